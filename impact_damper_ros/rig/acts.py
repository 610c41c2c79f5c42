# SPDX-License-Identifier: Apache-2.0
"""
Acts: what happens to a rig at given times, and which of it is next.

An act is a sample or a command of its control, a passage of X through zero, the next value of a
measured record, a step of the stepped sine, or a requested sample. Samples of the control lie on
the grid k/rate; passages and the starts of stops are at their exact instants.
"""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from math import inf
from typing import Any, NamedTuple

from impact_damper_ros.control.act import Action, ActRow
from impact_damper_ros.control.actuator import (
    commands_full,
    next_command,
    note_velocity,
    start_command,
)
from impact_damper_ros.control.controller import (
    end_sample,
    is_blind,
    is_ignored,
    next_sample,
    note_return,
    passage_index,
    sensor_sample,
    take_passage,
    take_sample,
)
from impact_damper_ros.control.own_law import law_failed
from impact_damper_ros.control.state import Control, ControlSettings, Estimates, Measurement
from impact_damper_ros.motion.event import (
    ROWS_AT_ONCE,
    STOP_ARRIVED,
    STOP_STARTED,
    STOP_TOUCHED,
    Log,
    View,
    sample_at,
    view_at,
    write_passage,
)
from impact_damper_ros.motion.flight import Motion, motion_at, move_to, places_after
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.moving_stops import move_stops
from impact_damper_ros.motion.next_event import (
    DONE,
    GOING,
    LAW_FAILED,
    SPENT,
    STEP_DUE,
    TIME_MARGIN,
    count_modes,
)
from impact_damper_ros.motion.state import Moving, Run, carried_to
from impact_damper_ros.motion.transition import begin_from, report_support
from impact_damper_ros.motion.zero_passage import pass_zero, set_side

#: Each `Action` as a number, for the kernels.
_COMMAND, _ARRIVED, _TOUCHED, _PASSAGE, _STARTED, _ = map(int, Action)

#: What comes next in a run besides events, in the order of acts at one instant: a passage of X, a
#: command, a sample of the control, a step of the sine, of a record, a requested sample, the end.
ACT_PASSAGE, ACT_COMMAND, ACT_SENSE, ACT_SWEEP, ACT_RECORD, ACT_SAMPLE, ACT_END = range(7)
#: Times of a rig without measured records: no value acts at any time.
NO_TIMES: list[float] = [inf, inf]


class Schedule(NamedTuple):
    """
    What a run does at given times.

    Attributes
    ----------
    instants : sequence of float
        When the motion is sampled, s.
    samples : ndarray of float, shape (n, 11)
        Rows of these samples.
    force_times, force_values : sequence of float
        Since when each value of a measured force acts, s and N. Infinity is the last time.
    base_times, base_values : sequence of float
        The same of a measured acceleration of the base, m/s^2.
    """

    instants: Any
    samples: Any
    force_times: Sequence[float]
    force_values: Sequence[float]
    base_times: Sequence[float]
    base_values: Sequence[float]


@kernel
def measure(
    moving: Moving,
    settings: ControlSettings,
    estimates: Estimates,
    index: int,
) -> Measurement:
    """Return the sample of an index that the sensors take at the present time."""
    run = moving.run
    view: View = view_at(moving, run.now)
    return sensor_sample(
        settings,
        estimates,
        index,
        run.now,
        view.x,
        view.velocity,
        view.y,
        view.y_rate,
        view.stop_1,
        view.stop_2,
    )


@kernel
def stops_now(moving: Moving) -> tuple[float, float]:
    """Return where the stops are at the present time, Y in m."""
    run = moving.run
    tau = max(0.0, (run.now - run.time) - run.time_low)
    travel = 0.0
    if run.arrival < inf:
        # A stop follows m.
        motion: Motion = motion_at(moving, tau)
        travel = motion.travel
    _, _, stop_1, stop_2 = places_after(run, tau, travel)
    return stop_1, stop_2


