// SPDX-License-Identifier: Apache-2.0
// What translated Python stands on: its operators and built-in functions, as far as they are used,
// arrays of numpy with two dimensions at most, and its extended floats.

// Extended floats

/** A number with 64 binary digits, as the extended ones of x86-64: digits times 2^exponent. */
class Extended {
  constructor(digits, exponent = 0) {
    const excess = Extended.length(digits) - 64;
    [this.digits, this.exponent] = excess > 0 ? [Extended.rounded(digits, excess), exponent + excess] : [digits, exponent];
  }

  static size(digits) { return digits < 0n ? -digits : digits; }

  static length(digits) { return digits === 0n ? 0 : Extended.size(digits).toString(2).length; }

  /** Digits without the last ones, rounded to even. */
  static rounded(digits, excess) {
    const half = 1n << BigInt(excess - 1);
    const size = Extended.size(digits);
    let whole = size >> BigInt(excess);
    const rest = size & (2n * half - 1n);
    if (rest > half || (rest === half && whole & 1n)) whole += 1n;
    return digits < 0n ? -whole : whole;
  }

  static of(value) {
    if (value instanceof Extended) return value;
    if (value === 0) return new Extended(0n);
    const view = new DataView(new ArrayBuffer(8));
    view.setFloat64(0, value);
    const bits = view.getBigUint64(0);
    const power = Number((bits >> 52n) & 0x7ffn);
    const digits = (bits & 0xfffffffffffffn) | (power ? 0x10000000000000n : 0n);
    return new Extended(value < 0 ? -digits : digits, Math.max(power, 1) - 1075);
  }

  plus(other) {
    const low = Math.min(this.exponent, other.exponent);
    return new Extended((this.digits << BigInt(this.exponent - low)) + (other.digits << BigInt(other.exponent - low)), low);
  }

  negative() { return new Extended(-this.digits, this.exponent); }

  minus(other) { return this.plus(other.negative()); }

  times(other) { return new Extended(this.digits * other.digits, this.exponent + other.exponent); }

  over(other) {
    const shift = 136 + Math.max(0, Extended.length(other.digits) - Extended.length(this.digits));
    const top = Extended.size(this.digits) << BigInt(shift);
    const bottom = Extended.size(other.digits);
    const whole = 2n * (top / bottom) + (top % bottom ? 1n : 0n);
    return new Extended((this.digits < 0n) !== (other.digits < 0n) ? -whole : whole, this.exponent - other.exponent - shift - 1);
  }

  root() {
    let [digits, exponent] = [this.digits << 160n, this.exponent - 160];
    if (exponent % 2) [digits, exponent] = [digits << 1n, exponent - 1];
    let whole = 1n << BigInt((Extended.length(digits) + 1) >> 1);
    for (let next = (whole + digits / whole) >> 1n; next < whole; next = (whole + digits / whole) >> 1n) whole = next;
    return new Extended(2n * whole + (whole * whole === digits ? 0n : 1n), exponent / 2 - 1);
  }

  /** As a float; with few digits it may be a subnormal one. */
  get number() {
    const excess = Extended.length(this.digits) - 53;
    const [digits, exponent] = excess > 0 ? [Extended.rounded(this.digits, excess), this.exponent + excess] : [this.digits, this.exponent];
    // In two steps, as 2^-1100 is no float
    const half = Math.trunc(exponent / 2);
    return Number(digits) * 2 ** half * 2 ** (exponent - half);
  }
}

// Arrays

/** An array of numpy: its shape, and its entries row by row. */
class Matrix {
  constructor(shape, entries) {
    this.shape = shape;
    this.entries = entries;
  }

  static of(rows) {
    if (rows instanceof Matrix) return rows;
    if (!Array.isArray(rows)) return new Matrix([], [rows]);
    const parts = rows.map(Matrix.of);
    return new Matrix([rows.length, ...(parts[0]?.shape ?? [])], parts.flatMap((part) => part.entries));
  }

