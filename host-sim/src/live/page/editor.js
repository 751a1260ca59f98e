// The page on which a site is edited. What to expect of it the server computes.

const byId = id => document.getElementById(id);
const token = location.hash.slice(1);
let site = null;
let layout = null;
let judged = {design: null, refused: null, advice: null};
let selected = null;
let tool = 'select';
let begunWall = [];
let dragging = null;
const undone = [];
const done = [];

const clone = value => JSON.parse(JSON.stringify(value));
const round = number => Math.round(number * 1000) / 1000;

function element(name, attributes, parent, text) {
  const made = document.createElementNS(byId('site').namespaceURI, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent?.append(made);
  return made;
}

function cell(row, text, head) {
  const made = document.createElement(head ? 'th' : 'td');
  if (head) made.scope = 'row';
  made.textContent = text;
  row.append(made);
}

// All cameras with the number of their network.
const cameras = () => layout.networks.flatMap((list, network) => list.map(camera => ({network, camera})));
const selectedCamera = () => selected?.kind === 'camera'
  ? cameras().find(({network, camera}) => network === selected.network && camera.id === selected.id)?.camera
  : undefined;
const expected = (network, id) => judged.design?.cameras.find(one => one.network === network && one.id === id);

// ---- Changes

function remember() {
  done.push(clone(layout));
  if (done.length > 200) done.shift();
  undone.length = 0;
}

function change(work) {
  remember();
  work();
  changed();
}

function changed() {
  draw();
  judge(false);
}

function step(from, to) {
  const before = from.pop();
  if (!before) return;
  to.push(clone(layout));
  layout = before;
  changed();
}

function addCamera(x, y, headingDeg) {
  const ids = cameras().map(({camera}) => camera.id);
  const network = selected?.kind === 'camera' ? selected.network : 0;
  // The lowest number that nobody has.
  let id = 1;
  while (ids.includes(id) || site.taken.includes(id)) id += 1;
  change(() => {
    layout.networks[network].push({id, x: round(x), y: round(y), heading_deg: round(headingDeg)});
    selected = {kind: 'camera', network, id};
  });
}

function removeSelected() {
  if (!selected) return;
  change(() => {
    if (selected.kind === 'camera') {
      const {network, id} = selected;
      layout.networks[network] = layout.networks[network].filter(camera => camera.id !== id);
    } else {
      layout.obstacles.splice(selected.index, 1);
    }
    selected = null;
  });
}

function endWall() {
  const wall = begunWall;
  begunWall = [];
  if (wall.length < 2) return draw();
  change(() => layout.obstacles.push({wall}));
}

function choose(name) {
  tool = name;
  begunWall = [];
  for (const other of ['select', 'camera', 'wall']) {
    byId('tool-' + other).setAttribute('aria-pressed', String(other === name));
  }
  draw();
}

// ---- The server

let isAsking = false;
let isWanted = false;
let isAdviceWanted = false;

async function post(path, advice) {
  return fetch(path, {
    method: 'POST', headers: {'content-type': 'application/json', 'x-token': token},
    body: JSON.stringify({layout, advice}),
  });
}

// One question at a time; of those that come meanwhile, the last.
async function judge(advice) {
  isAdviceWanted ||= advice;
  isWanted = true;
  if (isAsking) return;
  isAsking = true;
  while (isWanted) {
    isWanted = false;
    const wantsAdvice = isAdviceWanted;
    isAdviceWanted = false;
    tell('computing', false);
    try {
      const answer = await post('design', wantsAdvice);
      if (answer.ok) {
        judged = await answer.json();
        tell('computed', false);
      } else {
        tell(`refused: ${await answer.text() || answer.status}`, true);
      }
    } catch {
      tell('the server does not answer', true);
    }
  }
  isAsking = false;
  draw();
  document.body.dataset.judged = String(Number(document.body.dataset.judged ?? 0) + 1);
}

function tell(words, isBad) {
  byId('link').textContent = words;
  byId('link').classList.toggle('lost', isBad);
}

async function save() {
  try {
    const answer = await post('save', false);
    if (!answer.ok) return tell(`not saved: ${await answer.text() || answer.status}`, true);
    if (!answer.headers.get('content-type').startsWith('application/toml')) return tell(await answer.text(), false);
    const link = document.createElement('a');
    link.href = URL.createObjectURL(await answer.blob());
    link.download = 'site.toml';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    tell('downloaded as site.toml', false);
  } catch {
    tell('not saved: the server does not answer', true);
  }
}

// ---- The picture

// Y of the picture goes down.
const across = ([x, y]) => [x, -y];
const points = list => list.map(across).map(([x, y]) => `${x},${y}`).join(' ');

function placeOf(event) {
  const svg = byId('site');
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  return [point.x, -point.y];
}

function outlineOf(obstacle) {
  return obstacle.of === undefined ? obstacle.wall : site.outlines[obstacle.of];
}

function draw() {
  if (!layout) return;
  const svg = byId('site');
  const focused = document.activeElement?.dataset?.key;
  svg.replaceChildren();
  const [[lowX, lowY], [highX, highY]] = site.bounds;
  const size = Math.max(highX - lowX, highY - lowY);
  const unit = size / 100;
  const margin = 2 * unit;
  svg.setAttribute('viewBox',
    `${lowX - margin} ${-highY - margin} ${highX - lowX + 2 * margin} ${highY - lowY + 2 * margin}`);
  drawCoverage(svg);
  element('rect', {class: 'border', x: lowX, y: -highY, width: highX - lowX, height: highY - lowY}, svg);
  const walls = layout.obstacles.flatMap(obstacle => {
    const corners = outlineOf(obstacle);
    return corners.slice(1).map(([x, y], i) => [...corners[i], x, y]);
  });
  layout.obstacles.forEach((obstacle, index) => {
    const line = element('polyline', {
      class: 'wall' + (selected?.kind === 'obstacle' && selected.index === index ? ' selected' : ''),
      points: points(outlineOf(obstacle)), tabindex: 0, role: 'button', 'aria-label': `obstacle ${index + 1}`,
      'data-key': `obstacle-${index}`,
    }, svg);
    const pick = () => { selected = {kind: 'obstacle', index}; draw(); };
    line.addEventListener('pointerdown', event => { if (tool === 'select') { event.stopPropagation(); pick(); } });
    line.addEventListener('keydown', event => { if (event.key === ' ' || event.key === 'Enter') pick(); });
  });
  for (const [x, y] of judged.design?.stops ?? []) {
    element('circle', {class: 'stop', cx: x, cy: -y, r: unit * 0.5}, svg);
  }
  for (const {network, camera} of cameras()) drawCamera(svg, network, camera, walls, unit);
  drawAdvice(svg, unit);
  if (begunWall.length) element('polyline', {class: 'wall begun', points: points(begunWall)}, svg);
  if (focused) svg.querySelector(`[data-key="${focused}"]`)?.focus({preventScroll: true});
  panels();
}

function drawCoverage(svg) {
  const coverage = judged.design?.coverage;
  if (!coverage) return;
  const what = byId('shade').value;
  const group = element('g', {'aria-hidden': 'true'}, svg);
  const values = coverage[what];
  const sigmas = coverage.sigma.filter(value => value !== null).sort((a, b) => a - b);
  // Dark where a target's place is known as well as anywhere, faint at ten times as much.
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

// As small as they are, ellipses would not be seen.
const MAGNIFIED = 10;

function drawCamera(svg, network, camera, walls, unit) {
  const is = selected?.kind === 'camera' && selected.network === network && selected.id === camera.id;
  const what = expected(network, camera.id) ?? {field_of_view_deg: 60, range: 8};
  const turn = camera.heading_deg * DEGREE;
  const outline = fieldOfView(camera.x, camera.y, camera.heading_deg, what.field_of_view_deg, what.range, walls);
  const group = element('g', {
    class: 'camera' + (is ? ' selected' : '') + (what.reference ? ' reference' : ''), tabindex: 0, role: 'button',
    'aria-label': `camera ${camera.id}`, 'aria-pressed': String(is), 'data-key': `camera-${network}-${camera.id}`,
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
  const drag = isTurn => event => {
    if (tool !== 'select') return;
    event.preventDefault();
    event.stopPropagation();
    selected = {kind: 'camera', network, id: camera.id};
    dragging = {isTurn, network, id: camera.id, pointer: event.pointerId, before: clone(layout), moved: false};
    byId('site').setPointerCapture(event.pointerId);
    draw();
    byId('site').querySelector(`[data-key="camera-${network}-${camera.id}"]`)?.focus({preventScroll: true});
  };
  body.addEventListener('pointerdown', drag(false));
  handle.addEventListener('pointerdown', drag(true));
  group.addEventListener('focus', () => {
    if (!is && !dragging) { selected = {kind: 'camera', network, id: camera.id}; draw(); }
  });
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

// ---- Words

function panels() {
  const {design, refused, advice} = judged;
  const known = design?.cameras.filter(camera => camera.sigma_position !== null) ?? [];
  const worst = known.reduce((a, b) => (a && a.sigma_position > b.sigma_position ? a : b), null);
  byId('verdict').textContent = refused ?? design?.problem ?? (worst
    ? `Each pose can be found: the worst is that of camera ${worst.id}, to ${worst.sigma_position.toFixed(3)} ${site.unit}.`
    : 'No stops: nothing is known of poses.');
  if (!refused && design && !design.problem && known.length < design.cameras.length) {
    const lost = design.cameras.filter(camera => camera.sigma_position === null).map(camera => camera.id);
    byId('verdict').textContent = `The stops do not tell the poses of cameras ${lost.join(', ')}.`;
  }
  byId('banner').classList.toggle('good', Boolean(design && !design.problem && known.length === design.cameras.length));
  const body = document.querySelector('#cameras tbody');
  body.replaceChildren(...cameras().map(({network, camera}) => {
    const row = document.createElement('tr');
    row.dataset.camera = camera.id;
    row.classList.toggle('selected', camera === selectedCamera());
    const what = expected(network, camera.id);
    const number = (value, digits) => (value === null || value === undefined ? '-' : value.toFixed(digits));
    cell(row, camera.id + (what?.reference ? ' (reference)' : ''), true);
    cell(row, `${camera.x.toFixed(2)}, ${camera.y.toFixed(2)}`);
    cell(row, `${camera.heading_deg.toFixed(1)}°`);
    cell(row, what ? what.stops : '-');
    cell(row, number(what?.sigma_position, 4));
    cell(row, what?.sigma_heading_deg === null || !what ? '-' : `${number(what.sigma_heading_deg, 3)}°`);
    row.addEventListener('click', () => { selected = {kind: 'camera', network, id: camera.id}; draw(); });
    return row;
  }));
  const camera = selectedCamera();
  byId('exact').hidden = !camera;
  if (camera) {
    byId('which').textContent = `Camera ${camera.id}`;
    for (const [id, key] of [['x', 'x'], ['y', 'y'], ['heading', 'heading_deg']]) {
      if (document.activeElement !== byId(id)) byId(id).value = camera[key];
    }
  }
  byId('undo').disabled = !done.length;
  byId('redo').disabled = !undone.length;
  byId('remove').disabled = !selected;
  byId('advice').hidden = !advice;
  if (advice) {
    const list = byId('advice').querySelector('ol');
    list.replaceChildren(...advice.cameras.map(one => {
      const item = document.createElement('li');
      item.append(`a camera at (${one.x.toFixed(2)}, ${one.y.toFixed(2)}) that looks along ${one.heading_deg.toFixed(0)}°: `
        + `${one.gain_bits.toFixed(2)} bits per place `);
      const put = document.createElement('button');
      put.type = 'button';
      put.textContent = 'put it there';
      put.addEventListener('click', () => addCamera(one.x, one.y, one.heading_deg));
      item.append(put);
      return item;
    }), ...advice.stops.map(one => {
      const item = document.createElement('li');
      item.textContent = `a stop at (${one.x.toFixed(2)}, ${one.y.toFixed(2)}), seen by ${one.seen_by.join(', ')}: `
        + `${one.gain_bits.toFixed(2)} bits about their poses`;
      return item;
    }));
    byId('advice').querySelector('p').textContent = advice.method;
  }
}

// ---- Pointer and keys

function listen() {
  const svg = byId('site');
  svg.addEventListener('pointerdown', event => {
    const [x, y] = placeOf(event);
    if (tool === 'camera') { addCamera(x, y, 0); choose('select'); }
    else if (tool === 'wall') { begunWall.push([round(x), round(y)]); draw(); }
    else { selected = null; draw(); }
  });
  svg.addEventListener('dblclick', () => { if (tool === 'wall') endWall(); });
  svg.addEventListener('pointermove', event => {
    if (dragging?.pointer !== event.pointerId) return;
    const camera = layout.networks[dragging.network].find(one => one.id === dragging.id);
    const [x, y] = placeOf(event);
    if (dragging.isTurn) {
      const degrees = Math.atan2(y - camera.y, x - camera.x) / DEGREE;
      camera.heading_deg = Math.round((degrees + 360) % 360);
    } else {
      [camera.x, camera.y] = [round(x), round(y)];
    }
    dragging.moved = true;
    draw();
  });
  const drop = event => {
    if (dragging?.pointer !== event.pointerId) return;
    const {moved, before} = dragging;
    dragging = null;
    if (!moved) return;
    done.push(before);
    undone.length = 0;
    changed();
  };
  svg.addEventListener('pointerup', drop);
  svg.addEventListener('pointercancel', drop);
  for (const name of ['select', 'camera', 'wall']) byId('tool-' + name).addEventListener('click', () => choose(name));
  byId('undo').addEventListener('click', () => step(done, undone));
  byId('redo').addEventListener('click', () => step(undone, done));
  byId('remove').addEventListener('click', removeSelected);
  byId('shade').addEventListener('change', draw);
  byId('advise').addEventListener('click', () => judge(true));
  byId('save').addEventListener('click', save);
  byId('exact').addEventListener('submit', event => event.preventDefault());
  for (const [id, key] of [['x', 'x'], ['y', 'y'], ['heading', 'heading_deg']]) {
    byId(id).addEventListener('change', () => {
      const number = byId(id).valueAsNumber;
      if (Number.isFinite(number)) change(() => { selectedCamera()[key] = number; });
    });
  }
  document.addEventListener('keydown', keys);
}

function keys(event) {
  const key = event.key.toLowerCase();
  if (event.ctrlKey || event.metaKey) {
    if (key === 's') { event.preventDefault(); save(); }
    if (event.target instanceof HTMLInputElement) return;
    if (key === 'z' || key === 'y') {
      event.preventDefault();
      if (key === 'y' || event.shiftKey) step(undone, done); else step(done, undone);
    }
    return;
  }
  if (event.altKey || event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement) return;
  const far = event.shiftKey ? 1 : 0.1;
  const moves = {arrowleft: [-far, 0], arrowright: [far, 0], arrowup: [0, far], arrowdown: [0, -far]};
  const turns = {q: event.shiftKey ? 15 : 1, e: event.shiftKey ? -15 : -1};
  const camera = selectedCamera();
  if (camera && moves[key]) {
    event.preventDefault();
    change(() => { camera.x = round(camera.x + moves[key][0]); camera.y = round(camera.y + moves[key][1]); });
  } else if (camera && turns[key]) {
    change(() => { camera.heading_deg = round((camera.heading_deg + turns[key] + 360) % 360); });
  } else if (key === 'delete' || key === 'backspace') {
    removeSelected();
  } else if (key === 'enter' && tool === 'wall') {
    event.preventDefault();
    endWall();
  } else if (key === 'escape') {
    selected = null;
    choose('select');
  } else if (key === 'c') choose('camera');
  else if (key === 'w') choose('wall');
  else if (key === 'v') choose('select');
}

async function begin() {
  if (!token) return tell('open the whole address that was printed, with what follows #', true);
  const answer = await fetch('site?token=' + encodeURIComponent(token));
  if (!answer.ok) return tell('this address is not the one that was printed last', true);
  site = await answer.json();
  layout = clone(site.layout);
  byId('name').textContent = site.name;
  document.title = site.name;
  listen();
  draw();
  judge(false);
}

begin();
