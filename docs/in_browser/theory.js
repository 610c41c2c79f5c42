// SPDX-License-Identifier: Apache-2.0
// Theory of any rig: the motion into which it settles, with its multipliers, and the curve over the gap. What is
// solved are the kernels of `orbits`, and its records; here they are put together, as there in `solved_orbits`,
// `continuation` and `solution_curve` with arrays of numpy.

/** Longest run ahead, in cycles of the force, and that from other starts; how often it is examined. */
const MOST_CYCLES_AHEAD = 1500;
const MOST_CYCLES_ELSEWHERE = 600;
const CYCLES_BETWEEN_LOOKS = 25;
const LONGEST_PERIOD = 16;
const LONGEST_FORCE = 8;
const FEWEST_REPEATS = 10;
const MOST_EVENTS = 2000;
/** It has settled if states a period apart agree to this, relative to the size of the motion. */
const SETTLED = 1e-5;
const GROWS = 1.001;
/** Distances of a motion from the observed one, and of two solutions for one motion. */
const NEAR = 1e-2;
const SAME = 1e-6;
const MOST_LOOKS = 3;
/** Steps of a branch, the factor to the ends of its range, and how it is followed beyond an end. */
const LARGEST_STEP = 0.05;
const FIRST_STEP = 0.1 * LARGEST_STEP;
const MOST_POINTS = 150;
const SPAN_OF_GAPS = 4;
const MOST_FURTHER = 4;
const MOST_BRANCHES = 4;
const ROWS_OF_TRACE = 64;
/** How close multipliers are to those of a special point, and where they have a pole. */
const GENUINE = 1e-3;
const GUESSED = 0.2;
const POLE = 1e10;
const BEYOND_MEETING = 1e-6;
const POINTS_PER_CYCLE = 400;
const KINDS = { [FOLD]: 'fold', [DOUBLING]: 'period doubling', [TORUS]: 'Neimark-Sacker', [BRANCHING]: 'branch point', [VIABLE]: 'grazing' };

// Arrays

/** Rows of numbers, as a kernel has a matrix. */
const rowsOf = (count, width, Kind = Float64Array) => Object.assign(Array.from({ length: count }, () => new Kind(width)), { shape: [count, width] });
const blank = (Kind, fields = {}) => Object.assign(Kind._make(Kind.fields.map(() => 0)), fields);
const distanceOf = (one, other) => Math.hypot(...one.map((value, n) => value - other[n]));
const last = (list) => list[list.length - 1];

/** Reflect a square matrix on the left and right, so that of a vector from a row on only the first entry is left. */
function reflect(h, v, count, from, firstColumn, endRow) {
  let square = 0;
  for (let n = 0; n < count; n += 1) square += v[n] * v[n];
  if (square === 0) return;
  const length = Math.sqrt(square);
  square += Math.abs(v[0]) * length;
  v[0] += v[0] >= 0 ? length : -length;
  for (let k = firstColumn; k < h.length; k += 1) {
    let dot = 0;
    for (let n = 0; n < count; n += 1) dot += v[n] * h[from + n][k];
    for (let n = 0; n < count; n += 1) h[from + n][k] -= (dot / square) * v[n];
  }
  for (let k = 0; k < endRow; k += 1) {
    let dot = 0;
    for (let n = 0; n < count; n += 1) dot += v[n] * h[k][from + n];
    for (let n = 0; n < count; n += 1) h[k][from + n] -= (dot / square) * v[n];
  }
}

/** Let rows and columns of a matrix have norms that agree. */
function balance(h) {
  for (let again = true; again;) {
    again = false;
    for (let i = 0; i < h.length; i += 1) {
      let [row, column] = [0, 0];
      for (let k = 0; k < h.length; k += 1) if (k !== i) { row += Math.abs(h[i][k]); column += Math.abs(h[k][i]); }
      if (!row || !column) continue;
      const factor = 2 ** Math.round(0.5 * Math.log2(row / column));
      if (column * factor + row / factor >= 0.95 * (row + column)) continue;
      again = true;
      for (let k = 0; k < h.length; k += 1) { h[i][k] /= factor; h[k][i] *= factor; }
    }
  }
}

/** The eigenvalues of two rows and columns, as [real, imaginary]. */
function eigenvaluesOfTwo(a, b, c, d) {
  const half = 0.5 * (a - d);
  const root = half * half + b * c;
  if (root < 0) return [[0.5 * (a + d), Math.sqrt(-root)], [0.5 * (a + d), -Math.sqrt(-root)]];
  const far = half + (half >= 0 ? Math.sqrt(root) : -Math.sqrt(root));
  return [[d + far, 0], [far ? d - (b * c) / far : d, 0]];
}

/** The eigenvalues of a small matrix, which is overwritten, by double steps of Francis. */
function eigenvalues(h) {
  balance(h);
  const v = new Float64Array(h.length);
  for (let k = 0; k < h.length - 2; k += 1) {
    const count = h.length - k - 1;
    for (let n = 0; n < count; n += 1) v[n] = h[k + 1 + n][k];
    reflect(h, v, count, k + 1, 0, h.length);
    for (let n = 1; n < count; n += 1) h[k + 1 + n][k] = 0;
  }
  const values = [];
  for (let [end, steps] = [h.length - 1, 0]; end >= 0; steps += 1) {
    let low = end;
    while (low > 0 && Math.abs(h[low][low - 1]) > 2.3e-16 * (Math.abs(h[low][low]) + Math.abs(h[low - 1][low - 1]))) low -= 1;
    if (low === end) {
      values.push([h[end][end], 0]);
      [end, steps] = [end - 1, 0];
      continue;
    }
    const [a, b, c, d] = [h[end - 1][end - 1], h[end - 1][end], h[end][end - 1], h[end][end]];
    if (low === end - 1) {
      values.push(...eigenvaluesOfTwo(a, b, c, d));
      [end, steps] = [end - 2, 0];
      continue;
    }
    // Now and then with another shift, where it does not converge
    const shift = Math.abs(c) + Math.abs(h[end - 1][end - 2]);
    const [trace, product] = steps % 10 === 9 ? [1.5 * shift, shift * shift] : [a + d, a * d - b * c];
    const [p, q] = [h[low], h[low + 1]];
    v.set([p[low] * p[low] + p[low + 1] * q[low] - trace * p[low] + product, q[low] * (p[low] + q[low + 1] - trace), q[low] * h[low + 2][low + 1]]);
    for (let k = low; k < end; k += 1) {
      const count = Math.min(3, end - k + 1);
      if (k > low) for (let n = 0; n < count; n += 1) v[n] = h[k + n][k - 1];
      reflect(h, v, count, k, Math.max(low, k - 1), Math.min(end, k + 3) + 1);
      if (k > low) for (let n = 1; n < count; n += 1) h[k + n][k - 1] = 0;
    }
  }
  return values;
}

