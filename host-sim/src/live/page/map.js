// The plan: walls, fields of view, cameras, ellipses, targets with their trail, rays, stops.

class Plan {
  // `choose` is told the number of the camera that is clicked.
  constructor(canvas, hover, scale, choose) {
    Object.assign(this, {canvas, hover, scale, choose});
    this.view = null;
    this.isOwn = false;
    this.chosen = null;
    this.state = emptyState();
    this.shapes = new Map();
    this.colours = {};
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
    for (const name of ['ground', 'ink', 'faint', 'line', 'calibrated', 'weak', 'doubtful', 'refused',
      'waiting', 'target', 'object', 'truth', 'wall', 'view', 'ray', 'next']) {
      this.colours[name] = style.getPropertyValue('--' + name).trim();
    }
    this.dirty = true;
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const {clientWidth: width, clientHeight: height} = this.canvas;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.ratio = ratio;
    if (!this.isOwn) this.view = null;
    this.dirty = true;
  }

  show(state) {
    if (state.record?.obstacles !== this.state.record?.obstacles) {
      this.walls = wallsOf(state.record?.obstacles ?? []);
      this.shapes.clear();
    }
    this.state = state;
    // What is new may be out of view.
    const size = (state.record?.nodes.length ?? 0) + (state.record?.targets ?? []).reduce(
      (sum, target) => sum + target.stops.length, 0) + (state.verdict?.walk_to.length ?? 0);
    if (size !== this.size && !this.isOwn) this.view = null;
    this.size = size;
    this.dirty = true;
  }

  // Where a camera is drawn: where it believes to be, or else where it was put.
  drawn(node) {
    const place = node.estimate ?? node.planned ?? node.truth;
    if (!place) return null;
    const [x, y] = inFirst(this.state.record, node.network, place.x, place.y);
    return {x, y, heading: turned(this.state.record, node.network, place.heading_deg)};
  }

  // Everything in view.
  fit() {
    const places = [];
    const {record, verdict, places: targets} = this.state;
    for (const node of record?.nodes ?? []) {
      const drawn = this.drawn(node);
      if (drawn) places.push([drawn.x, drawn.y]);
      if (node.truth) places.push(inFirst(record, node.network, node.truth.x, node.truth.y));
    }
    for (const target of record?.targets ?? []) {
      for (const stop of target.stops) places.push(inFirst(record, target.network, stop.x, stop.y));
    }
    for (const outline of record?.obstacles ?? []) places.push(...outline);
    for (const place of targets.values()) places.push([place.x, place.y]);
    for (const stop of verdict?.walk_to ?? []) places.push(inFirst(record, stop.network, stop.x, stop.y));
    if (!places.length) places.push([-1, -1], [1, 1]);
    const xs = places.map(place => place[0]), ys = places.map(place => place[1]);
    const [left, right] = [Math.min(...xs), Math.max(...xs)];
    const [low, high] = [Math.min(...ys), Math.max(...ys)];
    const {clientWidth: width, clientHeight: height} = this.canvas;
    const times = Math.min(width / (right - left || 1), height / (high - low || 1)) * 0.86;
    return {x: (left + right) / 2, y: (low + high) / 2, times};
  }

  toScreen(x, y) {
    const {clientWidth: width, clientHeight: height} = this.canvas;
    return [width / 2 + (x - this.view.x) * this.view.times, height / 2 - (y - this.view.y) * this.view.times];
  }

  toPlan(px, py) {
    const {clientWidth: width, clientHeight: height} = this.canvas;
    return [this.view.x + (px - width / 2) / this.view.times, this.view.y - (py - height / 2) / this.view.times];
  }

  zoom(by, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    if (!this.view) return;
    const [x, y] = this.toPlan(px, py);
    this.view.times *= by;
    this.view.x = x - (px - this.canvas.clientWidth / 2) / this.view.times;
    this.view.y = y + (py - this.canvas.clientHeight / 2) / this.view.times;
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
    if (!this.view) return null;
    let best = null, least = 18;
    for (const node of this.state.record?.nodes ?? []) {
      if (node.role !== 'camera') continue;
      const drawn = this.drawn(node);
      if (!drawn) continue;
      const [x, y] = this.toScreen(drawn.x, drawn.y);
      const gap = Math.hypot(x - px, y - py);
      if (gap < least) { least = gap; best = node; }
    }
    return best;
  }

  point(px, py) {
    const node = this.nearest(px, py);
    this.hover.hidden = !node;
    if (!node) return;
    this.hover.textContent = `camera ${node.id}: ${statusWords(node)}\n${poseWords(node)}`;
    this.hover.style.left = Math.min(px + 12, this.canvas.clientWidth - 180) + 'px';
    this.hover.style.top = py + 12 + 'px';
  }

