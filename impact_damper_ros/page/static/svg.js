// SPDX-License-Identifier: Apache-2.0
// A context of a canvas that writes SVG: as much of it as the pictures of this page use.

const escaped = (text) => String(text).replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
const short = (value) => String(Number(value.toFixed(2)));
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
    this.groups = 0;
    this.count = 0;
    this.parts = /** @type {string[]} */ ([]);
    this.saved = /** @type {object[]} */ ([]);
  }

  save() { this.saved.push({ ...this }); }

  restore() {
    const { groups, count, path } = this;
    Object.assign(this, this.saved.pop(), { count, path });
    this.parts.push('</g>'.repeat(groups - this.groups));
  }

  open(attribute) {
    this.groups += 1;
    this.parts.push(`<g ${attribute}>`);
  }

  translate(x, y) { this.open(`transform="translate(${short(x)} ${short(y)})"`); }

  rotate(angle) { this.open(`transform="rotate(${short((180 / Math.PI) * angle)})"`); }

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

  roundRect(x, y, width, height, radius) {
    const [r, across, down] = [radius, width - 2 * radius, height - 2 * radius].map(short);
    const corner = (right, low) => `a${r} ${r} 0 0 1 ${right}${r} ${low}${r}`;
    this.path += `M${short(x + radius)} ${short(y)}h${across}${corner('', '')}v${down}${corner('-', '')}h-${across}${corner('-', '-')}v-${down}${corner('', '-')}z`;
  }

  arc(x, y, radius, from, to, backwards = false) {
    if (to - from < 2 * Math.PI) {
      const [[a, b], [c, d]] = [from, to].map((angle) => [short(x + radius * Math.cos(angle)), short(y + radius * Math.sin(angle))]);
      this.path += `M${a} ${b}A${short(radius)} ${short(radius)} 0 0 ${backwards ? 0 : 1} ${c} ${d}`;
    } else this.circle(x, y, radius);
  }

  circle(x, y, radius) { this.path += `M${short(x - radius)} ${short(y)}a${short(radius)} ${short(radius)} 0 1 0 ${short(2 * radius)} 0a${short(radius)} ${short(radius)} 0 1 0 ${short(-2 * radius)} 0z`; }

  clip() {
    this.count += 1;
    this.parts.push(`<clipPath id="c${this.count}"><path d="${this.path}"/></clipPath>`);
    this.open(`clip-path="url(#c${this.count})"`);
  }

  fill(rule = 'nonzero') { this.parts.push(`<path d="${this.path}" fill="${this.fillStyle}" fill-rule="${rule}" opacity="${short(this.globalAlpha)}"/>`); }

  stroke() {
    const dash = this.dash.length ? ` stroke-dasharray="${this.dash.join(' ')}"` : '';
    this.parts.push(`<path d="${this.path}" fill="none" stroke="${this.strokeStyle}" stroke-width="${short(this.lineWidth)}" stroke-linejoin="${this.lineJoin}" opacity="${short(this.globalAlpha)}"${dash}/>`);
  }

  box(x, y, width, height) {
    this.beginPath();
    this.rect(x, y, width, height);
    return this;
  }

  fillRect(x, y, width, height) { this.box(x, y, width, height).fill(); }

  strokeRect(x, y, width, height) { this.box(x, y, width, height).stroke(); }

  fillText(text, x, y) { this.write(text, x, y, `fill="${this.fillStyle}"`); }

  strokeText(text, x, y) { this.write(text, x, y, `fill="none" stroke="${this.strokeStyle}" stroke-width="${short(this.lineWidth)}" stroke-linejoin="round"`); }

  write(text, x, y, paint) {
    const [, style, weight, size, family] = /^(italic)?\s*(?:(\d+)\s+)?([\d.]+)px (.*)$/.exec(this.font.trim());
    const font = `font-family="${escaped(family)}" font-size="${size}"${style ? ' font-style="italic"' : ''}${weight ? ` font-weight="${weight}"` : ''}`;
    this.parts.push(`<text x="${short(x)}" y="${short(y)}" ${font} text-anchor="${ANCHORS[this.textAlign]}" dominant-baseline="${BASELINES[this.textBaseline]}" opacity="${short(this.globalAlpha)}" ${paint}>${escaped(text)}</text>`);
  }

  /** The picture as a file. */
  text() {
    const { width, height, parts } = this;
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">${parts.join('')}</svg>`;
  }
}
