"""The phase of the force from the motion itself, where the bag does not tell it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .fault_search import FaultSearch
from .flight_check import check_intervals, knots_of
from .periodic_part import knots_between
from .recorded_stretch import ForceClock, RecordedStretch

__all__ = ['with_fitted_clock']


_MOST_KNOTS = 4000
#: Share of the residual without a force that the fitted one may leave.
_LEFT = 1e-3


def with_fitted_clock(
    stretch: RecordedStretch,
) -> tuple[RecordedStretch, FaultSearch | None]:
    """
    Return a stretch with the phase of its force found from the joint states.

    Between two joint states the force adds to X and X' what is linear in the sine and the cosine
    of its phase; both are found by least squares.

    Parameters
    ----------
    stretch : RecordedStretch
        A stretch whose clock is not known.

    Returns
    -------
    stretch : RecordedStretch
        With its clock, if the force is one harmonic and the motion is driven by it.
    search : FaultSearch or None
        The check of its flights.
    """
    rig, states = stretch.parameters, stretch.states[:_MOST_KNOTS]
    amplitude = rig.force_amplitudes[0]
    if len(states) < 4 or not rig.periodic_force:
        return stretch, None
    impacts = stretch.impacts
    within = (impacts.time >= states.time[0]) & (impacts.time <= states.time[-1])
    knots = knots_of(rig, states, impacts[within], stretch.stop_before(float(states.time[0])))
    start = float(states.time[0])

    def residuals(force: float, angle: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        trial = ForceClock(
            rig.replace(force_amplitudes=(force, *rig.force_amplitudes[1:])),
            start,
            (angle,) * len(rig.force_phases),
        )
        found = check_intervals(trial, knots)
        scaled = found.residuals[:, :2] / np.array([1.0, rig.omega])
        return np.asarray(scaled[found.plain].ravel())

    offset = -rig.force_phases[0]
    free = residuals(0.0, 0.0)
    parts = [free - residuals(amplitude, offset + turn) for turn in (0.0, math.pi / 2.0)]
    (sine, cosine), *_ = np.linalg.lstsq(np.column_stack(parts), free, rcond=None)
    if not math.isclose(math.hypot(sine, cosine), 1.0, rel_tol=0.5):
        return stretch, None
    angle = math.atan2(cosine, sine)
    left = residuals(amplitude, offset + angle)
    if not float(np.linalg.norm(left)) < _LEFT * float(np.linalg.norm(free)):
        return stretch, None
    clock = ForceClock(rig, start, (offset + angle,) * len(rig.force_phases))
    moved = stretch.control.get('gap_control', 'off') != 'off'
    search = FaultSearch(clock, in_closed_form=moved)
    search.look(knots_between(stretch, stretch.start, stretch.end), final=True)
    return replace(stretch, clock=clock), search
