# SPDX-License-Identifier: Apache-2.0
"""A first course of the motion from the data alone: impacts, K and C, then the parameters of m."""

from __future__ import annotations

from itertools import product
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .course import Course
from .first_guess import regress
from .impact_search import ImpactSearch, Jumps
from .record import Record
from .unknowns import Unknowns, later
from .vibration import Array, Vibration

#: Numbers of phases of the force, and stiffnesses over that of the start, that are tried.
_PHASES, _STIFFNESSES = 16, (0.96, 0.98, 1.0, 1.02, 1.04)
#: Samples in a natural period of the thinned record with which phases and units are tried, and
#: means in that with which K and C are.
SAMPLES, _MEANS = 20, 40
#: Stiffnesses and dampings, over those of the start, that are tried where the phase is known.
GRID = np.linspace(0.95, 1.05, 11), np.array([0.65, 1.0, 1.6])
#: Least first guess of the gap, in the swing of M at impacts.
_LEAST_GAP = 1e-2
#: Least number of impacts for a fit, and least number of flights from stop to stop.
LEAST_IMPACTS, _LEAST_TRANSITS = 6, 4
#: Remedy for other causes where a fit fails.
WRONG_RIG = (
    'check that the damper was in the rig, and that masses, angle and force are right '
    '(--also force_delay finds the phase of the force)'
)


class UnfitRecordError(Exception):
    """A record to which no rig can be fitted; the text has the reason and the remedy."""


def check_impacts(count: int) -> None:
    """Raise `UnfitRecordError` if there are too few impacts."""
    if count < LEAST_IMPACTS:
        raise UnfitRecordError(
            f'the record has {plural(count, "impact")}, and a fit needs {LEAST_IMPACTS}: '
            'record a motion in which the damper hits its stops, for longer; a record without the '
            'damper is one for --structure'
        )


def match_times(times: Array, measured: Array, limit: float) -> NDArray[np.int64]:
    """Match measured times to instants, one to one; return their indices, -1 for none."""
    found = np.full(len(times), -1)
    if not len(measured) or not len(times):
        return found
    apart = np.abs(measured[None, :] - times[:, None])
    nearest = apart.argmin(1)
    back = apart.argmin(0)
    both = (back[nearest] == np.arange(len(times))) & (apart.min(1) < limit)
    found[both] = nearest[both]
    return found


def thin_out(record: Record, rig: RigParameters, samples: int) -> Record:
    """Return the record with about that many samples in a natural period, or with all."""
    step = 2.0 * np.pi / rig.omega / samples / float(np.median(np.diff(record.time)))
    part = slice(None, None, max(1, round(step)))
    return Record(record.time[part], record.motion[part], record.weight[part], record.order)


def average(record: Record, rig: RigParameters, deviation: float) -> tuple[Record, float]:
    """Return the record with means of neighbouring samples, if it has many, and its noise."""
    step = 2.0 * np.pi / rig.omega / _MEANS / float(np.median(np.diff(record.time)))
    size = max(1, int(step))
    whole = len(record.time) // size * size
    time, motion, weight = (part[:whole].reshape(-1, size) for part in record[:3])
    means = Record(time.mean(1), motion.mean(1), weight.min(1), record.order)
    return means, deviation / np.sqrt(size)


def guess_of(rig: RigParameters) -> tuple[float, float]:
    """Return K and C of a rig as a guess, which is not without damping."""
    return rig.stiffness, max(rig.damping, 1e-6 * rig.stiffness / rig.omega)


def _delay(record: Record, rig: RigParameters, deviation: float) -> tuple[float, float]:
    """
    Return the delay of the force, and the stiffness, by trial.

    With the right phase the motion has the fewest free vibrations. Near resonance an error of the
    stiffness shifts the phase of the response, too.
    """
    period = 2.0 * np.pi / max(rig.first_harmonic[1], 1e-3 * rig.omega)
    damping = guess_of(rig)[1]
    fewer = thin_out(record, rig, SAMPLES)

    def cost(tried: tuple[float, float]) -> float:
        delay, stiffness = tried
        vibration = Vibration.of(rig, stiffness, damping, delay)
        return ImpactSearch(fewer, rig, deviation).find(vibration)

    parts = np.arange(_PHASES) / _PHASES
    delays = period * np.where(parts > 0.5, parts - 1.0, parts)
    return min(
        ((float(delay), rig.stiffness * factor) for delay in delays for factor in _STIFFNESSES),
        key=cost,
    )


