"""
The run loop under control: samples, passages of X through zero and commands, each at its instant.

Samples lie on the grid k/rate, passages and the starts of stops at their own exact instants, so
that the motion does not depend on how a run is cut into pieces. Between these instants the rig
runs by `rig.run_loop`; with the control off it runs as without control, bit for bit.
"""

from __future__ import annotations

from math import inf
from typing import Any

from impact_damper_ros.rig.contact import ALL_STEPS
from impact_damper_ros.rig.event import EventKind
from impact_damper_ros.rig.flight import Flight, Motion, motion_at
from impact_damper_ros.rig.kernels import kernel
from impact_damper_ros.rig.mode import RigConstants
from impact_damper_ros.rig.origin import Origin, offset_of, placed
from impact_damper_ros.rig.run_loop import (
    CROSSED,
    DONE,
    FULL,
    PAUSED,
    ROWS_AT_ONCE,
    SPENT,
    OpenFlight,
    accounted,
    clear_until,
    go_on,
    open_flight,
    state_at,
    stops_moved,
    write_sample,
)

from .actuator import commands_full, next_command, start_command, stop_stopped
from .controller import (
    LAW_NUMBERS,
    Control,
    end_sample,
    holds_off,
    measured,
    next_sample,
    take_crossing,
    take_sample,
    trigger_number,
)
from .own_law import law_failed
from .record import Action
from .sensors import Measurement

#: There is no room for more commands that wait.
COMMANDS_FULL = 6
#: A law of the user's own has returned what are no places.
LAW_FAILED = 7

_ARRIVED_EVENT = int(EventKind.STOP_ARRIVED)
_TOUCHED_EVENT = int(EventKind.STOP_TOUCHED)
_COMMAND_ACTION = int(Action.COMMAND)
_ARRIVED_ACTION = int(Action.ARRIVED)
_TOUCHED_ACTION = int(Action.TOUCHED)
_CROSSING_ACTION = int(Action.CROSSING)
_NAN = float('nan')
_PREDICTIVE = LAW_NUMBERS['predictive']


@kernel(inline=True)
def take_measurement(control: Control, here: OpenFlight, time: float, index: int) -> Measurement:
    """Return the sample of an index that the sensors take at an instant of a flight."""
    origin: Origin = here.origin
    flight: Flight = here.flight
    tau = max(0.0, (time - origin.time) - origin.time_low)
    motion: Motion = motion_at(flight, tau)
    clearance_1, clearance_2, stop_1, stop_2 = placed(origin, flight, tau, motion.travel)
    speed = 0.0 if flight.joint else motion.relative_velocity
    offset = offset_of(clearance_1, clearance_2, stop_1, stop_2)
    return measured(control, index, time, motion.x, motion.velocity, offset, speed, stop_1, stop_2)


@kernel
def places_of_stops(here: OpenFlight, time: float) -> tuple[float, float]:
    """Return where the stops are at an instant of a flight, Y in m."""
    flight: Flight = here.flight
    tau = max(0.0, (time - here.origin.time) - here.origin.time_low)
    travel = 0.0
    if flight.arrival < inf:
        # A stop follows m.
        motion: Motion = motion_at(flight, tau)
        travel = motion.travel
    _, _, stop_1, stop_2 = placed(here.origin, flight, tau, travel)
    return stop_1, stop_2


@kernel
def write_record(control: Control, action: int, time: float, records: Any, row: int) -> int:
    """Write a `ControlRecord`, but not the same one twice; return the next row."""
    actuators = control.actuators
    x_rate = control.observer.x_rate
    records[row, 0] = time
    records[row, 1] = action
    records[row, 2] = actuators.target_1
    records[row, 3] = actuators.target_2
    records[row, 4] = control.observer.amplitude
    records[row, 5] = actuators.velocity_1
    records[row, 6] = actuators.velocity_2
    records[row, 7] = x_rate if x_rate == x_rate else 0.0
    records[row, 8] = actuators.energy_1
    records[row, 9] = actuators.energy_2
    # Stops that arrive together make one record.
    if row > 0:
        for column in range(10):
            if records[row, column] != records[row - 1, column]:
                return row + 1
        return row
    return row + 1


@kernel
def note_stops(
    control: Control,
    numbers: Any,
    codes: Any,
    first: int,
    written: int,
    recording: bool,
    records: Any,
    recorded: int,
) -> int:
    """Note the stops that have arrived or met m, by the events; return the next record."""
    for row in range(first, written):
        kind = codes[row, 8]
        if kind in (_ARRIVED_EVENT, _TOUCHED_EVENT):
            arrived = kind == _ARRIVED_EVENT
            # Not the Y of an arrival, which is that of m: the encoder shows the target.
            stop_stopped(control, codes[row, 9], _NAN if arrived else numbers[row, 2])
            if recording:
                action = _ARRIVED_ACTION if arrived else _TOUCHED_ACTION
                recorded = write_record(control, action, numbers[row, 0], records, recorded)
    return recorded


@kernel
def sample_on(control: Control, here: OpenFlight, time: float, until: float) -> float:
    """Take the samples before an instant up to which nothing else happens; return the last."""
    while not (control.controller.returning or commands_full(control) or law_failed(control)):
        sample = next_sample(control)
        if not sample < min(until, next_command(control)):
            break
        time = sample
        index = control.controller.sample_index
        take_sample(control, take_measurement(control, here, time, index))
        end_sample(control, time, 0.0, 0.0)
    return time


