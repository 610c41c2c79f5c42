"""
The timed law: an impact where X passes through zero, that is where |X'| is largest.

Between the impacts the stops are parked wide apart. For a passage of X through zero at which an
impact would take energy from M, one stop is closed so as to meet m at that instant, and is then
opened again; at most one such impact for each passage.

With symmetric stops, m has to be on the side of the stop that is closed, as in the reconstruction
of the law of Masri et al. (1989). With independent stops, an extension, a stop may pass the middle
to meet m, which matters as soon as weight, friction or a random force let the middle of
the motion of m wander; and m must come with a good part of the speed of M, since each passage
allows one impact only.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar, NamedTuple

from impact_damper_ros.rig import GapControlParameters

from .law import Damper, Plant
from .sensors import LENGTH, TIME, Kinds, Measurement, Observer, Passage

#: Least approach speed with independent stops, over |X'|.
_LEAST_APPROACH = 0.5
#: How far past the middle an independent stop may be closed, over half the optimal gap.
_WANDER = 1.0
#: The target is beyond m by what m covers in this part of a half cycle, in case m is late.
_OVERREACH = 0.1
#: Longest delay of a timed impact after the passage, in half cycles.
_LATEST = 0.2
#: A stop that has not met m this long after the passage is opened, in half cycles.
_GIVE_UP = 0.25
#: A stop is not parked anew by less than this part of its place: each start costs energy.
_DEAD_BAND = 0.05
#: A stop is not parked where m will be within this part of a half cycle.
_CLEARANCE = 0.05


class Closing(NamedTuple):
    """A command that closes a stop on m: when to give it (s), to which stop, to which Y (m)."""

    issue: float
    stop: int
    target: float


def stop_to_close(
    at: Passage, parked: float, optimal: float, damper: Damper, p: GapControlParameters
) -> int:
    """
    Return which stop to close for a passage, 1 or 2, or 0 for none.

    Notes
    -----
    An impact of approach speed w changes the kinetic energy of M by (M/2)((X' - c w)^2 - X'^2) < 0
    if X' and Y' point in opposite directions and c |w| < 2 |X'|, c = mu (1 + R)/(1 + mu).
    """
    approach, speed = abs(at.y_rate), abs(at.x_rate)
    if at.x_rate * at.y_rate >= 0.0 or damper.push * approach >= 2.0 * speed:
        return 0
    stop = 1 if at.y_rate > 0.0 else 2
    outwards = at.y if stop == 1 else -at.y
    if outwards >= parked:
        # m hits the parked stop before.
        return 0
    if not p.independent:
        return stop if 2.0 * outwards > p.gap_min else 0
    if approach < _LEAST_APPROACH * speed or outwards < -_WANDER * 0.5 * optimal:
        return 0
    return stop


@dataclass(slots=True)
class TimedLaw:
    """
    State of the law.

    Attributes
    ----------
    parked : float
        Distance of the parked stops from the middle, m; 0 before they are parked.
    aimed : bool
        Whether a stop has been ordered for the coming passage.
    closed : int
        The stop that is closed, or 0.
    until : float
        When it is to meet m, s.
    """

    KINDS: ClassVar[Kinds] = {'parked': LENGTH, 'until': TIME}

    parked: float = 0.0
    aimed: bool = False
    closed: int = 0
    until: float = 0.0

    def see(self, sample: Measurement, plant: Plant) -> None:
        """Open the stop that has done its work, and close one for the passage ahead."""
        if self.parked == 0.0:
            return
        if self._reopens(sample, plant.observer):
            stop, self.closed = self.closed, 0
            self._park(sample.time, (stop,), plant)
        p = plant.parameters
        if self.closed or self.aimed or not (p.actuator_delay or p.actuator_speed):
            return
        ahead = plant.observer.next_passage()
        if ahead is not None and self._close(ahead, sample, plant.next_sample, plant):
            self.aimed = True

    def cross(self, sample: Measurement, plant: Plant) -> None:
        """Park the stops, and close one for this passage if that has not been done."""
        aimed, self.aimed = self.aimed, False
        self.parked = plant.symmetric_place(plant.parameters.gap_control_park)
        if not aimed and not self.closed:
            here = Passage(sample.time, sample.x_rate, sample.y, sample.y_rate)
            self._close(here, sample, inf, plant)
        self._park(sample.time, tuple(stop for stop in (1, 2) if stop != self.closed), plant)

    def _park(self, time: float, stops: tuple[int, ...], plant: Plant) -> None:
        """Send stops to where they are parked, unless m is or will be beyond that place."""
        now = Measurement(*plant.observer.last)
        free: list[float | None] = []
        for stop, side in ((1, 1.0), (2, -1.0)):
            outwards = side * now.y
            ahead = _CLEARANCE * plant.observer.half_cycle * max(0.0, side * now.y_rate)
            parked = stop in stops and outwards + ahead < self.parked
            free.append(side * self.parked if parked else None)
        plant.move(time, (free[0], free[1]), _DEAD_BAND)

    def _close(self, at: Passage, now: Measurement, before: float, plant: Plant) -> bool:
        """Order a stop to meet m at a passage; return whether one is ordered before an instant."""
        closing = self._aim(at, now, before, plant.observer, plant.damper, plant.parameters)
        if closing is None:
            return False
        issue, stop, target = closing
        first, second = (target, None) if stop == 1 else (None, target)
        plant.actuators.order(issue, first, second, plant.parameters)
        return True

    def _aim(
        self,
        at: Passage,
        now: Measurement,
        horizon: float,
        observer: Observer,
        damper: Damper,
        p: GapControlParameters,
    ) -> Closing | None:
        """Return the command that makes a stop meet m; None if none is to be given by then."""
        optimal = damper.optimal_gap(observer.amplitude, p.gap_max)
        stop = stop_to_close(at, self.parked, optimal, damper, p)
        if stop == 0:
            return None
        side = 1.0 if stop == 1 else -1.0
        place, other = (now.stop_1, now.stop_2) if stop == 1 else (now.stop_2, now.stop_1)
        way = side * (place - at.y)
        room = side * (at.y - other) - p.gap_min
        if room < 0.0 or way < 0.0:
            return None
        speed = p.actuator_speed or inf
        issue = at.time - way / speed - p.actuator_delay
        if issue >= horizon:
            return None
        late = now.time - issue
        if late > 0.0:
            # The stop starts late, and m and the stop approach each other.
            late *= 1.0 if speed == inf else speed / (speed + abs(at.y_rate))
            if late > _LATEST * observer.half_cycle:
                return None
            issue = now.time
        beyond = min(room, _OVERREACH * observer.half_cycle * abs(at.y_rate))
        target = side * at.y - beyond
        if not p.independent:
            target = max(target, 0.5 * p.gap_min)
        self.closed = stop
        self.until = at.time + max(0.0, late)
        return Closing(issue, stop, side * target)

    def _reopens(self, now: Measurement, observer: Observer) -> bool:
        """Return whether the stop that was closed has done its work."""
        if self.closed == 0 or not observer.last:
            return False
        away = now.y_rate <= 0.0 if self.closed == 1 else now.y_rate >= 0.0
        overdue = now.time >= self.until + _GIVE_UP * observer.half_cycle
        return overdue or (away and now.time >= self.until - _OVERREACH * observer.half_cycle)