/** The four multipliers of a map, row by row, with some free coordinates; the largest first. */
function multipliersOfMap(entries, size) {
  const matrix = [];
  for (let n = 0; n < size; n += 1) matrix.push(entries.slice(4 * n, 4 * n + size));
  const ranked = eigenvalues(matrix).map((value) => [Math.hypot(value[0], value[1]), value]);
  ranked.sort(([one, a], [other, b]) => (Math.abs(other - one) < 1e-12 ? b[0] - a[0] || b[1] - a[1] : other - one));
  const values = ranked.map(([, value]) => value);
  while (values.length < 4) values.push([0, 0]);
  return values;
}

// Solutions

/** The numbers of a rig, as the kernels have them. */
function numbersOf(rig) {
  return [...NUMBERS.map((name) => rig[name]), ...[...zip(...rig.harmonics)].flat()];
}

/** The boundary-value problem of a rig and a sequence of nodes; see `periodic_problem`. */
class PeriodicProblem {
  constructor(parameters, nodes, cycles) {
    const numbers = numbersOf(parameters);
    Object.assign(this, { parameters, nodes, cycles, cycle: 2 * Math.PI / numbers[FIRST_LINE + 1] });
    this.stops = nodes.filter(({ kind }) => kind === EventKind.IMPACT).map(({ stop }) => stop);
    const count = nodes.length;
    const [equations, unknowns] = [0, 1].map((k) => nodes.flatMap((node) => _counting(node)[k]).flatMap((counts, n) => (counts ? [n] : [])));
    const places = rowsOf(4, 5 * count, Int32Array);
    for (const row of places) row.fill(-1);
    places[UNKNOWNS].set(unknowns);
    [[ROW_OF, equations], [UNKNOWN_OF, unknowns]].forEach(([row, numbers]) => numbers.forEach((place, n) => { places[row][place] = n; }));
    let stop = 0;
    const hit = [...nodes, ...nodes].map((node) => { stop = node.kind === EventKind.IMPACT ? node.stop : stop; return stop; }).slice(count);
    this.last = hit;
    const rows = nodes.map((node, n) => {
      const before = nodes[(n + count - 1) % count];
      const direction = Number(node.mode === SLIDE_DOWN) - Number(node.mode === SLIDE_UP);
      return new NodeRow(node.kind, node.stop, node.mode, node.resting, direction, hit[n], _upwards(before, node) ? 1 : -1, node.stop !== 0 && node.stop === before.stop && count > 1);
    });
    this.width = unknowns.length + 1;
    const width = Math.max(this.width, numbers.length, NEWTON_STEPS + 1);
    const harmonics = (numbers.length - FIRST_LINE) / 3;
    const both = { harmonics, one_sided: parameters.one_sided, free: blank(Oscillator), joint: blank(Oscillator) };
    const moving = new Moving(blank(RigConstants, both), Array.from({ length: 2 * harmonics }, () => blank(Line)), new Run(), Array.from({ length: harmonics }, () => new Wave()), []);
    this.table = rowsOf(count, COLUMNS);
    this.sheet = rowsOf(ROWS + 3 * this.width, width);
    this.arrays = new Problem(moving, rows, this.table, places, this.sheet);
    const [amplitude, frequency] = numbers.slice(FIRST_LINE);
    const fall = (Math.abs(parameters.gravity) * (1 + Math.abs(parameters.friction)) + parameters.air_force / parameters.damper_mass) / frequency ** 2;
    const swings = new Set(this.stops).size > 1 ? parameters.gap : 0;
    this.length = Math.max(Math.abs(amplitude) / parameters.stiffness, fall, swings);
    this.sheet[RIG].set(numbers);
    this.sheet[UNITS].set([this.length, this.length * parameters.omega, cycles]);
    this.counting = unknowns;
    this.numbers = numbers;
  }

  place() { return this.sheet[PLACE].slice(0, this.width); }

  unknowns(states, instants) {
    const [length, speed] = this.sheet[UNITS];
    const units = [length, speed, length, speed, 1 / this.numbers[FIRST_LINE + 1]];
    const full = states.flatMap((state, n) => [...state, instants[n]].map((value, k) => value / units[k]));
    return this.counting.map((place) => full[place]);
  }

  compute(task, inOrder, one, other, trace = []) { return compute(this.arrays, trace, task, inOrder, one, other); }

  /** The solution that Newton's method leads to from a place, or null. */
  solveFrom(place) {
    this.sheet[PLACE].set(place);
    return this.compute(SOLVE, true, LEAST_RESIDUAL, RESIDUAL_TOLERANCE)[0] ? this.solution(this.parameters) : null;
  }

  /** Room for roots in rows. */
  rowsOfRoots(count) { return rowsOf(count, this.width - 1 + KIND + NEWTON_STEPS + 1 + COLUMNS * this.nodes.length); }

  /** The solution in a row of roots. */
  solutionOf(row) {
    const values = [...row].slice(this.width - 1);
    const cells = values.splice(KIND + NEWTON_STEPS + 1);
    return this.solution(this.parameters, values, values.slice(KIND), this.nodes.map((_, n) => cells.slice(n * COLUMNS, (n + 1) * COLUMNS)));
  }

