// Places for words and symbols on the plan, so that no word lies over another or over a symbol.

// Height of a line of words, pixels.
const LINE = 13;

const STOP_FONT = '10px system-ui, sans-serif';
const cameraFont = node => `${node.reference ? 'bold ' : ''}12px system-ui, sans-serif`;

class Labels {
  constructor(context) { Object.assign(this, {context, taken: []}); }

  isFree({x, y, width, height}) {
    return this.taken.every(other => Math.abs(other.x - x) * 2 >= other.width + width
      || Math.abs(other.y - y) * 2 >= other.height + height);
  }

  // Keeps a place free around a symbol.
  symbol(x, y, size) { this.taken.push({x, y, width: size, height: size}); }

  // The first of these places, from the middle, at which the words lie over nothing; nothing if there is none.
  place(words, font, [x, y], places) {
    this.context.font = font;
    const width = this.context.measureText(String(words)).width + 2;
    for (const [dx, dy] of places) {
      const box = {x: x + dx, y: y + dy, width, height: LINE};
      if (this.isFree(box)) {
        this.taken.push(box);
        return [dx, dy];
      }
    }
    return null;
  }
}

// Places around a symbol, beginning at an angle, so far away.
function around(angle, far) {
  return [0, 1, -1, 2, -2, 3, -3, 4].flatMap(eighths => {
    const at = angle + eighths * Math.PI / 4;
    return [[far * Math.cos(at), far * Math.sin(at)]];
  });
}

// Places of the numbers of cameras, by their identity, and of stops, by target and stop; `places` are those of
// targets. Those that find no place
// are left out: a camera's number is told by its tooltip.
function labelsOf(brush, record, cameras, places) {
  const labels = new Labels(brush.context);
  const named = cameras.length <= 200 ? cameras : [];
  const placed = named.map(node => [node, drawnAt(record, node)]).filter(([, at]) => at);
  const all = placed.map(([node, at]) => ({node, at, on: brush.toScreen(at.x, at.y)}));
  for (const {on} of all) labels.symbol(...on, 14);
  for (const [id, place] of places) {
    const target = record.targets.find(other => other.id === id);
    if (target) labels.symbol(...brush.placed(target.network, place), 12);
  }
  const numbers = new Map();
  for (const {node, at, on} of all) {
    const away = -at.heading * DEGREE + Math.PI;
    const place = labels.place(node.id, cameraFont(node), on, [...around(away, 15), ...around(away, 21)]);
    if (place) numbers.set(node.id, place);
  }
  const stops = new Map();
  const beside = around(-Math.PI / 4, 11);
  for (const target of record.targets) {
    const known = target.stops.map((stop, index) => ({stop: stop.stop, count: index + 1, on: brush.placed(target.network, stop)}));
    for (const {on} of known) labels.symbol(...on, 5);
    // The newest first: of them people want to know.
    for (const {stop, count, on} of known.reverse()) {
      const place = labels.place(count, STOP_FONT, on, beside);
      if (place) stops.set(`${target.id} ${stop}`, place);
    }
  }
  return {numbers, stops, taken: labels.taken};
}
