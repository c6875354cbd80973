// From one volume to the next: what has to go into the texture.  Bricks that came and bricks that left, which become
// zeros, joined along x into boxes, so that there are few uploads.
import { CELLS, HALF } from "./pvx.js";

const SIDE = 8;
export const MACRO = 4; // cells that are stepped over together (shader.js)

export class Bricks {
  constructor() { this.forget(); }
  forget() { this.had = new Uint32Array(0); this.last = null; }

  // The last volume whole, for a texture that was lost.
  again() {
    const v = this.last;
    this.forget();
    return v ? this.take(v) : null;
  }

  // {boxes: [{at, size, offset}] with offsets in half floats into data, data, occupied: Uint8Array of the blocks}
  take(v) {
    const { grid: g, ids } = v, [nbx, nby, nbz] = g.nb, runs = [];
    let i = 0, j = 0, total = 0;
    // both lists ascend: merge them
    while (i < ids.length || j < this.had.length) {
      const a = i < ids.length ? ids[i] : Infinity, b = j < this.had.length ? this.had[j] : Infinity;
      const id = Math.min(a, b), from = a <= b ? i : -1, run = runs[runs.length - 1];
      if (a === id) i++;
      if (b === id) j++;
      if (run && run.id + run.from.length === id && id % nbx !== 0) run.from.push(from);
      else runs.push({ id, from: [from] });
      total++;
    }
    const per = CELLS * g.channels, data = new Uint16Array(total * per), boxes = [];
    let offset = 0;
    for (const run of runs) {
      const bx = run.id % nbx, by = Math.floor(run.id / nbx) % nby, bz = Math.floor(run.id / nbx / nby);
      run.from.forEach((b, k) => {
        if (b >= 0) this.copy(v, b, [bx + k, by, bz], data, offset, run.from.length, k);
      });
      boxes.push({ at: [bx * SIDE, by * SIDE, bz * SIDE], size: [run.from.length * SIDE, SIDE, SIDE], offset });
      offset += run.from.length * per;
    }
    this.had = ids;
    this.last = v;
    return { boxes, data, occupied: this.occupied(v) };
  }

  // The blocks of MACRO^3 voxels in which something is not 0.
  occupied(v) {
    const [bx, by, bz] = v.grid.nb, out = new Uint8Array(bx * by * bz * 8), c = v.grid.channels, row = SIDE * c / 2;
    const rows = CELLS / SIDE * 2;
    v.ids.forEach((id, b) => {
      const x = 2 * (id % bx), y = 2 * (Math.floor(id / bx) % by), z = 2 * Math.floor(id / bx / by);
      for (let r = 0, at = b * CELLS * c; r < rows; r++) { // half rows: 4 voxels
        let any = 0;
        for (let i = 0; i < row; i++) any |= v.half[at++];
        if (any) out[((z + (r >> 6)) * 2 * by + y + (r >> 3 & 1)) * 2 * bx + x + (r & 1)] = 1;
      }
    });
    return out;
  }

  // Brick b of the payload as the k-th of a box of `n`; what lies outside the grid is 0, whatever it says.
  copy(v, b, brick, data, offset, n, k) {
    const c = v.grid.channels, row = SIDE * c, inside = v.grid.n.map((s, a) => Math.min(SIDE, s - brick[a] * SIDE));
    for (let z = 0; z < inside[2]; z++)
      for (let y = 0; y < inside[1]; y++) {
        const from = (b * SIDE * SIDE + z * SIDE + y) * row;
        data.set(v.half.subarray(from, from + inside[0] * c), offset + ((z * SIDE + y) * n + k) * row);
      }
  }
}

// About the brightest pixel that it makes: the largest sum along x or y, of every other voxel.
export function brightest(v) {
  const { grid: g, ids, half } = v, [nbx, nby, nbz] = g.nb, c = g.channels;
  const front = new Float32Array(nbx * nbz * 16), left = new Float32Array(nby * nbz * 16);
  ids.forEach((id, b) => {
    const x0 = id % nbx * 4, y0 = Math.floor(id / nbx) % nby * 4, z0 = Math.floor(id / nbx / nby) * 4;
    for (let i = 0; i < 64; i++) {
      const x = i & 3, y = i >> 2 & 3, z = i >> 4, at = (b * CELLS + (2 * z * SIDE + 2 * y) * SIDE + 2 * x) * c;
      let e = HALF[half[at]];
      for (let q = 1; q < c; q++) e = Math.max(e, HALF[half[at + q]]);
      front[(z0 + z) * nbx * 4 + x0 + x] += e;
      left[(z0 + z) * nby * 4 + y0 + y] += e;
    }
  });
  const most = (a) => a.reduce((m, s) => Math.max(m, s), 0), side = (a) => 2 * (g.max[a] - g.min[a]) / g.n[a];
  return Math.max(most(front) * side(1), most(left) * side(0));
}

// What a volume of one channel has, but for its outliers: {low, high} leave out a 200th at each end; the largest, the mean
// and the number of the voxels that are not 0.  null: it has none.
export function span(v) {
  let n = 0, sum = 0, least = Infinity, most = 0;
  for (const h of v.half) {
    const x = HALF[h];
    if (!(x > 0)) continue;
    n++;
    sum += x;
    if (x < least) least = x;
    if (x > most) most = x;
  }
  if (!n) return null;
  const BINS = 512, bins = new Uint32Array(BINS), per = most > least ? (BINS - 1) / (most - least) : 0;
  for (const h of v.half) { const x = HALF[h]; if (x > 0) bins[Math.floor((x - least) * per)]++; }
  let a = 0, b = BINS - 1;
  for (let left = n / 200; (left -= bins[a]) > 0;) a++;
  for (let left = n / 200; (left -= bins[b]) > 0;) b--;
  return { low: per ? least + a / per : least, high: per ? Math.min(most, least + (b + 1) / per) : most, most, mean: sum / n, n };
}

// Which blocks of cells need a look, for a shader that walks through them.  The box basis' cells are voxels; the trilinear
// one's lie between voxel centres, so they reach one further, and into the next block.
export function cells(g, occupied) {
  const more = g.basis === 1 ? 1 : 0, n = g.n.map((s) => Math.ceil((s + more) / MACRO)), out = new Uint8Array(n[0] * n[1] * n[2]);
  const [nbx, nby, nbz] = g.nb.map((b) => 2 * b);
  for (let z = 0, at = 0; z < n[2]; z++)
    for (let y = 0; y < n[1]; y++)
      for (let x = 0; x < n[0]; x++, at++)
        for (let d = 0; d < (more ? 8 : 1) && !out[at]; d++) {
          const bx = x - (d & 1), by = y - (d >> 1 & 1), bz = z - (d >> 2);
          if (bx >= 0 && by >= 0 && bz >= 0 && bx < nbx && by < nby && bz < nbz && occupied[(bz * nby + by) * nbx + bx]) out[at] = 255;
        }
  return { n, out };
}
