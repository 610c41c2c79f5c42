"""
Whether the impacts of a log are those of the rig that it names.

Where m is at an impact tells the gap; how fast the masses part, the coefficients of restitution;
and both masses receive the same impulse. None of this needs the motion between the impacts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters

from .flight_check import largest_size
from .recorded_stretch import RecordedImpacts, RecordedStates
from .run_comparison import Finding
from .run_curves import Array

__all__ = [
    'contact_findings',
    'gap_findings',
    'impulse_findings',
    'restitution_findings',
    'stop_findings',
]


_TOLERANCE = 1e-9
# The relative speed of slower impacts has lost its digits.
_SLOW = 1e-6
_LEAST_IMPACTS = 3
_ROUND_OFF = 1e-12


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
    """Find out whether m hits the stops, and these stand, where the logged gap has them."""
    half = 0.5 * parameters.gap
    length = max(half, largest_size(states.x, impacts.x))
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


def contact_findings(
    parameters: RigParameters, states: RecordedStates, impacts: RecordedImpacts, *, moving: bool
) -> Iterator[Finding]:
    """
    Find single impacts on the wrong stop: by the direction of the impulse, and by where m is.

    With `moving`, stops may be anywhere, and only the direction counts.
    """
    if not len(impacts):
        return
    half = 0.5 * parameters.gap
    side = np.where(impacts.stop == 1, 1.0, -1.0)
    with np.errstate(over='ignore', invalid='ignore'):
        outward = side * (impacts.z - impacts.x)
        tolerance = _TOLERANCE * (half + largest_size(states.x, impacts.x))
        # A stop that follows m comes inwards from where the joint states show it first.
        y = states.z - states.x
        at_stop = [np.abs(stop - states.z) <= tolerance for stop in (states.stop_1, states.stop_2)]
        farthest = np.abs(y[at_stop[0] | at_stop[1]]).max(initial=half)
        there = (outward >= half - tolerance) & (outward <= farthest + tolerance)
        wrong = np.flatnonzero(~((side * impacts.primary_impulse >= 0.0) & (there | moving)))
    if len(wrong):
        first = int(wrong[0])
        found = float(side[first] * outward[first])
        yield Finding(
            quantity='Y at impact',
            unit='m',
            time=float(impacts.time[first]),
            measured=found,
            expected=float(side[first]) * half,
            tolerance=tolerance,
            text=(
                f'{len(wrong)} impacts are not where their stop is or push M the wrong way, first '
                f'on stop {impacts.stop[first]:.0f} at {impacts.time[first]:.9f} s: Y is '
                f'{found:.9g} m, the impulse on M {impacts.primary_impulse[first]:.9g} N s'
            ),
        )


def stop_findings(
    parameters: RigParameters, control: Mapping[str, Any], states: RecordedStates
) -> Iterator[Finding]:
    """Find joint states in which a stop is where, or as fast as, it cannot be."""
    half, active = 0.5 * parameters.gap, control.get('gap_control', 'off') != 'off'
    speed = float(control.get('actuator_speed') or 0.0) if active else 0.0
    reach = max(half, 0.5 * float(control.get('gap_max', 0.0))) if active else half
    place = _TOLERANCE * (reach + largest_size(states.x, states.z))
    rate = _TOLERANCE * (speed + largest_size(states.velocity, states.damper_velocity))
    with np.errstate(over='ignore', invalid='ignore'):
        y, y_rate = states.z - states.x, states.damper_velocity - states.velocity
        for stop, side, position, velocity in (
            (1, 1.0, states.stop_1, states.stop_1_velocity),
            (2, -1.0, states.stop_2, states.stop_2_velocity),
        ):
            at, moving = position - states.x, velocity - states.velocity
            touching = np.abs(at - y) <= place
            standing = np.abs(moving) <= rate
            right = touching | (np.abs(at - side * half) <= place)
            if active:
                right = (side * (at - y) >= -place) & (side * at <= reach + place)
            right &= (
                standing
                | (touching & (np.abs(moving - y_rate) <= rate))
                | ((speed > 0.0) & (np.abs(moving) <= speed + rate))
            )
            wrong = np.flatnonzero(~right)
            if len(wrong) and not (stop == 2 and parameters.one_sided):
                first = int(wrong[0])
                yield Finding(
                    quantity=f'stop_{stop}',
                    unit='m',
                    time=float(states.time[first]),
                    measured=float(at[first]),
                    expected=side * half,
                    tolerance=place,
                    text=(
                        f'in {len(wrong)} joint states stop {stop} is where, or as fast as, it '
                        f'cannot be, first at {states.time[first]:.9g} s: at Y = '
                        f'{at[first]:.9g} m, at {moving[first]:.9g} m/s in M'
                    ),
                )


def restitution_findings(
    parameters: RigParameters, impacts: RecordedImpacts, *, single: bool = False
) -> Iterator[Finding]:
    """
    Find out whether the masses part as fast as the logged coefficients of restitution say.

    With `single`, also single impacts at which they do not are found.
    """
    before = impacts.damper_velocity_before(parameters) - impacts.velocity_before(parameters)
    after = impacts.damper_velocity_after - impacts.velocity_after
    fast = np.abs(before) > _SLOW * largest_size(before)
    for stop, expected in ((1, parameters.restitution_1), (2, parameters.restitution_2)):
        hit = fast & (impacts.stop == stop)
        if hit.sum() < _LEAST_IMPACTS:
            continue
        found = -after[hit] / before[hit]
        measured = float(np.median(found))
        name = f'restitution_{stop}'
        if abs(measured - expected) <= _TOLERANCE:
            # Slow ones are known less well.
            slack = _TOLERANCE + _ROUND_OFF * largest_size(before, after) / np.abs(before[hit])
            wrong = np.flatnonzero(~(np.abs(found - expected) <= slack))
            if len(wrong) and single:
                first = int(wrong[0])
                yield Finding(
                    quantity=name,
                    unit='',
                    time=float(impacts.time[hit][first]),
                    measured=float(found[first]),
                    expected=expected,
                    tolerance=float(slack[first]),
                    text=(
                        f'in {len(wrong)} of {len(found)} impacts on stop {stop} the masses do '
                        f'not part as {name} = {expected:.9g} says, first at '
                        f'{impacts.time[hit][first]:.9f} s: at {found[first]:.9g} of the speed at '
                        'which they meet'
                    ),
                )
            continue
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
    scale = largest_size(impacts.primary_impulse) or 1.0
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
