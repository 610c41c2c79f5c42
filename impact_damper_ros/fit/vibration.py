# SPDX-License-Identifier: Apache-2.0
"""
Motion of M alone between two nodes, in closed form, for many instants at once.

M is a linear oscillator whatever m does, so that its state some time after a node is linear in
the state at the node, and in the constant acceleration of M by friction.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.rig_parameters import RigParameters

Array = NDArray[np.float64]
Phasors = NDArray[np.complex128]


class Vibration(NamedTuple):
    """
    M on its spring and dashpot, and the harmonics that drive it, per unit mass.

    Attributes
    ----------
    decay, damped, stiffness : float
        Constants a, b and w^2 of X'' + 2 a X' + w^2 X = drive.
    forces, frequencies, phases : ndarray, shape (h,)
        Amplitudes over M, m/s^2, circular frequencies, rad/s, and phases, rad.
    """

    decay: float
    damped: float
    stiffness: float
    forces: Array
    frequencies: Array
    phases: Array

    # A fit needs the same vibration many times.
    @classmethod
    @lru_cache(maxsize=64)
    def of(
        cls,
        rig: RigParameters,
        stiffness: float,
        damping: float,
        delay: float = 0.0,
        *,
        joint: bool = False,
    ) -> Vibration:
        """Return the vibration of M, or of M and m, with other K and C and a delayed force."""
        mass = rig.primary_mass + (rig.damper_mass if joint else 0.0)
        decay, square = 0.5 * damping / mass, stiffness / mass
        forces, frequencies, phases = _harmonics(rig, stiffness, damping)
        return cls(
            decay,
            math.sqrt(max(square - decay * decay, 1e-12 * square)),
            square,
            forces / mass,
            frequencies,
            phases - frequencies * delay,
        )

    @property
    def root(self) -> complex:
        """The eigenvalue -a + ib."""
        return complex(-self.decay, self.damped)

    def phasors(self, times: Array) -> Phasors:
        """Return the harmonics of the drive at times as phasors; the drive is their sine."""
        turning: Phasors = self.forces * np.exp(
            1j * (self.frequencies * times[..., None] + self.phases)
        )
        return turning

    def drive(self, times: Array) -> Array:
        """Return the drive at times, m/s^2."""
        total: Array = self.phasors(times).imag.sum(-1)
        return total

    def steady(self, times: Array, order: int) -> Array:
        """Return a time derivative of the steady response at times."""
        turning = np.exp(1j * self.frequencies * times[..., None])
        total: Array = (turning @ self.steady_phasors(order)).imag
        return total

    def steady_phasors(self, order: int) -> Phasors:
        """Return the phasors at time 0 of a time derivative of the steady response."""
        w = self.frequencies
        gain = (1j * w) ** order / (self.stiffness - w * w + 2j * self.decay * w)
        phasors: Phasors = gain * self.forces * np.exp(1j * self.phases)
        return phasors

    def acceleration(self, times: Array, x: Array, velocity: Array, push: Array) -> Array:
        """Return X'' in a state at times under a constant push."""
        rest: Array = self.drive(times) + push - 2.0 * self.decay * velocity - self.stiffness * x
        return rest


@lru_cache(maxsize=64)
def wave_of(
    rig: RigParameters, stiffness: float, damping: float, delay: float, joint: bool, order: int
) -> Array:
    """Return a vibration as `sample_kernels` has it, for a derivative of X."""
    vibration = Vibration.of(rig, stiffness, damping, delay, joint=joint)
    phasors = np.stack([vibration.steady_phasors(k) for k in (0, 1, order)], axis=1)
    constants = vibration.decay, vibration.damped, vibration.stiffness
    return np.concatenate([constants, phasors.view(float).ravel()])


def _harmonics(rig: RigParameters, stiffness: float, damping: float) -> tuple[Array, Array, Array]:
    """Return the harmonics of the force on M; those of a base depend on K and C."""
    parts = [(rig.force_amplitudes, rig.force_frequencies, rig.force_phases)]
    for name, group in rig.harmonic_groups.items():
        if name == 'base':
            parts.append(rig.base_motion.force(stiffness, damping))  # type: ignore[arg-type]
        elif name != 'force':
            parts.append(group)  # type: ignore[arg-type]
    columns = [np.concatenate([np.asarray(part[i], float) for part in parts]) for i in range(3)]
    acting = columns[0] != 0.0
    if not acting.any():
        acting[0] = True
    forces, frequencies, phases = (column[acting] for column in columns)
    return forces, frequencies, phases
