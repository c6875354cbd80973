// What the cameras see, and what the daemon thinks of them: picture, silhouette over it, saturation, vote, verdict.
const el = (tag, cls, words) => { const e = document.createElement(tag); if (cls) e.className = cls; if (words !== undefined) e.textContent = words; return e; };

export class Cameras {
  constructor(parent, changed) {
    this.parent = parent;
    this.changed = changed; // (states) name -> "good" | "bad"
    this.cards = new Map();
    this.silhouettes = true;
  }
  card(name) {
    let k = this.cards.get(name);
    if (k) return k;
    k = { box: el("figure", "camera"), image: el("img"), over: el("canvas"), title: el("figcaption", "", name), words: el("p"), url: "", preview: "", saturated: 0 };
    k.image.alt = `${name}: no picture yet`;
    k.over.setAttribute("aria-hidden", "true");
    k.frame = el("div", "frame");
    k.frame.append(k.image, k.over);
    k.box.append(k.frame, k.title, k.words);
    this.parent.append(k.box);
    this.cards.set(name, k);
    return k;
  }
  clear() {
    for (const k of this.cards.values()) if (k.url) URL.revokeObjectURL(k.url);
    this.cards.clear();
    this.parent.replaceChildren();
  }
  preview(p) {
    for (const c of p.cameras) {
      const k = this.card(c.name), bins = c.across * c.down;
      k.saturated = bins ? c.saturated / bins : 0;
      k.frame.style.aspectRatio = c.height ? `${c.width} / ${c.height}` : "";
      if (c.jpeg.length) {
        const url = URL.createObjectURL(new Blob([c.jpeg], { type: "image/jpeg" })), old = k.url;
        k.image.onload = k.image.onerror = () => { if (old) URL.revokeObjectURL(old); };
        k.image.src = k.url = url;
        k.image.alt = `${c.name}, ${c.lit} of ${bins} bins lit`;
      }
      this.outline(k.over, c);
      k.box.classList.toggle("saturated", c.saturated > 0);
      k.sat = c.saturated > 0 ? `${(100 * k.saturated).toFixed(k.saturated < 0.01 ? 2 : 1)} % saturated: shorten the exposure` : "";
      this.say(k);
    }
  }
  // The border of the lit bins.
  outline(canvas, c) {
    canvas.width = c.across; canvas.height = c.down;
    if (!this.silhouettes || !c.across) return;
    const d = canvas.getContext("2d"), image = d.createImageData(c.across, c.down), stride = c.across + 7 >> 3;
    const lit = (x, y) => x >= 0 && y >= 0 && x < c.across && y < c.down && c.bits[y * stride + (x >> 3)] >> 7 - (x & 7) & 1;
    for (let y = 0, i = 0; y < c.down; y++)
      for (let x = 0; x < c.across; x++, i += 4)
        if (lit(x, y) && !(lit(x - 1, y) && lit(x + 1, y) && lit(x, y - 1) && lit(x, y + 1))) image.data.set([90, 220, 255, 230], i);
    d.putImageData(image, 0, 0);
  }
  status(s) {
    const states = new Map();
    for (const c of s.cameras || []) {
      const k = this.card(c.name), out = c.vote?.out === true, lost = c.state !== "running";
      k.vote = out ? `voted out: ${c.vote.why}${c.vote.remedy ? "; " + c.vote.remedy : ""}` : "";
      k.state = lost ? `${c.state}${c.error ? ": " + c.error : ""}` : "";
      k.check = c.check?.wrong ? c.check.text : "";
      k.moved = c.rig?.moved ? "it has moved: pyrovox calibrate refine" : "";
      const own = c.selfcal?.corrected && c.selfcal;
      k.own = own ? `corrected: gain ${own.gain.toFixed(2)} ± ${own.gain_error.toFixed(2)}, aim ${Math.hypot(own.right_px, own.down_px).toFixed(2)} ± ${Math.hypot(own.right_error_px, own.down_error_px).toFixed(2)} px` : "";
      k.fps = c.fps;
      k.box.classList.toggle("out", out || lost);
      states.set(c.name, out || lost || k.check || k.moved ? "bad" : "good");
      this.say(k);
    }
    this.changed(states);
  }
  say(k) {
    const words = [k.state, k.vote, k.check, k.moved, k.sat].filter(Boolean).join(" · ") || [k.fps ? `${k.fps.toFixed(0)} Hz, good` : "", k.own].filter(Boolean).join(" · ");
    if (k.words.textContent !== words) k.words.textContent = words;
  }
}
