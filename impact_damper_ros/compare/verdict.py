# SPDX-License-Identifier: Apache-2.0
"""The comparison of one stretch of a run with theory, and its verdict."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from impact_damper_ros.orbits.arguments import OrbitError, check_forcing
from impact_damper_ros.orbits.flight_arrays import Drive
from impact_damper_ros.orbits.flight_integrals import EQUATION_PUSH, EQUATION_SQUARE
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.recurrence import LONGEST_PERIOD, MotionKind, Period
from impact_damper_ros.orbits.ring_down import is_free, recorded_ring_down
from impact_damper_ros.orbits.search import find_orbits
from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.orbits.solved_orbits import counted_from_zero
from impact_damper_ros.orbits.swept_response import SweptResponse, swept_response
from impact_damper_ros.orbits.transmissibility import dynamic_stiffness
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.replay.rows import Samples

from .measures import energy_balance, measured_motion, motion_curve, spectrum
from .motion_kind import SETTLED, StretchKind, kind_by_impacts, kind_of, run_on, settled_after
from .prediction import SAME_DECAY, PeriodicMotion, impulses_of, periodic_motion, predicted_curve
from .result import EnergyBalance, LoggedStretch, StretchComparison, StretchCurves, Verdict
from .stretches import RecordedStretch

_LISTED_STOPS = 12


class _Judgement(NamedTuple):
    """A verdict, and the verdict in words."""

    verdict: Verdict
    sentence: str


def _motion_name(orbit: PeriodicOrbit) -> str:
    cycles = plural(orbit.cycles, 'cycle')
    if orbit.impacts > _LISTED_STOPS:
        return f'the motion with {plural(orbit.impacts, "impact")} in {cycles}'
    stops = ','.join(str(stop) for stop in orbit.stops)
    return f'the motion with the stops {stops} in {cycles}'


def _stability(orbit: PeriodicOrbit) -> str:
    word = orbit.stability.replace('unstable', 'not stable')
    return f'{word}, largest multiplier {abs(orbit.multipliers[0]):.4g}'


def _judged_period(kind: StretchKind, motion: PeriodicMotion) -> _Judgement:
    """Judge a motion that repeats, or that settles to a period."""
    orbit, distance, decay = motion.orbit, motion.distance, motion.decay
    if orbit is None:
        return _Judgement(Verdict.NO_PREDICTION, motion.solver)
    name = _motion_name(orbit)
    rate = ''
    if not math.isnan(decay.measured):
        rate = (
            f'; a period multiplies deviations by {decay.measured:.5g}, predicted '
            f'{decay.predicted:.5g}'
        )
        if abs(decay.measured - decay.predicted) > SAME_DECAY * decay.predicted:
            rate += ', which is another one'
    if distance > motion.allowed:
        text = f'differs by {distance:.3g} of its size from {name}; the remaining transient and '
        text += f'the stamps explain {motion.allowed:.1g}'
        return _Judgement(Verdict.DIFFERS, text + rate)
    near = f'{distance:.2g} of its size from {name} ({_stability(orbit)})'
    if kind.kind is MotionKind.TRANSIENT:
        # If the multipliers are complex, the distance oscillates as it shrinks.
        largest = float(motion.distances[-6:].max())
        if orbit.stable and largest > SETTLED and decay.predicted > 0.0:
            periods = math.log(SETTLED / largest) / math.log(decay.predicted)
            more = math.ceil(periods) * orbit.cycles
            near += f', and within {SETTLED:g} of it after about {more} more cycles'
        return _Judgement(Verdict.NOT_SETTLED, near + rate)
    stays = orbit.stable or orbit.neutral
    verdict = Verdict.AGREES if stays else Verdict.PREDICTED_UNSTABLE
    return _Judgement(verdict, near + rate)


def _judged_irregular(
    stretch: RecordedStretch, drive: Drive, kind: StretchKind
) -> tuple[_Judgement, PeriodicOrbit | None]:
    """Judge a motion that does not repeat, by the simplest periodic motion of the rig."""
    rig = counted_from_zero(stretch.parameters, drive.angles)
    stops = (1,) if rig.one_sided else (1, 2)
    orbits: tuple[PeriodicOrbit, ...] = ()
    try:
        orbits = find_orbits(rig, stops, 1, simulate=False).orbits
        judgement = _beside(kind, orbits, stops)
    except OrbitError as error:
        judgement = _Judgement(Verdict.NO_PREDICTION, str(error))
    if kind.kind is MotionKind.TRANSIENT:
        judgement = _Judgement(Verdict.NOT_SETTLED, kind.evidence)
    if kind.short:
        judgement = _Judgement(Verdict.TOO_SHORT, kind.evidence)
    return judgement, next((orbit for orbit in orbits if orbit.viable), None)


def _beside(
    kind: StretchKind, orbits: tuple[PeriodicOrbit, ...], stops: tuple[int, ...]
) -> _Judgement:
    """Judge by the motions with the period of the force."""
    orbit = next((orbit for orbit in orbits if orbit.viable), None)
    what = kind.kind.value
    if orbit is None:
        named = ','.join(str(stop) for stop in stops)
        reason = orbits[0].reason if orbits else 'the equations have no solution'
        text = (
            f'{what}: theory finds no motion with the stops {named} in 1 cycle that this rig can '
            f'perform ({reason})'
        )
        return _Judgement(Verdict.NO_PREDICTION, text)
    if not (orbit.stable or orbit.neutral):
        text = f'{what}: theory finds {_motion_name(orbit)}, but it is {_stability(orbit)}'
        return _Judgement(Verdict.PREDICTED_UNSTABLE, text)
    text = f'{what}; theory finds {_motion_name(orbit)} ({_stability(orbit)}), which the rig '
    text += 'may reach later, or' if orbit.stable else 'does not approach, but may have'
    text += ' from other initial conditions'
    return _Judgement(Verdict.NO_PREDICTION, text)


#: Largest change of Y, as a share of X and Y, with which m keeps its place in M.
_KEPT = 1e-9


def _vibration(stretch: RecordedStretch, *, joined: bool) -> float | None:
    """Return a bound of |X| in steady vibration without impacts, m; exact for one harmonic."""
    rig = stretch.parameters
    mass = rig.primary_mass + (rig.damper_mass if joined else 0.0)
    frequencies, amplitudes = np.array(rig.harmonics[1]), np.array(rig.harmonics[0])
    stiffness = np.abs(dynamic_stiffness(rig, frequencies, mass))
    active = amplitudes != 0.0
    if (stiffness[active] == 0.0).any():
        return None
    air = rig.air_force * bool(stretch.flights.stop[-1])
    weight = rig.damper_mass * rig.gravity * math.sin(rig.angle)
    rest = abs(weight if joined else air) / rig.stiffness
    return float((np.abs(amplitudes[active]) / stiffness[active]).sum()) + rest


def _free_vibration(stretch: RecordedStretch, *, joined: bool) -> float:
    """Return the amplitude of the free vibration that is left at the end, m."""
    rig, flights = stretch.parameters, stretch.flights
    mass = rig.primary_mass + (rig.damper_mass if joined else 0.0)
    last, tau = np.array([len(flights) - 1]), flights.spans[-1:]
    columns = flights.equations[last].T
    steady, speed = columns[EQUATION_PUSH] / columns[EQUATION_SQUARE], 0.0
    for number, amplitude in enumerate(rig.harmonics[0]):
        if amplitude:
            force, rate = flights.line(number, last)
            moved = force * np.exp(1j * rate * tau) / dynamic_stiffness(rig, rate, mass)
            steady, speed = steady + moved.imag, speed + rate * moved.real
    end = flights.rows[-1:]
    x, velocity = end['x'] - steady, end['primary_velocity_after'] - speed
    return float(np.hypot(x, velocity / math.sqrt(rig.stiffness / mass))[0])


def _judged_vibration(stretch: RecordedStretch, x_max: float, cycle: float) -> _Judgement:
    """Judge a motion without impacts by the rig that is run on from its end."""
    rig = stretch.parameters
    late = stretch.flights.cut(stretch.end - 0.5 * stretch.duration, stretch.end)
    joined = bool(late.together[:-1].all())
    expected = _vibration(stretch, joined=joined)
    later = run_on(stretch, cycle, math.inf)
    if expected is None or later is None or (not joined and rig.friction * rig.gravity > 0.0):
        text = 'm slides with friction and hits no stop: theory has no closed solution for it'
        return _Judgement(Verdict.NO_PREDICTION, text)
    section = later.section
    hits = later.impacts if later.period is None else []
    left = _free_vibration(stretch, joined=joined) / expected if expected else math.inf
    how = 'with m on it' if joined else 'without m'
    several = sum(amplitude != 0.0 for amplitude in rig.harmonics[0]) > 1
    text = (
        f'M vibrates {how}: largest |X| {x_max:.7g} m, predicted '
        f'{"at most " if several else ""}{expected:.7g} m; the free vibration left is {left:.2g} '
        'of it'
    )
    # Without friction m stays at its place in space while X still settles.
    place = section[:, 2] if joined else section[:, 0] + section[:, 2]
    drift = float(place[-1] - place[0])
    size = float(np.abs(place).max()) + expected
    moves = hits or abs(drift) > _KEPT * size
    if hits:
        after = (hits[0].time - stretch.end) / cycle
        text += (
            f'; m does not keep its place, and hits stop {hits[0].stop} after about {after:.3g} '
            'more cycles'
        )
    elif moves and not (rig.one_sided and drift < 0.0):
        stop = 1 if drift > 0.0 else 2
        text += f'; m does not keep its place, and drifts towards stop {stop}'
    else:
        moves = False
    if rig.damping == 0.0 and left > SETTLED and not moves:
        return _Judgement(Verdict.NO_PREDICTION, f'{text}, and stays: M is not damped')
    settled = left <= SETTLED and not moves
    return _Judgement(Verdict.AGREES if settled else Verdict.NOT_SETTLED, text)


#: Periods, or cycles, over which the energy is balanced, and which the plots show in detail.
_BALANCED, _SHOWN = 50, 8
_MOST_IMPACTS = 20_000
#: Periods of a settled motion that are measured.
_MEASURED = 20
#: Cycles without an impact at the end of a stretch after which it counts as one without impacts.
_QUIET_CYCLES = 20
_LEAST_CYCLES = 2
_STILL = 1e-9


def _why_no_theory(stretch: RecordedStretch) -> str:
    """Return why the periodic theory does not apply to a stretch; empty if it does."""
    rig = stretch.parameters
    if stretch.flights.drive is None:
        return 'a measured record acts on the rig: theory has no motion for it'
    if stretch.controlled:
        mode = stretch.control['gap_control']
        return f'the gap is under control ({mode}): the periodic theory is for a constant gap'
    if rig.multisine_level > 0.0:
        return 'the force is a multisine: it has no period within the range searched'
    if rig.sweep_mode != 'off':
        return f'the frequency of the {rig.swept} is swept'
    if is_free(rig):
        return 'no force acts, and the base is at rest: the rig is left to itself'
    if rig.first_harmonic[0] == 0.0 or rig.first_harmonic[1] == 0.0:
        return 'the first harmonic of the force is zero: there are no cycles to count'
    for cycles in range(1, LONGEST_PERIOD + 1):
        try:
            check_forcing(rig, cycles)
        except OrbitError:
            continue
        return ''
    return f'the harmonics of the force have no common period of up to {LONGEST_PERIOD} cycles'


def _at_rest(samples: Samples) -> bool:
    """Return whether nothing moves in the last quarter of some samples."""
    speeds = np.abs([samples['primary_velocity'], samples['damper_velocity']]).max(axis=0)
    late = speeds[-max(len(speeds) // 4, 2) :]
    return float(late.max(initial=0.0)) <= _STILL * float(speeds.max(initial=0.0))


class _Comparison:
    """The comparison of one stretch, step by step."""

    def __init__(self, stretch: RecordedStretch) -> None:
        self.stretch = stretch
        self.cycle = cycle_of(stretch.parameters)
        self.ring_down = recorded_ring_down(stretch.flights)
        self.response: SweptResponse | None = None
        if stretch.parameters.sweep_mode != 'off' and len(stretch.flights):
            self.response = swept_response(stretch.flights)
        self.reason = _why_no_theory(stretch)
        self.motion: PeriodicMotion | None = None
        self.orbit: PeriodicOrbit | None = None
        self.solver = ''

    def run(self) -> StretchComparison:
        stretch = self.stretch
        cycles = stretch.duration / self.cycle
        impacts = stretch.flights.impacts
        if cycles < _LEAST_CYCLES or len(stretch.samples) + len(impacts) < 3:
            text = f'{cycles:.2g} cycles of the force are too few for a comparison'
            kind = StretchKind(MotionKind.UNDECIDED, text, short=True)
            return self._result(kind, _Judgement(Verdict.TOO_SHORT, text))
        quiet = max(0.5 * stretch.duration, min(_QUIET_CYCLES * self.cycle, stretch.duration))
        if len(stretch.samples) and not (impacts['time'] > stretch.end - quiet).any():
            return self._without_impacts(quiet)
        return self._with_impacts()

    def _without_theory(self) -> _Judgement:
        """Return why there is no prediction; of a sweep the largest |X|, with m and of M alone."""
        found = self.response
        if found is None:
            return _Judgement(Verdict.NO_PREDICTION, self.reason)
        texts = (
            f'{values.max():.5g} m at {found.frequency[values.argmax()] / math.tau:.4g} Hz'
            for values in (found.x, found.x_without)
        )
        text = f'{self.reason}: |X| is largest, ' + ', without damper '.join(texts)
        return _Judgement(Verdict.SWEPT, text)

    def _without_impacts(self, quiet: float) -> StretchComparison:
        stretch = self.stretch
        if len(stretch.samples) >= 2 and _at_rest(stretch.samples):
            kind = StretchKind(MotionKind.AT_REST, 'nothing moves any more')
            forced = any(stretch.parameters.force_amplitudes)
            text = 'nothing moves' if forced else 'nothing moves, and no force acts'
            return self._result(kind, _Judgement(Verdict.NO_PREDICTION, text))
        text = f'm has hit no stop for {quiet / self.cycle:.0f} cycles'
        kind = StretchKind(MotionKind.NO_IMPACTS, text)
        if self.reason:
            return self._result(kind, self._without_theory())
        end = stretch.end
        measured = measured_motion(stretch, end - 0.2 * stretch.duration, end)
        judgement = _judged_vibration(stretch, measured.x_max, self.cycle)
        short = stretch.duration < _QUIET_CYCLES * self.cycle
        if short and judgement.verdict is Verdict.NO_PREDICTION:
            text = f'{text}, and the stretch is short'
            return self._result(kind, _Judgement(Verdict.TOO_SHORT, text))
        self.solver = 'closed form'
        return self._result(kind, judgement)

    def _with_impacts(self) -> StretchComparison:
        stretch, drive = self.stretch, self.stretch.drive
        if drive is None or self.reason:
            kind = kind_by_impacts(stretch, self.cycle)
            if self.reason and kind.recurrence is None:
                kind = StretchKind(MotionKind.NOT_PERIODICALLY_DRIVEN, self.reason)
            self.solver = self.reason
            if kind.recurrence is not None and drive is not None:
                self.motion = periodic_motion(drive, kind.impacts, kind.recurrence)
            return self._result(kind, self._without_theory())
        kind = kind_of(stretch, self.cycle)
        if kind.recurrence is not None:
            return self._repeating(drive, kind, kind.recurrence)
        later = kind.later
        if later is not None and (orbit := later.orbit) is not None:
            self.orbit, self.solver = orbit, 'boundary-value problem of its events'
            text = f'run on, it comes to {_motion_name(orbit)} ({_stability(orbit)}) after '
            text += plural(settled_after(later), 'cycle')
            return self._result(kind, _Judgement(Verdict.NOT_SETTLED, text))
        judgement, self.orbit = _judged_irregular(stretch, drive, kind)
        self.solver = 'impact equations, one cycle of the force'
        return self._result(kind, judgement)

    def _repeating(self, drive: Drive, kind: StretchKind, recurrence: Period) -> StretchComparison:
        """Compare a motion whose recorded impacts repeat, or will."""
        motion = periodic_motion(drive, kind.impacts, recurrence, self.stretch.parameters)
        self.motion, self.orbit, self.solver = motion, motion.orbit, motion.solver
        if motion.orbit is None and kind.kind is MotionKind.TRANSIENT:
            later = run_on(self.stretch, self.cycle)
            if later is not None and later.orbit is not None:
                self.orbit, self.solver = later.orbit, 'boundary-value problem of its events'
                text = f'run on, it comes to {_motion_name(later.orbit)} '
                text += f'({_stability(later.orbit)})'
                return self._result(kind, _Judgement(Verdict.NOT_SETTLED, text))
        if kind.kind is MotionKind.TRANSIENT and motion.distance <= SETTLED:
            kind = replace(kind, kind=MotionKind.PERIODIC)
        return self._result(kind, _judged_period(kind, motion))

    def _result(self, kind: StretchKind, judgement: _Judgement) -> StretchComparison:
        stretch, recorded, orbit = self.stretch, self.motion, self.orbit
        samples, missing, impacts = stretch.counts
        steady = begin = stretch.start + 0.5 * stretch.duration
        period, per_cycle, decay, settled_at = None, math.nan, None, None
        if recorded is not None:
            period, settled_at = recorded.period, recorded.settled_at
            cycles = recorded.recurrence.cycles
            per_cycle = recorded.recurrence.rows / cycles
            if recorded.orbit is not None:
                decay = recorded.decay
            if settled_at is not None:
                steady = min(settled_at, stretch.end)
                begin = max(steady, stretch.end - _MEASURED * cycles * self.cycle)
        return StretchComparison(
            **{f.name: getattr(stretch, f.name) for f in fields(LoggedStretch)},
            samples=samples,
            impacts=impacts,
            missing_samples=missing,
            kind=kind.kind,
            evidence=kind.evidence,
            measures=kind.measures,
            cycles=recorded.recurrence.cycles if recorded is not None else 0,
            settled_at=settled_at,
            overall=stretch.overall,
            measured=measured_motion(stretch, begin, stretch.end, period, per_cycle),
            predicted=orbit,
            predicted_impulse=impulses_of(orbit) if orbit is not None else (),
            solver=self.solver,
            energy=self._energy(recorded),
            decay=decay,
            ring_down=self.ring_down,
            response=self.response,
            verdict=judgement.verdict,
            sentence=judgement.sentence,
            curves=self._curves(recorded, steady),
        )

    def _energy(self, motion: PeriodicMotion | None) -> EnergyBalance | None:
        """Balance the energy over whole periods, or cycles of the force, at the end."""
        stretch = self.stretch
        if stretch.flights.drive is None or not len(stretch.flights):
            return None
        first = float(stretch.flights.rows['time'][0])
        if motion is not None:
            times = motion.times[motion.times >= first][-1 - _BALANCED :]
            if len(times) > 1:
                return energy_balance(stretch, float(times[0]), float(times[-1]), len(times) - 1)
        cycles = min(_BALANCED, int((stretch.end - first) / self.cycle))
        start = stretch.end - cycles * self.cycle
        return energy_balance(stretch, start, stretch.end, cycles) if cycles else None

    def _curves(self, motion: PeriodicMotion | None, steady: float) -> StretchCurves:
        stretch, drive, orbit = self.stretch, self.stretch.drive, self.orbit
        predicted = None
        if drive is not None and orbit is not None:
            time = motion.time if motion is not None else stretch.end
            period = motion.period if motion is not None else None
            predicted = predicted_curve(drive, orbit, period, time)
        rig = stretch.parameters
        forced = rig.first_harmonic[0] != 0.0 and drive is not None and drive.cycle < math.inf
        cycles = max(1, motion.recurrence.cycles if motion is not None else 1)
        shown = stretch.end - _SHOWN * self.cycle * cycles
        settled = stretch.samples[stretch.samples['time'] >= steady]
        impacts = stretch.flights.impacts[-_MOST_IMPACTS:]
        return StretchCurves(
            envelope=stretch.envelope if stretch.envelope.size else None,
            motion=motion_curve(stretch, max(stretch.start, shown), self.cycle),
            impacts=impacts if len(impacts) else None,
            phases=drive.phase(impacts['time']) % 1.0 if drive is not None and forced else None,
            predicted=predicted,
            convergence=motion.as_curve() if motion is not None else None,
            spectrum=spectrum(settled, rig.first_harmonic[1] / math.tau if forced else 0.0),
        )


def compare_stretch(stretch: RecordedStretch) -> StretchComparison:
    """Measure a stretch, find the kind of its motion, and compare it with theory."""
    return _Comparison(stretch).run()
