# SPDX-License-Identifier: Apache-2.0
"""The steady state of a rig: run until the motion repeats, or to a limit, and measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.kernels import call_kernel
from impact_damper_ros.motion.state import Mode
from impact_damper_ros.orbits.flight_arrays import FlightStart, rows_of_samples
from impact_damper_ros.orbits.flight_integrals import chatter_time
from impact_damper_ros.orbits.flights import machine_of, moving_at, rig_on
from impact_damper_ros.orbits.settled_motion import (
    SettledMotion,
    cycle_of,
    relative_states,
    settle,
)
from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.parameters.parameter_spec import (
    ParameterError,
    number_between,
    whole_number,
)
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Events, Outcome, RunResult, one_table, rows_where
from impact_damper_ros.rig.runaway import RunawayError
from impact_damper_ros.rig.snapshot import LATEST

Array = NDArray[np.float64]
#: The columns of one rig: values for JSON, and arrays.
Row = dict[str, Any]
#: Columns of X, X', Y and Y' at the ends of cycles.
SECTION = ('section_x', 'section_velocity', 'section_offset', 'section_relative_velocity')


@dataclass(frozen=True)
class Settling:
    """
    Limits and tolerances of the detection of a steady state.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    cycles: int = 2000  # most cycles of the force to settle in
    watch: int = 500  # cycles that are judged and measured if a motion does not repeat
    #: Largest distance of states a period apart, relative to the size of the motion.
    tolerance: float = 1e-8
    events: int = 2_000_000  # most events of one rig; more events are a failure
    #: Most points of the section, and half of the most impacts, that are kept of a motion that
    #: does not repeat.
    section: int = 100

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low, high in (
            ('cycles', 1, 10_000_000),
            ('watch', 21, 1_000_000),
            ('events', 1, 10**12),
            ('section', 1, 100_000),
        ):
            object.__setattr__(self, name, whole_number(name, getattr(self, name), low, high))
        tolerance = number_between('tolerance', self.tolerance, 1e-12, 1e-2)
        object.__setattr__(self, 'tolerance', tolerance)


#: Least frequency of the force, over the natural one.
_SLOWEST = 1e-4
#: Distance of states, relative to the motion, that round-off makes.
_SAME_STATE = 1e-12


def _sequence(events: Events) -> str:
    """Return the stops hit, as the least rotation; a chatter to rest is one entry, 1~."""
    words: list[str] = []
    for kind, stop in zip(events['kind'].tolist(), events['stop'].tolist(), strict=True):
        if kind == EventKind.IMPACT:
            words.append(str(stop))
        elif kind == EventKind.REST:
            while words and words[-1] == str(stop):
                words.pop()
            words.append(f'{stop}~')
    # The period may end during a chatter.
    while len(words) > 1 and words[-1] + '~' in words and words[-1] == words[0][0]:
        words.pop()
    return ','.join(min((words[i:] + words[:i] for i in range(len(words))), default=[]))


def _run(
    rig: Rig, start: float, cycle: float, counts: NDArray[np.float64], most: int
) -> RunResult:
    """Run through instants, counted in cycles from a start (s), and sample there."""
    instants = start + counts * cycle
    result = rig.run(float(instants[-1]), instants, most_events=max(most, 1))
    if result.outcome is not Outcome.COMPLETE:
        raise RunawayError(result.reason)
    return result


