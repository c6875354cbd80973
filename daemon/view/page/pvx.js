// Messages of PROTOCOL.md, read from an ArrayBuffer; lengths are checked before anything is used.  Runs in a worker and
// in node.
export const START = 100, VOLUME = 200, STATUS = 300, END = 400, RIG = 500, EVENT = 600, PREVIEW = 700, BARS = 800;
export const CELLS = 512;

export class Malformed extends Error {}
function need(ok, what) {
  if (!ok) throw new Malformed(what);
}
const text = (bytes) => new TextDecoder().decode(bytes);
const u64 = (v, at) => Number(v.getBigUint64(at, true));
function padded(buffer, at, size) {
  const bytes = new Uint8Array(buffer, at, size), end = bytes.indexOf(0);
  need(end >= 0, "a text that does not end");
  return text(bytes.subarray(0, end));
}

export function header(buffer) {
  need(buffer.byteLength >= 48, "a message that is too short");
  const v = new DataView(buffer);
  need(v.getUint32(0, false) === 0x50565831, "not a message of Pyrovox");
  need(v.getUint16(8, true) === 1, "a message of a later version: reload the page");
  need(v.getUint32(12, true) < 0x10000, "a message that needs a later reader: reload the page");
  const h = {
    type: v.getUint16(4, true), head: v.getUint16(6, true), sequence: u64(v, 16),
    session: v.getBigUint64(32, true).toString(16), body: u64(v, 40),
  };
  need(h.head >= 48 && h.head + h.body === buffer.byteLength, "a message whose length is wrong");
  return h;
}

function grid(v, at) {
  const g = {
    n: [0, 4, 8].map((o) => v.getUint32(at + o, true)),
    basis: v.getUint32(at + 12, true), channels: v.getUint32(at + 16, true),
  };
  need(g.n.every((n) => n >= 1 && n <= 1024) && g.basis <= 1 && (g.channels === 1 || g.channels === 3),
    "a grid that is out of range");
  g.nb = g.n.map((n) => (n + 7) >> 3);
  return g;
}
function box(v, g, at) {
  g.min = [0, 8, 16].map((o) => v.getFloat64(at + o, true));
  g.max = [24, 32, 40].map((o) => v.getFloat64(at + o, true));
  need(g.max.every((m, a) => Number.isFinite(m) && Number.isFinite(g.min[a]) && m > g.min[a]), "an empty box");
}

export function start(buffer, h) {
  need(h.body >= 152, "a start that is cut short");
  const v = new DataView(buffer, h.head), g = grid(v, 0);
  box(v, g, 24);
  return {
    grid: g, session: h.session, cameras: v.getUint32(20, true), fps: v.getFloat64(80, true),
    units: padded(buffer, h.head + 88, 32), software: padded(buffer, h.head + 120, 32),
  };
}

// One LZ4 block into `out`, whose size is that of what it unpacks to.
export function lz4(src, out) {
  let i = 0, o = 0;
  const n = src.length, end = out.length;
  while (i < n) {
    const token = src[i++];
    let len = token >> 4;
    if (len === 15) for (let b = 255; b === 255;) { need(i < n, "LZ4"); b = src[i++]; len += b; }
    need(len <= n - i && len <= end - o, "LZ4: literals beyond the end");
    if (len > 32) { out.set(src.subarray(i, i + len), o); o += len; i += len; } else for (const to = o + len; o < to;) out[o++] = src[i++];
    if (i === n) break;
    need(i + 2 <= n, "LZ4: cut short");
    const back = src[i] | src[i + 1] << 8;
    i += 2;
    need(back > 0 && back <= o, "LZ4: a match before the begin");
    len = (token & 15) + 4;
    if (len === 19) for (let b = 255; b === 255;) { need(i < n, "LZ4"); b = src[i++]; len += b; }
    need(len <= end - o, "LZ4: a match beyond the end");
    if (back >= len && len > 32) { out.copyWithin(o, o - back, o - back + len); o += len; } else for (const to = o + len; o < to; o++) out[o] = out[o - back];
  }
  need(o === end, "LZ4: another size than was said");
}

const f32 = new Float32Array(1), bits = new Uint32Array(f32.buffer);
// To nearest, ties to even; cut at 65504.
export function toHalf(x) {
  f32[0] = x;
  const b = bits[0], sign = b >>> 16 & 0x8000, mag = b & 0x7fffffff;
  if (mag >= 0x477fefff + 1) return sign | 0x7bff;
  if (mag < 0x33000001) return sign;
  const e = mag >>> 23, m = mag & 0x7fffff | (e ? 0x800000 : 0);
  const shift = e < 113 ? 126 - e : 13;
  let h = m >>> shift;
  const rest = m & (1 << shift) - 1, half = 1 << shift - 1;
  if (rest > half || (rest === half && h & 1)) h++;
  return sign | (e < 113 ? h : (e - 113 << 10) + h);
}
export function fromHalf(h) {
  const e = h >> 10 & 31, m = h & 1023, s = h & 0x8000 ? -1 : 1;
  return s * (e === 0 ? m * 2 ** -24 : (1 + m / 1024) * 2 ** (e - 15));
}

export const HALF = Float32Array.from({ length: 65536 }, (_, h) => fromHalf(h));