  /** The solution that the kernels have reached, of a rig. */
  solution(parameters, marks = [...this.sheet[MARKS]], history = [...this.sheet[HISTORY]], table = this.table.map((row) => [...row])) {
    const ends = table.map((row) => row.slice(END, END + 4));
    const viable = marks[VIABLE] > 0;
    const faults = viable ? [] : table.flatMap((row, n) => (row[FAULT] === RIGHT ? [] : [_fault_at(this.arrays.nodes, n, table)]));
    return {
      problem: this, parameters, viable, cycle: this.cycle, table: table, residual: marks[RESIDUAL], history: history.slice(0, history.indexOf(-1)),
      multipliers: multipliersOfMap(marks.slice(MAP), marks[SIZE]), x_max: marks[X_MAX], reason: faults.join('; '),
      states: Matrix.of(table.map((row) => row.slice(0, 4))), instants: Matrix.of(table.map((row) => row[INSTANT])), before: Matrix.of([last(ends), ...ends.slice(0, -1)]),
    };
  }
}

/** The motion of a solution, with its nodes. */
function orbitOf(solution) {
  const orbit = orbit_of(solution);
  const { problem, states, instants } = solution;
  orbit.guess = { nodes: problem.nodes, states: states.tolist(), instants: instants.tolist() };
  return orbit;
}

const modulusOf = ({ multipliers: [[re, im]] }) => Math.hypot(re, im);
const isStable = (motion) => modulusOf(motion) < 1 - NEUTRAL;
const isKept = (motion) => motion.viable && modulusOf(motion) <= 1 + NEUTRAL;

/** The rig that goes on from the origin of a flight, at time 0. */
function rig_on({ run, waves }, parameters) {
  const rig = new Rig(parameters);
  return continued(rig, run, waves.map(({ angle }) => angle));
}

/** A rig in the state of a run. */
function continued(rig, run, angles) {
  const kept = Object.assign(new Run(), run);
  Object.assign(rig, { _run: copy_of(kept), _waves: angles.map((angle) => new Wave(angle)), _unreported: [] });
  begin_flight(rig._moving());
  const { searched, crossing_side, watched, crossing, now, time, time_low } = kept;
  Object.assign(rig._run, { searched, crossing_side, watched, crossing, counted_from: now, counted: now - time - time_low });
  return rig;
}

/** Run a rig on; null where it has too many events. */
function eventsUntil(rig, time, most = MOST_EVENTS) {
  try {
    const events = rig.advance(time);
    return events.length > most ? null : events;
  } catch (error) {
    if (error instanceof RunawayError) return null;
    throw error;
  }
}

/** Nodes among events that begin in a mode, with their events; null where a chatter ends without rest. */
function nodesAmong(events, mode) {
  const nodes = [];
  let kind = -1;
  for (const event of events) {
    const [before, previous] = [mode, kind];
    ({ kind, mode } = event);
    const rests = kind === EventKind.REST;
    if (before >= CHATTER_1 && (!rests || mode >= CHATTER_1)) return null;
    if (rests && before < CHATTER_1 && previous !== EventKind.IMPACT) return null;
    if (!rests) nodes.push({ node: new Node(kind, event.stop, mode), event });
  }
  return nodes;
}

const rests = (mode) => mode === STICK || mode === REST_1 || mode === REST_2;

/** A guess of the periodic motion near that of a rig at an instant of the force, which is run on; see `guess_along`. */
function guessAlong(rig, instant, period) {
  const start = rig.time;
  const first = rig.sample();
  const begun = { time: start, mode: rig._run.mode, speed: first.damper_velocity - first.primary_velocity };
  const events = eventsUntil(rig, start + period);
  if (!events) return null;
  const flights = [begun, ...events.map((e) => ({ time: e.time, mode: e.mode, speed: e.damper_velocity_after - e.primary_velocity_after }))];
  flights.forEach((flight, n) => { flight.span = (flights[n + 1]?.time ?? start + period) - flight.time; });
  // Resting first, then long and fast
  const anyRests = flights.some(({ mode }) => rests(mode));
  const weights = flights.map(({ mode, span, speed }) => span * (anyRests ? Number(rests(mode)) : mode < STICK ? Math.abs(speed) : 0));
  const best = weights.indexOf(Math.max(...weights));
  const flight = flights[best];
  const later = eventsUntil(rig, flight.time + flight.span * (rests(flight.mode) ? 0.5 : 0.25) + period);
  if (!later) return null;
  const read = nodesAmong([...events.slice(best), ...later], flight.mode);
  if (!read?.some(({ node }) => node.kind === EventKind.IMPACT)) return null;
  const resting = rests(flight.mode) ? flight.mode : 0;
  const { node: final } = last(read);
  if (final.resting !== resting || !(resting || final.mode === flight.mode)) return null;
  const nodes = read.map(({ node }) => node);
  const instants = read.map(({ event }) => instant + (event.time - start));
  if (instants.some((one, n) => n && one <= instants[n - 1])) return null;
  const ratio = rig._parameters.mass_ratio;
  const share = ratio / (1 + ratio);
  const half = 0.5 * rig._parameters.gap;
  let stop = last(nodes.filter(({ kind }) => kind === EventKind.IMPACT)).stop;
  const states = read.map(({ node, event }) => {
    if (node.kind === EventKind.IMPACT) stop = node.stop;
    const velocity = event.primary_velocity_after;
    const relative = event.damper_velocity_after - velocity;
    const joint = event.mode >= STICK;
    return [event.x, velocity + (joint ? share * relative : 0), event.y + (stop === 1 ? -half : half), joint ? 0 : relative];
  });
  return { nodes, states, instants };
}

const guessPerformed = (orbit, parameters) => guessAlong(after_impact(orbit, parameters), orbit.instants[0], orbit.period);

