# SPDX-License-Identifier: Apache-2.0
"""
Propagation of deviations of (X, X', Z, Z') through flights and through events.

A flight carries deviations at a fixed instant by its free vibration. An event at a surface h = 0
carries them by its saltation matrix

    S = D + (f+ - D f-) grad h / (grad h . f-),

with D the derivative of the jump and f the rate of the state before and after [1]_ [2]_.

References
----------
.. [1] A. B. Nordmark, J. Sound Vib. 145, 279-297 (1991).
.. [2] M. H. Fredriksson, A. B. Nordmark, Proc. R. Soc. Lond. A 456, 315-331 (2000).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.rig.oscillator import Oscillator
from impact_damper_ros.rig.state import STICK, RigConstants

from .response import Array, free_response

Mask = NDArray[np.bool_]

#: Gradients of the surfaces: Y = Z - X at an impact, Y' at all other events.
_PLACE = np.array([-1.0, 0.0, 1.0, 0.0])
_SPEED = np.array([0.0, -1.0, 0.0, 1.0])


def free_vibration(oscillator: Oscillator, spans: Array) -> Array:
    """Return the matrices (n, 2, 2) of free vibration that carry (X, X') through spans, s."""
    less, impulse, slope = free_response(oscillator.decay, oscillator.frequency, spans)
    rows = (1.0 + less, impulse), (-oscillator.omega_squared * impulse, slope)
    return np.array(rows).transpose(2, 0, 1)


def flight_matrices(machine: RigConstants, modes: NDArray[np.int64], spans: Array) -> Array:
    """Return the matrices (n, 4, 4) that carry deviations through flights, by mode and span."""
    matrices = np.zeros((len(spans), 4, 4))
    apart, stuck, on_stop = modes < STICK, modes == STICK, modes > STICK
    matrices[apart, :2, :2] = free_vibration(machine.free, spans[apart])
    matrices[apart, 2, 2] = matrices[apart, 3, 3] = 1.0
    matrices[apart, 2, 3] = spans[apart]
    matrices[~apart, :2, :2] = free_vibration(machine.joint, spans[~apart])
    # Friction holds m wherever it is; a stop leaves it no deviation
    matrices[stuck, 2] = matrices[stuck, 0] + _PLACE
    matrices[on_stop, 2] = matrices[on_stop, 0]
    matrices[~apart, 3] = matrices[~apart, 1]
    return matrices


def state_rates(
    machine: RigConstants,
    drive: ArrayLike,
    x: ArrayLike,
    velocity: ArrayLike,
    damper_velocity: ArrayLike,
    direction: ArrayLike,
    air: ArrayLike,
    together: ArrayLike = False,
) -> Array:
    """
    Return (X', X'', Z', Z'') in flights, shape (n, 4).

    The drive is the force over M, the direction the paper's lambda (1 where m slides down, -1
    up, 0 without friction), the air what it accelerates m by; `together` says where M and m
    move as one.
    """
    free, both, mu = machine.free, machine.joint, machine.mass_ratio
    drive, x, velocity, damper, direction, air, together = np.broadcast_arrays(
        drive, x, velocity, damper_velocity, direction, air, together
    )
    common = (velocity + mu * damper) / (1.0 + mu)
    apart = (
        drive
        + mu * (direction * machine.grip - air)
        - 2.0 * free.decay * velocity
        - free.omega_squared * x
    )
    one = (
        drive / (1.0 + mu)
        + mu / (1.0 + mu) * machine.slope
        - 2.0 * both.decay * common
        - both.omega_squared * x
    )
    slide = machine.slope - direction * machine.grip + air
    rates: Array = np.where(
        together[..., None],
        np.stack([common, one, common, one], axis=-1),
        np.stack([velocity, apart, damper, slide], axis=-1),
    )
    return rates


def event_matrices(
    mass_ratio: float, impact: Mask, restitution: Array, before: Array, after: Array, crosses: Mask
) -> Array:
    """
    Return the matrices (n, 4, 4) that carry deviations through events.

    At an event that is no impact, the relative velocity becomes zero. The restitution of a
    plastic impact is 0. The rates (X', X'', Z', Z'') are those just before and after.
    `crosses` is False where a deviation does not move the instant of the event: at a release,
    where the relative acceleration is zero.
    """
    total = 1.0 + mass_ratio
    jump = np.zeros((len(impact), 4, 4))
    jump[:, range(4), range(4)] = 1.0
    jump[impact, 1, 1] = (1.0 - mass_ratio * restitution[impact]) / total
    jump[impact, 1, 3] = mass_ratio * (1.0 + restitution[impact]) / total
    jump[impact, 3, 1] = (1.0 + restitution[impact]) / total
    jump[impact, 3, 3] = (mass_ratio - restitution[impact]) / total
    normal = np.where(impact[:, None], _PLACE, _SPEED)
    across = np.einsum('ij,ij->i', normal, before)
    crosses = crosses & (across != 0.0)
    rise = after - np.einsum('ijk,ik->ij', jump, before)
    rise /= np.where(crosses, across, 1.0)[:, None]
    matrices: Array = jump + np.where(
        crosses[:, None, None], rise[:, :, None] * normal[:, None, :], 0.0
    )
    return matrices


def multipliers_of(matrix: Array) -> tuple[complex, ...]:
    """Return the eigenvalues, largest modulus first; of a pair, positive imaginary part first."""
    values = [complex(value) for value in np.linalg.eigvals(matrix)]
    return tuple(sorted(values, key=lambda v: (-round(abs(v), 12), -v.real, -v.imag)))
