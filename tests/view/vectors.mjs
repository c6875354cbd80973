// What 097-page.sh asks of the page's modules: vectors.mjs WHAT MODULES VECTORS
import assert from "node:assert/strict";
import fs from "node:fs";
import { pathToFileURL } from "node:url";

const [what, modules, vectors] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(`${modules}/${name}.js`).href);
const pvx = await load("pvx"), { Bricks, cells } = await load("bricks"), probe = await load("probe");
const bytes = (name) => { const b = fs.readFileSync(`${vectors}/${name}.bin`); return b.buffer.slice(b.byteOffset, b.byteOffset + b.length); };
const golden = (name) => JSON.parse(fs.readFileSync(`${vectors}/${name}.json`));
const all = fs.readdirSync(vectors).filter((n) => n.endsWith(".bin")).map((n) => n.slice(0, -4));
let seed = 12345;
const random = (n) => { seed = Math.imul(seed, 1664525) + 1013904223 >>> 0; return Math.floor(seed / 4294967296 * n); };

// Dense values of a decoded volume.
function dense(v) {
  const { n, nb, channels: c } = v.grid, out = new Float64Array(n[0] * n[1] * n[2] * c);
  v.ids.forEach((id, b) => {
    const at = [id % nb[0] * 8, Math.floor(id / nb[0]) % nb[1] * 8, Math.floor(id / nb[0] / nb[1]) * 8];
    for (let k = 0; k < 512; k++) {
      const p = [at[0] + k % 8, at[1] + (k >> 3) % 8, at[2] + (k >> 6)];
      if (p.some((x, a) => x >= n[a])) continue;
      for (let q = 0; q < c; q++) out[((p[2] * n[1] + p[1]) * n[0] + p[0]) * c + q] = pvx.fromHalf(v.half[(b * 512 + k) * c + q]);
    }
  });
  return out;
}

// A volume as the wire would have it, for the tests of bricks.
function made(n, channels, ids, basis = 0) {
  const nb = n.map((x) => x + 7 >> 3);
  return { grid: { n, nb, channels, basis }, ids: Uint32Array.from(ids), half: Uint16Array.from({ length: ids.length * 512 * channels }, () => 1 + random(30000)) };
}

