# SPDX-License-Identifier: Apache-2.0
"""
Transients of many rigs at once, by the engine's loop over an array of rigs.

Rigs without control and air that differ in numbers alone, and whose force repeats, run together
through their transients. Each then goes on by itself from a state at the end of a cycle, where its
motion may have settled: this state as initial conditions is the same motion to the last digits.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.state import Mode
from impact_damper_ros.orbits.flights import flight_at, machine_of, rig_on
from impact_damper_ros.orbits.settled_motion import cycle_of, relative_states
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import (
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
)
from impact_damper_ros.rig.ensemble import run_ensemble
from impact_damper_ros.rig.rig import Outcome, Rig

from .grid import Axis, Grid, RigSetup
from .steady_state import BETWEEN, ROUND_OFF, SECTION, Array, Settling, check_cycle, comes_back

#: Parameters in which rigs of an ensemble may differ.
_NUMBERS = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if spec.kind == 'double' and not name.startswith(('force_', 'multisine_', 'sweep_'))
]
#: Cycles of the first part of a transient; each further part ends four times as late.
_FIRST_PART, _LATER = 500, 4


class Transient(NamedTuple):
    """The end of a transient."""

    cycles: int
    events: int  # that were computed for it, and perhaps some after it
    state: InitialConditions


def can_share(grid: Grid) -> bool:
    """Return whether many rigs of a grid differ in numbers alone."""
    return not grid.setup.control.active and any(map(_is_of_numbers, grid.axes))


def shared_values(grid: Grid, row: int) -> tuple[float, ...]:
    """Return the values of a row in which the rigs of an ensemble agree."""
    values = zip(grid.axes, grid.values(row), strict=True)
    return tuple(value for axis, value in values if not _is_of_numbers(axis))


def _is_of_numbers(axis: Axis) -> bool:
    return all(one.name in _NUMBERS for one in axis.varied)


def transients(setups: Mapping[int, RigSetup], threads: int | None) -> dict[int, Transient]:
    """Run rigs, given by number, through their transients; those that cannot are left out."""
    groups: dict[Any, dict[int, RigSetup]] = defaultdict(dict)
    for point, setup in setups.items():
        parameters = setup.parameters
        # The air depends on the stop hit last, which initial conditions do not hold
        if parameters.periodic_force and parameters.air_force == 0.0:
            held = parameters.as_dict()
            others = tuple(value for name, value in held.items() if name not in _NUMBERS)
            groups[setup.initial, others][point] = setup
    found: dict[int, Transient] = {}
    for group in groups.values():
        with suppress(ParameterError):
            # By itself each says what is wrong with it
            found |= _run_together(group, threads)
    return found


def _run_together(setups: dict[int, RigSetup], threads: int | None) -> dict[int, Transient]:
    """Run the rigs of one ensemble until each has come close to a state of cycles before."""
    parameters, initial, *_, settling = next(iter(setups.values()))
    for setup in setups.values():
        check_cycle(setup.parameters, settling)
    cycle = cycle_of(parameters)
    left, found = dict(setups), {}
    begun, end = 0, min(_FIRST_PART, settling.cycles)
    while left:
        rigs = [setup.parameters for setup in left.values()]
        result = run_ensemble(
            parameters,
            {name: [getattr(rig, name) for rig in rigs] for name in _NUMBERS},
            end * cycle,
            np.arange(1, end + 1) * cycle,
            initial=initial,
            most_events=settling.events,
            threads=threads,
        )
        omega = np.array([max(math.tau / cycle, rig.omega) for rig in rigs])
        ended = _ends(relative_states(result.samples), omega, settling, begun)
        if end == settling.cycles:
            ended[ended == 0] = end
        for i, (point, setup) in enumerate(list(left.items())):
            if result.outcomes[i] != Outcome.COMPLETE:
                # By itself it says what it does
                del left[point]
            elif ended[i]:
                _, x, velocity, z, damper_velocity, *_ = result.samples[i, ended[i] - 1].tolist()
                half = 0.5 * setup.parameters.gap
                state = start_at(x, velocity, z - x, damper_velocity, half)
                found[point] = Transient(int(ended[i]), int(result.event_counts[i]), state)
                del left[point]
        begun, end = end, min(_LATER * end, settling.cycles)
    return found


def _ends(states: Array, omega: Array, settling: Settling, begun: int) -> NDArray[np.int64]:
    """Return the cycle at which each motion first comes back to a state of cycles before; or 0."""
    count = states.shape[1]
    ended = np.zeros(len(states), np.int64)
    for look in range(begun + BETWEEN, count + 1, BETWEEN):
        back = comes_back(states[:, look - BETWEEN : look], omega, settling)
        ended[back & (ended == 0)] = look
    return ended


def rig_of_row(row: Any, parameters: RigParameters) -> Rig:
    """Return a rig in the last state of a row of the table."""
    x, velocity, offset, relative = (float(getattr(row, name)[-1]) for name in SECTION)
    half = 0.5 * parameters.gap
    start = start_at(x, velocity, offset, velocity + relative, half)
    rig = Rig(parameters, start)
    if not len(row.impact_stop):
        return rig
    # The air depends on the stop hit last, which initial conditions do not hold
    resting = rig.mode if rig.mode >= Mode.STICK else 0
    beyond, last = start.initial_damper_offset - half, int(row.impact_stop[-1])
    machine = machine_of(parameters)
    flight = flight_at(machine, 0.0, x, velocity, beyond, relative, resting, last)
    return rig_on(flight, parameters)


def start_at(
    x: float, velocity: float, offset: float, damper_velocity: float, half: float
) -> InitialConditions:
    """Return a state; round-off may neither put m beyond a stop nor part it from one it is on."""
    if abs(abs(offset) - half) <= ROUND_OFF * (half + abs(x)):
        offset = math.copysign(half, offset)
    return InitialConditions(
        initial_primary_position=x,
        initial_primary_velocity=velocity,
        initial_damper_offset=min(max(offset, -half), half),
        initial_damper_velocity=damper_velocity,
    )
