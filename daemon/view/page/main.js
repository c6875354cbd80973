// The page: what comes from the bridge goes to the flame, the lines and the panel; what a person does, to the view.
import { Flame } from "./flame.js";
import { Flat } from "./flat.js";
import { Orbit, frame } from "./orbit.js";
import { Link } from "./link.js";
import { Overlay } from "./overlay.js";
import { Chart } from "./chart.js";
import { Cameras } from "./cameras.js";
import { Lost } from "./lost.js";
import { Player } from "./player.js";
import { Orders } from "./orders.js";
import { Pointer } from "./pointer.js";
import { doubts } from "./probe.js";
import { names } from "./colours.js";
import { Legend } from "./legend.js";

const $ = (id) => document.getElementById(id);
const view = { start: null, set: -1, volumes: 0, exposureAuto: 0 };
let dirty = false, whole = false, moved = 0, drawing = false, pending = null, ended = "", last = 0;

function state(words, kind = "") { const s = $("state"); if (s.textContent !== words) s.textContent = words; s.className = kind; }
function notice(words) { const n = $("notice"); n.hidden = !words; if (n.textContent !== words) n.textContent = words; }
function verdict(words) { const v = $("verdict"); v.hidden = !words; if (v.textContent !== words) v.textContent = words; v.className = words.startsWith("bad") ? "bad" : ""; }
function change() { dirty = true; whole = false; moved = performance.now(); }

// The three projections, from now on.
function flat(why) {
  const fresh = $("flame").cloneNode(), look = flame?.look;
  $("flame").replaceWith(fresh);
  flame = new Flat(fresh);
  if (look) flame.look = look;
  notice(`Three projections instead of the turning flame: ${why}.`);
  document.body.classList.add("flat");
}
let flame;
try {
  if (new URLSearchParams(location.search).has("flat")) throw new Error("asked for without WebGL2");
  flame = new Flame($("flame"), (back) => {
    if (!back) { notice("The graphics were taken away from this page; it waits for them."); return; }
    notice("");
    link.again();
    change();
  });
} catch (x) {
  flat(x.message);
}
const orbit = new Orbit($("flame"), change), overlay = new Overlay($("lines"));
const charts = {
  rate: new Chart($("charts"), "sets a second", "1/s"), latency: new Chart($("charts"), "latency, daemon", "ms"),
  hull: new Chart($("charts"), "visual hull", "voxels", 0), residual: new Chart($("charts"), "residual", "%", 2),
  way: new Chart($("charts"), "published to drawn, median", "ms"),
  most: new Chart($("charts"), "hottest voxel", "K", 0, false), mean: new Chart($("charts"), "mean of the voxels", "K", 0, false),
  known: new Chart($("charts"), "voxels that have one", "", 0),
};
const cameras = new Cameras($("cameras"), (states) => {
  overlay.states = states;
  const now = JSON.stringify([...states]);
  if (now === view.states) return;
  view.states = now;
  const bad = [...states].filter(([, s]) => s === "bad").map(([n]) => n);
  $("camera-sum").textContent = bad.length ? `${bad.join(", ")} need a look` : `${states.size}`;
  change();
});
const lost = new Lost($("lost"));
const token = location.hash.slice(1);
const seen = [];

function newSession() {
  flame.clear();
  lost.clear();
  cameras.clear();
  for (const c of Object.values(charts)) c.clear();
  overlay.rig = [];
  view.set = -1;
  view.start = null;
  ended = "";
  seen.length = 0;
  pending = null;
  change();
}

// So that the brightest columns fill the range, smoothed over time.
function autoExposure(v) {
  if (!(v.bright > 0)) return;
  const want = 0.2 - Math.log2(v.bright);
  view.exposureAuto = view.exposureKnown ? view.exposureAuto + 0.1 * (want - view.exposureAuto) : want;
  view.exposureKnown = true;
  if ($("auto").checked) { $("exposure").value = view.exposureAuto; setExposure(); }
}
function setExposure() {
  const s = Number($("exposure").value);
  flame.look.exposure = 2 ** s;
  $("stops").textContent = `${s >= 0 ? "+" : "−"}${Math.abs(s).toFixed(1)} stops`;
  legend();
}
const scaled = new Legend(() => { legend(); change(); });
function legend() { scaled.show(flame.look, view.start?.grid); }
// The range of a scale of its own, and its lines; of light the exposure.
function measure(v) {
  if (!scaled.own) { autoExposure(v); return; }
  scaled.follow(v.span);
  legend();
  if ($("bars").checked || v.again) return;
  charts.most.add(v.span?.most);
  charts.mean.add(v.span?.mean);
  charts.known.add(v.span?.n ?? 0);
}

