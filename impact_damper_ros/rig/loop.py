# SPDX-License-Identifier: Apache-2.0
"""
The run loop: the next event or the next act of the control, whichever is earlier.

Samples of the control lie on the grid k/rate; passages of X through zero and the starts of stops
are at their own exact instants. With the control off, or without one, nothing but events happens.
"""

from __future__ import annotations

from collections.abc import Callable, MutableSequence, Sequence
from math import inf
from typing import Any

import numpy as np

from impact_damper_ros.control.actuator import (
    commands_full,
    next_command,
    note_velocity,
    start_command,
)
from impact_damper_ros.control.controller import (
    end_sample,
    has_law,
    holds_off,
    is_blind,
    measured,
    next_sample,
    note_return,
    take_crossing,
    take_sample,
    trigger_number,
)
from impact_damper_ros.control.own_law import law_failed
from impact_damper_ros.control.record import Action, ActRow
from impact_damper_ros.control.state import Control, ControlSettings, Estimates, Measurement
from impact_damper_ros.motion.compiled import compiled, dtype_of, kernel
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
from impact_damper_ros.motion.first_event import pass_zero
from impact_damper_ros.motion.flight import Motion, motion_at, places_after
from impact_damper_ros.motion.next_event import (
    COMMANDS_FULL,
    DONE,
    FULL,
    GOING,
    LAW_FAILED,
    PAUSED,
    SPENT,
    TIME_MARGIN,
    count_modes,
    find_event,
    find_passage,
    next_event,
)
from impact_damper_ros.motion.state import Lines, Moving, RigConstants, Run, Wave, Waves
from impact_damper_ros.motion.transition import begin_from, move_stops

