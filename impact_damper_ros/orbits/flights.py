# SPDX-License-Identifier: Apache-2.0
"""Rigs that begin at a state on the force's clock, in plain Python; constants that are kept."""

from __future__ import annotations

from functools import lru_cache
from math import inf
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.motion.event import EVENT_TYPE, EventRow
from impact_damper_ros.motion.flight import (
    begin_flight,
    moving_mode,
    rest,
)
from impact_damper_ros.motion.impact import strike
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.motion.oscillator import Line, Oscillator
from impact_damper_ros.motion.records import dtype_of, pack, pack_rows
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


def moving_at(
    machine: Machine,
    instant: float,
    x: float,
    velocity: float,
    beyond: float,
    relative_velocity: float,
    resting: int,
    last_stop: int,
) -> Moving:
    """
    Return a rig at the beginning of the flight from a state on the force's clock, s.

    `beyond` is Y - d/2, the way m has gone beyond stop 1: not positive, and exact near the
    stop of a one-sided rig, whose gap is meaningless. `beyond` and Y' do not count where `resting`
    is `STICK`, `REST_1` or `REST_2`; with 0 m moves. `last_stop` is 0 if none was hit yet.
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
    moving = Moving(constants, lines, run, [Wave() for _ in range(constants.harmonics)], [])
    turn_waves(lines, moving.waves, instant)
    if resting:
        rest(moving)
    else:
        run.mode = moving_mode(constants, relative_velocity)
    begin_flight(moving)
    return moving


def _zeros(cls: Any) -> Any:
    """Return an object of a class of constants that kernels may set."""
    if has_numba():
        return np.zeros(1, dtype_of(cls))[0]
    return SimpleNamespace(**dict.fromkeys(cls._fields, 0.0))


def settable_rig(harmonics: int, one_sided: bool) -> Moving:
    """Return a rig that kernels set and move."""
    constants, run = _zeros(RigConstants), Run()
    waves = [Wave() for _ in range(harmonics)]
    if has_numba():
        constants['harmonics'], constants['one_sided'] = harmonics, one_sided
        lines: Any = np.zeros(2 * harmonics, dtype_of(Line))
        log: Any = np.zeros(0, dtype_of(EventRow))
        return Moving(constants, lines, pack(run), pack_rows(waves, Wave), log)
    constants.harmonics, constants.one_sided = harmonics, one_sided
    constants.free, constants.joint = _zeros(Oscillator), _zeros(Oscillator)
    return Moving(constants, [_zeros(Line) for _ in range(2 * harmonics)], run, waves, [])


def packed_rig(moving: Moving, room: int) -> Moving:
    """Return a rig that moves in the form for kernels that are called, with room for events."""
    if not has_numba():
        return moving._replace(log=[EventRow() for _ in range(room)])
    constants, lines, run, waves, _ = moving
    log: Any = np.zeros(room, EVENT_TYPE)
    return Moving(pack(constants), pack_rows(lines, Line), pack(run), pack_rows(waves, Wave), log)


def rig_on(moving: Moving, parameters: RigParameters) -> Rig:
    """Return the rig that goes on from the origin of a flight, at time 0."""
    angles = tuple(wave.angle for wave in moving.waves)
    snapshot = Snapshot(parameters, moving.run, angles, (), SteppedSine(0.0))
    return Rig.resume(snapshot, compiled=None)


def moving_at_impact(
    machine: Machine,
    instant: float,
    stop: int,
    x: float,
    velocity: float,
    damper_velocity: float,
    *,
    before: bool = False,
) -> Moving:
    """
    Return a rig at the beginning of the flight from a stop, at an instant of the force's clock, s.

    The velocities are those after the impact, or `before` it. Without relative velocity, as after
    a plastic impact, the forces decide whether m rests or leaves.
    """
    relative = damper_velocity - velocity
    beyond = 0.0 if stop == 1 else -2.0 * machine.constants.half_gap
    resting = STICK if relative == 0.0 else 0
    moving = moving_at(machine, instant, x, velocity, beyond, relative, resting, stop)
    if before:
        moving.run.velocity, moving.run.relative_velocity = velocity, relative
        strike(moving, stop)
        begin_flight(moving)
    return moving
