"""
The rig of the theory, run on from the last impact of a stretch.

A recording ends where somebody ended it; the exact simulator of the logged rig goes on from there,
for many times as many cycles, until its motion repeats, its impacts end, or a bound is reached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from impact_damper_ros.orbits.event_map import origin_at
from impact_damper_ros.orbits.irregularity import Indications, average_spread, quiet_phase
from impact_damper_ros.orbits.lyapunov import Exponent, deviations, growth_exponent
from impact_damper_ros.orbits.recognition import (
    LONGEST_PERIOD,
    SETTLED,
    Recurrence,
    find_recurrence,
    section_distance,
)
from impact_damper_ros.orbits.settling import section_of
from impact_damper_ros.rig import EventKind, RigParameters
from impact_damper_ros.rig.forcing import SteppedSine
from impact_damper_ros.rig.long_run import EVENT_TYPE, Events, LongRun, Outcome
from impact_damper_ros.rig.mode import REST_1, REST_2, Origin, RigConstants, rig_constants
from impact_damper_ros.rig.simulator import Snapshot

from .matched_orbit import counted_impacts, impact_table
from .recorded_stretch import ForceClock, RecordedImpacts
from .run_curves import Array

__all__ = ['CarriedMotion', 'carry_on']


#: Cycles for each recorded one, and the least and the most of them. More are run if more were
#: recorded, up to the last number.
_TIMES_RECORDED, _LEAST, _MOST, _MOST_OF_ALL = 30, 400, 2000, 5000
#: Events are what costs time: some 0.15 ms each in plain Python.
_MOST_EVENTS, _MOST_EVENTS_OF_ALL = 8000, 20_000
_BETWEEN_LOOKS = 100
#: Cycles without an impact after which no more are awaited.
_QUIET = 200
#: The part of the cycles that is left out of what is measured, as a transient.
_LEFT_OUT = 4
_LEAST_MEASURED = 100
#: Impacts whose phases say where in a cycle there are none.
_PHASES = 100
#: Impacts that are searched for a period, and the longest period of the states looked for.
_SEARCHED, _LONGEST = 1500, 64
#: Two periods of a settled motion agree to this.
_REPEATED = 1e-6


@dataclass(frozen=True)
class CarriedMotion:
    """
    How a rig goes on.

    Attributes
    ----------
    cycles : int
        Cycles of the force that it was run.
    impacts : RecordedImpacts
        Its impacts, without the weak ones of chatters, on the clock of the recording.
    recurrence : Recurrence or None
        How they repeat, or come to.
    settled_after : int or None
        Cycles after which the motion repeats to within `SETTLED`; None if it does not.
    period : int
        Period in cycles of the force, once settled; 0 if it is not, or without impacts.
    quiet_after : int or None
        Cycles after which there are no more impacts; None if there are.
    indications : Indications or None
        What speaks for chaos and what against it; None if there are too few cycles.
    growth : float
        Logarithm of the growth of a deviation until the motion had settled.
    """

    #: Growth after which the stamps, good to 1e-9, do not determine what the motion comes to; it
    #: has shrunk by e to the seventh since the chaos ended.
    UNFORESEEABLE: ClassVar[float] = 12.0

    cycles: int
    impacts: RecordedImpacts
    recurrence: Recurrence | None
    settled_after: int | None
    period: int
    quiet_after: int | None
    indications: Indications | None
    growth: float = 0.0


def _start(machine: RigConstants, clock: ForceClock, last: RecordedImpacts) -> Origin:
    """Return the state just after an impact, at time 0."""
    velocity = float(last.velocity_after[0])
    relative = float(last.damper_velocity_after[0]) - velocity
    stop = int(last.stop[0])
    return origin_at(
        machine,
        float(last.time[0]) - clock.zero,
        float(last.x[0]),
        velocity,
        0.0 if stop == 1 else -2.0 * machine.stop,
        relative,
        0 if relative else (REST_1 if stop == 1 else REST_2),
        stop,
    )


def _impacts(events: Events, rig: RigParameters, begin: float) -> RecordedImpacts:
    """Return the impacts of a run as they would be recorded, from an instant of the clock, s."""
    hits = events[events['kind'] == EventKind.IMPACT]
    after, damper_after = hits['primary_velocity_after'], hits['damper_velocity_after']
    half = np.where(hits['stop'] == 1, 0.5, -0.5) * rig.gap
    return RecordedImpacts(
        time=begin + hits['time'],
        stop=hits['stop'].astype(float),
        x=hits['x'],
        z=hits['x'] + half,
        velocity_after=after,
        damper_velocity_after=damper_after,
        primary_impulse=rig.primary_mass * (after - hits['primary_velocity_before']),
        damper_impulse=rig.damper_mass * (damper_after - hits['damper_velocity_before']),
    )


def _period_of(section: Array) -> int:
    """Return the period of the states at the ends of cycles, or 0."""
    size = np.abs(section[-_BETWEEN_LOOKS:]).max() or 1.0
    for period in range(1, min(_LONGEST, len(section) // 3) + 1):
        count = min(max(2 * period, period + 3), len(section) - period)
        if section_distance(section, period, count) <= _REPEATED * size:
            return period
    return 0


class _CarriedRig:
    """The rig, and what it has done so far."""

    def __init__(self, clock: ForceClock, impacts: RecordedImpacts) -> None:
        self._clock = clock
        self._rig = clock.counted_from_zero()
        self._machine = rig_constants(self._rig)
        last = impacts[-1:]
        self._origin = _start(self._machine, clock, last)
        self._begin = float(last.time[0])
        phases = clock.phase(impacts.time[-_PHASES:])
        # How long after the end of a cycle, counted from the last impact, it is looked at
        self._strobe = (quiet_phase(phases) - float(phases[-1])) % 1.0
        state = Snapshot(self._rig, self._origin, 0.0, (), SteppedSine(0.0)).as_dict()
        # Plain Python: compiling would take longer than the run.
        self._run = LongRun.restore(state, compiled=False)
        self._events: list[Events] = [np.empty(0, EVENT_TYPE)]
        self._sections: list[Array] = [np.empty((0, 4))]
        self.cycles = self.event_count = 0

    def go_on(self, cycles: int, most_events: int) -> bool:
        """Run on; return whether that was possible with so many events in all."""
        ends = (self.cycles + np.arange(1, cycles + 1)) * self._clock.cycle
        left = max(1, most_events - self.event_count)
        instants = ends - (1.0 - self._strobe) * self._clock.cycle
        stretch = self._run.advance(float(ends[-1]), instants, most_events=left)
        self._events.append(stretch.events)
        self._sections.append(
            section_of(stretch.samples) / np.array([1.0, self._rig.omega, 1.0, self._rig.omega])
        )
        self.cycles += len(stretch.samples)
        self.event_count += stretch.event_count
        return stretch.outcome is Outcome.COMPLETE

    def events(self) -> Events:
        """Return all events."""
        return np.concatenate(self._events)

    def section(self) -> Array:
        """Return X, X', Y and Y' once in each cycle, rates over the natural frequency."""
        return np.concatenate(self._sections)

    def impacts(self) -> RecordedImpacts:
        """Return the impacts that count."""
        return counted_impacts(_impacts(self.events(), self._rig, self._begin))

    def quiet_after(self) -> int | None:
        """Return after how many cycles the impacts ended; None if they go on."""
        events = self.events()
        times = events['time'][events['kind'] == EventKind.IMPACT]
        cycles = math.ceil(float(times[-1]) / self._clock.cycle) if len(times) else 0
        return cycles if self.cycles - cycles >= _QUIET else None

    def recurrence(self, impacts: RecordedImpacts) -> Recurrence | None:
        """Return how the last impacts repeat."""
        last, clock = impacts[-_SEARCHED:], self._clock
        return find_recurrence(impact_table(last, clock.zero, clock.cycle))

    def exponent(self, first: int, last: int) -> Exponent:
        """Return the exponent between the ends of two cycles."""
        cycle = self._clock.cycle
        along = deviations(
            self._machine,
            self._origin.angles,
            self.events(),
            self._origin.mode,
            self._origin.last_stop,
            first * cycle,
            last * cycle,
        )
        return growth_exponent(along, self._rig.omega)

    def indications(self) -> Indications | None:
        """Return what the later cycles indicate."""
        first, cycle = self.cycles // _LEFT_OUT, self._clock.cycle
        if self.cycles - first < _LEAST_MEASURED:
            return None
        found = self.exponent(first, self.cycles)
        spread = average_spread(self.section()[first:])
        cycles = self.cycles - first
        return Indications(cycle * found.value, cycle * found.standard_error, cycles, spread)


def _settled_after(recurrence: Recurrence, impacts: RecordedImpacts, begin: float) -> float:
    """Return the time from which on a motion that has settled repeats to within `SETTLED`."""
    far = np.flatnonzero(recurrence.distance > SETTLED)
    periods = len(recurrence.distance) - (int(far[-1]) + 1 if len(far) else 0)
    first = max(0, len(impacts) - recurrence.impacts * (periods + 1))
    return float(impacts.time[first]) - begin


def carry_on(clock: ForceClock, impacts: RecordedImpacts, recorded: float) -> CarriedMotion | None:
    """Let the rig of the theory go on from the last impact."""
    if not len(impacts):
        return None
    rig = _CarriedRig(clock, impacts)
    begin = float(impacts.time[-1])
    most = int(min(max(_TIMES_RECORDED * recorded, _LEAST), _MOST))
    most = max(most, int(min(recorded, _MOST_OF_ALL)))
    events = min(max(_MOST_EVENTS, 2 * len(impacts)), _MOST_EVENTS_OF_ALL)
    ahead = RecordedImpacts.none()
    recurrence, quiet, period = None, None, 0
    while rig.cycles < most:
        whole = rig.go_on(min(_BETWEEN_LOOKS, most - rig.cycles), events)
        quiet = rig.quiet_after()
        ahead = rig.impacts()
        recurrence = rig.recurrence(ahead) if quiet is None else None
        period = _period_of(rig.section()) if quiet is None else 0
        # States come back a little before the impacts are seen to
        seen = period > LONGEST_PERIOD or (
            period and recurrence is not None and recurrence.cycles == period
        )
        if seen or quiet is not None or not whole:
            break
    if rig.cycles < 3:
        return None
    settled = None
    if period and recurrence is not None and recurrence.cycles == period:
        settled = math.ceil(_settled_after(recurrence, ahead, begin) / clock.cycle)
    elif period:
        settled = rig.cycles - 3 * period
    growth = 0.0
    if settled:
        growth = rig.exponent(0, settled).value * settled * clock.cycle
    return CarriedMotion(
        cycles=rig.cycles,
        impacts=ahead,
        recurrence=recurrence,
        settled_after=settled,
        period=period,
        quiet_after=quiet,
        indications=None if period or quiet is not None else rig.indications(),
        growth=growth,
    )
