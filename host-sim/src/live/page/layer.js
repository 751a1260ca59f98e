// The part of the plan that changes only with cameras, walls and the view is drawn once for many frames. Many
// cameras are drawn a portion in each frame: until all are drawn, the former picture is shown where the view is.

class Layer {
  // Number of cameras, or of fields of view, that are drawn in a frame: a slow computer has time for so many.
  static portion = 100;

  constructor() {
    this.shown = null;
    this.next = null;
    this.canvases = [document.createElement('canvas'), document.createElement('canvas')];
  }

  // Draws on towards the wanted picture; returns true if it is shown. `size` is the canvas's, in its own pixels.
  update(wanted, size) {
    if (this.shown && isSame(this.shown.wanted, wanted)) {
      this.next = null;
      return true;
    }
    const fits = picture => picture?.size[0] === size[0] && picture.size[1] === size[1];
    if (!fits(this.next)) this.next = this.begin(wanted, size);
    // If there is nothing to show meanwhile, all at once.
    const portion = fits(this.shown) ? Layer.portion : Infinity;
    for (let i = 0; i < portion; i++) {
      if (this.next.work.next().done) {
        this.shown = this.next;
        this.next = null;
        return isSame(this.shown.wanted, wanted);
      }
    }
    return false;
  }

  begin(wanted, size) {
    const canvas = this.canvases.find(other => other !== this.shown?.canvas);
    [canvas.width, canvas.height] = size;
    const context = canvas.getContext('2d');
    const ratio = size[0] / wanted.view.width;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    return {wanted, size, canvas, work: steps(context, wanted)};
  }

  // Shows the picture where the view is now.
  draw(brush) {
    const {canvas, wanted: {view}} = this.shown;
    const by = brush.view.times / view.times;
    const [x, y] = brush.toScreen(view.x, view.y);
    const [width, height] = [view.width * by, view.height * by];
    brush.context.drawImage(canvas, x - width / 2, y - height / 2, width, height);
  }
}

function* steps(context, {view, record, colours, shapes, cameras, chosen, times, labels}) {
  const brush = new Brush(context, view, record, colours, shapes);
  for (const node of cameras) {
    brush.fieldOfView(node, node.id === chosen);
    yield;
  }
  brush.walls();
  for (const node of cameras) {
    brush.camera(node, times, labels.numbers.get(node.id), node.id === chosen);
    yield;
  }
}

function isSame(a, b) {
  const same = (one, other) => one.length === other.length && one.every((item, i) => item === other[i]);
  return ['x', 'y', 'times'].every(key => a.view[key] === b.view[key])
    && ['chosen', 'times', 'colours', 'shapes', 'labels'].every(key => a[key] === b[key])
    && same(a.record.networks, b.record.networks) && same(a.cameras, b.cameras);
}
