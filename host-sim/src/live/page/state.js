// The state at a moment: the record, folded from events as `RunRecord::apply` does it.

// Number of places of an object's trail that are kept.
const TRAIL = 200;

// A fresh state before anything is known.
function emptyState() {
  return {
    seconds: 0, record: null, verdict: null, places: new Map(), stopped: new Map(), rays: [],
    blobs: new Map(), objects: new Map(), truths: new Map(), ended: null,
  };
}

function put(list, key, item) {
  const at = list.findIndex(other => other[key] === item[key]);
  if (at >= 0) list[at] = item; else { list.push(item); list.sort((a, b) => a[key] - b[key]); }
}

// A list that was told by its former items: pieces of those, each from a place on and so many, and new items.
function putTogether(before, pieces) {
  return pieces.flatMap(piece => Array.isArray(piece) ? before.slice(piece[0], piece[0] + piece[1]) : [piece]);
}

// Takes an event over. Events are never changed: a state shares parts with them.
function apply(state, event) {
  state.seconds = Math.max(state.seconds, event.seconds);
  const record = state.record;
  switch (event.event) {
    case 'begin': {
      Object.assign(state, emptyState(), {seconds: event.seconds});
      const from = event.record;
      state.record = {
        ...from, nodes: [...from.nodes], networks: [...from.networks],
        targets: from.targets.map(target => ({...target, stops: [...target.stops]})),
      };
      for (const target of from.targets) {
        const last = target.stops.at(-1);
        if (last) state.places.set(target.id, last);
      }
      break;
    }
    case 'node': put(record.nodes, 'id', event.is); break;
    case 'gone':
      record.nodes = record.nodes.filter(node => node.id !== event.node);
      record.targets = record.targets.filter(target => target.id !== event.node);
      break;
    case 'network': put(record.networks, 'network', event.is); break;
    case 'obstacles': Object.assign(record, {obstacles: event.outlines, area: event.area ?? []}); break;
    case 'target': put(record.targets, 'id', {...event.is, stops: [...event.is.stops]}); break;
    case 'stop': {
      const target = record.targets.find(other => other.id === event.target);
      if (target) put(target.stops, 'stop', event.is);
      if (event.begins) state.stopped.set(event.target, true);
      // The place where it stands may become better known.
      if (event.begins || state.places.get(event.target)?.stop === event.is.stop) {
        state.places.set(event.target, event.is);
      }
      break;
    }
    case 'stop_ends': state.stopped.set(event.target, false); break;
    case 'place': state.places.set(event.target, event); break;
    case 'seen':
      state.rays.push(event);
      if (state.rays.length > 400) state.rays.splice(0, 200);
      break;
    case 'tracked': state.blobs.set(event.node, event); break;
    case 'object': {
      const key = `${event.network} ${event.object}`;
      const trail = state.objects.get(key)?.trail ?? [];
      if (event.is) state.objects.set(key, {...event, trail: [...trail.slice(1 - TRAIL), [event.is.x, event.is.y]]});
      else state.objects.delete(key);
      break;
    }
    case 'truth': state.truths.set(`${event.network} ${event.object}`, event); break;
    case 'verdict': state.verdict = event; break;
    case 'verdict_change': {
      const before = state.verdict ?? {words: '', findings: [], walk_to: []};
      state.verdict = {
        ...event, words: putTogether(before.words.split('\n'), event.words).join('\n'),
        findings: putTogether(before.findings, event.findings), walk_to: putTogether(before.walk_to, event.walk_to),
      };
      break;
    }
    case 'end': state.ended = event; break;
  }
}

// All events, the state now, and the state at any moment. Memory is bounded: the oldest events are
// folded into the state with which the history begins.
class History {
  static kept = 60000;
  static checkpointEvery = 2000;

  constructor() { this.clear(); }

  clear() {
    this.events = [];
    // Of these, the events that say something in words, and those with the state of a node.
    this.telling = [];
    this.nodes = [];
    this.latest = emptyState();
    this.checkpoints = [{count: 0, state: emptyState()}];
  }

  push(event) {
    if (event.event === 'begin') this.clear();
    this.events.push(event);
    if (eventWords(null, event)) this.telling.push(event);
    if (event.event === 'node' || event.event === 'begin') this.nodes.push(event);
    apply(this.latest, event);
    if (this.events.length % History.checkpointEvery === 0) {
      this.checkpoints.push({count: this.events.length, state: copy(this.latest)});
    }
    if (this.events.length > History.kept) this.forget();
  }

  // Forgets everything before the second checkpoint.
  forget() {
    const {count} = this.checkpoints[1];
    this.events.splice(0, count);
    this.checkpoints.shift();
    for (const checkpoint of this.checkpoints) checkpoint.count -= count;
    const oldest = this.events[0].seconds;
    this.telling = this.telling.filter(event => event.seconds >= oldest);
    this.nodes = this.nodes.filter(event => event.seconds >= oldest);
  }

  get begin() { return this.checkpoints[0].state.record ? this.checkpoints[0].state.seconds : this.events[0]?.seconds ?? 0; }
  get end() { return this.latest.seconds; }

  // The state at a moment.
  at(seconds) {
    let from = this.checkpoints[0];
    for (const checkpoint of this.checkpoints) {
      if (checkpoint.state.seconds <= seconds) from = checkpoint;
    }
    const state = copy(from.state);
    for (let i = from.count; i < this.events.length && this.events[i].seconds <= seconds; i++) {
      apply(state, this.events[i]);
    }
    return state;
  }
}

function copy(state) {
  const record = state.record && {
    ...state.record, nodes: [...state.record.nodes], networks: [...state.record.networks],
    targets: state.record.targets.map(target => ({...target, stops: [...target.stops]})),
  };
  return {
    ...state, record, places: new Map(state.places), stopped: new Map(state.stopped),
    rays: [...state.rays], blobs: new Map(state.blobs), objects: new Map(state.objects),
    truths: new Map(state.truths),
  };
}
