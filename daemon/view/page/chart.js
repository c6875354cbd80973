// A small time line: the last values over the seconds in which they came, from 0 to the largest.
const KEEP = 240;

export class Chart {
  // zero: the axis begins at 0, else below the smallest.
  constructor(parent, name, unit, digits = 1, zero = true) {
    this.clear();
    this.zero = zero;
    this.unit = unit;
    this.digits = digits;
    const box = this.box = document.createElement("div"), title = document.createElement("span");
    box.className = "chart";
    this.title = title;
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
    this.t.push(performance.now() / 1000);
    if (this.v.length > KEEP) { this.v.shift(); this.t.shift(); }
    this.dirty = true;
  }
  name(name, unit, digits = this.digits) { this.title.textContent = name; Object.assign(this, { unit, digits, dirty: true }); }
  show(on) { this.box.hidden = !on; }
  clear() { this.v = []; this.t = []; this.dirty = true; }
  draw() {
    if (!this.dirty || this.box.hidden) return;
    this.dirty = false;
    const k = this.canvas, c = k.getContext("2d"), dpr = Math.min(devicePixelRatio || 1, 2), w = k.clientWidth || 120, h = k.clientHeight || 52;
    k.width = w * dpr;
    k.height = h * dpr;
    c.scale(dpr, dpr);
    const n = this.v.length, top = Math.max(...this.v, 1e-12), least = this.zero ? 0 : Math.floor(0.98 * Math.min(...this.v)), now = this.v[n - 1];
    this.words.textContent = now === undefined ? "–" : `${now.toFixed(this.digits)}${this.unit ? " " + this.unit : ""}`;
    if (!n) return;
    const high = top.toFixed(this.digits), from = this.t[0], span = this.t[n - 1] - from;
    c.font = "11px system-ui, sans-serif";
    c.fillStyle = c.strokeStyle = "#aab4c2";
    const left = Math.ceil(Math.max(c.measureText(high).width, c.measureText(least.toFixed(0)).width)) + 5, low = h - 14, high_y = 5;
    c.textAlign = "right";
    c.fillText(high, left - 4, high_y + 4);
    c.fillText(n && Number.isFinite(least) ? least.toFixed(0) : "0", left - 4, low + 2);
    c.fillText("0 s", w, h - 1);
    c.textAlign = "left";
    if (span > 0) c.fillText(`−${span.toFixed(span < 10 ? 1 : 0)} s`, left, h - 1);
    c.lineWidth = 1;
    c.globalAlpha = 0.45;
    c.beginPath();
    c.moveTo(left + 0.5, high_y);
    c.lineTo(left + 0.5, low + 0.5);
    c.lineTo(w, low + 0.5);
    c.stroke();
    c.globalAlpha = 1;
    c.strokeStyle = "#ff9d47";
    c.lineWidth = 1.25;
    c.beginPath();
    this.v.forEach((x, i) => c[i ? "lineTo" : "moveTo"](left + (span > 0 ? (this.t[i] - from) / span : 1) * (w - left - 1), low - (x - least) / (top - least) * (low - high_y)));
    c.stroke();
  }
}
