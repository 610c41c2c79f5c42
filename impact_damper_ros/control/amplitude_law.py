# SPDX-License-Identifier: Apache-2.0
"""
The amplitude law: at each passage of X through zero, places for both stops.

Symmetric stops reconstruct the law of Masri, Miller, Dehghanyar and Caughey (1989), in which the
amplitude of the primary mass sets the gap: d = kappa d*(A).

Independent stops are an extension. The place of each stop grows and shrinks with the amplitude and
is corrected by the instant at which m hit it: after an early impact the stop is moved out by what
m covers in that time, after a late one it is moved in. The two flights may then differ, as weight
and friction make them, and neither R nor mu has to be known.
"""

from __future__ import annotations

from math import nan

from impact_damper_ros.motion.kernels import kernel

from .law import place_stops, reach_limit, symmetric_place
from .state import AmplitudeLaw, Control, Estimates, Measurement, Search

#: A stop is not moved by less than this part of its place: each start costs energy.
_SMALLEST_MOVE = 0.005


@kernel
def clear_amplitude_law(law: AmplitudeLaw) -> None:
    """Put the state back to that at the start."""
    law.place_1 = nan
    law.place_2 = nan
    law.amplitude = 0.0


@kernel
def amplitude_law_crosses(control: Control, seen: Measurement) -> None:
    """Move both stops to their places, at a passage of X through zero."""
    law: AmplitudeLaw = control.amplitude_law
    if control.settings.independent:
        correct_places(control, seen)
        place_stops(control, seen.time, law.place_1, -law.place_2, _SMALLEST_MOVE)
    else:
        place = symmetric_place(control, control.settings.gap_control_gain)
        place_stops(control, seen.time, place, -place, _SMALLEST_MOVE)


@kernel
def correct_places(control: Control, seen: Measurement) -> None:
    """Correct the distances of both stops from the middle."""
    law: AmplitudeLaw = control.amplitude_law
    estimates: Estimates = control.estimates
    search: Search = control.search
    if law.place_1 != law.place_1:
        law.place_1 = seen.stop_1
        law.place_2 = -seen.stop_2
    growth = estimates.amplitude / law.amplitude if law.amplitude > 0.0 else 1.0
    law.amplitude = estimates.amplitude
    limit_1 = reach_limit(search.missed_1, search.reach_1)
    limit_2 = reach_limit(search.missed_2, search.reach_2)
    early_1 = seen.time - estimates.hit_time_1
    early_2 = seen.time - estimates.hit_time_2
    law.place_1 = corrected_place(
        control, law.place_1, growth, early_1, estimates.hit_speed_1, limit_1
    )
    law.place_2 = corrected_place(
        control, law.place_2, growth, early_2, estimates.hit_speed_2, limit_2
    )


@kernel
def corrected_place(
    control: Control, place: float, growth: float, early: float, speed: float, limit: float
) -> float:
    """Return the new place of a stop: `early` is NaN if m has not hit it; `speed` is that of m."""
    p = control.settings
    half_cycle = control.estimates.half_cycle
    if early == early:
        if early > 0.5 * half_cycle:
            # The impact belongs to the passage before this one.
            early -= half_cycle
        early -= p.gap_control_lead * half_cycle
        place += p.gap_control_timing_gain * speed * early
    place = min(growth * place, limit)
    return min(max(place, 0.5 * p.gap_min), 0.5 * p.gap_max)
