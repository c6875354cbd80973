// Volumes that are not light but have a scale of their own, by their units: what they are called, and the range of their
// colours.  A ray then shows the largest value that it meets, and 0 is none.
const known = {
  K: { name: "temperature", most: "hottest", voxel: "hottest voxel", voxels: "voxels with a temperature", zero: false, colours: "plasma", digits: 0 },
  ppm: { name: "soot", most: "most soot", voxel: "voxel with most soot", voxels: "voxels with soot", zero: true, colours: "viridis", digits: 3 },
};
export const quantity = (units) => known[units] ?? null;

// The step between round numbers, of which about n lie in a span.
export function step(span, n = 4) {
  const raw = span / n, p = 10 ** Math.floor(Math.log10(raw)), m = raw / p;
  return p * (m <= 1 ? 1 : m <= 2 ? 2 : m <= 2.5 ? 2.5 : m <= 5 ? 5 : 10);
}
export const words = (x) => Number(x.toPrecision(6)).toString();
// The round numbers from lo to hi.
export function ticks(lo, hi) {
  const s = step(hi - lo), out = [];
  for (let k = Math.ceil(lo / s - 1e-6); k * s <= hi + 1e-6 * s; k++) out.push(Number((k * s).toPrecision(12)));
  return out;
}
// A round range about both.
export function round(lo, hi) {
  if (!(hi > lo)) { const d = Math.abs(hi) * 0.05 || 1; lo -= d; hi += d; }
  const s = step(hi - lo);
  return [Math.floor(lo / s + 1e-6) * s, Math.ceil(hi / s - 1e-6) * s].map((x) => Number(x.toPrecision(12)));
}

export class Scale {
  constructor() { this.auto = true; this.clear(); }
  clear() { this.low = 0; this.high = 1; this.known = false; }
  // What a volume has: {low, high}, all but its outliers.  The range stays while that fills at least half of it.
  follow(span, zero) {
    if (!span || !(span.high > 0)) return false;
    const lo = zero ? 0 : span.low, hi = span.high, was = [this.low, this.high];
    this.seen = [lo, hi];
    if (!this.auto || (this.known && lo >= this.low && hi <= this.high && hi - lo >= 0.5 * (this.high - this.low))) return false;
    [this.low, this.high] = round(lo, hi);
    this.known = true;
    return was[0] !== this.low || was[1] !== this.high;
  }
  set(low, high) {
    if (!Number.isFinite(low) || !Number.isFinite(high) || !(high > low)) return false;
    Object.assign(this, { low, high, auto: false });
    return true;
  }
}