function lostSum() { $("lost-sum").textContent = lost.words(view.words?.volumes_drawn || 0); }

// A volume that is not shown: counted, and the next one asked for.
function passOver(cause) {
  lost.more("page", cause);
  lostSum();
  link.say({ credits: 1 });
}
function take(v) {
  let why = flame.misfit(v.grid);
  try {
    if (!why) return flame.take(v);
  } catch (x) { why = x.message; }
  flat(why);
  if (!v.again) link.again(); // all of it
  return flame.take(v);
}
function volume(v) {
  if (v.again) { // it was counted when it came
    take(v);
    if (v.other) { view.exposureKnown = false; measure(v); }
    change();
    return;
  }
  if (!view.start) { passOver("before the session began"); return; }
  if (!take(v)) { passOver("graphics were away"); return; }
  if (pending !== null) passOver("newer came before it was drawn");
  measure(v);
  view.set = v.set;
  view.volumes++;
  const set = v.set;
  flame.fence(() => link.say({ held: set }));
  pending = v.set;
  const now = performance.now();
  seen.push(now);
  while (seen.length > 40 || now - seen[0] > 4000) seen.shift();
  charts.rate.add(seen.length > 1 ? (seen.length - 1) * 1000 / (now - seen[0]) : NaN);
  charts.latency.add(v.latency || NaN);
  charts.hull.add(v.voxels);
  charts.residual.add(100 * v.residual);
  const g = v.grid;
  $("what").textContent = `${g.n.join("×")}${g.channels === 3 ? " RGB" : scaled.own ? ` ${scaled.units}` : ""} · set ${v.set} · ${v.cameras ? `${v.cameras} cameras · ` : ""}${v.n_bricks} bricks · ${(v.bytes / 1e6).toFixed(2)} MB${$("bars").checked ? " · error bars" : ""}`;
  change();
}

