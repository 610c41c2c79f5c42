"""The comparison of one stretch of a run with theory, and its verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from impact_damper_ros.orbits import OrbitError, PeriodicOrbit, find_orbits
from impact_damper_ros.orbits.equations import check_forcing
from impact_damper_ros.orbits.recognition import LONGEST_PERIOD, SETTLED, MotionKind

from .comparison_curves import impact_curve, motion_curve, predicted_curve, spectrum
from .fault_search import FaultSearch
from .log_findings import log_findings, repaired_impacts
from .matched_orbit import impulses_of
from .periodic_part import PeriodicPart, knots_between, measured_motion, periodic_part
from .recorded_stretch import ForceClock, RecordedStates, RecordedStretch
from .run_comparison import EnergyBalance, Finding, StretchComparison, Verdict
from .run_curves import StretchCurves
from .stretch_kind import (
    Oscillation,
    StretchKind,
    carried_on,
    kind_of,
    kind_without_force_phase,
    oscillation,
)
from .stretch_totals import energy_balance

__all__ = [
    'Judgement',
    'compare_stretch',
    'irregular_judgement',
    'judged_log',
    'judged_oscillation',
    'judged_period',
    'why_no_theory',
]


_LISTED_STOPS = 12


class Judgement(NamedTuple):
    """A verdict, in words, and the findings that led to it."""

    verdict: Verdict
    sentence: str
    findings: list[Finding]


def motion_name(orbit: PeriodicOrbit) -> str:
    """Return what identifies a motion to the reader."""
    cycles = '1 cycle' if orbit.cycles == 1 else f'{orbit.cycles} cycles'
    if orbit.impacts > _LISTED_STOPS:
        return f'the motion with {orbit.impacts} impacts in {cycles}'
    stops = ','.join(str(stop) for stop in orbit.stops)
    return f'the motion with the stops {stops} in {cycles}'


def _stability(orbit: PeriodicOrbit) -> str:
    word = 'stable' if orbit.stable else 'not stable'
    return f'{word}, largest multiplier {abs(orbit.multipliers[0]):.4g}'


def judged_log(log: list[Finding]) -> Judgement:
    """Judge a stretch whose log is wrong: there is at least one finding."""
    more = f' (and {len(log) - 1} more)' if len(log) > 1 else ''
    return Judgement(Verdict.DIFFERS, log[0].text + more, log)


def judged_period(
    kind: StretchKind, part: PeriodicPart, log: list[Finding], solver: str
) -> Judgement:
    """Judge a motion that repeats, or comes to."""
    orbit = part.match.orbit
    distance = float(part.match.distance)
    if log:
        judgement = judged_log(log)
        if orbit is not None and not kind.carried_on and distance > part.allowed:
            return judgement._replace(findings=[*log, *part.differences()])
        return judgement
    if orbit is None:
        return Judgement(Verdict.NO_PREDICTION, solver, [])
    name = motion_name(orbit)
    if kind.carried_on:
        cycles = kind.measures['settles_after_cycles']
        text = f'theory leads on to {name} ({_stability(orbit)}), {cycles:.0f} cycles later'
        return Judgement(Verdict.NOT_SETTLED, text, [])
    rate = ''
    if not math.isnan(part.decay.factor):
        rate = (
            f'; deviations shrink by {part.decay.factor:.5g} in a period, predicted '
            f'{part.predicted_factor:.5g}'
        )
    if distance > part.allowed:
        differences = part.differences()
        text = f'differs by {distance:.3g} of its size from {name}, where {part.allowed:.1g} is '
        text += 'explained by the remaining transient and the stamps'
        if differences:
            text += f': {differences[0].text}'
        return Judgement(Verdict.DIFFERS, text + rate, differences)
    near = f'{distance:.2g} of its size from {name} ({_stability(orbit)})'
    if kind.kind is MotionKind.TRANSIENT:
        factor = part.predicted_factor
        # Where the multipliers are complex the distance swings on its way.
        largest = float(part.distances[-6:].max())
        if orbit.stable and largest > SETTLED and factor > 0.0:
            more = math.ceil(math.log(SETTLED / largest) / math.log(factor)) * orbit.cycles
            near += f', and within {SETTLED:g} of it after about {more} more cycles'
        return Judgement(Verdict.NOT_SETTLED, near + rate, [])
    if not orbit.stable:
        return Judgement(Verdict.PREDICTED_UNSTABLE, near + rate, [])
    return Judgement(Verdict.AGREES, near + rate, [])


def irregular_judgement(
    clock: ForceClock, kind: StretchKind, log: list[Finding]
) -> tuple[Judgement, PeriodicOrbit | None]:
    """Judge a motion that does not repeat, by the simplest motion that theory has here."""
    rig = clock.counted_from_zero()
    stops = (1,) if rig.one_sided else (1, 2)
    orbits: tuple[PeriodicOrbit, ...] = ()
    try:
        orbits = find_orbits(rig, stops, 1, simulate=False).orbits
        judgement = _beside(kind, orbits, stops)
    except OrbitError as error:
        judgement = Judgement(Verdict.NO_PREDICTION, str(error), [])
    if kind.kind is MotionKind.TRANSIENT:
        judgement = Judgement(Verdict.NOT_SETTLED, kind.evidence, [])
    if kind.short:
        judgement = Judgement(Verdict.TOO_SHORT, kind.evidence, [])
    if log:
        judgement = judged_log(log)
    viable = [orbit for orbit in orbits if orbit.viable]
    return judgement, (viable[0] if viable else None)


def _beside(
    kind: StretchKind, orbits: tuple[PeriodicOrbit, ...], stops: tuple[int, ...]
) -> Judgement:
    """Judge by the motions with the period of the force."""
    viable = [orbit for orbit in orbits if orbit.viable]
    named = ','.join(str(stop) for stop in stops)
    what = kind.kind.value
    if not viable:
        reason = orbits[0].reason if orbits else 'the equations have no solution'
        text = (
            f'{what}: theory has no motion with the stops {named} in 1 cycle that this rig could '
            f'make ({reason})'
        )
        return Judgement(Verdict.NO_PREDICTION, text, [])
    orbit = viable[0]
    if not orbit.stable:
        text = f'{what}: theory has {motion_name(orbit)}, but it is {_stability(orbit)}'
        return Judgement(Verdict.PREDICTED_UNSTABLE, text, [])
    text = (
        f'{what}, beside {motion_name(orbit)} ({_stability(orbit)}), which theory has here and '
        'other initial conditions, or more time, may lead to'
    )
    return Judgement(Verdict.NO_PREDICTION, text, [])


def judged_oscillation(found: Oscillation | None, x_max: float, log: list[Finding]) -> Judgement:
    """Judge a motion without impacts."""
    if log:
        return judged_log(log)
    if found is None:
        text = 'without impacts m slides to and fro: no periodic motion with impacts to compare'
        return Judgement(Verdict.NO_PREDICTION, text, [])
    how = 'with m on it' if found.joined else 'without m'
    text = (
        f'M vibrates {how}: largest |X| {x_max:.7g} m, predicted {found.x_max:.7g} m; the free '
        f'vibration left is {found.distance:.2g} of it'
    )
    verdict = Verdict.AGREES if found.settled else Verdict.NOT_SETTLED
    return Judgement(verdict, text, [])


#: Periods, or cycles, of which the energy is balanced, and which the plots show in detail.
_BALANCED, _SHOWN = 50, 8
#: Periods of a settled motion that are measured.
_MEASURED = 20
#: Cycles without an impact at the end of a stretch, after which it counts as one without.
_QUIET_CYCLES = 20
_LEAST_CYCLES = 2
_STILL = 1e-9


def why_no_theory(stretch: RecordedStretch) -> str:
    """Return why the periodic theory does not apply to a stretch; empty if it does."""
    rig, control = stretch.parameters, stretch.control
    if (mode := control.get('gap_control', 'off')) != 'off':
        return f'the gap is under control ({mode}): the periodic theory is for a constant gap'
    if rig.multisine_level > 0.0:
        return 'the force is a multisine: it does not repeat within the periods looked for'
    if rig.sweep_mode != 'off':
        return 'the frequency of the force is swept'
    if rig.force_amplitudes[0] == 0.0 or rig.force_frequencies[0] == 0.0:
        return 'the first harmonic of the force is off: there are no cycles to count'
    if stretch.clock is None:
        return 'the phase of the force is not in the bag (no snapshot)'
    for cycles in range(1, LONGEST_PERIOD + 1):
        try:
            check_forcing(rig, cycles)
        except OrbitError:
            continue
        return ''
    return f'the harmonics of the force have no common period of up to {LONGEST_PERIOD} cycles'


def _cycle(stretch: RecordedStretch) -> float:
    """Return the duration of a cycle of the force, or of the natural vibration, s."""
    rig = stretch.parameters
    forced = rig.force_amplitudes[0] != 0.0 and rig.force_frequencies[0] != 0.0
    return math.tau / (rig.force_frequencies[0] if forced else rig.omega)


def _at_rest(states: RecordedStates) -> bool:
    """Return whether nothing moves in the last quarter of some joint states."""
    late = states[-max(len(states) // 4, 2) :]
    speeds = np.concatenate([late.velocity, late.damper_velocity])
    every = np.concatenate([states.velocity, states.damper_velocity])
    largest = float(np.abs(every).max(initial=0.0))
    return float(np.abs(speeds).max(initial=0.0)) <= _STILL * largest


class _Comparison:
    """The comparison of one stretch, step by step."""

    def __init__(
        self,
        stretch: RecordedStretch,
        search: FaultSearch | None,
        replayed: Sequence[Finding] | None,
    ) -> None:
        self.stretch = stretch
        self.cycle = _cycle(stretch)
        self.reason = why_no_theory(stretch)
        controlled = stretch.control.get('gap_control', 'off') != 'off'
        self.log = log_findings(stretch, search, controlled=controlled, replayed=replayed)
        self.impacts = repaired_impacts(stretch, search)
        self.part: PeriodicPart | None = None
        self.orbit: PeriodicOrbit | None = None
        self.solver = ''

    def run(self) -> StretchComparison:
        stretch = self.stretch
        cycles = stretch.duration / self.cycle
        if cycles < _LEAST_CYCLES or len(stretch.states) + len(stretch.impacts) < 3:
            text = f'{cycles:.2g} cycles of the force are too few to tell anything'
            kind = StretchKind(MotionKind.UNDECIDED, text, short=True)
            return self._result(kind, self._unless_wrong(Verdict.TOO_SHORT, text))
        quiet = max(0.5 * stretch.duration, min(_QUIET_CYCLES * self.cycle, stretch.duration))
        late = bool((self.impacts.time > stretch.end - quiet).any())
        if len(stretch.states) and not late:
            return self._without_impacts(stretch.end - quiet)
        return self._with_impacts()

    def _unless_wrong(self, verdict: Verdict, text: str) -> Judgement:
        """Return a judgement; that of the log if that is wrong."""
        return judged_log(self.log) if self.log else Judgement(verdict, text, [])

    def _without_impacts(self, start: float) -> StretchComparison:
        stretch = self.stretch
        states = stretch.states[stretch.states.time >= start]
        if len(states) >= 2 and _at_rest(stretch.states):
            kind = StretchKind(MotionKind.AT_REST, 'nothing moves any more')
            text = 'nothing moves, and nothing pushes'
            if any(stretch.parameters.force_amplitudes):
                text = 'nothing moves'
            return self._result(kind, self._unless_wrong(Verdict.NO_PREDICTION, text))
        text = f'm has hit no stop for {(stretch.end - start) / self.cycle:.0f} cycles'
        kind = StretchKind(MotionKind.NO_IMPACTS, text)
        measured = measured_motion(stretch, stretch.end - 0.2 * stretch.duration, stretch.end)
        driven = stretch.clock is not None and not self.reason
        found = None
        if driven and len(states):
            assert stretch.clock is not None
            found = oscillation(stretch.clock, states)
            self.solver = 'closed form' if found is not None else ''
        judgement = judged_oscillation(found, measured.x_max, self.log)
        if found is None and stretch.duration < _QUIET_CYCLES * self.cycle:
            judgement = self._unless_wrong(Verdict.TOO_SHORT, f'{text}, and the stretch is short')
        if self.reason:
            judgement = self._unless_wrong(Verdict.NO_PREDICTION, self.reason)
        return self._result(kind, judgement)

    def _with_impacts(self) -> StretchComparison:
        clock = self.stretch.clock
        if clock is None or self.reason:
            kind = kind_without_force_phase(self.impacts, self.cycle)
            driven = clock is None and self.stretch.parameters.sweep_mode == 'off'
            if self.reason and not driven and kind.recurrence is None:
                kind = StretchKind(MotionKind.NOT_PERIODICALLY_DRIVEN, self.reason, kind.measures)
            self.solver = self.reason
            if kind.recurrence is not None and clock is not None:
                self.part = periodic_part(clock, kind, predict=False)
            return self._result(kind, self._unless_wrong(Verdict.NO_PREDICTION, self.reason))
        kind = kind_of(clock, self.impacts, sound=not self.log)
        if kind.recurrence is None:
            judgement, self.orbit = irregular_judgement(clock, kind, self.log)
            self.solver = 'impact equations, one cycle of the force'
            return self._result(kind, judgement)
        part = periodic_part(clock, kind, predict=True)
        if part.match.orbit is None and kind.kind is MotionKind.TRANSIENT:
            further = carried_on(clock, self.impacts)
            if further is not None:
                kind, part = further, periodic_part(clock, further, predict=True)
        near = part.match.distance <= SETTLED and not kind.carried_on
        if kind.kind is MotionKind.TRANSIENT and near:
            kind = replace(kind, kind=MotionKind.PERIODIC)
        self.part, self.orbit, self.solver = part, part.match.orbit, part.match.solver
        return self._result(kind, judged_period(kind, part, self.log, part.match.solver))

    def _result(self, kind: StretchKind, judgement: Judgement) -> StretchComparison:
        stretch, part, orbit = self.stretch, self.part, self.orbit
        recorded = part if not kind.carried_on else None
        steady = begin = stretch.start + 0.5 * stretch.duration
        period, per_cycle, decay, settled_at = None, math.nan, None, None
        if recorded is not None:
            period, settled_at = recorded.period, recorded.settled_at
            cycles = recorded.recurrence.cycles
            per_cycle = recorded.recurrence.impacts / cycles
            if recorded.match.orbit is not None:
                decay = recorded.as_decay()
            if settled_at is not None:
                steady = min(settled_at, stretch.end)
                begin = max(steady, stretch.end - _MEASURED * cycles * self.cycle)
        return StretchComparison(
            number=stretch.number,
            start=stretch.start,
            end=stretch.end,
            begins=stretch.begins,
            cause=stretch.cause,
            parameters=stretch.parameters,
            control=stretch.control,
            samples=stretch.state_count,
            impacts=stretch.impact_count,
            missing_samples=stretch.missing_states,
            kind=kind.kind,
            evidence=kind.evidence,
            measures=kind.measures,
            cycles=part.recurrence.cycles if part is not None else 0,
            settled_at=settled_at,
            overall=stretch.overall,
            measured=measured_motion(stretch, begin, stretch.end, period, per_cycle),
            predicted=orbit,
            predicted_impulse=impulses_of(orbit) if orbit is not None else (),
            solver=self.solver,
            energy=self._energy(recorded),
            decay=decay,
            verdict=judgement.verdict,
            sentence=judgement.sentence,
            findings=tuple(judgement.findings),
            curves=self._curves(recorded, steady),
        )

    def _energy(self, part: PeriodicPart | None) -> EnergyBalance | None:
        """Balance the energy over whole periods, or cycles of the force, at the end."""
        stretch, clock = self.stretch, self.stretch.clock
        if clock is None or not len(stretch.states):
            return None
        first = max(float(stretch.states.time[0]), stretch.start)
        if part is not None:
            times = part.times[part.times >= first][-1 - _BALANCED :]
            if len(times) > 1:
                knots = knots_between(stretch, float(times[0]), float(times[-1]))
                return energy_balance(clock, knots, len(times) - 1)
        cycles = min(_BALANCED, int((stretch.end - first) / self.cycle))
        if cycles < 1:
            return None
        knots = knots_between(stretch, stretch.end - cycles * self.cycle, stretch.end)
        return energy_balance(clock, knots, cycles)

    def _curves(self, part: PeriodicPart | None, steady: float) -> StretchCurves:
        stretch, clock, orbit = self.stretch, self.stretch.clock, self.orbit
        predicted = None
        if clock is not None and orbit is not None:
            time = part.time if part is not None else stretch.end
            period = part.period if part is not None else None
            predicted = predicted_curve(clock, orbit, period, time)
        rig = stretch.parameters
        forced = rig.force_amplitudes[0] != 0.0
        span = _SHOWN * self.cycle * max(1, part.recurrence.cycles if part is not None else 1)
        settled = stretch.states[stretch.states.time >= steady]
        return StretchCurves(
            envelope=stretch.envelope if len(stretch.envelope.time) else None,
            motion=motion_curve(stretch, max(stretch.start, stretch.end - span)),
            impacts=impact_curve(stretch, stretch.impacts),
            predicted=predicted,
            convergence=part.as_curve() if part is not None else None,
            spectrum=spectrum(settled, rig.force_frequencies[0] / math.tau if forced else 0.0),
        )


def compare_stretch(
    stretch: RecordedStretch,
    search: FaultSearch | None,
    replayed: Sequence[Finding] | None = None,
) -> StretchComparison:
    """
    Measure a stretch, find out what its motion is, and hold it against theory.

    Parameters
    ----------
    stretch : RecordedStretch
        The stretch.
    search : FaultSearch or None
        What its flights told, as `StretchMeter` has it; None if the force is not known, or the
        log needs no check.
    replayed : sequence of Finding, optional
        What a bit-for-bit replay of the log found in this stretch; None if there was none.
    """
    return _Comparison(stretch, search, replayed).run()