  // Draws if something changed since. Rays fade for half a second of the clock.
  draw() {
    const now = performance.now();
    const rays = this.rays(now);
    if (!this.dirty && !rays.length && !this.hadRays) return;
    if (!this.view) {
      if (!this.canvas.clientWidth) return;
      this.view = this.fit();
    }
    this.dirty = false;
    this.hadRays = rays.length > 0;
    const {record} = this.state;
    const context = this.canvas.getContext('2d');
    const {colours, ratio} = this;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    if (!record) return;
    const cameras = record.nodes.filter(node => node.role === 'camera');
    const times = this.magnification(cameras);
    this.updateLayer(record, cameras, times);
    this.drawLayer(context);
    for (const {ray, share} of rays) this.drawRay(context, ray, share);
    this.drawStops(context, record);
    this.drawNext(context, record);
    for (const target of record.targets) this.drawTarget(context, target, times);
    for (const truth of this.state.truths.values()) this.drawTruth(context, truth);
    for (const object of this.state.objects.values()) this.drawObject(context, object);
    const words = times > 1 ? `, ellipses (95 %) ${times} times larger` : ', ellipses hold 95 %';
    this.scale.textContent = this.ruler(record) + words;
  }

  // What changes only with cameras, walls and the view is drawn once for many frames.
  updateLayer(record, cameras, times) {
    const {width, height} = this.canvas;
    const {x, y, times: zoom} = this.view;
    const key = [width, height, x, y, zoom, times, this.chosen, this.colours.ground].join(' ');
    const kept = this.kept;
    if (kept && kept.key === key && kept.obstacles === record.obstacles && kept.networks.length === record.networks.length
      && kept.networks.every((network, i) => network === record.networks[i])
      && kept.cameras.length === cameras.length && kept.cameras.every((node, i) => node === cameras[i])) return;
    // Where that takes long it is not done for every frame: the old one serves until then.
    const begun = performance.now();
    if (kept && kept.width === width && kept.height === height && begun - kept.at < 4 * kept.cost) {
      this.dirty = true;
      return;
    }
    this.layer ??= document.createElement('canvas');
    this.layer.width = width;
    this.layer.height = height;
    const context = this.layer.getContext('2d', {willReadFrequently: true});
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.drawViews(context, cameras);
    this.drawWalls(context, record);
    for (const node of cameras) this.drawCamera(context, node, times, cameras.length <= 200);
    // Only then it is really drawn.
    context.getImageData(0, 0, 1, 1);
    const at = performance.now();
    this.kept = {
      key, obstacles: record.obstacles, networks: [...record.networks], cameras, view: {...this.view},
      width, height, at, cost: at - begun,
    };
  }