const link = new Link(token, {
  "link-state": (m) => {
    view.link = m.state;
    if (m.state === "open") state("connected, waiting for volumes");
    if (m.state === "connecting" && m.tries > 0) state("reconnecting", "bad");
    if (m.state === "closed") state("the bridge is gone; trying again", "bad");
    if (m.state === "silent") state("the bridge does not answer; trying again", "bad");
    if (m.state === "full") state("as many pages are open as the bridge has room for; trying again", "bad");
    if (m.state === "refused") {
      state("turned away", "bad");
      notice(token ? `The address is not this bridge's: ${m.why || "its token is an old one"}. Open the one that pyrovox view printed last.`
        : "The address lacks its token, the part behind #. Open the one that pyrovox view printed.");
    }
  },
  session: newSession,
  start: (m) => {
    const same = view.start && JSON.stringify(view.start.grid) === JSON.stringify(m.grid);
    view.start = m;
    if (!same) {
      flame.clear();
      orbit.frameBox(m.grid.min, m.grid.max);
      view.exposureKnown = false;
      link.again();
    }
    state("connected, waiting for volumes");
    for (const say of metres) say();
    scaled.start(m.units, flame.look);
    charts.hull.show(!scaled.own);
    charts.residual.show(!scaled.own);
    for (const k of ["most", "mean", "known"]) charts[k].show(Boolean(scaled.own));
    charts.most.name(scaled.own?.voxel, m.units, scaled.own?.digits);
    charts.known.name(scaled.own?.voxels, "");
    charts.mean.name("mean of the voxels", m.units, scaled.own?.digits);
    legend();
    change();
  },
  volume,
  status: (m) => {
    lost.status(m.status);
    cameras.status(m.status);
    orders.status(m.status);
    const c = m.status.check, p = $("check");
    p.hidden = !c || !c.checks;
    p.textContent = c?.checks ? `calibrate check: ${c.text || c.outcome}` : "";
    lostSum();
  },
  event: (m) => {
    const li = document.createElement("li"), { kind, time_ns: t, version: _, ...rest } = m.event;
    li.textContent = `${new Date(t / 1e6).toLocaleTimeString()} ${String(kind).replaceAll("_", " ")} ${Object.values(rest).filter((x) => x !== "").join(", ")}`;
    $("events").prepend(li);
    while ($("events").children.length > 50) $("events").lastChild.remove();
  },
  preview: (m) => cameras.preview(m),
  bars: (m) => {
    view.bars = m;
    const why = m.has ? doubts(m.doubt) : [];
    $("doubt").hidden = !why.length && !($("bars").checked && !m.has);
    $("doubt").textContent = why.length ? `These bars may be too small: ${why.join("; ")}.` : "This volume has no error bars.";
    pointer.again();
  },
  probe: (m) => pointer.answer(m),
  end: (m) => { ended = m.reason; state(`the daemon has ended: ${m.reason}`, "bad"); },
  malformed: (m) => { view.malformed = (view.malformed || 0) + 1; lost.set("page", "not understood", view.malformed, m.why); },
  words: (m) => {
    if (m.rig) { overlay.rig = m.rig.cameras; change(); }
    if (m.film) player.film(m.film);
    $("soot-row").hidden = m.film?.soot === undefined;
    if (m.film?.soot !== undefined) $("soot").checked = m.film.soot;
    if (m.orders) orders.words(m.orders);
    verdict(ended || (m.link?.silent_s ?? 0) >= 3 ? "" : m.verdict || "");
    if (!m.link) return;
    view.words = m.link;
    if (m.link.bars) $("bars-row").hidden = false;
    lost.link(m.link);
    lostSum();
    if (m.link.whole_ms[0] !== null) charts.way.add(m.link.whole_ms[0]);
    if (ended || view.link !== "open") return;
    if (view.set >= 0 && (m.film || m.link.silent_s < 3)) state(!m.film ? "live" : m.film.playing ? "playing" : "paused", "live");
    else if (m.link.silent_s < 0) state("no daemon there yet; waiting for it", "bad");
    else if (m.link.silent_s >= 3) state("nothing comes from the daemon; waiting", "bad");
  },
});
const pointer = new Pointer($("stage"), $("value"), {
  link, over: wantBars,
  look: () => flame instanceof Flame && view.start ? { frame: orbit.frame(), fov: orbit.fov, look: flame.look, grid: view.start.grid, units: view.start.units } : null,
});
// Bars travel only for who looks at them.
function wantBars() {
  const want = $("bars").checked || pointer.over;
  if (want === view.wantBars) return;
  view.wantBars = want;
  link.say({ bars: want });
}
const player = new Player($("film"), (o) => link.say(o));
const orders = new Orders($("orders"), (o) => link.say(o));

// One picture at a time; the volume on it is acknowledged, and the next one asked for, when the GPU has drawn it.
function tick(now) {
  requestAnimationFrame(tick);
  orbit.step(Math.min(0.1, (now - last) / 1000));
  if ($("turn").getAttribute("aria-pressed") !== String(orbit.turning)) $("turn").setAttribute("aria-pressed", orbit.turning);
  last = now;
  if (!dirty && !whole && now - moved > Flame.settle && (flame.scale ?? 1) < 1) { whole = true; dirty = true; }
  if (!dirty || drawing) return;
  dirty = false;
  drawing = true;
  const f = orbit.frame(), set = pending;
  pending = null;
  const done = () => {
    drawing = false;
    view.drawn = (view.drawn || 0) + 1;
    if (set !== null) link.say({ drawn: set, credits: 1 });
  };
  try {
    if (flame instanceof Flame) overlay.draw(f, orbit.fov, view.start?.grid, flame.look);
    else overlay.clear();
    flame.draw(f, orbit.fov, whole, done);
  } catch (x) { // a picture that fails is one picture, not the page
    done();
    throw x;
  }
  pointer.again();
  for (const c of Object.values(charts)) c.draw();
}
requestAnimationFrame(tick);
addEventListener("resize", change);

