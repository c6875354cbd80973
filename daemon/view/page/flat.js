// Without WebGL2: the sums along the three axes, on an ordinary canvas; of a scale of its own the largest values.
import { HALF } from "./pvx.js";
import { plain } from "./flame.js";
import { srgb, table } from "./colours.js";


export class Flat {
  constructor(canvas) {
    this.canvas = canvas;
    this.c2d = canvas.getContext("2d");
    this.look = plain();
    this.clear();
  }
  misfit() { return ""; }
  clear() { this.grid = this.dense = null; this.sums = []; }
  take(v) {
    const g = this.grid = v.grid, c = g.channels, side = g.n.map((n, a) => (g.max[a] - g.min[a]) / n);
    // kept whole: what comes is only what has changed
    if (!this.dense || this.dense.length !== g.n[0] * g.n[1] * g.n[2] * c) this.dense = new Uint16Array(g.n[0] * g.n[1] * g.n[2] * c);
    for (const b of v.boxes)
      for (let z = 0; z < 8 && b.at[2] + z < g.n[2]; z++)
        for (let y = 0; y < 8 && b.at[1] + y < g.n[1]; y++) {
          const w = Math.min(b.size[0], g.n[0] - b.at[0]) * c, from = b.offset + (z * 8 + y) * b.size[0] * c;
          this.dense.set(v.data.subarray(from, from + w), (((b.at[2] + z) * g.n[1] + b.at[1] + y) * g.n[0] + b.at[0]) * c);
        }
    const [nx, ny, nz] = g.n, own = Boolean(this.look.range);
    const put = (s, p, e, deep) => { s[p] = own ? Math.max(s[p], e) : s[p] + e * deep; };
    this.sums = [[nx, nz], [ny, nz], [nx, ny]].map(([w, h]) => ({ w, h, v: new Float32Array(w * h * 3) }));
    const [front, left, top] = this.sums;
    for (let k = 0, i = 0; k < nz; k++)
      for (let y = 0; y < ny; y++)
        for (let x = 0; x < nx; x++, i += c)
          for (let q = 0; q < 3; q++) {
            const e = HALF[this.dense[i + (c === 3 ? q : 0)]];
            if (e === 0) continue;
            put(front.v, ((nz - 1 - k) * nx + x) * 3 + q, e, side[1]);
            put(left.v, ((nz - 1 - k) * ny + y) * 3 + q, e, side[0]);
            put(top.v, ((ny - 1 - y) * nx + x) * 3 + q, e, side[2]);
          }
    return true;
  }
  fence(done) { done(); }
  draw(camera, fov, whole, done) {
    const c = this.canvas, d = this.c2d, w = c.width = c.clientWidth, h = c.height = c.clientHeight;
    d.fillStyle = "#04050a";
    d.fillRect(0, 0, w, h);
    d.imageSmoothingEnabled = this.grid?.basis === 1;
    const map = table(this.look.colours), grey = this.grid?.channels === 1, tall = h > w;
    this.sums.forEach((s, i) => {
      const image = new ImageData(s.w, s.h), names = ["from the front (-y)", "from the side (+x)", "from above"];
      for (let p = 0; p < s.w * s.h; p++) {
        const own = this.look.range;
        if (own) {
          const x = s.v[3 * p], i = 4 * Math.round(255 * Math.min(1, Math.max(0, (x - own[0]) / (own[1] - own[0]))));
          image.data.set(x > 0 ? map.subarray(i, i + 4) : [4, 5, 10, 255], 4 * p);
          continue;
        }
        const at = grey ? 4 * Math.round(srgb(s.v[3 * p] * this.look.exposure)) : -1;
        for (let q = 0; q < 3; q++) image.data[4 * p + q] = grey ? map[at + q] : srgb(s.v[3 * p + q] * this.look.exposure);
        image.data[4 * p + 3] = 255;
      }
      const off = new OffscreenCanvas(s.w, s.h);
      off.getContext("2d").putImageData(image, 0, 0);
      const cw = tall ? w : w / 3, ch = tall ? h / 3 : h, k = 0.86 * Math.min(cw / s.w, (ch - 40) / s.h);
      const x = (tall ? 0 : i * cw) + (cw - k * s.w) / 2, y = (tall ? i * ch : 0) + (ch - k * s.h) / 2;
      d.drawImage(off, x, y, k * s.w, k * s.h);
      d.fillStyle = "#aab4c2";
      d.font = "12px system-ui, sans-serif";
      d.fillText(names[i], x, y - 8);
    });
    done();
  }
}