/** The motion that Newton's method leads to from a guess, if the rig can perform it; else null. */
function solve_orbit(parameters, guess, cycles) {
  for (let look = 0; guess && look < MOST_LOOKS; look += 1) {
    const problem = new PeriodicProblem(parameters, guess.nodes, cycles);
    const solution = problem.solveFrom(problem.unknowns(guess.states, guess.instants));
    if (!solution) return null;
    const orbit = orbitOf(solution);
    if (orbit.viable) return orbit;
    const again = guessPerformed(orbit, parameters);
    if (again && $same(again.nodes, guess.nodes)) return null;
    guess = again;
  }
  return null;
}

/** The motion near a solution, with the same stops, that a rig performs, begun at the same impact; or null. */
function performed(orbit, parameters) {
  const other = solve_orbit(parameters, guessPerformed(orbit, parameters), orbit.cycles);
  const turned = other?.nearest_turn(orbit);
  return turned ? Object.assign(turned[0], { guess: other.guess }) : null;
}

/** The motion that begins near an impact of the force's phase, in cycles. */
function orbitNear(parameters, impact, phase, cycles) {
  const cycle = 2 * Math.PI / parameters.first_harmonic[1];
  const instant = cycle * $modulo(phase, cycles);
  const moving = moving_at_impact(machine_of(parameters), instant, impact.stop, impact.x, impact.primary_velocity_after, impact.damper_velocity_after);
  return solve_orbit(parameters, guessAlong(rig_on(moving, parameters), instant, cycles * cycle), cycles);
}

/** Motions of one impact on each stop in some cycles that the theory of impacts has. */
function* orbitsOfTheory(parameters, cycles) {
  const stops = parameters.one_sided ? [1] : [1, 2];
  const { constants } = machine_of(parameters);
  const problem = new PeriodicProblem(parameters, impact_nodes(stops), cycles);
  if (parameters.harmonics[0].length > 1 || (parameters.one_sided && constants.grip > 0)) return;
  const size = 4 * stops.length;
  const scan = (first, end, points) => {
    for (let room = ROWS_OF_TRACE; ;) {
      const rows = rowsOf(room + 1, size + 1);
      last(rows)[0] = points;
      const [, count] = problem.compute(FIND_STARTS, true, first, end, rows);
      if (count <= room) return rows.slice(0, count);
      room = count;
    }
  };
  const points = Math.min(1e5, Math.ceil(POINTS_PER_CYCLE * cycles * Math.max(1, parameters.omega / parameters.first_harmonic[1])));
  const starts = scan(0, points + 24, points);
  const rows = problem.rowsOfRoots(starts.length);
  starts.forEach((start, n) => rows[n].set(start));
  const [, count] = problem.compute(FIND_ROOTS, true, 0, 0, rows);
  for (const row of rows.slice(0, count)) {
    const orbit = orbitOf(problem.solutionOf(row));
    if (!orbit.repeats(1e-7)) yield orbit;
  }
}

/** Keep a motion, unless it is known, in order; return the one that is kept. */
function addTo(orbits, orbit) {
  const known = nearestTo(orbits, orbit, SAME);
  if (known) return known;
  orbits.push(orbit);
  const rank = (one) => [one.viable ? 0 : 1, isStable(one) ? 0 : 1, one.x_max];
  orbits.sort((one, other) => rank(one).map((value, n) => value - rank(other)[n]).find(Boolean) ?? 0);
  return orbit;
}

function nearestTo(orbits, rhythm, limit) {
  const apart = orbits.map((one) => rhythm.distance(one));
  const least = Math.min(...apart);
  return least < limit ? orbits[apart.indexOf(least)] : null;
}

// Runs ahead

/**
 * Run a rig until its motion repeats, in parts; the last yield is what was reached: the rhythm of its impacts, the
 * strongest of them and its phase, or the reason why there is none.
 */
function* settle(rig, mostCycles) {
  const { _parameters: parameters } = rig;
  const frequency = parameters.first_harmonic[1];
  const cycle = 2 * Math.PI / frequency;
  const start = rig.time;
  const turned = (rig._waves[0].angle + (start - rig._run.time - rig._run.time_low) * frequency) / (2 * Math.PI);
  const rate = Math.max(frequency, parameters.omega);
  const states = [];
  let impacts = [];
  for (let cycles = 1; cycles <= mostCycles; cycles += 1) {
    const events = eventsUntil(rig, start + cycles * cycle, Infinity);
    if (!events) return { reason: 'run ahead from its state, the rig has too many events' };
    impacts.push(...events.filter(({ kind }) => kind === EventKind.IMPACT));
    const { x, primary_velocity: v, z, damper_velocity: w } = rig.sample();
    states.push([x, v / rate, z - x, (w - v) / rate]);
    if (cycles % CYCLES_BETWEEN_LOOKS && cycles < mostCycles) continue;
    yield null;
    impacts = impacts.filter(({ time }) => time > rig.time - 3 * LONGEST_PERIOD * cycle);
    const recent = states.slice(-3 * LONGEST_PERIOD);
    const sizes = recent.map(([one]) => Math.abs(one));
    const ways = recent.map(([, , way]) => way);
    const size = Math.max(...sizes) + Math.max(...ways) - Math.min(...ways) || 1;
    for (let period = 1; period <= LONGEST_PERIOD; period += 1) {
      const rows = Math.max(2 * period, FEWEST_REPEATS);
      if (states.length < rows + period) break;
      const repeats = recent.slice(-rows).every((state, n, { length }) => {
        const before = recent[recent.length - length + n - period];
        return state.every((value, k) => Math.abs(value - before[k]) < SETTLED * size);
      });
      if (!repeats) continue;
      const hits = impacts.filter(({ time }) => time > rig.time - period * cycle);
      if (!hits.length) return { reason: `run ahead from its state, the rig has no more impacts after ${cycles} cycles`, kind: 'without impacts' };
      const phase = (time) => turned + (time - start) / cycle;
      const xMax = Math.max(...sizes, ...hits.map(({ x: one }) => Math.abs(one)));
      const rhythm = Rhythm.of_impacts(period, hits.map(({ stop }) => stop), hits.map(({ time }) => phase(time)), hits.map(({ x: one }) => one), xMax);
      const impact = hits.reduce((one, other) => (Math.abs(other.impulse) > Math.abs(one.impulse) ? other : one));
      const orbit = reachedFrom(parameters, rhythm, impact, phase(impact.time));
      if (orbit && modulusOf(orbit) > GROWS) break;
      return { orbit, rhythm, reason: orbit ? '' : `run ahead, the rig reaches a motion with stops ${rhythm.stops} in ${plural(period, 'cycle')} of the force, for which the solvers find no motion` };
    }
  }
  return { reason: `run ahead from its state, the rig does not repeat within ${mostCycles} cycles of the force` };
}

