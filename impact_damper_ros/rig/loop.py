# SPDX-License-Identifier: Apache-2.0
"""The run loop: the next event or the next act, whichever is earlier."""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import Any

from impact_damper_ros.control.actuator import commands_full
from impact_damper_ros.control.controller import has_law
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.next_event import (
    COMMANDS_FULL,
    FULL,
    GOING,
    PAUSED,
    count_event,
    may_go_on,
    next_event,
    next_passage,
)
from impact_damper_ros.motion.state import Moving
from impact_damper_ros.motion.transition import resolve

from .acts import ACT_PASSAGE, Schedule, has_room, next_act, note_stops, perform


@kernel
def run_to(
    moving: Moving,
    in_mode: MutableSequence[float],
    control: Any,
    acts: Any,
    schedule: Schedule,
    end: float,
) -> int:
    """
    Go from event to event and act to act, up to an instant, s; return why it stopped.

    `control` and `acts` are None for a rig without control: its compiled loop has no code of it.
    """
    _, _, run, _, log = moving
    while has_room(run, control):
        if control is not None:
            if commands_full(control):
                return COMMANDS_FULL
            run.watch = has_law(control)
        time, act = next_act(run, control, schedule, end)
        if run.steps <= 0 and run.now < end:
            return PAUSED
        run.steps -= 1
        if not next_event(moving, time):
            return PAUSED
        if control is not None and run.watch:
            if not next_passage(moving, time):
                return PAUSED
            if run.crossing <= min(time, run.due):
                time = run.crossing
                act = ACT_PASSAGE
        if run.due <= time and act != ACT_PASSAGE:
            status = may_go_on(run)
            if status != GOING:
                return status
            first = run.written
            in_mode[run.mode] += run.tau - run.counted
            resolve(moving)
            count_event(moving)
            if control is not None:
                note_stops(run, log, control, acts, first)
        else:
            status = perform(act, time, moving, in_mode, control, acts, schedule, end)
            if status != GOING:
                return status
    return FULL
