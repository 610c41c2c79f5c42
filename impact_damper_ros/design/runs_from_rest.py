# SPDX-License-Identifier: Apache-2.0
"""
Largest |X| of many rigs from rest, which differ in gap, level, frequency, uncertain parameters.

The rigs of an ensemble share their excitation. A rig at another level or frequency moves as one at
the common level and frequency, in other units: with a cycle as the unit of time and the amplitude
of the base, or that of the force over M and the square of its frequency, as that of length.
Another level is another gap, gravity and air force; another frequency another stiffness and
damping.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from math import copysign, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from impact_damper_ros.motion.kernels import call_kernel, kernel
from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.ensemble import run_ensemble
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Outcome

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
#: Values of each rig by name: numbers of `RigParameters`, `level` as a factor, and `frequency` of
#: the excitation, rad/s.
Cases = Mapping[str, npt.ArrayLike]

#: Time constants of M in which a start decays; least and most cycles for that.
_TIME_CONSTANTS, _LEAST_CYCLES, _MOST_CYCLES = 8.0, 150, 1500
#: Cycles in which irregular impacts with R = 0 would come to repeat; 1/(1 - R) times as many.
_IMPACT_CYCLES = 45.0
#: Cycles that are measured after settling, and samples in each: for all motions, and for those
#: that do not repeat.
_MEASURED, _SAMPLES, _MEASURED_IRREGULAR, _FEWER_SAMPLES = 30, 16, 500, 6
#: Longest period of a motion that repeats, in cycles, and accuracy to which its largest |X|
#: repeats.
_LONGEST_PERIOD, _REPEATS = 6, 1e-3
#: A gap that M does not swing across, over its amplitude.
_OPEN = 20.0


def at_level(rig: RigParameters, factor: float) -> RigParameters:
    """Return a rig whose force or base is stronger by a factor."""
    name = f'{rig.swept}_amplitudes'
    return rig.replace(**{name: tuple(factor * a for a in getattr(rig, name))})


def settling_cycles(rig: RigParameters) -> int:
    """Return the cycles in which a start decays, by the damping of M and by impacts."""
    cycle = math.tau / rig.first_harmonic[1]
    lost = 1.0 - 0.5 * (rig.restitution_1 + rig.restitution_2)
    lasting = max(
        _TIME_CONSTANTS / (rig.zeta * rig.omega * cycle) if rig.zeta else math.inf,
        _IMPACT_CYCLES / lost if lost else math.inf,
    )
    return max(_LEAST_CYCLES, math.ceil(min(lasting, _MOST_CYCLES)))


def widest_hit(rig: RigParameters, level: float = 1.0) -> float:
    """
    Return the widest gap with which m of a rig from rest is hit at some level, m.

    Off resonance M swings farther at first than later on. On an incline, along which m slides to a
    stop by itself, it is the gap across which M alone swings.
    """
    alone = at_level(rig, level).replace(gap=_OPEN * rig.response_amplitude)
    if rig.gravity * math.sin(rig.angle):
        alone = alone.replace(angle=0.0, friction=0.0)
    cycles = settling_cycles(rig)
    end = cycles * math.tau / rig.first_harmonic[1]
    samples = Rig(alone, compiled=None).run(end, np.linspace(0.0, end, 128 * cycles)).samples
    return 2.0 * float(np.abs(samples['z'] - samples['x']).max())


def _column(rig: RigParameters, cases: Cases, name: str) -> Array:
    return np.asarray(cases.get(name, getattr(rig, name, 1.0)), dtype=float)


def _similar(rig: RigParameters, cases: Cases) -> tuple[dict[str, npt.ArrayLike], Array]:
    """Return values of a similar ensemble, and the factors of length of the rigs to it."""
    ratio = np.asarray(cases.get('frequency', 1.0), dtype=float)
    if 'frequency' in cases:
        ratio = ratio / rig.first_harmonic[1]
    power = 2 if rig.swept == 'force' else ORDERS[rig.base_quantity]
    level = _column(rig, cases, 'level')
    lengths, weights = level / ratio**power, level * ratio ** (2 - power)
    scales = {
        'gap': lengths,
        'gravity': weights,
        'air_force': weights,
        'restitution_speed': lengths * ratio,
        'stiffness': ratio**2,
        'damping': ratio,
    }
    values = {name: column for name, column in cases.items() if name not in ('level', 'frequency')}
    values |= {name: _column(rig, cases, name) / scale for name, scale in scales.items()}
    count = max(np.size(column) for column in values.values())
    return {n: np.broadcast_to(v, count) for n, v in values.items()}, lengths


def bare_amplitudes(rig: RigParameters, cases: Cases) -> Array:
    """Return the amplitude of X of each rig without its damper, m."""
    values, lengths = _similar(rig, cases)
    rate = rig.first_harmonic[1]
    spring = np.asarray(values['stiffness']) + 1j * rate * np.asarray(values['damping'])
    line = abs(rig.first_line[0])
    force = line * np.abs(spring) if rig.swept == 'base' else line
    amplitudes: Array = lengths * force / np.abs(spring - rig.primary_mass * rate**2)
    return amplitudes


@kernel
def write_largest_in_cycles(samples: Any, sizes: Any) -> None:
    """Write the largest |X| of each rig in each of some cycles, from X and X' of samples."""
    times, places, velocities = samples['time'], samples['x'], samples['primary_velocity']
    in_cycle = (times.shape[1] - 1) // sizes.shape[1]
    for rig in range(len(sizes)):
        for k in range(times.shape[1] - 1):
            before, after = places[rig, k], places[rig, k + 1]
            largest = max(abs(before), abs(after))
            v, w = velocities[rig, k], velocities[rig, k + 1]
            if v * w < 0.0:
                # X between the samples is a cubic
                span = times[rig, k + 1] - times[rig, k]
                first, last = span * v, span * w
                a = 2.0 * (before - after) + first + last
                b = 3.0 * (after - before) - 2.0 * first - last
                root = sqrt(max(b * b - 3.0 * a * first, 0.0))
                share = min(max(first / (copysign(root, first) - b), 0.0), 1.0)
                largest = max(largest, abs(before + share * (first + share * (b + share * a))))
            cycle = k // in_cycle
            sizes[rig, cycle] = largest if k % in_cycle == 0 else max(sizes[rig, cycle], largest)


