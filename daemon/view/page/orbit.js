// A camera that goes round a place: mouse, touch, pen and keyboard.  Angles in radians, z up; equations as the
// command-line renderer's (`pyrovox render --eye`).
const sub = (a, b) => a.map((v, i) => v - b[i]), dot = (a, b) => a.reduce((s, v, i) => s + v * b[i], 0);
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };

// right, up, forward of unit length.
export function frame(eye, target, up = [0, 0, 1]) {
  const forward = unit(sub(target, eye)), right = unit(cross(forward, up));
  return { eye, right, up: cross(right, forward), forward };
}
// To the picture: x, y from -1 to 1, and the depth; null behind the camera.
export function project(f, tan, aspect, p) {
  const d = sub(p, f.eye), z = dot(d, f.forward);
  return z > 1e-6 ? [dot(d, f.right) / (z * tan * aspect), dot(d, f.up) / (z * tan), z] : null;
}

export class Orbit {
  constructor(canvas, changed) {
    this.changed = changed;
    this.fov = 40 * Math.PI / 180;
    this.home = { azimuth: -0.9, elevation: 0.18, distance: 3, target: [0, 0, 0.5] };
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.turning = false;
    this.reset();
    this.listen(canvas);
  }
  frameBox(min, max) {
    const size = max.map((m, i) => m - min[i]);
    this.home.target = max.map((m, i) => (m + min[i]) / 2);
    this.home.distance = 0.54 * Math.hypot(...size) / Math.tan(this.fov / 2);
    this.size = Math.max(...size);
    this.reset();
  }
  reset() { Object.assign(this, this.home, { target: [...this.home.target] }); this.changed(); }
  get eye() {
    const { azimuth: a, elevation: e, distance: r, target: t } = this;
    return [t[0] + r * Math.cos(e) * Math.cos(a), t[1] + r * Math.cos(e) * Math.sin(a), t[2] + r * Math.sin(e)];
  }
  frame() { return frame(this.eye, this.target); }
  turn(dx, dy) {
    this.azimuth -= dx;
    this.elevation = Math.max(-1.5, Math.min(1.5, this.elevation + dy));
    this.changed();
  }
  zoom(f) {
    this.distance = Math.max(this.home.distance * 0.05, Math.min(this.home.distance * 8, this.distance * f));
    this.changed();
  }
  pan(dx, dy) {
    const f = this.frame(), k = 2 * this.distance * Math.tan(this.fov / 2);
    this.target = this.target.map((t, i) => t - k * (dx * f.right[i] - dy * f.up[i]));
    this.changed();
  }
  // asked: by a person, now; else it is left to what they said of motion.
  spin(on, asked) { this.turning = on && (asked || !this.still.matches); }
  step(seconds) { if (this.turning) this.turn(-0.35 * seconds, 0); }

  listen(canvas) {
    const at = new Map();
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); at.set(e.pointerId, [e.clientX, e.clientY]); this.turning = false; });
    canvas.addEventListener("pointermove", (e) => {
      const was = at.get(e.pointerId);
      if (!was) return;
      const now = [e.clientX, e.clientY], h = canvas.clientHeight || 1, dx = (now[0] - was[0]) / h, dy = (now[1] - was[1]) / h;
      if (at.size === 2) {
        const other = [...at].find(([id]) => id !== e.pointerId)[1];
        const before = Math.hypot(was[0] - other[0], was[1] - other[1]), after = Math.hypot(now[0] - other[0], now[1] - other[1]);
        this.pan(dx / 2, dy / 2);
        if (before > 1 && after > 1) this.zoom(before / after);
      } else if (e.buttons & 6 || e.shiftKey || e.ctrlKey) this.pan(dx, dy);
      else this.turn(3.2 * dx, 3.2 * dy);
      at.set(e.pointerId, now);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => at.delete(e.pointerId));
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(Math.max(-60, Math.min(60, e.deltaY)) * 0.004)); }, { passive: false });
    canvas.addEventListener("dblclick", () => this.reset());
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("keydown", (e) => {
      if (e.ctrlKey || e.altKey || e.metaKey) return; // the browser's
      const k = e.key, move = e.shiftKey ? (x, y) => this.pan(x * 0.04, y * 0.04) : (x, y) => this.turn(x * 0.08, y * 0.08);
      if (k === "ArrowLeft") move(-1, 0); else if (k === "ArrowRight") move(1, 0);
      else if (k === "ArrowUp") move(0, -1); else if (k === "ArrowDown") move(0, 1);
      else if (k === "+" || k === "=") this.zoom(0.9); else if (k === "-") this.zoom(1 / 0.9);
      else if (k === "Home" || k === "0") this.reset();
      else return;
      e.preventDefault();
    });
  }
}
