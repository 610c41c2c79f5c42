"""Xmax/A against the gap, once for all stretches of a run that share a curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impact_damper_ros.orbits import PeriodicOrbit, continue_orbit

from .run_comparison import StretchComparison
from .run_curves import GapCurve, StretchCurves

__all__ = ['GapCurves']

_GAP_RANGE = 3.0
_GAP_POINTS = 150
#: How near a curve a predicted motion is on it, in Xmax/A.
_ON_CURVE = 1e-3


class GapCurves:
    """Follows predicted motions in the gap, and remembers them."""

    def __init__(self) -> None:
        self._known: list[tuple[PeriodicOrbit, GapCurve]] = []

    def added(self, stretch: StretchComparison) -> StretchCurves:
        """Return the curves of a stretch with that against the gap, if there is one."""
        orbit = stretch.predicted
        if orbit is None or orbit.parameters.one_sided or stretch.measured is None:
            return stretch.curves
        ratio = stretch.measured.amplitude_ratio
        curve = self._found(orbit)
        if curve is None:
            curve = _followed(orbit)
            if curve is None:
                return stretch.curves
            self._known.append((orbit, curve))
        marked = replace(curve, measured_gap=orbit.parameters.gap, measured_ratio=ratio)
        return replace(stretch.curves, gap_curve=marked)

    def _found(self, orbit: PeriodicOrbit) -> GapCurve | None:
        """Return a curve that a motion is on."""
        rig = orbit.parameters
        for other, curve in self._known:
            same = other.parameters == rig.replace(gap=other.parameters.gap)
            if not same or other.cycles != orbit.cycles or len(other.stops) != len(orbit.stops):
                continue
            scaled = (curve.gap / rig.gap - 1.0, curve.ratio - orbit.amplitude_ratio)
            ends = np.hypot(*scaled)
            near = int(ends.argmin())
            here = slice(max(near - 1, 0), near + 2)
            gaps, ratios = curve.gap[here], curve.ratio[here]
            order = np.argsort(gaps)
            between = float(np.interp(rig.gap, gaps[order], ratios[order]))
            inside = gaps.min() <= rig.gap <= gaps.max()
            if inside and abs(between - orbit.amplitude_ratio) < _ON_CURVE:
                return curve
        return None


def _followed(orbit: PeriodicOrbit) -> GapCurve | None:
    """Follow a motion in the gap; None if that cannot be done."""
    gap = orbit.parameters.gap
    low, high = gap / _GAP_RANGE, gap * _GAP_RANGE
    try:
        down, up = (
            continue_orbit(orbit, 'gap', low, high, upwards=upwards, most_points=_GAP_POINTS)
            for upwards in (False, True)
        )
    except (ValueError, ArithmeticError):
        return None
    orbits = [*down.orbits[::-1], *up.orbits[1 if down.orbits else 0 :]]
    if len(orbits) < 2:
        return None
    special = [*down.special[::-1], *up.special]
    return GapCurve(
        gap=np.array([o.parameters.gap for o in orbits]),
        ratio=np.array([o.amplitude_ratio for o in orbits]),
        stable=np.array([o.stable for o in orbits]),
        viable=np.array([o.viable for o in orbits]),
        special_gap=np.array([s.value for s in special]),
        special_ratio=np.array([s.orbit.amplitude_ratio for s in special]),
        special_kind=tuple(s.kind.value for s in special),
        measured_gap=gap,
        measured_ratio=orbit.amplitude_ratio,
        stops=orbit.stops,
        ended=up.ended,
    )
