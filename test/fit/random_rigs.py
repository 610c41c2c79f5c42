"""Rigs on a bench with random parameters, and what sensors show of them."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters
from impact_damper_ros.fit.course import Course
from impact_damper_ros.fit.first_course import match_times
from impact_damper_ros.fit.gauss_newton import System
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.record import Record
from impact_damper_ros.fit.shooting import Shooting
from impact_damper_ros.fit.unknowns import Unknowns
from impact_damper_ros.parameters.base_motion import ORDERS

#: Standard deviation of a measured impact time, s.
DEVIATION = 5e-4
#: Longest record, s.
LONGEST = 60.0
COLUMN = {'displacement': 'x', 'velocity': 'primary_velocity'}


class Measurement(NamedTuple):
    """A record, the noise in it, and all events of the rig."""

    record: MeasuredMotion
    deviation: float
    events: np.ndarray


def random_rig(rng: np.random.Generator) -> RigParameters:
    """Return a rig near resonance whose gap is of the order of the optimal one."""
    mass, ratio = 2.0, rng.uniform(0.04, 0.1)
    stiffness = mass * (2.0 * math.pi * rng.uniform(4.0, 6.0)) ** 2
    zeta, restitution = rng.uniform(0.005, 0.03), rng.uniform(0.3, 0.75)
    friction, r, force = rng.uniform(0.0, 0.04), rng.uniform(0.93, 1.07), 1.2
    bounce = (1.0 + restitution) / (1.0 - restitution) / (1.0 + ratio)
    damped = zeta + 2.0 / math.pi * ratio * bounce
    amplitude = force / stiffness / math.hypot(1.0 - r * r, 2.0 * r * damped)
    return RigParameters(
        primary_mass=mass,
        stiffness=stiffness,
        damping=2.0 * zeta * math.sqrt(stiffness * mass),
        damper_mass=ratio * mass,
        restitution_1=restitution,
        restitution_2=restitution,
        friction=friction,
        gap=math.pi * amplitude * bounce * rng.uniform(0.35, 1.1),
        force_amplitudes=(force,),
        force_frequencies=(r * math.sqrt(stiffness / mass),),
        force_phases=(rng.uniform(0.0, 2.0 * math.pi),),
    )


def guess_of(rig: RigParameters, rng: np.random.Generator) -> RigParameters:
    """Return the start of a fit: K within 5 %, C within 60 %, of the rest nothing is taken."""
    return rig.replace(
        stiffness=rig.stiffness * rng.uniform(0.95, 1.05),
        damping=rig.damping * rng.uniform(0.6, 1.6),
        restitution_1=0.9,
        restitution_2=0.9,
        friction=0.3,
        gap=10.0 * rig.gap,
    )


def measure(
    rig: RigParameters,
    rng: np.random.Generator,
    *,
    impacts: int = 100,
    rate: float = 200.0,
    noise: float = 0.01,
    quantity: str = 'displacement',
    timed: bool = True,
    missing: float = 0.0,
    false: float = 0.0,
    cut: float = 0.0,
) -> Measurement:
    """Return a record over some impacts from a time on, with noise over the amplitude."""
    start = InitialConditions(initial_damper_velocity=float(rng.uniform(-0.3, 0.3)))
    hits = Rig(rig, start).run(LONGEST).impacts()['time']
    hits = hits[hits > cut]
    end = hits[min(impacts, len(hits) - 1)] + 0.05
    time = np.arange(int(cut * rate), int(end * rate)) / rate
    run = Rig(rig, start).run(time[-1], time)
    if quantity == 'acceleration':
        x, v = run.samples['x'], run.samples['primary_velocity']
        motion = _acceleration(rig, time, x, v, run.samples, run.events)
    else:
        motion = run.samples[COLUMN[quantity]].copy()
    deviation = noise * math.sqrt(2.0) * float(np.std(motion))
    motion = motion + rng.normal(0.0, deviation, len(time))
    times = None
    if timed:
        times = hits[hits < time[-1]]
        times = times + rng.normal(0.0, DEVIATION, len(times))
        wrong = rng.uniform(time[0], time[-1], round(false * len(times)))
        times = np.sort(np.concatenate([times[rng.uniform(size=len(times)) >= missing], wrong]))
    used = np.ones(len(time), bool)
    record = MeasuredMotion(
        time, motion, quantity, used, impact_times=times, impact_deviation=DEVIATION
    )
    return Measurement(record, deviation, run.events)


def _acceleration(rig, time, x, v, samples, events):
    """Return X'' of a rig that slides all the time but for its sticks."""
    force = sum(
        f * np.sin(w * time + p)
        for f, w, p in zip(
            rig.force_amplitudes, rig.force_frequencies, rig.force_phases, strict=True
        )
    )
    slides = np.sign(samples['damper_velocity'] - v)
    grip = rig.friction * rig.gravity * rig.damper_mass
    free = (force + slides * grip - rig.damping * v - rig.stiffness * x) / rig.primary_mass
    joint = (force - rig.damping * v - rig.stiffness * x) / (rig.primary_mass + rig.damper_mass)
    at = np.searchsorted(events['time'], time, side='right') - 1
    mode = np.where(at >= 0, events['mode'][np.maximum(at, 0)], 3)
    return np.where(mode >= 3, joint, free)


def true_course(unknowns: Unknowns, measurement: Measurement) -> tuple[Record, Course]:
    """Return the samples of a record, and the course of the motion as the events have it."""
    record, _, events = measurement
    rig = unknowns.rig
    hits = events[events['kind'] == EventKind.IMPACT]
    rests = events['time'][events['kind'] == EventKind.REST]
    alphas = unknowns.alpha(np.array([rig.restitution_1, rig.restitution_2]))
    grip = rig.friction * unknowns.normal
    shared = unknowns.start(rig.stiffness, rig.damping, alphas, grip, rig.gap)
    if (column := unknowns.column('slowness')) >= 0:
        shared[column] = rig.restitution_slowness
    spans = list(pairwise(hits['time'].tolist()))
    begins = np.array([True, *(((rests > low) & (rests < high)).any() for low, high in spans)])
    stop = np.where(hits['stop'] == 1, 1, -1)
    turns, after = [], []
    for (low, high), cut, side in zip(spans, begins[1:], stop, strict=False):
        inside = (events['time'] > low) & (events['time'] < high) & (not cut)
        turns.append(events['time'][inside])
        ways = [1]
        for k in np.flatnonzero(inside):
            slides = -side * np.sign(events['y'][k + 1] - events['y'][k])
            kind = events['kind'][k]
            ways.append({EventKind.STICK: 0, EventKind.REVERSAL: -ways[-1]}.get(kind, int(slides)))
        after.append(np.array(ways[1:], int))
    times = np.zeros(0) if record.impact_times is None else record.impact_times
    course = Course(
        shared,
        hits['time'].copy(),
        hits['x'].copy(),
        hits['primary_velocity_after'].copy(),
        hits['damper_velocity_after'].copy(),
        stop,
        begins,
        match_times(hits['time'], times, 6.0 * DEVIATION),
        turns,
        after,
    )
    weight = np.ones(len(record.time))
    return Record(record.time, record.motion, weight, ORDERS[record.quantity]), course


def bounds_of(rig: RigParameters, measurement: Measurement) -> dict[str, float]:
    """
    Return the Cramer-Rao bounds of the deviations of `true_values`.

    Those of an estimate that knows all impacts and reversals, and which of the measured times are
    whose; flights in which m rests on a stop count for nothing, as in the fit.
    """
    unknowns = Unknowns(rig, False, ())
    samples, course = true_course(unknowns, measurement)
    times = measurement.record.impact_times
    times = np.zeros(0) if times is None else times
    shooting = Shooting(samples, measurement.deviation, unknowns, course, times, DEVIATION)
    covariance = System(shooting.equations(shooting.start()), 1e-12).covariance(np.arange(5))
    scale = (1.0, 1.0, (1.0 + rig.restitution_1) / course.shared[2], 1.0 / rig.gravity, 1.0)
    return dict(
        zip(true_values(rig), (np.sqrt(np.diag(covariance)) * scale).tolist(), strict=True)
    )


def true_values(rig: RigParameters) -> dict[str, float]:
    """Return what a fit should find."""
    names = ('stiffness', 'damping', 'restitution_1', 'friction', 'gap')
    return {name: getattr(rig, name) for name in names}


def errors(fit, rig: RigParameters) -> dict[str, float]:
    """Return how far each estimate is off, in standard deviations."""
    return {
        name: (fit.parameters[name].value - value) / fit.parameters[name].standard_deviation
        for name, value in true_values(rig).items()
    }
