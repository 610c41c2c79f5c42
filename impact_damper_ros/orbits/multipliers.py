# SPDX-License-Identifier: Apache-2.0
"""
The motion in flights and events as it changes: rates of the state, and what carries deviations.

The state is (X, X', Y, Y'). A flight carries deviations at a fixed instant by its free vibration.
An event at a surface h = 0 carries them by its saltation matrix

    S = D + (f+ - D f-) grad h / (grad h . f-),

with D the derivative of the jump and f the rate of the state before and after [1]_ [2]_.

References
----------
.. [1] A. B. Nordmark, J. Sound Vib. 145, 279-297 (1991).
.. [2] M. H. Fredriksson, A. B. Nordmark, Proc. R. Soc. Lond. A 456, 315-331 (2000).
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.impact import rebound_slopes
from impact_damper_ros.motion.state import RigConstants
from impact_damper_ros.rig.run_result import Events

from .response import Array

Mask = NDArray[np.bool_]
X, V, Y, U = range(4)
#: The direction in which the air drives m, by the stop hit last, or 0.
AWAY: Array = np.array([0.0, -1.0, 1.0])


def velocities_of(events: Events, side: str, joint: Mask, share: float) -> tuple[Array, Array]:
    """
    Return X' and Y' on one side of events, that is in flights which may be joint ones.

    In the rest of a chatter, whose impacts are not resolved, both move at their common velocity.
    """
    velocity = events[f'primary_velocity_{side}']
    relative = events[f'damper_velocity_{side}'] - velocity
    return (
        velocity + np.where(joint, share * relative, 0.0),
        np.where(joint, 0.0, relative),
    )


class FlightLaws(NamedTuple):
    """
    The equations of motion in flights.

    X'' = push + force - 2 decay X' - stiffness X, where the force is that over the mass which
    moves; and Z'' = slide, where m moves by itself.
    """

    decay: Array
    damped: Array  # frequency of the free vibration, rad/s
    stiffness: Array
    push: Array
    slide: Array
    moves: Array  # 1 where m moves by itself, 0 where it moves as one with M

    @classmethod
    def of(
        cls,
        constants: RigConstants,
        joint: Mask,
        direction: Array,
        away: Array,
    ) -> Self:
        """
        Return the laws of flights.

        Given are whether M and m move as one, the paper's lambda, and the direction in which the
        air drives m.
        """
        friction, air = direction * constants.grip, away * constants.air
        moves = np.where(joint, 0.0, 1.0)
        decay, damped, stiffness = (
            np.where(joint, getattr(constants.joint, name), getattr(constants.free, name))
            for name in ('decay', 'frequency', 'omega_squared')
        )
        return cls(
            *(decay, damped, stiffness),
            np.where(
                joint, constants.share * constants.slope, constants.mass_ratio * (friction - air)
            ),
            moves * (constants.slope - friction + air),
            moves,
        )

    def rates(self, x: Array, velocity: Array, relative: Array, force: Array) -> Array:
        """Return the rates (..., n, 4) of states."""
        acceleration = self.push - 2.0 * self.decay * velocity - self.stiffness * x + force
        rates = np.empty((*x.shape, 4))
        rates[..., X], rates[..., V] = velocity, acceleration
        rates[..., Y] = self.moves * relative
        rates[..., U] = self.moves * (self.slide - acceleration)
        return rates


def jumps(share: float, impact: Mask, slopes: Array) -> Array:
    """
    Return the derivative (n, 4, 4) of the state after events by that before them.

    The slopes are those of `impact.bounce` at the impacts.
    """
    jump = np.zeros((len(impact), 4, 4))
    jump[:, range(4), range(4)] = 1.0
    slide, stay = rebound_slopes(share, slopes)
    jump[:, V, U] = np.where(impact, slide, 0.0)
    jump[:, U, U] = np.where(impact, stay, 1.0)
    return jump


def event_matrices(
    jump: Array, impact: Mask, before: Array, after: Array, crosses: Mask | bool = True
) -> Array:
    """
    Return the matrices (n, 4, 4) that carry deviations through events.

    At an event that is no impact, the relative velocity becomes zero. The rates are those just
    before and after. `crosses` is False at what happens at its own time; where m was held, its
    relative acceleration is zero, and a deviation does not move the instant either.
    """
    normal = np.where(impact, Y, U)
    across = np.where(impact, before[:, Y], before[:, U])
    crosses = crosses & (across != 0.0)
    rise = after - (jump @ before[:, :, None])[..., 0]
    rise *= (crosses / np.where(crosses, across, 1.0))[:, None]
    matrices = jump.copy()
    matrices[np.arange(len(impact)), :, normal] += rise
    return matrices


def multipliers_of(matrix: Array) -> tuple[complex, ...]:
    """Return the eigenvalues, largest modulus first; of a pair, positive imaginary part first."""
    values = [complex(value) for value in np.linalg.eigvals(matrix)]
    return tuple(sorted(values, key=lambda v: (-round(abs(v), 12), -v.real, -v.imag)))
