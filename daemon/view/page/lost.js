// What was lost, where, and why: the daemon's causes, the way here, the bridge, the page.
export class Lost {
  constructor(table) { this.table = table; this.rows = new Map(); this.total = new Map(); this.kept = 0; }
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
  // "daemon 6 of 190, here 122 of 154": the daemon's sets since it began, this page's volumes since it was opened.
  words(drawn) {
    let sets = 0, volumes = 0;
    for (const [key, n] of this.total) if (key.startsWith("daemon/")) sets += n; else volumes += n;
    const part = (name, n, rest) => n ? [`${name} ${n.toLocaleString("en")} of ${(n + rest).toLocaleString("en")}`] : [];
    return [...part("daemon", sets, this.kept), ...part("here", volumes, drawn)].join(", ") || "0";
  }
  clear() { this.kept = 0; this.rows.clear(); this.total.clear(); this.table.replaceChildren(); }
  status(s) {
    this.kept = (s.sets?.published || 0) + (s.sets?.inside || 0);
    for (const d of s.drops || []) this.set("daemon", d.name.replaceAll("_", " "), d.value, d.help);
  }
  link(l) {
    this.set("ZeroMQ", "lost on the way", l.lost, "messages that the daemon published and the bridge did not get");
    this.set("bridge", "not understood", l.malformed + l.unreadable, "messages or volumes that could not be read");
    this.set("bridge", "newer came first", l.superseded, "this page, or the way to it, took longer than the next volume");
    this.set("bridge", "page was hidden", l.hidden, "a hidden page is sent no volumes");
  }
}