  /** The result of a function on the entries of arrays, each repeated along what it lacks. */
  static each(action, ...given) {
    if (!given.some((one) => one instanceof Matrix)) return action(...given);
    const parts = given.map(Matrix.of);
    const depth = Math.max(...parts.map(({ shape }) => shape.length));
    const shapes = parts.map(({ shape }) => [...new Array(depth - shape.length).fill(1), ...shape]);
    const shape = shapes[0].map((_, axis) => shapes.map((one) => one[axis]).find((size) => size !== 1) ?? 1);
    if (shapes.some((one) => one.some((size, axis) => size !== 1 && size !== shape[axis]))) throw new ValueError('arrays of other shapes');
    const count = shape.reduce((product, size) => product * size, 1);
    const [first, second] = parts;
    if (parts.length === 1) return new Matrix(shape, first.entries.map((value) => action(value)));
    if (parts.length === 2 && parts.every((part) => !part.shape.length || part.entries.length === count)) {
      const [one, other] = parts.map((part) => Number(part.shape.length > 0));
      return new Matrix(shape, Array.from({ length: count }, (_, n) => action(first.entries[one * n], second.entries[other * n])));
    }
    const place = (index, own) => {
      let [at, rest, step] = [0, index, 1];
      for (let axis = depth - 1; axis >= 0; axis -= 1) {
        if (own[axis] > 1) at += (rest % shape[axis]) * step;
        step *= own[axis];
        rest = Math.floor(rest / shape[axis]);
      }
      return at;
    };
    const entries = Array.from({ length: count }, (_, index) => action(...parts.map((part, n) => part.entries[place(index, shapes[n])])));
    return new Matrix(shape, entries);
  }

  get length() { return this.shape[0]; }

  *[Symbol.iterator]() { for (let n = 0; n < this.length; n += 1) yield this.row(n); }

  row(n) {
    const [, ...rest] = this.shape;
    if (!rest.length) return this.entries[n];
    const size = rest.reduce((product, one) => product * one, 1);
    return new Matrix(rest, this.entries.slice(n * size, (n + 1) * size));
  }

  /** Entries at an index: a number or a slice for each axis; `[:, None]` adds an axis. */
  at(index) {
    const [rows, ...columns] = Array.isArray(index) ? index : [index];
    if (columns[0] === null) return new Matrix([this.length, 1], this.entries);
    if (!(rows instanceof slice)) {
      const row = this.row(rows < 0 ? this.length + rows : rows);
      return columns.length ? row.at(columns) : row;
    }
    const { length, shape: [, width = 1, ...rest] } = this;
    const step = rows.step || (columns[0] instanceof slice && columns[0].step);
    if (rest.length || (step && step !== 1)) return Matrix.of($items([...this], rows).map((row) => (columns.length ? row.at(columns) : row)));
    // Numbers are copied in one go: there are many.
    const [from, to] = [[rows.start, 0], [rows.stop, length]].map(([end, other]) => Math.min(length, Math.max(0, (end ?? other) < 0 ? length + end : end ?? other)));
    const count = Math.max(0, to - from);
    if (!columns.length) return new Matrix([count, ...this.shape.slice(1)], this.entries.slice(from * width, (from + count) * width));
    if (typeof columns[0] === 'number') {
      const column = from * width + (columns[0] < 0 ? width : 0) + columns[0];
      return new Matrix([count], Array.from({ length: count }, (_, n) => this.entries[column + n * width]));
    }
    const across = $items(range(width), columns[0]);
    return new Matrix([count, across.length], Array.from({ length: count * across.length }, (_, n) => this.entries[(from + Math.floor(n / across.length)) * width + across[n % across.length]]));
  }

  /** One number for each row of the last axis, or for all entries. */
  reduce(action, axis) {
    if (axis === undefined || this.shape.length === 1) return action(this.entries);
    const size = this.shape.at(-1);
    const rows = Array.from({ length: this.shape[0] }, (_, n) => this.entries.slice(n * size, (n + 1) * size));
    return new Matrix(this.shape.slice(0, -1), rows.map(action));
  }

  max(axis, { initial = -Infinity } = {}) { return this.reduce((row) => row.reduce($max, initial), axis); }

  sum(axis) { return this.reduce((row) => row.reduce($add, 0), axis); }

  astype(kind) { return new Matrix(this.shape, this.entries.map(kind === np.longdouble ? Extended.of : $number)); }

  reshape() { return new Matrix([this.entries.length], this.entries); }

  tolist() { return [...this].map((row) => (row instanceof Matrix ? row.tolist() : row)); }
}

const $number = (value) => (value instanceof Extended ? value.number : Number(value));
const $even = (value) => {
  const near = Math.round(value);
  return near - value === 0.5 && near % 2 ? near - 1 : near;
};

