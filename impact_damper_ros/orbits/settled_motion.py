# SPDX-License-Identifier: Apache-2.0
"""Runs of a rig until its motion repeats, or a limit is reached; and the kind of that motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.motion.event import EVENT_TYPE, Event, EventKind, events_of_table
from impact_damper_ros.parameters.parameter_spec import check_kind, whole_number
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Events, Outcome, one_table, rows_where
from impact_damper_ros.rig.runaway import RunawayError

from .flight_arrays import Flights, FlightStart, rows_of_samples
from .irregularity import Indications, average_spread, quiet_phase
from .lyapunov import Exponent, growth_exponent, monodromy_of
from .multipliers import multipliers_of
from .orbit import PeriodicOrbit, Rhythm
from .recurrence import (
    LONGEST_PERIOD,
    Array,
    MotionKind,
    Period,
    Section,
    find_period,
    nearest_return,
)
from .solved_orbits import counted_from_zero, orbit_near

#: Fewest cycles in which the states must come back.
_LEAST_REPEATS = 10
#: Displacements below this share of the static one are checked more closely.
_SMALL = 1e-2
#: Distance that round-off alone makes, and least distance at which a run ahead ends.
_SAME_STATE, _CAME_BACK = 1e-13, 1e-12
#: A state farther than this number of tolerances from all before it begins no period.
_NEAR = 1e3
#: A motion that repeats is unstable if deviations grow by more than this factor in a period.
_GROWS = 1.001
#: States are taken at one phase as long as its gap between impacts is this part of the widest one.
_STILL_QUIET = 0.3
#: Fewest cycles of which an exponent is measured.
_FEWEST = 21
#: Number of impacts from which the motion of theory is sought, and its largest distance.
_STARTS, _REACHED = 3, 1e-2
_UNKNOWN = Exponent(math.nan, math.nan)


def _active_rates(parameters: RigParameters) -> list[float]:
    """Return the circular frequencies of the force, those without amplitude left out."""
    amplitudes, frequencies, _ = parameters.harmonics
    pairs = zip(amplitudes, frequencies, strict=True)
    return [rate for amplitude, rate in pairs if amplitude != 0.0]


def cycle_of(parameters: RigParameters) -> float:
    """Return the period of the first harmonic that acts, or of the spring if none does, s."""
    rates = [rate for rate in _active_rates(parameters) if rate > 0.0]
    return math.tau / (rates[0] if rates else parameters.omega)


def _repeat(turns: list[float], longest: int) -> bool:
    """Return whether all harmonics, given turns per cycle, make whole turns in some cycles."""
    return any(
        all(abs(k * turn - round(k * turn)) < 1e-9 * max(k * turn, 1.0) for turn in turns)
        for k in range(1, longest + 1)
    )


def relative_states(samples: np.ndarray[Any, np.dtype[np.void]]) -> Array:
    """Return X, X', Y and Y' of samples."""
    x, velocity = samples['x'], samples['primary_velocity']
    return np.stack(
        [x, velocity, samples['z'] - x, samples['damper_velocity'] - velocity], axis=-1
    )


class _Part(NamedTuple):
    """A part of a run between two comparisons."""

    begin: FlightStart
    events: Events
    section: Array  # states in each of its cycles


@dataclass(frozen=True, kw_only=True)
class SettledMotion:
    """
    The motion of a rig after it was run until it repeats, or a limit was reached.

    The rig is at the end of the run, a whole number of cycles after its start.

    Attributes
    ----------
    kind : MotionKind
        `PERIODIC` and `NO_IMPACTS` (`AT_REST`, without a force) of a motion that repeats and is
        stable; `QUASI_PERIODIC`, `CHAOTIC` or `UNDECIDED`, by the thresholds of
        `orbits.irregularity`, of one that does not; `NOT_PERIODICALLY_DRIVEN`.
    period : Period or None
        Period on the stroboscopic section; None if the motion does not repeat.
    parameters : RigParameters
        The rig.
    cycle : float
        Cycle of the force, or of the spring if there is none, s.
    start : float
        Time at which the run began, s.
    turned : float
        Angle of the force's first harmonic at the start, in cycles, as phases count it.
    cycles : int
        Cycles of the run.
    events : ndarray of EVENT_TYPE
        Events of the cycles that were watched: the last ones, at least a period.
    event_count : int
        Number of all events.
    section : ndarray, shape (n, 4)
        X, X', Y and Y' once in each of these cycles, where impacts are rare.
    exponent : Exponent
        Largest Lyapunov exponent; NaN under gap control, where it is not measured, or if too
        little was watched.
    multiplier : float
        Modulus of the largest multiplier of a period; NaN if the motion does not repeat, or where
        the exponent is NaN.
    indications : Indications or None
        The evidence for and against chaos of a motion that does not repeat, per cycle; None
        under gap control.
    reason : str
        Why the run ended early, and the remedy; empty if it did not.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters
    >>> motion = settle(Rig(RigParameters(gravity=0.0)))
    >>> motion.kind.name, motion.rhythm.stops, round(motion.x_max, 5)
    ('PERIODIC', (1, 2), 10.46441)
    """

    kind: MotionKind
    period: Period | None = None
    parameters: RigParameters
    cycle: float
    start: float
    turned: float
    cycles: int
    events: Events
    event_count: int
    section: Array
    exponent: Exponent = _UNKNOWN
    multiplier: float = math.nan
    indications: Indications | None = None
    reason: str
    _begin: FlightStart
    _last: Events

    def __repr__(self) -> str:
        """Return the motion in a line."""
        text = f'<SettledMotion: {self.kind.value}'
        if self.rhythm is not None:
            text += f', {plural(self.rhythm.impacts, "impact")} in '
            text += plural(self.rhythm.cycles, 'cycle')
        text += f' after {plural(self.cycles, "cycle")}; largest |X| {self.x_max:.6g} m'
        return f'{text}; {self.reason}>' if self.reason else f'{text}>'

    @property
    def end(self) -> float:
        """Time at which the run ended, s."""
        return self.start + self.cycles * self.cycle

    @property
    def watched_from(self) -> float:
        """Time from which on `events` are known, s."""
        return float(self._begin.row['time'][0])

    @property
    def quiet(self) -> float:
        """Cycles since the last impact; infinite if there was none in the watched ones."""
        hits = self.events['time'][self.events['kind'] == EventKind.IMPACT]
        return (self.end - float(hits[-1])) / self.cycle if len(hits) else math.inf

    @property
    def impacts(self) -> list[Event]:
        """The impacts of the last period, or of all cycles watched if there is none."""
        chosen = self.events['kind'] == EventKind.IMPACT
        if self.period is not None:
            chosen &= self.events['time'] > self.end - self.period.cycles * self.cycle
        return events_of_table(rows_where(chosen, self.events))

    @cached_property
    def flights(self) -> Flights:
        """The cycles that were watched."""
        flights = self._begin.flights(self.parameters, self.events, self._last)
        # The steps of a swept force are unknown.
        return flights if self.parameters.sweep_mode == 'off' else replace(flights, drive=None)

    def phase(self, time: float) -> float:
        """Return the angle of the force's first harmonic at a time (s), in cycles."""
        return self.turned + (time - self.start) / self.cycle

    @cached_property
    def rhythm(self) -> Rhythm | None:
        """The impacts of a period; None without impacts, or if the motion does not repeat."""
        hits = self.impacts
        if self.period is None or not hits:
            return None
        return Rhythm.of_impacts(
            self.period.cycles,
            [event.stop for event in hits],
            [self.phase(event.time) for event in hits],
            [event.x for event in hits],
            self.x_max,
        )

    @cached_property
    def x_max(self) -> float:
        """Largest |X|, m, exact: over the last period, or over all cycles watched."""
        span = math.inf if self.period is None else self.period.cycles * self.cycle
        return self.flights.cut(self.end - span, self.end).moments()[1]

    @cached_property
    def orbit(self) -> PeriodicOrbit | None:
        """
        The motion of theory that was reached, begun at the same impact as `rhythm`.

        It is None if no motion is within the rest of the transient, or stops move.
        """
        rhythm = self.rhythm
        if rhythm is None or self.period is None:
            return None
        rig = counted_from_zero(self.parameters, self._begin.drive.angles)
        # The search begins at the strongest impact: round-off matters least there.
        hits = sorted(self.impacts, key=lambda event: -abs(event.impulse))
        for impact in hits[:_STARTS]:
            orbit = orbit_near(rig, impact, self.phase(impact.time), rhythm.cycles)
            turned = None if orbit is None else orbit.nearest_turn(rhythm)
            if turned is not None and max(turned[1]) < _REACHED:
                return turned[0]
        return None


