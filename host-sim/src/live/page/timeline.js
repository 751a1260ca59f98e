// The moment that is shown: the latest, or one that the user chose; and replay from there.

class Timeline {
  constructor(history, changed) {
    Object.assign(this, {history, changed});
    this.follows = true;
    this.seconds = 0;
    this.playing = false;
    this.marked = -1;
    // A simulation that goes on: `send` tells it, `isPaused` if it stands still.
    this.simulation = null;
    byId('rate').addEventListener('change', () => {
      if (this.drives) this.simulation.send({do: 'speed', times: Number(byId('rate').value)});
    });
    byId('scrub').addEventListener('input', event => this.go(Number(event.target.value)));
    byId('now').addEventListener('click', () => this.follow());
    byId('play').addEventListener('click', () => this.toggle());
  }

  // The controls are those of the simulation, not of a replay.
  get drives() { return this.simulation !== null && this.follows && this.history.latest.ended === null; }

  // The moment that is shown.
  get moment() { return this.follows ? this.history.end : this.seconds; }

  go(seconds) {
    this.follows = false;
    this.seconds = Math.max(this.history.begin, Math.min(seconds, this.history.end));
    this.changed();
  }

  follow() {
    this.follows = true;
    this.playing = false;
    this.changed();
  }

  // Plays from the beginning, if it is at the end and nothing comes.
  toggle() {
    if (this.drives) {
      const {simulation} = this;
      simulation.isPaused = !simulation.isPaused;
      simulation.send({do: simulation.isPaused ? 'pause' : 'resume'});
    } else if (this.follows) {
      this.follows = false;
      this.playing = this.history.latest.ended !== null;
      this.seconds = this.playing ? this.history.begin : this.history.end;
    } else {
      this.playing = !this.playing;
      if (this.playing && this.seconds >= this.history.end) this.seconds = this.history.begin;
    }
    this.changed();
  }

  // Lets replayed time pass; returns true if another moment is to be shown.
  tick(elapsed) {
    if (!this.playing) return false;
    this.seconds = Math.min(this.seconds + elapsed * (Number(byId('rate').value) || Infinity), this.history.end);
    if (this.seconds >= this.history.end) this.playing = false;
    return true;
  }

  show() {
    const {begin, end} = this.history;
    const scrub = byId('scrub');
    scrub.min = begin;
    scrub.max = end;
    scrub.value = this.moment;
    setText(byId('clock'), `${this.moment.toFixed(1)} s`);
    byId('now').classList.toggle('on', this.follows);
    const runs = this.drives ? !this.simulation.isPaused : this.playing || this.follows && !this.history.latest.ended;
    const [stop, go] = this.drives ? ['pause', 'go on'] : ['hold', 'play'];
    setText(byId('play'), runs ? stop : go);
    setText(byId('rate-of'), this.drives ? 'speed' : 'replay');
    byId('play').setAttribute('aria-label', runs ? `${stop} this moment` : go);
    byId('play').setAttribute('aria-pressed', String(runs));
    this.mark();
  }

  // Marks stops, poses and failures along the line.
  mark() {
    const {events, begin, end} = this.history;
    const now = performance.now();
    if (this.marked === events.length || now - (this.markedAt ?? 0) < 500) return;
    this.marked = events.length;
    this.markedAt = now;
    const {context, width, height} = canvasOf('marks');
    const colours = {stop: colour('target'), pose: colour('calibrated'), bad: colour('bad')};
    for (const event of events) {
      const kind = event.event === 'stop' && event.begins ? 'stop'
        : event.event === 'node' && event.news.includes('failure') || event.event === 'said' && event.node ? 'bad'
          : event.event === 'node' && event.news.includes('status') && event.is.status === 'calibrated' ? 'pose'
            : null;
      if (!kind) continue;
      context.fillStyle = colours[kind];
      const x = (event.seconds - begin) / (end - begin || 1) * (width - 16) + 7;
      const [top, tall] = {stop: [0, height], pose: [4, height - 4], bad: [8, height - 8]}[kind];
      context.fillRect(x, top, 2, tall);
    }
  }
}
