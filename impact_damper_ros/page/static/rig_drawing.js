// SPDX-License-Identifier: Apache-2.0
// The rig in side view, tilted as it is: wall, spring, dashpot, M with its stops, m, force, ruler.
//
// Lengths along the axis are to scale. M has a size of its own in the picture, and m one by its
// mass: its area is as the mass ratio. It is as long as `slug` on either side of its position, and
// both stops are that much farther apart, so that contact is seen exactly where it is.

import { Canvas, colours, font, SteadyRange, stopColour } from './chart.js';
import { digits, lengthUnit, minus, niceAbove, ticks } from './format.js';
import { reducedMotion } from './dom.js';

const FLASH = 260;
/** Mass ratio at which m has its usual size, and the least and largest size beside that. */
const USUAL_RATIO = 0.05;
const [SMALLEST, LARGEST] = [0.3, 1.7];
const COILS = 9;
/** Stops so many times farther away than anything moves are not drawn to scale. */
const FAR = 100;

/** A place along the axis and across it, in pixels of a canvas turned by the angle of the rig. */
export class RigDrawing extends Canvas {
  constructor(canvas) {
    super(canvas);
    this.plan = this.held = this.outline = null;
    this.clear();
  }

  clear() {
    this.rescale();
    this.flashes = [];
    this.loudest = 1e-12;
    this.shown = null;
  }

  /** Choose the scale anew. */
  rescale() {
    this.swing = new SteadyRange();
    this.spread = new SteadyRange();
    this.shaken = new SteadyRange();
  }

  /** Let the stops light up at impacts after an instant, up to another one; the strength is the impulse over the largest seen lately. */
  flash(impacts, from, to, now) {
    for (let n = impacts.after(from); n < impacts.after(to); n += 1) {
      const { stop, impulse } = impacts.row(n);
      this.loudest = Math.max(0.995 * this.loudest, impulse);
      this.flashes.push({ stop, strength: Math.sqrt(impulse / this.loudest), since: now });
    }
    this.flashes.splice(0, this.flashes.length - 8);
  }

  /** Choose the scale: all that moved lately has room, in steps so that the picture is calm. */
  layout(extent, state, massRatio, now) {
    const rel1 = state.stop_1 - state.x;
    const rel2 = Number.isFinite(state.stop_2) ? state.x - state.stop_2 : rel1;
    // Stops that are far beyond all that moves stand at the edge.
    const moved = Math.max(extent.swing, extent.apart);
    const half = Math.min(Math.max(rel1, rel2, 1e-12), moved > 0 ? FAR * moved : Infinity);
    const swing = this.swing.fit(niceAbove(Math.max(extent.swing, Math.abs(state.x), 0.02 * half)), now);
    const spread = this.spread.fit(niceAbove(Math.max(half, extent.apart)), now);
    const angle = state.angle;
    const em = colours.size;
    const [cos, sin] = [Math.abs(Math.cos(angle)), Math.abs(Math.sin(angle))];
    // As long as the canvas allows in this direction; a shorter rig is a lower one, too.
    let [length, tall, up, down] = [0, 0, 0, 0];
    for (length = Math.hypot(this.width, this.height); length > 110; length *= 0.985) {
      // A long one may be lower than it would like to be, but not by much.
      const room = ((this.height - 0.3 * em - length * sin) / cos - 3.4 * em) / 1.16;
      tall = Math.min(Math.max(2.4 * em, Math.min(length / 5.5, 10 * em)), Math.max(2 * em, length / 9, room));
      [up, down] = [tall / 2 + 1.5 * em, 0.66 * tall + 1.9 * em];
      const [wide, high] = [length * cos + (up + down) * sin, length * sin + (up + down) * cos];
      if (wide <= this.width - 1.6 * em && high <= this.height) break;
    }
    const thick = Math.max(5, Math.min(0.16 * tall, 0.025 * length));
    const size = Math.min(LARGEST, Math.max(SMALLEST, Math.sqrt(massRatio / USUAL_RATIO) || 1));
    const slug = Math.max(3, size * Math.min(0.17 * tall, 0.028 * length));
    const rod = 0.5 * thick + 4;
    const wall = 0.7 * em;
    const spring = Math.max(30, Math.min(0.12 * length, 6 * em));
    const fixed = wall + spring + 2 * (thick + rod + slug) + 0.8 * em;
    const shaken = this.shaken.fit(extent.shaken > 0 ? niceAbove(extent.shaken) : 0, now);
    const way = extent.shaken > 0 ? shaken : 0;
    const scale = Math.max(1e-12, (length - fixed) / (2 * swing + 2 * spread + 2 * way));
    const cavity = scale * spread + slug + rod;
    const body = cavity + thick;
    const reach = scale * swing;
    // The middle of what is drawn is the middle of the canvas.
    const left = -(body + reach + spring + wall + 2 * scale * way);
    const right = body + reach + 0.8 * em;
    const geometry = { scale, slug, rod, thick, cavity, body, reach, tall, left, right, wall, angle, swing, spread, up, down, way: scale * way };
    const before = this.shown;
    // Another scale is gone to smoothly.
    if (before && !reducedMotion() && now - before.now < 200 && Math.abs(before.scale / scale - 1) > 1e-3) {
      geometry.scale = before.scale * (scale / before.scale) ** (1 - Math.exp(-(now - before.now) / 90));
    }
    this.shown = { scale: geometry.scale, now };
    return geometry;
  }