def _kept_quiet(phases: Array, before: float) -> float:
    """Return a phase without impacts: the last phase, unless impacts have come near to it."""
    if not len(phases):
        return before
    best = quiet_phase(phases)
    clear = [float(np.abs((phases - place + 0.5) % 1.0 - 0.5).min()) for place in (before, best)]
    return before if clear[0] > _STILL_QUIET * clear[1] else best


class _SettlingRig:
    """A rig that is run by whole cycles of its force, and the records of its last cycles."""

    def __init__(self, rig: Rig, watch: int, most_events: int, longest: int) -> None:
        parameters, self.begin = rig.parameters, FlightStart.of(rig)
        self.rig, self.parameters, self.longest = rig, parameters, longest
        self.cycle = cycle_of(parameters)
        self.rate = max(math.tau / self.cycle, parameters.omega)
        self.start, self.cycles, self.events = rig.time, 0, 0
        self.reason = ''
        self.parts: list[_Part] = []
        self.last = np.empty(0, EVENT_TYPE)
        self._static = max(map(abs, parameters.harmonics[0]), default=0.0) / parameters.stiffness
        drive = self.begin.drive
        since = self.start - drive.time
        self.turned = drive.angles[0] + parameters.first_harmonic[1] * since
        rates = _active_rates(parameters)
        self.forced = bool(rates)
        turns = [rate * self.cycle / math.tau for rate in rates]
        self.driven = parameters.sweep_mode == 'off' and _repeat(turns, longest)
        law = rig.control
        noisy = law.gap_control_noise_position or law.gap_control_noise_velocity
        samples = law.gap_control_rate * self.cycle
        # No law samples under external control, nor while stops are sent back
        sampled = rig.own_law is not None or law.gap_control not in ('off', 'external')
        self.in_step = not sampled or (not noisy and _repeat([samples], longest))
        self._watch, self._most = watch, most_events
        self._quiet = 0.5
        self._size = 0.0
        # Stops that are sent back after the control was switched off come to rest on the way
        self._controlled = rig.moves_stops
        self._section: Array
        self.forget()

    def forget(self) -> None:
        """Discard the states so far, so that the detection of a period starts again."""
        self._section = np.empty((0, 6 if self._controlled else 4))

    @property
    def time(self) -> float:
        """Time after the cycles run so far, s."""
        return self.start + self.cycles * self.cycle

    def wait(self, cycles: int, tolerance: float, interrupted: Callable[[], bool]) -> bool:
        """Run, compiled, until a state comes back or for some cycles; return whether one did."""
        try:
            waited, events = self.rig.run_until_return(
                *(self.cycle, self.rate, cycles, max(tolerance, _CAME_BACK)),
                most_events=self._most,
                interrupted=interrupted,
            )
        except RunawayError as error:
            self.reason = str(error)
            return False
        self.cycles, self.events = waited, events
        return waited < cycles

    def run(self, cycles: int) -> bool:
        """Run for some cycles; return whether that was possible."""
        rig = self.rig
        # Angles are counted from the start of the run.
        begin = FlightStart.of(rig)._replace(drive=self.begin.drive)
        if self.parts:
            before = self.parts[-1].events
            hits = before['time'][before['kind'] == EventKind.IMPACT]
            self._quiet = _kept_quiet((hits - self.start) / self.cycle, self._quiet)
        # One rounding, so that the steps do not drift
        counts = self.cycles + np.arange(cycles)[:, None] + np.array([self._quiet, 1.0])
        instants = self.start + counts.ravel() * self.cycle
        most = max(self._most - self.events, 1)
        result = rig.run(float(instants[-1]), instants, most_events=most)
        self.events += result.event_count
        if result.outcome is not Outcome.COMPLETE:
            self.reason = result.reason
            return False
        self.last = rows_of_samples(result.samples[-1:])
        states = relative_states(result.samples)
        section, quiet = states[1::2], states[::2]
        size = float(np.abs(section[:, 0]).max() + np.ptp(section[:, 2]))
        if size < _SMALL * self._static:
            # M may pass zero at the ends of all cycles.
            flights = begin.flights(self.parameters, result.events, self.last)
            size += flights.cut(self.time, math.inf).moments()[1]
        # A rig without force has settled once its start has decayed.
        self._size = size if self.forced else max(size, self._size)
        if self._controlled:
            # Stops that still move are not settled, whether m reaches them or not.
            samples = result.samples[1::2]
            places = [samples[name] - samples['x'] for name in ('stop_1', 'stop_2')]
            section = np.concatenate([section, np.stack(places, axis=-1)], axis=-1)
        self._section = np.concatenate([self._section, section])
        self.parts.append(_Part(begin, result.events, quiet))
        self.cycles += cycles
        oldest = self.start + (self.cycles - self._watch) * self.cycle
        while len(self.parts) > 1 and self.parts[1].begin.row['time'][0] <= oldest:
            del self.parts[0]
        return True

    def period(self, tolerance: float) -> Period | None:
        """Return the period with which the last states repeat."""
        if not self.driven or len(self._section) < 2:
            return None
        # Without motion all states are equal.
        size = (self._size or 1.0) * np.array([1.0, self.rate] * 2)
        if self._controlled:
            far = float(np.abs(self._section[-1, 4:]).max())
            size = np.append(size, [max(self._size, far)] * 2)
        # A motion that is not periodic rarely comes back so near: the search would be in vain.
        recent = self._section[-1 - self.longest :] / size
        if nearest_return(recent, self.longest) > _NEAR * max(tolerance, _SAME_STATE):
            return None
        section = Section.stroboscopic(self._section, size)
        return find_period(section, tolerance, _SAME_STATE, longest=self.longest)

    def result(self, kind: MotionKind, **fields: Any) -> SettledMotion:
        """Return the motion, given its kind and further fields."""
        return SettledMotion(
            kind=kind,
            parameters=self.parameters,
            cycle=self.cycle,
            start=self.start,
            turned=self.turned / math.tau,
            cycles=self.cycles,
            events=one_table(np.empty(0, EVENT_TYPE), *(s.events for s in self.parts)),
            event_count=self.events,
            section=np.concatenate([np.empty((0, 4)), *(s.section for s in self.parts)]),
            reason=self.reason,
            _begin=self.parts[0].begin if self.parts else self.begin,
            _last=self.last,
            **fields,
        )

    def repeating(self, period: Period) -> SettledMotion:
        """Return the motion that has settled, with its largest multiplier."""
        motion = self.result(MotionKind.PERIODIC, period=period)
        kind = motion.kind
        if not motion.impacts:
            kind = MotionKind.NO_IMPACTS if self.forced else MotionKind.AT_REST
        if self.rig.moves_stops:
            return replace(motion, kind=kind)
        # The period before gives the error.
        span, end = period.cycles * self.cycle, motion.end
        edges = max(motion.watched_from, end - 2.0 * span), end - span, end
        periods = [ends for ends in pairwise(edges) if ends[0] < ends[1]]
        matrices = [monodromy_of(motion.flights, *ends) for ends in periods]
        moduli = [abs(multipliers_of(matrix)[0]) for matrix in matrices]
        rates = [math.log(modulus) / span if modulus else -math.inf for modulus in moduli]
        spread = abs(rates[-1] - rates[0]) if all(map(math.isfinite, rates)) else 0.0
        exponent = Exponent(rates[-1], spread)
        return replace(motion, kind=kind, exponent=exponent, multiplier=moduli[-1])

    def irregular(self) -> SettledMotion:
        """Return the motion that does not repeat, with the evidence for and against chaos."""
        motion = self.result(MotionKind.UNDECIDED)
        watched = len(motion.section)
        if self.parameters.sweep_mode != 'off':
            return replace(motion, kind=MotionKind.NOT_PERIODICALLY_DRIVEN)
        if watched < _FEWEST:
            return motion
        if not (self.driven and self.in_step):
            motion = replace(motion, kind=MotionKind.NOT_PERIODICALLY_DRIVEN)
        if self.rig.moves_stops:
            return motion
        exponent = growth_exponent(motion.flights, motion.watched_from, motion.end)
        rates = self.cycle * exponent.value, self.cycle * exponent.standard_error
        indications = Indications(*rates, watched, average_spread(motion.section))
        kind = indications.kind() if motion.kind is MotionKind.UNDECIDED else motion.kind
        return replace(motion, kind=kind, exponent=exponent, indications=indications)


