// Banner, checklist, one camera, the log: everything that is text. Words of nodes are text only.

function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

const byId = id => document.getElementById(id);
const digits = (value, count) => value === null || value === undefined ? '-' : value.toFixed(count);
// A heading in [0, 360), also when it is rounded.
const headingWords = (degrees, count) => digits(Number(digits(degrees, count)) % 360, count);

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function statusWords(node) {
  if (node.reason) return `${node.status} (${String(node.reason).replaceAll('_', ' ')})`;
  return node.status ?? 'unknown';
}

function poseWords(record, node) {
  const pose = poseOf(record, node);
  if (!pose) return 'no pose yet';
  const words = `x ${digits(pose.x, 3)} \u00b1 ${digits(pose.sigma_x, 3)}, y ${digits(pose.y, 3)} \u00b1 ` +
    `${digits(pose.sigma_y, 3)}, heading ${headingWords(pose.heading_deg, 2)} \u00b1 ${digits(pose.sigma_heading_deg, 2)}\u00b0`;
  if (pose.z === undefined) return words;
  return `${words}, height ${digits(pose.z, 2)} \u00b1 ${digits(pose.sigma_z, 2)}, ` +
    `pitch ${digits(pose.pitch_deg, 1)} \u00b1 ${digits(pose.sigma_pitch_deg, 1)}\u00b0, ` +
    `roll ${digits(pose.roll_deg, 1)} \u00b1 ${digits(pose.sigma_roll_deg, 1)}\u00b0`;
}

// No coordinator speaks any more, such as those of a simulation that has ended.
function isLineSilent(record) {
  const silent = (record?.nodes ?? []).filter(node => node.role === 'coordinator' && node.silent);
  return silent.length > 0 && silent.length >= record.networks.length;
}

function showBanner(state) {
  const {verdict} = state;
  byId('banner').classList.toggle('good', Boolean(verdict?.good));
  if (!verdict) {
    setText(byId('verdict'), state.record ? 'The network finds itself.' : 'Nothing is known yet.');
    setText(byId('walk'), '');
    showFindings([]);
    return;
  }
  const [first, ...lines] = verdict.words.split('\n').map(line => line.trim()).filter(line => line);
  // A walk that has ended goes nowhere: then it is advice like the rest.
  const next = state.ended === null && !isLineSilent(state.record) ? lines.find(line => line.startsWith('Next')) : undefined;
  setText(byId('verdict'), first);
  setText(byId('walk'), next ?? '');
  // What needs attention comes first.
  const rank = line => (/^(\d+ )?cameras? /.test(line) ? 0 : line.startsWith('Next') ? 1 : 2);
  const others = lines.filter(line => line !== next).sort((a, b) => rank(a) - rank(b));
  // So does what to do about it.
  const todo = others.findIndex(line => rank(line) === 1);
  if (todo >= FINDINGS) others.splice(FINDINGS - 1, 0, ...others.splice(todo, 1));
  showFindings(others);
}

// Findings that are shown at once.
const FINDINGS = 5;

function showFindings(lines) {
  showLines(byId('findings'), lines.slice(0, FINDINGS));
  const more = lines.slice(FINDINGS);
  byId('more').hidden = !more.length;
  setText(byId('more').querySelector('summary'), `${more.length} more`);
  showLines(byId('more').querySelector('ul'), more);
}

function showLines(list, lines) {
  const key = JSON.stringify(lines);
  if (list.shown === key) return;
  list.shown = key;
  list.replaceChildren(...lines.map(line => element('li', line)));
}

// The texts of the cells of a camera's row, each with whether it is well.
function cellsOf(record, node, advice) {
  const joined = node.address !== null;
  const enough = node.sightings >= 3 || node.reference;
  const pose = poseOf(record, node);
  const isGood = node.status === 'calibrated';
  return [
    [node.silent ? 'silent' : joined ? 'yes' : 'no', joined && !node.silent],
    [node.sightings < 3 ? `${node.sightings} of 3` : String(node.sightings), enough],
    [node.status ?? 'unknown', pose !== null && isGood],
    [pose ? `${digits(pose.x, 2)}, ${digits(pose.y, 2)}` : '-', pose !== null],
    [pose ? `\u00b1${digits(Math.hypot(pose.sigma_x, pose.sigma_y), 3)}` : '-', pose !== null],
    [pose ? `${headingWords(pose.heading_deg, 1)}\u00b0` : '-', pose !== null],
    [isGood && !advice ? 'yes' : isGood ? 'not checked' : 'no', isGood && !advice],
  ];
}

