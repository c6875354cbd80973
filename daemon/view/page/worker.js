// The connection and the decoder, away from the thread that draws.  Every message from the bridge is read here; of a
// volume only what the texture needs goes on.
import { read, Malformed } from "./pvx.js";
import { Bricks, brightest, cells, span } from "./bricks.js";
import { quantity } from "./scale.js";
import { Probe } from "./probe.js";

const RETRY_MS = [250, 500, 1000, 2000, 4000];
const SILENT_MS = 5000; // the bridge says something every second
let socket = null, url = "", token = "", tries = 0, session = "", most = 1 << 30, timer = 0, watch = 0, heard = 0;
let events = new Set(); // that were seen, by session and sequence: a bridge tells the last ones to whoever comes
let wants = { hidden: false, previews: false, bars: false };
const bricks = new Bricks();
let units = "1/m";
let volume = null, bars = null, showBars = false; // the newest, and its error bars as far as they have come

function say(o) {
  if (socket && socket.readyState === 1) socket.send(JSON.stringify(o));
}

const barsOf = (v) => bars && v && bars.session === v.session && bars.set === v.set ? bars : null;

// What is shown of a volume: itself, or its bars, which are nothing where it has none.
function shown(v) {
  if (!showBars) return v;
  const b = barsOf(v);
  return { ...v, ids: b ? b.ids : new Uint32Array(0), half: b ? b.half : new Uint16Array(0) };
}
function texture(v, whole) {
  const t = whole || bricks.take(v), c = cells(v.grid, t.occupied), { half, ids, mask, ...about } = v;
  const own = quantity(units) !== null;
  postMessage({ ...about, n_bricks: ids.length, bright: own ? 0 : brightest(v), span: own ? span(v) : null, mask: mask.toString(), boxes: t.boxes, data: t.data, cells: c.out, cells_n: c.n },
    [t.data.buffer, c.out.buffer]);
}

function message(buffer) {
  const m = read(buffer, most);
  if (m.kind === "other") return;
  if (m.kind === "start" && m.session !== session) {
    session = m.session;
    bricks.forget();
    volume = bars = null;
    postMessage({ kind: "session", session });
  }
  if (m.kind === "start") units = m.units;
  if (m.kind === "event") {
    const id = `${m.session} ${m.sequence}`;
    if (events.has(id)) return;
    if (events.size > 500) events = new Set();
    events.add(id);
  }
  if (m.kind === "volume") {
    volume = m;
    texture(shown(m));
    postMessage({ kind: "bars", set: m.set, has: Boolean(barsOf(m)), doubt: barsOf(m)?.doubt ?? 0 });
  } else if (m.kind === "bars") {
    bars = m;
    if (!barsOf(volume)) return; // of the volume that follows
    if (showBars) texture({ ...shown(volume), again: true, other: true });
    postMessage({ kind: "bars", set: m.set, has: true, doubt: m.doubt });
  } else if (m.kind === "preview") postMessage({ kind: "preview", set: m.set, cameras: m.cameras.map((k) => ({ ...k, jpeg: k.jpeg.slice(), bits: k.bits.slice() })) });
  else postMessage(m);
}

function connect() {
  clearTimeout(timer);
  clearInterval(watch);
  if (socket) { socket.onclose = socket.onmessage = socket.onopen = null; socket.close(); }
  postMessage({ kind: "link-state", state: "connecting", tries });
  socket = new WebSocket(url, "pyrovox.1");
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    say({ token, ...wants, credits: 1 });
    postMessage({ kind: "link-state", state: "open" });
    tries = 0;
    heard = performance.now();
    watch = setInterval(() => { // a way that is dead is not closed by itself for many minutes
      if (performance.now() - heard < SILENT_MS) return;
      postMessage({ kind: "link-state", state: "silent" });
      connect();
    }, 1000);
  };
  socket.onmessage = (e) => {
    heard = performance.now();
    try {
      if (typeof e.data === "string") postMessage({ kind: "words", ...JSON.parse(e.data) });
      else message(e.data);
    } catch (x) {
      // one that says no more of itself, as no memory does not, is no reason to stand still
      postMessage({ kind: "malformed", why: x instanceof Malformed ? x.message : `${x.name}: ${x.message}` });
      say({ credits: 1 }); // it may have been a volume
    }
  };
  socket.onclose = (e) => {
    clearInterval(watch);
    const refused = e.code === 4401;
    postMessage({ kind: "link-state", state: refused ? "refused" : e.code === 4503 ? "full" : "closed", code: e.code, why: e.reason });
    if (!refused) timer = setTimeout(connect, RETRY_MS[Math.min(tries++, RETRY_MS.length - 1)]);
  };
}

onmessage = (e) => {
  const m = e.data;
  if (m.connect) { ({ url, token, most } = m.connect); connect(); }
  if (m.retry) { tries = 0; connect(); }
  if (m.say) {
    for (const k of ["hidden", "previews", "bars"]) if (k in m.say) wants[k] = m.say[k];
    say(m.say);
  }
  if (m.probe) postMessage({ kind: "probe", at: m.probe.at, ...new Probe(volume, barsOf(volume), showBars).ask(m.probe) });
  if ("show" in m) {
    showBars = m.show === "bars";
    if (volume) texture({ ...shown(volume), again: true, other: true });
  }
  if (m.again) { const v = bricks.last, t = bricks.again(); if (t) texture({ ...v, again: true }, t); }
};