def settle(
    rig: Rig,
    *,
    cycles: int = 2000,
    watch: int = 500,
    tolerance: float = 1e-8,
    events: int = 2_000_000,
    between: int = 50,
    quiet: float = math.inf,
    longest: int = LONGEST_PERIOD,
    interrupted: Callable[[], bool] = lambda: False,
) -> SettledMotion:
    """
    Run a rig until its motion repeats.

    The rig runs until the state at the end of a cycle of the force is that of an earlier cycle, or
    to the cycles to watch. From there on the states at the ends of all cycles are compared. The
    motion has settled if they come back after 1 to 16 cycles, for two periods and at least ten
    cycles. A motion that comes back but is unstable by its multipliers is run on until it
    departs. A motion that does not repeat within the given cycles is judged by its last cycles.

    Parameters
    ----------
    rig : Rig
        The rig, at any instant, with or without gap control. It is run on.
    cycles : int, optional
        Most cycles of the force to run; of the spring, if there is no force.
    watch : int, optional
        Number of last cycles that are kept and judged if the motion does not repeat: at least 300
        distinguish chaos from quasi-periodic motion.
    tolerance : float, optional
        How closely the states a period apart must agree, relative to the size of the motion.
    events : int, optional
        Most events of the run; with more it ends, and `reason` reports it.
    between : int, optional
        Cycles between two comparisons.
    quiet : float, optional
        Cycles without an impact after which the run ends, whether M has settled or not.
    longest : int, optional
        Longest period that is recognised, in cycles of the force.
    interrupted : callable, optional
        Called now and then; once it returns true, the run ends, and the result has no meaning.

    Returns
    -------
    SettledMotion
        The motion, with its period, its impacts and its kind.

    Raises
    ------
    TypeError
        If the rig is no `Rig`.
    ParameterError
        If the number of cycles is not positive.

    Notes
    -----
    Under gap control the stops must come back too. Exponents and multipliers are not measured
    there, since the decisions of a control have no derivative.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> found = settle(Rig(RigParameters(gravity=0.0)))
    >>> found.kind.value, found.rhythm.stops, round(found.rhythm.phases[0], 6)
    ('periodic', (1, 2), 0.733784)
    """
    check_kind('rig', rig, Rig, 'a Rig, such as Rig(parameters)')
    cycles = whole_number('cycles', cycles, 1, 2**31)
    run = _SettlingRig(rig, max(watch, 3 * longest), events, longest)
    # Without force the rest of a start decays, but states never come back.
    if cycles > watch and math.isinf(quiet) and run.forced:
        if not run.wait(cycles - watch, tolerance, interrupted):
            between = watch
        if run.reason:
            return run.result(MotionKind.UNDECIDED)
    while run.cycles < cycles:
        if not run.run(min(between, cycles - run.cycles)):
            return run.result(MotionKind.UNDECIDED)
        period = run.period(tolerance)
        if (
            period is not None
            and period.settled
            and period.repeated >= 2
            and period.repeated * period.cycles >= _LEAST_REPEATS
        ):
            motion = run.repeating(period)
            doubt = motion.exponent.uncertainty * period.cycles * run.cycle
            if not motion.multiplier > _GROWS * math.exp(doubt):
                return motion
            run.forget()
        if math.isfinite(quiet) and run.cycles >= quiet:
            motion = run.result(MotionKind.NO_IMPACTS)
            if motion.quiet >= quiet:
                return motion
    return run.irregular()
