# SPDX-License-Identifier: Apache-2.0
"""
The timed law: an impact where X passes through zero, that is where |X'| is largest.

Between the impacts the stops are parked wide apart. For a passage of X through zero at which an
impact would take energy from M, one stop is closed to meet m at that instant, and is then
opened again; at most one such impact for each passage.

With symmetric stops, m has to be on the side of the stop that is closed, as in the reconstruction
of the law of Masri et al. (1989). With independent stops, an extension, a stop may pass the middle
to meet m, which matters as soon as weight, friction or a random force let the middle of the motion
of m drift. The approach speed must then be a good part of the speed of M, since each passage
allows one impact only.
"""

from __future__ import annotations

from math import inf, nan

from impact_damper_ros.motion.kernels import kernel

from .actuator import order_stops
from .law import best_gap, place_stops, symmetric_place
from .sensors import ZeroPassage, expected_passage
from .state import Control, ControlSettings, Estimates, Measurement, TimedLaw

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
#: While X moves away from zero, its next passage is further ahead than this, in half cycles.
_NOT_YET = 0.499
#: A stop is not parked anew by less than this part of its place: each start costs energy.
_PARKED_ENOUGH = 0.05
#: A stop is not parked where m will be within this part of a half cycle.
_CLEAR_OF_DAMPER = 0.05


@kernel
def stop_to_close(p: ControlSettings, at: ZeroPassage, parked: float, optimal: float) -> int:
    """
    Return which stop to close for a passage, 1 or 2, or 0 for none.

    Notes
    -----
    An impact of approach speed w changes the kinetic energy of M by (M/2)((X' - c w)^2 - X'^2) < 0
    if X' and Y' point in opposite directions and c |w| < 2 |X'|, c = mu (1 + R)/(1 + mu).
    """
    approach = abs(at.y_rate)
    speed = abs(at.x_rate)
    if at.x_rate * at.y_rate >= 0.0 or p.primary_jump * approach >= 2.0 * speed:
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


@kernel
def clear_timed_law(law: TimedLaw) -> None:
    """Put the state back to that at the start."""
    law.parked = 0.0
    law.aimed = False
    law.closed = 0
    law.until = 0.0


@kernel(inline=True)
def timed_law_sees(control: Control, seen: Measurement, next_sample: float) -> None:
    """Open the stop that has met m, or missed it, and close one for the passage ahead."""
    law: TimedLaw = control.timed_law
    p = control.settings
    if law.parked == 0.0:
        return
    if reopens(law, seen, control.estimates.half_cycle):
        stop = law.closed
        law.closed = 0
        park_stops(control, seen, stop == 1, stop == 2)
    if law.closed != 0 or law.aimed or (p.actuator_delay == 0.0 and p.speed == inf):
        return
    estimates: Estimates = control.estimates
    if estimates.x * estimates.x_rate > 0.0:
        # X moves away from zero: the passage is at least half a half cycle ahead.
        way = max(seen.stop_1, -seen.stop_2)
        if p.independent:
            way += _WANDER * 0.5 * best_gap(control)
        longest = way / p.speed + p.actuator_delay
        if _NOT_YET * estimates.half_cycle - longest >= next_sample - seen.time:
            return
    ahead = expected_passage(estimates)
    if ahead.time == ahead.time and close_stop(control, ahead, seen, next_sample):
        law.aimed = True


@kernel
def timed_law_crosses(control: Control, seen: Measurement) -> None:
    """Park the stops, and close one for this passage if that has not been done."""
    law: TimedLaw = control.timed_law
    aimed = law.aimed
    law.aimed = False
    law.parked = symmetric_place(control, control.settings.gap_control_park)
    if not aimed and law.closed == 0:
        here = ZeroPassage(seen.time, seen.x_rate, seen.y, seen.y_rate)
        close_stop(control, here, seen, inf)
    park_stops(control, seen, law.closed != 1, law.closed != 2)


@kernel
def park_stops(control: Control, seen: Measurement, first: bool, second: bool) -> None:
    """Send stops to where they are parked, unless m is or will be beyond that place."""
    parked = control.timed_law.parked
    clearance = _CLEAR_OF_DAMPER * control.estimates.half_cycle
    place_1 = nan
    place_2 = nan
    if first and seen.y + clearance * max(0.0, seen.y_rate) < parked:
        place_1 = parked
    if second and -seen.y + clearance * max(0.0, -seen.y_rate) < parked:
        place_2 = -parked
    place_stops(control, seen.time, place_1, place_2, _PARKED_ENOUGH)


@kernel
def close_stop(control: Control, at: ZeroPassage, seen: Measurement, before: float) -> bool:
    """Order a stop to meet m at a passage; return whether one is ordered before an instant."""
    law: TimedLaw = control.timed_law
    estimates: Estimates = control.estimates
    p = control.settings
    optimal = best_gap(control)
    stop = stop_to_close(p, at, law.parked, optimal)
    if stop == 0:
        return False
    side = 1.0 if stop == 1 else -1.0
    place = seen.stop_1 if stop == 1 else seen.stop_2
    other = seen.stop_2 if stop == 1 else seen.stop_1
    way = side * (place - at.y)
    room = side * (at.y - other) - p.gap_min
    if room < 0.0 or way < 0.0:
        return False
    issue = at.time - way / p.speed - p.actuator_delay
    if issue >= before:
        return False
    late = seen.time - issue
    if late > 0.0:
        # The stop starts late, and m and the stop approach each other.
        if p.speed < inf:
            late *= p.speed / (p.speed + abs(at.y_rate))
        if late > _LATEST * estimates.half_cycle:
            return False
        issue = seen.time
    beyond = min(room, _OVERREACH * estimates.half_cycle * abs(at.y_rate))
    target = side * at.y - beyond
    if not p.independent:
        target = max(target, 0.5 * p.gap_min)
    law.closed = stop
    law.until = at.time + max(0.0, late)
    if stop == 1:
        order_stops(control, issue, target, nan, nan)
    else:
        order_stops(control, issue, nan, -target, nan)
    return True


@kernel
def reopens(law: TimedLaw, seen: Measurement, half_cycle: float) -> bool:
    """Return whether the closed stop has met m, or has missed it."""
    if law.closed == 0:
        return False
    away = seen.y_rate <= 0.0 if law.closed == 1 else seen.y_rate >= 0.0
    overdue = seen.time >= law.until + _GIVE_UP * half_cycle
    return overdue or (away and seen.time >= law.until - _OVERREACH * half_cycle)
