// What was lost, where, and why: the daemon's causes, the way here, the bridge, the page.
export class Lost {
  constructor(table) { this.table = table; this.rows = new Map(); this.total = new Map(); }
  set(place, cause, n, why = "") {
    const key = `${place}/${cause}`;
    let r = this.rows.get(key);
    if (!n && !r) return;
    if (!r) {
      const tr = document.createElement("tr"), cells = [0, 1, 2].map(() => document.createElement("td"));
      tr.append(...cells);
      this.table.append(tr);
      this.rows.set(key, r = cells);
      cells[0].textContent = place;
      cells[1].textContent = cause;
    }
    if (why) r[1].title = why;
    r[2].textContent = n.toLocaleString("en");
    this.total.set(key, n);
  }
  more(place, cause) { this.set(place, cause, (this.total.get(`${place}/${cause}`) || 0) + 1); }
  get sum() { return [...this.total.values()].reduce((a, b) => a + b, 0); }
  clear() { this.rows.clear(); this.total.clear(); this.table.replaceChildren(); }
  status(s) { for (const d of s.drops || []) this.set("daemon", d.name.replaceAll("_", " "), d.value, d.help); }
  link(l) {
    this.set("ZeroMQ", "lost on the way", l.lost, "messages that the daemon published and the bridge did not get");
    this.set("bridge", "not understood", l.malformed + l.unreadable, "messages or volumes that could not be read");
    this.set("bridge", "newer came first", l.superseded, "this page, or the way to it, took longer than the next volume");
    this.set("bridge", "page was hidden", l.hidden, "a hidden page is sent no volumes");
  }
}
