"""Changes of the parameters in flight: what they make of the state at their instant."""

from __future__ import annotations

from math import inf

from .mode import Machine
from .origin import Origin, offset_of

__all__ = ['changed', 'kept_angles']


def regapped(here: Origin, machine: Machine) -> Origin:
    """
    Return the state with both stops sent to the places that the machine has for them, at once.

    A stop that would pass m comes up to it, and follows it inwards from then on.
    """
    offset = offset_of(here.clearance_1, here.clearance_2, here.stop_1, here.stop_2)
    stop_1 = max(machine.stop, offset)
    stop_2 = -machine.stop if machine.one_sided else min(-machine.stop, offset)
    # Clearances move by what the stops move, so that the tiny ones keep their digits.
    clearance_1 = max(0.0, here.clearance_1 + (stop_1 - here.stop_1))
    if stop_1 == offset and stop_1 > machine.stop:
        clearance_1 = 0.0
    if machine.one_sided:
        clearance_2 = inf
    elif here.clearance_2 == inf:
        clearance_2 = max(0.0, offset - stop_2)
    else:
        clearance_2 = max(0.0, here.clearance_2 - (stop_2 - here.stop_2))
    if stop_2 == offset and stop_2 < -machine.stop and not machine.one_sided:
        clearance_2 = 0.0
    return here._replace(
        stop_1=stop_1,
        stop_2=stop_2,
        clearance_1=clearance_1,
        clearance_2=clearance_2,
        target_1=machine.stop,
        target_2=-machine.stop,
        stop_velocity_1=0.0,
        stop_velocity_2=0.0,
    )


def kept_angles(
    angles: tuple[float, ...], own: tuple[int, int], lines: tuple[int, int]
) -> tuple[float, ...]:
    """
    Return the angles that harmonics have turned, once their numbers have changed.

    Each keeps its own by its place, in the force arrays or among the lines of the multisine; added
    ones have turned none.

    Parameters
    ----------
    angles : tuple of float
        The angles before, those of the force arrays first, rad.
    own, lines : tuple of int
        Entries of the force arrays and lines of the multisine, before and after.
    """
    first = (angles[: own[0]] + (0.0,) * own[1])[: own[1]]
    others = (angles[own[0] :] + (0.0,) * lines[1])[: lines[1]]
    return first + others


def changed(
    here: Origin, before: Machine, machine: Machine, shift: float, angles: tuple[float, ...]
) -> Origin:
    """
    Return the state just after a change, before m hits a stop that has come up to it.

    Parameters
    ----------
    here : Origin
        State just before the change.
    before, machine : Machine
        The rig before and after it.
    shift : float
        By how much X grows because its zero, the static equilibrium, moves, m.
    angles : tuple of float
        What the harmonics have turned, rad.

    Returns
    -------
    Origin
        The state, its mode still to be found. Stops go to their places if these have changed; else
        they stay, or go on their way.
    """
    if before.stop != machine.stop or before.one_sided != machine.one_sided:
        here = regapped(here, machine)
    return here._replace(x=here.x + shift, angles=angles)