// ---- the panel
for (const n of names) $("colours").append(new Option(n, n, n === "fire", n === "fire"));
const on = (id, what) => { $(id).addEventListener("input", what); };
on("exposure", () => { $("auto").checked = false; setExposure(); change(); });
on("auto", () => { if ($("auto").checked && view.exposureKnown) { $("exposure").value = view.exposureAuto; setExposure(); change(); } });
on("colours", () => { scaled.chosen = true; flame.look.colours = $("colours").value; legend(); change(); });
on("bars", () => { wantBars(); link.show($("bars").checked ? "bars" : "flame"); scaled.again($("bars").checked); legend(); change(); });
on("soot", () => link.say({ soot: $("soot").checked }));
on("box", () => { overlay.show.box = $("box").checked; change(); });
on("frusta", () => { overlay.show.cameras = $("frusta").checked; change(); });
overlay.show.cameras = $("frusta").checked;
on("slices", () => { flame.look.slices = $("slices").checked; legend(); change(); });
on("silhouettes", () => { cameras.silhouettes = $("silhouettes").checked; });
const metres = []; // each says where its slider stands, anew when the box is another
function slider(parent, a, words, value, set) {
  const row = document.createElement("label"), range = document.createElement("input"), out = document.createElement("output");
  row.className = "row";
  Object.assign(range, { type: "range", min: 0, max: 1, step: 0.005, value });
  const say = () => {
    const g = view.start?.grid, size = g ? g.max[a] - g.min[a] : 0;
    out.textContent = g ? `${(g.min[a] + Number(range.value) * size).toFixed(size < 0.2 ? 4 : 3)} m` : "";
  };
  metres.push(say);
  range.addEventListener("input", () => { set(Number(range.value)); say(); change(); });
  row.append(words, out, range);
  $(parent).append(row);
  return range;
}
if (flame.look.sliceAt) {
  ["x", "y", "z"].forEach((a, i) => slider("slice-rows", i, `slice across ${a}`, 0.5, (x) => { flame.look.sliceAt[i] = x; }));
  const clips = [];
  ["x", "y", "z"].forEach((a, i) => {
    clips.push(slider("clip-rows", i, `show ${a} from`, 0, (x) => { flame.look.clip[i] = Math.min(x, flame.look.clip[i + 3]); }));
    clips.push(slider("clip-rows", i, `show ${a} to`, 1, (x) => { flame.look.clip[i + 3] = Math.max(x, flame.look.clip[i]); }));
  });
  $("unclip").onclick = () => { flame.look.clip = [0, 0, 0, 1, 1, 1]; clips.forEach((c, i) => { c.value = i & 1; }); for (const say of metres) say(); change(); };
}
const panel = $("cameras").closest("details");
panel.addEventListener("toggle", () => link.say({ previews: panel.open }));

function turn() { orbit.spin(!orbit.turning, true); }
function fullScreen() { if (document.fullscreenElement) document.exitFullscreen(); else $("stage").requestFullscreen?.(); }
// What is saved: a scale of its own needs its colour bar.
function picture() {
  const from = $("flame");
  if (!scaled.own) return from;
  const to = Object.assign(document.createElement("canvas"), { width: from.width, height: from.height }), c = to.getContext("2d");
  c.drawImage(from, 0, 0);
  scaled.paint(c, flame.look, from.width / from.clientWidth);
  return to;
}
function shot() {
  flame.draw(orbit.frame(), orbit.fov, true, () => {
    picture().toBlob((b) => {
      const a = document.createElement("a");
      a.href = URL.createObjectURL(b);
      a.download = `pyrovox-${view.set}.png`;
      a.click();
      setTimeout(() => URL.revokeObjectURL(a.href), 1000);
    });
  });
}
if (new URLSearchParams(location.search).has("turn")) orbit.spin(true, false);
$("reset").onclick = () => orbit.reset();
$("turn").onclick = turn;
$("full").onclick = fullScreen;
$("shot").onclick = shot;
addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.altKey || e.metaKey || /INPUT|SELECT|TEXTAREA/.test(e.target.tagName)) return;
  const key = e.key.toLowerCase();
  if (key === "t") turn();
  else if (key === "f") fullScreen();
  else if (key === "p") shot();
  else if (key === "," || key === ".") player.step(key === "." ? 1 : -1);
  else if (key === " " && !/BUTTON|SUMMARY/.test(e.target.tagName) && !$("film").hidden) { e.preventDefault(); player.play.click(); }
});
addEventListener("hashchange", () => location.reload());
setExposure();

// For tests: the state, and pictures from a given place.
window.pyrovox = {
  view, orbit, saved: picture, scaled, flame: () => flame, link, lost, overlay, pointer,
  picture(w, h, eye, target, fov, exposure, colours = "grey", count = 0) {
    const was = { ...flame.look };
    Object.assign(flame.look, { exposure, colours, slices: false, clip: [0, 0, 0, 1, 1, 1] });
    const p = flame.pixels(w, h, frame(eye, target), fov * Math.PI / 180, count);
    Object.assign(flame.look, was);
    let s = "";
    for (let i = 0; i < p.length; i += 8192) s += String.fromCharCode(...p.subarray(i, i + 8192));
    return btoa(s);
  },
};
