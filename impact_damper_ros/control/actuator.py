# SPDX-License-Identifier: Apache-2.0
"""
The actuators of the stops: their delay, speed and energy.

A command waits for the delay and then moves its stop, in place of the command before. The rig
decides what happens where a stop meets m: the stop stands there, and moves on as soon as m lets
it.

The energy is that of the stop itself, of mass `actuator_mass`: each start and each reversal spends
its kinetic energy at its speed, none of which is recovered by braking. Friction of the guides,
and weight and inertia in the moving M, are left out. A stop that moves at once spends none.

Commands that wait are rows of `WaitingCommand` in a ring that begins at `first`, in the order in
which they are carried out.
"""

from __future__ import annotations

from math import inf, nan

from impact_damper_ros.motion.kernels import kernel

from .state import Actuators, Control

#: Most commands that one sample or crossing gives.
MOST_ORDERS = 4


@kernel
def settle_stops(control: Control) -> None:
    """Place the stops at half the gap, without commands."""
    actuators: Actuators = control.actuators
    half_gap = control.settings.half_gap
    actuators.waiting = 0
    actuators.target_1 = half_gap
    actuators.target_2 = -half_gap
    actuators.commanded_1 = half_gap
    actuators.commanded_2 = -half_gap
    actuators.velocity_1 = 0.0
    actuators.velocity_2 = 0.0


@kernel(inline=True)
def next_command(control: Control) -> float:
    """Return when the next command is carried out, s; infinity if none waits."""
    actuators: Actuators = control.actuators
    if actuators.waiting == 0:
        return inf
    due: float = control.commands[actuators.first].time
    return due


@kernel(inline=True)
def commands_full(control: Control) -> bool:
    """Return whether one sample or crossing might give more commands than there is room for."""
    return control.actuators.waiting + MOST_ORDERS > len(control.commands)


@kernel
def order_stops(
    control: Control, issue: float, stop_1: float, stop_2: float, speed: float
) -> None:
    """Give a command at an instant, now or ahead; the speed is NaN for that of the actuators."""
    actuators: Actuators = control.actuators
    rows = control.commands
    time = issue + control.settings.actuator_delay
    place = actuators.waiting
    while place > 0:
        earlier = rows[(actuators.first + place - 1) % len(rows)]
        if earlier.time <= time:
            break
        later = rows[(actuators.first + place) % len(rows)]
        later.time = earlier.time
        later.stop_1 = earlier.stop_1
        later.stop_2 = earlier.stop_2
        later.speed = earlier.speed
        place -= 1
    row = rows[(actuators.first + place) % len(rows)]
    row.time = time
    row.stop_1 = stop_1
    row.stop_2 = stop_2
    row.speed = speed
    actuators.waiting += 1
    if stop_1 == stop_1:
        actuators.commanded_1 = stop_1
    if stop_2 == stop_2:
        actuators.commanded_2 = stop_2


@kernel(inline=True)
def starting_velocity(way: float, speed: float) -> float:
    """Return the velocity at which a stop starts on its way; 0 for one that moves at once."""
    rate = speed if speed < inf else 0.0
    if way > 0.0:
        return rate
    return -rate if way < 0.0 else 0.0


@kernel(inline=True)
def start_energy(mass: float, velocity: float) -> float:
    """Return the energy that a start of a stop takes, J; 0 for one that moves at once."""
    return 0.5 * mass * (velocity * velocity) if abs(velocity) < inf else 0.0


@kernel
def start_command(control: Control, place_1: float, place_2: float) -> tuple[float, float, float]:
    """
    Begin the next command with the stops at two places, Y in m.

    Returns its targets, Y in m, NaN to leave a stop alone, and its speed, m/s.
    """
    actuators: Actuators = control.actuators
    p = control.settings
    row = control.commands[actuators.first]
    stop_1 = nan if p.blocked_1 else row.stop_1
    stop_2 = nan if p.one_sided or p.blocked_2 else row.stop_2
    speed = p.speed * p.pace
    if row.speed == row.speed:
        speed = min(row.speed, speed)
    energy = start_energy(p.actuator_mass, speed)
    actuators.first = (actuators.first + 1) % len(control.commands)
    actuators.waiting -= 1
    if stop_1 == stop_1:
        velocity = starting_velocity(stop_1 - place_1, speed)
        if velocity != 0.0 and velocity != actuators.velocity_1:
            actuators.energy_1 += energy
        actuators.target_1 = stop_1
        actuators.velocity_1 = velocity
    if stop_2 == stop_2:
        velocity = starting_velocity(stop_2 - place_2, speed)
        if velocity != 0.0 and velocity != actuators.velocity_2:
            actuators.energy_2 += energy
        actuators.target_2 = stop_2
        actuators.velocity_2 = velocity
    return stop_1, stop_2, speed


@kernel(inline=True)
def note_velocity(control: Control, stop: int, velocity: float) -> None:
    """Note the velocity of a stop that has arrived, has met m, or moves on behind m."""
    actuators: Actuators = control.actuators
    if velocity != 0.0:
        p = control.settings
        energy = start_energy(p.actuator_mass, velocity)
        actuators.energy_1 += energy if stop == 1 else 0.0
        actuators.energy_2 += energy if stop == 2 else 0.0
    if stop == 1:
        actuators.velocity_1 = velocity
    else:
        actuators.velocity_2 = velocity
