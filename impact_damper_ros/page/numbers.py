# SPDX-License-Identifier: Apache-2.0
"""The key numbers of a rig, and of its motion in the last cycles of the force."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from impact_damper_ros.rig import RigParameters

from .knobs import as_json
from .motion import Motion

#: Cycles of the force over which is measured.
_CYCLES = 20


def numbers_of(rig: RigParameters, motion: Motion, end: float) -> dict[str, Any]:
    """
    Return the message with the numbers of a rig and of its motion up to an instant.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    motion : Motion
        Its motion.
    end : float
        Rig time now, s.
    """
    frequency, amplitude = rig.force_frequencies[0], rig.response_amplitude
    numbers = {
        'natural_frequency_hz': rig.omega / math.tau,
        'damping_ratio': rig.zeta,
        'frequency_ratio': rig.frequency_ratio,
        'static_amplitude': amplitude,
        'mass_ratio': rig.mass_ratio,
        'gap': rig.gap,
    }
    cycle = math.tau / frequency if frequency > 0.0 else math.inf
    known = end - float(motion.samples[0, 0]) if len(motion.samples) else 0.0
    cycles = min(_CYCLES, math.floor(known / cycle))
    if cycles >= 1:
        impacts = motion.impacts_between(end - cycles * cycle, end)
        x_max = float(np.abs(motion.samples_between(end - cycles * cycle, end)[:, 1]).max())
        # X' changes at an impact, X does not.
        before, after = impacts[:, 4], impacts[:, 5]
        lost = 0.5 * rig.primary_mass * float((before**2 - after**2).sum())
        numbers |= {
            'impacts_per_cycle': len(impacts) / cycles,
            'energy_per_cycle': lost / cycles,
            'x_max_ratio_measured': x_max / amplitude if amplitude > 0.0 else math.nan,
        }
    return {'type': 'numbers', **as_json(numbers)}
