// Puts the parts together: events in, one moment shown, commands out.

const eventHistory = new History();
let chosen = null;
let stale = true;
let link = {words: 'connecting', isLost: false};
const changed = () => { stale = true; };
const choose = id => { chosen = chosen === id ? null : id; plan.chosen = chosen; changed(); };
const plan = new Plan(byId('map'), byId('hover'), byId('scale'), choose);
const checklist = new Checklist(byId('checklist'), choose);
const timeline = new Timeline(eventHistory, changed);
const source = new Source(events => {
  for (const event of events) eventHistory.push(event);
  if (timeline.follows) changed(); else timeline.show();
}, (words, isLost) => {
  link = {words, isLost};
  byId('link').classList.toggle('lost', isLost);
  changed();
});

function showAll() {
  const state = timeline.follows ? eventHistory.latest : eventHistory.at(timeline.seconds);
  // The latest state goes on: the shown part of it is of this moment.
  plan.show({...state, rays: state.rays, record: state.record && {...state.record}});
  const isOver = !link.isLost && eventHistory.latest.ended !== null && kind !== 'recorded';
  const isSilent = !link.isLost && isLineSilent(eventHistory.latest.record);
  setText(byId('link'), isOver ? 'the walk has ended' : isSilent ? 'nothing comes on the line' : link.words);
  byId('link').classList.toggle('lost', link.isLost || isSilent);
  showBanner(state);
  checklist.show(state, chosen);
  showObjects(byId('objects'), state);
  showDetail(state, eventHistory, chosen);
  showWords(byId('log'), lastWords(state.record, eventHistory.telling, timeline.moment, 60, () => true));
  timeline.show();
  if (state.record) setText(byId('name'), state.record.scenario + (state.record.seed === null ? '' : `, seed ${state.record.seed}`));
  document.body.dataset.seconds = timeline.moment.toFixed(3);
  document.body.dataset.ended = String(state.ended !== null);
}

let before = performance.now();
function frame(now) {
  const elapsed = Math.min(0.5, (now - before) / 1000);
  before = now;
  if (timeline.tick(elapsed)) stale = true;
  if (stale) {
    stale = false;
    showAll();
  }
  plan.draw();
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);

function button(words, act, title) {
  const made = element('button', words, {type: 'button'});
  if (title) made.title = title;
  made.addEventListener('click', act);
  return made;
}

function number(name, value) {
  const label = element('label', name + ' ');
  const input = element('input', undefined, {type: 'number', step: 'any', value});
  label.append(input);
  return [label, () => Number(input.value)];
}

// The answer is told below the controls; the result of the command comes as an event.
async function send(command) {
  setText(byId('sent'), `${command.do.replaceAll('_', ' ')}: ${await source.send(command)}`);
}

function group(name, ...parts) {
  const made = element('fieldset');
  made.append(element('legend', name), ...parts);
  return made;
}

const ORDERS = [
  ['initialise', 'resets the camera, and lets it adapt to the light'],
  ['learn-colour', 'takes the object in the middle of its view as the colour to look for'],
  ['track', 'tells what it sees until it is told to stop'],
  ['stop-tracking', 'tells no more what it sees'],
  ['forget', 'drops its pose and its sightings'],
];

function makeControls(kind) {
  const controls = byId('controls');
  controls.hidden = false;
  controls.append(element('h2', 'Controls'));
  if (kind === 'simulation') {
    const [jam, seconds] = number('for', 10);
    controls.append(
      group('Disturb', jam, element('span', 's'),
        button('jam the radio', () => send({do: 'jam', seconds: seconds()})),
        button('let the carrier drift', () => {
          for (const target of eventHistory.latest.record?.targets ?? []) {
            send({do: 'drift', node: target.id, seconds: seconds(), share: 0.1});
          }
        })));
  }
  const [window, open] = number('for', 60);
  controls.append(
    group('All cameras', ...ORDERS.slice(0, 4).map(([name, title]) =>
      button(name, () => send({do: 'camera', node: null, command: name}), title))),
    group('Join window', window, element('span', 's'),
      button('open', () => { send({do: 'join_window', seconds: open()}); countDown(open()); }),
      button('close', () => { send({do: 'join_window', seconds: 0}); countDown(0); }),
      element('output', '', {id: 'window'})));
  controls.append(element('output', '', {id: 'sent'}));
  const own = byId('node-controls');
  const [move, by] = number('by, in units of the site', 0.3);
  const [turn, degrees] = number('turn by, deg', 10);
  own.append(...ORDERS.map(([name, title]) =>
    button(name, () => send({do: 'camera', node: chosen, command: name}), title)));
  own.append(button('remove', () => {
    if (confirm(`Send camera ${chosen} away?`)) send({do: 'remove', node: chosen});
  }, 'sends it away from the network'));
  if (kind === 'simulation') {
    own.append(
      button('restart', () => send({do: 'restart', node: chosen})),
      button('unplug for 20 s', () => send({do: 'unplug', node: chosen, seconds: 20})),
      move, turn,
      button('move', () => send({do: 'move', node: chosen, by: [by(), 0], turn_deg: degrees()})));
  }
}

// Shows a speed among those to choose from.
function setRate(times) {
  const rate = byId('rate');
  if (![...rate.options].some(option => Number(option.value) === times)) {
    rate.prepend(element('option', `${times}x`, {value: times}));
  }
  rate.value = String(times);
}

let closing = null;
function countDown(seconds) {
  clearInterval(closing);
  const until = performance.now() + seconds * 1000;
  const show = () => {
    const left = Math.ceil((until - performance.now()) / 1000);
    setText(byId('window'), left > 0 ? `${left} s left, if the network took it` : '');
    if (left <= 0) clearInterval(closing);
  };
  closing = setInterval(show, 500);
  show();
}

byId('zoom-in').addEventListener('click', () => plan.zoom(1.25));
byId('zoom-out').addEventListener('click', () => plan.zoom(0.8));
byId('zoom-fit').addEventListener('click', () => plan.all());
byId('detail-close').addEventListener('click', () => choose(chosen));

document.addEventListener('keydown', event => {
  if (event.target.closest?.('input, select, button, #map')) return;
  if (event.key === ' ') timeline.toggle();
  else if (event.key === 'l') timeline.follow();
  else if (event.key === 'ArrowLeft') timeline.go(timeline.moment - 5);
  else if (event.key === 'ArrowRight') timeline.go(timeline.moment + 5);
  else if (event.key === 'Escape' && chosen !== null) choose(chosen);
  else return;
  event.preventDefault();
});

let kind = source.isFile ? 'recorded' : null;
if (source.isFile) setText(byId('now'), 'end');
if (!source.isFile) {
  source.about().then(about => {
    if (!about) return;
    kind = about.kind;
    setText(byId('name'), about.name);
    document.title = about.name;
    if (kind !== 'recorded') makeControls(kind);
    if (kind === 'simulation') {
      timeline.simulation = {send, isPaused: false};
      setRate(about.speed);
    }
    source.listen();
  }).catch(() => {
    link = {words: 'the server does not answer', isLost: true};
    byId('link').classList.add('lost');
    changed();
  });
}

// For tests of the page: the state that is shown at this moment.
window.shown = () => {
  const {record, verdict, seconds} = timeline.follows ? eventHistory.latest : eventHistory.at(timeline.seconds);
  return {record, verdict, seconds};
};
