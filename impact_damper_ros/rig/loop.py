# SPDX-License-Identifier: Apache-2.0
"""
The run loop: the next event or the next act, whichever is earlier.

Acts are what happens to a rig at given times: samples and commands of its control, the next value
of a measured record, a step of the stepped sine, and the instants of requested samples. Samples of
the control lie on the grid k/rate; passages of X through zero and the starts of stops are at their
own exact instants.
"""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.control.act import Action, ActRow
from impact_damper_ros.control.actuator import (
    commands_full,
    next_command,
    note_velocity,
    start_command,
)
from impact_damper_ros.control.controller import (
    end_sample,
    has_law,
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
    Sample,
    View,
    sample_at,
    view_at,
    write_passage,
)
from impact_damper_ros.motion.flight import Motion, motion_at, move_to, places_after
from impact_damper_ros.motion.kernels import compiled_kernel, dtype_of, kernel, only_row
from impact_damper_ros.motion.moving_stops import move_stops
from impact_damper_ros.motion.next_event import (
    COMMANDS_FULL,
    DONE,
    FULL,
    GOING,
    LAW_FAILED,
    PAUSED,
    SPENT,
    STEP_DUE,
    TIME_MARGIN,
    count_event,
    count_modes,
    may_go_on,
    next_event,
    next_passage,
)
from impact_damper_ros.motion.state import Moving, Run, carried_to
from impact_damper_ros.motion.transition import begin_from, report_support, resolve
from impact_damper_ros.motion.zero_passage import pass_zero, set_side

#: Each `Action` as a number, for the kernels.
_COMMAND, _ARRIVED, _TOUCHED, _CROSSING, _STARTED, _ = map(int, Action)

#: What comes next in a run besides events, in the order of acts at one instant: a passage of X, a
#: command, a sample of the control, a step of the sine, of a record, a requested sample, the end.
ACT_CROSSING, ACT_COMMAND, ACT_SENSE, ACT_SWEEP, ACT_RECORD, ACT_SAMPLE, ACT_END = range(7)


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
    if spent and act == ACT_CROSSING:
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
        if act == ACT_CROSSING:
            perform_passage(moving, control, acts)
        else:
            until, _ = next_of_schedule(run, schedule, end)
            perform_samples(moving, control, until)
        if law_failed(control):
            return LAW_FAILED
    return GOING


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
                act = ACT_CROSSING
        if run.due <= time and act != ACT_CROSSING:
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


@dataclass(slots=True)
class Strobe:
    """
    A run that ends once its state comes back: states at the ends of cycles are compared.

    Attributes
    ----------
    start, cycle : float
        When it began, and the duration of a cycle, s.
    rate : float
        Circular frequency that makes velocities comparable with displacements, rad/s.
    tolerance : float
        Distance of two states, over the size of the motion, below which they are the same.
    most, most_events : int
        Most cycles, and most events.
    cycles, next : int
        Cycles that are done, and cycles at the next comparison.
    happened : int
        Events before the last comparison.
    """

    start: float
    cycle: float
    rate: float
    tolerance: float
    most: int
    most_events: int
    cycles: int = 0
    next: int = 0
    happened: int = 0


#: Cycles between two comparisons, and number of earlier states that the last one is compared with.
CYCLES_OF_A_LOOK = 50
_STATES_BEFORE = 16
#: Columns of samples that hold X, Z, X' and Z'.
_STATE_COLUMNS = [
    Sample._fields.index(n) for n in ('x', 'z', 'primary_velocity', 'damper_velocity')
]
_COLUMN_X, _COLUMN_Z, _COLUMN_V, _COLUMN_W = _STATE_COLUMNS


@kernel
def next_look(run: Run, schedule: Schedule, strobe: Strobe) -> float:
    """Request the states at the ends of cycles up to the next comparison; return its instant."""
    if strobe.next == strobe.cycles:
        strobe.next = min(strobe.cycles + CYCLES_OF_A_LOOK, strobe.most)
        run.sampled = 0
        for k in range(CYCLES_OF_A_LOOK):
            schedule.instants[k] = inf
            if strobe.cycles + k < strobe.next:
                # One rounding, so that the steps do not drift
                schedule.instants[k] = strobe.start + (strobe.cycles + k + 1.0) * strobe.cycle
    look: float = schedule.instants[strobe.next - strobe.cycles - 1]
    return look


