// SPDX-License-Identifier: Apache-2.0
// A context of a canvas that writes SVG: as much of it as the pictures of this page use.

const escaped = (text) => String(text).replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
const short = (value) => String(Number(value.toFixed(2)));
const STATE = ['fillStyle', 'strokeStyle', 'lineWidth', 'lineCap', 'lineJoin', 'globalAlpha', 'font', 'textAlign', 'textBaseline', 'dash', 'clips'];
const ANCHORS = { left: 'start', center: 'middle', right: 'end' };
const BASELINES = { top: 'text-before-edge', middle: 'central', bottom: 'text-after-edge', alphabetic: 'alphabetic' };

export class SvgContext {
  /** `ruler` is a context of a canvas, which measures texts. */
  constructor(width, height, ruler) {
    this.width = width;
    this.height = height;
    this.ruler = ruler;
    this.fillStyle = this.strokeStyle = '#000';
    this.lineWidth = this.globalAlpha = 1;
    this.lineCap = 'butt';
    this.lineJoin = 'miter';
    this.font = '12px sans-serif';
    this.textAlign = 'left';
    this.textBaseline = 'alphabetic';
    this.dash = /** @type {number[]} */ ([]);
    this.path = '';
    this.clips = 0;
    this.count = 0;
    this.parts = /** @type {string[]} */ ([]);
    this.saved = /** @type {object[]} */ ([]);
  }

  save() { this.saved.push(Object.fromEntries(STATE.map((name) => [name, this[name]]))); }

  restore() {
    const { clips } = this;
    Object.assign(this, this.saved.pop());
    this.parts.push('</g>'.repeat(clips - this.clips));
  }

  setTransform() {}

  clearRect() {}

  setLineDash(dash) { this.dash = dash; }

  measureText(text) {
    this.ruler.font = this.font;
    return this.ruler.measureText(text);
  }

  beginPath() { this.path = ''; }

  moveTo(x, y) { this.path += `M${short(x)} ${short(y)}`; }

  lineTo(x, y) { this.path += `${this.path ? 'L' : 'M'}${short(x)} ${short(y)}`; }

  rect(x, y, width, height) { this.path += `M${short(x)} ${short(y)}h${short(width)}v${short(height)}h${short(-width)}z`; }

  arc(x, y, radius) { this.path += `M${short(x - radius)} ${short(y)}a${short(radius)} ${short(radius)} 0 1 0 ${short(2 * radius)} 0a${short(radius)} ${short(radius)} 0 1 0 ${short(-2 * radius)} 0z`; }

  clip() {
    this.count += 1;
    this.clips += 1;
    this.parts.push(`<clipPath id="c${this.count}"><path d="${this.path}"/></clipPath><g clip-path="url(#c${this.count})">`);
  }

  fill() { this.parts.push(`<path d="${this.path}" fill="${this.fillStyle}" opacity="${short(this.globalAlpha)}"/>`); }

  stroke() {
    const dash = this.dash.length ? ` stroke-dasharray="${this.dash.join(' ')}"` : '';
    this.parts.push(`<path d="${this.path}" fill="none" stroke="${this.strokeStyle}" stroke-width="${short(this.lineWidth)}" stroke-linejoin="${this.lineJoin}" opacity="${short(this.globalAlpha)}"${dash}/>`);
  }

  fillRect(...box) {
    this.beginPath();
    this.rect(...box);
    this.fill();
  }

  strokeRect(...box) {
    this.beginPath();
    this.rect(...box);
    this.stroke();
  }

  fillText(text, x, y) { this.write(text, x, y, `fill="${this.fillStyle}"`); }

  strokeText(text, x, y) { this.write(text, x, y, `fill="none" stroke="${this.strokeStyle}" stroke-width="${short(this.lineWidth)}" stroke-linejoin="round"`); }

  write(text, x, y, paint) {
    const [, style, weight, size, family] = /^(italic)?\s*(\d+)?\s*([\d.]+)px (.*)$/.exec(this.font.trim());
    const font = `font-family="${escaped(family)}" font-size="${size}"${style ? ' font-style="italic"' : ''}${weight ? ` font-weight="${weight}"` : ''}`;
    this.parts.push(`<text x="${short(x)}" y="${short(y)}" ${font} text-anchor="${ANCHORS[this.textAlign]}" dominant-baseline="${BASELINES[this.textBaseline]}" opacity="${short(this.globalAlpha)}" ${paint}>${escaped(text)}</text>`);
  }

  /** The picture as a file. */
  text() {
    const { width, height, parts } = this;
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">${parts.join('')}</svg>`;
  }
}