// Advice about a camera that is not well; nothing about one that is.
function adviceFor(node, findings) {
  if (node.address === null) return 'it is no member: check its power, its site key and the join window';
  if (node.silent) return 'it does not answer: check its power and its radio';
  return findings;
}

class Checklist {
  constructor(table, choose) {
    this.body = table.tBodies[0];
    this.rows = new Map();
    this.choose = choose;
  }

  show(state, chosen) {
    const cameras = (state.record?.nodes ?? []).filter(node => node.role === 'camera');
    const advice = new Map();
    for (const finding of state.verdict?.findings ?? []) {
      const before = advice.get(finding.node);
      advice.set(finding.node, before ? `${before}; ${finding.words}` : finding.words);
    }
    const known = new Set();
    for (const node of cameras) {
      known.add(node.id);
      let row = this.rows.get(node.id);
      if (!row) {
        row = this.makeRow(node.id);
        this.rows.set(node.id, row);
      }
      row.classList.toggle('chosen', node.id === chosen);
      // The row of a camera that did not change, and has no other advice, is there already.
      const words = advice.get(node.id);
      const standing = JSON.stringify(frameOf(state.record, node.network));
      if (row.shown === node && row.advice === words && row.standing === standing) continue;
      row.shown = node;
      row.standing = standing;
      row.advice = words;
      row.title = adviceFor(node, words) ?? '';
      cellsOf(state.record, node, row.advice).forEach(([text, isWell], i) => {
        const cell = row.cells[i + 1];
        setText(cell, text);
        cell.className = i === 2 && node.status ? `status ${node.status}` : isWell ? 'ok' : 'bad';
      });
    }
    for (const [id, row] of this.rows) {
      if (!known.has(id)) { row.remove(); this.rows.delete(id); }
    }
    this.sort(cameras, advice);
  }

  // What needs attention comes first.
  sort(cameras, advice) {
    const rank = node => (node.silent || node.status !== 'calibrated' ? 0 : advice.has(node.id) ? 1 : 2);
    const order = cameras.map(node => [rank(node), node.id]).sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const key = order.map(([, id]) => id).join();
    if (this.order === key) return;
    this.order = key;
    // A button that is moved loses the focus.
    const focused = document.activeElement;
    this.body.append(...order.map(([, id]) => this.rows.get(id)));
    if (this.body.contains(focused)) focused.focus({preventScroll: true});
  }

  makeRow(id) {
    const row = element('tr', undefined, {'data-camera': id});
    const head = element('th', undefined, {scope: 'row'});
    const button = element('button', String(id), {type: 'button', 'aria-label': `camera ${id}`});
    head.append(button);
    row.append(head);
    for (let i = 0; i < 7; i++) row.append(element('td'));
    row.addEventListener('click', () => this.choose(id));
    this.body.append(row);
    return row;
  }
}

// The objects that cameras track, a row each; hidden where there is none.
function showObjects(table, state) {
  const rows = [...state.objects.values()].map(({network, object, is}) => [
    state.record.networks.length > 1 ? `${network}/${object}` : String(object),
    inSite(state.record, network, is.x, is.y).map(at => digits(at, 2)).join(', '),
    `\u00b1${digits(Math.sqrt(is.covariance[0] + is.covariance[2]), 2)}`,
    digits(Math.hypot(...is.velocity), 1),
    is.unseen_s < 0.5 ? 'now' : `${digits(is.unseen_s, 1)} s ago`,
  ]);
  const key = JSON.stringify(rows);
  if (table.shown === key) return;
  table.shown = key;
  table.hidden = !rows.length;
  table.tBodies[0].replaceChildren(...rows.map(cells => {
    const row = element('tr');
    row.append(...cells.map(text => element('td', text)));
    return row;
  }));
}

