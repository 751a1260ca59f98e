// The page on which a site is edited. The server computes what to expect of it.

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

const TURN = 2 * Math.PI;
// Fields of the selected camera's form, and the keys of the file that they set.
const FIELDS = [
  ['x', 'x'], ['y', 'y'], ['heading', 'heading_deg'],
  ['height', 'height'], ['pitch', 'pitch_deg'], ['roll', 'roll_deg'],
];
// Those that may be empty.
const MOUNT = ['height', 'pitch', 'roll'];
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

// The network of the camera that is nearest to a place.
function networkAt(x, y) {
  const gap = ({camera}) => Math.hypot(camera.x - x, camera.y - y);
  return cameras().reduce((a, b) => (a && gap(a) <= gap(b) ? a : b), null)?.network ?? 0;
}

function addCamera(x, y, headingDeg, network) {
  const ids = cameras().map(({camera}) => camera.id);
  // The lowest number that no node has.
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
  change(() => layout.obstacles.push({is: {wall}}));
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
let isQuiet = false;

async function post(path, more) {
  return fetch(path, {
    method: 'POST', headers: {'content-type': 'application/json', 'x-token': token},
    body: JSON.stringify({version: site.version, layout, ...more}),
  });
}

// Asks one question at a time; of those that come meanwhile, the last. `quiet` leaves the words on a save there.
async function judge(advice, quiet = false) {
  isAdviceWanted ||= advice;
  isQuiet = quiet;
  isWanted = true;
  if (isAsking) return;
  isAsking = true;
  while (isWanted) {
    isWanted = false;
    const wantsAdvice = isAdviceWanted;
    isAdviceWanted = false;
    if (!isQuiet) tell('computing', false);
    try {
      const answer = await post('design', {advice: wantsAdvice});
      if (answer.ok) {
        judged = await answer.json();
        if (!isQuiet) tell('computed', false);
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

// The layout that was last read or saved, as text.
let kept = '';
let isSaving = false;

const isUnsaved = () => layout !== null && JSON.stringify(layout) !== kept;

function download(text) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([text], {type: 'application/toml'}));
  link.download = 'site.toml';
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// Numbers the obstacles of a layout that can be undone or redone as those of the saved file.
function renumber(entry, sent, saved) {
  for (const obstacle of entry.obstacles) {
    const same = one => (obstacle.of === undefined
      ? one.of === undefined && JSON.stringify(one.is) === JSON.stringify(obstacle.is)
      : one.of === obstacle.of);
    const at = sent.obstacles.findIndex(same);
    obstacle.of = at < 0 ? undefined : saved.obstacles[at].of;
  }
}

// Saves; `more` tells which change holds where page and file changed the same thing, or that a download is wanted.
async function save(more) {
  if (isSaving || dragging) return;
  // Nothing changes meanwhile that would be lost when the file's state comes back.
  isSaving = true;
  const locked = [byId('tools'), document.querySelector('main')];
  for (const part of locked) part.inert = true;
  try {
    const answer = await post('save', more);
    if (answer.status === 409) return conflict(await answer.json());
    if (!answer.ok) return tell(`not saved: ${await answer.text() || answer.status}`, true);
    const saved = await answer.json();
    if (saved.text !== null) download(saved.text);
    byId('conflict').hidden = true;
    if (saved.joined) {
      // Going back would take the others' changes back too.
      done.length = undone.length = 0;
      selected = null;
    } else {
      const sent = layout;
      for (const entry of [...done, ...undone]) renumber(entry, sent, saved.layout);
    }
    site = saved.site;
    layout = saved.layout;
    kept = JSON.stringify(layout);
    const words = saved.words ?? 'downloaded as site.toml';
    tell(saved.joined ? `${words}, joined with what changed there meanwhile` : words, false);
    draw();
    if (saved.joined) judge(false, true);
  } catch {
    tell('not saved: the server does not answer', true);
  } finally {
    isSaving = false;
    for (const part of locked) part.inert = false;
  }
}

// Shows what was changed here and in the file, and what can be done.
function conflict(all) {
  tell('not saved: it was changed here and in the file', true);
  byId('conflict').querySelector('ul').replaceChildren(...all.map(words => {
    const item = document.createElement('li');
    item.textContent = words;
    return item;
  }));
  byId('conflict').hidden = false;
}

// ---- Pointer and keys

function listen() {
  const svg = byId('site');
  svg.addEventListener('pointerdown', event => {
    const [x, y] = placeOf(event);
    if (tool === 'camera') { addCamera(x, y, 0, networkAt(x, y)); choose('select'); }
    else if (tool === 'wall') { begunWall.push([round(x), round(y)]); draw(); }
    else { selected = null; draw(); }
  });
  svg.addEventListener('dblclick', () => { if (tool === 'wall') endWall(); });
  svg.addEventListener('pointermove', event => {
    if (dragging?.pointer !== event.pointerId) return;
    // From the place before the drag, so that no rounding adds up.
    layout = clone(dragging.before);
    dragging.move(placeOf(event), dragging.from);
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
  byId('save').addEventListener('click', () => save());
  byId('take-page').addEventListener('click', () => save({prefer: 'page'}));
  byId('take-file').addEventListener('click', () => save({prefer: 'file'}));
  byId('keep-page').addEventListener('click', () => save({download: true}));
  addEventListener('beforeunload', event => { if (isUnsaved()) event.preventDefault(); });
  byId('exact').addEventListener('submit', event => event.preventDefault());
  for (const [id, key] of FIELDS) {
    byId(id).addEventListener('change', () => {
      const number = byId(id).valueAsNumber;
      if (Number.isFinite(number)) change(() => { selectedCamera()[key] = number; });
      else if (MOUNT.includes(id)) change(() => { delete selectedCamera()[key]; });
    });
  }
  document.addEventListener('keydown', keys);
}

function keys(event) {
  const key = event.key.toLowerCase();
  if (isSaving) return;
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
  if (selected?.kind === 'obstacle' && moves[key]) {
    event.preventDefault();
    change(() => moveObstacle(layout.obstacles[selected.index], ...moves[key]));
  } else if (camera && moves[key]) {
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
  if (!answer.ok) return tell(await answer.text() || 'this address is not the one that was printed last', true);
  site = await answer.json();
  layout = clone(site.layout);
  kept = JSON.stringify(layout);
  byId('name').textContent = site.name;
  document.title = site.name;
  byId('grid').hidden = !site.was_grid;
  listen();
  draw();
  judge(false);
}

begin();
