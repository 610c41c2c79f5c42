"""
The first event between m and stops that move relative to M, in multiprecision.

A stop that moves is one that stands for an observer who moves with it: the relative displacement
less its way is searched for the place where the stop began.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle.first_root import Watched, first_event
from oracle.hybrid_oracle import HybridMotion
from oracle.precise_motion import Motion, Relative, mp


def first_meeting(
    params: Mapping[str, Any],
    initial: Mapping[str, Any],
    places: tuple[float, float],
    velocities: tuple[float, float],
    targets: tuple[float, float],
    horizon: float,
) -> tuple[str, Any, Any] | None:
    """
    Return what happens first to m in flight between two stops, from time 0.

    Parameters
    ----------
    params, initial : mapping
        Fields of RigParameters and InitialConditions, with m in the middle of a wide gap.
    places, velocities, targets : tuple of float
        Place Y of each stop, its velocity relative to M, and where it stops.
    horizon : float
        Where the search ends.

    Returns
    -------
    tuple or None
        'contact 1', 'contact 2', 'reversal', 'arrived 1' or 'arrived 2'; the instant; and the
        rate at which the two then come together (1 if there is none).
    """
    rig = HybridMotion(params, initial)
    drag = rig.slide * rig.grip
    motion = Motion(rig.alone, mp.mpf(0), rig.x, rig.v, rig.m * drag)

    def seen(velocity: float) -> Relative:
        return Relative(motion, rig.y, rig.v + rig.u - mp.mpf(velocity), rig.incline - drag)

    def begun(place: float, rate: Any) -> int:
        return 1 if rig.y == mp.mpf(place) and rate > 0 else 0

    watched = [
        Watched(
            'contact 1',
            seen(velocities[0]),
            -1,
            0,
            mp.mpf(places[0]),
            begun(places[0], velocities[0] - rig.u),
        ),
        Watched(
            'contact 2',
            seen(velocities[1]),
            1,
            0,
            -mp.mpf(places[1]),
            begun(places[1], rig.u - velocities[1]),
        ),
    ]
    if rig.grip:
        watched.append(Watched('reversal', seen(0.0), rig.slide, 1, mp.mpf(0), 0 if rig.u else 1))
    found = first_event(watched, rig.step, mp.mpf(horizon))
    events = [(found[1], found[0])] if found else []
    for stop, place, velocity, target in zip((1, 2), places, velocities, targets, strict=True):
        if velocity:
            way = mp.mpf(target) - mp.mpf(place)
            events.append((way / mp.mpf(velocity), f'arrived {stop}'))
    if not events:
        return None
    instant, kind = min(events)
    rate: Any = mp.mpf(1)
    for function in watched:
        if function.kind == kind:
            rate = abs(function(instant)[1])
    return kind, instant, rate
