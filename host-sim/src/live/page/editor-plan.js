// The picture of a site that is edited, and the effects of a pointer on it.

// Y of the picture goes down.
const across = ([x, y]) => [x, -y];
const points = list => list.map(across).map(([x, y]) => `${x},${y}`).join(' ');

function placeOf(event) {
  const svg = byId('site');
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  return [point.x, -point.y];
}

// The corners of an obstacle that can be moved one by one; of a pillar, its middle.
const cornersOf = ({is}) => is.wall ?? is.block ?? [[is.pillar.x, is.pillar.y]];

// The outline of an obstacle: a block's and a pillar's is closed.
function outlineOf({is}) {
  if (is.wall) return is.wall;
  if (is.block) return [...is.block, is.block[0]];
  const {x, y, radius} = is.pillar;
  return Array.from({length: 25}, (_, n) => n * TURN / 24)
    .map(angle => [x + radius * Math.cos(angle), y + radius * Math.sin(angle)]);
}

// Moves one corner of an obstacle, or all of it.
function moveObstacle({is}, dx, dy, corner) {
  if (is.pillar) [is.pillar.x, is.pillar.y] = [round(is.pillar.x + dx), round(is.pillar.y + dy)];
  else cornersOf({is}).forEach((place, n) => {
    if (corner === undefined || n === corner) [place[0], place[1]] = [round(place[0] + dx), round(place[1] + dy)];
  });
}

function draw() {
  if (!layout) return;
  const svg = byId('site');
  const focused = document.activeElement?.dataset?.key;
  svg.replaceChildren();
  const [[lowX, lowY], [highX, highY]] = site.bounds;
  const size = Math.max(highX - lowX, highY - lowY);
  const unit = size / 100;
  // The number of a camera at the border stands beyond it.
  const margin = 5 * unit;
  svg.setAttribute('viewBox',
    `${lowX - margin} ${-highY - margin} ${highX - lowX + 2 * margin} ${highY - lowY + 2 * margin}`);
  drawCoverage(svg);
  element('rect', {class: 'border', x: lowX, y: -highY, width: highX - lowX, height: highY - lowY}, svg);
  const walls = layout.obstacles.flatMap(obstacle => {
    const corners = outlineOf(obstacle);
    return corners.slice(1).map(([x, y], i) => [...corners[i], x, y]);
  });
  layout.obstacles.forEach((obstacle, index) => drawObstacle(svg, obstacle, index, unit));
  for (const [x, y] of judged.design?.stops ?? []) {
    element('circle', {class: 'stop', cx: x, cy: -y, r: unit * 0.5}, svg);
  }
  for (const {network, camera} of cameras()) drawCamera(svg, network, camera, walls, unit);
  drawAdvice(svg, unit);
  if (begunWall.length) element('polyline', {class: 'wall begun', points: points(begunWall)}, svg);
  if (focused) svg.querySelector(`[data-key="${focused}"]`)?.focus({preventScroll: true});
  panels();
}

function drawObstacle(svg, obstacle, index, unit) {
  const is = selected?.kind === 'obstacle' && selected.index === index;
  const key = `obstacle-${index}`;
  const line = element('polyline', {
    class: is ? 'wall selected' : 'wall', points: points(outlineOf(obstacle)), tabindex: 0, role: 'button',
    'aria-label': `obstacle ${index + 1}`, 'aria-pressed': String(is), 'data-key': key,
  }, svg);
  // Messages about an obstacle tell this number.
  const [[x1, y1], [x2, y2]] = outlineOf(obstacle);
  const middle = obstacle.is.pillar ? [obstacle.is.pillar.x, obstacle.is.pillar.y] : [(x1 + x2) / 2, (y1 + y2) / 2];
  element('text', {
    class: 'of-wall', x: middle[0] + unit, y: -middle[1] - unit, 'font-size': 2.4 * unit, 'aria-hidden': 'true',
  }, svg, index + 1);
  const item = {kind: 'obstacle', index};
  line.addEventListener('pointerdown', grab(item, key, moveObstacleBy(index)));
  line.addEventListener('focus', () => pick(item));
  if (!is || obstacle.is.pillar) return;
  cornersOf(obstacle).forEach(([x, y], corner) => {
    const handle = element('circle', {class: 'handle', cx: x, cy: -y, r: unit * 0.9}, svg);
    handle.addEventListener('pointerdown', grab(item, key, moveObstacleBy(index, corner)));
  });
}

const moveObstacleBy = (index, corner) => (at, from) =>
  moveObstacle(layout.obstacles[index], at[0] - from[0], at[1] - from[1], corner);

// Begins a drag when a pointer comes down on an item: `move` is told where the pointer is and where it was.
function grab(item, key, move) {
  return event => {
    if (tool !== 'select') return;
    event.preventDefault();
    event.stopPropagation();
    selected = item;
    dragging = {move, pointer: event.pointerId, from: placeOf(event), before: clone(layout), moved: false};
    byId('site').setPointerCapture(event.pointerId);
    draw();
    byId('site').querySelector(`[data-key="${key}"]`)?.focus({preventScroll: true});
  };
}

