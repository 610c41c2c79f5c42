"""The arrays behind the plots of a stretch, each from what was recorded or predicted."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.orbits import PeriodicOrbit
from impact_damper_ros.orbits.event_map import origin_at, run_course
from impact_damper_ros.rig.flight import motion_at
from impact_damper_ros.rig.mode import make_machine
from impact_damper_ros.rig.origin import offset_of

from .force_clock import ForceClock
from .recorded_stretch import RecordedImpacts, RecordedStates, RecordedStretch
from .run_curves import (
    Array,
    ImpactCurve,
    MotionCurve,
    PredictedCurve,
    Spectrum,
)
from .steady_part import knots_between
from .stretch_measures import ImpactStates

__all__ = ['impact_curve', 'motion_curve', 'predicted_curve', 'spectrum']

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
    """
    Return one period of a predicted motion.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    orbit : PeriodicOrbit
        The motion; counted as the measured one, if there is one.
    period : ImpactStates or None
        The measured period.
    time : float
        Instant of its first impact, rig time, s; any instant without it.

    Returns
    -------
    PredictedCurve or None
        None if the rig cannot move so.
    """
    if not orbit.viable or not orbit.impacts:
        return None
    rig = clock.counted_from_zero()
    machine = make_machine(rig)
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
    course = run_course(machine, origin, orbit.period, differentiate=False)
    if course is None:
        return None
    rows = []
    for part in course.stretches:
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
    """
    Return the amplitude spectrum of X, of the end of some joint states.

    Parameters
    ----------
    states : RecordedStates
        Joint states in a row.
    force_frequency : float
        Of the first harmonic, Hz; 0 without a force.
    """
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