  /** Draw a state; `ghost` is a second one, outlined. */
  draw(state, { extent, ghost = null, push = NaN, oneSided = false, massRatio = USUAL_RATIO, now }) {
    if (!this.begin() || !state) return;
    const g = this.held ?? this.layout(extent, state, massRatio, now);
    this.plan = g;
    const { context } = this;
    const middle = (g.left + g.right) / 2;
    context.save();
    context.translate(this.width / 2, this.height / 2);
    context.rotate(g.angle);
    context.translate(-middle, (g.up - g.down) / 2);
    this.ground(g, state);
    this.attachments(g, state);
    for (const other of [ghost, this.outline]) if (other) this.carriage(g, other, { oneSided, ghostly: true });
    this.carriage(g, state, { oneSided, now });
    if (Number.isFinite(push)) this.force(g, state, push);
    context.restore();
    if (Math.abs(g.angle) > 0.003) this.inclination(g);
  }

  /** Where an event is along the axis and across it, from the middle of M at rest. */
  at({ clientX, clientY }) {
    const g = this.plan;
    if (!g) return null;
    const box = this.canvas.getBoundingClientRect();
    const [a, b] = [clientX - box.left - this.width / 2, clientY - box.top - this.height / 2];
    const [cos, sin] = [Math.cos(g.angle), Math.sin(g.angle)];
    return { u: a * cos + b * sin + (g.left + g.right) / 2, v: b * cos - a * sin - (g.up - g.down) / 2, plan: g };
  }

  /** Keep the scale while something is dragged. */
  hold(on) {
    this.held = on ? this.plan : null;
  }

  /** The incline with its ruler, which counts from the static equilibrium of M. */
  ground(g, state) {
    const { context } = this;
    const em = colours.size;
    const base = 0.66 * g.tall;
    this.base = base;
    const wall = this.wallAt(g, state);
    this.lines(colours.steel, 1.5, [[[g.left, base], [g.right, base]], [[wall, base], [wall, -g.tall / 2]]]);
    const step = Math.max(6, 0.55 * em);
    const hatches = Array.from({ length: Math.floor((base + 0.1 + g.tall / 2) / step) }, (_, n) => n * step - g.tall / 2);
    this.lines(colours.stop, 1, hatches.map((v) => [[wall, v], [wall - g.wall, v + step]]));
    const { factor, unit } = lengthUnit(g.swing + g.spread);
    const reach = Math.min(g.right, g.body + g.reach) / g.scale;
    const { values, decimals, step: apart } = ticks(-reach * factor, reach * factor, Math.min(8, (reach * g.scale) / (1.5 * em)));
    const marks = values.flatMap((value) => [0, 1, 2, 3, 4].map((n) => [((value + (n * apart) / 5) / factor) * g.scale, n ? 3 : 6]));
    this.lines(colours.steel, 1, marks.filter(([place]) => place <= g.right).map(([place, high]) => [[place, base], [place, base + high]]));
    context.font = font(0.75);
    for (const value of values) {
      const name = value === values.at(-1) ? `${minus(value.toFixed(decimals))} ${unit}` : minus(value.toFixed(decimals));
      // As far from the line as its letters need
      const [high, wide] = [Math.abs(Math.cos(g.angle)), Math.abs(Math.sin(g.angle))];
      const half = Math.max(0.55 * em * high, 0.5 * wide * context.measureText(name).width);
      this.upright(g, name, (value / factor) * g.scale, base + 6 + 0.17 * em + half, { size: 0.75 });
    }
  }

  arrowhead(colour, ...corners) {
    const { context } = this;
    context.beginPath();
    for (const corner of corners) context.lineTo(...corner);
    Object.assign(context, { fillStyle: colour }).fill();
  }

