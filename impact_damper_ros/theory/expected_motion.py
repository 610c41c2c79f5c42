# SPDX-License-Identifier: Apache-2.0
"""
The periodic motion into which a rig will settle from its present state.

Theory gives the periodic motions; which of several stable ones a rig reaches depends on its state.
The rig is therefore run ahead until its motion repeats, and the nearest periodic motion is solved
for, with its multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from impact_damper_ros.orbits.arguments import OrbitError, period_of_force
from impact_damper_ros.orbits.orbit import PeriodicOrbit, Rhythm
from impact_damper_ros.orbits.recurrence import MotionKind
from impact_damper_ros.orbits.search import counted_as, find_orbits, starting_rigs
from impact_damper_ros.orbits.settled_motion import SettledMotion, settle
from impact_damper_ros.orbits.solved_orbits import counted_from_zero, orbit_near
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig

from .prediction import Basis, ObservedMotion, Prediction

#: Longest run ahead, in cycles of the force, and how often its impacts are examined.
_MOST_CYCLES_AHEAD = 1500
_CYCLES_BETWEEN_LOOKS = 25
_MOST_EVENTS = 50_000
#: The rig has settled if states a period apart agree to this, relative to the size of the motion.
_SETTLED = 1e-5
#: That of other attractors, from other starts.
_ELSEWHERE = 600
#: Largest distance of a solution from the motion of the rig.
_NEAR = 1e-2
_SAME = 1e-6
#: Longest period of the force, in cycles of its first harmonic.
_LONGEST_FORCE = 8
#: Most impacts of a motion that is searched for without its states: more take minutes.
_MOST_SOUGHT = 32


def run_ahead(rig: Rig, most_cycles: int = _MOST_CYCLES_AHEAD) -> SettledMotion:
    """Run a rig on until its motion repeats."""
    return settle(
        rig,
        cycles=most_cycles,
        tolerance=_SETTLED,
        events=_MOST_EVENTS,
        between=_CYCLES_BETWEEN_LOOKS,
    )


class _Orbits:
    """The different motions found so far, the best first."""

    def __init__(self) -> None:
        self.all: list[PeriodicOrbit] = []

    def add(self, orbit: PeriodicOrbit) -> PeriodicOrbit:
        """Keep a motion, unless it is known; return the one that is kept."""
        if (known := self.nearest(orbit, _SAME)) is not None:
            return known
        self.all.append(orbit)
        self.all.sort(key=lambda o: (not o.viable, not o.stable, o.x_max))
        return orbit

    def search(
        self, parameters: RigParameters, stops: tuple[int, ...], cycles: int, simulate: bool
    ) -> None:
        """Search for the motions with these stops."""
        try:
            found = find_orbits(parameters, stops, cycles, simulate=simulate)
        except OrbitError:
            # This rig cannot have such motions, such as those on both stops of a one-sided rig.
            return
        for orbit in found.orbits:
            self.add(orbit)

    def nearest(self, rhythm: Rhythm, limit: float) -> PeriodicOrbit | None:
        """Return the motion nearest to a rhythm, if it is within a limit."""
        best = min(self.all, key=rhythm.distance, default=None)
        return best if best is not None and rhythm.distance(best) < limit else None

    def like(self, parameters: RigParameters, motion: ObservedMotion) -> PeriodicOrbit | None:
        """Return the predicted motion that an observed one has reached, and keep it."""
        rhythm, impact = motion.rhythm, motion.impact
        if (known := self.nearest(rhythm, _NEAR)) is not None:
            return known
        try:
            shot = orbit_near(parameters, impact, motion.phase, rhythm.cycles)
        except OrbitError:
            shot = None
        counted = None if shot is None else counted_as(shot, rhythm.stops)
        if counted is not None:
            return self.add(counted)
        if len(rhythm.stops) > _MOST_SOUGHT:
            return None
        self.search(parameters, rhythm.stops, rhythm.cycles, simulate=True)
        return self.nearest(rhythm, _NEAR)

    def settled_orbit(
        self, parameters: RigParameters, found: SettledMotion
    ) -> PeriodicOrbit | None:
        """Return the predicted motion into which a rig has settled, and keep it."""
        if found.rhythm is None:
            return None
        # The strongest impact: round-off matters least there.
        impact = max(found.impacts, key=lambda event: abs(event.impulse))
        motion = ObservedMotion(found.rhythm, impact, found.phase(impact.time))
        return self.like(parameters, motion)

    def predict(self, orbit: PeriodicOrbit | None, basis: Basis, why_not: str = '') -> Prediction:
        """Predict a motion; if none is given, the first that the rig can have."""
        if orbit is not None:
            return Prediction(tuple(self.all), orbit, basis)
        first = self.all[0] if self.all and self.all[0].viable else None
        return Prediction(tuple(self.all), first, 'listed' if first is not None else '', why_not)


def predictions(rig: Rig, measured: ObservedMotion | None = None) -> Iterator[Prediction]:
    """
    Predict the motion of a rig, then find the other motions that it can have.

    Parameters
    ----------
    rig : Rig
        The rig, in its present state, which does not change. While a law moves its stops, nothing
        is predicted.
    measured : ObservedMotion or None, optional
        The motion measured on the rig since its state.

    Yields
    ------
    Prediction
        The predicted motion, and once more, `complete`, with the others. For a rig without a
        periodic force there is only one prediction, which gives the reason.
    """
    if rig.control.active:
        reason = f'gap_control is {rig.control.gap_control}: theory is for stops that do not move'
        yield Prediction(reason=reason, complete=True, applies=False)
        return
    try:
        period = period_of_force(rig.parameters, _LONGEST_FORCE)
    except OrbitError as error:
        yield Prediction(reason=str(error), complete=True, applies=False)
        return
    parameters = counted_from_zero(rig.parameters, rig.state().angles)
    orbits = _Orbits()
    stops = (1,) if parameters.one_sided else (1, 2)
    orbits.search(parameters, stops, period, simulate=False)
    expected = None if measured is None else orbits.like(parameters, measured)
    ahead = run_ahead(Rig.restore(rig.snapshot(), rig.own_law, compiled=None))
    reached = orbits.settled_orbit(parameters, ahead)
    prediction = orbits.predict(expected, 'measured')
    if expected is None:
        prediction = orbits.predict(reached, 'run ahead', _why_none(ahead))
        prediction = replace(prediction, kind=ahead.kind.value)
    yield prediction
    for start in starting_rigs(parameters):
        orbits.settled_orbit(parameters, run_ahead(start, _ELSEWHERE))
    yield replace(prediction, orbits=tuple(orbits.all), complete=True)


def _why_none(ahead: SettledMotion) -> str:
    if ahead.reason:
        return f'run ahead from its state, the rig cannot be run further: {ahead.reason}'
    if ahead.rhythm is not None:
        stops = ','.join(map(str, ahead.rhythm.stops))
        return (
            f'run ahead, the rig reaches a motion with stops {stops} in '
            f'{plural(ahead.rhythm.cycles, "cycle")} of the force, for which the solvers find no '
            'motion'
        )
    if ahead.kind in (MotionKind.NO_IMPACTS, MotionKind.AT_REST) or math.isinf(ahead.quiet):
        return f'run ahead from its state, the rig has no more impacts after {ahead.cycles} cycles'
    text = (
        f'run ahead from its state, the rig does not repeat within {ahead.cycles} cycles of the '
        'force'
    )
    if (found := ahead.indications) is not None:
        text += (
            f'; {ahead.kind.value}: Lyapunov exponent {found.exponent:+.3f} ± {found.error:.3f} '
            f'per cycle over {found.cycles} of them'
        )
    return text
