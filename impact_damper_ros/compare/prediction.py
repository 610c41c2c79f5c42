"""
Which periodic motion a rig will settle into, from where it is.

Theory says which motions there are; to which of several stable ones a rig comes depends on where
it starts. The motion between impacts being closed-form, the rig is simply run ahead until its
impacts repeat; the periodic motion next to that is then solved for, with its multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from impact_damper_ros.control import ControlledRig
from impact_damper_ros.orbits import OrbitError, PeriodicOrbit, find_orbits, orbit_near
from impact_damper_ros.orbits.equations import check_forcing
from impact_damper_ros.orbits.recognition import LONGEST_RHYTHM, Rhythm, rhythm_of, turned_cycles
from impact_damper_ros.orbits.search import counted_as
from impact_damper_ros.orbits.settling import run_by_cycles, starting_points
from impact_damper_ros.rig import Event, ParameterError, RigParameters, Simulator

from .carried_rig import carry_on
from .recorded_stretch import ForceClock, RecordedImpacts

__all__ = ['Basis', 'Course', 'Prediction', 'predictions', 'run_ahead']


AnyRig: TypeAlias = Simulator | ControlledRig
#: Why a motion is the one predicted: the rig was measured to move like it, or comes to it when it
#: is run ahead, or it is only the first of those there are.
Basis: TypeAlias = Literal['measured', 'run ahead', 'listed', '']

#: Longest run ahead, in cycles of the force, and how often its impacts are looked at.
MOST_CYCLES_AHEAD = 1500
_CYCLES_BETWEEN_LOOKS = 25
_PARTS_OF_CYCLE = 4
_MOST_EVENTS = 30_000
#: The same for other attractors, from other starts.
_ELSEWHERE = 600
_KEPT_IMPACTS = 512
_RECENT = 100
#: Recorded cycles that stand for those of a rig that was run ahead: it is run on for 1500 more.
_CARRIED_FOR = 50.0
#: A solution this near to what the rig does is the one it does.
NEAR = 1e-2
_SAME = 1e-6


@dataclass(frozen=True)
class Course:
    """
    How a rig moves after a while.

    Attributes
    ----------
    rhythm : Rhythm or None
        What its impacts repeat; None if they do not.
    impact : Event or None
        The last impact.
    phase : float
        Its instant in cycles of the force since its zero angle.
    cycles : int, optional
        How far it was run for that, in cycles of the force.
    hits : bool, optional
        Whether there were impacts in the last cycles.
    recent : tuple of Event, optional
        The last impacts, up to 100.
    """

    rhythm: Rhythm | None
    impact: Event | None
    phase: float
    cycles: int = 0
    hits: bool = True
    recent: tuple[Event, ...] = ()


@dataclass(frozen=True)
class Prediction:
    """
    The periodic motions of a rig, as far as they are known.

    Attributes
    ----------
    orbits : tuple of PeriodicOrbit
        Different motions; stable and viable ones first, then viable, then the others.
    expected : PeriodicOrbit or None
        The one of them that is predicted.
    basis : str
        Why that one.
    reason : str
        What is to be said of the choice, or why there is none.
    complete : bool
        Whether no better answer is to come.
    applies : bool
        Whether the theory is for such a rig at all.
    """

    orbits: tuple[PeriodicOrbit, ...] = ()
    expected: PeriodicOrbit | None = None
    basis: Basis = ''
    reason: str = ''
    complete: bool = False
    applies: bool = True


def run_ahead(rig: AnyRig, most_cycles: int = MOST_CYCLES_AHEAD) -> Course:
    """Run a rig on until its impacts repeat."""
    frequency = rig.parameters.force_frequencies[0]
    began, turned, cycle = rig.time, turned_cycles(rig.snapshot(), frequency), math.tau / frequency
    impacts: list[Event] = []
    total, looked, rhythm, hits = 0, 0, None, False
    instants: list[float] = []
    for look in run_by_cycles(
        rig, _CYCLES_BETWEEN_LOOKS, most_cycles, base=began, parts=_PARTS_OF_CYCLE
    ):
        total, looked = total + len(look.events), look.cycles
        impacts = [*impacts, *look.impacts][-_KEPT_IMPACTS:]
        instants = [turned + (event.time - began) / cycle for event in impacts]
        hits = bool(instants) and instants[-1] > turned + looked - LONGEST_RHYTHM
        stops, x = [event.stop for event in impacts], [event.x for event in impacts]
        rhythm = rhythm_of(instants, stops, x, look.largest) if hits else None
        if (rhythm is not None and rhythm.settled) or total > _MOST_EVENTS:
            break
    impact = impacts[-1] if impacts else None
    phase = instants[-1] if instants else 0.0
    return Course(rhythm, impact, phase, looked, hits, tuple(impacts[-_RECENT:]))


def _period_of_force(parameters: RigParameters) -> int:
    """Return the period of the force in cycles of its first harmonic."""
    for cycles in range(1, LONGEST_RHYTHM + 1):
        try:
            check_forcing(parameters, cycles)
        except OrbitError:
            if cycles == LONGEST_RHYTHM:
                raise
        else:
            break
    return cycles


def _clock_of(rig: AnyRig) -> ForceClock:
    """Return the force of a rig."""
    origin = rig.snapshot()['origin']
    angles = tuple(map(float, origin['angles']))
    return ForceClock(rig.parameters, float(origin['time']), angles)


class _Orbits:
    """The different motions found so far, the best first."""

    def __init__(self) -> None:
        self.all: list[PeriodicOrbit] = []

    def add(self, orbit: PeriodicOrbit) -> PeriodicOrbit:
        """Keep a motion, unless it is known; return the one that is kept."""
        if (known := self.nearest(Rhythm.of(orbit), _SAME)) is not None:
            return known
        self.all.append(orbit)
        self.all.sort(key=lambda o: (not o.viable, not o.stable, o.x_max))
        return orbit

    def search(
        self, parameters: RigParameters, stops: tuple[int, ...], cycles: int, simulate: bool
    ) -> None:
        """Look for the motions with these stops."""
        try:
            found = find_orbits(parameters, stops, cycles, simulate=simulate)
        except OrbitError:
            # Not motions that this rig can be asked for, such as both stops of a one-sided one
            return
        for orbit in found.orbits:
            self.add(orbit)

    def nearest(self, rhythm: Rhythm, limit: float) -> PeriodicOrbit | None:
        """Return the motion nearest to a rhythm, if it is within a limit."""
        best, least = None, limit
        for orbit in self.all:
            turned = Rhythm.of(orbit).turned_to(rhythm)
            if turned is not None and max(turned[1]) < least:
                best, least = orbit, max(turned[1])
        return best

    def like(self, parameters: RigParameters, course: Course) -> PeriodicOrbit | None:
        """Return the motion that a rig has come to, and keep it."""
        rhythm, impact = course.rhythm, course.impact
        if rhythm is None or impact is None:
            return None
        if (known := self.nearest(rhythm, NEAR)) is not None:
            return known
        try:
            shot = orbit_near(parameters, impact, course.phase, rhythm.cycles)
        except OrbitError:
            shot = None
        counted = None if shot is None else counted_as(shot, rhythm.stops)
        if counted is not None:
            return self.add(counted)
        self.search(parameters, rhythm.stops, rhythm.cycles, simulate=True)
        return self.nearest(rhythm, NEAR)


def predictions(rig: AnyRig, measured: Course | None = None) -> Iterator[Prediction]:
    """
    Predict the motion of a rig, at first quickly and then ever more thoroughly.

    Parameters
    ----------
    rig : Simulator or ControlledRig
        The rig, where it is; it is left there. While a law moves its stops nothing is predicted.
    measured : Course or None, optional
        How it has been seen to move since.

    Yields
    ------
    Prediction
        The first after some 20 ms, the last, which is `complete`, after a few tenths of a second.
        A rig without a periodic force has one only, which says so.
    """
    if isinstance(rig, ControlledRig) and rig.control.active:
        reason = f'gap_control is {rig.control.gap_control}: theory is for stops that do not move'
        yield Prediction(reason=reason, complete=True, applies=False)
        return
    try:
        period = _period_of_force(rig.parameters)
    except OrbitError as error:
        yield Prediction(reason=str(error), complete=True, applies=False)
        return
    clock = _clock_of(rig)
    parameters = clock.counted_from_zero()
    orbits = _Orbits()
    stops = (1,) if parameters.one_sided else (1, 2)
    orbits.search(parameters, stops, period, simulate=False)
    expected = None if measured is None else orbits.like(parameters, measured)
    if expected is not None:
        yield Prediction(tuple(orbits.all), expected, 'measured')
    else:
        yield _listed(orbits, '')
    course = run_ahead(type(rig).restore(rig.snapshot()))
    ahead = orbits.like(parameters, course)
    prediction = (
        Prediction(tuple(orbits.all), expected, 'measured')
        if expected is not None
        else Prediction(tuple(orbits.all), ahead, 'run ahead')
        if ahead is not None
        else _listed(orbits, _why_none(course))
    )
    yield prediction
    for initial in starting_points(parameters):
        try:
            start = Simulator(parameters, initial)
        except ParameterError:
            continue
        orbits.like(parameters, run_ahead(start, _ELSEWHERE))
    reason = prediction.reason
    if reason and course.rhythm is None and course.hits:
        reason += _how_irregular(clock, course)
    yield replace(prediction, orbits=tuple(orbits.all), reason=reason, complete=True)


def _listed(orbits: _Orbits, reason: str) -> Prediction:
    """Predict the first of the motions that the rig can have."""
    first = orbits.all[0] if orbits.all and orbits.all[0].viable else None
    return Prediction(tuple(orbits.all), first, 'listed' if first is not None else '', reason)


def _how_irregular(clock: ForceClock, course: Course) -> str:
    """Return what the motion of a rig is that does not repeat, as `compare_run` would say it."""
    carried = carry_on(clock, RecordedImpacts.of_events(course.recent), _CARRIED_FOR)
    if carried is None or (found := carried.indications) is None:
        return ''
    return (
        f'; {found.kind().value}: Lyapunov exponent {found.exponent:+.3f} ± {found.error:.3f} per '
        f'cycle over {found.cycles} cycles more'
    )


def _why_none(course: Course) -> str:
    if not course.hits:
        return f'run ahead from where it is, m hits no stop any more after {course.cycles} cycles'
    if course.rhythm is None:
        return (
            f'run ahead from where it is, the rig does not repeat within {course.cycles} cycles '
            'of the force'
        )
    stops = ','.join(map(str, course.rhythm.stops))
    return (
        f'run ahead, the rig comes to stops {stops} in {course.rhythm.cycles} cycles of the '
        'force, for which the solvers find no motion'
    )
