# SPDX-License-Identifier: Apache-2.0
"""
Transitions: the events of a flight, from the state before to the state after.

A stop away from its target moves there at its speed, as far as m lets it, and never does work:
where it meets m it stands, at rest relative to M, before m may hit it. Its velocity therefore
enters no impact. Where m moves inwards more slowly than the stop, the stop follows in contact with
m. It moves by itself again once m is faster or out of the way.
"""

from __future__ import annotations

from math import inf

from .event import (
    RELEASE_EVENT,
    REST_EVENT,
    REVERSAL_EVENT,
    STICK_EVENT,
    STOP_ARRIVED,
    STOP_STARTED,
    STOP_TOUCHED,
    Log,
    write_event,
    write_quiet,
)
from .flight import (
    ARRIVAL,
    CHATTER_END,
    CONTACT_1,
    CONTACT_2,
    OUTRUN,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
    begin_next_flight,
    move_origin,
    moving_mode,
    rest,
)
from .impact import strike
from .kernels import kernel
from .state import (
    CHATTER_1,
    FREE,
    REST_1,
    REST_2,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
    Moving,
    RigConstants,
    Run,
    on_stop_1,
    on_stop_2,
    stop_under,
)
from .waves import set_waves
from .zero_passage import set_side


@kernel(inline=True)
def put_on_stop(constants: RigConstants, run: Run, stop: int) -> None:
    """Put m exactly on a stop."""
    across = inf if constants.one_sided else max(0.0, run.stop_1 - run.stop_2)
    run.clearance_1 = 0.0 if stop == 1 else across
    run.clearance_2 = across if stop == 1 else 0.0


@kernel
def put_between_stops(run: Run, stop: int) -> bool:
    """Put m on a stop if the other stop still touches m, which it follows; return whether."""
    if stop == 1:
        if not (on_stop_2(run) and run.stop_2 != run.target_2):
            return False
        run.stop_2 = run.stop_1
    else:
        if not (on_stop_1(run) and run.stop_1 != run.target_1):
            return False
        run.stop_1 = run.stop_2
    run.clearance_1 = 0.0
    run.clearance_2 = 0.0
    return True


@kernel
def block_stop(constants: RigConstants, run: Run, stop: int) -> None:
    """Let a stop stand where it has met m."""
    if stop == 1:
        # The stops never cross; with m on both there is no room between them.
        if run.clearance_2 == 0.0 or (not constants.one_sided and run.stop_1 < run.stop_2):
            run.stop_1 = run.stop_2
        run.stop_velocity_1 = 0.0
    else:
        if run.clearance_1 == 0.0 or run.stop_2 > run.stop_1:
            run.stop_2 = run.stop_1
        run.stop_velocity_2 = 0.0
    run.released = False
    put_on_stop(constants, run, stop)


@kernel
def report_support(run: Run, log: Log, mode_before: int) -> None:
    """Report the rest or the release that a change of support causes, if any."""
    if mode_before >= STICK > run.mode:
        write_quiet(run, log, RELEASE_EVENT, stop_under(mode_before))
    elif run.mode in (REST_1, REST_2) and (mode_before < STICK or mode_before >= CHATTER_1):
        write_quiet(run, log, REST_EVENT, stop_under(run.mode))


@kernel(inline=True)
def touch(moving: Moving, stop: int) -> bool:
    """Put m on a stop, which stands there if it moves; return whether m hits it."""
    constants, _, run, _, log = moving
    if (run.stop_velocity_1 if stop == 1 else run.stop_velocity_2) == 0.0:
        if not put_between_stops(run, stop):
            put_on_stop(constants, run, stop)
        return True
    mode_before = run.mode
    relative = run.relative_velocity
    block_stop(constants, run, stop)
    write_quiet(run, log, STOP_TOUCHED, stop)
    if relative == 0.0:
        rest(moving)
        report_support(run, log, mode_before)
    return relative > 0.0 if stop == 1 else relative < 0.0


