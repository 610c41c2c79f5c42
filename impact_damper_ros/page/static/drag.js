// SPDX-License-Identifier: Apache-2.0
// Drag in the picture of the rig: a stop sets the gap; M or m is let go where it is left.

/** How far from a stop it is still hit, px. */
const NEAR = 12;

export class Drag {
  /** `state` returns the rig as it is shown; `act` has hold(name), gap(value) and release({ x, y }). */
  constructor(drawing, state, act) {
    this.drawing = drawing;
    this.state = state;
    this.act = act;
    this.what = '';
    this.on = true;
    const { canvas } = drawing;
    canvas.addEventListener('pointerdown', (event) => this.begin(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    canvas.addEventListener('pointerup', () => this.end(true));
    canvas.addEventListener('pointercancel', () => this.end(false));
    canvas.addEventListener('keydown', (event) => { if (event.key === 'Escape') this.end(false); });
  }

  /** What is under the pointer: stop 1 or 2, m, M, or nothing. */
  under(event) {
    const state = this.state();
    const at = this.drawing.at(event);
    if (!state || !at || !this.on) return '';
    const { x, z, stop_1, stop_2 } = state;
    const { slug, body, tall, scale } = at.plan;
    if (Math.abs(at.v) > tall / 2) return '';
    for (const [name, face] of [['stop_1', stop_1 * scale + slug], ['stop_2', stop_2 * scale - slug]]) {
      if (Math.abs(at.u - face) < NEAR && Math.abs(at.u - z * scale) > slug) return name;
    }
    if (Math.abs(at.u - z * scale) < slug + 2) return 'm';
    return Math.abs(at.u - x * scale) < body ? 'M' : '';
  }

  begin(event) {
    this.what = event.button === 0 ? this.under(event) : '';
    if (!this.what) return;
    event.preventDefault();
    const { canvas } = this.drawing;
    canvas.setPointerCapture(event.pointerId);
    this.drawing.hold(true);
    this.act.hold(this.what.startsWith('stop') ? 'gap' : '');
    this.grip = this.drawing.at(event).u / this.drawing.plan.scale;
    this.from = this.state();
    canvas.style.cursor = 'grabbing';
  }

  move(event) {
    if (!this.what) {
      this.drawing.canvas.style.cursor = this.under(event) ? 'grab' : '';
      return;
    }
    const { scale, slug } = this.drawing.plan;
    const u = this.drawing.at(event).u / scale;
    const now = this.state();
    if (this.what === 'stop_1' || this.what === 'stop_2') {
      const half = Math.abs(u - now.x) - slug / scale;
      // Half of the way in and out again: the middle of the gap stays where it is.
      if (half > 0) this.act.gap(Number((2 * half).toPrecision(3)));
      return;
    }
    const far = u - this.grip;
    const { x, z, stop_1, stop_2 } = this.from;
    const half = stop_1 - x;
    const within = (y) => Math.min(half, Math.max(Number.isFinite(stop_2) ? -half : -Infinity, y));
    this.left = this.what === 'M' ? { x: x + far, y: z - x } : { x: now.x, y: within(z + far - now.x) };
    const { x: place, y } = this.left;
    this.drawing.outline = { ...now, x: place, z: place + y, stop_1: place + half, stop_2: place - half };
    this.drawing.stale = true;
  }

  end(done) {
    if (!this.what) return;
    this.what = '';
    this.drawing.hold(false);
    this.act.hold('');
    this.drawing.outline = null;
    this.drawing.canvas.style.cursor = '';
    if (done && this.left) this.act.release(this.left);
    this.left = null;
  }
}