/** The motion that a run ahead has reached, with the impacts in its order; null if there is none. */
function reachedFrom(parameters, rhythm, impact, phase) {
  const shot = orbitNear(parameters, impact, phase, rhythm.cycles);
  const orbit = shot && counted_as(shot, rhythm.stops);
  return orbit ? Object.assign(orbit, { guess: shot.guess }) : null;
}

/** Rigs that may settle into different motions; see `search.starting_rigs`. */
function startingRigs(parameters) {
  const amplitude = Math.min(parameters.response_amplitude, 5 * Math.abs(parameters.first_harmonic[0]) / parameters.stiffness);
  const speed = amplitude * parameters.first_harmonic[1];
  const half = 0.5 * parameters.gap;
  const starts = [[1, 0, 0], [0, 0, 0], [-0.5, 1, 0.9], [0.3, -2, -0.9], [2, 1, 0.3]];
  return starts.flatMap(([x, velocity, offset]) => {
    const values = {
      initial_primary_position: x * amplitude, initial_primary_velocity: velocity * speed,
      initial_damper_offset: parameters.one_sided ? half - Math.min(half, Math.abs(offset) * amplitude) : offset * half,
    };
    try {
      return [new Rig(parameters, InitialConditions.$of(values))];
    } catch {
      return [];
    }
  });
}

// The curve over the gap

/** Points with the nodes of one motion, as a curve over the gap. */
class SolutionCurve {
  constructor(orbit, range, scale, guess = orbit.guess) {
    Object.assign(this, { parameters: orbit.parameters, range, scale });
    const { nodes, states, instants } = guess;
    this.problem = new PeriodicProblem(orbit.parameters, nodes, orbit.cycles);
    const { sheet, numbers, arrays: { moving: { constants } } } = this.problem;
    sheet[PATH].set(numbers);
    sheet[PATH][GAP] = 0;
    sheet[SLOPE].fill(0);
    sheet[SLOPE][GAP] = scale;
    sheet[UNITS][CONTACTS] = 1;
    this.start = [...this.problem.unknowns(states, instants), orbit.parameters.gap / scale];
    const grip = Math.abs(orbit.parameters.friction * orbit.parameters.gravity);
    const single = constants.harmonics === 1 || !numbers.slice(FIRST_LINE + 3).some((value, n) => n % 3 === 0 && value);
    /** The theory of impacts follows its solutions through, where it holds. */
    this.inOrder = nodes.length === orbit.stops.length && single && within_theory(grip, this.problem.stops);
  }

  point(row) {
    const { width } = this.problem;
    const [place, tangent] = [0, width].map((from) => row.subarray(COORDINATES + from, COORDINATES + from + width));
    let gap = place[width - 1] * this.scale;
    for (const end of this.range) if (Math.abs(gap - end) <= 1e-12 * this.scale) gap = end;
    return { curve: this, row, place, tangent, gap, viable: row[VIABLE] > 0, x_max: row[X_MAX], multipliers: multipliersOfMap(row.subarray(MAP), row[SIZE]) };
  }

  /** The point of the curve in the plane through a guess, or null. */
  correct(guess, normal) {
    const { sheet, width } = this.problem;
    sheet[NORMAL].set(normal);
    sheet[GUESS].set(guess);
    if (!this.problem.compute(CORRECT, this.inOrder, ENOUGH, 0)[0]) return null;
    const row = new Float64Array(COORDINATES + 2 * width);
    row.set(sheet[MARKS].slice(0, KIND));
    row.set(sheet[PLACE].slice(0, width), COORDINATES);
    row.set(sheet[TANGENT].slice(0, width), COORDINATES + width);
    return this.point(row);
  }

  atGap(gap, upwards, guess = this.start) {
    const there = gap / this.scale;
    return this.correct([...guess.slice(0, -1), there], [...new Array(guess.length - 1).fill(0), Math.sign(upwards) || 1]);
  }

  traceOf(rows) { return rowsOf(rows + 2 * SPARE, COORDINATES + 2 * this.problem.width); }

  /** Points ahead, why they end, and the next step. */
  stepsFrom(here, step, most) {
    const trace = this.traceOf(Math.min(ROWS_OF_TRACE, most));
    trace[0].set(here.row);
    last(trace).set([step, LARGEST_STEP, 1]);
    const [ended, final] = this.problem.compute(GO_ON, this.inOrder, ...this.range.map((gap) => gap / this.scale), trace);
    return { points: trace.slice(1, final + 1).map((row) => this.point(row)), ended, step: last(trace)[0] };
  }

  /** The special points between two points. */
  between(here, there) {
    const trace = this.traceOf(1);
    trace[0].set(here.row);
    trace[1].set(there.row);
    const [, final] = this.problem.compute(LOCATE, this.inOrder, 0, 0, trace);
    return trace.slice(1, final).map((row) => this.point(row));
  }

  solutionAt(point) {
    this.correct(point.place, point.tangent);
    return this.problem.solution(this.parameters.replace({ gap: point.gap }));
  }

  /** A guess without the two closest events of a point; null if it needs them. */
  withoutMeeting(point) {
    const { table, states, instants } = this.solutionAt(point);
    const { nodes } = this.problem;
    const spans = table.map((row) => row[SPAN]);
    const first = spans.indexOf(Math.min(...spans));
    const pair = [first, (first + 1) % nodes.length];
    if (pair.some((n) => nodes[n].kind === EventKind.IMPACT) || nodes.at(first - 1).mode !== nodes[pair[1]].mode) return null;
    const left = (list_) => list_.filter((_, n) => !pair.includes(n));
    return { nodes: left(nodes), states: left(states.tolist()), instants: left(instants.tolist()) };
  }
}

