# SPDX-License-Identifier: Apache-2.0
"""The text that `simulate_rig` prints of a run, and the period that it counts by."""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.compare.random_response import ResponseSamples
from impact_damper_ros.control.act import Action
from impact_damper_ros.measured.record import BASE_RECORD
from impact_damper_ros.motion.event import Event, EventKind, Sample, table_of_events
from impact_damper_ros.motion.state import Mode
from impact_damper_ros.motion.swing import Swing
from impact_damper_ros.orbits.flight_arrays import FlightStart
from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.report.formatting import mode_words
from impact_damper_ros.report.random_response_figure import response_text
from impact_damper_ros.report.transmissibility_text import transmissibility_text
from impact_damper_ros.rig.observed_run import Observer
from impact_damper_ros.rig.rig import Rig

# Cycles at the end of a run in which the largest |X| is sought, and samples in each
_WATCHED_CYCLES = 20
_LOOKS_PER_CYCLE = 256
# A number of cycles is whole if it is below a whole number by less than this.
_WHOLE = 1e-6


def cycle_at(parameters: RigParameters) -> float:
    """Return the period of the force, s; the natural one if its frequency is stepped."""
    return cycle_of(parameters) if parameters.sweep_mode == 'off' else math.tau / parameters.omega


class RunSummary(Observer):
    """The printed summary of a run: events, commands, last impacts, largest |X| at the end."""

    def __init__(self, rig: Rig, duration: float, response: ResponseSamples | None = None) -> None:
        self._rig = rig
        #: Samples for the response to a base of many lines, over their common period.
        self.response = response
        self._look_period = cycle_at(rig.parameters) / _LOOKS_PER_CYCLE
        self._cycles = min(_WATCHED_CYCLES, duration / cycle_at(rig.parameters))
        self._from = max(0.0, duration - _WATCHED_CYCLES * cycle_at(rig.parameters))
        self._started = time.perf_counter()
        self._counts: Counter[EventKind] = Counter()
        self._commands = 0
        self._impacts: dict[int, Event] = {}
        self._swing = Swing()
        # Largest |Y| at the looks
        self._reach = 0.0
        self._since_look: list[Event] = []
        # Of a rig with a moving base: start of the measured motion, and all events since then
        self._begin: FlightStart | None = None
        self._passed: list[Event] = []

    def ticks(self) -> Iterator[float]:
        """Yield the instant from which on the motion is looked at, near the end."""
        yield self._from

    def instants(self) -> Iterator[float]:
        """Yield the instants at which X is looked at."""
        return (self._from + k * self._look_period for k in count())

    def take_events(self, events: Sequence[Event]) -> None:
        """Count events and commands."""
        self._counts.update(event.kind for event in events)
        self._commands += sum(act.action is Action.COMMAND for act in self._rig.acts)
        self._impacts |= {e.stop: e for e in events if e.kind is EventKind.IMPACT}
        self._since_look += [event for event in events if event.time >= self._from]
        if self._begin is not None:
            self._passed += events

    def take_change(
        self, time_ns: int, values: Mapping[str, Any], events: Sequence[Event]
    ) -> None:
        """Measure the transmissibility from here on."""
        super().take_change(time_ns, values, events)
        self._begin = None

    def take_samples(self, samples: NDArray[np.void]) -> None:
        """Look at samples."""
        for row in samples.tolist():
            self._look(Sample(*row))

    def _look(self, sample: Sample) -> None:
        passed = bisect_right(self._since_look, sample.time, key=lambda event: event.time)
        self._swing.look(sample, self._since_look[:passed])
        del self._since_look[:passed]
        self._reach = max(self._reach, abs(sample.z - sample.x))

    def look_at(self, instant: float) -> None:
        """Look at the motion."""
        if instant >= self._from:
            self._look(self._rig.sample())
            moves = self._rig.parameters.base_motion.moves and not self._rig.measured_records
            if self._begin is None and moves:
                self._begin, self._passed = FlightStart.of(self._rig), []

    def text(self, *, whole: bool) -> str:
        """Return the summary of a run that is complete, or not."""
        rig, largest, spent = self._rig, self._swing.largest, time.perf_counter() - self._started
        parameters, mode = rig.parameters, mode_words(rig.mode.name)
        events = [f'{number} {kind.name.lower()}' for kind, number in self._counts.items()]
        lines = [
            f'simulated   {rig.time:g} s in {spent:.2f} s; the loose mass is now in mode "{mode}"',
            f'events      {", ".join(events) or "none"}',
        ]
        # If a record moves the base, other lines report X - b instead of X.
        if whole and not any(r.quantity == BASE_RECORD for r in rig.measured_records):
            lines.append(f'largest |X| {largest:.7g} m in the last {self._cycles:.3g} cycles')
            amplitude = parameters.response_amplitude
            if parameters.periodic_force and math.isfinite(amplitude):
                lines[-1] += (
                    f', {largest / amplitude:.7f} of the {amplitude:.6g} m without impacts'
                )
        if whole and self.response is not None:
            lines.append(response_text(self.response.response()))
        elif whole and self._begin is not None and parameters.sweep_mode == 'off':
            passed = table_of_events(self._passed)
            flights = self._begin.flights(parameters, passed, FlightStart.of(rig).row)
            cycle = cycle_at(parameters)
            since = max(1, int((rig.time - flights.starts[0]) / cycle + _WHOLE)) * cycle
            found = flights.cut(rig.time - since, rig.time).integrals()[0]
            lines.append(transmissibility_text(found.transmissibility, parameters))
        if rig.control.active:
            (spent_1, spent_2), (stop_1, stop_2) = rig.energies, rig.stops
            lines.append(
                f'gap control {rig.law}: {self._commands} commands; stop 1 spent '
                f'{spent_1:.6g} J, stop 2 {spent_2:.6g} J; they are at Y = {stop_1:.6g} m and '
                f'{stop_2:.6g} m'
            )
        for stop, event in sorted(self._impacts.items()):
            phase = ''
            if parameters.periodic_force:
                phase = f'phase {event.time / cycle_at(parameters) % 1.0:.7f} cycles, '
            lines.append(
                f'last impact on stop {stop}: t = {event.time:.9f} s, {phase}'
                f'X = {event.x:.7f} m; just after it '
                f"X' = {event.primary_velocity_after:.7f} m/s, "
                f"Z' = {event.damper_velocity_after:.7f} m/s"
            )
        since = max((event.time for event in self._impacts.values()), default=0.0)
        silent = (rig.time - since) / cycle_at(parameters)
        # At the last frequency of a sweep M may hardly move.
        swept = parameters.sweep_mode != 'off' and bool(self._impacts)
        if whole and silent >= _WATCHED_CYCLES and not swept:
            lines.append(
                f'no impact   m has not hit a stop for {silent:.4g} cycles{self._remedy()}'
            )
        return '\n'.join(lines)

    def _remedy(self) -> str:
        """Return how m would hit a fixed stop that it does not rest on."""
        rig = self._rig
        if rig.control.active or not self._reach or rig.mode in (Mode.REST_1, Mode.REST_2):
            return ''
        return (
            f': |Y| is up to {self._reach:.4g} m, half the gap {rig.parameters.gap / 2.0:.4g} m; '
            f'give a gap below {2.0 * self._reach:.4g} m, or an initial_damper_velocity'
        )
