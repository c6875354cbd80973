// The ray integral, exact but for the texture's own precision: a ray is cut where it crosses cells.  In a cell the box
// basis is constant, and the trilinear one a cubic, which two Gauss points integrate exactly.  Light adds up, so there
// is no early end; empty blocks of 4^3 cells are stepped over (MACRO in bricks.js).
export const vertex = `#version 300 es
out vec2 at;
void main() { vec2 p = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0); at = p; gl_Position = vec4(p, 0, 1); }`;

export const fragment = `#version 300 es
precision highp float; precision highp sampler3D; precision highp int;
uniform sampler3D voxels, cells;
uniform sampler2D colours;
uniform vec3 eye, right, up, forward;      // cells; right, up scaled to the picture's edge
uniform vec3 metres;                       // sides of a cell
uniform vec3 lo, hi;                       // of what is shown, cells
uniform vec3 grid;                         // voxels
uniform ivec3 macros;
uniform int trilinear, grey, slices, count, own; // own: a scale of its own (scale.js)
uniform float exposure;
uniform vec2 range;                        // of that scale: the value of the first colour, 1 / what is between first and last
uniform vec3 slice_at, slice_on;           // cells
in vec2 at;
out vec4 colour;
int samples = 0;

vec3 point(vec3 q) { samples++; return texture(voxels, (trilinear == 1 ? q + 0.5 : q + 1.0) / vec3(textureSize(voxels, 0))).rgb; }
vec3 value(ivec3 c, vec3 o, vec3 d, float a, float b) {
  if (trilinear == 0) { samples++; return texelFetch(voxels, c + 1, 0).rgb; }
  float m = 0.5 * (a + b), h = 0.28867513459481287 * (b - a);
  return 0.5 * (point(o + d * (m - h)) + point(o + d * (m + h)));
}
float least(vec3 v) { return min(v.x, min(v.y, v.z)); }
float most(vec3 v) { return max(v.x, max(v.y, v.z)); }

// From t0 to t1 inside one macro cell.
vec3 walk(vec3 o, vec3 d, vec3 inv, float t0, float t1, ivec3 m) {
  vec3 sum = vec3(0), s = step(0.0, d), first = vec3(m) * 4.0;
  float e = 1e-4 / most(abs(d));
  vec3 c = clamp(floor(o + d * (t0 + e)), first, first + 3.0), next = (c + s - o) * inv, dt = abs(inv);
  float a = t0;
  for (int i = 0; i < 14; i++) {
    float b = min(least(next), t1);
    if (b > a) {
      vec3 v = value(ivec3(c), o, d, a, b);
      sum = own == 1 ? max(sum, v) : sum + (b - a) * v;
      a = b;
    }
    if (b >= t1) break;
    vec3 cross = vec3(lessThanEqual(next, vec3(b)));
    c += cross * (2.0 * s - 1.0);
    next += cross * dt;
    if (any(lessThan(c, first)) || any(greaterThan(c, first + 3.0))) break;
  }
  return sum;
}

vec3 integral(vec3 o, vec3 d) {
  vec3 g = vec3(greaterThanEqual(d, vec3(0))) * 2.0 - 1.0;
  d = g * max(abs(d), vec3(1e-7));
  vec3 inv = 1.0 / d, a = (lo - o) * inv, b = (hi - o) * inv, sum = vec3(0), s = step(0.0, d);
  float t = max(most(min(a, b)), 0.0), end = least(max(a, b)) - t, e = 1e-4 / most(abs(d));
  o += t * d; // far away t + e would be t
  t = 0.0;
  for (int i = 0; i < 800 && t < end; i++) {
    ivec3 m = clamp(ivec3(floor((o + d * (t + e)) / 4.0)), ivec3(0), macros - 1);
    float far = min(least((4.0 * (vec3(m) + s) - o) * inv), end);
    if (texelFetch(cells, m, 0).r > 0.0) { vec3 v = walk(o, d, inv, t, far, m); sum = own == 1 ? max(sum, v) : sum + v; }
    t = max(far, t + e);
  }
  return sum;
}

vec3 srgb(vec3 v) { return mix(12.92 * v, 1.055 * pow(max(v, 0.0), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v)); }

// The nearest slice with light that the ray meets: the value there, 1/m.  Dark places are glass: what is behind them
// shows.  Returns how many of them the ray went through.
float slice(vec3 o, vec3 d, float dark, out vec3 v) {
  float best = 1e30, panes = 0.0;
  v = vec3(0);
  for (int k = 0; k < 3; k++) {
    float t = (slice_at[k] - o[k]) / d[k];
    vec3 p = o + d * t;
    p[k] = slice_at[k];
    if (slice_on[k] > 0.5 && t > 0.0 && t < best && all(greaterThanEqual(p, lo - 1e-3)) && all(lessThanEqual(p, hi + 1e-3))) {
      vec3 here = trilinear == 1 ? point(p) : texelFetch(voxels, ivec3(clamp(floor(p), vec3(0), grid - 1.0)) + 1, 0).rgb;
      if (most(here) <= dark) { panes++; continue; }
      best = t;
      v = here;
    }
  }
  return panes;
}

void main() {
  vec3 d = forward + at.x * right + at.y * up, v;
  d /= length(d * metres);                 // t is metres
  if (slices == 1) {
    float deep = least(grid * metres) * 0.25; // a slice is as bright as a quarter of the box of that
    float panes = slice(eye, d, own == 1 ? 0.0 : 0.002 / (deep * exposure), v);
    if (v == vec3(0)) { colour = vec4(vec3(0.016, 0.02, 0.027) + panes * vec3(0.02, 0.023, 0.027), 1.0); return; }
    if (own == 0) v *= deep;
  } else v = integral(eye, d);
  if (count == 1) { colour = vec4(float(samples) / 1024.0, 0, 0, 1); return; }
  if (own == 1) {
    float at = clamp((v.r - range.x) * range.y, 0.0, 1.0) * 255.0;
    colour = vec4(v.r > 0.0 ? texture(colours, vec2((at + 0.5) / 256.0, 0.5)).rgb : vec3(0.016, 0.02, 0.027), 1.0);
    return;
  }
  v *= exposure;
  colour = vec4(grey == 1 ? texture(colours, vec2((srgb(clamp(v.rrr, 0.0, 1.0)).r * 255.0 + 0.5) / 256.0, 0.5)).rgb : srgb(clamp(v, 0.0, 1.0)), 1.0);
}`;