const turns = (one, other) => last(one.tangent) * last(other.tangent) < 0;

/** Whether the multipliers at a located point are those of its kind. */
function isGenuine({ row, multipliers }) {
  const near = row[CONVERGED] > 0 ? GENUINE : GUESSED;
  const kind = row[KIND];
  if (kind === FOLD || kind === VIABLE) return true;
  const modulus = ([re, im]) => Math.hypot(re, im);
  // Round-off of the largest one hides the others
  if (modulus(multipliers[0]) > POLE) return false;
  if (kind === TORUS) return multipliers.some((one) => Math.abs(modulus(one) - 1) < near && one[1] !== 0);
  const to = kind === DOUBLING ? -1 : 1;
  return multipliers.some(([re, im]) => modulus([re - to, im]) < near);
}

/** The points of a curve that belong to it, and the special ones among them; see `continuation`. */
function withSpecial(points, change = null) {
  const [kept, special] = [[], []];
  for (const point of points) {
    const kind = point.row[KIND];
    if (kind in KINDS) {
      const turning = change !== null && turns(...change);
      if (!isGenuine(point) || (change && !point.viable) || (turning && kind === FOLD)) continue;
      special.push({ point, kind: turning && kind === VIABLE ? 'fold' : KINDS[kind] });
    }
    if (kind === BETWEEN && !(special.length && last(kept) === last(special).point)) continue;
    if (kind !== BEYOND) kept.push(point);
  }
  return { kept, special };
}

/** The motion with other nodes that the rig performs beyond a point, and its curve. */
function freshCurve(curve, here, there) {
  const { range, scale } = curve;
  if (turns(here, there)) {
    const met = curve.between(here, there).find(({ row }) => row[KIND] === FOLD);
    const guess = met && curve.withoutMeeting(met);
    if (!guess) return null;
    const orbit = orbitOf(curve.solutionAt(met));
    const fresh = new SolutionCurve(orbit, range, scale, guess);
    const step = BEYOND_MEETING * distanceOf(there.place, here.place) * scale;
    for (const way of [last(here.tangent), last(there.tangent)]) {
      const again = fresh.atGap(met.gap + Math.sign(way) * step, way);
      if (again?.viable) return { curve: fresh, point: again };
    }
    return null;
  }
  const orbit = orbitOf(curve.solutionAt(there));
  const other = performed(orbit, orbit.parameters);
  if (!other || other.distance(orbit) > 4 * LARGEST_STEP) return null;
  const fresh = new SolutionCurve(other, range, scale);
  const again = fresh.atGap(there.gap, last(there.tangent));
  return again?.viable ? { curve: fresh, point: again } : null;
}

/** Step along a branch until it leaves the range, ends or has enough points. */
function grow(curve, point, mostPoints) {
  const stretches = [[point]];
  const special = [];
  let [here, step, count, ended] = [point, FIRST_STEP, 1, ''];
  while (!ended && count < mostPoints) {
    const ahead = curve.stepsFrom(here, step, mostPoints - count);
    const beyond = ahead.ended === NOT_VIABLE ? ahead.points.pop() : null;
    here = last(ahead.points) ?? here;
    step = ahead.step;
    count += ahead.points.filter(({ row }) => row[KIND] === ORDINARY).length;
    const located = withSpecial(ahead.points);
    last(stretches).push(...located.kept);
    special.push(...located.special);
    if (ahead.ended === LOW_END || ahead.ended === HIGH_END) ended = 'end';
    else if (ahead.ended === LOST) ended = 'lost';
    if (!beyond) continue;
    const fresh = freshCurve(curve, here, beyond);
    if (!fresh) {
      step *= 0.5;
      ended = step < LEAST_STEP * LARGEST_STEP ? 'lost' : '';
      continue;
    }
    const more = withSpecial(curve.between(here, beyond), [here, fresh.point]);
    last(stretches).push(...more.kept);
    special.push(...more.special);
    ({ curve, point: here } = fresh);
    stretches.push([here]);
    count += 1;
    step = FIRST_STEP;
    if (!(curve.range[0] < here.gap && here.gap < curve.range[1])) ended = 'end';
  }
  return { stretches, points: stretches.flat(), special, began: '', ended: ended || 'points' };
}

const reversed_ = ({ stretches, points, special, ended, began }) => ({
  stretches: stretches.map((one) => [...one].reverse()).reverse(), points: [...points].reverse(), special: [...special].reverse(), ended: began, began: ended,
});
/** A branch and the one that goes on from its last point. */
const extended = (one, other) => ({
  stretches: [...one.stretches, ...other.stretches], points: [...one.points, ...other.points.slice(1)], special: [...one.special, ...other.special], began: one.began, ended: other.ended,
});

/** Follow a motion in both directions over a range of gaps. */
function follow(orbit, low, high, mostPoints) {
  const { gap } = orbit.parameters;
  const curve = new SolutionCurve(orbit, [low, high], Math.max(Math.abs(gap), 0.2 * (high - low)));
  const [down, up] = [-1, 1].map((way) => curve.atGap(gap, way)).map((point) => (point ? grow(curve, point, mostPoints) : null));
  if (down && up) return extended(reversed_(down), up);
  return down ?? up;
}

/** The branch of a motion over the gap; further where M moves least at an end. */
class GapBranch {
  constructor(start, branch, points) {
    Object.assign(this, { start, branch, mostPoints: points });
    this.points = branch.points;
    this.label = nameOf(start);
  }

  static of(orbit, points = MOST_POINTS) {
    const { gap } = orbit.parameters;
    const branch = follow(orbit, gap / SPAN_OF_GAPS, gap * SPAN_OF_GAPS, points);
    let one = branch && new GapBranch(orbit, branch, points);
    for (let n = 0; one?.bound && points === MOST_POINTS && n < MOST_FURTHER; n += 1) one = one.further();
    return one;
  }

