"""The arrays behind the plots of a comparison: motion, spectrum, and Xmax/A over the gap."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from impact_damper_ros.orbits import PeriodicOrbit, continue_orbit
from impact_damper_ros.orbits.event_map import follow_trajectory, origin_at
from impact_damper_ros.rig.flight import motion_at
from impact_damper_ros.rig.mode import rig_constants
from impact_damper_ros.rig.origin import offset_of

from .periodic_part import knots_between
from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates, RecordedStretch
from .run_comparison import ImpactStates, StretchComparison
from .run_curves import (
    Array,
    GapCurve,
    ImpactCurve,
    MotionCurve,
    PredictedCurve,
    Spectrum,
    StretchCurves,
)

__all__ = ['GapCurves', 'impact_curve', 'motion_curve', 'predicted_curve', 'spectrum']


_MOST_ROWS = 6000
_MOST_IMPACTS = 20_000
_PER_CYCLE = 250
_MOST_LINES = 4096
_MOST_SPECTRUM_STATES = 2**17
_HIGHEST_HARMONIC = 12.0


def motion_curve(stretch: RecordedStretch, start: float) -> MotionCurve | None:
    """Return the motion from an instant on, or as much of its end as may be shown."""
    knots = knots_between(stretch, start, stretch.end)[-_MOST_ROWS:]
    if not len(knots):
        return None
    twice = np.repeat(np.arange(len(knots)), np.where(knots.stop > 0.0, 2, 1))
    first = np.append(twice[1:] == twice[:-1], False)
    velocity = np.where(first, knots.velocity_before[twice], knots.velocity[twice])
    damper = np.where(first, knots.damper_velocity_before[twice], knots.damper_velocity[twice])
    time = knots.time[twice]
    states = stretch.states
    at = np.clip(np.searchsorted(states.time, time, side='right') - 1, 0, None)
    nothing = np.full(len(time), np.nan)
    stop_1 = (states.stop_1 - states.x)[at] if len(states) else nothing
    stop_2 = (states.stop_2 - states.x)[at] if len(states) else nothing
    return MotionCurve(
        time=time,
        x=knots.x[twice],
        velocity=velocity,
        y=(knots.z - knots.x)[twice],
        relative_velocity=damper - velocity,
        stop_1=stop_1,
        stop_2=nothing if stretch.parameters.one_sided else stop_2,
    )


def impact_curve(stretch: RecordedStretch, impacts: RecordedImpacts) -> ImpactCurve | None:
    """Return the latest impacts."""
    impacts = impacts[-_MOST_IMPACTS:]
    if not len(impacts):
        return None
    rig, clock = stretch.parameters, stretch.clock
    phase = np.full(len(impacts), np.nan)
    if clock is not None and clock.frequency > 0.0:
        phase = clock.phase(impacts.time) % 1.0
    return ImpactCurve(
        time=impacts.time,
        phase=phase,
        stop=impacts.stop.astype(np.int64),
        x=impacts.x,
        primary_velocity_before=impacts.velocity_before(rig),
        primary_velocity_after=impacts.velocity_after,
        damper_velocity_before=impacts.damper_velocity_before(rig),
        damper_velocity_after=impacts.damper_velocity_after,
        impulse=np.abs(impacts.primary_impulse),
    )


def predicted_curve(
    clock: ForceClock, orbit: PeriodicOrbit, period: ImpactStates | None, time: float
) -> PredictedCurve | None:
    """Return one period of a predicted motion."""
    if not orbit.viable or not orbit.impacts:
        return None
    rig = clock.counted_from_zero()
    machine = rig_constants(rig)
    # The zero of the force before the measured period, from which both count their phases
    first = period.phases[0] if period is not None else float(clock.phase(np.array(time)) % 1.0)
    late = round(orbit.phases[0] - first) if period is not None else 0
    zero = time - (first + late) * clock.cycle
    stop = orbit.stops[0]
    origin = origin_at(
        machine,
        zero + orbit.phases[0] * clock.cycle - clock.zero,
        orbit.x[0],
        orbit.primary_velocity_after[0],
        0.0 if stop == 1 else -2.0 * machine.stop,
        orbit.damper_velocity_after[0] - orbit.primary_velocity_after[0],
        0,
        stop,
    )
    course = follow_trajectory(machine, origin, orbit.period, differentiate=False)
    if course is None:
        return None
    rows = []
    for part in course.flights:
        start = part.origin
        y = offset_of(start.clearance_1, start.clearance_2, start.stop_1, start.stop_2)
        count = max(2, math.ceil(_PER_CYCLE * part.duration / clock.cycle))
        for tau in np.linspace(0.0, part.duration, count):
            motion = motion_at(part.flight, float(tau))
            phase = orbit.phases[0] + (part.start + float(tau)) / clock.cycle
            # M and m move as one in a joint flight.
            moves = not part.flight.joint
            travel = motion.travel if moves else 0.0
            relative = motion.relative_velocity if moves else 0.0
            rows.append((phase, motion.x, motion.velocity, y + travel, relative))
    # After the impact that ends the period all is as after the one that began it.
    rows.append((max(rows[-1][0], orbit.phases[0] + orbit.cycles), *rows[0][1:]))
    phase, x, velocity, place, relative_velocity = np.array(rows).T
    return PredictedCurve(
        phase=phase,
        x=x,
        velocity=velocity,
        y=place,
        relative_velocity=relative_velocity,
        force_zero=zero,
        cycle=clock.cycle,
        cycles=orbit.cycles,
    )


def spectrum(states: RecordedStates, force_frequency: float) -> Spectrum | None:
    """Return the amplitude spectrum of X, of the end of some joint states."""
    steps = np.diff(states.time)
    if len(steps) < 16:
        return None
    step = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - step) > 1e-3 * step)
    begin = int(uneven[-1]) + 1 if len(uneven) else 0
    highest = 0.5 / step
    if force_frequency > 0.0:
        highest = min(highest, _HIGHEST_HARMONIC * force_frequency)
    most = min(_MOST_SPECTRUM_STATES, int(_MOST_LINES / (highest * step)))
    x = states.x[begin:][-most:]
    if len(x) < 16:
        return None
    window = np.hanning(len(x) + 1)[:-1]
    amplitude: Array = np.abs(np.fft.rfft((x - x.mean()) * window)) * (2.0 / window.sum())
    frequency: Array = np.arange(len(amplitude)) / (len(x) * step)
    shown = frequency <= highest
    return Spectrum(
        frequency=frequency[shown][:_MOST_LINES],
        amplitude=amplitude[shown][:_MOST_LINES],
        force_frequency=force_frequency,
        resolution=float(frequency[1]),
        window='Hann',
    )


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