// The words of an event for people; nothing for those that only change numbers.
function eventWords(record, event) {
  switch (event.event) {
    case 'said': return (event.node ? `node ${event.node}: ` : '') + event.words;
    case 'command': {
      const state = {asked: 'asked for', done: 'done', failed: 'failed'}[event.state] ?? event.state;
      return `${event.node ? `node ${event.node}: ` : ''}${event.command}: ${state}${event.words ? `: ${event.words}` : ''}`;
    }
    case 'stop': return event.begins ? `target ${event.target}: stop ${stopCount(record, event.target, event.is.stop)}` : null;
    case 'node': {
      const node = event.is;
      const what = [];
      if (event.news.includes('joined')) what.push('is a member');
      if (event.news.includes('left')) what.push('is a member no more');
      if (event.news.includes('status') || event.news.includes('refusal')) what.push(statusWords(node));
      if (event.news.includes('silent')) what.push(node.silent ? 'does not answer' : 'answers again');
      if (event.news.includes('failure') && node.failures.length) what.push(`stops: ${node.failures.at(-1).why}`);
      if (event.news.includes('moved')) what.push('stands elsewhere');
      return what.length ? `${node.role} ${node.id}: ${what.join(', ')}` : null;
    }
    case 'end': return event.cut_short ? `the end: ${event.cut_short}` : 'the end';
    default: return null;
  }
}

function isAbout(event, id) {
  return event.node === id || (event.event === 'node' && event.is.id === id);
}

// The last words before a moment, newest first.
function lastWords(record, events, seconds, most, isMeant) {
  const items = [];
  for (let i = events.length - 1; i >= 0 && items.length < most; i--) {
    const event = events[i];
    if (event.seconds > seconds || !isMeant(event)) continue;
    const words = eventWords(record, event);
    if (words) items.push({seconds: event.seconds, words});
  }
  return items;
}

function showWords(list, items) {
  const key = JSON.stringify(items);
  if (list.shown === key) return;
  list.shown = key;
  list.replaceChildren(...items.map(item => {
    const line = element('li');
    line.append(element('time', item.seconds.toFixed(1) + ' s'), ' ' + item.words);
    return line;
  }));
}

function canvasOf(id) {
  const canvas = byId(id);
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return {context, width, height};
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
}

// Everything that is known of one camera.
function showDetail(state, history, chosen) {
  const node = state.record?.nodes.find(other => other.id === chosen);
  document.querySelector('main').classList.toggle('detailed', Boolean(node));
  byId('detail').hidden = !node;
  if (!node) return;
  setText(byId('detail-name'), `Camera ${node.id}${node.reference ? ', reference' : ''}`);
  const advice = state.verdict?.findings.filter(finding => finding.node === chosen).map(finding => finding.words);
  setText(byId('detail-words'), adviceFor(node, advice?.join('; ')) || statusWords(node));
  const residuals = node.residuals.map(residual =>
    `stop ${stopCount(state.record, residual.target, residual.stop)}: ${digits(residual.residual_deg, 2)}\u00b0 (${digits(residual.normalised, 1)} sigma)`);
  const error = node.error && errorOf(state.record, node);
  const unit = state.record.unit.name;
  const facts = [
    ['pose', poseWords(state.record, node)],
    ['error', error ? `${digits(error.x, 3)}, ${digits(error.y, 3)} ${unit}, ${digits(error.heading_deg, 2)}\u00b0` : 'not known'],
    ['checked to', node.protection ? `${digits(node.protection.position, 2)} ${unit}, ${digits(node.protection.heading_deg, 1)}\u00b0` : '-'],
    ['sightings', `${node.used} of ${node.sightings} used`],
    ['residuals', residuals.join(', ') || '-'],
  ];
  const list = byId('detail-facts');
  const key = JSON.stringify(facts);
  if (list.shown !== key) {
    list.shown = key;
    list.replaceChildren(...facts.flatMap(([name, text]) => [element('dt', name), element('dd', text)]));
  }
  showSide(state.record, node);
  showBlob(state.blobs.get(chosen));
  showSigma(history.nodes, state.seconds, chosen);
  showWords(byId('node-log'), lastWords(state.record, history.telling, state.seconds, 40, event => isAbout(event, chosen)));
}

// The frame of the picture is that of the smaller sensor.
const PICTURE = [88, 143];

