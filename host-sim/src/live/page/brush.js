// Draws the parts of the plan on a canvas, as they are in one view.

class Brush {
  // The view has the place in the middle, `x` and `y`, `times` pixels a unit, and the picture's `width` and `height`.
  // `shapes` keeps the outlines of the cameras' fields of view.
  constructor(context, view, record, colours, shapes) {
    Object.assign(this, {context, view, record, colours, shapes});
  }

  toScreen(x, y) {
    const {width, height, times} = this.view;
    return [width / 2 + (x - this.view.x) * times, height / 2 - (y - this.view.y) * times];
  }

  // A place of a network on the screen.
  placed(network, {x, y}) {
    return this.toScreen(...inSite(this.record, network, x, y));
  }

  path(places, close) {
    const {context} = this;
    context.beginPath();
    places.forEach(([x, y], i) => {
      const at = this.toScreen(x, y);
      if (i) context.lineTo(...at); else context.moveTo(...at);
    });
    if (close) context.closePath();
  }

  // A line as long as a round number of units; returns that number.
  ruler() {
    const wide = 80 / this.view.times;
    const power = 10 ** Math.floor(Math.log10(wide));
    const length = [5, 2, 1].find(times => times * power <= wide) * power;
    const {context} = this;
    context.fillStyle = this.colours.faint;
    const [left, low, pixels] = [8, this.view.height - 8, length * this.view.times];
    context.fillRect(left, low, pixels, 2);
    context.fillRect(left, low - 4, 1, 6);
    context.fillRect(left + pixels, low - 4, 1, 6);
    return `${Number(length.toPrecision(2))} ${this.record.unit.name}`;
  }

  walls() {
    const {context} = this;
    context.strokeStyle = this.colours.wall;
    context.lineWidth = 2.5;
    for (const outline of obstaclesOf(this.record)) {
      this.path(outline, true);
      context.stroke();
    }
  }

  // The field of view of a camera.
  fieldOfView(node, isChosen) {
    const at = node.view && drawnAt(this.record, node);
    if (!at) return;
    const {context} = this;
    this.path([[at.x, at.y], ...this.shapes.outline(node, at)], true);
    context.fillStyle = this.colours.view;
    context.fill();
    if (isChosen) {
      context.strokeStyle = this.colours.calibrated;
      context.lineWidth = 1;
      context.stroke();
    }
  }

  // A camera with its ellipse so many times larger, and with its number at a place, if it has one.
  camera(node, times, number, isChosen) {
    const {record, context} = this;
    const at = drawnAt(record, node);
    if (!at) return;
    const status = node.status ?? 'waiting';
    const colour = this.colours[status] ?? this.colours.waiting;
    if (node.truth && node.estimate) this.truth({network: node.network, ...node.truth});
    if (node.estimate) {
      const [xx, xy, , yy] = node.estimate.covariance;
      this.ellipse(at.x, at.y, turnedCovariance(record, node.network, [xx, xy, yy]), times, colour);
    }
    context.save();
    context.translate(...this.toScreen(at.x, at.y));
    context.save();
    context.rotate(-at.heading * DEGREE);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(0, 0); context.lineTo(16, 0); context.moveTo(12, -3); context.lineTo(16, 0);
    context.lineTo(12, 3);
    context.stroke();
    context.restore();
    this.symbol(status, colour, node.address === null);
    if (isChosen) {
      context.beginPath();
      context.arc(0, 0, 11, 0, 2 * Math.PI);
      context.stroke();
    }
    if (number) this.word(node.id, ...number, cameraFont(node), 'ink');
    context.restore();
  }

  word(words, x, y, font, colour) {
    const {context} = this;
    context.fillStyle = this.colours[colour];
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    context.font = font;
    context.fillText(String(words), x, y);
  }

