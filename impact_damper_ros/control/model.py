"""The model of the rig for laws that know the structure: its motion ahead, without control."""

from __future__ import annotations

from math import inf

from impact_damper_ros.rig.flight import NO_EVENT, Flight, end_at
from impact_damper_ros.rig.kernels import kernel
from impact_damper_ros.rig.mode import REST_1, RigConstants, launch
from impact_damper_ros.rig.origin import Origin, carried, offset_of
from impact_damper_ros.rig.run_loop import first_end
from impact_damper_ros.rig.transition import at_rest, common_velocity, moving_mode, resolve, struck

#: Most flights that are followed. M then carries m, which rattles on a stop or in a narrow gap.
_MOST_FLIGHTS = 200


@kernel
def motion_ahead(rig: RigConstants, origin: Origin, end: float) -> Origin:
    """Return the state at a later instant, with no further command to the stops."""
    for _ in range(_MOST_FLIGHTS):
        flight: Flight = launch(rig, origin)
        since = max(0.0, (end - origin.time) - origin.time_low)
        ended, ending = first_end(origin, flight, since)
        if not ended:
            return carried(origin, flight, end_at(flight, NO_EVENT, since))
        origin = resolve(rig, origin, flight, ending).origin
    together = origin._replace(
        mode=REST_1,
        velocity=common_velocity(rig, origin),
        relative_velocity=0.0,
        stop_velocity_1=0.0,
        stop_velocity_2=0.0,
    )
    flight = launch(rig, together)
    since = max(0.0, (end - origin.time) - origin.time_low)
    return at_rest(rig, carried(together, flight, end_at(flight, NO_EVENT, since)))


@kernel
def sent_off(
    rig: RigConstants, here: Origin, stop_1: float, stop_2: float, speed: float
) -> Origin:
    """Return the state with the stops on their way to places, or there."""
    if rig.one_sided:
        stop_2 = here.stop_2
    if speed < inf:
        way_1 = stop_1 - here.stop_1
        way_2 = stop_2 - here.stop_2
        return here._replace(
            target_1=stop_1,
            target_2=stop_2,
            stop_velocity_1=0.0 if way_1 == 0.0 else (speed if way_1 > 0.0 else -speed),
            stop_velocity_2=0.0 if way_2 == 0.0 else (speed if way_2 > 0.0 else -speed),
        )
    offset = offset_of(here.clearance_1, here.clearance_2, here.stop_1, here.stop_2)
    stop_1 = max(stop_1, offset)
    stop_2 = min(stop_2, offset)
    there = here._replace(
        stop_1=stop_1,
        stop_2=stop_2,
        target_1=stop_1,
        target_2=stop_2,
        clearance_1=stop_1 - offset,
        clearance_2=inf if rig.one_sided else offset - stop_2,
        stop_velocity_1=0.0,
        stop_velocity_2=0.0,
        chatter_left=0.0,
    )
    if there.relative_velocity == 0.0:
        return at_rest(rig, there)
    if there.relative_velocity > 0.0 and there.clearance_1 == 0.0:
        return struck(rig, there, 1).origin
    if there.relative_velocity < 0.0 and there.clearance_2 == 0.0:
        return struck(rig, there, 2).origin
    return there._replace(mode=moving_mode(rig, there.relative_velocity))
