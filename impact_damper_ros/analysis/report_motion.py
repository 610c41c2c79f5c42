"""Recorded motion between its samples, for plots of a coarse recording."""

from __future__ import annotations

import math

import numpy as np

from .cubic import cubic_rates
from .run_comparison import StretchComparison
from .run_curves import Array, MotionCurve

__all__ = ['filled_motion']

#: Samples in a cycle of the force from which on straight lines between them look smooth.
_FINE = 100
#: Into how many parts each interval is cut otherwise.
_PARTS = 3
#: Intervals so many times longer than usual are left as they are: something is missing there.
_LONGEST = 3.0


def _between(time: Array, place: Array, rate: Array) -> tuple[Array, Array]:
    """Return positions and velocities of the cubics between knots, at the parts."""
    step = np.diff(time)
    usual = float(np.median(step[step > 0.0]))
    smooth = (step > 0.0) & (step < _LONGEST * usual)
    share = np.where(smooth[:, None], np.arange(_PARTS) / _PARTS, 0.0)
    width = np.where(smooth, step, 1.0)
    b, a = cubic_rates(width, np.diff(place), rate[:-1], rate[1:])
    v_0, a, b, width = (v[:, None] for v in (rate[:-1], a, b, width))
    x = place[:-1, None] + width * share * (v_0 + share * (b / 2.0 + share * a / 3.0))
    return x, v_0 + share * (b + share * a)


def filled_motion(stretch: StretchComparison) -> MotionCurve | None:
    """
    Return the end of a stretch in detail, with cubics between samples that are far apart.

    Parameters
    ----------
    stretch : StretchComparison
        The stretch.

    Returns
    -------
    MotionCurve or None
        None if there is nothing to show.
    """
    motion = stretch.curves.motion
    if motion is None or len(motion.time) < 2 or not np.isfinite(motion.time).all():
        return None
    span = float(motion.time[-1] - motion.time[0])
    cycles = span * stretch.parameters.force_frequencies[0] / math.tau
    if span <= 0.0 or len(motion.time) > _FINE * cycles:
        return motion
    x, velocity = _between(motion.time, motion.x, motion.velocity)
    y, relative = _between(motion.time, motion.y, motion.relative_velocity)
    # A part of an interval that stays as it is comes to lie on its beginning.
    time, _ = _between(motion.time, motion.time, np.ones_like(motion.time))

    def joined(inner: Array, knots: Array) -> Array:
        return np.append(inner.ravel(), knots[-1])

    def spread(edge: Array) -> Array:
        return np.interp(joined(time, motion.time), motion.time, edge)

    return MotionCurve(
        joined(time, motion.time),
        joined(x, motion.x),
        joined(velocity, motion.velocity),
        joined(y, motion.y),
        joined(relative, motion.relative_velocity),
        spread(motion.stop_1),
        spread(motion.stop_2),
    )
