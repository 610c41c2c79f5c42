"""The key numbers of a rig, and of its motion in the last seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from impact_damper_ros.rig import RigParameters

from .knobs import as_json
from .motion import MotionHistory, Rows

#: Cycles of the force over which energy is counted.
_CYCLES = 20
#: Coefficients of restitution that count as equal.
_EQUAL = 1e-3
#: Largest relative change of the velocity of m on its way through the gap.
_SMALL = 0.25
#: Samples per second of a replay at 1/20 of the speed, on a screen with 60 frames per second.
_SLOW_RATE = 1200.0
#: Largest number of samples (a minute) and impacts of a replay.
_MOST_SLOW, _MOST_SLOW_IMPACTS = 3600, 50


@dataclass(frozen=True)
class RigNumbers:
    """
    A rig, and the numbers measured on it.

    Attributes
    ----------
    rig : RigParameters or None
        The rig, if it is known.
    motion : MotionHistory
        Its motion.
    end : float
        Rig time now, s.
    x_max : float or None
        Largest |X| measured, m; taken from the last cycles of the force, if it is None.
    impacts_per_cycle : float or None
        As measured; counted over the last cycles, if it is None.
    """

    rig: RigParameters | None
    motion: MotionHistory
    end: float
    x_max: float | None = None
    impacts_per_cycle: float | None = None

    def as_dict(
        self, predicted: float | None, optimum: float | None, basis: str = 'curve'
    ) -> dict[str, Any]:
        """
        Return the message, with Xmax/A and the best gap predicted by theory.

        `basis` is the source of the best gap: the ``'curve'``, its end (``'at least'``, ``'at
        most'``), ``'part of the curve'``, or the ``'formula'`` for the resonance; see
        `estimated_optimum`.
        """
        rig = self.rig
        if rig is None:
            return {'type': 'numbers'}
        frequency = rig.force_frequencies[0]
        amplitude = rig.response_amplitude
        impacts, x_max, energy = self._of_last_cycles(rig)
        x_max = self.x_max if self.x_max is not None else x_max
        known = x_max is not None and 0.0 < amplitude < math.inf
        ratio = x_max / amplitude if known and x_max is not None else None
        numbers = {
            'natural_frequency_hz': rig.omega / math.tau,
            'natural_period': math.tau / rig.omega,
            'omega': rig.omega,
            'damping_ratio': rig.zeta,
            'frequency_hz': frequency / math.tau,
            'frequency_ratio': rig.frequency_ratio,
            'static_amplitude': amplitude,
            'mass_ratio': rig.mass_ratio,
            'gap': rig.gap,
            'optimal_gap': optimum,
            'optimal_gap_basis': basis if optimum else '',
            'gap_ratio': rig.gap / optimum if optimum else None,
            'impacts_per_cycle': (
                self.impacts_per_cycle if self.impacts_per_cycle is not None else impacts
            ),
            'energy_per_cycle': energy,
            'amplitude_measured': x_max,
            'x_max_ratio_measured': ratio,
            'x_max_ratio_predicted': predicted,
        }
        return {'type': 'numbers', **as_json(numbers)}

    def _of_last_cycles(
        self, rig: RigParameters
    ) -> tuple[float | None, float | None, float | None]:
        """Return impacts per cycle, largest |X|, and energy that the impacts take from M."""
        frequency, end = rig.force_frequencies[0], self.end
        if frequency <= 0.0 or not math.isfinite(end):
            return None, None, None
        cycle = math.tau / frequency
        known = end - float(self.motion.samples[0, 0])
        cycles = min(_CYCLES, math.floor(known / cycle))
        if cycles < 1:
            return None, None, None
        start = end - cycles * cycle
        impacts = self.motion.impacts_between(start, end)
        x = self.motion.samples_between(start, end)[:, 1]
        # X' changes at an impact, X does not.
        lost = 0.5 * rig.primary_mass * float((impacts[:, 8] ** 2 - impacts[:, 3] ** 2).sum())
        return len(impacts) / cycles, float(np.abs(x).max()), lost / cycles


def estimated_optimum(rig: RigParameters) -> float | None:
    """
    Estimate the best gap by an energy balance, m; None where that does not apply.

    The estimate is for two impacts per cycle at resonance, where M passes its equilibrium, with
    equal stops and a constant velocity of m in between. Theory finds the best gap itself, later.
    """
    restitution, mu = 0.5 * (rig.restitution_1 + rig.restitution_2), rig.mass_ratio
    single = rig.sweep_mode == 'off' and not rig.multisine_level
    equal = abs(rig.restitution_1 - rig.restitution_2) < _EQUAL
    if rig.one_sided or not (single and equal and 0.0 < restitution < 1.0):
        return None
    share = mu / (1.0 + mu)
    added = 2.0 / math.pi * share * (1.0 + restitution) / (1.0 - restitution)
    damping = rig.zeta + added
    # Within the width of the resonance with impacts
    if len(rig.force_amplitudes) > 1 or abs(rig.frequency_ratio - 1.0) > 0.5 * damping:
        return None
    x_max = 0.5 * abs(rig.force_amplitudes[0]) / rig.stiffness / damping
    gap = math.pi * x_max * (1.0 + restitution) / ((1.0 - restitution) * (1.0 + mu))
    pull = rig.gravity * (abs(math.sin(rig.angle)) + rig.friction) + (
        rig.air_force / rig.damper_mass
    )
    # What the pull changes in half a cycle, and the velocity with which m crosses the gap
    half = math.pi / rig.force_frequencies[0]
    return gap if 0.0 < gap < math.inf and pull * half < _SMALL * gap / half else None


def slow_motion(motion: MotionHistory, count: int, end: float) -> dict[str, Any]:
    """
    Return the last impacts, closely sampled, for slow motion.

    Between samples and impacts the motion is drawn by cubics through places and velocities, with
    the velocity after an impact different from that before it.
    """
    impacts = motion.impacts_between(-math.inf, end)
    impacts = impacts[-min(max(count, 1), _MOST_SLOW_IMPACTS) :]
    message: dict[str, Any] = {'type': 'slow_motion', 't': [], 'impacts': []}
    if not len(impacts):
        return message | {name: [] for name in ('x', 'z', 'stop_1', 'stop_2')}
    pause = 0.3 * max(float(impacts[-1, 0] - impacts[0, 0]) / max(len(impacts) - 1, 1), 1e-3)
    start, end = impacts[0, 0] - pause, min(impacts[-1, 0] + pause, end)
    first = np.searchsorted(motion.samples[:, 0], start, side='right') - 1
    samples = motion.samples[max(int(first), 0) :]
    count = int(min(_MOST_SLOW, max(2, (end - start) * _SLOW_RATE)))
    t = np.linspace(max(start, samples[0, 0]), end, count)
    (x, _), (z, _) = _at(t, samples, impacts)
    at = np.clip(np.searchsorted(samples[:, 0], t, side='right') - 1, 0, None)
    stops = {
        f'stop_{stop}': as_json((x + (samples[at, column] - samples[at, 1])).tolist())
        for stop, column in ((1, 5), (2, 7))
    }
    return message | {
        't': t.tolist(),
        'x': x.tolist(),
        'z': z.tolist(),
        **stops,
        'impacts': [
            {'t': float(row[0]), 'stop': int(row[1]), 'impulse': float(row[5])} for row in impacts
        ],
    }


def state_at(motion: MotionHistory, time: float) -> Rows:
    """Return the state at an instant, as `SAMPLE_COLUMNS` without the time."""
    samples = motion.samples
    place = int(np.searchsorted(samples[:, 0], time, side='right')) - 1
    place = min(max(place, 0), len(samples) - 1)
    row: Rows = samples[place, 1:].copy()
    if place + 1 >= len(samples) or time <= samples[place, 0]:
        return row
    two = samples[place : place + 2]
    impacts = motion.impacts_between(two[0, 0], two[1, 0])
    (x, x_velocity), (z, z_velocity) = _at(np.array([time]), two, impacts)
    # The stops ride on M.
    row[[4, 6]] += float(x[0]) - row[0]
    row[[5, 7]] += float(x_velocity[0]) - row[1]
    row[:4] = x[0], x_velocity[0], z[0], z_velocity[0]
    if not math.isnan(row[9]) and not math.isnan(two[1, 10]):
        turned = (two[1, 10] - two[0, 10]) % 1.0
        share = (time - two[0, 0]) / (two[1, 0] - two[0, 0])
        row[9] = (row[9] + share * turned) % 1.0
    return row


def _at(t: Rows, samples: Rows, impacts: Rows) -> tuple[tuple[Rows, Rows], tuple[Rows, Rows]]:
    """Return X and Z with their velocities at instants."""
    places = np.column_stack([impacts[:, 0], impacts[:, 2] + impacts[:, 7], impacts[:, [4, 9]]])
    return (
        _between_knots(t, samples[:, [0, 1, 2]], impacts[:, [0, 2, 3, 8]]),
        _between_knots(t, samples[:, [0, 3, 4]], places),
    )


def _between_knots(t: Rows, samples: Rows, impacts: Rows) -> tuple[Rows, Rows]:
    """Return places and velocities; impacts have the velocity after them and the one before."""
    after = np.column_stack([impacts[:, :3], np.ones(len(impacts))])
    before = np.column_stack([impacts[:, [0, 1, 3]], np.zeros(len(impacts))])
    plain = np.column_stack([samples, np.full(len(samples), 0.5)])
    knots = np.concatenate([plain, before, after])
    knots = knots[np.lexsort((knots[:, 3], knots[:, 0]))]
    left = np.clip(np.searchsorted(knots[:, 0], t, side='right') - 1, 0, len(knots) - 2)
    begin, end = knots[left], knots[left + 1]
    length = np.maximum(end[:, 0] - begin[:, 0], 1e-12)
    share = np.clip((t - begin[:, 0]) / length, 0.0, 1.0)
    rest = 1.0 - share
    place: Rows = (
        begin[:, 1] * rest**2 * (1.0 + 2.0 * share)
        + end[:, 1] * share**2 * (1.0 + 2.0 * rest)
        + length * share * rest * (begin[:, 2] * rest - end[:, 2] * share)
    )
    velocity: Rows = (
        6.0 * share * rest * (end[:, 1] - begin[:, 1]) / length
        + begin[:, 2] * rest * (1.0 - 3.0 * share)
        + end[:, 2] * share * (1.0 - 3.0 * rest)
    )
    return place, velocity