const np = {
  array: (rows) => Matrix.of([...rows].map((row) => (row instanceof Matrix ? row.tolist() : row))),
  asarray: (rows) => Matrix.of(rows),
  longdouble: 'longdouble',
  float64: 'float64',
  full: (count, value) => new Matrix([count], new Array(count).fill(value)),
  zeros: (count) => new Array(count).fill(0),
  zeros_like: (one) => Matrix.each(() => 0, one),
  broadcast_to: (one, shape) => Matrix.each((value) => value, one, new Matrix(shape, new Array(shape.reduce((a, b) => a * b, 1)).fill(0))),
  where: (test, yes, no) => Matrix.each((which, one, other) => (which ? one : other), test, yes, no),
  searchsorted: (rows, values, { side = 'left' } = {}) => values.map((value) => {
    let [low, high] = [0, rows.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (rows.entries[middle] < value || (side === 'right' && rows.entries[middle] === value)) low = middle + 1;
      else high = middle;
    }
    return low;
  }),
  mean: (one) => one.sum() / one.entries.length,
  diff: ({ entries }) => new Matrix([Math.max(0, entries.length - 1)], entries.slice(1).map((value, n) => value - entries[n])),
  clip: (one, low, high) => Matrix.each((value) => Math.min(high ?? Infinity, Math.max(low, value)), one),
  sqrt: (one) => Matrix.each((value) => (value instanceof Extended ? value.root() : Math.sqrt(value)), one),
  abs: (one) => Matrix.each(Math.abs, one),
  hypot: (one, other) => Matrix.each((a, b) => Math.hypot(a, b), one, other),
  maximum: (one, other) => Matrix.each((a, b) => Math.max(a, b), one, other),
  minimum: (one, other) => Matrix.each((a, b) => Math.min(a, b), one, other),
  round: (one) => Matrix.each($even, one),
  frexp: (one) => [0, 1].map((part) => Matrix.each((value) => math.frexp(value)[part], one)),
  ldexp: (one, other) => Matrix.each((value, power) => value * 2 ** power, one, other),
};

/** Records with columns of numbers, as a structured array. */
function rows_of(kind, shape, columns) {
  const parts = kind.fields.map((name) => (name in columns ? Matrix.each($number, columns[name]) : null));
  const model = parts.find((part) => part);
  const rows = model.entries.map((_, n) => parts.map((part) => part?.entries[n] ?? 0));
  return { tolist: () => rows, reshape: () => ({ tolist: () => rows }) };
}

// Numbers

const $bits = new DataView(new ArrayBuffer(8));

const math = {
  copysign: (x, y) => (y < 0 || Object.is(y, -0) ? -Math.abs(x) : Math.abs(x)),
  fmod: (x, y) => x % y,
  remainder: (x, y) => x - $even(x / y) * y,
  frexp: (x) => {
    if (x === 0 || !Number.isFinite(x)) return [x, 0];
    let power = Math.floor(Math.log2(Math.abs(x))) + 1;
    if (Math.abs(x) / 2 ** power >= 1) power += 1;
    if (Math.abs(x) / 2 ** power < 0.5) power -= 1;
    return [x / 2 ** power, power];
  },
  isfinite: Number.isFinite,
  isinf: (x) => Math.abs(x) === Infinity,
  isnan: Number.isNaN,
  nextafter: (x, y) => {
    if (x === y) return y;
    if (x === 0) return y > 0 ? 5e-324 : -5e-324;
    $bits.setFloat64(0, x);
    $bits.setBigInt64(0, $bits.getBigInt64(0) + ((y > x) === (x > 0) ? 1n : -1n));
    return $bits.getFloat64(0);
  },
  ulp: (x) => math.nextafter(Math.abs(x), Infinity) - Math.abs(x),
};

const $min = (a, b) => (b < a ? b : a);
const $max = (a, b) => (b > a ? b : a);
const $modulo = (x, y) => {
  if (typeof x === 'bigint') return ((x % BigInt(y)) + BigInt(y)) % BigInt(y);
  const rest = x % y;
  return rest !== 0 && (rest < 0) !== (y < 0) ? rest + y : rest;
};

// Operators on numbers, long integers, texts, lists, mappings and arrays

const $big = (value) => BigInt(value);
const $plain = (value) => value !== null && typeof value === 'object' && Object.getPrototypeOf(value) === Object.prototype;