// What a volume says of itself, its brick ids, and its payload as half floats.
export function volume(buffer, h, most = 1 << 30) {
  need(h.body >= 248, "a volume that is cut short");
  const v = new DataView(buffer, h.head), g = grid(v, 68);
  box(v, g, 88);
  const description = v.getUint32(0, true), sample = v.getUint32(4, true), packed = v.getUint32(8, true);
  const n = v.getUint32(224, true), raw = u64(v, 232), stored = u64(v, 240), at = description + 4 * n;
  need(v.getUint32(12, true) === 8 && (sample === 1 || sample === 2) && packed <= 1,
    "samples, bricks or a compression that this page does not know");
  need(description >= 248 && n <= g.nb[0] * g.nb[1] * g.nb[2] && at + stored <= h.body, "a volume that is cut short");
  need(raw === n * CELLS * g.channels * (sample === 1 ? 4 : 2) && stored <= raw && (packed || stored === raw),
    "a payload whose length is wrong");
  need(raw <= most, "a volume that is too large for this page");
  const ids = new Uint32Array(n);
  for (let b = 0, last = -1; b < n; last = ids[b++]) {
    ids[b] = v.getUint32(description + 4 * b, true);
    need(ids[b] > last && ids[b] < g.nb[0] * g.nb[1] * g.nb[2], "brick ids that do not ascend");
  }
  let bytes = new Uint8Array(buffer, h.head + at, stored);
  if (packed && raw) { const to = new Uint8Array(raw); lz4(bytes, to); bytes = to; } else bytes = bytes.slice();
  let half;
  if (sample === 2) half = new Uint16Array(bytes.buffer);
  else {
    const from = new Float32Array(bytes.buffer);
    half = new Uint16Array(from.length);
    for (let i = 0; i < from.length; i++) {
      need(Number.isFinite(from[i]), "a value that is not finite");
      half[i] = toHalf(from[i]);
    }
  }
  for (let i = 0; i < half.length; i++) need((half[i] & 0x7c00) !== 0x7c00, "a value that is not finite");
  return {
    grid: g, ids, half, session: h.session, set: u64(v, 16), exposure: Number(v.getBigInt64(24, true)),
    latency: Number(v.getBigInt64(48, true)) * 1e-6, cameras: v.getUint32(64, true), mask: v.getBigUint64(56, true),
    status: v.getUint32(136, true), iterations: v.getUint32(140, true), solver: padded(buffer, h.head + 144, 16), doubt: v.getUint32(228, true),
    residual: v.getFloat64(160, true), voxels: v.getUint32(168, true), rays: v.getUint32(172, true),
    bytes: buffer.byteLength,
    hull: Number(v.getBigInt64(192, true)) * 1e-6, solve: Number(v.getBigInt64(208, true)) * 1e-6,
  };
}

export function json(buffer, h) {
  const o = JSON.parse(text(new Uint8Array(buffer, h.head, h.body)));
  need(o !== null && typeof o === "object", "not an object");
  return o;
}
export function end(buffer, h) {
  need(h.body >= 64, "an end that is cut short");
  return { reason: padded(buffer, h.head, 64) };
}

export function preview(buffer, h) {
  need(h.body >= 32, "a preview that is cut short");
  const v = new DataView(buffer, h.head), first = v.getUint32(0, true), step = v.getUint32(4, true);
  const n = v.getUint32(24, true);
  need(first >= 32 && step >= 104 && n <= 64 && first + n * step <= h.body, "a preview that is cut short");
  const piece = (at, len) => {
    need(at + len <= h.body, "a preview that is cut short");
    return new Uint8Array(buffer, h.head + at, len);
  };
  const cameras = [];
  for (let c = 0; c < n; c++) {
    const at = first + c * step, across = v.getUint16(at + 72, true), down = v.getUint16(at + 74, true);
    const k = {
      name: padded(buffer, h.head + at, 64), out: (v.getUint32(at + 64, true) & 1) === 1,
      width: v.getUint16(at + 68, true), height: v.getUint16(at + 70, true), across, down,
      lit: v.getUint32(at + 76, true), saturated: v.getUint32(at + 80, true),
      jpeg: piece(v.getUint32(at + 84, true), v.getUint32(at + 88, true)),
      bits: piece(v.getUint32(at + 92, true), v.getUint32(at + 96, true)),
    };
    need(k.bits.length === down * (across + 7 >> 3), "a silhouette of another size");
    cameras.push(k);
  }
  return { set: u64(v, 8), cameras };
}

export function read(buffer, most) {
  const h = header(buffer);
  switch (h.type) {
    case START: return { kind: "start", ...start(buffer, h) };
    case VOLUME: return { kind: "volume", ...volume(buffer, h, most) };
    case BARS: return { kind: "bars", ...volume(buffer, h, most) }; // deviations of the volume that follows
    case STATUS: return { kind: "status", status: json(buffer, h), session: h.session };
    case EVENT: return { kind: "event", event: json(buffer, h), session: h.session, sequence: h.sequence };
    case END: return { kind: "end", ...end(buffer, h), session: h.session };
    case PREVIEW: return { kind: "preview", ...preview(buffer, h), session: h.session };
    default: return { kind: "other" };
  }
}
