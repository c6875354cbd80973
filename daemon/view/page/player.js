// The scrub bar of a recording.
export class Player {
  constructor(box, say) {
    this.box = box;
    this.say = say;
    [this.play, this.bar, this.words, this.speed] = ["play", "bar", "at", "speed"].map((k) => box.querySelector(`[data-film=${k}]`));
    this.play.onclick = () => say({ play: !this.playing });
    this.bar.oninput = () => { this.held = performance.now(); say({ play: false, seek: Number(this.bar.value) }); };
    this.speed.onchange = () => say({ speed: Number(this.speed.value) });
  }
  film(f) {
    this.box.hidden = false;
    this.playing = f.playing;
    this.count = f.count;
    this.play.textContent = f.playing ? "Pause" : "Play";
    if (![...this.speed.options].some((o) => Number(o.value) === f.speed)) this.speed.append(new Option(`${f.speed}×`, f.speed));
    this.speed.value = String(f.speed);
    this.bar.max = f.count - 1;
    this.at(f.at);
    this.box.classList.toggle("cut", f.cut);
    this.words.title = f.unsolved ? `${f.unsolved} sets are not solved yet and are left out`
      : f.cut ? "the recording was cut off: it is shown as far as it is whole" : "";
  }
  at(k) {
    if (performance.now() - (this.held || 0) > 300) this.bar.value = k;
    this.words.textContent = `${k + 1} of ${this.count}`;
  }
  step(n) { this.say({ play: false, seek: Math.max(0, Math.min(this.count - 1, Number(this.bar.value) + n)) }); }
}