  /** Write a text that stays level whatever the inclination. */
  upright(g, text, u, v, look) {
    const { context } = this;
    context.save();
    context.translate(u, v);
    context.rotate(-g.angle);
    this.text(text, 0, 0, { align: 'center', level: 'middle', ...look });
    context.restore();
  }

  /** Where the wall is, which the base moves. */
  wallAt(g, { base = 0 }) {
    return g.left + g.wall + g.way + (base || 0) * g.scale;
  }

  /** Spring and dashpot between the wall and M. */
  attachments(g, state) {
    const from = this.wallAt(g, state);
    const to = state.x * g.scale - g.body;
    const span = Math.max(6, to - from);
    const [upper, lower] = [-0.22 * g.tall, 0.24 * g.tall];
    const radius = 0.12 * g.tall;
    const lead = Math.min(10, 0.15 * span);
    const pitch = (span - 2 * lead) / COILS;
    const coils = Array.from({ length: 2 * COILS }, (_, n) => [from + lead + (0.5 * n + 0.25) * pitch, upper + (n % 2 ? radius : -radius)]);
    this.lines(colours.ink, 1.6, [[[from, upper], [from + lead, upper], ...coils, [to - lead, upper], [to, upper]]]);
    // Dashpot: the cylinder is fixed to the wall, the piston to M.
    const cylinder = Math.max(10, 0.5 * (g.reach + 0.3 * (g.body - g.cavity) + 30));
    const start = from + lead;
    const bore = Math.min(cylinder, 0.72 * span);
    const piston = start + Math.max(4, Math.min(bore - 3, 0.5 * bore + 0.35 * ((state.x - (state.base || 0)) * g.scale)));
    this.lines(colours.ink, 1.4, [
      [[from, lower], [start, lower]],
      [[start + bore, lower - radius], [start, lower - radius], [start, lower + radius], [start + bore, lower + radius]],
      [[piston, lower - radius + 3], [piston, lower + radius - 3]],
      [[piston, lower], [to, lower]],
    ]);
  }

  /** M with its stops, m, wheels; or the outline of another rig. */
  carriage(g, state, { oneSided, now = 0, ghostly = false }) {
    const { context } = this;
    const em = colours.size;
    const [x, z] = [state.x * g.scale, state.z * g.scale];
    const top = -g.tall / 2;
    const floor = g.tall / 2 - g.thick;
    const round = Math.min(5, g.thick / 2);
    const inner = floor - top - g.thick;
    const slugTall = Math.min(0.8 * inner, 3.4 * g.slug);
    context.save();
    if (ghostly) {
      Object.assign(context, { globalAlpha: 0.75, lineWidth: 1.5, strokeStyle: colours.special });
      context.setLineDash([5, 4]);
      context.beginPath();
      context.roundRect(x - g.body, top, 2 * g.body, g.tall, round);
      context.roundRect(z - g.slug, floor - slugTall, 2 * g.slug, slugTall, 3);
      context.stroke();
      context.restore();
      return;
    }
    // wheels
    const wheel = (this.base - g.tall / 2) / 2;
    const [hub, turned] = [this.base - wheel, x / Math.max(1, wheel)];
    for (const side of [-0.62, 0.62]) {
      const axle = x + side * g.body;
      this.disc(axle, hub, wheel - 0.5, colours.panel, colours.steel);
      this.lines(colours.steel, 1.5, [[[axle, hub], [axle + 0.75 * wheel * Math.cos(turned), hub + 0.75 * wheel * Math.sin(turned)]]]);
    }
    // the frame of M, with the space for m cut out
    context.beginPath();
    context.roundRect(x - g.body, top, 2 * g.body, g.tall, round + 1);
    context.roundRect(x - g.cavity, top + g.thick, 2 * g.cavity, floor - top - g.thick, 2);
    context.fillStyle = colours.primary;
    context.fill('evenodd');
    // stops
    const pad = Math.max(3.5, 0.3 * g.thick);
    const tallPad = Math.min(Math.max(slugTall * 1.15, 0.4 * inner), inner - 2);
    const centre = floor - tallPad / 2.3;
    const faces = [
      [1, Math.min(state.stop_1 * g.scale + g.slug, x + g.cavity), 1],
      [2, Number.isFinite(state.stop_2) ? Math.max(state.stop_2 * g.scale - g.slug, x - g.cavity) : NaN, -1],
    ];
    for (const [stop, face, side] of faces) {
      if (stop === 2 && (oneSided || !Number.isFinite(face))) continue;
      const anchor = x + side * g.cavity;
      context.fillStyle = colours.steel;
      const rod = Math.max(3, 0.2 * tallPad);
      context.fillRect(Math.min(face, anchor), centre - rod / 2, Math.abs(anchor - face), rod);
      context.fillStyle = stopColour(stop);
      context.fillRect(side > 0 ? face : face - pad, floor - tallPad, pad, tallPad);
      for (const { since, strength } of this.flashes.filter((one) => one.stop === stop && now - one.since < FLASH)) {
        const part = reducedMotion() ? 0 : Math.max(0, now - since) / FLASH;
        const radius = tallPad * (0.5 + 0.55 * strength) * (0.6 + 0.6 * part);
        context.globalAlpha = 0.35 * (1 - part) * (0.35 + 0.65 * strength);
        for (const size of [1, 0.8, 0.6, 0.4]) this.disc(face, centre, size * radius, colours.open);
        context.globalAlpha = 1;
      }
    }
    this.flashes = this.flashes.filter((one) => now - one.since < FLASH);
    // m
    context.fillStyle = colours.damper;
    context.beginPath();
    context.roundRect(z - g.slug, floor - slugTall, 2 * g.slug, slugTall, Math.min(4, g.slug / 3));
    context.fill();
    // Its name is on it, or above it where there is no room.
    const roomy = g.slug > 0.55 * em;
    const look = { colour: roomy ? '#000000' : colours.ink, size: roomy ? Math.min(1.1, (1.35 * g.slug) / em) : 0.9, style: 'italic 600' };
    this.upright(g, 'm', z, roomy ? floor - slugTall / 2 : floor - slugTall - 0.6 * em, look);
    // names: M above its frame, the stops above their pads
    this.upright(g, 'M', x - g.body + 0.7 * em, top - 0.75 * em, { colour: colours.primary, size: 1, style: 'italic 600' });
    if (tallPad < inner - 1.2 * em) {
      for (const [stop, face, side] of faces) {
        if (!Number.isFinite(face) || (stop === 2 && oneSided)) continue;
        this.upright(g, String(stop), face + (side * pad) / 2, floor - tallPad - 0.62 * em, { size: 0.72 });
      }
    }
    // where M is, on the ruler
    this.arrowhead(colours.primary, [x, this.base + 1], [x - 5, this.base + 10], [x + 5, this.base + 10]);
    context.restore();
  }

