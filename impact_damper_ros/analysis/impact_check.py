"""
Whether the impacts of a log are those of the rig that it names.

Where m is at an impact tells the gap; how fast the masses part, the coefficients of restitution;
and both masses receive the same impulse. None of this needs the motion between the impacts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters

from .recorded_stretch import RecordedImpacts, RecordedStates
from .run_curves import Array
from .stretch_measures import Finding

__all__ = ['gap_findings', 'impulse_findings', 'restitution_findings']

_TOLERANCE = 1e-9
# The relative speed of slower impacts has lost its digits.
_SLOW = 1e-6
_LEAST_IMPACTS = 3


def _last_run(wrong: NDArray[np.bool_]) -> int:
    """Return where the last run of wrong values begins that lasts to the end; else the length."""
    right = np.flatnonzero(~wrong)
    return int(right[-1]) + 1 if len(right) else 0


@dataclass(frozen=True)
class _Place:
    """Where a stop was found to be, from when on, and by what."""

    y: float
    time: float
    seen: str


def _misplaced(
    stop: int,
    expected: float,
    tolerance: float,
    states: RecordedStates,
    impacts: RecordedImpacts,
) -> _Place | None:
    """Return where a stop is at the end of a stretch, if not at the Y expected."""
    at = (states.stop_1 if stop == 1 else states.stop_2) - states.x
    off = np.abs(at - expected) > tolerance
    # A stop that had to give way to m follows it to its place, touching it.
    astray = off & (np.abs(at - (states.z - states.x)) > tolerance)
    hit = impacts.stop == stop
    where, when = (impacts.z - impacts.x)[hit], impacts.time[hit]
    begin = _last_run(np.abs(where - expected) > tolerance)
    count = len(where) - begin
    if count >= _LEAST_IMPACTS:
        later = states.time >= when[begin]
        if not later.any() or astray[later].any() or not off[later].all():
            seen = f'{count} impacts from {when[begin]:.9g} s on are there'
            return _Place(float(np.median(where[begin:])), float(when[begin]), seen)
    first = _last_run(astray)
    if len(at) - first >= _LEAST_IMPACTS:
        time = float(states.time[first])
        seen = f'the joint states show it there from {time:.9g} s on'
        return _Place(float(np.median(at[first:])), time, seen)
    return None


def gap_findings(
    parameters: RigParameters, states: RecordedStates, impacts: RecordedImpacts
) -> Iterator[Finding]:
    """
    Find out whether m hits the stops, and these stand, where the logged gap has them.

    Parameters
    ----------
    parameters : RigParameters
        As logged; no control moves the stops.
    states, impacts : RecordedStates, RecordedImpacts
        What was recorded.
    """
    half = 0.5 * parameters.gap
    length = float(np.abs(np.concatenate([states.x, impacts.x])).max(initial=half))
    tolerance = _TOLERANCE * (half + length)
    sides = ((1, half),) if parameters.one_sided else ((1, half), (2, -half))
    found = {
        stop: place
        for stop, expected in sides
        if (place := _misplaced(stop, expected, tolerance, states, impacts)) is not None
    }
    if not found:
        return
    if len(found) == 2:
        gap = found[1].y - found[2].y
    else:
        gap = half + abs(next(iter(found.values())).y)
    where = ' and '.join(
        f'stop {stop} is at Y = {place.y:.9g} m ({place.seen})' for stop, place in found.items()
    )
    yield Finding(
        quantity='gap',
        unit='m',
        time=min(place.time for place in found.values()),
        measured=gap,
        expected=parameters.gap,
        tolerance=2.0 * tolerance,
        text=f'{where}: a gap of {gap:.9g} m; logged is {parameters.gap:.9g} m',
    )


def restitution_findings(parameters: RigParameters, impacts: RecordedImpacts) -> Iterator[Finding]:
    """Find out whether the masses part as fast as the logged coefficients of restitution say."""
    before = impacts.damper_velocity_before(parameters) - impacts.velocity_before(parameters)
    after = impacts.damper_velocity_after - impacts.velocity_after
    fast = np.abs(before) > _SLOW * float(np.abs(before).max(initial=0.0))
    for stop, expected in ((1, parameters.restitution_1), (2, parameters.restitution_2)):
        hit = fast & (impacts.stop == stop)
        if hit.sum() < _LEAST_IMPACTS:
            continue
        found = -after[hit] / before[hit]
        measured = float(np.median(found))
        if abs(measured - expected) <= _TOLERANCE:
            continue
        name = f'restitution_{stop}'
        yield Finding(
            quantity=name,
            unit='',
            time=float(impacts.time[hit][0]),
            measured=measured,
            expected=expected,
            tolerance=_TOLERANCE,
            text=(
                f'at stop {stop} the masses part at {measured:.9g} of the speed at which they '
                f'meet (median of {len(found)} impacts, by impulses and logged masses); logged '
                f'is {name} = {expected:.9g}'
            ),
        )


def impulse_findings(impacts: RecordedImpacts) -> Iterator[Finding]:
    """Find out whether both masses receive the same impulse."""
    if not len(impacts):
        return
    scale = float(np.abs(impacts.primary_impulse).max(initial=0.0)) or 1.0
    off: Array = impacts.primary_impulse + impacts.damper_impulse
    wrong = np.flatnonzero(~(np.abs(off) <= _TOLERANCE * scale))
    if not len(wrong):
        return
    first = int(wrong[0])
    worst = (
        int(wrong[np.nanargmax(np.abs(off[wrong]))]) if np.isfinite(off[wrong]).any() else first
    )
    on_m, on_primary = float(impacts.damper_impulse[worst]), float(impacts.primary_impulse[worst])
    yield Finding(
        quantity='impulse',
        unit='N s',
        time=float(impacts.time[first]),
        measured=on_m,
        expected=-on_primary,
        tolerance=_TOLERANCE * scale,
        text=(
            f'{len(wrong)} impacts do not give M and m the same impulse: up to {on_m:.9g} N s on '
            f'm against {on_primary:.9g} N s on M, first at {impacts.time[first]:.9f} s'
        ),
    )
