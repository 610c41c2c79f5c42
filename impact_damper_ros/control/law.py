# SPDX-License-Identifier: Apache-2.0
"""What all laws share: the damper as they know it, the search for m, and how stops are moved."""

from __future__ import annotations

from math import inf, nan

from impact_damper_ros.motion.kernels import kernel

from .actuator import order_stops
from .state import Control, Estimates, Measurement, Search, gap_for_amplitude

#: Half cycles without an impact on a stop before it is moved in.
_HALF_CYCLES_MISSED = 2
_PART_OF_REACH = 0.9


@kernel
def clear_search(search: Search) -> None:
    """Put the state back to that at the start."""
    search.missed_1 = 0
    search.missed_2 = 0
    search.reach_1 = 0.0
    search.reach_2 = 0.0


@kernel(inline=True)
def search_sample(search: Search, seen: Measurement) -> None:
    """Extend the reach of m by a sample."""
    search.reach_1 = max(search.reach_1, seen.y)
    search.reach_2 = max(search.reach_2, -seen.y)


@kernel
def search_missed(search: Search, estimates: Estimates) -> None:
    """Count half cycles without an impact, at the end of one."""
    hit_1 = estimates.hit_time_1 == estimates.hit_time_1
    hit_2 = estimates.hit_time_2 == estimates.hit_time_2
    search.missed_1 = 0 if hit_1 else search.missed_1 + 1
    search.missed_2 = 0 if hit_2 else search.missed_2 + 1


@kernel
def search_anew(search: Search, rising: bool) -> None:
    """Begin another half cycle, at its passage of X through zero."""
    # m meets stop 1 about where X falls through zero, and stop 2 about where it rises.
    if rising:
        search.reach_1 = 0.0
    else:
        search.reach_2 = 0.0


@kernel
def reach_limit(missed: int, reach: float) -> float:
    """Return how far out a stop may be for m to reach it, m."""
    return inf if missed <= _HALF_CYCLES_MISSED else _PART_OF_REACH * reach


@kernel
def best_gap(control: Control) -> float:
    """Return the optimal gap for the estimated amplitude, m."""
    p = control.settings
    return gap_for_amplitude(control.estimates.amplitude, p.mass_ratio, p.restitution, p.gap_max)


@kernel
def symmetric_place(control: Control, share: float) -> float:
    """Return the place of symmetric stops: half a share of the optimal gap, m."""
    p = control.settings
    search: Search = control.search
    half = 0.5 * min(max(share * best_gap(control), p.gap_min), p.gap_max)
    limit = max(
        reach_limit(search.missed_1, search.reach_1), reach_limit(search.missed_2, search.reach_2)
    )
    return max(min(half, limit), 0.5 * p.gap_min)


@kernel
def outside_dead_band(place: float, before: float, dead_band: float) -> float:
    """Return a place; NaN if it is within the dead band of the place before, or NaN itself."""
    return place if abs(place - before) > dead_band * abs(before) else nan


@kernel
def place_stops(
    control: Control, time: float, place_1: float, place_2: float, dead_band: float
) -> None:
    """Order stops to places; a stop within the dead band of its place, or with NaN, stays."""
    wanted_1 = outside_dead_band(place_1, control.actuators.commanded_1, dead_band)
    wanted_2 = outside_dead_band(place_2, control.actuators.commanded_2, dead_band)
    if wanted_1 == wanted_1 or wanted_2 == wanted_2:
        order_stops(control, time, wanted_1, wanted_2, nan)
