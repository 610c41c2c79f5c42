# SPDX-License-Identifier: Apache-2.0
"""
Free and forced response of M, in closed form and for many spans at once.

The forced part is the response from rest, a divided difference of the exponential. Unlike the
steady response it is finite for an undamped rig at resonance, and nothing cancels near there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: An angle, rad, beyond which others make no difference.
_RESONANT = 1e-100
#: Decay of a free vibration, in powers of e, after which it counts as zero.
_LOST = 500.0

Array = NDArray[np.float64]


def unit_response(
    decay: Array | float, damped: Array | float, spans: Array
) -> tuple[Array, Array, Array]:
    """
    Return X after spans (s) from a unit X, less 1, and X and X' from a unit X'.

    Nothing cancels in short spans.
    """
    less, half = np.expm1(-decay * spans), 0.5 * damped * spans
    envelope, sine = 1.0 + less, np.sin(half)
    impulse = 2.0 * envelope * sine * np.cos(half) / damped
    fall = 2.0 * envelope * sine * sine
    return less + (decay * impulse - fall), impulse, envelope - fall - decay * impulse


def forced_response(
    decay: Array | float, damped: Array | float, frequency: Array | float, spans: Array
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return X and X' after spans (s) of the response from rest to exp(i frequency tau)."""
    root = -decay + 1j * np.asarray(damped)
    drive = 1j * np.asarray(frequency)
    near = np.where(decay * spans < _LOST, spans, 0.0)
    free = np.exp(root * near)
    parts = []
    for eigenvalue, factor in ((root, free), (root.conjugate(), free.conjugate())):
        apart = drive - eigenvalue
        # So close to resonance the quotient is the same, and its parts may not be finite.
        close = np.abs(apart) < _RESONANT
        grown = factor * np.expm1(apart * near)
        if (near != spans).any():
            grown = np.where(near < spans, np.exp(drive * spans), grown)
        if close.any():
            quotient = grown / np.where(close, 1.0, apart)
            parts.append(np.where(close, spans * factor, quotient))
        else:
            parts.append(grown / apart)
    x = (parts[0] - parts[1]) / (2j * np.asarray(damped))
    return x, root * x + parts[1]
