"""The rig of the theory, followed event by event from one recorded knot to another."""

from __future__ import annotations

import numpy as np

from impact_damper_ros.orbits.event_map import Course, origin_at, run_course
from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.hybrid_motion import RunawayError
from impact_damper_ros.rig.mode import REST_1, REST_2, STICK, make_machine
from impact_damper_ros.rig.origin import offset_of

from .flight_check import Knots, resting_place
from .force_clock import ForceClock
from .run_curves import Array

__all__ = ['FollowedRig']

#: A stamp is rounded to the nanosecond; an impact is looked for so much later.
_ROUNDED_S = 2e-9
_ROUND_OFF = 1e-14
_WEAK = 1e-3
_RELATIVE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0]]
)


class FollowedRig:
    """
    Follows the rig between knots.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged; the stops are in their places.
    """

    def __init__(self, clock: ForceClock) -> None:
        self.rig = clock.counted_from_zero()
        self._clock = clock
        self._machine = make_machine(self.rig)

    def course(
        self, knots: Knots, first: int, duration: float, *, differentiate: bool = False
    ) -> Course | None:
        """
        Return the motion from just after a knot on.

        Parameters
        ----------
        knots : Knots
            The knots.
        first : int
            Where to begin.
        duration : float
            How long, s.
        differentiate : bool, optional
            Whether to work out its derivative.
        """
        x, z = float(knots.x[first]), float(knots.z[first])
        velocity = float(knots.velocity[first])
        relative = float(knots.damper_velocity[first]) - velocity
        half = self._machine.stop
        stop = int(knots.stop[first]) or resting_place(self.rig, z - x)
        beyond = {0: z - x - half, 1: 0.0, 2: -2.0 * half}[stop if relative == 0.0 else 0]
        if knots.stop[first]:
            beyond = 0.0 if stop == 1 else -2.0 * half
        resting = {0: STICK, 1: REST_1, 2: REST_2}[stop] if relative == 0.0 else 0
        origin = origin_at(
            self._machine,
            float(knots.time[first]) - self._clock.zero,
            x,
            velocity,
            beyond,
            relative,
            resting,
            int(knots.last_stop[first]),
        )
        try:
            return run_course(self._machine, origin, duration, differentiate=differentiate)
        except (ArithmeticError, RunawayError):
            # A wrong number may be one with which no rig can move.
            return None

    def out_of_reach(self, knots: Knots, first: int, last: int) -> bool:
        """Return whether a stop that follows m has still to come to its place."""
        y = np.abs(knots.z[[first, last]] - knots.x[[first, last]])
        beyond = y > self._machine.stop * (1.0 + 1e-9)
        return not self.rig.one_sided and bool((beyond & (knots.touched[[first, last]] > 0)).any())

    def next_knot(self, knots: Knots, first: int) -> Array | None:
        """
        Return X, X', Z and Z' just before the knot after the next interval.

        Parameters
        ----------
        knots : Knots
            The knots.
        first : int
            Where the interval begins.

        Returns
        -------
        ndarray, shape (4,), or None
            None if an impact comes that is not recorded there, or does not come.
        """
        last = first + 1
        duration = float(knots.time[last] - knots.time[first])
        at_impact = knots.stop[last] > 0.0
        course = self.course(knots, first, duration + (_ROUNDED_S if at_impact else 0.0))
        if course is None:
            return None
        hits = [i for i in course.incidents if i.kind is EventKind.IMPACT]
        speed = max(abs(float(knots.velocity[first])), abs(float(knots.damper_velocity[first])))
        # Of the weak impacts that end a chatter none is told.
        strong = [hit for hit in hits if abs(hit.relative_before) > _WEAK * speed]
        if not at_impact:
            return None if strong else _state_of(course)
        there = [hit for hit in hits if hit.time >= duration - _ROUNDED_S]
        if any(hit.time < duration - _ROUNDED_S for hit in strong) or not there:
            return None
        hit = there[0]
        if hit.stop != int(knots.stop[last]):
            return None
        half = self._machine.stop
        z = hit.x + (half if hit.stop == 1 else -half)
        return np.array([hit.x, hit.velocity_before, z, hit.velocity_before + hit.relative_before])

    def reaches(
        self, course: Course, knots: Knots, last: int, tolerances: Array
    ) -> tuple[Array, bool]:
        """
        Return by how much a course misses a joint state, and whether that can be told.

        Parameters
        ----------
        course : Course
            The course, with its derivative.
        knots : Knots
            The knots.
        last : int
            Where it ends.
        tolerances : ndarray, shape (4,)
            How well X, X', Z and Z' are known.
        """
        missed = _recorded(knots, last) - _state_of(course)
        scale = np.array(
            [
                max(abs(float(knots.x[last])), abs(float(knots.z[last]))),
                max(abs(float(knots.velocity[last])), abs(float(knots.damper_velocity[last]))),
            ]
        )
        grown = np.abs(course.matrix) @ (_ROUND_OFF * np.tile(scale, 2))
        return missed, bool((grown < tolerances).all())


def _state_of(course: Course) -> Array:
    """Return X, X', Z and Z' at the end."""
    end = course.end
    offset = offset_of(end.clearance_1, end.clearance_2, end.stop_1, end.stop_2)
    state: Array = _RELATIVE @ np.array([end.x, end.velocity, offset, end.relative_velocity])
    return state


def _recorded(knots: Knots, knot: int) -> Array:
    """Return X, X', Z and Z' just before a knot."""
    return np.array(
        [
            knots.x[knot],
            knots.velocity_before[knot],
            knots.z[knot],
            knots.damper_velocity_before[knot],
        ]
    )
