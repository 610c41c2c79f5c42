# SPDX-License-Identifier: Apache-2.0
"""
Stepped sine: the first harmonic goes through a range of frequencies with a continuous phase.

The instants of the steps are counted from the start, so that a long sweep does not drift.
"""

from __future__ import annotations

from math import ceil, inf
from typing import NamedTuple

from impact_damper_ros.parameters.rig_parameters import RigParameters

#: A change of one of these starts the sweep anew.
SWEEP_FIELDS = ('sweep_mode', 'sweep_low', 'sweep_high', 'sweep_step', 'sweep_dwell')
# A range this little longer than a whole number of steps ends with the last of them.
_WHOLE = 1e-9


def frequency_steps(parameters: RigParameters) -> int:
    """Return the number of steps of a whole sweep; 0 if there is none."""
    if parameters.sweep_mode == 'off':
        return 0
    way = (parameters.sweep_high - parameters.sweep_low) / parameters.sweep_step
    once = max(1, ceil(way - _WHOLE))
    return 2 * once if parameters.sweep_mode == 'up_down' else once


def frequency_at(parameters: RigParameters, step: int) -> float:
    """
    Return the frequency of the first harmonic after a number of steps of the sweep, rad/s.

    Up and down go through the same frequencies: from the low end on in whole steps, and the high
    end, to which the last step may be a shorter one.
    """
    steps = frequency_steps(parameters)
    if not steps:
        return parameters.first_harmonic[1]
    once = steps // 2 if parameters.sweep_mode == 'up_down' else steps
    place = min(max(step, 0), steps)
    if parameters.sweep_mode == 'down':
        place = steps - place
    elif place > once:
        place = 2 * once - place
    if place == once:
        return parameters.sweep_high
    return parameters.sweep_low + place * parameters.sweep_step


class SteppedSine(NamedTuple):
    """
    How far a sweep has come.

    Attributes
    ----------
    start : float
        When it was started, s.
    step : int
        Steps done.
    """

    start: float
    step: int = 0

    @classmethod
    def begun(cls, parameters: RigParameters, time: float) -> SteppedSine:
        """Return a sweep that starts at a time; one that is off has begun at none."""
        return cls(0.0 if parameters.sweep_mode == 'off' else time)

    def due(self, parameters: RigParameters) -> float:
        """Return the instant of the next step, s; infinity after the last one."""
        if self.step >= frequency_steps(parameters):
            return inf
        return self.start + (self.step + 1) * parameters.sweep_dwell