@kernel
def write_act(control: Control, acts: Sequence[ActRow], action: int, time: float) -> None:
    """Write an act of the control, but not the same twice: two stops may arrive together."""
    controller = control.controller
    if controller.room == 0:
        return
    actuators = control.actuators
    x_rate = control.estimates.x_rate
    row = acts[controller.recorded]
    row.time = time
    row.action = action
    row.target_1 = actuators.target_1
    row.target_2 = actuators.target_2
    row.amplitude = control.estimates.amplitude
    row.velocity_1 = actuators.velocity_1
    row.velocity_2 = actuators.velocity_2
    row.x_rate = x_rate if x_rate == x_rate else 0.0
    row.energy_1 = actuators.energy_1
    row.energy_2 = actuators.energy_2
    if controller.recorded > 0:
        last = acts[controller.recorded - 1]
        if (
            last.time == row.time
            and last.action == row.action
            and last.target_1 == row.target_1
            and last.target_2 == row.target_2
            and last.amplitude == row.amplitude
            and last.velocity_1 == row.velocity_1
            and last.velocity_2 == row.velocity_2
            and last.x_rate == row.x_rate
            and last.energy_1 == row.energy_1
            and last.energy_2 == row.energy_2
        ):
            return
    controller.recorded += 1


@kernel
def note_stops(run: Run, log: Log, control: Control, acts: Sequence[ActRow], first: int) -> None:
    """Note the stops that arrived, met m or moved on, by the events from a row on."""
    for k in range(first, run.written):
        row = log[k]
        if row.kind == STOP_ARRIVED:
            note_velocity(control, row.stop, 0.0)
            write_act(control, acts, _ARRIVED, row.time)
        elif row.kind == STOP_TOUCHED:
            note_velocity(control, row.stop, 0.0)
            write_act(control, acts, _TOUCHED, row.time)
        elif row.kind == STOP_STARTED:
            velocity = run.stop_velocity_1 if row.stop == 1 else run.stop_velocity_2
            note_velocity(control, row.stop, velocity)
            write_act(control, acts, _STARTED, row.time)


@kernel
def perform_passage(moving: Moving, control: Control, acts: Sequence[ActRow]) -> None:
    """Write a passage of X through zero, and let the control act on it."""
    _, _, run, _, log = moving
    write_passage(moving)
    pass_zero(run)
    run.happened += 1
    if is_ignored(control, run.now):
        return
    rising = log[run.written - 1].primary_velocity_after > 0.0
    number = passage_index(control)
    seen = measure(moving, control.settings, control.estimates, number)
    take_passage(control, seen, rising)
    write_act(control, acts, _PASSAGE, run.now)


@kernel
def perform_command(
    moving: Moving,
    in_mode: MutableSequence[float],
    control: Control,
    acts: Sequence[ActRow],
) -> None:
    """Carry out the command that is due."""
    _, _, run, _, log = moving
    place_1, place_2 = stops_now(moving)
    target_1, target_2, speed = start_command(control, place_1, place_2)
    write_act(control, acts, _COMMAND, run.now)
    first = run.written
    count_modes(run, in_mode)
    move_stops(moving, target_1, target_2, speed)
    run.happened += run.written - first
    note_stops(run, log, control, acts, first)


@kernel(inline=True)
def quiet_until(run: Run) -> float:
    """Return the instant before which nothing happens, as far as the flight has been searched."""
    quiet = run.due
    if quiet == inf:
        reached = run.time + run.searched
        quiet = reached - TIME_MARGIN * abs(reached)
    if not run.watch:
        return quiet
    passage = run.crossing
    if passage == inf:
        reached = run.time + run.watched
        passage = reached - TIME_MARGIN * abs(reached)
    return min(quiet, passage)


@kernel
def perform_samples(moving: Moving, control: Control, end: float) -> None:
    """Take the sample that is due, and those before an instant up to which all else is quiet."""
    run = moving.run
    until = min(quiet_until(run), end)
    while True:
        if run.watch and not is_blind(control):
            index = control.controller.sample_index
            seen = measure(moving, control.settings, control.estimates, index)
            take_sample(control, seen)
        if control.controller.returning:
            place_1, place_2 = stops_now(moving)
            note_return(control, place_1, place_2)
        end_sample(control)
        if not run.watch or run.steps <= 0 or control.controller.returning:
            return
        if commands_full(control) or law_failed(control):
            return
        sample = next_sample(control)
        if not sample < min(until, next_command(control)):
            return
        run.now = sample
        run.steps -= 1


@kernel
def hold_base(run: Run, acceleration: float) -> None:
    """Let a measured acceleration of the base act from the origin of a flight on."""
    if run.carried:
        run.base_place, run.base_speed = carried_to(run, run.time)
    run.carried = True
    run.base_from = run.time
    run.base_acceleration = acceleration