  // A shape for each status, so that it can be read without the colour.
  symbol(status, colour, isAbsent) {
    const {context} = this;
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

  ellipse(x, y, covariance, times, colour) {
    const {context} = this;
    const {a, b, angle} = ellipse(...covariance);
    const [px, py] = this.toScreen(x, y);
    context.strokeStyle = colour;
    context.lineWidth = 1.2;
    context.beginPath();
    context.ellipse(px, py, a * times * this.view.times, b * times * this.view.times, -angle, 0, 2 * Math.PI);
    context.stroke();
  }

  // The true place of something.
  truth({network, x, y}) {
    const [px, py] = this.placed(network, {x, y});
    this.strokes('truth', 1, [[px - 3, py - 3, px + 3, py + 3], [px + 3, py - 3, px - 3, py + 3]]);
  }

  strokes(colour, wide, lines) {
    const {context} = this;
    context.strokeStyle = this.colours[colour];
    context.lineWidth = wide;
    context.beginPath();
    for (const [ax, ay, bx, by] of lines) {
      context.moveTo(ax, ay);
      context.lineTo(bx, by);
    }
    context.stroke();
  }

  // A sighting as far as its target was, and as bright as it is fresh.
  ray(ray, place, share) {
    const node = this.record.nodes.find(other => other.id === ray.node);
    const at = node && drawnAt(this.record, node);
    if (!at) return;
    const {context} = this;
    const angle = (at.heading + ray.bearing_deg) * DEGREE;
    let far = node.view?.range ?? 10;
    if (place) {
      const [tx, ty] = inSite(this.record, node.network, place.x, place.y);
      far = Math.min(far, Math.hypot(tx - at.x, ty - at.y) * 1.05);
    }
    context.globalAlpha = Math.max(0.1, share);
    context.strokeStyle = this.colours.ray;
    context.lineWidth = 1.5;
    this.path([[at.x, at.y], [at.x + far * Math.cos(angle), at.y + far * Math.sin(angle)]]);
    context.stroke();
    context.globalAlpha = 1;
  }

  // The stops of a target in their order, and on to where it is now; those with a place for it have their number.
  stops(target, now, numbers) {
    const {record, context} = this;
    const way = now ? [...target.stops, now] : target.stops;
    context.strokeStyle = this.colours.target;
    context.globalAlpha = 0.45;
    context.lineWidth = 1;
    this.path(way.map(({x, y}) => inSite(record, target.network, x, y)));
    context.stroke();
    context.globalAlpha = 1;
    for (const [index, stop] of target.stops.entries()) {
      const [x, y] = this.placed(target.network, stop);
      context.fillStyle = this.colours.ground;
      context.strokeStyle = this.colours.target;
      context.beginPath();
      context.arc(x, y, 2.5, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
      const number = numbers.get(`${target.id} ${stop.stop}`);
      if (number) this.word(index + 1, x + number[0], y + number[1], STOP_FONT, 'faint');
    }
  }

  // Places to stop next: the best one larger than the others.
  next(places) {
    places.forEach((place, i) => {
      const [x, y] = this.placed(place.network, place);
      const size = i ? 6 : 10;
      this.strokes('next', i ? 2 : 4, [[x - size, y, x + size, y], [x, y - size, x, y + size]]);
    });
  }

  // A target at its place, and the ellipse of its last believed place.
  target(target, place, isStanding, times) {
    const {record, context} = this;
    const believed = target.stops.at(-1)?.believed;
    if (believed) {
      const [x, y] = inSite(record, target.network, believed.x, believed.y);
      const covariance = turnedCovariance(record, target.network, [believed.sigma_x ** 2, 0, believed.sigma_y ** 2]);
      this.ellipse(x, y, covariance, times, this.colours.target);
    }
    if (!place) return;
    context.fillStyle = this.colours.target;
    context.beginPath();
    context.arc(...this.placed(target.network, place), isStanding ? 6 : 4.5, 0, 2 * Math.PI);
    context.fill();
    context.strokeStyle = this.colours.ink;
    context.lineWidth = 1;
    context.stroke();
  }

  // An object that cameras track: its trail, its ellipse in true size, and its place in a second.
  object({network, object, is, trail}) {
    const {record, context} = this;
    const [x, y] = inSite(record, network, is.x, is.y);
    context.strokeStyle = this.colours.object;
    context.lineWidth = 1.5;
    context.globalAlpha = 0.5;
    this.path(trail.map(place => inSite(record, network, ...place)));
    context.stroke();
    context.globalAlpha = 1;
    this.ellipse(x, y, turnedCovariance(record, network, is.covariance), 1, this.colours.object);
    const [vx, vy] = is.velocity;
    this.path([[x, y], inSite(record, network, is.x + vx, is.y + vy)]);
    context.stroke();
    const [px, py] = this.toScreen(x, y);
    context.fillStyle = this.colours.object;
    context.fillRect(px - 8, py - 8, 16, 16);
    this.word(object, px, py + 0.5, 'bold 11px system-ui, sans-serif', 'ground');
  }
}

// The place at which a camera is drawn: its own estimate, or else the place where it was put.
function drawnAt(record, node) {
  const place = node.estimate ?? node.planned ?? node.truth;
  if (!place) return null;
  const [x, y] = inSite(record, node.network, place.x, place.y);
  return {x, y, heading: turned(record, node.network, place.heading_deg)};
}

// The outlines of the cameras' fields of view. Each is computed again only when its camera is drawn elsewhere.
class Shapes {
  constructor(obstacles) {
    this.walls = wallsOf(obstacles);
    this.known = new Map();
  }

  outline(node, {x, y, heading}) {
    const key = `${x} ${y} ${heading}`;
    const known = this.known.get(node.id);
    if (known?.key === key) return known.outline;
    const outline = fieldOfView(x, y, heading, node.view.fov_deg, node.view.range, this.walls);
    this.known.set(node.id, {key, outline});
    return outline;
  }
}