#: Each `Action` as a number, for the kernels.
_COMMAND, _ARRIVED, _TOUCHED, _CROSSING, _STARTED, _ = map(int, Action)


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
    return measured(
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
    """Write what the control did, but not the same twice: stops arrive together."""
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
    """Note the stops that arrived, met m or went on, by the events from a row on."""
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
def perform_passage(
    moving: Moving,
    control: Control,
    acts: Sequence[ActRow],
) -> None:
    """Let the control act on the passage of X through zero that the last event reports."""
    _, _, run, _, log = moving
    if holds_off(control, run.now):
        return
    rising = log[run.written - 1].primary_velocity_after > 0.0
    number = trigger_number(control)
    seen = measure(moving, control.settings, control.estimates, number)
    take_crossing(control, seen, rising)
    write_act(control, acts, _CROSSING, run.now)


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
    crossing = run.crossing
    if crossing == inf:
        reached = run.time + run.watched
        crossing = reached - TIME_MARGIN * abs(reached)
    return min(quiet, crossing)


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
def run_to(
    moving: Moving,
    in_mode: MutableSequence[float],
    control: Any,
    acts: Any,
    end: float,
) -> int:
    """
    Go from event to event and act to act, up to an instant, s; return why it stopped.

    `control` and `acts` are None for a rig without control: its compiled loop has no code of it.
    """
    _, _, run, _, log = moving
    while True:
        until = end
        command = inf
        sample = inf
        if control is not None:
            if 0 < run.room < run.written + ROWS_AT_ONCE:
                return FULL
            if 0 < control.controller.room < control.controller.recorded + ROWS_AT_ONCE:
                return FULL
            if commands_full(control):
                return COMMANDS_FULL
            run.watch = has_law(control)
            command = next_command(control)
            sample = next_sample(control)
            # A command may be due in the past, after the delay has been shortened.
            until = max(run.now, min(command, sample, end))
        if run.steps <= 0 and run.now < end:
            return PAUSED
        run.steps -= 1
        if not find_event(moving, until):
            return PAUSED
        if control is not None:
            if run.watch and not find_passage(moving, until):
                return PAUSED
            if run.crossing <= until and run.crossing <= run.due and run.watch:
                if run.happened >= run.most:
                    return SPENT
                run.now = run.crossing
                write_passage(moving)
                pass_zero(run)
                run.happened += 1
                perform_passage(moving, control, acts)
                if law_failed(control):
                    return LAW_FAILED
                continue
        if run.due <= until:
            first = run.written
            status = next_event(moving, in_mode)
            if status != GOING:
                return status
            if control is not None:
                note_stops(run, log, control, acts, first)
            continue
        run.now = until
        if control is not None:
            if command <= until:
                if run.happened >= run.most:
                    return SPENT
                perform_command(moving, in_mode, control, acts)
                continue
            if sample <= until:
                perform_samples(moving, control, end)
                if law_failed(control):
                    return LAW_FAILED
                continue
        return DONE


@kernel
def run_through(
    moving: Moving,
    in_mode: MutableSequence[float],
    control: Any,
    acts: Any,
    end: float,
    instants: Any,
    sampled: int,
    samples: Any,
) -> tuple[int, int]:
    """Let a rig run to a later time, as `run_to` does, with samples at instants."""
    status = DONE
    while sampled < len(instants):
        instant = instants[sampled]
        status = run_to(moving, in_mode, control, acts, instant)
        if status != DONE:
            break
        row = sample_at(moving, instant)
        for k in range(11):
            samples[sampled, k] = row[k]
        sampled += 1
    if status == DONE:
        status = run_to(moving, in_mode, control, acts, end)
    return status, sampled


@kernel
def run_one(
    k: int,
    waves: Waves,
    control: Any,
    acts: Any,
    constants: Sequence[RigConstants],
    lines: Sequence[Lines],
    runs: Sequence[Run],
    log: Log,
    in_mode: Any,
    end: float,
    instants: Any,
    outcomes: Any,
    sampled: Any,
    samples: Any,
    anew: bool,
) -> None:
    """
    Let one of some rigs run to a time, from its start if `anew`; why it stopped is in `outcomes`.

    `control` and `acts` are None for a rig without control. The events of rigs that run `anew` are
    not kept; `log` is where their control finds what the stops do.
    """
    run = runs[k]
    moving = Moving(constants[k], lines[k], run, waves, log)
    if anew:
        begin_from(moving)
    status = FULL
    count = sampled[k]
    while status == FULL:
        run.written = 0
        status, count = run_through(
            moving, in_mode[k], control, acts, end, instants, count, samples[k]
        )
        if not anew:
            break
    if anew:
        count_modes(run, in_mode[k])
    outcomes[k] = status
    sampled[k] = count


@kernel
def run_each(waves: Sequence[Waves], rest: Any) -> int:
    """Let each rig run as `run_one` does, without control, given the rest of its arguments."""
    for k in range(len(waves)):
        run_one(k, waves[k], None, None, *rest)
    return len(waves)


@kernel
def run_each_with_one_harmonic(waves: Sequence[Wave], rest: Any) -> int:
    """Run rigs with one harmonic without loops over it, as a tuple has a fixed length."""
    for k in range(len(waves)):
        run_one(k, (waves[k],), None, None, *rest)
    return len(waves)


@kernel
def run_each_under_control(waves: Sequence[Waves], controls: Any, acts: Any, rest: Any) -> int:
    """Let each rig run as `run_one` does, under its own control."""
    for k in range(len(waves)):
        # Here, as no compiled function can return it
        control = Control(
            controls.controller[k],
            controls.estimates[k],
            controls.search[k],
            controls.actuators[k],
            controls.commands[k],
            controls.settings[k],
            controls.amplitude_law[k],
            controls.timed_law[k],
            controls.refusal[k],
            controls.memory[k],
            controls.law,
        )
        run_one(k, waves[k], control, acts, *rest)
    return len(waves)


#: A table of acts that has no room.
NO_ACTS: Any = np.empty(0, dtype_of(ActRow))


def run_compiled(
    constants: Any,
    lines: Any,
    runs: Any,
    waves: Any,
    log: Any,
    in_mode: Any,
    controls: Control | None,
    end: float,
    instants: Any,
    outcomes: Any,
    sampled: Any,
    samples: Any,
    acts: Any = NO_ACTS,
    *,
    anew: bool = False,
) -> None:
    """Run arrays of rigs as `run_one` does, compiled."""
    rest = constants, lines, runs, log, in_mode, end, instants, outcomes, sampled, samples, anew
    entry: Callable[..., int] = run_each
    arguments: tuple[Any, ...] = waves, rest
    if controls is not None:
        entry, arguments = run_each_under_control, (waves, controls, acts, rest)
    elif waves.shape[1] == 1:
        entry, arguments = run_each_with_one_harmonic, (waves[:, 0], rest)
    try:
        compiled(entry.__name__, arguments)(*arguments)
    except SystemError as error:
        # What a signal raises just as compiled code returns
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise error.__cause__ from None
        raise