@kernel
def perform_step(moving: Moving, in_mode: MutableSequence[float], schedule: Schedule) -> None:
    """Let the next values of the measured records that are due act."""
    _, _, run, _, log = moving
    mode = run.mode
    side = run.crossing_side
    count_modes(run, in_mode)
    move_to(moving, run.now)
    if side != 0:
        set_side(moving, side)
    if schedule.force_times[run.force_step + 1] == run.now:
        run.force_step += 1
        run.recorded_force = schedule.force_values[run.force_step]
    if schedule.base_times[run.base_step + 1] == run.now:
        run.base_step += 1
        hold_base(run, schedule.base_values[run.base_step])
    first = run.written
    begin_from(moving)
    if run.written == first:
        report_support(run, log, mode)
    run.happened += run.written - first


@kernel(inline=True)
def has_room(run: Run, control: Any) -> bool:
    """Return whether the tables of events and of acts have room for what comes next."""
    if 0 < run.room < run.written + ROWS_AT_ONCE:
        return False
    if control is None:
        return True
    controller = control.controller
    return not 0 < controller.room < controller.recorded + ROWS_AT_ONCE


@kernel(inline=True)
def next_step(run: Run, schedule: Schedule) -> float:
    """Return when the next value of a measured record acts, s; infinity after the last one."""
    return min(schedule.force_times[run.force_step + 1], schedule.base_times[run.base_step + 1])


@kernel(inline=True)
def next_of_schedule(run: Run, schedule: Schedule, end: float) -> tuple[float, int]:
    """Return what a run does next at a given time, up to its end: the instant, s, and what."""
    time = end
    act = ACT_END
    if run.sampled < len(schedule.instants) and schedule.instants[run.sampled] <= time:
        time = schedule.instants[run.sampled]
        act = ACT_SAMPLE
    due = next_step(run, schedule)
    if due <= time:
        time = due
        act = ACT_RECORD
    if run.sweep_due <= time:
        time = run.sweep_due
        act = ACT_SWEEP
    return time, act


@kernel(inline=True)
def next_act(run: Run, control: Any, schedule: Schedule, end: float) -> tuple[float, int]:
    """Return the next act of a run, up to its end, as `next_of_schedule` does."""
    time, act = next_of_schedule(run, schedule, end)
    if control is not None:
        sample = next_sample(control)
        if sample <= time:
            time = sample
            act = ACT_SENSE
        command = next_command(control)
        if command <= time:
            # It may be due in the past, after the delay has been shortened.
            time = command
            act = ACT_COMMAND
    return max(run.now, time), act


@kernel
def take_rows(moving: Moving, control: Any, schedule: Schedule) -> None:
    """Take the requested sample that is due, and those before anything else happens."""
    run = moving.run
    until = min(quiet_until(run), next_step(run, schedule), run.sweep_due)
    if control is not None:
        until = min(until, next_sample(control), next_command(control))
    while True:
        row = sample_at(moving, run.now)
        for k in range(11):
            schedule.samples[run.sampled, k] = row[k]
        run.sampled += 1
        if run.sampled == len(schedule.instants) or run.steps <= 0:
            return
        instant = schedule.instants[run.sampled]
        if not instant < until:
            return
        run.now = instant
        run.steps -= 1


@kernel
def perform(
    act: int,
    time: float,
    moving: Moving,
    in_mode: MutableSequence[float],
    control: Any,
    acts: Any,
    schedule: Schedule,
    end: float,
) -> int:
    """Perform an act that is due; return `GOING`, or why the run ends before it or after it."""
    run = moving.run
    spent = run.happened >= run.most
    if spent and act == ACT_PASSAGE:
        return SPENT
    run.now = time
    if act == ACT_SAMPLE:
        take_rows(moving, control, schedule)
        return GOING
    if act == ACT_END:
        return DONE
    if spent and act != ACT_SENSE:
        return SPENT
    if act == ACT_SWEEP:
        return STEP_DUE
    if act == ACT_RECORD:
        perform_step(moving, in_mode, schedule)
        return GOING
    if control is not None:
        if act == ACT_COMMAND:
            perform_command(moving, in_mode, control, acts)
            return GOING
        if act == ACT_PASSAGE:
            perform_passage(moving, control, acts)
        else:
            until, _ = next_of_schedule(run, schedule, end)
            perform_samples(moving, control, until)
        if law_failed(control):
            return LAW_FAILED
    return GOING
