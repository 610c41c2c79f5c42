"""
The steady part of a stretch: its last period, the prediction, and the approach to it.

Near the periodic motion the state at impact one period later is a linear function of the one
before. Its largest eigenvalue is measured by dynamic mode decomposition (Schmid, J. Fluid Mech.
656, 2010) of the differences of successive periods, each scaled to the same size, so that nothing
of the theory enters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impact_damper_ros.orbits.recognition import SETTLED, ImpactTable, Recurrence

from .flight_check import Knots, knots_of
from .matched_orbit import MatchedOrbit, impact_table, match_orbit, state_row
from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStretch
from .run_comparison import Decay, Finding, ImpactStates, MeasuredMotion
from .run_curves import Array, Convergence, cubic_swing
from .stretch_kind import StretchKind

__all__ = [
    'DecayRate',
    'PeriodicPart',
    'decay_rate',
    'distances_to',
    'knots_between',
    'last_period',
    'measured_motion',
    'period_end',
    'period_states',
    'periodic_part',
]


def knots_between(stretch: RecordedStretch, start: float, end: float) -> Knots:
    """Return joint states and impacts of a part of a stretch, as far as they were kept, s."""
    states, impacts = stretch.states, stretch.impacts
    if len(states):
        start = max(start, float(states.time[0]))
    states = states[(states.time >= start) & (states.time <= end)]
    impacts = impacts[(impacts.time >= start) & (impacts.time <= end)]
    return knots_of(stretch.parameters, states, impacts, stretch.stop_before(start))


def _swing(stretch: RecordedStretch, knots: Knots) -> tuple[float, float]:
    """Return the largest |X|, also between the knots, and the rms of X where none is missing."""
    largest = float(np.abs(knots.x).max(initial=0.0))
    begin, end = knots[:-1], knots[1:]
    starts, ends = np.array(stretch.gaps).reshape(-1, 2).T
    # None before the first gap: the place -1 is of an end before all times.
    last = np.searchsorted(starts, begin.time, side='right') - 1
    missing = end.time <= np.append(ends, -math.inf)[last]
    used = (end.time > begin.time) & ~missing
    begin, end = begin[used], end[used]
    step = end.time - begin.time
    swing = cubic_swing(step, begin.x, end.x, begin.velocity * step, end.velocity_before * step)
    covered = float(step.sum())
    known = len(stretch.states) > 0 and covered > 0.0
    rms = math.sqrt(swing.squares / covered) if known else math.nan
    return max(largest, swing.largest), rms


def measured_motion(
    stretch: RecordedStretch,
    start: float,
    end: float,
    period: ImpactStates | None = None,
    per_cycle: float = math.nan,
) -> MeasuredMotion:
    """Measure a part of a stretch, as far as it was kept."""
    knots = knots_between(stretch, start, end)
    if len(knots):
        start, end = float(knots.time[0]), float(knots.time[-1])
    hits = knots[knots.stop > 0.0]
    impulse = stretch.parameters.primary_mass * np.abs(hits.velocity - hits.velocity_before)
    largest, rms = _swing(stretch, knots)
    amplitude = stretch.parameters.response_amplitude
    steady = stretch.parameters.sweep_mode == 'off'
    known = steady and 0.0 < amplitude < math.inf
    cycles = (end - start) * stretch.parameters.force_frequencies[0] / math.tau * steady
    if math.isnan(per_cycle) and cycles > 0.0:
        per_cycle = len(hits) / cycles
    return MeasuredMotion(
        start=start,
        end=end,
        x_max=largest,
        x_rms=rms,
        amplitude_ratio=largest / amplitude if known else math.nan,
        impacts=len(hits),
        impacts_per_cycle=per_cycle,
        mean_impulse=float(impulse.mean()) if len(hits) else 0.0,
        largest_impulse=float(impulse.max(initial=0.0)),
        last_period=period,
    )


def period_end(stops: Array, impacts: int) -> int:
    """
    Return the index after the last period to be shown.

    It begins on stop 1 after stop 2, if there is such a place in the last two periods.
    """
    total = len(stops)
    for begin in range(total - impacts, max(total - 2 * impacts, 0), -1):
        if stops[begin] == 1.0 and stops[begin - 1] == 2.0:
            return begin + impacts
    return total


def last_period(
    clock: ForceClock, impacts: RecordedImpacts, recurrence: Recurrence, end: int
) -> ImpactStates:
    """Return the impacts of a period."""
    period = impacts[end - recurrence.impacts : end]
    phases = clock.phase(period.time)
    phases = phases - math.floor(phases[0])
    rig = clock.parameters

    def row(values: Array) -> tuple[float, ...]:
        return tuple(float(value) for value in values)

    return ImpactStates(
        stops=tuple(int(stop) for stop in period.stop),
        phases=row(phases % recurrence.cycles),
        x=row(period.x),
        primary_velocity_before=row(period.velocity_before(rig)),
        primary_velocity_after=row(period.velocity_after),
        damper_velocity_before=row(period.damper_velocity_before(rig)),
        damper_velocity_after=row(period.damper_velocity_after),
        impulse=row(np.abs(period.primary_impulse)),
    )


#: Differences of successive periods between which the decay is measured: the linear regime.
_LINEAR = 5e-3
_NOISE_FLOORS = 300.0
_LEAST_PERIODS = 8
_PERIODS_PER_RANK = 4
_MOST_RANK = 4
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True)
class DecayRate:
    """
    Measured factor by which deviations shrink in a period.

    Attributes
    ----------
    factor : float
        Largest modulus of the eigenvalues; NaN if it could not be measured.
    angle : float
        Angle of that eigenvalue, rad, from 0 to pi.
    start, stop : int
        The periods on which it was measured.
    """

    factor: float
    angle: float
    start: int
    stop: int


def period_states(table: ImpactTable, recurrence: Recurrence, end: int) -> Array:
    """Return the states of the last periods, one row for each, with whole periods taken out."""
    n, k = recurrence.impacts, recurrence.cycles
    begin = len(table) - (len(recurrence.distance) + 1) * n
    count = (end - begin) // n
    rows = slice(end - count * n, end)
    periods = np.arange(count)[:, None]
    phase = table.phase[rows].reshape(count, n) - k * (periods - (count - 1))
    states = table.states[rows].reshape(count, 3 * n)
    return np.hstack([phase, states])


def distances_to(states: Array, reference: Array) -> Array:
    """Return the distance of each period from a reference: the largest difference."""
    distance: Array = np.abs(states - reference).max(axis=1)
    return distance


def decay_rate(states: Array, floor: float) -> DecayRate:
    """Measure the decay of the differences of successive periods."""
    steps = np.diff(states, axis=0)
    sizes = np.abs(steps).max(axis=1)
    large = np.flatnonzero(sizes > _LINEAR)
    start = int(large[-1]) + 1 if len(large) else 0
    largest_later = np.maximum.accumulate(sizes[::-1])[::-1]
    small = np.flatnonzero(largest_later < _NOISE_FLOORS * floor)
    stop = int(small[0]) if len(small) else len(sizes)
    count = stop - start
    if count < _LEAST_PERIODS:
        return DecayRate(math.nan, math.nan, start, start)
    steps, sizes = steps[start:stop], sizes[start:stop, None]
    before, after = (steps[:-1] / sizes[:-1]).T, (steps[1:] / sizes[:-1]).T
    modes, values, rows = np.linalg.svd(before, full_matrices=False)
    rank = min(_MOST_RANK, max(1, count // _PERIODS_PER_RANK))
    rank = int(min(rank, (values > _NEGLIGIBLE * values[0]).sum()))
    modes, values, rows = modes[:, :rank], values[:rank], rows[:rank]
    map_ = modes.T @ after @ rows.T / values
    eigenvalue = max(np.linalg.eigvals(map_), key=abs)
    return DecayRate(float(abs(eigenvalue)), float(abs(np.angle(eigenvalue))), start, stop)


#: Periods shown, at most, and after the stamps hide all that is left.
_MOST_SHOWN_PERIODS, _PERIODS_BEYOND = 4000, 60
_HIDDEN = 3.0
#: How much farther than its own bound the run may be from the motion it approaches.
_MARGIN = 3.0
_FLOORS = 5.0
_SOLVED = 1e-9
_DIFFERENT = 1e-3


@dataclass(frozen=True)
class PeriodicPart:
    """
    What is known of a motion that repeats.

    Attributes
    ----------
    period : ImpactStates
        Its last period.
    time : float
        Instant of the first impact of that, rig time, s.
    match : MatchedOrbit
        The predicted motion.
    decay : DecayRate
        The measured decay.
    times, distances : ndarray of shape (p,)
        Beginning of each period, s, and its distance from the predicted motion; from the last
        period, if there is no prediction.
    allowed : float
        Distance of the last period that the remaining transient and the stamps account for.
    settled_at : float or None
        Instant from which the distance is less than `SETTLED`, s.
    table : ImpactTable
        What scales the states.
    recurrence : Recurrence
        How the motion repeats.
    """

    period: ImpactStates
    time: float
    match: MatchedOrbit
    decay: DecayRate
    times: Array
    distances: Array
    allowed: float
    settled_at: float | None
    table: ImpactTable
    recurrence: Recurrence

    @property
    def predicted_factor(self) -> float:
        """Largest modulus of the multipliers; NaN without a prediction."""
        orbit = self.match.orbit
        return abs(orbit.multipliers[0]) if orbit is not None else np.nan

    def as_decay(self) -> Decay:
        """Return measured against predicted decay."""
        return Decay(
            measured=self.decay.factor,
            predicted=self.predicted_factor,
            periods=self.decay.stop - self.decay.start,
            distance=float(self.distances[-1]),
            floor=self.table.floor,
        )

    def as_curve(self) -> Convergence:
        """Return the way to the periodic motion, for a plot."""
        hidden = np.flatnonzero(self.distances < _HIDDEN * self.table.floor)
        last = min(
            int(hidden[0]) + _PERIODS_BEYOND if len(hidden) else _MOST_SHOWN_PERIODS,
            _MOST_SHOWN_PERIODS,
        )
        return Convergence(
            time=self.times[:last],
            distance=self.distances[:last],
            floor=self.table.floor,
            fitted_from=min(self.decay.start, last),
            fitted_to=min(self.decay.stop, last),
            measured=self.decay.factor,
            predicted=self.predicted_factor,
        )

    def differences(self) -> list[Finding]:
        """Return what differs most between the last period and the predicted one."""
        orbit = self.match.orbit
        if orbit is None or orbit.impacts != len(self.period.stops):
            return []
        found = []
        late = round(self.period.phases[0] - orbit.phases[0])
        groups = (
            ('phase', 'cycles', self.period.phases, orbit.phases, 1.0),
            ('X', 'm', self.period.x, orbit.x, self.table.length),
            (
                "X' after",
                'm/s',
                self.period.primary_velocity_after,
                orbit.primary_velocity_after,
                self.table.speed,
            ),
            (
                "Z' after",
                'm/s',
                self.period.damper_velocity_after,
                orbit.damper_velocity_after,
                self.table.speed,
            ),
        )
        for name, unit, measured, predicted, size in groups:
            pairs = []
            for a, b in zip(measured, predicted, strict=True):
                off = a - b
                if name == 'phase':
                    off -= late
                    off -= orbit.cycles * round(off / orbit.cycles)
                pairs.append((abs(off) / size, off, b))
            worst = max(range(len(pairs)), key=lambda i: pairs[i][0])
            share, off, expected = pairs[worst]
            if share <= self.allowed:
                continue
            where = f'{name} at impact {worst + 1} (stop {orbit.stops[worst]})'
            found.append(
                Finding(
                    quantity=where,
                    unit=unit,
                    time=self.time,
                    measured=expected + off,
                    expected=expected,
                    tolerance=self.allowed * size,
                    text=(
                        f'{where} is {expected + off:.9g} {unit}, predicted {expected:.9g} '
                        f'{unit}: off by {off:+.4g} {unit}'
                    ),
                )
            )
        return found


def periodic_part(clock: ForceClock, kind: StretchKind, *, predict: bool) -> PeriodicPart:
    """Analyse a motion that repeats."""
    recurrence, impacts = kind.recurrence, kind.impacts
    assert recurrence is not None
    n = recurrence.impacts
    table = impact_table(impacts, clock.zero, clock.cycle)
    end = period_end(table.stop, n)
    rows = period_states(table, recurrence, end)
    period = last_period(clock, impacts, recurrence, end)
    measured = rows[-1].copy()
    whole = np.floor(measured[0])
    measured[:n] -= whole
    if predict:
        match = match_orbit(clock, period, measured, recurrence, table)
    else:
        match = MatchedOrbit(None, np.inf, '')
    reference = rows[-1]
    if match.orbit is not None:
        reference = state_row(match.orbit, table)
        first = reference[0]
        reference[:n] = first + (reference[:n] - first) % recurrence.cycles
        reference[:n] += whole + round(measured[0] - first)
    decay = decay_rate(rows, table.floor)
    distances = distances_to(rows, reference)
    if match.orbit is None:
        distances = distances[:-1] if len(distances) > 1 else distances
    begins = end - n * np.arange(len(rows), 0, -1)
    factor = decay.factor if decay.factor < 1.0 else recurrence.factor
    recent = float(recurrence.distance[-6:].max())
    allowed = _MARGIN * recent / (1.0 - min(factor, 0.999)) + _FLOORS * table.floor + _SOLVED
    far = np.flatnonzero(distances > max(SETTLED, 0.0))
    settled = int(far[-1]) + 1 if len(far) else 0
    times = impacts.time[begins][: len(distances)]
    return PeriodicPart(
        period=period,
        time=float(impacts.time[end - n]),
        match=match,
        decay=decay,
        times=times,
        distances=distances,
        allowed=allowed,
        settled_at=float(times[settled]) if settled < len(times) else None,
        table=table,
        recurrence=recurrence,
    )
