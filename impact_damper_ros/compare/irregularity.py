"""
Motions that do not repeat: quasi-periodic, chaotic, or not settled.

The largest Lyapunov exponent is taken *along the recorded motion*: between two recorded impacts
the theory of the logged rig carries neighbouring motions in closed form, saltation at impacts and
reversals included, and the recording corrects it at every impact. Two tests see nothing but values
taken once in a cycle. That of weighted averages [1]_ compares the averages over both halves, with
weights that vanish smoothly at the ends: those of a quasi-periodic motion agree to ever more
digits, those of a chaotic one as badly as random numbers. The 0-1 test [2]_ drives a walk in the
plane, which stays bounded for a regular motion (K near 0) and diffuses for a chaotic one (K near
1); of motions that forget slowly it needs a thousand values.

References
----------
.. [1] E. Sander, J. D. Meiss, Physica D 411, 132569 (2020).
.. [2] G. A. Gottwald, I. Melbourne, SIAM J. Appl. Dyn. Syst. 8, 129-145 (2009).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impact_damper_ros.orbits.event_map import origin_at, run_course
from impact_damper_ros.orbits.floquet import impact_matrix
from impact_damper_ros.orbits.rhythm import MotionKind
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.mode import REST_1, REST_2, Machine, make_machine

from .recorded_stretch import ForceClock, RecordedImpacts
from .result import Array

__all__ = [
    'Exponent',
    'Indications',
    'average_spread',
    'largest_exponent',
    'quiet_phase',
    'zero_one_test',
]


#: Impacts on which the exponent is measured, at most, and the parts for its error.
_MOST_IMPACTS = 1500
_PARTS = 8
#: Numbers that the 0-1 test needs at least, and takes at most.
_LEAST_NUMBERS, _MOST_NUMBERS = 100, 1000
_FREQUENCIES = 60
#: A motion is chaotic if the exponent is so many standard errors above zero, a deviation grows by
#: more than e to this power over the time measured, and the weighted averages are apart by more
#: than this.
CERTAIN_ERRORS, CERTAIN_GROWTH, IRREGULAR_SPREAD = 5.0, 10.0, 3e-3
#: It is quasi-periodic if a deviation has neither grown nor shrunk by more than e to this power,
#: the exponent is no more than so many standard errors from zero, and the averages are closer.
BOUNDED_GROWTH, DOUBTFUL_ERRORS, REGULAR_SPREAD = 2.0, 3.0, 1e-3
#: Values from which on the weighted averages mean something.
LEAST_VALUES = 300
#: What would decide is not foretold beyond this.
_MOST_FORETOLD = 1_000_000
_CONSTANT = 1e-6
# A stamp is rounded to the nanosecond; the flight ends as much before the impact.
_GUARD_S = 2e-9


@dataclass(frozen=True)
class Exponent:
    """
    The largest Lyapunov exponent.

    Attributes
    ----------
    value : float
        Growth of small deviations per cycle of the force, as a logarithm.
    error : float
        Its standard error, from parts of the stretch.
    impacts : int
        Impacts on which it was measured.
    cycles : float
        Cycles of the force that they take.
    """

    value: float
    error: float
    impacts: int
    cycles: float = 0.0


@dataclass(frozen=True)
class Indications:
    """
    What speaks for chaos and what against it.

    Attributes
    ----------
    exponent, error : float
        Largest Lyapunov exponent, and its standard error, per cycle of the force.
    cycles : int
        Cycles on which they were measured.
    spread : float
        Difference of the weighted averages; NaN if there are too few values.
    """

    exponent: float
    error: float
    cycles: int
    spread: float

    @property
    def grows(self) -> bool:
        """Whether neighbouring motions part, beyond doubt."""
        grown = self.exponent * self.cycles
        return self.exponent > CERTAIN_ERRORS * self.error and grown > CERTAIN_GROWTH

    @property
    def shrinks(self) -> bool:
        """Whether neighbouring motions join, beyond doubt."""
        grown = self.exponent * self.cycles
        return self.exponent < -CERTAIN_ERRORS * self.error and grown < -BOUNDED_GROWTH

    @property
    def neutral(self) -> bool:
        """Whether neighbouring motions keep their distance."""
        grown = abs(self.exponent) * self.cycles
        return grown < BOUNDED_GROWTH and abs(self.exponent) <= DOUBTFUL_ERRORS * self.error

    def kind(self) -> MotionKind:
        """Return what the motion is: chaotic or quasi-periodic if both tests say so."""
        # Of too few values nothing is known but the exponent
        if self.grows and not self.spread <= IRREGULAR_SPREAD:
            return MotionKind.CHAOTIC
        if self.neutral and self.spread < REGULAR_SPREAD and self.cycles >= LEAST_VALUES:
            return MotionKind.QUASI_PERIODIC
        return MotionKind.UNDECIDED

    def cycles_to_decide(self) -> int:
        """Return after how many cycles in all the exponent should be certain; 0 if not known."""
        if self.exponent <= DOUBTFUL_ERRORS * self.error:
            return 0
        certain = self.cycles * (CERTAIN_ERRORS * self.error / self.exponent) ** 2
        needed = max(certain, CERTAIN_GROWTH / self.exponent)
        return math.ceil(needed) if self.cycles < needed < _MOST_FORETOLD else 0


def average_spread(section: Array) -> float:
    """
    Return by how much the weighted averages over two halves of a motion differ at most.

    Parameters
    ----------
    section : ndarray of shape (n, m)
        The motion, once in a cycle.

    Returns
    -------
    float
        The largest difference of averages of each quantity, its cosine and the sine of its
        double, each scaled to the standard deviation 1. NaN with fewer than `LEAST_VALUES`.
    """
    half = len(section) // 2
    if len(section) < LEAST_VALUES:
        return math.nan
    deviation = section.std(axis=0)
    size = float(deviation.max()) or 1.0
    moving = deviation > _CONSTANT * size
    scaled = (section[:, moving] - section[:, moving].mean(axis=0)) / deviation[moving]
    values = np.concatenate([scaled, np.cos(scaled), np.sin(2.0 * scaled)], axis=1)
    part = np.arange(1, half + 1) / (half + 1)
    weight = np.exp(-1.0 / (part * (1.0 - part)))
    weight /= weight.sum()
    return float(np.abs(weight @ (values[:half] - values[-half:])).max(initial=0.0))


def quiet_phase(phases: Array) -> float:
    """
    Return the middle of the widest gap between the phases of impacts, in cycles, in [0, 1).

    There a cycle should be looked at for `average_spread`: what is looked at where impacts fall
    jumps, and its averages converge slowly.
    """
    if not len(phases):
        return 0.0
    inside = np.sort(phases % 1.0)
    gaps = np.diff(np.append(inside, inside[0] + 1.0))
    widest = int(gaps.argmax())
    return float(inside[widest] + 0.5 * gaps[widest]) % 1.0


def _rates(
    machine: Machine, rig: RigParameters, force: float, x: float, velocity: float, damper: float
) -> Array:
    """Return (X', X'', Z', Z'') at an impact."""
    direction = math.copysign(1.0, damper - velocity) if damper != velocity else 0.0
    grip = machine.grip * direction
    push = force - rig.damping * velocity - rig.stiffness * x + rig.damper_mass * grip
    return np.array([velocity, push / rig.primary_mass, damper, machine.slope - grip])


def largest_exponent(clock: ForceClock, impacts: RecordedImpacts) -> Exponent | None:
    """Measure how fast motions next to the recorded one part from it, or join it."""
    impacts = impacts[-_MOST_IMPACTS:]
    if len(impacts) < 2 * _PARTS:
        return None
    rig = clock.counted_from_zero()
    machine = make_machine(rig)
    before = impacts.velocity_before(rig)
    damper_before = impacts.damper_velocity_before(rig)
    force = clock.force(impacts.time)
    since = impacts.time - clock.zero
    scale = np.array([1.0, rig.omega, 1.0, rig.omega])
    deviation = np.array([1.0, 0.6, -0.8, 0.4]) / scale
    growth = np.zeros(len(impacts))
    for i in range(1, len(impacts)):
        j = i - 1
        stop = int(impacts.stop[j])
        after = (float(impacts.velocity_after[j]), float(impacts.damper_velocity_after[j]))
        relative = after[1] - after[0]
        resting = 0 if relative else (REST_1 if stop == 1 else REST_2)
        origin = origin_at(
            machine,
            float(since[j]),
            float(impacts.x[j]),
            after[0],
            0.0 if stop == 1 else -2.0 * machine.stop,
            relative,
            resting,
            stop,
        )
        duration = float(impacts.time[i] - impacts.time[j])
        course = run_course(machine, origin, max(duration - _GUARD_S, 0.0))
        if course is None:
            continue
        restitution = machine.restitution_1 if impacts.stop[i] == 1 else machine.restitution_2
        at = (float(force[i]), float(impacts.x[i]))
        rates = [
            _rates(machine, rig, *at, float(v[i]), float(w[i]))
            for v, w in (
                (before, damper_before),
                (impacts.velocity_after, impacts.damper_velocity_after),
            )
        ]
        if rates[0][0] == rates[0][2]:
            continue
        hit = impact_matrix(machine.mass_ratio, restitution, *rates)
        deviation = hit @ (course.matrix @ deviation)
        size = float(np.linalg.norm(deviation * scale))
        if size == 0.0:
            return Exponent(-math.inf, 0.0, i)
        growth[i] = math.log(size)
        deviation /= size
    phase = clock.phase(impacts.time)
    span = float(phase[-1] - phase[0])
    if span < _PARTS:
        return None
    part = np.minimum(((phase - phase[0]) * (_PARTS / span)).astype(np.int64), _PARTS - 1)
    rate = np.bincount(part, growth, _PARTS) * (_PARTS / span)
    error = float(rate.std(ddof=1)) / math.sqrt(_PARTS)
    return Exponent(float(growth.sum()) / span, error, len(impacts), span)


def zero_one_test(values: Array, seed: int = 1) -> float:
    """Return the K of the 0-1 test: near 0 for regular, near 1 for chaotic sequences."""
    values = values[-_MOST_NUMBERS:]
    n = len(values)
    if n < _LEAST_NUMBERS or float(values.std()) == 0.0:
        return math.nan
    mean = float(values.mean())
    values = (values - mean) / float(values.std())
    reach = n // 10
    steps = np.arange(1, n + 1)
    lags = np.arange(1, reach + 1)
    found = []
    for frequency in np.random.default_rng(seed).uniform(0.2 * np.pi, 0.8 * np.pi, _FREQUENCIES):
        walk = np.cumsum(values * np.exp(1j * frequency * steps))
        moved = np.array(
            [np.mean(np.abs(walk[lag : lag + n - reach] - walk[: n - reach]) ** 2) for lag in lags]
        )
        found.append(np.corrcoef(lags, moved)[0, 1])
    return float(np.median(found))