def clock_offset_of(record: Record, rig: RigParameters) -> float:
    """Return the mean over whole periods of the force: nearly the offset of the sensor."""
    period = 2.0 * np.pi / max(rig.first_harmonic[1], 1e-3 * rig.omega)
    whole = np.floor((record.time[-1] - record.time[0]) / period) * period
    last = (record.time >= record.time[-1] - whole) & (record.weight > 0.0)
    return float(record.motion[last].mean()) if last.any() else 0.0


def first_course(
    record: Record,
    unknowns: Unknowns,
    deviation: float,
    measured: Array,
    impact_deviation: float,
) -> Course:
    """
    Return the course by a search for impacts and regression, from the K and C of the rig.

    Of many K and C those are taken with which the record is explained best by few impacts between
    which the laws of m hold: with another frequency fewer impacts may explain it, but none of
    their laws hold.

    Raises
    ------
    UnfitRecordError
        If there are too few impacts, or flights from stop to stop.
    """
    rig = unknowns.rig
    bias = unknowns.column('bias')
    offset = clock_offset_of(record, rig) if bias >= 0 else 0.0
    record = record._replace(motion=record.motion - offset)
    stiffness, damping = guess_of(rig)
    late, force_delay = 0.0, unknowns.column('force_delay')
    if force_delay >= 0:
        late, stiffness = _delay(record, rig, deviation)
        rig = later(rig, late)

    def search(one: Record, noise: float) -> ImpactSearch:
        return ImpactSearch(one, rig, noise, measured, impact_deviation)

    fewer, noise = average(record, rig, deviation)
    rough = search(fewer, noise)
    tried = []
    for by_stiffness, by_damping in product(*GRID):
        vibration = Vibration.of(rig, stiffness * by_stiffness, damping * by_damping)
        rough.find(vibration, merge=True)
        jumps = rough.jumps(vibration)
        stops = _stops_of(jumps)
        saved = 0.0
        if _transits(stops) >= _LEAST_TRANSITS:
            saved = regress(unknowns, jumps, stops, np.sqrt(vibration.stiffness)).saved
        tried.append((rough.cost - saved, vibration))
    vibration = min(tried, key=itemgetter(0))[1]
    fine = search(record, deviation)
    fine.find(vibration, merge=True)
    jumps = fine.jumps(vibration)
    check_impacts(len(jumps.time))
    stops = _stops_of(jumps)
    if (transits := _transits(stops)) < _LEAST_TRANSITS:
        raise UnfitRecordError(
            f'{transits} flights from one stop to the other were found in the record, and the gap '
            f'needs {_LEAST_TRANSITS} at least: shake harder, or record for longer'
        )
    alphas, grip, gap, _ = regress(unknowns, jumps, stops, np.sqrt(vibration.stiffness))
    gap = max(gap, _LEAST_GAP * float(np.ptp(jumps.x)))
    mass = rig.primary_mass
    known = vibration.stiffness * mass, 2.0 * vibration.decay * mass
    shared = unknowns.start(*known, alphas, grip, gap)
    if bias >= 0:
        shared[bias] = offset
    if force_delay >= 0:
        shared[force_delay] = late
    ratio = rig.primary_mass / rig.damper_mass
    alpha = np.where(stops == 1, alphas[0], alphas[1])
    begins = np.zeros(len(stops), bool)
    begins[0] = True
    return Course(
        shared,
        jumps.time,
        jumps.x,
        jumps.velocity + jumps.jump,
        jumps.velocity + (alpha - ratio) * jumps.jump,
        stops,
        begins,
        match_times(jumps.time, measured, max(6.0 * impact_deviation, 1e-9)),
    )


def _stops_of(jumps: Jumps) -> NDArray[np.int64]:
    """Return the stop of each impact, +1 or -1."""
    return np.where(jumps.jump >= 0.0, 1, -1)


def _transits(stops: NDArray[np.int64]) -> int:
    """Return the number of flights from one stop to the other."""
    return int((np.diff(stops) != 0).sum())
