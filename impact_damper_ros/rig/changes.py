"""
Changes in flight: the state after a parameter change or a command to the stops.

A stop moves relative to M at constant speed towards its target. It never does work: where it meets
m it stops, at rest relative to M, before m may hit it. Its velocity therefore enters no impact.
"""

from __future__ import annotations

from math import inf, isnan

from .arguments import as_float
from .kernels import kernel
from .mode import RigConstants
from .origin import Origin, locked, offset_of
from .parameter_spec import ParameterError
from .quoting import shown


def regapped(here: Origin, rig: RigConstants) -> Origin:
    """
    Return the state with both stops moved to half the gap of the rig, at once.

    A stop that would pass m is placed at m and follows it inwards from then on.
    """
    offset = offset_of(here.clearance_1, here.clearance_2, here.stop_1, here.stop_2)
    stop_1 = max(rig.stop, offset)
    stop_2 = -rig.stop if rig.one_sided else min(-rig.stop, offset)
    # Clearances change by what the stops move, so that small ones keep their digits.
    clearance_1 = max(0.0, here.clearance_1 + (stop_1 - here.stop_1))
    if stop_1 == offset and stop_1 > rig.stop:
        clearance_1 = 0.0
    if rig.one_sided:
        clearance_2 = inf
    elif here.clearance_2 == inf:
        clearance_2 = max(0.0, offset - stop_2)
    else:
        clearance_2 = max(0.0, here.clearance_2 - (stop_2 - here.stop_2))
    if stop_2 == offset and stop_2 < -rig.stop and not rig.one_sided:
        clearance_2 = 0.0
    return here._replace(
        stop_1=stop_1,
        stop_2=stop_2,
        clearance_1=clearance_1,
        clearance_2=clearance_2,
        target_1=rig.stop,
        target_2=-rig.stop,
        stop_velocity_1=0.0,
        stop_velocity_2=0.0,
    )


def kept_angles(
    angles: tuple[float, ...], own: tuple[int, int], lines: tuple[int, int]
) -> tuple[float, ...]:
    """
    Return the angles turned by the harmonics after their number has changed.

    A harmonic keeps its angle by its index, in the force arrays or among the lines of the
    multisine; an added one begins with zero.
    """
    first = (angles[: own[0]] + (0.0,) * own[1])[: own[1]]
    others = (angles[own[0] :] + (0.0,) * lines[1])[: lines[1]]
    return first + others


def changed(
    here: Origin, before: RigConstants, rig: RigConstants, shift: float, angles: tuple[float, ...]
) -> Origin:
    """Return the state just after a change, before m hits a stop that has been placed at m."""
    if before.stop != rig.stop or before.one_sided != rig.one_sided:
        here = regapped(here, rig)
    return here._replace(x=here.x + shift, angles=angles)


_FARTHEST = 1e9
_SLOWEST = 1e-9


#: A stop just after a command: it moves, is at its target, or touches m and cannot move further.
MOVING = 0
ARRIVED = 1
TOUCHED = 2


def check_command(one_sided: bool, stop: int, target: float, speed: float) -> None:
    """Check the target and speed of a stop."""
    name = f'stop_{stop}'
    if stop == 2 and one_sided:
        raise ParameterError(
            name,
            f'{name} is {target!r} m but the rig is one-sided: give None, or one_sided: false',
        )
    if not -_FARTHEST <= as_float(target) <= _FARTHEST:
        raise ParameterError(
            name,
            f'{name} is {shown(target)} m: give the place Y where it is to go, a number from '
            f'{-_FARTHEST:g} to {_FARTHEST:g} m',
        )
    if isnan(speed) or speed < _SLOWEST:
        raise ParameterError(
            'speed',
            f'speed is {speed!r} m/s: give a number from {_SLOWEST:g} m/s, or inf for at once',
        )


@kernel(inline=True)
def supports(origin: Origin) -> tuple[bool, bool]:
    """Return whether m is on stop 1, and on stop 2, while that stop stands."""
    return (
        origin.clearance_1 == 0.0 and origin.stop_velocity_1 == 0.0,
        origin.clearance_2 == 0.0 and origin.stop_velocity_2 == 0.0,
    )


@kernel
def commanded(
    one_sided: bool, here: Origin, stop: int, target: float, speed: float
) -> tuple[Origin, int]:
    """Return the state just after a command to a stop, mode and velocities unchanged."""
    outwards = 1.0 if stop == 1 else -1.0
    place = here.stop_1 if stop == 1 else here.stop_2
    clearance = here.clearance_1 if stop == 1 else here.clearance_2
    way = target - place
    velocity = 0.0
    if way != 0.0 and speed < inf:
        velocity = speed if way > 0.0 else -speed
    moved = _set_off(here, stop, target, velocity)
    if velocity != 0.0:
        closing = outwards * (here.relative_velocity - velocity)
        if clearance == 0.0 and outwards * velocity < 0.0 and closing >= 0.0:
            return locked(one_sided, moved, stop), TOUCHED
        return moved, MOVING
    if way == 0.0:
        return moved, ARRIVED
    offset = offset_of(here.clearance_1, here.clearance_2, here.stop_1, here.stop_2)
    if outwards * way < 0.0 and outwards * (target - offset) <= 0.0:
        return locked(one_sided, _put(moved, stop, offset, 0.0), stop), TOUCHED
    # The clearance changes by what the stop moves, so that a small one keeps its digits.
    return _put(moved, stop, target, max(0.0, clearance + outwards * way)), ARRIVED


@kernel(inline=True)
def _set_off(here: Origin, stop: int, target: float, velocity: float) -> Origin:
    if stop == 1:
        return here._replace(target_1=target, stop_velocity_1=velocity)
    return here._replace(target_2=target, stop_velocity_2=velocity)


@kernel(inline=True)
def _put(here: Origin, stop: int, place: float, clearance: float) -> Origin:
    if stop == 1:
        return here._replace(stop_1=place, clearance_1=clearance)
    return here._replace(stop_2=place, clearance_2=clearance)