function showBlob(blob) {
  byId('picture').hidden = !blob;
  setText(byId('blob'), blob
    ? `middle ${blob.middle.join(', ')}; box ${blob.edges.join(', ')}; ${blob.pixels} pixels; confidence ${blob.confidence}`
    : 'It tells what it sees once it is told to track.');
  if (!blob) return;
  const {context, width, height} = canvasOf('picture');
  const [sx, sy] = [width / PICTURE[0], height / PICTURE[1]];
  const [left, upper, right, lower] = blob.edges;
  context.strokeStyle = colour('target');
  context.lineWidth = 2;
  context.strokeRect(left * sx, upper * sy, Math.max(2, (right - left) * sx), Math.max(2, (lower - upper) * sy));
  context.fillStyle = colour('ink');
  context.fillRect(blob.middle[0] * sx - 2, blob.middle[1] * sy - 2, 4, 4);
}

// The camera from the side: its height, its optical axis with two sigmas of its pitch, and the places where it saw the
// ball, at their distances from it.
function showSide(record, node) {
  const pose = node.estimate;
  byId('side').hidden = pose?.z === undefined;
  if (byId('side').hidden) return;
  const ball = record.networks.find(own => own.network === node.network)?.ball_height;
  const low = ball ?? 0;
  const stops = node.residuals.map(residual => record.targets.find(target => target.id === residual.target)
    ?.stops.find(stop => stop.stop === residual.stop)).filter(stop => stop);
  const places = stops.map(stop => Math.hypot(stop.x - pose.x, stop.y - pose.y));
  const far = 1.1 * Math.max(1, ...places);
  const floor = ball === undefined ? low : 0;
  const high = Math.max(pose.z, low) - floor || 1;
  const {context, width, height} = canvasOf('side');
  const scale = Math.min((width - 24) / far, (height - 30) / high);
  const at = (along, up) => [12 + along * scale, height - 10 - (up - floor) * scale];
  const line = (from, to) => {
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    context.stroke();
  };
  context.lineWidth = 1;
  context.strokeStyle = colour('faint');
  if (ball !== undefined) line(at(0, 0), at(far, 0));
  context.setLineDash([4, 4]);
  line(at(0, low), at(far, low));
  context.setLineDash([]);
  line(at(0, floor), at(0, pose.z));
  context.strokeStyle = colour(node.status ?? 'waiting');
  for (const off of [-2, 0, 2]) {
    const pitch = (pose.pitch_deg + off * pose.sigma_pitch_deg) * DEGREE;
    context.lineWidth = off ? 1 : 2;
    line(at(0, pose.z), at(far * Math.cos(pitch), pose.z - far * Math.sin(pitch)));
  }
  context.fillStyle = colour('target');
  for (const place of places) {
    context.beginPath();
    context.arc(...at(place, low), 3, 0, 2 * Math.PI);
    context.fill();
  }
  context.fillStyle = colour('faint');
  context.font = '11px system-ui, sans-serif';
  const unit = record.unit.name;
  context.fillText(`from the side: ${digits(pose.z, 2)} ${unit} above ${ball === undefined ? 'the ball' : 'the floor'}`, 20, 12);
}

function showSigma(events, seconds, id) {
  const points = [];
  for (const event of events) {
    if (event.seconds > seconds) break;
    const node = event.event === 'node' && event.is.id === id ? event.is
      : event.event === 'begin' ? event.record.nodes.find(other => other.id === id) : null;
    if (node?.estimate) points.push([event.seconds, Math.hypot(node.estimate.sigma_x, node.estimate.sigma_y)]);
  }
  const {context, width, height} = canvasOf('sigma');
  context.fillStyle = colour('faint');
  context.font = '11px system-ui, sans-serif';
  if (!points.length) { context.fillText('no pose yet', 4, 14); return; }
  const most = Math.max(...points.map(point => point[1])) || 1;
  const from = points[0][0], until = Math.max(seconds, from + 1);
  context.strokeStyle = colour('calibrated');
  context.lineWidth = 2;
  context.beginPath();
  let last = null;
  for (const [at, sigma] of points) {
    const x = (at - from) / (until - from) * width;
    const y = height - 4 - sigma / most * (height - 22);
    if (last === null) context.moveTo(x, y); else { context.lineTo(x, last); context.lineTo(x, y); }
    last = y;
  }
  context.lineTo(width, last);
  context.stroke();
  context.fillText(`sigma of its place, ${most.toFixed(3)} at most, ${points.at(-1)[1].toFixed(3)} last`, 4, 12);
}