@kernel
def go_under_control(
    rig: RigConstants,
    damper_mass: float,
    control: Control,
    here: OpenFlight,
    time: float,
    end: float,
    step_due: float,
    most: int,
    steps: int,
    numbers: Any,
    codes: Any,
    room: int,
    written: int,
    in_mode: Any,
    recording: bool,
    records: Any,
    recorded: int,
) -> tuple[int, float, OpenFlight, int, int, int]:
    """
    Let a rig under control run to an instant.

    Parameters
    ----------
    rig, damper_mass, here, time, most, steps, numbers, codes, room, written, in_mode
        As for `go_on`. There must be room for `ROWS_AT_ONCE` events at least.
    control : Control
        The control.
    end, step_due : float
        The instant, s, and that of the next step of a stepped sine, before which the loop ends.
    recording, records, recorded : bool, array, int
        Whether to write `ControlRecord`, the table of them, and how many are written.

    Returns
    -------
    status : int
        `DONE`, `FULL`, `SPENT`, `RUNAWAY`, `PAUSED`, `COMMANDS_FULL` or `LAW_FAILED`.
    time, here, written, happened
        As from `go_on`; passages of X through zero are counted too.
    recorded : int
        Records written in all.
    """
    happened = 0
    while True:
        status = DONE
        if commands_full(control):
            status = COMMANDS_FULL
        elif written + ROWS_AT_ONCE > room:
            status = FULL
        if status != DONE:
            break
        command = next_command(control)
        sample = next_sample(control)
        # A command may be due in the past, after the delay has been shortened.
        until = max(time, min(command, sample, end))
        stepping = step_due <= until
        if stepping:
            until = step_due
        first = written
        active = control.settings.law != 0
        status, time, here, written, count = go_on(
            rig,
            damper_mass,
            here,
            time,
            until,
            max(until, min(command, end, step_due)) if steps == ALL_STEPS else until,
            active,
            most - happened,
            steps,
            numbers,
            codes,
            room,
            written,
            in_mode,
        )
        happened += count
        recorded = note_stops(
            control, numbers, codes, first, written, recording, records, recorded
        )
        if status == CROSSED:
            happened += 1
            if not holds_off(control, time):
                rising = numbers[written - 1, 4] > 0.0
                seen = take_measurement(control, here, time, trigger_number(control))
                known: Origin = here.origin
                if control.settings.law == _PREDICTIVE:
                    known = state_at(here, time)
                take_crossing(control, seen, rising, rig, known)
                if recording:
                    recorded = write_record(control, _CROSSING_ACTION, time, records, recorded)
            status = DONE
            if happened >= most and time < end:
                status = SPENT
        elif status != DONE or stepping:
            break
        elif command <= until and happened >= most:
            status = SPENT
        elif command <= until:
            place_1, place_2 = places_of_stops(here, time)
            target_1, target_2 = start_command(control, place_1, place_2)
            if recording:
                recorded = write_record(control, _COMMAND_ACTION, time, records, recorded)
            first = written
            accounted(here, time, in_mode)
            origin, written = stops_moved(
                rig,
                damper_mass,
                here,
                time,
                active,
                target_1,
                target_2,
                control.settings.speed,
                numbers,
                codes,
                written,
            )
            here = open_flight(rig, origin, time)
            happened += written - first
            recorded = note_stops(
                control, numbers, codes, first, written, recording, records, recorded
            )
        elif sample <= until:
            if active:
                index = control.controller.sample_index
                take_sample(control, take_measurement(control, here, time, index))
            place_1 = 0.0
            place_2 = 0.0
            if control.controller.returning:
                place_1, place_2 = places_of_stops(here, time)
            end_sample(control, time, place_1, place_2)
            if active:
                time = sample_on(control, here, time, min(clear_until(here, True), end, step_due))
        else:
            break
        if law_failed(control):
            status = LAW_FAILED
        if status != DONE:
            break
        if steps < ALL_STEPS and time < end:
            status = PAUSED
            break
    return status, time, here, written, happened, recorded


@kernel
def run_controlled(
    rig: RigConstants,
    damper_mass: float,
    control: Control,
    origin: Origin,
    time: float,
    end: float,
    step_due: float,
    instants: Any,
    sampled: int,
    samples: Any,
    numbers: Any,
    codes: Any,
    written: int,
    keep: bool,
    most: int,
    in_mode: Any,
) -> tuple[int, tuple[Any, ...], float, int, int, int]:
    """Let a rig run to a later time, as `run_through` does; without `keep`, events are dropped."""
    here: OpenFlight = open_flight(rig, origin, time)
    happened = 0
    first = written
    count = len(instants)
    room = len(codes)
    while True:
        target = end
        if sampled < count:
            target = float(instants[sampled])
        status, time, here, written, passed, _ = go_under_control(
            rig,
            damper_mass,
            control,
            here,
            time,
            target,
            step_due,
            most - happened,
            ALL_STEPS,
            numbers,
            codes,
            room,
            written,
            in_mode,
            False,
            numbers,
            0,
        )
        happened += passed
        if status == FULL and not keep:
            written = first
            continue
        if status != DONE or sampled == count or time < target:
            break
        write_sample(samples, sampled, here, target)
        sampled += 1
    accounted(here, time, in_mode)
    return status, here.origin[:], time, sampled, written, happened
