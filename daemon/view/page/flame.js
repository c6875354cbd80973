// The volume in a 3-D texture of half floats, and the ray march through it (shader.js).  Draws when asked, and asks for
// the next picture only when something has changed.
import { vertex, fragment } from "./shader.js";
import { table } from "./colours.js";
import { MACRO } from "./bricks.js";

const SLOW_MS = 30, FAST_MS = 10, SETTLE_MS = 350, SCALE_MIN = 0.2;

function build(gl, kind, source) {
  const s = gl.createShader(kind);
  gl.shaderSource(s, source);
  gl.compileShader(s);
  if (!gl.getShaderParameter(s, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(s));
  return s;
}

// range: [first, last] of a scale of its own (scale.js); null: light
export const plain = () => ({ exposure: 1, range: null, colours: "fire", slices: false, sliceAt: [0.5, 0.5, 0.5], sliceOn: [1, 1, 1], clip: [0, 0, 0, 1, 1, 1] });

export class Flame {
  // lost(back): the context went, or is there again and wants the volume anew.
  constructor(canvas, lost) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, powerPreference: "high-performance", preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("this browser has no WebGL2");
    this.look = plain();
    this.scale = 1;
    this.ms = 0;
    canvas.addEventListener("webglcontextlost", (e) => { e.preventDefault(); this.grid = null; lost(false); });
    canvas.addEventListener("webglcontextrestored", () => { this.setup(); lost(true); });
    this.setup();
  }
  setup() {
    const gl = this.gl, p = this.program = gl.createProgram();
    gl.attachShader(p, build(gl, gl.VERTEX_SHADER, vertex));
    gl.attachShader(p, build(gl, gl.FRAGMENT_SHADER, fragment));
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(p));
    gl.useProgram(p);
    this.at = new Proxy({}, { get: (seen, k) => seen[k] ??= gl.getUniformLocation(p, k) });
    gl.bindVertexArray(gl.createVertexArray());
    this.voxels = this.cells = this.grid = null;
    this.palette = "";
    this.colours = gl.createTexture();
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    for (const [i, name] of ["voxels", "cells", "colours"].entries()) gl.uniform1i(this.at[name], i);
  }
  texture(unit, filter) {
    const gl = this.gl, t = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_3D, t);
    for (const k of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(gl.TEXTURE_3D, k, gl.CLAMP_TO_EDGE);
    for (const k of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, k, filter);
    return t;
  }
  // What a grid takes; "" if it fits.
  misfit(g) {
    if (this.gl.isContextLost()) return "";
    const most = this.gl.getParameter(this.gl.MAX_3D_TEXTURE_SIZE), side = Math.max(...g.nb) * 8 + 2;
    return side > most ? `this machine's textures end at ${most} voxels a side, the volume needs ${side}` : "";
  }
  clear() { this.grid = null; }
  begin(g) {
    const gl = this.gl, grey = g.channels === 1;
    for (const t of [this.voxels, this.cells]) if (t) gl.deleteTexture(t);
    this.voxels = this.texture(0, g.basis === 1 ? gl.LINEAR : gl.NEAREST);
    // a border of zeros: the trilinear basis falls to zero one spacing outside
    gl.texStorage3D(gl.TEXTURE_3D, 1, grey ? gl.R16F : gl.RGB16F, ...g.nb.map((n) => n * 8 + 2));
    this.cells = this.texture(1, gl.NEAREST);
    this.macros = g.n.map((n) => Math.ceil((n + (g.basis === 1 ? 1 : 0)) / MACRO));
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.R8, ...this.macros);
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error("this machine's graphics have no memory for the volume");
    this.grid = g;
  }
  // A volume of the worker's (bricks.js); false if its context is gone.
  take(v) {
    const gl = this.gl, g = v.grid;
    if (gl.isContextLost()) return false;
    if (!this.grid) this.begin(g);
    const format = g.channels === 1 ? gl.RED : gl.RGB;
    gl.activeTexture(gl.TEXTURE0);
    for (const b of v.boxes)
      gl.texSubImage3D(gl.TEXTURE_3D, 0, ...b.at.map((x) => x + 1), ...b.size, format, gl.HALF_FLOAT, v.data, b.offset);
    gl.activeTexture(gl.TEXTURE1);
    gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, 0, ...v.cells_n, gl.RED, gl.UNSIGNED_BYTE, v.cells);
    return true;
  }
  // done() when all that was said to the GPU so far is done.
  fence(done) {
    const gl = this.gl, f = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0), channel = new MessageChannel();
    gl.flush();
    let turns = 0;
    const ask = () => {
      const s = gl.isContextLost() ? gl.CONDITION_SATISFIED : gl.clientWaitSync(f, 0, 0); // nothing is to be waited for
      if (s === gl.TIMEOUT_EXPIRED) { if (turns++ < 50) channel.port2.postMessage(0); else setTimeout(ask, 1); return; }
      gl.deleteSync(f);
      channel.port1.close();
      done();
    };
    channel.port1.onmessage = ask;
    ask();
  }
  // camera: orbit.js' frame; fov in radians.  count: red is samples / 1024.
  render(w, h, camera, fov, count = 0) {
    const gl = this.gl, g = this.grid, at = this.at, k = this.look;
    gl.viewport(0, 0, w, h);
    if (!g) { gl.clearColor(0.016, 0.02, 0.027, 1); gl.clear(gl.COLOR_BUFFER_BIT); return; }
    if (this.palette !== k.colours) {
      gl.activeTexture(gl.TEXTURE2);
      gl.bindTexture(gl.TEXTURE_2D, this.colours);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, table(k.colours));
      for (const f of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, f, gl.NEAREST);
      this.palette = k.colours;
    }
    const side = g.n.map((n, a) => (g.max[a] - g.min[a]) / n), more = g.basis === 1 ? 0.5 : 0;
    const inCells = (p) => p.map((x, a) => (x - g.min[a]) / side[a] + more), scaled = (d, s) => d.map((x, a) => x * s / side[a]);
    const tan = Math.tan(fov / 2), end = (f, a) => f <= 0 ? 0 : f >= 1 ? g.n[a] + 2 * more : f * g.n[a] + more;
    gl.uniform3fv(at.eye, inCells(camera.eye));
    gl.uniform3fv(at.right, scaled(camera.right, tan * w / h));
    gl.uniform3fv(at.up, scaled(camera.up, tan));
    gl.uniform3fv(at.forward, scaled(camera.forward, 1));
    gl.uniform3fv(at.metres, side);
    gl.uniform3fv(at.lo, [0, 1, 2].map((a) => end(k.clip[a], a)));
    gl.uniform3fv(at.hi, [0, 1, 2].map((a) => end(k.clip[a + 3], a)));
    gl.uniform3fv(at.grid, g.n);
    gl.uniform3iv(at.macros, this.macros);
    gl.uniform1i(at.trilinear, g.basis);
    gl.uniform1i(at.grey, g.channels === 1 ? 1 : 0);
    gl.uniform1i(at.slices, k.slices ? 1 : 0);
    gl.uniform1i(at.count, count);
    gl.uniform1f(at.exposure, k.exposure);
    gl.uniform1i(at.own, k.range ? 1 : 0);
    gl.uniform2fv(at.range, k.range ? [k.range[0], 1 / (k.range[1] - k.range[0])] : [0, 1]);
    gl.uniform3fv(at.slice_at, k.sliceAt.map((f, a) => (Math.floor(Math.min(f, 0.999999) * g.n[a]) + 0.5) + more));
    gl.uniform3fv(at.slice_on, k.sliceOn);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
  // Onto the screen, at the resolution that the machine keeps up with; all of it once nothing has moved for a while.
  draw(camera, fov, whole, done) {
    const c = this.canvas, dpr = Math.min(devicePixelRatio || 1, 2), s = whole ? 1 : this.scale;
    const w = Math.max(16, Math.round(c.clientWidth * dpr * s)), h = Math.max(16, Math.round(c.clientHeight * dpr * s));
    if (c.width !== w || c.height !== h) { c.width = w; c.height = h; }
    const t0 = performance.now();
    this.render(w, h, camera, fov);
    this.fence(() => {
      this.ms = performance.now() - t0;
      if (!whole) {
        if (this.ms > SLOW_MS) this.scale = Math.max(SCALE_MIN, this.scale * Math.max(0.6, Math.sqrt(SLOW_MS / this.ms)));
        else if (this.ms < FAST_MS && this.scale < 1) this.scale = Math.min(1, this.scale * 1.15);
      }
      done();
    });
  }
  // Pixels of a picture of its own size, rows from the top; for tests and screenshots.
  pixels(w, h, camera, fov, count = 0) {
    const gl = this.gl, t = gl.createTexture(), f = gl.createFramebuffer(), out = new Uint8Array(w * h * 4), top = new Uint8Array(w * h * 4);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, t);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, w, h);
    gl.bindFramebuffer(gl.FRAMEBUFFER, f);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, t, 0);
    this.render(w, h, camera, fov, count);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, out);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(f);
    gl.deleteTexture(t);
    for (let y = 0; y < h; y++) top.set(out.subarray((h - 1 - y) * w * 4, (h - y) * w * 4), y * w * 4);
    return top;
  }
  static settle = SETTLE_MS;
}
