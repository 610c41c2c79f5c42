"""Runs into a steady state: initial conditions, and detection that the motion repeats."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.control import GapControlParameters, Outcome, Rig, RunResult
from impact_damper_ros.control.nearby_rig import Scales
from impact_damper_ros.rig import (
    Event,
    EventKind,
    RigParameters,
    RunawayError,
)
from impact_damper_ros.rig.event_budget import EndlessEventsError
from impact_damper_ros.rig.parameter_spec import number_between, whole_number

from .flights import machine_of
from .recognition import LONGEST_PERIOD, Array, section_distance
from .search import starting_points as starting_points

# More events than any motion has, and the cycles at the start in which more are tolerated.
_ENDLESS_PER_CYCLE, _BUSY_CYCLES = 500, 20
#: Cycles between two looks at whether the motion repeats.
CYCLES_BETWEEN_LOOKS = 50
#: For how many cycles at least the states must come back.
_LEAST_REPEATS = 10
#: Distance of the states, in tolerances, up to which a period is still considered.
_NEARLY = 1e3


class Look(NamedTuple):
    """The events of a rig between two checks."""

    cycles: int  # cycles of the force run so far
    events: list[Event]  # since the last look
    largest: float  # largest |X| at events and at the ends of the parts of cycles since then, m
    endless: bool = False  # whether the rig was stopped because it has too many events

    @property
    def impacts(self) -> list[Event]:
        """The impacts among the events."""
        return [event for event in self.events if event.kind is EventKind.IMPACT]


def run_by_cycles(
    rig: Rig,
    every: int,
    most_cycles: int,
    *,
    base: float = 0.0,
    first: int = 0,
    parts: int = 1,
    events_per_cycle: float = _ENDLESS_PER_CYCLE,
) -> Iterator[Look]:
    """
    Run a rig by cycles of its force, and yield its events after every few cycles.

    The last `Look` is at the end. Cycles are counted from the instant `base` (s) and `first`
    cycles after it; each is run in some parts. A rig that has more events in a cycle on average
    is stopped at one of them; the last `Look` then counts whole cycles only.
    """
    cycle = math.tau / rig.parameters.force_frequencies[0]
    events: list[Event] = []
    largest, total = 0.0, 0
    for k in range(1, most_cycles + 1):
        most = events_per_cycle * (k + _BUSY_CYCLES)
        for part in range(1, parts + 1):
            # One rounding, so that the steps do not drift
            end = base + (first + k - 1 + part / parts) * cycle
            try:
                new = rig.advance(end, max(1, most - total))
            except RunawayError:
                yield Look(k - 1, events, largest, endless=True)
                return
            total += len(new)
            largest = max([largest, abs(rig.sample().x), *(abs(event.x) for event in new)])
            events += new
            if rig.time < end:
                yield Look(k - 1, events, largest, endless=True)
                return
        if k % every == 0 or k == most_cycles:
            yield Look(k, events, largest)
            events, largest = [], 0.0


@dataclass(frozen=True)
class Settling:
    """
    Limits and tolerances of the detection of a steady state.

    Raises
    ------
    ValueError
        If one is out of its range.
    """

    cycles: int = 2000  # most cycles of the force to settle in
    watch: int = 500  # cycles that are measured of a motion that does not repeat
    #: How closely the states a period apart must agree, relative to the size of the motion.
    tolerance: float = 1e-8
    events: int = 2_000_000  # most events of one rig; more is a failure
    #: Most points of the section, and half as many as the impacts, that are kept of a motion
    #: that does not repeat.
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


def _active_rates(parameters: RigParameters) -> list[float]:
    """Return the circular frequencies of the force, those without amplitude left out."""
    amplitudes, frequencies, _ = parameters.harmonics
    pairs = zip(amplitudes, frequencies, strict=True)
    return [rate for amplitude, rate in pairs if amplitude != 0.0]


def cycle_of(parameters: RigParameters) -> float:
    """Return the period of the first harmonic that acts, or of the spring if none does, s."""
    rates = [rate for rate in _active_rates(parameters) if rate > 0.0]
    return math.tau / (rates[0] if rates else parameters.omega)


def _repeats_with(parameters: RigParameters, cycle: float) -> bool:
    """Return whether the force repeats with a cycle, s."""
    turns = [rate * cycle / math.tau for rate in _active_rates(parameters)]
    return all(abs(turn - round(turn)) < 1e-9 * max(turn, 1.0) for turn in turns)


def _samples_alike(control: GapControlParameters, cycle: float) -> bool:
    """Return whether the samples of a control can repeat after some cycles, s."""
    if control.gap_control_noise_position or control.gap_control_noise_velocity:
        return False
    counts = [control.gap_control_rate * cycle * k for k in range(1, LONGEST_PERIOD + 1)]
    return any(abs(count - round(count)) < 1e-9 * max(count, 1.0) for count in counts)


def relative_states(samples: NDArray[np.void]) -> Array:
    """Return X, X', Y and Y' of samples."""
    x, velocity = samples['x'], samples['primary_velocity']
    return np.stack(
        [x, velocity, samples['z'] - x, samples['damper_velocity'] - velocity], axis=-1
    )


class SettlingRig:
    """
    A rig that is run by whole cycles of its force.

    `run` must be at the beginning of a cycle of its force.
    """

    def __init__(self, run: Rig, settling: Settling) -> None:
        parameters = run.parameters
        self.settling = settling
        #: Period of the force, s
        self.cycle = cycle_of(parameters)
        self.machine = machine_of(parameters)
        #: Angle turned by each harmonic at the beginning, rad
        self.angles = run.state().angles
        #: Whether the force repeats with its cycle
        self.repeating = _repeats_with(parameters, self.cycle)
        self.controlled = run.acts
        #: Whether the samples of a control can repeat with the cycles
        self.in_step = not run.acts or _samples_alike(run.control, self.cycle)
        #: Cycles run and events had so far
        self.cycles = self.events = 0
        self._run = run
        self._start = run.time
        self._rate = max(math.tau / self.cycle, parameters.omega)
        self.omega = parameters.omega
        self.forced = bool(_active_rates(parameters))
        self._size = 0.0
        self._recent: Array
        self.forget()

    @property
    def scales(self) -> Scales:
        """Scales of the numbers in the state of a rig under control."""
        return Scales(self._size or 1.0, self._rate)

    def snapshot(self) -> dict[str, Any]:
        """Return the snapshot of the rig."""
        return self._run.snapshot()

    def state(self) -> tuple[int, int]:
        """Return the mode, and the stop hit last."""
        return int(self._run.mode), self._run.state().run.last_stop

    def time_after(self, cycles: int) -> float:
        """Return the instant at which some cycles have been run, s."""
        return cycles * self.cycle + self._start

    def run(self, cycles: int, looks: int = 1) -> RunResult:
        """Run for some cycles, with some samples in each, the first one at once."""
        grid = np.arange(cycles * looks + 1) / looks + self.cycles
        grid *= self.cycle
        grid += self._start
        most = self.settling.events - self.events
        result = self._run.run(float(grid[-1]), grid, most_events=max(most, 1))
        if result.outcome is not Outcome.COMPLETE:
            raise EndlessEventsError(result.reason)
        self.cycles += cycles
        self.events += result.event_count
        return result

    def settle(self, cycles: int) -> NDArray[np.void]:
        """Run until the next check whether the motion repeats; return the events."""
        result = self.run(cycles)
        section = relative_states(result.samples[1:])
        size = float(np.abs(section[:, 0]).max() + np.ptp(section[:, 2]))
        # A rig without force has settled once next to nothing of its start is left
        self._size = size if self.forced else max(size, self._size)
        if self.controlled:
            # Stops that still move are not settled, whether m reaches them or not
            x = result.samples['x'][1:]
            places = [result.samples[name][1:] - x for name in ('stop_1', 'stop_2')]
            section = np.concatenate([section, np.stack(places, axis=-1)], axis=-1)
        self._recent = np.concatenate([self._recent, section])[-4 * LONGEST_PERIOD :]
        return result.events

    def forget(self) -> None:
        """Discard the states so far, so that the detection of a period starts again."""
        self._recent = np.empty((0, 6 if self.controlled else 4))

    def period(self) -> int:
        """
        Return the number of cycles after which the last states repeat, or 0.

        On the way to a motion of one cycle, the states may repeat after several cycles first, if
        a free vibration takes that many. A longer period therefore counts only if no shorter one
        fits nearly as well, or at the end of the run.
        """
        if not self.repeating or not self._size or len(self._recent) < 2:
            return 0
        size = self.settling.tolerance * self._size * np.array([1.0, self._rate] * 2)
        if self.controlled:
            far = float(np.abs(self._recent[-1, 4:]).max())
            size = np.append(size, [self.settling.tolerance * max(self._size, far)] * 2)
        last = self._recent[-1]
        if (np.abs(self._recent[-1 - LONGEST_PERIOD : -1] - last) / size).max(1).min() > _NEARLY:
            return 0
        nearly = False
        for period in range(1, LONGEST_PERIOD + 1):
            count = min(max(2 * period, _LEAST_REPEATS), len(self._recent) - period)
            if count < 2 * period:
                break
            apart = section_distance(self._recent, period, count, size)
            if apart <= 1.0:
                return 0 if nearly and self.cycles < self.settling.cycles else period
            nearly = nearly or apart <= _NEARLY
        return 0
