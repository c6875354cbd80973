// What this page may tell the daemon, where the bridge was started with --control.
export class Orders {
  constructor(box, say) {
    this.box = box;
    [this.record, this.snapshot, this.now, this.said] = ["record", "snapshot", "now", "said"].map((k) => box.querySelector(`[data-order=${k}]`));
    this.ringSaid = document.getElementById("ring");
    this.record.onclick = () => say({ order: this.running ? "stop" : "record" });
    this.snapshot.onclick = () => say({ order: "snapshot" });
  }
  // Raw frames in memory: what their triggers judge, and the take of the last.
  ring(s) {
    const r = s.ring;
    if (!r) return "";
    const t = s.triggers.map((k) => `${k.name} ${k.unit ? `${Number(k.value?.toPrecision(3))} of ${k.above} ${k.unit}` : `by ${k.when}`}, fired ${k.fired}`);
    const lost = Object.entries(r.lost).map(([k, n]) => `${k} ${n}`);
    return [`last ${r.seconds.toFixed(1)} s in memory`, ...t, `${r.takes} takes${r.writing ? `, writing ${r.name}` : ""}`, lost.length ? `frames lost: ${lost.join(", ")}` : "", r.error].filter(Boolean).join(" · ");
  }
  words(o) {
    this.box.hidden = false;
    this.record.disabled = this.snapshot.disabled = o.busy;
    if (this.said.textContent !== o.said) this.said.textContent = o.said;
    this.said.classList.toggle("bad", !o.good);
  }
  status(s) {
    const r = s.record_volumes;
    this.ringSaid.textContent = this.ring(s);
    this.ringSaid.parentElement.hidden = !s.ring;
    this.running = Boolean(r?.running);
    this.record.textContent = this.running ? "Stop recording" : "Record volumes";
    this.record.setAttribute("aria-pressed", this.running);
    this.now.textContent = this.running ? `${r.written.toLocaleString("en")} volumes${r.lost ? `, ${r.lost} lost` : ""} in ${r.path}` : r?.error || "";
  }
}