  /** The force on M as an arrow, whose length is a share of its amplitude. */
  force(g, state, value) {
    const em = colours.size;
    const at = state.x * g.scale;
    const height = -g.tall / 2 - 0.75 * em;
    const length = value * Math.min(4.2 * em, 0.7 * g.body);
    const head = Math.min(8, Math.abs(length));
    const tip = at + length;
    const side = Math.sign(length);
    this.lines(colours.force, 2.5, [[[at, height], [tip - side * head, height]]]);
    this.arrowhead(colours.force, [tip, height], [tip - side * head, height - 0.6 * head], [tip - side * head, height + 0.6 * head]);
    this.disc(at, height, 2.5, colours.force);
    this.upright(g, 'F', at - (side || 1) * 0.75 * em, height, { colour: colours.force, size: 0.85, style: 'italic 600' });
  }

  /** The angle against the horizontal, in degrees. */
  inclination(g) {
    const { context } = this;
    const em = colours.size;
    const degrees = (g.angle * 180) / Math.PI;
    const radius = Math.min(3.2 * em, 0.16 * this.width);
    const side = g.angle > 0 ? 1 : -1;
    // Where a steep rig has no ruler
    const free = g.angle > 0.8 ? this.width - 6.6 * em : 0;
    const [left, low] = [free + 1.2 * em, this.height - 1.1 * em - (side > 0 ? radius * Math.sin(Math.min(1.2, Math.abs(g.angle))) : 0)];
    this.lines(colours.quiet, 1, [[[left + radius + 6, low], [left, low], [left + (radius + 6) * Math.cos(g.angle), low + (radius + 6) * Math.sin(g.angle)]]]);
    context.beginPath();
    context.arc(left, low, radius, 0, g.angle, side < 0);
    context.stroke();
    // Beside the arc, or above it where there is no room
    const narrow = this.width < 26 * em || free > 0;
    const [beside, height] = narrow ? [left, low - side * 0.9 * em] : [left + radius + 10, low + (side * radius * Math.sin(Math.abs(g.angle))) / 2];
    this.text(`θ = ${digits(degrees, 3)}°`, beside, height, { size: 0.85, level: 'middle' });
  }
}