function $operator(plain, extended) {
  const one = (a, b) => {
    if (typeof a === 'bigint' || typeof b === 'bigint') {
      return [a, b].every((x) => typeof x === 'bigint' || Number.isInteger(x)) ? plain($big(a), $big(b)) : plain(Number(a), Number(b));
    }
    if (a instanceof Extended || b instanceof Extended) return extended(Extended.of(a), Extended.of(b));
    return plain(a, b);
  };
  return (a, b) => {
    if (typeof a === 'number' && typeof b === 'number') return plain(a, b);
    return a instanceof Matrix || b instanceof Matrix ? Matrix.each(one, a, b) : one(a, b);
  };
}

const $sum = $operator((a, b) => a + b, (a, b) => a.plus(b));
const $product = $operator((a, b) => a * b, (a, b) => a.times(b));
const $subtract = $operator((a, b) => a - b, (a, b) => a.minus(b));
const $divide = $operator((a, b) => a / b, (a, b) => a.over(b));
const $floor_divide = $operator((a, b) => Math.floor(a / b));
const $power = $operator((a, b) => (b === 2 ? a * a : a ** b));
const $shift_right = (a, b) => $big(a) >> $big(b);
const $xor = (a, b) => $big(a) ^ $big(b);
const $add = (a, b) => (Array.isArray(a) && !(b instanceof Matrix) ? [...a, ...b] : $sum(a, b));
const $multiply = (a, b) => {
  if (Array.isArray(a)) return a.length === 1 ? new Array(b).fill(a[0]) : Array.from({ length: b }, () => a).flat();
  return Array.isArray(b) ? $multiply(b, a) : $product(a, b);
};
const $negative = (a) => Matrix.each((x) => (x instanceof Extended ? x.negative() : -x), a);
const $and = (a, b) => (a instanceof Matrix ? Matrix.each((x, y) => x && y, a, b) : $big(a) & $big(b));
const $or = (a, b) => ($plain(a) ? { ...a, ...b } : $big(a) | $big(b));

function $compare(test, every) {
  return (a, b) => {
    if (typeof a === 'number' && typeof b === 'number') return test(a, b);
    if (a instanceof Matrix || b instanceof Matrix) return Matrix.each(test, a, b);
    if (Array.isArray(a)) {
      const place = a.findIndex((one, n) => n < b.length && !$equal(one, b[n]));
      return place < 0 ? test(a.length, b.length) : test(a[place], b[place]);
    }
    return every ? every(a, b) : test(a, b);
  };
}

const $same = (a, b) => {
  if (a === null || b === null || typeof a !== 'object' || typeof b !== 'object') return a == b; // eslint-disable-line eqeqeq
  if (Object.getPrototypeOf(a) !== Object.getPrototypeOf(b)) return false;
  const [own, other] = [Object.keys(a), Object.keys(b)];
  return own.length === other.length && own.every((name) => $same(a[name], b[name]));
};
const $equal = (a, b) => (a instanceof Matrix ? Matrix.each((x, y) => x === y, a, b) : $same(a, b));
const $differ = (a, b) => (a instanceof Matrix ? Matrix.each((x, y) => x !== y, a, b) : !$same(a, b));
const $less = $compare((a, b) => a < b);
const $at_most = $compare((a, b) => a <= b);
const $greater = $compare((a, b) => a > b);
const $at_least = $compare((a, b) => a >= b);
const $true = (value) => {
  if (Array.isArray(value)) return value.length > 0;
  return $plain(value) ? Object.keys(value).length > 0 : Boolean(value);
};
const $both = (a, other) => ($true(a) ? other() : a);
const $either = (a, other) => ($true(a) ? a : other());
const $contains = (rows, value) => {
  if (typeof rows === 'string') return rows.includes(value);
  return $plain(rows) ? Object.hasOwn(rows, value) : [...$iterable(rows)].some((one) => $same(one, value));
};

// Sequences and mappings

class slice {
  constructor(start, stop, step = null) {
    this.start = start;
    this.stop = stop;
    this.step = step;
  }
}

