// The plan on its canvas: the part of it that is in view, and the things that are drawn there.

class Plan {
  // `choose` is told the number of the camera that is clicked.
  constructor(canvas, hover, scale, choose) {
    Object.assign(this, {canvas, hover, scale, choose});
    this.view = null;
    this.isOwn = false;
    this.chosen = null;
    this.state = emptyState();
    this.shapes = new Shapes([]);
    this.layer = new Layer();
    this.dirty = true;
    this.pointers = new Map();
    canvas.addEventListener('wheel', event => this.wheel(event), {passive: false});
    canvas.addEventListener('pointerdown', event => this.down(event));
    canvas.addEventListener('pointermove', event => this.move(event));
    for (const end of ['pointerup', 'pointercancel', 'pointerleave']) {
      canvas.addEventListener(end, event => this.up(event));
    }
    canvas.addEventListener('keydown', event => this.key(event));
    new ResizeObserver(() => { this.resize(); }).observe(canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.restyle());
    this.restyle();
  }

  restyle() {
    const style = getComputedStyle(document.documentElement);
    const names = ['ground', 'ink', 'faint', 'line', 'calibrated', 'weak', 'doubtful', 'refused', 'waiting', 'target',
      'object', 'truth', 'wall', 'view', 'ray', 'next'];
    this.colours = Object.fromEntries(names.map(name => [name, style.getPropertyValue('--' + name).trim()]));
    this.dirty = true;
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    // To ask for these costs a layout.
    const {clientWidth: width, clientHeight: height} = this.canvas;
    Object.assign(this, {ratio, width, height});
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    if (!this.isOwn) this.view = null;
    else if (this.view) Object.assign(this.view, {width, height});
    this.dirty = true;
  }

  show(state) {
    const first = state.record?.networks[0];
    const standing = JSON.stringify(first && frameOf(state.record, first.network));
    if (state.record?.obstacles !== this.state.record?.obstacles || standing !== this.standing) {
      this.shapes = new Shapes(obstaclesOf(state.record));
      this.standing = standing;
    }
    this.state = state;
    this.cameras = (state.record?.nodes ?? []).filter(node => node.role === 'camera');
    // New things may be out of view.
    const size = (state.record?.nodes.length ?? 0) + (state.record?.targets ?? []).reduce(
      (sum, target) => sum + target.stops.length, 0) + (state.verdict?.walk_to.length ?? 0);
    if (size !== this.size && !this.isOwn) this.view = null;
    this.size = size;
    this.dirty = true;
  }

  // Everything in view.
  fit() {
    const places = [];
    const {record, verdict, places: targets} = this.state;
    for (const node of record?.nodes ?? []) {
      const drawn = drawnAt(record, node);
      if (drawn) places.push([drawn.x, drawn.y]);
      if (node.truth) places.push(inSite(record, node.network, node.truth.x, node.truth.y));
    }
    for (const target of record?.targets ?? []) {
      for (const stop of target.stops) places.push(inSite(record, target.network, stop.x, stop.y));
    }
    for (const outline of obstaclesOf(record)) places.push(...outline);
    for (const target of record?.targets ?? []) {
      const place = targets.get(target.id);
      if (place) places.push(inSite(record, target.network, place.x, place.y));
    }
    for (const stop of verdict?.walk_to ?? []) places.push(inSite(record, stop.network, stop.x, stop.y));
    if (!places.length) places.push([-1, -1], [1, 1]);
    const xs = places.map(place => place[0]), ys = places.map(place => place[1]);
    const [left, right] = [Math.min(...xs), Math.max(...xs)];
    const [low, high] = [Math.min(...ys), Math.max(...ys)];
    const {width, height} = this;
    const times = Math.min(width / (right - left || 1), height / (high - low || 1)) * 0.86;
    return {x: (left + right) / 2, y: (low + high) / 2, times, width, height};
  }

  brush() {
    return new Brush(this.canvas.getContext('2d'), this.view, this.state.record, this.colours, this.shapes);
  }

  toPlan(px, py) {
    const {width, height, view} = this;
    return [view.x + (px - width / 2) / view.times, view.y - (py - height / 2) / view.times];
  }

  zoom(by, px = this.width / 2, py = this.height / 2) {
    if (!this.view) return;
    const [x, y] = this.toPlan(px, py);
    this.view.times *= by;
    this.view.x = x - (px - this.width / 2) / this.view.times;
    this.view.y = y + (py - this.height / 2) / this.view.times;
    this.isOwn = true;
    this.dirty = true;
  }

  pan(dx, dy) {
    if (!this.view) return;
    this.view.x -= dx / this.view.times;
    this.view.y += dy / this.view.times;
    this.isOwn = true;
    this.dirty = true;
  }

