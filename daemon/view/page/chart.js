// A small time line: the last values as a line, the newest and the largest in words.
const KEEP = 240;

export class Chart {
  constructor(parent, name, unit, digits = 1) {
    this.v = [];
    this.unit = unit;
    this.digits = digits;
    const box = document.createElement("div"), title = document.createElement("span");
    box.className = "chart";
    title.textContent = name;
    this.words = document.createElement("b");
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("aria-hidden", "true");
    box.append(title, this.words, this.canvas);
    parent.append(box);
  }
  add(x) {
    if (!Number.isFinite(x)) return;
    this.v.push(x);
    if (this.v.length > KEEP) this.v.shift();
    this.dirty = true;
  }
  clear() { this.v = []; this.dirty = true; }
  draw() {
    if (!this.dirty) return;
    this.dirty = false;
    const k = this.canvas, c = k.getContext("2d"), w = k.width = k.clientWidth || 120, h = k.height = k.clientHeight || 26;
    const top = Math.max(...this.v, 1e-12), now = this.v[this.v.length - 1];
    this.words.textContent = now === undefined ? "–" : `${now.toFixed(this.digits)}${this.unit ? " " + this.unit : ""}`;
    this.words.title = `largest ${top.toFixed(this.digits)} ${this.unit}`;
    c.strokeStyle = "#ff9d47";
    c.lineWidth = 1.25;
    c.beginPath();
    this.v.forEach((x, i) => c[i ? "lineTo" : "moveTo"](i / (KEEP - 1) * w, h - 2 - x / top * (h - 5)));
    c.stroke();
  }
}