const $iterable = (rows) => ($plain(rows) ? Object.keys(rows) : rows);
/** Some first and last entries of a sequence, and between them the list of the others. */
function $parts(rows, before, after) {
  const all_ = [...$iterable(rows)];
  const end = all_.length - after;
  return [...all_.slice(0, before), all_.slice(before, end), ...all_.slice(end)];
}
function $items(rows, { start, stop, step }) {
  const part = rows.slice(start ?? 0, stop ?? undefined);
  if (!step || step === 1) return part;
  if (step === -1) return [...part].reverse();
  return part.filter((_, n) => n % step === 0);
}
function $item(rows, index) {
  if (rows instanceof Matrix) return rows.at(index);
  if (Array.isArray(rows) && Array.isArray(index)) return rows.at(index[0]).at(index[1]);
  if (index instanceof slice) return typeof rows === 'string' ? $items([...rows], index).join('') : $items([...rows], index);
  if ($plain(rows)) {
    if (!Object.hasOwn(rows, index)) throw new KeyError(String(index));
    return rows[index];
  }
  const list = typeof rows === 'string' || Array.isArray(rows) ? rows : [...rows];
  return list[index < 0 ? list.length + index : index];
}
function $set(rows, index, value) {
  if (index instanceof slice) rows.splice(index.start ?? 0, (index.stop ?? rows.length) - (index.start ?? 0), ...$iterable(value));
  else rows[Array.isArray(rows) && index < 0 ? rows.length + index : index] = value;
}
function $delete(rows, index) {
  if (index instanceof slice) rows.splice(index.start ?? 0, (index.stop ?? rows.length) - (index.start ?? 0));
  else delete rows[index];
}

const $methods = {
  append: (rows, one) => { rows.push(one); },
  extend: (rows, more) => { rows.push(...$iterable(more)); },
  items: (rows) => Object.entries(rows),
  values: (rows) => Object.values(rows),
  keys: (rows) => Object.keys(rows),
  get: (rows, name, other = null) => (Object.hasOwn(rows, name) ? rows[name] : other),
  index: (rows, one) => rows.findIndex((other) => $same(one, other)),
  pop: (rows, name, other) => {
    if (Array.isArray(rows)) return rows.pop();
    const value = $methods.get(rows, name, other);
    delete rows[name];
    return value;
  },
  update: (rows, more) => { Object.assign(rows, more); },
  copy: (rows) => (Array.isArray(rows) ? [...rows] : { ...rows }),
  startswith: (text, start) => [start].flat().some((one) => text.startsWith(one)),
  endswith: (text, end) => [end].flat().some((one) => text.endsWith(one)),
  removeprefix: (text, start) => (text.startsWith(start) ? text.slice(start.length) : text),
  strip: (text) => text.trim(),
  lower: (text) => text.toLowerCase(),
  upper: (text) => text.toUpperCase(),
  split: (text, at) => text.split(at),
  replace: (text, one, other) => text.replaceAll(one, other),
  join: (text, rows) => [...$iterable(rows)].join(text),
  isdigit: (text) => /^\d+$/.test(text),
  fullmatch: (pattern, text) => pattern.exec(text),
  format: (text, ...values) => {
    let n = -1;
    return text.replace(/\{:?([^}]*)\}/g, (_, how) => { n += 1; return $format(values[n], how); });
  },
};
const $call = (one, name, ...values) => {
  const own = one !== null && typeof one === 'object' && !Array.isArray(one) && !$plain(one) && !(one instanceof RegExp) && one[name];
  return own ? one[name](...values) : $methods[name](one, ...values);
};

// Records and enumerations

/** Give a class what named tuples and dataclasses have. */
function $record(kind, names) {
  kind.fields = names;
  kind.prototype._fields = kind._fields = names;
  kind.$of = function of(values) {
    for (const name of Object.keys(values)) if (!names.includes(name)) throw new TypeError(`${kind.name} has no ${name}`);
    return new this(...names.map((name) => values[name]));
  };
  kind._make = function made(values) { return new this(...$iterable(values)); };
  // By its constructor, so that all records of a class have one shape and kernels are compiled for it once
  kind.prototype._replace = function changed(values) { return new this.constructor(...names.map((name) => (name in values ? values : this)[name])); };
  kind.prototype._asdict = function mapping() { return { ...this }; };
  kind.prototype[Symbol.iterator] = function* entries() { for (const name of names) yield this[name]; };
}
/** Let methods of a class be called on what it has made, too. */
function $shared(kind, names) {
  for (const name of names) kind.prototype[name] = function called(...given) { return this.constructor[name](...given); };
}
function $enumeration(name, members) {
  const kind = (value) => value;
  for (const [word, value] of Object.entries(members)) kind[word] = value;
  kind.members = Object.entries(members);
  kind[Symbol.iterator] = () => Object.values(members).values();
  return kind;
}
const copy_of = (state) => state._replace({});
const specs_of = (kind) => kind.specs;