@kernel
def resolve_rest(moving: Moving, kind: int) -> None:
    """Resolve the end of a chatter, a reversal, or a support that gives way."""
    constants, _, run, _, log = moving
    mode_before = run.mode
    before = run.velocity
    relative_before = run.relative_velocity
    if kind == REVERSAL and run.tau == 0.0:
        # m does not leave its support after all: the forces balance to round-off.
        run.mode = STICK
        if on_stop_1(run):
            run.mode = REST_1
        elif on_stop_2(run):
            run.mode = REST_2
        run.relative_velocity = 0.0
        run.released = False
        run.chatter_left = 0.0
    elif kind in (REVERSAL, CHATTER_END) or mode_before >= CHATTER_1:
        rest(moving)
    else:
        # A support gives way, in the direction that the event names.
        run.mode = FREE
        if constants.grip > 0.0:
            run.mode = SLIDE_UP if kind == RELEASE_UP else SLIDE_DOWN
        run.relative_velocity = 0.0
        run.released = True
        run.chatter_left = 0.0
    code = 0
    stop = 0
    if run.released:
        code = RELEASE_EVENT
        stop = stop_under(mode_before)
    elif run.mode == REST_1 or run.mode == REST_2:
        code = REST_EVENT
        stop = stop_under(run.mode)
    elif run.mode == STICK:
        code = STICK_EVENT
    elif mode_before >= CHATTER_1:
        # The stop no longer bears m where its bounces have accumulated.
        code = RELEASE_EVENT
        stop = stop_under(mode_before)
    elif kind == REVERSAL:
        code = REVERSAL_EVENT
    if code != 0:
        write_event(run, log, code, stop, before, before, before + relative_before, before, 0.0)


@kernel(inline=True)
def resolve(moving: Moving) -> None:
    """Go to the event that ends the flight, resolve and report it, and begin the next flight."""
    constants, lines, run, waves, log = moving
    kind = run.kind
    direction = run.direction
    side = run.crossing_side
    move_origin(
        lines,
        run,
        waves,
        run.tau,
        run.end_x,
        run.end_velocity,
        run.end_travel,
        run.end_relative_velocity,
    )
    if kind in (CONTACT_1, CONTACT_2):
        stop = 1 if kind == CONTACT_1 else 2
        if touch(moving, stop):
            strike(moving, stop)
    elif kind == ARRIVAL:
        stop = 1 if direction < 0 else 2
        if stop == 1:
            run.stop_1 = run.target_1
        else:
            run.stop_2 = run.target_2
        put_on_stop(constants, run, stop)
        write_quiet(run, log, STOP_ARRIVED, stop)
    elif kind == OUTRUN:
        # The stop is exactly as fast as m, so that both come apart from here.
        if direction < 0:
            run.stop_velocity_1 = run.relative_velocity = -run.speed_1
        else:
            run.stop_velocity_2 = run.relative_velocity = run.speed_2
        write_quiet(run, log, STOP_STARTED, 1 if direction < 0 else 2)
    elif kind == STOP_ARRIVED_1:
        run.stop_1 = run.target_1
        run.stop_velocity_1 = 0.0
        write_quiet(run, log, STOP_ARRIVED, 1)
    elif kind == STOP_ARRIVED_2:
        run.stop_2 = run.target_2
        run.stop_velocity_2 = 0.0
        write_quiet(run, log, STOP_ARRIVED, 2)
    else:
        resolve_rest(moving, kind)
    if side != 0:
        set_side(moving, side)
    begin_next_flight(moving)


@kernel
def begin_from(moving: Moving) -> None:
    """Begin from a state of unknown mode, with the impact of m that moves into its stop."""
    constants, lines, run, waves, _ = moving
    set_waves(lines, waves)
    relative = run.relative_velocity
    if relative == 0.0:
        mode = run.mode
        left = run.chatter_left
        rest(moving)
        # A chatter on a stop that still bears m keeps its instant of rest.
        if mode >= CHATTER_1 and stop_under(run.mode) == stop_under(mode):
            run.mode = mode
            run.chatter_left = left
    elif on_stop_1(run) and relative > 0.0:
        strike(moving, 1)
    elif on_stop_2(run) and relative < 0.0:
        strike(moving, 2)
    else:
        run.mode = moving_mode(constants, relative)
        run.chatter_left = 0.0
    begin_next_flight(moving)
