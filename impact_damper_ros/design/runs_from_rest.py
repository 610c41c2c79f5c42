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

import numpy as np
import numpy.typing as npt

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
#: Most samples that are kept at a time.
_MOST_SAMPLES = 1_000_000
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


def _sizes(states: npt.NDArray[np.void], cycles: int) -> Array:
    """Return the largest |X| in each of some cycles, from X and X' of samples."""
    x, v = states['x'], states['primary_velocity']
    h = np.diff(states['time'])
    sizes = np.maximum(np.abs(x[:, :-1]), np.abs(x[:, 1:]))
    # Where X' changes sign, X between two samples is a cubic
    turns = np.nonzero(v[:, :-1] * v[:, 1:] < 0.0)
    before, after = x[:, :-1][turns], x[:, 1:][turns]
    speeds = h[turns] * v[:, :-1][turns], h[turns] * v[:, 1:][turns]
    a = 2.0 * (before - after) + speeds[0] + speeds[1]
    b = 3.0 * (after - before) - 2.0 * speeds[0] - speeds[1]
    root = np.sqrt(np.maximum(b * b - 3.0 * a * speeds[0], 0.0))
    share = np.clip(speeds[0] / (np.copysign(root, speeds[0]) - b), 0.0, 1.0)
    peaks = before + share * (speeds[0] + share * (b + share * a))
    sizes[turns] = np.maximum(sizes[turns], np.abs(peaks))
    largest: Array = sizes.reshape(len(x), cycles, -1).max(axis=2)
    return largest


def _in_cycles(rig: RigParameters, cases: Cases, cycles: int, samples: int) -> Array:
    """Return the largest |X| in each of some cycles after settling, m; infinite if not reached."""
    values, lengths = _similar(rig, cases)
    cycle, first = math.tau / rig.first_harmonic[1], settling_cycles(rig)
    instants = (first + np.arange(cycles * samples + 1) / samples) * cycle
    count, at_a_time = len(np.asarray(values['gap'])), max(_MOST_SAMPLES // len(instants), 1)
    parts = []
    for start in range(0, count, at_a_time):
        some = {n: np.asarray(v)[start : start + at_a_time] for n, v in values.items()}
        result = run_ensemble(rig, some, float(instants[-1]), instants)
        sizes = _sizes(result.samples, cycles)
        sizes[result.outcomes != Outcome.COMPLETE] = math.inf
        parts.append(sizes)
    return np.broadcast_to(lengths, count)[:, None] * np.concatenate(parts)


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


def from_rest(rig: RigParameters) -> float:
    """Return the largest |X| of a rig some time after it was started from rest, m."""
    return float(largest_from_rest(rig, {'gap': [rig.gap]})[0])
