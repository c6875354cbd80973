// Lines over the picture: the box with its metres, the cameras' frusta, slices' frames.
import { project } from "./orbit.js";

const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

export class Overlay {
  constructor(canvas) {
    this.canvas = canvas;
    this.c = canvas.getContext("2d");
    this.show = { box: true, cameras: true };
    this.rig = [];
    this.states = new Map(); // camera name -> "good" | "bad"
  }
  line(f, tan, aspect, a, b) {
    const p = project(f, tan, aspect, a), q = project(f, tan, aspect, b), c = this.c;
    if (!p || !q) return;
    c.moveTo((p[0] + 1) / 2 * this.w, (1 - p[1]) / 2 * this.h);
    c.lineTo((q[0] + 1) / 2 * this.w, (1 - q[1]) / 2 * this.h);
  }
  text(f, tan, aspect, at, words) {
    const p = project(f, tan, aspect, at), c = this.c;
    if (!p) return;
    const wide = c.measureText(words).width, x = (p[0] + 1) / 2 * this.w + 5, y = (1 - p[1]) / 2 * this.h;
    if (x < -wide || x > this.w + wide || y < 0 || y > this.h) return;
    c.fillText(words, Math.max(4, Math.min(this.w - wide - 4, x)), Math.max(14, Math.min(this.h - 6, y)));
  }
  clear() { this.canvas.width = 1; }
  draw(f, fov, grid, look) {
    const k = this.canvas, dpr = Math.min(devicePixelRatio || 1, 2), c = this.c;
    const w = Math.round(k.clientWidth * dpr), h = Math.round(k.clientHeight * dpr);
    if (k.width !== w || k.height !== h) { k.width = w; k.height = h; }
    this.w = w / dpr; this.h = h / dpr;
    c.setTransform(dpr, 0, 0, dpr, 0, 0);
    c.clearRect(0, 0, this.w, this.h);
    if (!grid) return;
    const tan = Math.tan(fov / 2), aspect = this.w / this.h, L = (a, b) => this.line(f, tan, aspect, a, b);
    c.font = "12px system-ui, sans-serif";
    c.lineWidth = 1;
    if (this.show.box) {
      const corner = (i) => [0, 1, 2].map((a) => (i >> a & 1 ? grid.max : grid.min)[a]);
      c.strokeStyle = "rgba(150,170,200,.32)";
      c.beginPath();
      for (const [a, b] of EDGES) L(corner(a), corner(b));
      c.stroke();
      c.fillStyle = "#aab4c2";
      const m = (x) => `${x.toFixed(Math.abs(x) < 10 ? 2 : 1)} m`;
      for (let a = 0; a < 3; a++) { // the length of each side, in its middle
        const p = [...grid.min], s = grid.max[a] - grid.min[a];
        p[a] += s / 2;
        if (a === 2) p[0] = grid.max[0];
        this.text(f, tan, aspect, p, `${"xyz"[a]} ${m(s)}`);
      }
    }
    if (look.slices) {
      c.strokeStyle = "rgba(255,170,80,.6)";
      c.beginPath();
      for (let a = 0; a < 3; a++) {
        if (!look.sliceOn[a]) continue;
        const at = grid.min[a] + look.sliceAt[a] * (grid.max[a] - grid.min[a]), b = (a + 1) % 3, d = (a + 2) % 3;
        const q = (i, j) => { const p = []; p[a] = at; p[b] = (i ? grid.max : grid.min)[b]; p[d] = (j ? grid.max : grid.min)[d]; return p; };
        L(q(0, 0), q(1, 0)); L(q(1, 0), q(1, 1)); L(q(1, 1), q(0, 1)); L(q(0, 1), q(0, 0));
      }
      c.stroke();
    }
    if (this.show.cameras) {
      const size = 0.16 * Math.max(...grid.max.map((x, a) => x - grid.min[a]));
      for (const cam of this.rig) {
        const bad = this.states.get(cam.name) === "bad", tip = (d) => cam.eye.map((x, a) => x + d[a] * size);
        c.strokeStyle = bad ? "rgba(255,110,90,.95)" : "rgba(120,190,255,.55)";
        c.fillStyle = bad ? "#ff8a76" : "#8fbfe8";
        c.beginPath();
        cam.corner.forEach((d, i) => { L(cam.eye, tip(d)); L(tip(d), tip(cam.corner[(i + 1) % 4])); });
        c.stroke();
        this.text(f, tan, aspect, cam.eye, cam.name);
      }
    }
  }
}
