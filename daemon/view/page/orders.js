// What this page may tell the daemon, where the bridge was started with --control.
export class Orders {
  constructor(box, say) {
    this.box = box;
    [this.record, this.snapshot, this.now, this.said] = ["record", "snapshot", "now", "said"].map((k) => box.querySelector(`[data-order=${k}]`));
    this.record.onclick = () => say({ order: this.running ? "stop" : "record" });
    this.snapshot.onclick = () => say({ order: "snapshot" });
  }
  words(o) {
    this.box.hidden = false;
    this.record.disabled = this.snapshot.disabled = o.busy;
    if (this.said.textContent !== o.said) this.said.textContent = o.said;
    this.said.classList.toggle("bad", !o.good);
  }
  status(s) {
    const r = s.record_volumes;
    this.running = Boolean(r?.running);
    this.record.textContent = this.running ? "Stop recording" : "Record volumes";
    this.record.setAttribute("aria-pressed", this.running);
    this.now.textContent = this.running ? `${r.written.toLocaleString("en")} volumes${r.lost ? `, ${r.lost} lost` : ""} in ${r.path}` : r?.error || "";
  }
}
