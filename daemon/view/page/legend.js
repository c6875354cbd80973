// The colour bar: of light, whose range the exposure sets, or of a scale of its own with round ticks (scale.js), and the rows
// of the panel that set that range.
import { Scale, quantity, ticks, words } from "./scale.js";
import { table, srgb8 } from "./colours.js";

const $ = (id) => document.getElementById(id);
export class Legend {
  constructor(changed) {
    Object.assign(this, { changed, scale: new Scale(), own: null, units: "", bars: false, chosen: false });
    const typed = () => {
      const low = Number($("scale-low").value), high = Number($("scale-high").value);
      if ($("scale-low").value === "" || $("scale-high").value === "" || !this.scale.set(low, high)) return;
      $("scale-auto").checked = false;
      this.changed();
    };
    for (const id of ["scale-low", "scale-high"]) $(id).addEventListener("change", typed);
    $("scale-auto").addEventListener("input", () => {
      this.scale.auto = $("scale-auto").checked;
      this.scale.known = false;
      if (this.span) this.follow(this.span);
      this.changed();
    });
  }
  // A session's units.  Colours are those of the quantity until others are chosen.
  start(units, look) {
    const other = units !== this.units;
    this.own = quantity(units);
    this.units = units;
    if (!this.chosen) $("colours").value = look.colours = this.own?.colours ?? "fire";
    $("exposure-rows").hidden = Boolean(this.own);
    $("scale-rows").hidden = !this.own;
    for (const e of document.querySelectorAll("[data-quantity]")) e.textContent = this.own?.name ?? "flame";
    for (const e of document.querySelectorAll("[data-units]")) e.textContent = units;
    if (other) this.again();
  }
  // Another quantity, or its bars: a range of their own.
  again(bars = this.bars) {
    this.bars = bars;
    this.span = null;
    $("scale-auto").checked = true;
    this.scale.auto = true;
    this.scale.clear();
  }
  follow(span) {
    this.span = span;
    this.scale.follow(span, this.own.zero || this.bars);
  }
  show(look, grid) {
    const grey = grid?.channels === 1, own = this.own;
    look.range = own ? [this.scale.low, this.scale.high] : null;
    $("colours-row").hidden = !grey;
    $("legend").hidden = !grey || (own && !this.scale.known && this.scale.auto);
    $("legend").classList.toggle("own", Boolean(own));
    if (!grey) return;
    const map = table(look.colours), bar = new ImageData(256, 1); // even in the value; the colours of light are even in sRGB
    for (let i = 0; i < 256; i++) { const at = own ? i : srgb8(i / 255); bar.data.set(map.subarray(4 * at, 4 * at + 4), 4 * i); }
    $("map").getContext("2d").putImageData(bar, 0, 0);
    if (own) { this.ticks(look); return; }
    const full = 1 / look.exposure, deep = Math.min(...grid.max.map((m, a) => m - grid.min[a])) * 0.25;
    $("map-high").textContent = (look.slices ? full / deep : full).toPrecision(3);
    $("map-unit").textContent = `${this.bars ? "± " : ""}${look.slices ? "1/m" : "pixel value"}`;
  }
  ticks(look) {
    const { low, high } = this.scale;
    $("map-unit").textContent = this.title(look);
    $("map-ticks").replaceChildren(...ticks(low, high).map((x) => {
      const t = document.createElement("span");
      t.textContent = words(x);
      t.style.left = `${100 * (x - low) / (high - low)}%`;
      return t;
    }));
    for (const [id, x] of [["scale-low", low], ["scale-high", high]]) if (document.activeElement !== $(id)) $(id).value = words(x);
  }
  title(look) {
    const where = look.slices ? "in the slices" : `${this.bars ? "largest" : this.own.most} along each line of sight`;
    return `${this.bars ? "error bar of " : ""}${this.own.name}, ${this.units} · ${where}`;
  }
  // The same on a picture that is saved; k: pixels of it in one of the page's.
  paint(c, look, k) {
    const { low, high } = this.scale, x0 = 16 * k, y0 = 30 * k, w = 260 * k, h = 10 * k;
    c.font = `${12 * k}px system-ui, sans-serif`;
    c.fillStyle = "#e6eaf0";
    c.fillText(this.title(look), x0, y0 - 8 * k);
    c.imageSmoothingEnabled = false;
    c.drawImage($("map"), x0, y0, w, h);
    c.textAlign = "center";
    for (const x of ticks(low, high)) {
      const at = x0 + w * (x - low) / (high - low);
      c.fillRect(at - k / 2, y0 + h, k, 4 * k);
      c.fillText(words(x), at, y0 + h + 17 * k);
    }
  }
}
