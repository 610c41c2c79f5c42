"""What is measured of the steady part of a stretch."""

from __future__ import annotations

import math

import numpy as np

from .cubic import cubic_swing
from .flight_check import Knots, knots_of
from .force_clock import ForceClock
from .recorded_stretch import RecordedImpacts, RecordedStretch
from .recurrence import Recurrence
from .run_curves import Array
from .stretch_measures import ImpactStates, MeasuredMotion

__all__ = ['knots_between', 'last_period', 'measured_motion', 'period_end']


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
    """
    Measure a part of a stretch, as far as it was kept.

    Parameters
    ----------
    stretch : RecordedStretch
        The stretch.
    start, end : float
        The part, rig time, s.
    period : ImpactStates, optional
        The last period, if the motion has one.
    per_cycle : float, optional
        Impacts per cycle of the force, if known; counted otherwise.
    """
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
    """
    Return the impacts of a period.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    impacts : RecordedImpacts
        The impacts that repeat.
    recurrence : Recurrence
        How they do.
    end : int
        Index after the last impact of the period.
    """
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