  /** The stable motion with the least |X|, refined between its neighbours; null if there is none. */
  get best() {
    if (this._best !== undefined) return this._best;
    const kept = this.points.filter(isKept);
    if (!kept.length) return (this._best = null);
    let best = kept.reduce((one, other) => (other.x_max < one.x_max ? other : one));
    const sides = [];
    for (const stretch of this.branch.stretches) stretch.forEach((point, n) => { if (n && [stretch[n - 1], point].every(isKept) && [stretch[n - 1], point].includes(best)) sides.push([stretch[n - 1], point]); });
    const sizeAt = (share) => {
      const [start, end] = sides[Math.min(sides.length - 1, Math.floor(share))];
      const chord = [...end.place].map((value, n) => value - start.place[n]);
      const length = Math.hypot(...chord);
      const point = length ? end.curve.correct([...start.place].map((value, n) => value + (share % 1) * chord[n]), chord.map((value) => value / length)) : null;
      if (!point || !isKept(point)) return Infinity;
      if (point.x_max < best.x_max) best = point;
      return point.x_max;
    };
    if (sides.length) leastBetween(sizeAt, 0, sides.length);
    return (this._best = best);
  }

  /** Where the best gap is if M moves least at an end: 'at least' there, or 'at most'. */
  get bound() {
    const { best, points, branch } = this;
    const [first, final] = [points[0], last(points)];
    if (!best || points.length < 2 || ![first, final].includes(best)) return '';
    if (!['end', 'points'].includes(best === first ? branch.began : branch.ended)) return '';
    return best.gap > (best === first ? points[1] : points.at(-2)).gap ? 'at least' : 'at most';
  }

  further() {
    const { best, start, branch, points } = this;
    const [low, high] = this.bound === 'at least' ? [best.gap, 2 * best.gap] : [best.gap / 2, best.gap];
    const orbit = orbitOf(best.curve.solutionAt(best));
    let beyond = follow(orbit, low, high, MOST_POINTS);
    if (!beyond) return new GapBranch(start, { ...branch, began: '', ended: '' }, MOST_POINTS);
    if (high === best.gap) beyond = reversed_(beyond);
    const whole = best === points[0] ? reversed_(extended(reversed_(branch), beyond)) : extended(branch, beyond);
    return new GapBranch(start, whole, MOST_POINTS);
  }

  /** Whether a motion, or its mirror image, is on the branch. */
  holds(orbit) {
    const { gap } = orbit.parameters;
    if (this.label !== nameOf(orbit)) return false;
    return this.branch.stretches.some((stretch) => stretch.some((end, n) => {
      const start = stretch[n - 1];
      if (!n || (start.gap - gap) * (end.gap - gap) > 0 || start.gap === end.gap) return false;
      const share = (gap - start.gap) / (end.gap - start.gap);
      const there = end.curve.atGap(gap, end.gap - start.gap, [...start.place].map((value, k) => value + share * (end.place[k] - value)));
      return there !== null && Math.abs(there.x_max - orbit.x_max) <= SAME * orbit.x_max;
    }));
  }
}

/** Look for the least value of a function by golden sections. */
function leastBetween(value, low, high) {
  const share = 0.5 * (Math.sqrt(5) - 1);
  let [a, b] = [high - share * (high - low), low + share * (high - low)];
  let [there, other] = [value(a), value(b)];
  while (high - low > 1e-6) {
    if (there < other) {
      [high, b, other] = [b, a, there];
      a = high - share * (high - low);
      there = value(a);
    } else {
      [low, a, there] = [a, b, other];
      b = low + share * (high - low);
      other = value(b);
    }
  }
}

// Documents, as `theory.documents` describes them

const nameOf = ({ stops, cycles }) => `${plural(stops.length, 'impact')} in ${plural(cycles, 'cycle')}`;
const orNull = (value) => (Number.isFinite(value) ? value : null);
const summary = (orbit) => ({
  stable: isStable(orbit), viable: orbit.viable, reason: orbit.reason, x_max: orbit.x_max, x_max_ratio: orNull(orbit.x_max_ratio), multipliers: orbit.multipliers, label: nameOf(orbit),
});

/** One period of a motion from just after its first impact: rows of phase, X, X', Y and Y', both sides of each event. */
function periodOf(orbit) {
  const rig = after_impact(orbit, orbit.parameters);
  const events = eventsUntil(rig, orbit.period) ?? [];
  const perSecond = Math.min(250, 1500 / orbit.cycles) / orbit.cycle;
  const again = after_impact(orbit, orbit.parameters);
  const row = ({ time, x, primary_velocity: v, z, damper_velocity: w }) => [time, x, v, z - x, w - v];
  const side = (e, word) => row({ time: e.time, x: e.x, primary_velocity: e[`primary_velocity_${word}`], z: e.x + e.y, damper_velocity: e[`damper_velocity_${word}`] });
  const rows = [];
  let after = row(again.sample());
  for (const event of [...events, null]) {
    const [from, to] = [after[0], event?.time ?? orbit.period];
    const count = Math.ceil((to - from) * perSecond - 1e-9);
    rows.push(after);
    for (let k = 1; k < count; k += 1) {
      again.advance(from + ((to - from) / count) * k);
      rows.push(row(again.sample()));
    }
    if (event) rows.push(side(event, 'before'));
    else if (count) { again.advance(orbit.period); rows.push(row(again.sample())); }
    if (event) after = side(event, 'after');
  }
  return rows.map(([time, ...rest]) => [orbit.phases[0] + time / orbit.cycle, ...rest]);
}