  // The layer where the view is now.
  drawLayer(context) {
    const {view, width, height} = this.kept;
    const by = this.view.times / view.times;
    const [x, y] = this.toScreen(view.x, view.y);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.layer, x * this.ratio - by * width / 2, y * this.ratio - by * height / 2, by * width, by * height);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
  }

  // Ellipses of a few pixels show nothing: how many times larger they are drawn.
  magnification(cameras) {
    const sizes = cameras.filter(node => node.estimate && node.estimate.sigma_x > 0)
      .map(node => 2.45 * Math.hypot(node.estimate.sigma_x, node.estimate.sigma_y)).sort((a, b) => a - b);
    if (!sizes.length) return 1;
    const typical = sizes[Math.floor(sizes.length / 2)] * this.view.times;
    return [1, 2, 5, 10, 20, 50].find(times => times * typical >= 12) ?? 50;
  }

  ruler(record) {
    const wide = 80 / this.view.times;
    const power = 10 ** Math.floor(Math.log10(wide));
    const length = [5, 2, 1].find(times => times * power <= wide) * power;
    const context = this.canvas.getContext('2d');
    const y = this.canvas.clientHeight - 24;
    context.fillStyle = this.colours.faint;
    context.fillRect(8, y, length * this.view.times, 2);
    return `${Number(length.toPrecision(2))} ${record.unit.name}`;
  }

  path(context, places, close) {
    context.beginPath();
    places.forEach(([x, y], i) => {
      const at = this.toScreen(x, y);
      if (i) context.lineTo(...at); else context.moveTo(...at);
    });
    if (close) context.closePath();
  }

  drawWalls(context, record) {
    context.strokeStyle = this.colours.wall;
    context.lineWidth = 2.5;
    for (const outline of record.obstacles) {
      this.path(context, outline, true);
      context.stroke();
    }
  }

  drawViews(context, cameras) {
    for (const node of cameras) {
      const drawn = node.view && this.drawn(node);
      if (!drawn) continue;
      const key = `${drawn.x} ${drawn.y} ${drawn.heading}`;
      let shape = this.shapes.get(node.id);
      if (shape?.key !== key) {
        const outline = fieldOfView(drawn.x, drawn.y, drawn.heading, node.view.fov_deg, node.view.range, this.walls);
        shape = {key, outline};
        this.shapes.set(node.id, shape);
      }
      this.path(context, [[drawn.x, drawn.y], ...shape.outline], true);
      context.fillStyle = this.colours.view;
      context.fill();
      if (node.id === this.chosen) {
        context.strokeStyle = this.colours.calibrated;
        context.lineWidth = 1;
        context.stroke();
      }
    }
  }

  // The rays of the last moments, with how fresh they are.
  rays(now) {
    const {rays} = this.state;
    const last = rays.at(-1);
    if (last !== this.lastRay) {
      this.lastRay = last;
      this.rayAt = now;
    }
    const share = 1 - (now - (this.rayAt ?? 0)) / 700;
    if (!last || share <= 0) return [];
    const {seconds} = this.state;
    return rays.filter(ray => seconds - ray.seconds <= 3 && ray.seconds <= seconds).map(ray => ({ray, share}));
  }

  drawRay(context, ray, share) {
    const node = this.state.record.nodes.find(other => other.id === ray.node);
    const drawn = node && this.drawn(node);
    if (!drawn) return;
    const angle = (drawn.heading + ray.bearing_deg) * DEGREE;
    let far = node.view?.range ?? 10;
    const place = this.state.places.get(ray.target);
    if (place) {
      const [tx, ty] = inFirst(this.state.record, node.network, place.x, place.y);
      far = Math.min(far, Math.hypot(tx - drawn.x, ty - drawn.y) * 1.05);
    }
    context.globalAlpha = Math.max(0.1, share);
    context.strokeStyle = this.colours.ray;
    context.lineWidth = 1.5;
    this.path(context, [[drawn.x, drawn.y], [drawn.x + far * Math.cos(angle), drawn.y + far * Math.sin(angle)]]);
    context.stroke();
    context.globalAlpha = 1;
  }

  drawStops(context, record) {
    context.font = '11px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    for (const target of record.targets) {
      const places = target.stops.map(stop => inFirst(record, target.network, stop.x, stop.y));
      const now = this.state.places.get(target.id);
      const trail = now ? [...places, inFirst(record, target.network, now.x, now.y)] : places;
      context.strokeStyle = this.colours.target;
      context.globalAlpha = 0.45;
      context.lineWidth = 1;
      this.path(context, trail);
      context.stroke();
      context.globalAlpha = 1;
      target.stops.forEach((stop, i) => {
        const [x, y] = this.toScreen(...places[i]);
        context.fillStyle = this.colours.ground;
        context.beginPath();
        context.arc(x, y, 8, 0, 2 * Math.PI);
        context.fill();
        context.strokeStyle = this.colours.target;
        context.stroke();
        context.fillStyle = this.colours.ink;
        context.fillText(String(stop.stop), x, y + 0.5);
      });
    }
  }

  drawNext(context, record) {
    (this.state.verdict?.walk_to ?? []).forEach((stop, i) => {
      const [x, y] = this.toScreen(...inFirst(record, stop.network, stop.x, stop.y));
      const size = i ? 6 : 10;
      context.strokeStyle = this.colours.next;
      context.lineWidth = i ? 2 : 4;
      context.beginPath();
      context.moveTo(x - size, y); context.lineTo(x + size, y);
      context.moveTo(x, y - size); context.lineTo(x, y + size);
      context.stroke();
    });
  }

  drawEllipse(context, x, y, covariance, times, colour) {
    const {a, b, angle} = ellipse(...covariance);
    const [px, py] = this.toScreen(x, y);
    context.strokeStyle = colour;
    context.lineWidth = 1.2;
    context.beginPath();
    context.ellipse(px, py, a * times * this.view.times, b * times * this.view.times, -angle, 0, 2 * Math.PI);
    context.stroke();
  }

  drawCamera(context, node, times, named) {
    const {record} = this.state;
    const drawn = this.drawn(node);
    if (!drawn) return;
    const status = node.status ?? 'waiting';
    const colour = this.colours[status] ?? this.colours.waiting;
    const [x, y] = this.toScreen(drawn.x, drawn.y);
    if (node.truth && node.estimate) this.drawTruth(context, {network: node.network, ...node.truth});
    if (node.estimate) {
      const [xx, xy, , yy] = node.estimate.covariance;
      const covariance = turnedCovariance(record, node.network, [xx, xy, yy]);
      this.drawEllipse(context, drawn.x, drawn.y, covariance, times, colour);
    }
    context.save();
    context.translate(x, y);
    context.rotate(-drawn.heading * DEGREE);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(0, 0); context.lineTo(16, 0); context.moveTo(12, -3); context.lineTo(16, 0);
    context.lineTo(12, 3);
    context.stroke();
    context.restore();
    context.save();
    context.translate(x, y);
    this.symbol(context, status, colour, node.address === null);
    if (node.id === this.chosen) {
      context.beginPath();
      context.arc(0, 0, 11, 0, 2 * Math.PI);
      context.stroke();
    }
    if (named) {
      context.fillStyle = this.colours.ink;
      context.textAlign = 'center';
      context.textBaseline = 'middle';
      context.font = (node.reference ? 'bold ' : '') + '12px system-ui, sans-serif';
      const away = -drawn.heading * DEGREE + Math.PI;
      context.fillText(String(node.id), 15 * Math.cos(away), 15 * Math.sin(away));
    }
    context.restore();
  }

  // A shape for each status, so that nobody needs the colour.
  symbol(context, status, colour, isAbsent) {
    context.fillStyle = isAbsent || status === 'waiting' ? this.colours.ground : colour;
    context.strokeStyle = colour;
    context.lineWidth = 2;
    if (isAbsent) context.setLineDash([2, 2]);
    context.beginPath();
    switch (status) {
      case 'doubtful': context.moveTo(0, -7); context.lineTo(6, 5); context.lineTo(-6, 5); break;
      case 'weak': context.moveTo(0, -7); context.lineTo(7, 0); context.lineTo(0, 7); context.lineTo(-7, 0); break;
      case 'refused':
        context.moveTo(-5, -5); context.lineTo(5, 5); context.moveTo(5, -5); context.lineTo(-5, 5);
        context.stroke();
        context.setLineDash([]);
        return;
      default: context.arc(0, 0, 5.5, 0, 2 * Math.PI);
    }
    context.closePath();
    context.fill();
    context.stroke();
    context.setLineDash([]);
  }

  // Where something really is.
  drawTruth(context, {network, x, y}) {
    const [tx, ty] = this.toScreen(...inFirst(this.state.record, network, x, y));
    context.strokeStyle = this.colours.truth;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(tx - 3, ty - 3); context.lineTo(tx + 3, ty + 3);
    context.moveTo(tx + 3, ty - 3); context.lineTo(tx - 3, ty + 3);
    context.stroke();
  }

  // What cameras track: its trail, its ellipse as large as it is, and where it will be in a second.
  drawObject(context, {network, object, is, trail}) {
    const {record} = this.state;
    const [x, y] = inFirst(record, network, is.x, is.y);
    context.strokeStyle = this.colours.object;
    context.lineWidth = 1.5;
    context.globalAlpha = 0.5;
    this.path(context, trail.map(place => inFirst(record, network, ...place)));
    context.stroke();
    context.globalAlpha = 1;
    this.drawEllipse(context, x, y, turnedCovariance(record, network, is.covariance), 1, this.colours.object);
    const [vx, vy] = is.velocity;
    this.path(context, [[x, y], inFirst(record, network, is.x + vx, is.y + vy)]);
    context.stroke();
    const [px, py] = this.toScreen(x, y);
    context.fillStyle = this.colours.object;
    context.fillRect(px - 8, py - 8, 16, 16);
    context.fillStyle = this.colours.ground;
    context.font = 'bold 11px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    context.fillText(String(object), px, py + 0.5);
  }

  drawTarget(context, target, times) {
    const {record, places, stopped} = this.state;
    const believed = target.stops.at(-1)?.believed;
    if (believed) {
      const [x, y] = inFirst(record, target.network, believed.x, believed.y);
      const covariance = [believed.sigma_x ** 2, 0, believed.sigma_y ** 2];
      this.drawEllipse(context, x, y, covariance, times, this.colours.target);
    }
    const place = places.get(target.id);
    if (!place) return;
    const [x, y] = this.toScreen(...inFirst(record, target.network, place.x, place.y));
    context.fillStyle = this.colours.target;
    context.beginPath();
    context.arc(x, y, stopped.get(target.id) ? 6 : 4.5, 0, 2 * Math.PI);
    context.fill();
    context.strokeStyle = this.colours.ink;
    context.lineWidth = 1;
    context.stroke();
  }
}
