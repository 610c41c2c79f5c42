"""Random flights, and flights that graze a stop or a zero of the relative velocity on purpose."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oracle.bracketed_root import bracketed_root
from oracle.flight_cases import (
    EPS,
    REAL,
    Array,
    FlightCases,
    closed_form,
    precise,
    taylor_derivatives,
    taylor_series,
)

HARMONICS = 3
SAMPLES = 240


def log_uniform(
    rng: np.random.Generator, low: float, high: float, size: int | tuple[int, ...]
) -> Array:
    """Return numbers whose logarithm is uniform between those of low and high."""
    return np.asarray(10.0 ** rng.uniform(np.log10(low), np.log10(high), size))


def signed(rng: np.random.Generator, magnitude: Array) -> Array:
    """Return the magnitudes with random signs."""
    return np.asarray(magnitude * rng.choice([-1.0, 1.0], magnitude.shape))


def random_flights(n: int, rng: np.random.Generator) -> FlightCases:
    """
    Return flights over wide ranges of everything.

    omega0 1e-2..1e3, damping ratio 0..0.99, one to three harmonics from exact resonance to
    frequency ratios of 1e-2..1e2, displacements 1e-6..1e3, starts on either stop, in the gap, and
    just released (Y' = Y'' = 0).
    """
    omega = log_uniform(rng, 1e-2, 1e3, n)
    size = log_uniform(rng, 1e-6, 1e3, n)
    pick = rng.random(n)
    zeta = np.where(pick < 0.5, log_uniform(rng, 1e-6, 0.99, n), rng.uniform(0, 0.99, n))
    zeta[pick < 0.1] = 0.0
    pick = rng.random((n, HARMONICS))
    ratio = log_uniform(rng, 1e-2, 1e2, (n, HARMONICS))
    near = 1 + signed(rng, log_uniform(rng, 1e-12, 1e-1, (n, HARMONICS)))
    ratio = np.where(pick < 0.25, near, ratio)
    ratio[pick < 0.1] = 1.0
    force = signed(rng, log_uniform(rng, 1e-3, 1e2, (n, HARMONICS)))
    number = rng.choice([1, 1, 1, 1, 2, 3], n)
    force[np.arange(HARMONICS) >= number[:, None]] = 0.0
    length, speed, pull = size, omega * size, omega**2 * size

    def some(low: float, high: float, share: float) -> Array:
        values = signed(rng, log_uniform(rng, low, high, n))
        return np.asarray(np.where(rng.random(n) < share, values, 0.0))

    half_gap = length * log_uniform(rng, 1e-3, 1e2, n)
    cases = FlightCases(
        omega0=omega,
        zeta=zeta,
        x0=length * some(1e-4, 1, 0.85),
        v0=speed * some(1e-4, 1, 0.85),
        y0=half_gap * rng.uniform(-1, 1, n),
        w0=speed * signed(rng, log_uniform(rng, 1e-6, 10, n)),
        half_gap=half_gap,
        gz=pull * some(1e-4, 10, 0.6),
        force_acc=pull[:, None] * force,
        force_freq=omega[:, None] * ratio,
        force_phase0=rng.uniform(0, 2 * np.pi, (n, HARMONICS)),
        const_acc=pull * some(1e-4, 1, 0.5),
        one_sided=rng.random(n) < 0.2,
        watch_reversal=rng.random(n) < 0.4,
    )
    start = rng.random(n)
    _put_on_stop(cases, start < 0.5, rng)
    _release(cases, start > 0.88, rng)
    cases.slide = cases.leading_sign()
    cases.horizon = log_uniform(rng, 0.1, 40, n) * 2 * np.pi / cases.fastest
    return cases


def _put_on_stop(cases: FlightCases, chosen: Array, rng: np.random.Generator) -> None:
    """Start the chosen flights just after an impact, moving inwards."""
    stop = np.where(cases.one_sided | (rng.random(len(cases)) < 0.5), 1, -1)
    cases.y0[chosen] = (stop * cases.half_gap)[chosen]
    cases.w0[chosen] = (-stop * np.abs(cases.w0))[chosen]


def _release(cases: FlightCases, chosen: Array, rng: np.random.Generator) -> None:
    """Start the chosen flights with Y' = Y'' = 0, in the gap or on the stop they leave."""
    cases.w0[chosen] = 0.0
    y = taylor_derivatives(cases, 4)
    # In 80 bits: rounding gz itself is the only error left in Y''.
    cases.gz[chosen] = (cases.gz - y[2])[chosen].astype(float)
    jerk = np.sign(y[3]).astype(float)
    on_stop = chosen & (rng.random(len(cases)) < 0.5) & ~(cases.one_sided & (jerk > 0))
    cases.y0[on_stop] = (-jerk * cases.half_gap)[on_stop]
    cases.watch_reversal[chosen & (rng.random(len(cases)) < 0.5)] = True


def first_extrema(cases: FlightCases, order: int, sign: Array, skip: Array) -> tuple[Array, Array]:
    """
    Return time and index of an interior maximum of sign * S (order 0) or sign * Y' (order 1).

    Only running maxima count: those above all that came before.  `skip` (in 0..1) picks one of
    them.  Flights without any are left out.
    """
    times, rows = [], []
    for index, t, values in _sampled(cases):
        f, slope = (sign[index, None] * values[k] for k in (order, order + 1))
        top = np.maximum.accumulate(f, axis=1)
        peak = (slope[:, :-1] > 0) & (slope[:, 1:] < 0) & (f[:, :-1] >= top[:, :-1])
        if order == 0:
            peak &= f[:, :-1] > 0
        count = peak.sum(axis=1)
        wanted = np.floor(skip[index] * count).astype(int) + 1
        i, j = np.nonzero((np.cumsum(peak, axis=1) == wanted[:, None]) & peak)
        times.append(_polish_extremum(cases, index[i], t[i, j], t[i, j + 1], order))
        rows.append(index[i])
    return np.concatenate(times), np.concatenate(rows)


def _sampled(cases: FlightCases) -> Iterator[tuple[Array, Array, tuple[Array, Array, Array]]]:
    """Yield the flights in groups, as indices, sample times and S, Y', Y'' at these."""
    number = (cases.force_acc != 0).sum(axis=1)
    length = np.minimum(cases.horizon, 50.0 / cases.fastest)
    for count in range(1, HARMONICS + 1):
        group = np.flatnonzero(number == count)
        for k in range(0, len(group), 250):
            index = group[k : k + 250]
            t = length[index, None] * np.arange(1, SAMPLES + 1) / SAMPLES
            yield index, t, closed_form(cases.take(index).active(count), t)


def _polish_extremum(
    cases: FlightCases, index: Array, low: Array, high: Array, order: int
) -> Array:
    """Return where Y' (order 0) or Y'' (order 1) vanishes between two times."""
    chosen = cases.take(index)
    every, series = np.arange(len(index)), taylor_series(chosen)
    sign = -np.sign(precise(chosen, every, low, series)[order + 1])

    def slope(rows: Array, t: Array) -> Array:
        return np.asarray(sign[rows] * precise(chosen, rows, t, series)[order + 1])

    return bracketed_root(slope, every, low, high, 1e-12)


def near_grazing_flights(n: int, rng: np.random.Generator) -> FlightCases:
    """
    Return flights built to be hard, in random order.

    - An extremum of Y passes a stop by +-delta, relative, log-uniform 1e-15..1e-2: the far stop
      (by the gap), the stop the flight left (by its rebound speed), from within the gap.
      Where it passes beyond, there are two close roots.
    - Y' touches zero in the same way, with friction.
    - Rebound speeds of 1e-12..1e-3 of omega0 times the displacement.
    - A start on a stop, and two more roots close to it and to each other.
    """
    shares = {'far': 0.3, 'own': 0.15, 'gap': 0.15, 'friction': 0.2, 'tiny': 0.12, 'triple': 0.08}
    parts: list[FlightCases] = []
    missing = n
    makers = {
        'far': _graze_far,
        'own': _graze_own,
        'gap': _graze_gap,
        'friction': _graze_velocity,
        'tiny': _tiny_rebound,
        'triple': _three_roots,
    }
    while missing > 0:
        for name, share in shares.items():
            count = max(8, int(missing * share * 1.7))
            parts.append(makers[name](random_flights(count, rng), rng))
        missing = n - sum(len(part) for part in parts)
    every = FlightCases.join(parts)
    cases = every.take(rng.permutation(len(every))[:n])
    cases.slide = np.where(cases.w0 != 0, np.sign(cases.w0), cases.slide).astype(np.int8)
    return cases


def _delta(rng: np.random.Generator, n: int) -> Array:
    return signed(rng, log_uniform(rng, 1e-15, 1e-2, n))


def _graze_far(cases: FlightCases, rng: np.random.Generator) -> FlightCases:
    """From one stop to a grazing of the other: the gap is chosen."""
    n = len(cases)
    stop = np.where(rng.random(n) < 0.5, 1.0, -1.0)
    stop[cases.one_sided] = -1.0
    cases.w0 = -stop * np.abs(cases.w0)
    time, rows = first_extrema(cases, 0, -stop, rng.random(n))
    cases, stop = cases.take(rows), stop[rows]
    top = -stop * precise(cases, np.arange(len(cases)), time)[0].astype(float)
    cases.half_gap = top * (1 + _delta(rng, len(cases))) / 2
    cases.y0 = stop * cases.half_gap
    cases.one_sided &= stop > 0
    return cases


def _graze_gap(cases: FlightCases, rng: np.random.Generator) -> FlightCases:
    """From within the gap to a grazing."""
    n = len(cases)
    side = np.where(rng.random(n) < 0.5, 1.0, -1.0)
    side[cases.one_sided] = 1.0
    time, rows = first_extrema(cases, 0, side, rng.random(n))
    cases, side = cases.take(rows), side[rows]
    top = side * precise(cases, np.arange(len(cases)), time)[0].astype(float)
    cases.half_gap = top * log_uniform(rng, 0.51, 20, len(cases))
    cases.y0 = side * (cases.half_gap - top * (1 + _delta(rng, len(cases))))
    return cases


def _graze_own(cases: FlightCases, rng: np.random.Generator) -> FlightCases:
    """From a stop to a grazing of the same stop: the rebound speed is chosen."""
    n = len(cases)
    stop = np.where(rng.random(n) < 0.5, 1.0, -1.0)
    stop[cases.one_sided] = 1.0
    cases.w0 = -stop * np.abs(cases.w0)
    # S / t has an extremum where a line from the start touches S.
    times, rows = [], []
    for index, t, motion in _sampled(cases):
        mean = stop[index, None] * motion[0] / t
        top = np.maximum.accumulate(mean, axis=1)
        inner = mean[:, 1:-1]
        peak = (inner > mean[:, :-2]) & (inner > mean[:, 2:]) & (inner >= top[:, 1:-1])
        i = np.flatnonzero(peak.any(axis=1))
        times.append(t[i, 1 + np.argmax(peak[i], axis=1)].astype(REAL))
        rows.append(index[i])
    time, chosen = np.concatenate(times), np.concatenate(rows)
    cases, stop = cases.take(chosen), stop[chosen]
    index = np.arange(len(cases))
    series = taylor_series(cases)
    for _ in range(6):
        s, u, a = precise(cases, index, time, series)
        step = (u - s / time) / a
        time = time - np.clip(step, -time / 20, time / 20)
    s = precise(cases, index, time)[0]
    line = (s / time).astype(float)
    cases.w0 = (cases.w0 - line) * (1 + _delta(rng, len(cases)))
    good = (stop * cases.w0 < 0) & np.isfinite(line) & (time > 0)
    cases.y0 = stop * cases.half_gap
    return cases.take(good)


def _graze_velocity(cases: FlightCases, rng: np.random.Generator) -> FlightCases:
    """With friction, to where Y' touches zero: w0 is chosen."""
    n = len(cases)
    sign = np.where(rng.random(n) < 0.5, 1.0, -1.0)
    time, rows = first_extrema(cases, 1, sign, rng.random(n))
    cases, sign = cases.take(rows), sign[rows]
    shift = precise(cases, np.arange(len(cases)), time)[1].astype(float)
    cases.w0 = (cases.w0 - shift) * (1 + _delta(rng, len(cases)))
    cases.watch_reversal[:] = True
    # Room enough that Y' comes first more often than not.
    wide = rng.random(len(cases)) < 0.8
    room = 3 * np.abs(cases.w0) * time.astype(float)
    cases.half_gap = np.where(wide, cases.half_gap + room, cases.half_gap)
    start = rng.random(len(cases)) < 0.5
    inside = rng.uniform(-0.99, 0.99, len(cases))
    cases.y0 = cases.half_gap * np.where(start, -np.sign(cases.w0), inside)
    cases.one_sided &= cases.y0 != -cases.half_gap
    return cases.take(cases.w0 != 0)


def _tiny_rebound(cases: FlightCases, rng: np.random.Generator) -> FlightCases:
    """Off a stop with next to no speed, pressed back to it or not."""
    n = len(cases)
    size = np.abs(cases.x0) + cases.half_gap
    cases.w0 = cases.omega0 * size * log_uniform(rng, 1e-12, 1e-3, n)
    _put_on_stop(cases, np.ones(n, dtype=bool), rng)
    _balance(cases, rng.random(n) < 0.4, rng)
    return cases


def _balance(cases: FlightCases, chosen: Array, rng: np.random.Generator) -> None:
    """Make Y'' at the start small for the chosen flights: 1e-10..1e-1 of its terms."""
    y = taylor_derivatives(cases, 4)
    left = signed(rng, log_uniform(rng, 1e-10, 1e-1, len(cases))) * cases.strength
    cases.gz = np.where(chosen, (cases.gz - y[2] + left).astype(float), cases.gz)


def _three_roots(cases: FlightCases, rng: np.random.Generator) -> FlightCases:
    """On a stop with roots t1 and t1 (1 + delta) soon after the start."""
    n = len(cases)
    y = taylor_derivatives(cases, 4)
    jerk = y[3].astype(float)
    stop = -np.sign(jerk)
    keep = (jerk != 0) & ~(cases.one_sided & (stop < 0))
    cases, jerk, stop = cases.take(keep), jerk[keep], stop[keep]
    n = len(cases)
    first = log_uniform(rng, 1e-7, 10**-1.5, n) / cases.fastest
    second = first * (1 + log_uniform(rng, 1e-8, 10, n))
    cases.w0 = jerk * first * second / 6
    y = taylor_derivatives(cases, 4)
    cases.gz = (cases.gz - y[2] - jerk * (first + second) / 3).astype(float)
    cases.y0 = stop * cases.half_gap
    # Y'' cannot be set better than its round-off; where that rules, it is a different flight.
    good = np.abs(jerk) * first > 1e2 * EPS * cases.strength
    return cases.take(good)
