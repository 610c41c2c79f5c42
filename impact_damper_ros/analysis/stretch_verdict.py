"""How a stretch compares with theory, in one word and one sentence."""

from __future__ import annotations

import math
from typing import NamedTuple

from impact_damper_ros.orbits import OrbitError, PeriodicOrbit, find_orbits

from .force_clock import ForceClock
from .motion_kind import MotionKind
from .periodic_part import PeriodicPart
from .recurrence import SETTLED
from .run_comparison import Verdict
from .stretch_kind import StretchKind
from .stretch_measures import Finding
from .without_impacts import Oscillation

__all__ = ['Judgement', 'irregular_judgement', 'judged_log', 'judged_oscillation', 'judged_period']


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
    """
    Judge a motion that repeats, or comes to.

    Parameters
    ----------
    kind : StretchKind
        What it is.
    part : PeriodicPart
        The motion, and its prediction.
    log : list of Finding
        What is wrong with the log.
    solver : str
        Why there is no prediction, if there is none.
    """
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
    """
    Judge a motion that does not repeat, by the simplest motion that theory has here.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    kind : StretchKind
        What the motion is.
    log : list of Finding
        What is wrong with the log.

    Returns
    -------
    judgement : Judgement
        The verdict.
    orbit : PeriodicOrbit or None
        That motion.
    """
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
    """
    Judge a motion without impacts.

    Parameters
    ----------
    found : Oscillation or None
        What the theory has.
    x_max : float
        Measured largest |X|, m.
    log : list of Finding
        What is wrong with the log.
    """
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
