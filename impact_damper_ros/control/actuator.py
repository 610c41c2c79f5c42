"""
The actuators of the stops: a delay, a speed, and what they spend.

A command waits for the delay and then moves its stop, in place of the command before. The rig
decides what happens where a stop meets m.

The energy is that of the stop itself, of mass `actuator_mass`: each start and each reversal spends
its kinetic energy at full speed, none of which is recovered by braking. Friction of the guides,
and weight and inertia in the moving M, are left out. An actuator that moves at once spends none.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

from impact_damper_ros.rig import GapControlParameters

from .sensors import LENGTH, SPEED, TIME, Kinds


class Command(NamedTuple):
    """
    Targets of the stops.

    Attributes
    ----------
    time : float
        When the stops start, s.
    stop_1, stop_2 : float or None
        Target Y of each stop, m; None leaves it alone.
    """

    time: float
    stop_1: float | None
    stop_2: float | None


@dataclass(slots=True)
class Actuators:
    """
    State of both actuators; every field goes through JSON.

    Attributes
    ----------
    waiting : list of Command
        Commands to be carried out, in that order.
    targets : list of float
        Target of the last command to each stop that was carried out, Y in m.
    commanded : list of float
        Target of the last command to each stop, Y in m.
    velocities : list of float
        Velocity of each stop in M, m/s.
    energies : list of float
        Energy spent by each so far, J.
    """

    KINDS: ClassVar[Kinds] = {
        'waiting': (TIME, LENGTH, LENGTH),
        'targets': LENGTH,
        'commanded': LENGTH,
        'velocities': SPEED,
    }

    waiting: list[Command] = field(default_factory=list)
    targets: list[float] = field(default_factory=lambda: [0.0, 0.0])
    commanded: list[float] = field(default_factory=lambda: [0.0, 0.0])
    velocities: list[float] = field(default_factory=lambda: [0.0, 0.0])
    energies: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def settle(self, half_gap: float) -> None:
        """Place the stops at half the gap, without commands."""
        self.waiting = []
        self.targets = [half_gap, -half_gap]
        self.commanded = [half_gap, -half_gap]
        self.velocities = [0.0, 0.0]

    @property
    def due(self) -> float | None:
        """When the next command is carried out, s."""
        return self.waiting[0].time if self.waiting else None

    def order(
        self, issue: float, stop_1: float | None, stop_2: float | None, p: GapControlParameters
    ) -> None:
        """Give a command at an instant, now or ahead."""
        command = Command(issue + p.actuator_delay, stop_1, stop_2)
        place = len(self.waiting)
        while place and self.waiting[place - 1].time > command.time:
            place -= 1
        self.waiting.insert(place, command)
        for i, target in enumerate((stop_1, stop_2)):
            if target is not None:
                self.commanded[i] = target

    def start(
        self, places: tuple[float, float], p: GapControlParameters
    ) -> tuple[float | None, float | None]:
        """Begin the next command, and return its targets."""
        _, stop_1, stop_2 = self.waiting.pop(0)
        for i, target in enumerate((stop_1, stop_2)):
            if target is None:
                continue
            self.targets[i] = target
            way = target - places[i]
            velocity = 0.0
            if way != 0.0:
                velocity = p.actuator_speed if way > 0.0 else -p.actuator_speed
            if velocity not in (0.0, self.velocities[i]):
                self.energies[i] += 0.5 * p.actuator_mass * p.actuator_speed**2
            self.velocities[i] = velocity
        return stop_1, stop_2

    def stopped(self, stop: int, place: float) -> None:
        """Note that a stop stands, at its target or at m, Y in m."""
        i = stop - 1
        self.velocities[i] = 0.0
        if all(command[1 + i] is None for command in self.waiting):
            # The next command starts from here.
            self.commanded[i] = place