@kernel
def comes_back(samples: Any, strobe: Strobe) -> bool:
    """Return whether the last of some states is close to one of those before it."""
    count = strobe.next - strobe.cycles
    if count < 2:
        return False
    last = count - 1
    x = samples[last, _COLUMN_X]
    y = samples[last, _COLUMN_Z] - x
    v = samples[last, _COLUMN_V]
    u = samples[last, _COLUMN_W] - v
    largest = 0.0
    low = inf
    high = -inf
    nearest = inf
    for k in range(count):
        place = samples[k, _COLUMN_X]
        way = samples[k, _COLUMN_Z] - place
        largest = max(largest, abs(place))
        low = min(low, way)
        high = max(high, way)
        if last - _STATES_BEFORE <= k < last:
            speed = samples[k, _COLUMN_V]
            relative = samples[k, _COLUMN_W] - speed
            apart = max(abs(place - x), abs(way - y))
            apart = max(apart, max(abs(speed - v), abs(relative - u)) / strobe.rate)
            nearest = min(nearest, apart)
    return nearest <= strobe.tolerance * (largest + (high - low))


@kernel
def goes_on(run: Run, schedule: Schedule, strobe: Strobe) -> bool:
    """Compare the states, and return whether the run goes on."""
    back = comes_back(schedule.samples, strobe)
    strobe.cycles = strobe.next
    if back or strobe.cycles == strobe.most:
        return False
    strobe.happened = strobe.most_events - run.most + run.happened
    return True


@kernel
def run_each(
    waves: Any,
    controls: Any,
    acts: Any,
    rigs: Any,
    log: Any,
    in_mode: Any,
    end: float,
    outcomes: Any,
    instants: Any,
    samples: Any,
    records: Any,
    anew: bool,
    strobes: Any,
) -> int:
    """
    Let each rig run as `run_to` does, and write into `outcomes` why it stopped.

    A rig runs from its start if `anew`, and until its motion comes back if there are strobes. Its
    events are not kept then: only its control reads them, in `log`. Rigs with one harmonic have a
    row of waves each, not an array, and their code has no loop over harmonics.
    """
    constants, lines, runs = rigs
    for k in range(len(waves)):
        run = runs[k]
        if waves.ndim == 1:
            wave = only_row(waves, k)
        else:
            wave = waves[k]
        if controls is None:
            control = None
        else:
            # The table is made here, since no compiled function can return one.
            control = Control(
                controls[0][k],
                controls[1][k],
                controls[2][k],
                controls[3][k],
                controls[4][k],
                controls[5][k],
                controls[6][k],
                controls[7][k],
                controls[8][k],
                controls[9][k],
                controls[10],
            )
        moving = Moving(constants[k], lines[k], run, wave, log)
        schedule = Schedule(instants, samples[k], records[0], records[1], records[2], records[3])
        if anew:
            begin_from(moving)
        status = FULL
        while status == FULL:
            run.written = 0
            until = end
            if len(strobes) > 0:
                until = next_look(run, schedule, strobes[k])
            status = run_to(moving, in_mode[k], control, acts, schedule, until)
            if len(strobes) > 0:
                if status == DONE and goes_on(run, schedule, strobes[k]):
                    status = FULL
            elif not anew:
                break
        if anew:
            count_modes(run, in_mode[k])
        outcomes[k] = status
    return len(waves)


#: Times and values of the measured records of a rig, as arrays.
Records = tuple[Any, ...]
#: Times of a rig without measured records: no value acts at any time.
NO_TIMES: list[float] = [inf, inf]
NO_RECORDS: Records = (np.array(NO_TIMES), np.empty(0), np.array(NO_TIMES), np.empty(0))
#: A table of acts without rows.
NO_ACTS: Any = np.empty(0, dtype_of(ActRow))
NO_STROBES: Any = np.empty(0, dtype_of(Strobe))


def run_compiled(
    rigs: tuple[Any, Any, Any],
    waves: Any,
    log: Any,
    in_mode: Any,
    controls: Control | None,
    end: float,
    instants: Any,
    outcomes: Any,
    samples: Any,
    *,
    acts: Any = NO_ACTS,
    records: Records = NO_RECORDS,
    anew: bool = False,
    strobes: Any = NO_STROBES,
) -> None:
    """Run arrays of rigs as `run_each` does, compiled."""
    alone = waves.shape[1] == 1 and controls is None
    arguments = (
        # For a named tuple numba would determine the type at each call.
        *(waves[:, 0] if alone else waves, None if controls is None else tuple(controls)),
        *(None if controls is None else acts, rigs),
        *(log, in_mode, end, outcomes, instants, samples, records, anew, strobes),
    )
    form = 'one harmonic' if alone else 'harmonics'
    if controls is not None:
        form = 'control' if controls.law is None else 'own law'
    try:
        compiled_kernel(run_each.__name__, arguments, form=form)(*arguments)
    except SystemError as error:
        # An error that a signal raises just as compiled code returns
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise error.__cause__ from None
        raise