  all() { this.isOwn = false; this.view = null; this.dirty = true; }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.moved = 0;
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    const now = [event.offsetX, event.offsetY];
    if (!before) { this.point(...now); return; }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    this.moved += Math.abs(dx) + Math.abs(dy);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const gap = place => Math.hypot(place[0] - other[0], place[1] - other[1]) || 1;
      this.zoom(gap(now) / gap(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else if (this.moved > 4) {
      this.pan(dx, dy);
    }
    this.pointers.set(event.pointerId, now);
  }

  up(event) {
    const was = this.pointers.delete(event.pointerId);
    if (event.type === 'pointerleave') this.hover.hidden = true;
    if (was && event.type === 'pointerup' && this.moved <= 4) {
      const node = this.nearest(event.offsetX, event.offsetY);
      if (node) this.choose(node.id);
    }
  }

  key(event) {
    const steps = {ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40]};
    if (steps[event.key]) this.pan(...steps[event.key]);
    else if (event.key === '+' || event.key === '=') this.zoom(1.25);
    else if (event.key === '-') this.zoom(0.8);
    else if (event.key === '0') this.all();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  nearest(px, py) {
    if (!this.view || !this.cameras) return null;
    const brush = this.brush();
    let best = null, least = 18;
    for (const node of this.cameras) {
      const at = drawnAt(this.state.record, node);
      if (!at) continue;
      const [x, y] = brush.toScreen(at.x, at.y);
      const gap = Math.hypot(x - px, y - py);
      if (gap < least) { least = gap; best = node; }
    }
    return best;
  }

  point(px, py) {
    const node = this.nearest(px, py);
    this.hover.hidden = !node;
    if (!node) return;
    this.hover.textContent = `camera ${node.id}: ${statusWords(node)}\n${poseWords(this.state.record, node)}`;
    this.hover.style.left = Math.min(px + 12, this.width - 180) + 'px';
    this.hover.style.top = py + 12 + 'px';
  }

  // Draws if something changed since the last time. Rays fade for half a second of the clock.
  draw() {
    const rays = this.rays(performance.now());
    if (!this.dirty && !rays.length && !this.hadRays) return;
    if (!this.width) return;
    this.view ??= this.fit();
    this.dirty = false;
    this.hadRays = rays.length > 0;
    const {record, places, stopped, verdict, truths, objects} = this.state;
    const context = this.canvas.getContext('2d');
    const {colours, shapes, cameras, chosen} = this;
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, this.width, this.height);
    if (!record) return;
    const times = this.magnification(cameras);
    const brush = this.brush();
    const labels = this.labels(brush, record, cameras, places);
    const wanted = {view: {...this.view}, record, colours, shapes, cameras, chosen, times, labels};
    if (!this.layer.update(wanted, [this.canvas.width, this.canvas.height])) this.dirty = true;
    // Below the cameras, which they must not hide.
    for (const target of record.targets) brush.stops(target, places.get(target.id), labels.stops);
    this.layer.draw(brush);
    for (const {ray, place, share} of rays) brush.ray(ray, place, share);
    brush.next(verdict?.walk_to ?? []);
    for (const target of record.targets) {
      brush.target(target, places.get(target.id), stopped.get(target.id), times);
    }
    for (const truth of truths.values()) brush.truth(truth);
    for (const object of objects.values()) brush.object(object);
    const words = times > 1 ? `, ellipses (95 %) ${times} times larger` : ', ellipses hold 95 %';
    const frame = frameWords(record);
    setText(this.scale, `the line is ${brush.ruler()}${words}` + (frame && `; ${frame}`));
  }

  // Places of all numbers; the same as before, if nothing moved.
  labels(brush, record, cameras, places) {
    const {x, y, times, width, height} = this.view;
    const seen = cameras.map(node => [node.id, node.estimate?.x, node.estimate?.y, node.estimate?.heading_deg]);
    const stops = record.targets.map(target => target.stops.map(stop => [stop.stop, stop.x, stop.y]));
    const key = cameras.length > 200 ? `${stops}` : `${[x, y, times, width, height, this.standing]} ${seen} ${stops}`;
    if (this.labelKey !== key) {
      this.labelKey = key;
      this.placed = labelsOf(brush, record, cameras, places);
    }
    return this.placed;
  }

  // Magnification of ellipses, which show nothing if they have only a few pixels.
  magnification(cameras) {
    const sizes = cameras.filter(node => node.estimate && node.estimate.sigma_x > 0)
      .map(node => 2.45 * Math.hypot(node.estimate.sigma_x, node.estimate.sigma_y)).sort((a, b) => a - b);
    if (!sizes.length) return 1;
    const typical = sizes[Math.floor(sizes.length / 2)] * this.view.times;
    return [1, 2, 5, 10, 20, 50].find(times => times * typical >= 12) ?? 50;
  }

  // The rays of the last moments, with the places of their targets and with their freshness.
  rays(now) {
    const {rays, record, seconds, places} = this.state;
    const last = rays.at(-1);
    if (last !== this.lastRay) {
      this.lastRay = last;
      this.rayAt = now;
    }
    const share = 1 - (now - (this.rayAt ?? 0)) / 700;
    if (!last || share <= 0) return [];
    const recent = rays.filter(ray => seconds - ray.seconds <= 3 && ray.seconds <= seconds);
    return recent.map(ray => {
      const stops = record.targets.find(target => target.id === ray.target)?.stops ?? [];
      const place = stops.find(stop => stop.stop === ray.stop) ?? places.get(ray.target);
      return {ray, place, share};
    });
  }
}
