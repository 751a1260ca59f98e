// Places, frames, ellipses, and fields of view that walls clip.

const DEGREE = Math.PI / 180;

// A place of a network's frame in that of the first network.
function inFirst(record, network, x, y) {
  const own = record.networks.find(other => other.network === network)?.frame;
  if (!own) return [x, y];
  const [c, s] = [Math.cos(own.heading_deg * DEGREE), Math.sin(own.heading_deg * DEGREE)];
  return [own.x + c * x - s * y, own.y + s * x + c * y];
}

function turned(record, network, headingDeg) {
  return headingDeg + (record.networks.find(other => other.network === network)?.frame.heading_deg ?? 0);
}

// A covariance in a network's frame as it is in that of the first network.
function turnedCovariance(record, network, [xx, xy, yy]) {
  const turn = turned(record, network, 0) * DEGREE;
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return [c * c * xx - 2 * c * s * xy + s * s * yy, c * s * (xx - yy) + (c * c - s * s) * xy,
    s * s * xx + 2 * c * s * xy + c * c * yy];
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

// The walls of all obstacles.
function wallsOf(obstacles) {
  return obstacles.flatMap(outline =>
    outline.map(([x, y], i) => [x, y, ...outline[(i + 1) % outline.length]]));
}
