// Texts about a site that is edited: judgement, table, advice.

function panels() {
  const {design, refused, advice} = judged;
  byId('verdict').textContent = refused ?? design?.verdict ?? '';
  byId('banner').classList.toggle('good', Boolean(design?.good));
  const body = document.querySelector('#cameras tbody');
  body.replaceChildren(...cameras().map(({network, camera}) => {
    const row = document.createElement('tr');
    row.dataset.camera = camera.id;
    row.classList.toggle('selected', camera === selectedCamera());
    const what = expected(network, camera.id);
    const number = (value, digits) => (value === null || value === undefined ? '-' : value.toFixed(digits));
    cell(row, camera.id + (what?.reference ? ' ref.' : ''), true);
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
    for (const [id, key] of FIELDS) {
      if (document.activeElement !== byId(id)) byId(id).value = camera[key] ?? '';
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
      const of = layout.networks.length > 1 ? ` of network ${one.network + 1}` : '';
      item.append(`a camera${of} at (${one.x.toFixed(2)}, ${one.y.toFixed(2)}) that looks along `
        + `${one.heading_deg.toFixed(0)}°: ${one.gain_bits.toFixed(2)} bits per place `);
      const put = document.createElement('button');
      put.type = 'button';
      put.textContent = 'put it there';
      put.addEventListener('click', () => addCamera(one.x, one.y, one.heading_deg, one.network));
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