/** The document of the motion that is expected, with one period of it from the zero of the force on. */
function orbitDocument({ expected, basis = '', reason = '', kind = '', complete = false, orbits, zero }) {
  const message = { type: 'orbit', found: expected !== null, text: reason, kind, complete, others: orbits.filter((one) => one !== expected).map(summary) };
  if (!expected) return message;
  const { phases, x, stops, primary_velocity_after: velocities, damper_velocity_after: dampers, cycles, cycle } = expected;
  Object.assign(message, summary(expected), {
    cycles, stops: [...stops], period: expected.period, basis,
    impacts: phases.map((phase, n) => ({ phase, x: x[n], stop: stops[n], velocity_after: velocities[n], damper_velocity_after: dampers[n] })),
  });
  if (!expected.viable) return message;
  const rows = periodOf(expected);
  const turn = rows.findIndex(([phase]) => phase >= cycles);
  const cut = turn < 0 ? rows.length : turn;
  const turned = [...rows.slice(cut).map(([phase, ...rest]) => [phase - cycles, ...rest]), ...rows.slice(0, cut)];
  const phase = [];
  for (const [one] of turned) phase.push(Math.max(one, last(phase) ?? -Infinity));
  const column = (value) => turned.map(value);
  return Object.assign(message, {
    t_zero: zero, t: phase.map((one) => one * cycle), phase,
    x: column((row) => row[1]), z: column((row) => row[1] + row[3]), y: column((row) => row[3]), relative_velocity: column((row) => row[4]),
  });
}

/** The branches of Xmax/A over the gap that are known so far. */
class GapCurve {
  constructor(parameters) {
    Object.assign(this, { parameters, branches: [], here: null });
    this.amplitude = parameters.x_max_ratio(1);
  }

  /** Follow a motion, unless its branch is known; return whether it was. */
  follow(start) {
    if (this.branches.length >= MOST_BRANCHES || this.branches.some((one) => one.start === start || one.holds(start))) return false;
    const branch = GapBranch.of(start);
    if (branch) this.branches.push(branch);
    return branch !== null;
  }

  message(text = '') {
    const ratio = (point) => point.x_max * this.amplitude;
    const bests = this.branches.flatMap(({ best, bound }) => (best ? [{ gap: best.gap, x_max_ratio: ratio(best), bound }] : []));
    return {
      type: 'gap_curve', gap: this.parameters.gap, x_max_ratio: this.here ? orNull(this.here.x_max_ratio) : null,
      branches: this.branches.map(({ label, points }) => ({
        label, gap: points.map(({ gap }) => gap), x_max_ratio: points.map(ratio), stable: points.map(isStable), viable: points.map(({ viable }) => viable),
      })),
      special: this.branches.flatMap(({ branch }) => branch.special.filter(({ point }) => point.viable).map(({ point, kind }) => ({ gap: point.gap, x_max_ratio: ratio(point), kind, stable: isStable(point) }))),
      optimum: bests.length ? bests.reduce((one, other) => (other.x_max_ratio < one.x_max_ratio ? other : one)) : null,
      text: text || (this.branches.length ? '' : 'no periodic motion can be followed'),
    };
  }
}

/**
 * What theory says of a rig, in documents of rising quality; null is yielded where other work may come between.
 *
 * A rig is given by parameters, what moves its stops, and its state: run and angles of the harmonics; `before` is a
 * motion of a rig like it.
 */
function* theoryOf({ parameters, control, run, angles, before = null }) {
  const document_ = { time: run.now, orbit: null, gap_curve: null, theory_failed: null };
  const failed = (text) => ({ ...document_, theory_failed: { type: 'theory_failed', text } });
  if (control !== 'off') {
    yield failed(`gap_control is ${control}: theory is for stops that do not move`);
    return null;
  }
  let cycles = 0;
  try {
    cycles = period_of_force(parameters, LONGEST_FORCE);
  } catch (error) {
    if (!(error instanceof Exception)) throw error;
    yield failed(error.message);
    return null;
  }
  const frequency = parameters.first_harmonic[1];
  const zero = run.time + run.time_low - $modulo(angles[0], 2 * Math.PI) / frequency;
  const rig = counted_from_zero(parameters, angles);
  const curve = new GapCurve(rig);
  const orbits = [];
  const prediction = { expected: null, orbits, zero, basis: '', reason: '', kind: '' };
  const show = () => {
    curve.here = prediction.expected;
    document_.orbit = orbitDocument(prediction);
    if (!rig.one_sided && prediction.expected) curve.follow(prediction.expected);
    if (curve.branches.length) document_.gap_curve = curve.message();
    return { ...document_, expected: prediction.expected };
  };
  // A motion near the last one is the quickest answer, then what the theory of impacts has.
  const moved = before && before.parameters.one_sided === rig.one_sided ? solve_orbit(rig, before.guess, before.cycles) : null;
  if (moved) addTo(orbits, moved);
  else for (const orbit of orbitsOfTheory(rig, cycles)) addTo(orbits, orbit);
  if (orbits[0]?.viable) {
    Object.assign(prediction, { expected: orbits[0], basis: 'listed' });
    yield show();
  } else yield document_;
  if (moved) {
    for (const orbit of orbitsOfTheory(rig, cycles)) {
      addTo(orbits, orbit);
      yield null;
    }
  }
  const ahead = yield* settle(continued(new Rig(rig), run, angles), MOST_CYCLES_AHEAD);
  const quick = prediction.expected;
  const reached = ahead.orbit && addTo(orbits, ahead.orbit);
  Object.assign(prediction, { expected: reached ?? (orbits[0]?.viable ? orbits[0] : null), reason: reached ? '' : ahead.reason, kind: reached ? 'periodic' : ahead.kind ?? '' });
  prediction.basis = reached ? 'run ahead' : prediction.expected ? 'listed' : '';
  if (prediction.expected !== quick || !reached) yield show();
  for (const start of startingRigs(rig)) {
    const other = yield* settle(start, MOST_CYCLES_ELSEWHERE);
    if (other.orbit) addTo(orbits, other.orbit);
  }
  prediction.complete = true;
  document_.orbit = orbitDocument(prediction);
  for (const orbit of rig.one_sided ? [] : orbits) {
    if (curve.follow(orbit)) document_.gap_curve = curve.message();
    yield null;
  }
  document_.gap_curve = rig.one_sided ? curve.message('a one-sided rig has no gap') : curve.message();
  yield { ...document_, expected: prediction.expected };
  return null;
}
