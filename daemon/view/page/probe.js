// The value under the pointer: of the slice that is met first, or of the voxel that is brightest along the ray, in what is
// shown.  Voxels as they came, without interpolation.
import { HALF, CELLS } from "./pvx.js";

const SIDE = 8;
// Which voxel of a brick, and of which brick.
function place(g, p) {
  const [bx, by, bz] = p.map((v) => v >> 3);
  return [(bz * g.nb[1] + by) * g.nb[0] + bx, ((p[2] & 7) * SIDE + (p[1] & 7)) * SIDE + (p[0] & 7)];
}
// The values of a voxel; 0 where there is no brick.
function values(v, p) {
  const c = v.grid.channels, [id, cell] = place(v.grid, p);
  let lo = 0, hi = v.ids.length;
  while (lo < hi) { const mid = lo + hi >> 1; if (v.ids[mid] < id) lo = mid + 1; else hi = mid; }
  return Array.from({ length: c }, (_, q) => v.ids[lo] === id ? HALF[v.half[(lo * CELLS + cell) * c + q]] : 0);
}

export class Probe {
  constructor(volume, bars, showBars) {
    this.volume = volume;
    this.bars = bars;
    this.shown = showBars ? bars : volume;
  }
  // ray: {eye, d (unit), metres; slices, sliceAt, clip of flame.js, dark: values that are glass}.  {} where it meets nothing.
  ask(ray) {
    if (!this.volume || !this.shown) return {};
    const g = this.volume.grid, side = g.n.map((n, a) => (g.max[a] - g.min[a]) / n);
    const lo = g.n.map((_, a) => g.min[a] + ray.clip[a] * (g.max[a] - g.min[a])), hi = g.n.map((_, a) => g.min[a] + ray.clip[a + 3] * (g.max[a] - g.min[a]));
    const p = ray.slices ? this.slice(ray, g, side, lo, hi) : this.brightest(ray, g, side, lo, hi);
    if (!p) return {};
    return {
      where: p.map((i, a) => g.min[a] + (i + 0.5) * side[a]), slice: Boolean(ray.slices), bars: this.shown !== this.volume,
      values: values(this.volume, p), sd: this.bars ? values(this.bars, p) : null, set: this.volume.set,
    };
  }
  voxel(g, side, q) {
    return q.map((x, a) => Math.min(g.n[a] - 1, Math.max(0, Math.floor((x - g.min[a]) / side[a]))));
  }
  slice(ray, g, side, lo, hi) {
    let best = Infinity, found = null;
    for (let k = 0; k < 3; k++) {
      const at = g.min[k] + (Math.floor(Math.min(ray.sliceAt[k], 0.999999) * g.n[k]) + 0.5) * side[k], t = (at - ray.eye[k]) / ray.d[k];
      if (!(t > 0) || t >= best) continue;
      const q = ray.eye.map((e, a) => a === k ? at : e + t * ray.d[a]);
      if (q.some((x, a) => x < lo[a] - 1e-9 || x > hi[a] + 1e-9)) continue;
      const p = this.voxel(g, side, q);
      if (Math.max(...values(this.shown, p)) <= ray.dark) continue; // glass
      best = t;
      found = p;
    }
    return found;
  }
  brightest(ray, g, side, lo, hi) {
    let from = 0, to = Infinity, most = 0, found = null;
    for (let a = 0; a < 3; a++) {
      const d = Math.abs(ray.d[a]) < 1e-9 ? 1e-9 : ray.d[a], t = [(lo[a] - ray.eye[a]) / d, (hi[a] - ray.eye[a]) / d];
      from = Math.max(from, Math.min(...t));
      to = Math.min(to, Math.max(...t));
    }
    for (let t = from, step = 0.4 * Math.min(...side); t < to; t += step) {
      const p = this.voxel(g, side, ray.eye.map((e, a) => e + t * ray.d[a])), v = Math.max(...values(this.shown, p));
      if (v > most) { most = v; found = p; }
    }
    return found;
  }
}

// "12.3 ± 0.8": two digits of the bar, as `pyrovox value` prints them; four of a value without one.
export function figure(v, sd) {
  if (!(sd > 0)) return Number(v.toPrecision(4)).toString();
  const size = Math.max(Math.abs(v), sd), last = Math.floor(Math.log10(sd)) - 1;
  if (size >= 1e5 || last < -6) return `${v.toPrecision(4)} ± ${sd.toPrecision(2)}`;
  const decimals = Math.max(0, -last);
  return `${v.toFixed(decimals)} ± ${sd.toFixed(decimals)}`;
}

// PVP_DOUBTS of proto/pvp.h.
export const DOUBTS = [
  "the model misses the pictures by more than noise, calibration and texture explain",
  "there are fewer than five cameras",
  "the flame has detail as fine as its voxels, so finer detail is likely lost",
  "too few draws have been made yet",
  "noise hides detail that is finer than a few voxels",
];
export const doubts = (bits) => Array.from({ length: 32 }, (_, b) => b).filter((b) => bits >>> b & 1)
  .map((b) => DOUBTS[b] ?? "for a reason that this page does not know");