// Functions of Python

const $isClass = (one) => /^class\b/.test(Function.prototype.toString.call(one));
const $bound = (one, name) => (typeof one[name] === 'function' ? one[name].bind(one) : one[name]);
/** The result of a function for some arguments, of which the last ones are kept with it. */
function $remembered(place, action, given) {
  place.kept ??= [];
  const known = place.kept.find((one) => $same(one.given, given));
  if (known) return known.result;
  const result = action(...given);
  place.kept = [{ given, result }, ...place.kept.slice(0, 15)];
  return result;
}
const $applied = (action) => ($isClass(action) ? (...given) => new action(...given) : action); // eslint-disable-line new-cap

/** Arguments by name of a function of Python. */
class Named {
  constructor(values) { Object.assign(this, values); }
}

const object = Object;
const len = (rows) => (rows.members ? rows.members.length : $plain(rows) ? Object.keys(rows).length : rows.length);
const range = (...ends) => {
  const [first, last, step] = ends.length < 2 ? [0, ends[0], 1] : [...ends, 1];
  return Array.from({ length: Math.max(0, Math.ceil((last - first) / step)) }, (_, n) => first + n * step);
};
function* zip(...given) {
  const all = given.map((rows) => $iterable(rows)[Symbol.iterator]());
  for (;;) {
    const next = all.map((one) => one.next());
    if (!next.length || next.some(({ done }) => done)) return;
    yield next.map(({ value }) => value);
  }
}
const pairwise = (rows) => { const found = [...$iterable(rows)]; return found.slice(1).map((one, n) => [found[n], one]); };
function* chain(...given) { for (const rows of given) yield* $iterable(rows); }
function* repeat(value) { for (;;) yield value; }
const enumerate = (rows) => [...$iterable(rows)].map((one, n) => [n, one]);
const map = (action, ...given) => [...zip(...given)].map((values) => $applied(action)(...values));
const filter = (action, rows) => [...$iterable(rows)].filter(action ?? $true);
const list = (rows = []) => [...$iterable(rows)];
const tuple = list;
const set = list;
const dict = (rows = {}) => ($plain(rows) ? { ...rows } : Object.fromEntries([...rows]));
dict.fromkeys = (names, value = null) => Object.fromEntries([...$iterable(names)].map((name) => [name, value]));
const islice = (rows, count) => [...$iterable(rows)].slice(0, count);
const sorted = (rows, { key = (one) => one } = {}) => [...$iterable(rows)].sort((one, other) => ($less(key(one), key(other)) ? -1 : $less(key(other), key(one)) ? 1 : 0));
const replace = (one, changes) => Object.assign(Object.create(Object.getPrototypeOf(one)), one, changes);
const round = (value) => $even(value);
const reversed = (rows) => [...$iterable(rows)].reverse();
const sum = (rows, start = 0) => [...$iterable(rows)].reduce($add, start);
const any = (rows) => [...$iterable(rows)].some($true);
const all = (rows) => [...$iterable(rows)].every($true);
const iter = (rows) => $iterable(rows)[Symbol.iterator]();
const next = (rows, other) => {
  const { value, done } = rows.next ? rows.next() : $iterable(rows)[Symbol.iterator]().next();
  if (done && other === undefined) throw new Error('there is no next one');
  return done ? other : value;
};
const $extreme = (given, better) => {
  const named = given.at(-1) instanceof Named ? given.at(-1) : {};
  const values = given.filter((one) => one !== named);
  const rows = values.length === 1 ? [...$iterable(values[0])] : values;
  const key = named.key ?? ((one) => one);
  if (!rows.length) return named.default;
  return rows.reduce((one, other) => (better(key(other), key(one)) ? other : one));
};
const max = (...given) => $extreme(given, $greater);
const min = (...given) => $extreme(given, $less);
const abs = (value) => Math.abs(value);
const float = (value) => Number(value);
const int = (value) => (typeof value === 'bigint' ? value : Math.trunc(Number(value)));
const bool = (value) => $true(value);
const str = (value) => $format(value, '');
const type = (value) => value.constructor;
const getattr = (one, name, other) => (one?.[name] === undefined ? other : one[name]);
const hasattr = (one, name) => {
  if (name === '__float__') return typeof one === 'number' || typeof one === 'boolean';
  if (name === '__iter__') return typeof one === 'string' || Array.isArray(one);
  return name === '__len__' ? one?.length !== undefined : one?.[name] !== undefined;
};
const bytes = Uint8Array;
const isinstance = (value, kinds) => [kinds].flat().some((kind) => {
  if (kind === bool) return typeof value === 'boolean';
  if (kind === float) return typeof value === 'number';
  if (kind === int) return typeof value === 'boolean' || typeof value === 'bigint' || Number.isInteger(value);
  if (kind === str) return typeof value === 'string';
  if (kind === list || kind === tuple) return Array.isArray(value);
  return kind === dict ? $plain(value) : value instanceof kind;
});
const quote = (value) => $format(value, '', true);
const attrgetter = (...names) => (one) => (names.length > 1 ? names.map((name) => one[name]) : one[names[0]]);
const bisect_left = (rows, value) => {
  const place = rows.findIndex((one) => one >= value);
  return place < 0 ? rows.length : place;
};
const bisect_right = (rows, value) => {
  const place = rows.findIndex((one) => one > value);
  return place < 0 ? rows.length : place;
};

