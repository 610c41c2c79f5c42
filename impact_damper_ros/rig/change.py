"""Changes of the parameters in flight: what they make of the state at their instant."""

from __future__ import annotations

from math import inf

from .mode import Machine, Origin

__all__ = ['changed', 'offset_of']


def offset_of(clearance_1: float, clearance_2: float, stop_1: float, stop_2: float) -> float:
    """Return Y from the clearances and positions of the stops, by the nearer one, m."""
    return stop_1 - clearance_1 if clearance_1 <= clearance_2 else stop_2 + clearance_2


def changed(here: Origin, machine: Machine, shift: float) -> Origin:
    """
    Return the state just after a change, before m hits a stop that has come up to it.

    Parameters
    ----------
    here : Origin
        State just before the change.
    machine : Machine
        The rig after it.
    shift : float
        By how much X grows because its zero, the static equilibrium, moves, m.

    Returns
    -------
    Origin
        The state, its mode still to be found. Stops stand where the machine has them, or where m
        is in their way. Harmonics keep the angle they have turned; added ones have turned none.
    """
    count = len(machine.phases)
    angles = (here.angles + (0.0,) * count)[:count]
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
        x=here.x + shift,
        angles=angles,
        stop_1=stop_1,
        stop_2=stop_2,
        clearance_1=clearance_1,
        clearance_2=clearance_2,
    )
