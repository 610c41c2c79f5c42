"""The curves that the charts draw: motion between samples, and the prediction over any time."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.compare.measured_motion import cubic_rates
from impact_damper_ros.compare.result import Array, MotionCurve, PredictedCurve, StretchComparison

#: Samples in a cycle of the force from which on straight lines between them look smooth.
_FINE = 100
#: Into how many parts each interval is cut otherwise.
_PARTS = 3
#: Intervals longer than usual by this factor are not divided: samples are missing there.
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
    """Return the end of a stretch in detail, with cubics between samples that are far apart."""
    motion = stretch.curves.motion
    if motion is None or len(motion.time) < 2 or not np.isfinite(motion.time).all():
        return None
    span = float(motion.time[-1] - motion.time[0])
    cycles = span * stretch.parameters.force_frequencies[0] / math.tau
    if span <= 0.0 or len(motion.time) > _FINE * cycles:
        return motion
    x, velocity = _between(motion.time, motion.x, motion.velocity)
    y, relative = _between(motion.time, motion.y, motion.relative_velocity)
    # The parts of an interval that is not divided coincide with its beginning.
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


def _occurrences(curve: PredictedCurve, phase: float, start: float, end: float) -> Array:
    """Return the instants from `start` to `end` at which a phase of the motion comes."""
    period = curve.cycles * curve.cycle
    once = curve.force_zero + phase * curve.cycle
    if not (np.isfinite([once, start, end]).all() and period > 0.0):
        return np.empty(0)
    first, last = np.ceil((start - once) / period), np.floor((end - once) / period)
    return once + period * np.arange(first, last + 1.0)


def predicted_motion(
    curve: PredictedCurve, start: float, end: float
) -> tuple[Array, Array, Array]:
    """Return the predicted motion over a stretch of time."""
    if not len(curve.phase):
        return np.empty(0), np.empty(0), np.empty(0)
    period = curve.cycles * curve.cycle
    begins = _occurrences(curve, float(curve.phase[0]), start - period, end)
    within = (curve.phase - curve.phase[0]) * curve.cycle
    time = (begins[:, None] + within).ravel()
    inside = (time >= start) & (time <= end)
    x, y = (np.tile(values, len(begins))[inside] for values in (curve.x, curve.y))
    return time[inside], x, y


def predicted_impacts(stretch: StretchComparison, start: float, end: float) -> tuple[Array, Array]:
    """Return the predicted impacts from `start` to `end`, s."""
    orbit, curve = stretch.predicted, stretch.curves.predicted
    if orbit is None or curve is None:
        return np.empty(0), np.empty(0)
    half = 0.5 * orbit.parameters.gap
    instants = [_occurrences(curve, phase, start, end) for phase in orbit.phases]
    places = [
        np.full(len(row), x + (half if stop == 1 else -half))
        for row, stop, x in zip(instants, orbit.stops, orbit.x, strict=True)
    ]
    return np.concatenate([[], *instants]), np.concatenate([[], *places])


def predicted_lines(curve: PredictedCurve, highest: float) -> tuple[Array, Array]:
    """Return the lines of the spectrum of the predicted X."""
    period = curve.cycles * curve.cycle
    if not (len(curve.phase) > 2 and highest * period >= 1.0):
        return np.empty(0), np.empty(0)
    orders = np.arange(1, math.floor(highest * period) + 1)
    angle = math.tau * (curve.phase - curve.phase[0]) / curve.cycles
    signal = curve.x * np.exp(-1j * orders[:, None] * angle)
    lines = (0.5 * (signal[:, 1:] + signal[:, :-1]) * np.diff(angle)).sum(axis=1) / math.pi
    return orders / period, np.abs(lines)
