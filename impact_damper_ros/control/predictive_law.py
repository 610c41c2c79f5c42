# SPDX-License-Identifier: Apache-2.0
"""
The predictive law: places that the model of the rig itself finds to be the best.

At each passage of X through zero the motion ahead is computed, by the equations of the simulator
and from its exact state, with the stops at one pair of places after the other. The stops are sent
where the vibration of M has the least energy at the end of a horizon. No real controller knows
so much: the law shows what knowing the structure and the force is worth.

Each stop is tried around half the optimal gap of the present amplitude, then both more and more
finely around the best pair. The model holds the delay and the speed of the actuators; it leaves
out commands that still wait, and the steps of a stepped sine.
"""

from __future__ import annotations

from impact_damper_ros.motion.compiled import kernel
from impact_damper_ros.motion.event import Log
from impact_damper_ros.motion.flight import (
    Lines,
    Motion,
    Waves,
    begin_next_flight,
    motion_at,
    move_to,
)
from impact_damper_ros.motion.next_event import go_ahead
from impact_damper_ros.motion.state import RigConstants, Run, copy_state
from impact_damper_ros.motion.transition import send_stops

from .law import best_gap, place_stops
from .state import Actuators, Control, Measurement

#: Places tried on either side of the middle one at first; their step, over half the optimal gap.
_TRIES, _FIRST_STEP = 8, 0.125
#: How often the best place is sought again, and the step then, over that before.
_REFINEMENTS, _FINER = 3, 0.4
#: A stop is not moved by less than this part of its place.
_WORTH_A_MOVE = 0.005


@kernel
def energy_ahead(
    control: Control, rig: RigConstants, lines: Lines, log: Log, stop_1: float, stop_2: float
) -> float:
    """Return the energy of M at the end of the horizon, over M/2, with the stops sent off."""
    p = control.settings
    run = control.trial
    waves = control.trial_waves
    copy_state(control.start, control.start_waves, run, waves)
    end = run.time + p.horizon * control.observer.half_cycle
    run.room = 0
    send_stops(rig, lines, run, waves, log, stop_1, run.stop_2 if p.one_sided else stop_2, p.speed)
    tau = go_ahead(rig, lines, run, waves, log, end)
    motion: Motion = motion_at(rig, lines, run, waves, tau)
    return motion.velocity * motion.velocity + rig.free.omega_squared * motion.x * motion.x


@kernel
def improved(
    control: Control,
    rig: RigConstants,
    lines: Lines,
    log: Log,
    best: tuple[float, float, float],
    stop: int,
    centre: float,
    step: float,
    tries: int,
) -> tuple[float, float, float]:
    """Return the best places and their energy, with a stop (0 for both) tried around a place."""
    p = control.settings
    least, place_1, place_2 = best
    widest = 0.5 * p.gap_max
    for k in range(-tries, tries + 1):
        tried = min(max(centre + k * step, -widest), widest)
        stop_1 = tried if stop != 2 else best[1]
        stop_2 = -tried if stop != 1 else best[2]
        if stop_1 - stop_2 >= p.gap_min:
            energy = energy_ahead(control, rig, lines, log, stop_1, stop_2)
            if energy < least:
                least = energy
                place_1 = stop_1
                place_2 = stop_2
    return least, place_1, place_2


@kernel
def predictive_law_crosses(
    control: Control,
    seen: Measurement,
    rig: RigConstants,
    lines: Lines,
    run: Run,
    waves: Waves,
    log: Log,
) -> None:
    """Send both stops to the best places, at a passage of X through zero."""
    p = control.settings
    actuators: Actuators = control.actuators
    start = control.start
    copy_state(run, waves, start, control.start_waves)
    begin_next_flight(rig, lines, start, control.start_waves)
    move_to(rig, lines, start, control.start_waves, seen.time)
    begin_next_flight(rig, lines, start, control.start_waves)
    start.now = seen.time
    later = seen.time + p.delay
    go_ahead(rig, lines, start, control.start_waves, log, later)
    move_to(rig, lines, start, control.start_waves, later)
    unit = 0.5 * best_gap(control)
    place_1 = actuators.commanded_1
    place_2 = actuators.commanded_2
    best = (energy_ahead(control, rig, lines, log, place_1, place_2), place_1, place_2)
    step = unit * _FIRST_STEP
    tries = _TRIES
    for fineness in range(1 + _REFINEMENTS):
        if p.independent:
            centre = 0.5 * unit if fineness == 0 else best[1]
            best = improved(control, rig, lines, log, best, 1, centre, step, tries)
            centre = 0.5 * unit if fineness == 0 else -best[2]
            best = improved(control, rig, lines, log, best, 2, centre, step, tries)
        else:
            centre = unit if fineness == 0 else best[1]
            best = improved(control, rig, lines, log, best, 0, centre, step, tries)
        step *= _FINER
        tries = 1
    place_stops(control, seen.time, best[1], best[2], _WORTH_A_MOVE)