class Exception extends Error {}
class ValueError extends Exception {}
class RuntimeError extends Exception {}
class KeyError extends Exception {}
class OverflowError extends Exception {}

/** A value as Python writes it: with `repr`, or in a format of digits such as .4g. */
function $format(value, how, quoted = false) {
  if (value === null || value === undefined) return 'None';
  if (typeof value === 'boolean') return value ? 'True' : 'False';
  if (Array.isArray(value)) return `[${value.map((one) => $format(one, '', true)).join(', ')}]`;
  if (typeof value === 'string') return quoted ? `'${value}'` : value;
  if (value instanceof Error) return value.message;
  if (typeof value !== 'number') return String(value);
  if (!Number.isFinite(value)) return Number.isNaN(value) ? 'nan' : value > 0 ? 'inf' : '-inf';
  const [, digits, kind] = /^\.?(\d*)([a-z]?)$/.exec(how) ?? [];
  if (kind === 'f') return value.toFixed(Number(digits || 6));
  if (kind === 'd') return String(value);
  if (kind !== 'g') {
    const [digits_, power_] = value.toExponential().split('e');
    if (value && (Number(power_) < -4 || Number(power_) >= 16)) return $exponent(`${digits_}e${power_}`);
    const plain = Number.isInteger(value) || Math.abs(value) >= 1e-6 ? String(value) : value.toFixed(digits_.replace(/\D/g, '').length - 1 - Number(power_));
    return quoted && Number.isInteger(value) ? `${plain}.0` : plain;
  }
  const count = Math.max(1, Number(digits || 6));
  if (value === 0) return '0';
  const power = Number(value.toExponential(count - 1).split('e')[1]);
  if (power < -4 || power >= count) return $exponent(Number(value.toExponential(count - 1)).toExponential());
  return String(Number(value.toPrecision(count)));
}
const $exponent = (text) => text.replace(/e([+-])(\d)$/, 'e$10$2');

// What the page does without: laws of one's own, names of a structure, tables of numpy

const table_of_events = () => { throw new Error('no table of events'); };
const events_of_table = table_of_events;
const own_law_acts = () => { throw new Error('no law of its own'); };
const resolve_structure = (changes) => changes;

// Misspelt names, as Python's difflib compares them

/** Number of characters in the longest common part of two texts, and in those beside it on each side. */
function $in_common(one, other) {
  let [size, start, begin] = [0, 0, 0];
  for (let i = 0; i < one.length; i += 1) {
    for (let j = 0; j < other.length; j += 1) {
      let k = 0;
      while (i + k < one.length && one[i + k] === other[j + k]) k += 1;
      if (k > size) [size, start, begin] = [k, i, j];
    }
  }
  return size && size + $in_common(one.slice(0, start), other.slice(0, begin)) + $in_common(one.slice(start + size), other.slice(begin + size));
}
function similar_names(name, names, cutoff = 0.6) {
  const text = String(name).slice(0, 80);
  const known = [...$iterable(names)];
  const numbered = known.filter((one) => one.startsWith(`${text}_`) && /^\d+$/.test(one.slice(text.length + 1)));
  if (numbered.length) return numbered.join(' and ');
  const ratio = (one) => (2 * $in_common(one, text)) / (one.length + text.length);
  const near = known.filter((one) => ratio(one) >= cutoff);
  return near.sort((one, other) => ratio(other) - ratio(one) || (one < other ? 1 : -1))[0] ?? '';
}
