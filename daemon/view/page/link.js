// The way to the bridge, seen from the page: the worker (worker.js) and what is said to it.
export class Link {
  // on: functions by the kind of message.
  constructor(token, on) {
    this.worker = new Worker("worker.js", { type: "module" });
    this.worker.onmessage = (e) => on[e.data.kind]?.(e.data);
    this.worker.onerror = (e) => on.malformed({ why: e.message || "the worker did not start" });
    const url = new URL("live", location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.hash = "";
    this.worker.postMessage({ connect: { url: url.href, token, most: 1 << 30 } });
    document.addEventListener("visibilitychange", () => this.say({ hidden: document.hidden }));
    if (document.hidden) this.say({ hidden: true });
  }
  say(o) { this.worker.postMessage({ say: o }); }
  show(what) { this.worker.postMessage({ show: what }); } // "flame" or "bars"
  probe(ray) { this.worker.postMessage({ probe: ray }); }
  retry() { this.worker.postMessage({ retry: true }); }
  again() { this.worker.postMessage({ again: true }); }
}
