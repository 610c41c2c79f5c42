# SPDX-License-Identifier: Apache-2.0
"""Single flights of a rig in plain Python, for solvers that go from flight to flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from operator import attrgetter
from typing import Any, NamedTuple

from impact_damper_ros.motion.flight import (
    Motion,
    begin_flight,
    motion_at,
    moving_mode,
    rest,
    starting_motion,
)
from impact_damper_ros.motion.impact import strike
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.motion.oscillator import Line
from impact_damper_ros.motion.records import pack
from impact_damper_ros.motion.state import (
    REST_1,
    REST_2,
    STICK,
    Moving,
    RigConstants,
    Run,
    Wave,
    constants_of,
)
from impact_damper_ros.motion.waves import turn_waves
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.snapshot import Snapshot
from impact_damper_ros.rig.stepped_sine import SteppedSine

_run_fields = attrgetter(*Run.__dataclass_fields__)


class Machine(NamedTuple):
    """Constants of a rig, and of its harmonics."""

    constants: RigConstants
    lines: list[Line]


# A search needs the constants for each guess.
@lru_cache(maxsize=64)
def machine_of(parameters: RigParameters) -> Machine:
    """Return the constants of a rig, which must not be changed."""
    return Machine(*constants_of(parameters))


@lru_cache(maxsize=64)
def packed_constants(parameters: RigParameters) -> Any:
    """Return the constants of a rig for kernels that are called, which must not be changed."""
    constants = machine_of(parameters).constants
    return pack(constants) if has_numba() else constants


@dataclass(frozen=True)
class Flight:
    """A flight of a rig, from its origin on, which is at time 0."""

    machine: Machine
    run: Run
    waves: list[Wave]

    @property
    def moving(self) -> Moving:
        """The argument of the kernels of the motion."""
        return Moving(*self.machine, self.run, self.waves, [])

    def motion(self, tau: float) -> Motion:
        """Return the motion some time after the origin, s."""
        if tau == 0.0:
            return starting_motion(self.moving)
        return motion_at(self.moving, tau)

    def copy(self) -> Flight:
        """Return another flight in the same state."""
        waves = [Wave(w.angle, w.sine_0, w.cosine_0, w.sine, w.cosine) for w in self.waves]
        return Flight(self.machine, Run(*_run_fields(self.run)), waves)

    def begin(self) -> Flight:
        """Begin the flight at its origin, and return it."""
        self.run.time = self.run.time_low = self.run.now = 0.0
        begin_flight(self.moving)
        return self

    def struck(self, velocity: float, relative_velocity: float) -> Flight:
        """Return the flight after an impact on the stop hit last, with velocities before it."""
        there = self.copy()
        there.run.velocity, there.run.relative_velocity = velocity, relative_velocity
        there.run.room = 0
        strike(there.moving, there.run.last_stop)
        return there.begin()


def flight_at(
    machine: Machine,
    instant: float,
    x: float,
    velocity: float,
    beyond: float,
    relative_velocity: float,
    resting: int,
    last_stop: int,
    angles: Sequence[float] = (),
) -> Flight:
    """
    Return the flight from a state on the force's clock (s).

    `beyond` is Y - d/2, the way m has gone beyond stop 1: not positive, and exact near the
    stop of a one-sided rig, whose gap is meaningless. `beyond` and Y' do not count where `resting`
    is `STICK`, `REST_1` or `REST_2`; with 0 m moves. `last_stop` is 0 if none was hit yet.
    `angles` are those of the harmonics at instant 0, if they are not the phases.
    """
    constants, lines = machine
    half = constants.half_gap
    if resting == REST_1:
        beyond = 0.0
    elif resting == REST_2:
        beyond = -2.0 * half
    run = Run(
        mode=resting,
        x=x,
        velocity=velocity,
        relative_velocity=relative_velocity,
        clearance_1=max(0.0, -beyond),
        clearance_2=inf if constants.one_sided else max(0.0, 2.0 * half + beyond),
        stop_1=half,
        stop_2=-half,
        target_1=half,
        target_2=-half,
        last_stop=last_stop,
    )
    waves = [Wave(angle) for angle in angles] or [Wave() for _ in range(constants.harmonics)]
    turn_waves(lines, waves, instant)
    if resting:
        rest(Moving(*machine, run, waves, []))
    else:
        run.mode = moving_mode(constants, relative_velocity)
    return Flight(machine, run, waves).begin()


def rig_on(flight: Flight, parameters: RigParameters) -> Rig:
    """Return the rig that goes on from the origin of a flight, at time 0."""
    angles = tuple(wave.angle for wave in flight.waves)
    snapshot = Snapshot(parameters, flight.run, angles, (), SteppedSine(0.0))
    return Rig.resume(snapshot, compiled=None)


def flight_at_impact(
    machine: Machine,
    instant: float,
    stop: int,
    x: float,
    velocity: float,
    damper_velocity: float,
) -> Flight:
    """
    Return the flight from a stop, at an instant of the force's clock, s.

    Without relative velocity, as after a plastic impact, the forces decide whether m rests or
    leaves.
    """
    relative = damper_velocity - velocity
    beyond = 0.0 if stop == 1 else -2.0 * machine.constants.half_gap
    resting = STICK if relative == 0.0 else 0
    return flight_at(machine, instant, x, velocity, beyond, relative, resting, stop)
