# SPDX-License-Identifier: Apache-2.0
"""Commands to stops: to a place in M, at once or at a speed, or back to the gap."""

from __future__ import annotations

from math import inf

from .event import STOP_ARRIVED, STOP_TOUCHED, write_quiet
from .flight import begin_next_flight, move_to
from .kernels import kernel
from .state import Moving, RigConstants, Run, on_stop_1, on_stop_2, place
from .transition import begin_from, block_stop, report_support
from .zero_passage import set_side

#: A stop just after a command: it moves, is at its target, or is blocked by m.
MOVING = 0
ARRIVED = 1
TOUCHED = 2


@kernel
def send_stop(constants: RigConstants, run: Run, stop: int, target: float, speed: float) -> int:
    """
    Send a stop to a target, at once or at a speed; return `MOVING`, `ARRIVED` or `TOUCHED`.

    The velocities of the masses and the mode stay what they are.
    """
    outwards = 1.0 if stop == 1 else -1.0
    here = run.stop_1 if stop == 1 else run.stop_2
    clearance = run.clearance_1 if stop == 1 else run.clearance_2
    way = target - here
    velocity = 0.0
    if way != 0.0 and speed < inf:
        velocity = speed if way > 0.0 else -speed
    offset = place(run)
    if stop == 1:
        run.target_1 = target
        run.speed_1 = speed
        run.stop_velocity_1 = velocity
    else:
        run.target_2 = target
        run.speed_2 = speed
        run.stop_velocity_2 = velocity
    if velocity != 0.0:
        closing = outwards * (run.relative_velocity - velocity)
        if clearance == 0.0 and outwards * velocity < 0.0 and closing >= 0.0:
            block_stop(constants, run, stop)
            return TOUCHED
        return MOVING
    if way == 0.0:
        return ARRIVED
    touches = outwards * way < 0.0 and outwards * (target - offset) <= 0.0
    if touches:
        target = offset
    # The clearance changes by what the stop moves, so that a small one keeps its digits.
    clearance = max(0.0, clearance + outwards * way)
    if stop == 1:
        run.stop_1 = target
        run.clearance_1 = clearance
    else:
        run.stop_2 = target
        run.clearance_2 = clearance
    if touches:
        block_stop(constants, run, stop)
        return TOUCHED
    return ARRIVED


@kernel
def move_stops(
    moving: Moving,
    stop_1: float,
    stop_2: float,
    speed: float,
) -> None:
    """Send stops to targets, Y in m, at the present time; NaN leaves a stop as it is."""
    run = moving.run
    side = run.crossing_side
    move_to(moving, run.now)
    if side != 0:
        set_side(moving, side)
    send_stops(moving, stop_1, stop_2, speed)


@kernel
def send_stops(
    moving: Moving,
    stop_1: float,
    stop_2: float,
    speed: float,
) -> None:
    """Send stops to targets at the origin of a flight, and begin the next flight there."""
    constants, _, run, _, log = moving
    mode = run.mode
    was_on_1 = on_stop_1(run)
    was_on_2 = on_stop_2(run)
    first = MOVING
    second = MOVING
    if stop_1 == stop_1:
        first = send_stop(constants, run, 1, stop_1, speed)
    if stop_2 == stop_2:
        second = send_stop(constants, run, 2, stop_2, speed)
    if first != MOVING:
        write_quiet(run, log, STOP_ARRIVED if first == ARRIVED else STOP_TOUCHED, 1)
    if second != MOVING:
        write_quiet(run, log, STOP_ARRIVED if second == ARRIVED else STOP_TOUCHED, 2)
    if on_stop_1(run) == was_on_1 and on_stop_2(run) == was_on_2:
        begin_next_flight(moving)
        return
    written = run.written
    begin_from(moving)
    if run.written == written:
        report_support(run, log, mode)


@kernel
def place_stops_at_gap(constants: RigConstants, run: Run) -> None:
    """Send both stops to half the gap of the rig, at once."""
    half = constants.half_gap
    if constants.one_sided:
        run.clearance_2 = inf
        run.stop_2 = -half
        run.target_2 = -half
        run.stop_velocity_2 = 0.0
    elif run.clearance_2 == inf:
        # The rig was one-sided, and now gets a stop 2.
        offset = place(run)
        run.stop_2 = min(-half, offset)
        run.clearance_2 = max(0.0, offset - run.stop_2)
    send_stop(constants, run, 1, half, inf)
    if not constants.one_sided:
        send_stop(constants, run, 2, -half, inf)
