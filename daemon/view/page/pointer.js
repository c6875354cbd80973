// The value under the pointer, with its error bar: the worker has the volume and is asked (probe.js), one question at a time.
import { unit } from "./orbit.js";
import { figure } from "./probe.js";
import { quantity } from "./scale.js";

export class Pointer {
  // ask: {link, over(), look() -> {frame, fov, look, grid, units} or null where nothing can be asked}
  constructor(stage, label, ask) {
    Object.assign(this, { stage, label, ask, over: false, at: null, waiting: false, anew: false });
    for (const kind of ["pointermove", "pointerdown"])
      stage.addEventListener(kind, (e) => {
        if (e.target.id !== "flame" || (kind === "pointermove" && e.buttons)) { this.leave(); return; }
        const box = e.target.getBoundingClientRect();
        this.at = [e.clientX - box.left, e.clientY - box.top, box.width, box.height];
        if (!this.over) { this.over = true; ask.over(); }
        this.question();
      });
    stage.addEventListener("pointerleave", () => this.leave());
  }
  leave() {
    this.at = null;
    this.label.hidden = true;
    if (this.over) { this.over = false; this.ask.over(); }
  }
  // The picture, or the volume, is another.
  again() { if (this.at) this.question(); }
  question() {
    const now = this.ask.look();
    if (!now || !this.at) { this.label.hidden = true; return; }
    if (this.waiting) { this.anew = true; return; }
    const [px, py, w, h] = this.at, { frame: f, fov, look: k, grid: g } = now, tan = Math.tan(fov / 2);
    const x = (2 * px / w - 1) * tan * w / h, y = (1 - 2 * py / h) * tan;
    const d = unit(f.forward.map((v, a) => v + x * f.right[a] + y * f.up[a])), deep = Math.min(...g.max.map((m, a) => m - g.min[a])) * 0.25;
    this.waiting = true;
    this.ask.link.probe({ at: [px, py], eye: f.eye, d, slices: k.slices, sliceAt: k.sliceAt, clip: k.clip, dark: k.range ? 0 : 0.002 / (deep * k.exposure) });
  }
  answer(m) {
    this.waiting = false;
    if (this.anew) { this.anew = false; this.question(); }
    const now = this.ask.look();
    this.label.hidden = !this.at || !m.values || !now;
    if (this.label.hidden) return;
    const names = m.values.length === 3 ? ["red ", "green ", "blue "] : [""], small = document.createElement("small");
    this.label.textContent = m.values.map((v, c) => `${names[c]}${figure(v, m.sd?.[c])} ${now.units}`).join("\n");
    small.textContent = `${m.slice ? "in the slice" : `${m.bars ? "largest bar" : quantity(now.units)?.most ?? "brightest"} along this line of sight`}\n` +
      `${m.where.map((x, a) => `${"xyz"[a]} ${x.toFixed(3)}`).join(", ")} m${m.sd ? "" : "\nno error bar"}`;
    this.label.append(small);
    const [px, py, w, h] = m.at.concat(this.at.slice(2)), wide = this.label.offsetWidth, tall = this.label.offsetHeight;
    this.label.style.left = `${Math.max(4, px + 16 + wide > w ? px - wide - 12 : px + 16)}px`;
    this.label.style.top = `${Math.max(4, py + 16 + tall > h ? py - tall - 12 : py + 16)}px`;
  }
}
