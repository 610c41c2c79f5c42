# SPDX-License-Identifier: Apache-2.0
"""
Restitution, friction and gap from the jumps of M alone, by a robust linear regression.

The equations of the flights from stop to stop are linear in these (`orbits.flight_regressors`): no
start value is needed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.flight_regressors import flight_regressors

from .impact_search import PENALTY, Jumps
from .unknowns import Unknowns
from .vibration import Array

_ROUNDS = 60
#: Deviations of jumps are at most so many times their median.
_DEVIATIONS = 1.5
#: R and friction of most rigs, with deviations: in a regular motion either explains the other.
_LIKELY, _APART, _USUAL_FRICTION, G = 0.6, 0.25, 0.1, 9.81


class FirstGuess(NamedTuple):
    """
    Alpha of both stops, friction (m/s^2) and gap (m), and what the laws save.

    Flights whose laws hold save the penalty for an impact, less the squares of their deviations.
    """

    alphas: Array
    grip: float
    gap: float
    saved: float


def regress(unknowns: Unknowns, jumps: Jumps, stops: NDArray[np.int64], rate: float) -> FirstGuess:
    """Return the parameters of m from flights from stop to stop."""
    ratio = unknowns.rig.primary_mass / unknowns.rig.damper_mass
    span = np.diff(jumps.time)
    direction = -stops[:-1]
    push = unknowns.slope + direction * unknowns.air
    transit = stops[1:] != stops[:-1]
    z = jumps.velocity[:-1] - ratio * jumps.jump[:-1]
    laws = flight_regressors(jumps.time, jumps.jump, stops, direction)
    size = 2 if unknowns.separate else 1
    at_stop = [stops == 1, stops == -1] if unknowns.separate else [np.ones(len(stops), bool)]
    alphas = [laws[..., 0] * own[:-1, None] + laws[..., 1] * own[1:, None] for own in at_stop]
    columns = np.stack([*alphas, laws[..., 2], laws[..., 3]], axis=-1)
    matrix = np.vstack([columns[:, 0], rate * columns[:, 1]])[np.tile(transit, 2)]
    wanted = -np.concatenate(
        [
            z + push * span - jumps.velocity[1:],
            rate * (z * span + 0.5 * push * span**2 - np.diff(jumps.x)),
        ]
    )[np.tile(transit, 2)]
    likely = unknowns.alpha(_LIKELY)
    usual = np.array([*[likely] * size, 0.0])
    apart = np.array([*[likely * _APART / (1.0 + _LIKELY)] * size, _USUAL_FRICTION * G])
    slides = unknowns.normal > 0.0
    weight, spread = np.ones(len(wanted)), 0.0
    found = np.zeros(size + 2)
    for _ in range(_ROUNDS):
        if not slides:
            matrix[:, size] = 0.0  # so that least squares give no friction
        prior = np.eye(size + 1, size + 2) * spread / apart[:, None]
        found = np.linalg.lstsq(
            np.vstack([matrix * weight[:, None], prior]),
            np.concatenate([wanted * weight, prior[:, :-1] @ usual]),
            rcond=None,
        )[0]
        slides = slides and found[size] > 0.0
        left = matrix @ found - wanted
        spread = 1.4826 * np.median(np.abs(left)) + 1e-12 * rate
        weight = 1.0 / (1.0 + (left / (2.0 * spread)) ** 2)
    alpha = np.clip(found[:size], unknowns.alpha(1.0), None)
    # What the errors of the jumps at both ends do to a law
    both = np.hypot(jumps.deviation[1:], jumps.deviation[:-1])[transit]
    both = np.minimum(both, _DEVIATIONS * np.sqrt(2.0) * np.median(jumps.deviation))
    squares = (left.reshape(2, -1) / ((alpha.max() + ratio) * both)) ** 2
    saved = float(np.maximum(PENALTY - squares.sum(axis=0), 0.0).sum())
    grip, gap = max(float(found[-2]), 0.0), abs(float(found[-1]))
    return FirstGuess(np.resize(alpha, 2), grip, gap, saved)