const tests = {
  golden() {
    let volumes = 0, bars = 0;
    for (const name of all) {
      const want = golden(name);
      if (name.includes("zstd")) { assert.throws(() => pvx.read(bytes(name)), pvx.Malformed); continue; } // the bridge unpacks it
      const m = pvx.read(bytes(name)), text = JSON.stringify(want);
      if (m.kind === "volume") {
        volumes++;
        assert.equal(m.set, want.set);
        compare(name, m, dense(m), want);
      } else if (m.kind === "bars") {
        bars++;
        assert.deepEqual([m.set, m.doubt], [want.set, want.doubt]);
        compare(name, m, dense(m), want);
      } else assert.equal(m.kind === "other", name === "rig", name); // the bridge reads that
      if (m.kind === "end") assert.ok(text.includes(m.reason));
      if (m.kind === "start") assert.deepEqual([m.grid.n, m.grid.min, m.fps, m.units], [want.n, want.min, want.fps, want.units]);
      if (m.kind === "preview") assert.ok(m.cameras.every((c) => text.includes(c.name)) && m.cameras.length > 0);
      if (m.kind === "event") assert.ok(m.event.kind);
    }
    assert.ok(volumes >= 4 && bars === 1);
  },
  half() { // every half there and back; rounding to nearest even; the largest
    for (let h = 0; h < 65536; h++) {
      if ((h & 0x7c00) === 0x7c00) continue;
      assert.equal(pvx.toHalf(pvx.fromHalf(h)), h === 0x8000 ? 0x8000 : h);
    }
    for (let h = 0; h < 0x7bff; h++) {
      const a = pvx.fromHalf(h), b = pvx.fromHalf(h + 1), mid = (a + b) / 2, even = h & 1 ? h + 1 : h;
      assert.equal(pvx.toHalf(mid), even, `${mid}`);
      assert.equal(pvx.toHalf(mid + (b - mid) / 8), h + 1);
      assert.equal(pvx.toHalf(mid - (mid - a) / 8), h);
    }
    assert.equal(pvx.toHalf(1e9), 0x7bff);
    assert.equal(pvx.toHalf(-1e9), 0xfbff);
    assert.equal(pvx.toHalf(65504), 0x7bff);
  },
  lz4() {
    const block = (...b) => Uint8Array.from(b), out = new Uint8Array(40);
    pvx.lz4(block(0x1f, 7, 1, 0, 16, 0x40, 1, 2, 3, 4), out); // one literal, a run of itself, four literals
    assert.deepEqual([...out], [...Array(36).fill(7), 1, 2, 3, 4]);
    for (const bad of [block(), block(0x10), block(0x1f, 7, 2, 0, 16), block(0x1f, 7, 0, 0, 16), block(0x1f, 7, 1), block(0xff), block(0xff, 255, 255), block(0x1f, 7, 1, 0, 255, 255, 255, 0)])
      assert.throws(() => pvx.lz4(bad, new Uint8Array(40)), pvx.Malformed, bad.toString());
  },
  mutated() { // whatever comes: read, or refused with a Malformed or a SyntaxError of JSON
    let read = 0, refused = 0;
    for (let round = 0; round < 40000; round++) {
      const b = new Uint8Array(bytes(all[random(all.length)])), cut = random(4) === 0 ? random(b.length) : b.length;
      for (let k = 1 + random(4); k > 0; k--) b[random(random(3) ? Math.min(b.length, 400) : b.length)] = random(256);
      try { pvx.read(b.slice(0, cut).buffer, 1 << 24); read++; } catch (x) {
        if (!(x instanceof pvx.Malformed) && !(x instanceof SyntaxError)) throw x;
        refused++;
      }
    }
    assert.ok(read > 1000 && refused > 1000, `${read} ${refused}`);
  },
  bricks() { // a texture that is given only what bricks() says is always the volume
    for (const channels of [1, 3]) {
      const n = [30, 17, 25], nb = n.map((x) => x + 7 >> 3), side = nb.map((x) => x * 8), texture = new Uint16Array(side[0] * side[1] * side[2] * channels), b = new Bricks();
      for (let round = 0; round < 30; round++) {
        const v = made(n, channels, [...Array(nb[0] * nb[1] * nb[2]).keys()].filter(() => random(round % 5 + 1) === 0));
        const t = round % 7 === 6 ? (texture.fill(0), b.take(v), b.again()) : b.take(v);
        for (const x of t.boxes)
          for (let k = 0; k < 8; k++)
            for (let j = 0; j < 8; j++) {
              const row = x.size[0] * channels, from = x.offset + (k * 8 + j) * row;
              texture.set(t.data.subarray(from, from + row), (((x.at[2] + k) * side[1] + x.at[1] + j) * side[0] + x.at[0]) * channels);
            }
        const want = dense(v), got = new Float64Array(want.length);
        for (let z = 0, i = 0; z < n[2]; z++) for (let y = 0; y < n[1]; y++) for (let x = 0; x < n[0]; x++) for (let c = 0; c < channels; c++, i++)
          got[i] = pvx.fromHalf(texture[((z * side[1] + y) * side[0] + x) * channels + c]);
        assert.deepEqual(got, want);
        const lit = texture.reduce((s, x) => s + (x !== 0), 0), inside = want.reduce((s, x) => s + (x !== 0), 0);
        assert.equal(lit, inside, "values outside the grid");
      }
    }
  },
  async flat() { // the projections are those of the volume, and nothing is left of a session before
    const { Flat } = await load("flat"), n = [20, 17, 25], nb = n.map((x) => x + 7 >> 3), b = new Bricks(), f = new Flat({ getContext: () => null });
    for (let round = 0; round < 20; round++) {
      const v = made(n, 1, [...Array(nb[0] * nb[1] * nb[2]).keys()].filter(() => random(round % 3 + 1) === 0));
      Object.assign(v.grid, { min: [0, 0, 0], max: n });
      if (round % 5 === 4) { b.forget(); f.clear(); }
      f.take({ ...v, ...b.take(v) });
      const want = dense(v).reduce((s, x) => s + x, 0);
      for (const s of f.sums) assert.ok(Math.abs(s.v.filter((_, i) => i % 3 === 0).reduce((t, x) => t + x, 0) / want - 1) < 1e-4 || want === 0);
    }
  },
  async bright() { // a brick of ones alone, seen through its depth
    const { brightest } = await load("bricks"), v = made([16, 16, 16], 3, [3]);
    Object.assign(v.grid, { min: [0, 0, 0], max: [1.6, 3.2, 1.6] });
    v.half.fill(0x3c00);
    assert.ok(Math.abs(brightest(v) - 1.6) < 1e-5); // 8 voxels of 0.2 m along y
  },
  cells() { // no cell with light is stepped over, and few without are not
    for (const basis of [0, 1]) {
      const v = made([24, 16, 16], 1, [1, 5, 9], basis), want = new Set();
      v.half = v.half.map((h) => random(200) ? 0 : h);
      const c = cells(v.grid, new Bricks().take(v).occupied), n = v.grid.n, d = dense(v);
      assert.ok(d.some((x) => x !== 0));
      d.forEach((x, i) => { // the voxel's block, and with the trilinear basis those that its hat reaches
        if (x === 0) return;
        const block = [i % n[0], Math.floor(i / n[0]) % n[1], Math.floor(i / n[0] / n[1])].map((p) => p >> 2);
        for (let k = 0; k < 8; k++) want.add(block.map((p, a) => p + (basis ? k >> a & 1 : 0)).join());
      });
      for (let z = 0, i = 0; z < c.n[2]; z++) for (let y = 0; y < c.n[1]; y++) for (let x = 0; x < c.n[0]; x++, i++)
        assert.equal(c.out[i] > 0, want.has([x, y, z].join()), `${basis}: ${x} ${y} ${z}`);
    }
  },
  async camera() {
    const { frame, project } = await load("orbit");
    const f = frame([2, -1, 0.8], [0, 0, 0.5]), p = project(f, Math.tan(0.35), 4 / 3, [0, 0, 0.5]);
    assert.ok(Math.hypot(p[0], p[1]) < 1e-12 && Math.abs(p[2] - Math.hypot(2, 1, 0.3)) < 1e-12);
    const up = project(f, Math.tan(0.35), 4 / 3, [0, 0, 0.6]), right = project(f, Math.tan(0.35), 4 / 3, [0.1, 0.2, 0.5]);
    assert.ok(up[1] > 0 && Math.abs(up[0]) < 1e-12 && right[0] > 0);
    assert.equal(project(f, 1, 1, [4, -2, 1.1]), null);
  },
  contrast() { // WCAG 2.1: 4.5 to 1 for text on the grounds that it stands on
    const css = fs.readFileSync(`${modules}/style.css`, "utf8"), name = Object.fromEntries([...css.matchAll(/--(\w+): (#\w+)/g)].map((m) => [m[1], m[2]]));
    const light = (h) => [1, 3, 5].map((i) => parseInt(h.slice(i, i + 2), 16) / 255).map((x) => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4).reduce((s, x, i) => s + x * [0.2126, 0.7152, 0.0722][i], 0);
    const ratio = (a, b) => { const [x, y] = [light(a), light(b)].sort((p, q) => q - p); return (x + 0.05) / (y + 0.05); };
    for (const ground of [name.ground, name.raised, "#04050a", "#1b222d", "#2a1714"])
      for (const text of [name.text, name.soft, name.bad, name.good, name.fire])
        assert.ok(ratio(text, ground) >= 4.5, `${text} on ${ground}: ${ratio(text, ground).toFixed(2)}`);
    assert.ok(ratio("#ffd9d1", "#2a1714") >= 4.5 && ratio(name.text, "#4a2c12") >= 4.5);
  },
  probe() { // a voxel in a slice, and the largest along a ray, in the volume or in its bars; text of figures; the doubts are C's
    const v = made([21, 17, 30], 1, [0, 5, 40]), b = { ...made([21, 17, 30], 1, [0, 5, 40]), set: 1 };
    Object.assign(v.grid, { min: [0, 0, 0], max: [2.1, 1.7, 3.0] });
    v.set = 1;
    const d = dense(v), sd = dense(b), at = (p) => (p[2] * 17 + p[1]) * 21 + p[0], along = (a) => [0, 1, 2].map((k) => Number(k === a));
    const look = { slices: false, sliceAt: [0.5, 0.5, 0.5], clip: [0, 0, 0, 1, 1, 1], dark: 0 };
    let seen = 0;
    for (let i = 0; i < 300; i++) {
      const p = [random(21), random(17), random(30)], a = random(3), bars = i % 2 === 1, from = bars ? sd : d, of = v.grid.n[a];
      const eye = p.map((x, k) => k === a ? -1 : (x + 0.5) * 0.1), line = Array.from({ length: of }, (_, k) => at(p.map((x, j) => j === a ? k : x)));
      const most = Math.max(...line.map((k) => from[k])), got = new probe.Probe(v, b, bars).ask({ ...look, eye, d: along(a) });
      if (most === 0) { assert.equal(got.values, undefined); continue; }
      seen++;
      const best = line.find((k) => from[k] === most), where = line.indexOf(best);
      assert.deepEqual([got.values[0], got.sd[0], got.set], [d[best], sd[best], 1]);
      assert.ok(Math.abs(got.where[a] - (where + 0.5) * 0.1) < 1e-9);
      const s = new probe.Probe(v, b, bars).ask({ ...look, eye, d: along(a), slices: true, sliceAt: p.map((x, k) => k === a ? (x + 0.5) / of : 0) });
      if (from[at(p)] > 0) assert.deepEqual([s.values[0], s.sd[0]], [d[at(p)], sd[at(p)]]);
    }
    assert.ok(seen > 50, `${seen}`);
    assert.equal(new probe.Probe(v, null, false).ask({ ...look, eye: [0.05, 0.05, -1], d: [0, 0, 1] }).sd, null);
    assert.equal(new probe.Probe(v, null, true).ask({ ...look, eye: [0.05, 0.05, -1], d: [0, 0, 1] }).values, undefined);
    for (const [x, s, want] of [[12.34, 0.81, "12.34 ± 0.81"], [123.4, 12, "123 ± 12"], [0.01234, 0.0008, "0.01234 ± 0.00080"], [5, undefined, "5"], [1 / 3, 0, "0.3333"]])
      assert.equal(probe.figure(x, s), want);
    const said = [...fs.readFileSync("proto/pvp.h", "utf8").matchAll(/X\((\d+),\s*\w+,\s*"([\w-]+)",[\s\\]*"([^"]+)"\)/g)];
    assert.deepEqual(said.map((m) => m[3]), probe.DOUBTS);
    const names = fs.readFileSync("proto/clients/pyrovox_sub.py", "utf8").match(/DOUBTS = \((.*)\)  #/)[1].split(", ").map((x) => x.slice(1, -1));
    assert.deepEqual(said.map((m) => m[2]), names);
    assert.deepEqual(probe.doubts(1 << 31 | 2), [probe.DOUBTS[1], "for a reason that this page does not know"]);
  },
  names() { // everything that a module asks the page for is there; every file is small, and asks nobody else for anything
    const html = fs.readFileSync(`${modules}/index.html`, "utf8"), main = fs.readFileSync(`${modules}/main.js`, "utf8");
    for (const m of main.matchAll(/(?:\$|on)\("([\w-]+)"/g)) assert.ok(html.includes(`id="${m[1]}"`), m[1]);
    let total = 0;
    for (const f of fs.readdirSync(modules)) {
      const text = fs.readFileSync(`${modules}/${f}`, "utf8");
      total += text.length;
      assert.ok(!/https?:\/\/(?!www\.w3\.org\/2000\/svg)/.test(text), f);
      assert.ok(!/\beval\(|innerHTML|document\.write/.test(text), f);
    }
    assert.ok(total > 40000 && total < 150000, `${total}`);
  },
};

function compare(name, m, d, want) {
  const c = m.grid.channels, rest = new Set(d.keys());
  for (const [at, ...values] of want.voxels)
    values.forEach((x, q) => {
      rest.delete(at * c + q);
      assert.ok(Math.abs(d[at * c + q] - x) <= 6e-8 + Math.abs(x) * 2 ** -11, `${name} ${at}: ${d[at * c + q]} ${x}`);
    });
  for (const i of rest) assert.equal(d[i], 0, `${name} ${i}`);
  assert.deepEqual(m.grid.n, want.n);
  assert.equal(m.grid.basis, want.basis);
}

await tests[what]();
