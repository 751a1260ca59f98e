// Places, frames, ellipses, and fields of view that walls clip.

const DEGREE = Math.PI / 180;

// True if it is known where every network is in the frame of the site's file.
function isPlaced(record) {
  return record.networks.length > 0 && record.networks.every(network => network.building);
}

// Where a network's frame is in the one that is drawn: the frame of the site's file, or that of the first network
// where the site's is not known.
function frameOf(record, network) {
  const own = record.networks.find(other => other.network === network);
  return isPlaced(record) ? own?.building : own?.frame;
}

// A place of a network's frame in the one that is drawn.
function inSite(record, network, x, y) {
  const own = frameOf(record, network);
  if (!own) return [x, y];
  const [c, s] = [Math.cos(own.heading_deg * DEGREE), Math.sin(own.heading_deg * DEGREE)];
  return [own.x + c * x - s * y, own.y + s * x + c * y];
}

function turned(record, network, headingDeg) {
  return headingDeg + (frameOf(record, network)?.heading_deg ?? 0);
}

// A covariance in a network's frame as it is in the one that is drawn.
function turnedCovariance(record, network, [xx, xy, yy]) {
  const turn = turned(record, network, 0) * DEGREE;
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return [c * c * xx - 2 * c * s * xy + s * s * yy, c * s * (xx - yy) + (c * c - s * s) * xy,
    s * s * xx + 2 * c * s * xy + c * c * yy];
}

// The pose of a camera in the frame that is drawn, with the sigmas along its axes; null without one.
function poseOf(record, node) {
  const pose = node.estimate;
  if (!pose) return null;
  const [x, y] = inSite(record, node.network, pose.x, pose.y);
  const [xx, xy, , yy] = pose.covariance;
  const [sxx, , syy] = turnedCovariance(record, node.network, [xx, xy, yy]);
  const heading_deg = ((turned(record, node.network, pose.heading_deg) % 360) + 360) % 360;
  return {...pose, x, y, heading_deg, sigma_x: Math.sqrt(sxx), sigma_y: Math.sqrt(syy)};
}

// The count of a stop, from 1. A real target begins with a number of its own.
function stopCount(record, target, stop) {
  const stops = record?.targets.find(other => other.id === target)?.stops ?? [];
  const index = stops.findIndex(other => other.stop === stop);
  return index < 0 ? stops.length + 1 : index + 1;
}

// The error of a camera's pose along the axes that are drawn.
function errorOf(record, node) {
  const turn = turned(record, node.network, 0) * DEGREE;
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  const {x, y} = node.error;
  return {...node.error, x: c * x - s * y, y: s * x + c * y};
}

// The frame of the drawing in words, where it is not the site's.
function frameWords(record) {
  if (isPlaced(record)) return '';
  return 'no site file tells where this is: x and y count from the first reference camera, x towards the second';
}

// Half axes and direction of the ellipse that holds a place with 95 %.
function ellipse(xx, xy, yy) {
  const mean = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  const scale = Math.sqrt(5.991);
  return {
    a: scale * Math.sqrt(Math.max(0, mean + spread)), b: scale * Math.sqrt(Math.max(0, mean - spread)),
    angle: Math.atan2(2 * xy, xx - yy) / 2,
  };
}

// The outline of a camera's field of view: rays to the nearest wall, or as far as the camera sees.
function fieldOfView(x, y, headingDeg, fovDeg, range, walls) {
  const near = walls.filter(([ax, ay, bx, by]) => distance(x, y, ax, ay, bx, by) <= range);
  const half = fovDeg * DEGREE / 2;
  const middle = headingDeg * DEGREE;
  const angles = [];
  const steps = 24;
  for (let i = 0; i <= steps; i++) angles.push(-half + 2 * half * i / steps);
  for (const [ax, ay, bx, by] of near) {
    for (const [cx, cy] of [[ax, ay], [bx, by]]) {
      const off = wrap(Math.atan2(cy - y, cx - x) - middle);
      if (Math.abs(off) < half) angles.push(off - 1e-4, off + 1e-4);
    }
  }
  angles.sort((a, b) => a - b);
  return angles.map(off => {
    const [dx, dy] = [Math.cos(middle + off), Math.sin(middle + off)];
    let far = range;
    for (const wall of near) far = Math.min(far, along(x, y, dx, dy, wall));
    return [x + far * dx, y + far * dy];
  });
}

function wrap(angle) {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

// The distance of a wall along a ray; infinite if the ray does not hit it.
function along(x, y, dx, dy, [ax, ay, bx, by]) {
  const [ex, ey] = [bx - ax, by - ay];
  const across = dx * ey - dy * ex;
  if (Math.abs(across) < 1e-12) return Infinity;
  const t = ((ax - x) * ey - (ay - y) * ex) / across;
  const u = ((ax - x) * dy - (ay - y) * dx) / across;
  return t > 1e-6 && u >= 0 && u <= 1 ? t : Infinity;
}

function distance(x, y, ax, ay, bx, by) {
  const [ex, ey] = [bx - ax, by - ay];
  const length = ex * ex + ey * ey;
  const u = length > 0 ? Math.max(0, Math.min(1, ((x - ax) * ex + (y - ay) * ey) / length)) : 0;
  return Math.hypot(ax + u * ex - x, ay + u * ey - y);
}

// The obstacles, which are told in the frame of the first network.
function obstaclesOf(record) {
  const first = record?.networks[0]?.network;
  return (record?.obstacles ?? []).map(outline => outline.map(([x, y]) => inSite(record, first, x, y)));
}

// The walls of all obstacles.
function wallsOf(obstacles) {
  return obstacles.flatMap(outline =>
    outline.map(([x, y], i) => [x, y, ...outline[(i + 1) % outline.length]]));
}