// Selects an item that gets the focus by key.
function pick(item) {
  if (dragging || JSON.stringify(selected) === JSON.stringify(item)) return;
  selected = item;
  draw();
}

function drawCoverage(svg) {
  const coverage = judged.design?.coverage;
  if (!coverage) return;
  const what = byId('shade').value;
  const group = element('g', {'aria-hidden': 'true'}, svg);
  const values = coverage[what];
  const sigmas = coverage.sigma.filter(value => value !== null).sort((a, b) => a - b);
  // Dark where a target's place is known as well as anywhere, faint where it is known ten times worse.
  const best = sigmas[Math.floor(sigmas.length / 20)] ?? 1;
  values.forEach((value, n) => {
    if (value === null || value === 0) return;
    const strength = what === 'sigma' ? 1 - Math.log10(Math.max(1, value / best)) : value / 4;
    const [x, y] = [n % coverage.columns, Math.floor(n / coverage.columns)];
    element('rect', {
      class: 'cell', x: coverage.low[0] + x * coverage.step, y: -(coverage.low[1] + (y + 1) * coverage.step),
      width: coverage.step * 1.02, height: coverage.step * 1.02,
      'fill-opacity': (0.08 + 0.5 * Math.max(0, Math.min(1, strength))).toFixed(2),
    }, group);
  });
  const ellipses = ` Ellipses hold a camera's place with 95 %, drawn ${MAGNIFIED} times larger.`;
  byId('key').textContent = (what === 'sigma'
    ? (sigmas.length ? `Darkest: the place of a target is known to ${best.toFixed(3)} ${site.unit}; `
      + `faintest: to ${(10 * best).toFixed(3)} or worse; blank: fewer than two cameras of known pose see it.`
      : 'Nowhere do two cameras of known pose see a target.')
    : 'Darkest: four cameras or more see a target; blank: none.') + ellipses;
}

// In their true size, ellipses would be too small to see.
const MAGNIFIED = 10;

function drawCamera(svg, network, camera, walls, unit) {
  const is = selected?.kind === 'camera' && selected.network === network && selected.id === camera.id;
  const what = expected(network, camera.id) ?? {field_of_view_deg: 60, range: 8};
  const turn = camera.heading_deg * DEGREE;
  const outline = fieldOfView(camera.x, camera.y, camera.heading_deg, what.field_of_view_deg, what.range, walls);
  const key = `camera-${network}-${camera.id}`;
  const group = element('g', {
    class: 'camera' + (is ? ' selected' : '') + (what.reference ? ' reference' : ''), tabindex: 0, role: 'button',
    'aria-label': `camera ${camera.id}`, 'aria-pressed': String(is), 'data-key': key,
  }, svg);
  element('polygon', {class: 'view', points: points([[camera.x, camera.y], ...outline])}, group);
  if (what.covariance) {
    const [[xx, xy], [, yy]] = what.covariance;
    const {a, b, angle} = ellipse(xx, xy, yy);
    element('ellipse', {
      class: 'error', rx: a * MAGNIFIED, ry: b * MAGNIFIED,
      transform: `translate(${camera.x} ${-camera.y}) rotate(${-angle / DEGREE})`,
    }, group);
  }
  const body = element('circle', {class: 'body', cx: camera.x, cy: -camera.y, r: unit * 1.3}, group);
  const tip = [camera.x + 5 * unit * Math.cos(turn), camera.y + 5 * unit * Math.sin(turn)];
  element('line', {class: 'axis', x1: camera.x, y1: -camera.y, x2: tip[0], y2: -tip[1]}, group);
  const handle = element('circle', {class: 'handle', cx: tip[0], cy: -tip[1], r: unit * 1.1}, group);
  element('text', {x: camera.x + 1.5 * unit, y: -camera.y - 1.5 * unit, 'font-size': 3 * unit}, group, camera.id);
  const item = {kind: 'camera', network, id: camera.id};
  // After a drag, the layout is another one.
  const own = () => layout.networks[network].find(one => one.id === camera.id);
  body.addEventListener('pointerdown', grab(item, key, ([x, y]) => Object.assign(own(), {x: round(x), y: round(y)})));
  handle.addEventListener('pointerdown', grab(item, key, ([x, y]) => {
    const degrees = Math.atan2(y - own().y, x - own().x) / DEGREE;
    own().heading_deg = Math.round((degrees + 360) % 360);
  }));
  group.addEventListener('focus', () => pick(item));
}

function drawAdvice(svg, unit) {
  (judged.advice?.cameras ?? []).forEach(({x, y, heading_deg: heading}, n) => {
    const at = off => [x + 3 * unit * Math.cos((heading + off) * DEGREE), y + 3 * unit * Math.sin((heading + off) * DEGREE)];
    element('polygon', {class: 'advised', points: points([at(0), at(140), at(220)])}, svg);
    element('text', {class: 'advised', x: x + 2 * unit, y: -y, 'font-size': 3 * unit}, svg, `+${n + 1}`);
  });
  for (const {x, y} of judged.advice?.stops ?? []) {
    element('path', {class: 'advised', d: `M${x - unit} ${-y - unit}l${2 * unit} ${2 * unit}m0 ${-2 * unit}l${-2 * unit} ${2 * unit}`}, svg);
  }
}
