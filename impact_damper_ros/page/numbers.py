# SPDX-License-Identifier: Apache-2.0
"""The key numbers of a rig, and of its motion in the last cycles of the force."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .knobs import as_json
from .motion import MotionHistory, between

#: Cycles of the force over which the motion is measured, and time over which a controller is
#: scored, s.
_CYCLES, _SCORED_S = 20, 60.0


def numbers_of(rig: RigParameters, motion: MotionHistory, end: float) -> dict[str, Any]:
    """Return the message with the numbers of a rig and of its motion up to an instant, s."""
    amplitude, frequency, _ = rig.first_harmonic
    numbers = {
        'natural_frequency_hz': rig.omega / math.tau,
        'damping_ratio': rig.zeta,
        'frequency_ratio': rig.frequency_ratio,
        'static_amplitude': rig.response_amplitude,
        'mass_ratio': rig.mass_ratio,
        'gap': rig.gap,
    }
    cycle = math.tau / (frequency if amplitude != 0.0 and frequency > 0.0 else rig.omega)
    known = end - float(motion.samples[0, 0]) if len(motion.samples) else 0.0
    cycles = min(_CYCLES, math.floor(known / cycle))
    if cycles >= 1:
        impacts = between(motion.impacts, end - cycles * cycle, end)
        x_max = float(np.abs(between(motion.samples, end - cycles * cycle, end)[:, 1]).max())
        # X' changes at an impact, X does not.
        before, after = impacts[:, 4], impacts[:, 5]
        lost = 0.5 * rig.primary_mass * float((before**2 - after**2).sum())
        numbers |= {
            'impacts_per_cycle': len(impacts) / cycles,
            'energy_per_cycle': lost / cycles,
            'x_max_ratio': rig.x_max_ratio(x_max),
        }
    return {'type': 'numbers', **as_json(numbers), 'score': score_of(motion, end)}


def score_of(motion: MotionHistory, end: float) -> dict[str, Any] | None:
    """Return the rms of X and the energy of a controller in the last minute."""
    x = between(motion.samples, end - _SCORED_S, end)[:, :2]
    if len(x) < 2:
        return None
    start, acts = end - _SCORED_S, motion.acts
    first, last = np.searchsorted(acts[:, 0], (start, end), side='right')
    # Energy since the act before the minute; a reset lets the energy count from 0 again.
    energies = acts[max(first - 1, 0) : last, -1]
    return {
        'seconds': float(x[-1, 0] - x[0, 0]),
        'x_rms': float(np.sqrt(np.mean(x[:, 1] ** 2))),
        'x_max': float(np.abs(x[:, 1]).max()),
        'impacts': len(between(motion.impacts, start, end)),
        'actuator_energy': float(np.clip(np.diff(energies), 0.0, None).sum()),
    }