def _measure(rig: Rig, found: SettledMotion, settling: Settling) -> Row:
    """Measure a motion over its period, or the cycles to watch; return its row of the table."""
    period = 0 if found.period is None else found.period.cycles
    cycle, cycles = found.cycle, period or settling.watch
    most = settling.events - found.event_count
    begin = FlightStart.of(rig)
    result = _run(rig, found.end, cycle, np.arange(1.0, cycles + 1.0), most)
    parameters = rig.parameters
    flights = begin.flights(parameters, result.events, rows_of_samples(result.samples[-1:]))
    moments, largest = flights.moments()
    alone = Transmissibility.without_damper(parameters)
    shaken = Transmissibility.of_moments(moments).by_name() | alone.by_name('_without_damper')
    end = found.end + cycles * cycle
    # The events before and after the period complete a chatter that is cut at either end.
    after = _run(rig, end, cycle, np.array([1.0]), most - result.event_count)
    around = one_table(found.events, result.events, after.events)
    impacts = result.impacts()
    kept = period or min(settling.section, cycles)
    hits = rows_where(impacts['time'] > end - kept * cycle, impacts)
    if not period:
        hits = hits[-2 * settling.section :]
    approach = hits['damper_velocity_before'] - hits['primary_velocity_before']
    # With other harmonics A is not the amplitude without impacts.
    ratio = parameters.x_max_ratio(largest) if parameters.periodic_force else math.nan
    spent = result.time_in_mode / (end - found.end)
    section = relative_states(result.samples[-kept:]).T.copy()
    return {
        'ok': True,
        'reason': None,
        'kind': found.kind.value,
        'settled': period > 0,
        'settling_cycles': found.cycles,
        'measured_cycles': cycles,
        'cycle': cycle,
        'cycles': period or None,
        'impacts': len(hits) if period else None,
        'stops': _sequence(result.events) if period else None,
        'x_max': largest,
        'x_max_ratio': ratio,
        'x_rms': math.sqrt(moments.x_squares / moments.weight),
        'x_mean': moments.x / moments.weight,
        **shaken,
        'impacts_per_cycle': len(impacts) / cycles,
        'lyapunov_exponent': found.exponent.value,
        'lyapunov_uncertainty': found.exponent.uncertainty,
        'largest_multiplier': found.multiplier,
        'stick_share': float(spent[Mode.STICK]),
        'rest_share': float(spent[Mode.REST_1] + spent[Mode.REST_2]),
        'chatter_share': call_kernel(chatter_time, around, found.end, end) / (end - found.end),
        'events': found.event_count + result.event_count,
        **dict(zip(SECTION, section, strict=True)),
        'impact_stop': hits['stop'].astype(np.int8),
        'impact_phase': (hits['time'] - found.start) / cycle % 1.0,
        'impact_speed': np.abs(approach),
    }


def check_cycle(parameters: RigParameters, settling: Settling) -> None:
    """Raise `ParameterError` if the cycles of the force are too long for a run."""
    cycle, most = cycle_of(parameters), settling.cycles + 2 * settling.watch
    if cycle * parameters.omega > math.tau / _SLOWEST:
        raise ParameterError(
            'force_frequencies',
            f'the force has a cycle of {cycle:g} s, {cycle * parameters.omega / math.tau:.3g} '
            'natural periods: such a slow motion is no vibration, give at least '
            f'{_SLOWEST * parameters.omega:.3g} rad/s in force_frequencies',
        )
    if most * cycle > 0.5 * LATEST:
        raise ParameterError(
            'force_frequencies',
            f'the force has a cycle of {cycle:g} s, and so many cycles take longer than a rig '
            'can run: give a higher frequency in force_frequencies, or fewer cycles',
        )


def steady_state(rig: Rig, settling: Settling, halted: Callable[[], bool] = lambda: False) -> Row:
    """
    Run a rig until its motion repeats or the time is up, and return its row of the table.

    The rig is at the beginning of a cycle of its force. `settle` recognises that the motion
    repeats. Raises `RunawayError` if the rig has more events than `settling` allows. Once it is
    halted, the row is meaningless.
    """
    check_cycle(rig.parameters, settling)
    found = settle(
        rig,
        cycles=settling.cycles + settling.watch,
        watch=settling.watch,
        tolerance=settling.tolerance,
        events=settling.events,
        interrupted=halted,
    )
    if found.reason:
        raise RunawayError(found.reason)
    return _measure(rig, found, settling)


def rig_of_row(row: Any, parameters: RigParameters) -> Rig:
    """Return a rig in the last state of a row of the table."""
    x, velocity, offset, relative = (float(getattr(row, name)[-1]) for name in SECTION)
    half = 0.5 * parameters.gap
    # Round-off may neither put m beyond a stop nor part m from a stop.
    if abs(abs(offset) - half) <= _SAME_STATE * (half + abs(x)):
        offset = math.copysign(half, offset)
    offset = min(max(offset, -half), half)
    start = InitialConditions(
        initial_primary_position=x,
        initial_primary_velocity=velocity,
        initial_damper_offset=offset,
        initial_damper_velocity=velocity + relative,
    )
    rig = Rig(parameters, start)
    if not len(row.impact_stop):
        return rig
    # The air force depends on the stop hit last, which initial conditions do not hold.
    resting = rig.mode if rig.mode >= Mode.STICK else 0
    machine, last = machine_of(parameters), int(row.impact_stop[-1])
    moving = moving_at(machine, 0.0, x, velocity, offset - half, relative, resting, last)
    return rig_on(moving, parameters)