def _sizes(samples: npt.NDArray[np.void], cycles: int) -> Array:
    """Return the largest |X| in each of some cycles, from X and X' of samples."""
    sizes = np.empty((len(samples), cycles))
    call_kernel(write_largest_in_cycles, samples, sizes, what='simulator')
    return sizes


def _in_cycles(rig: RigParameters, cases: Cases, cycles: int, samples: int) -> Array:
    """Return the largest |X| in each of some cycles after settling, m; infinite if not reached."""
    values, lengths = _similar(rig, cases)
    cycle, first = math.tau / rig.first_harmonic[1], settling_cycles(rig)
    instants = (first + np.arange(cycles * samples + 1) / samples) * cycle
    largest = partial(_sizes, cycles=cycles)
    result = run_ensemble(rig, values, float(instants[-1]), instants, reduce=largest)
    sizes: Array = result.samples
    sizes[result.outcomes != Outcome.COMPLETE] = math.inf
    return np.broadcast_to(lengths, len(sizes))[:, None] * sizes


def largest_in_short(rig: RigParameters, cases: Cases) -> tuple[Array, Flags]:
    """Return the largest |X| in 30 cycles after settling, m, and whether each motion repeats."""
    sizes = _in_cycles(rig, cases, _MEASURED, _SAMPLES)
    largest: Array = sizes.max(axis=1)
    repeats = np.zeros(len(sizes), bool)
    for period in range(1, _LONGEST_PERIOD + 1):
        changes = np.abs(sizes[:, period:] - sizes[:, :-period]).max(axis=1)
        repeats |= changes <= _REPEATS * largest
    return largest, repeats


def largest_in_long(rig: RigParameters, cases: Cases) -> Array:
    """Return the largest |X| in 500 cycles after settling, m: that of irregular motions."""
    largest: Array = _in_cycles(rig, cases, _MEASURED_IRREGULAR, _FEWER_SAMPLES).max(axis=1)
    return largest


def largest_from_rest(
    rig: RigParameters, cases: Cases, most: Callable[[Array, Flags], float] | None = None
) -> Array:
    """
    Return the largest |X| of rigs some time after they were started from rest, m.

    The largest |X| is that in 30 cycles or, where the motion does not repeat, in 500.

    Parameters
    ----------
    rig : RigParameters
        The common parameters of the rigs.
    cases : mapping of str to array_like of float, shape (n,)
        The values in which the rigs differ, see `Cases`.
    most : callable, optional
        Returns the largest |X| that still matters, given that in 30 cycles and whether each motion
        repeats: motions beyond it are not run longer.
    """
    largest, repeats = largest_in_short(rig, cases)
    longer = np.flatnonzero(~repeats & (largest <= (most(largest, repeats) if most else math.inf)))
    if len(longer):
        some = {n: np.broadcast_to(v, len(largest))[longer] for n, v in cases.items()}
        largest[longer] = np.maximum(largest[longer], largest_in_long(rig, some))
    return largest
