# SPDX-License-Identifier: Apache-2.0
"""
Mass dampers of the same mass, and their comparison with an impact damper.

References
----------
1. J. P. Den Hartog, "Mechanical Vibrations", 4th ed., 1956, section 3.3: a mass on a spring and a
   dashpot, tuned to 1/(1 + mu), so that both fixed points of the response have the same height,
   and damped so that both are maxima.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impact_damper_ros.orbits.transmissibility import dynamic_stiffness
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .runs_from_rest import Array, bare_amplitudes, largest_in_short

#: Damping ratio of a mass damper that is tuned to one sine: a steel spring without a dashpot.
_SPRING_DAMPING = 0.005
#: Frequencies, as factors, and how many of them; levels of the band, and of the longer range.
_BAND, _FREQUENCIES, _LEVELS, _LEVEL_RANGE, _COMPARED_LEVELS = (0.75, 1.25), 101, 5, 4.0, 97


class Tuning(NamedTuple):
    """
    The tuning of a mass damper.

    Attributes
    ----------
    frequency : float
        Natural circular frequency of the mass damper, rad/s.
    zeta : float
        Damping ratio of the mass damper.
    """

    frequency: float
    zeta: float


def den_hartog(rig: RigParameters) -> Tuning:
    """Return Den Hartog's tuning, for all frequencies near that of M."""
    mu = rig.mass_ratio
    return Tuning(rig.omega / (1.0 + mu), math.sqrt(3.0 * mu / (8.0 * (1.0 + mu))))


def tuned_to_excitation(rig: RigParameters) -> Tuning:
    """Return the tuning for the one frequency of the excitation."""
    return Tuning(rig.first_harmonic[1], _SPRING_DAMPING)


def mass_damper_response(rig: RigParameters, tuning: Tuning, frequencies: Array) -> Array:
    """
    Return the amplitude of X of a rig with a mass damper in place of its impact damper, m.

    Parameters
    ----------
    rig : RigParameters
        The rig; its first harmonic shakes it, of a force or of the base.
    tuning : Tuning
        The tuning of the mass damper.
    frequencies : ndarray
        Circular frequencies, rad/s.
    """
    m, own = rig.damper_mass, tuning.frequency
    link = m * own**2 + 2.0j * frequencies * m * own * tuning.zeta
    inertia = -m * frequencies**2
    # Dynamic stiffness of the mass on its spring, which acts on M
    reaction = inertia * link / (inertia + link)
    force = np.array([abs(rig.with_first_frequency(w).first_harmonic[0]) for w in frequencies])
    response: Array = force / np.abs(dynamic_stiffness(rig, frequencies) + reaction)
    return response


class Comparison(NamedTuple):
    """
    Comparison of an impact damper from rest with no damper, and with two mass dampers.

    Attributes
    ----------
    frequencies : ndarray, shape (n,)
        Circular frequencies, rad/s.
    levels : ndarray, shape (k,)
        Levels as factors, between those in which the excitation may be.
    bare, den_hartog, tuned : ndarray, shape (n,)
        Amplitude of X without a damper, with a mass damper of Den Hartog's tuning, and with one
        that is tuned to the excitation, m.
    damper : ndarray, shape (k, n)
        Largest |X| with the impact damper over the level, m.
    level_range, level_ratios : ndarray
        Levels over a longer range, and the largest |X| at these over that without the damper.
    """

    frequencies: Array
    levels: Array
    bare: Array
    den_hartog: Array
    tuned: Array
    damper: Array
    level_range: Array
    level_ratios: Array


def compare_dampers(rig: RigParameters, low: float, high: float) -> Comparison:
    """
    Return the comparison of an impact damper with mass dampers.

    Parameters
    ----------
    rig : RigParameters
        The structure with its impact damper.
    low, high : float
        Levels, as factors, between which the excitation may be.
    """
    frequencies = rig.first_harmonic[1] * np.linspace(*_BAND, _FREQUENCIES)
    levels = np.unique([*np.geomspace(low, high, _LEVELS), 1.0])
    band = {
        'level': np.repeat(levels, len(frequencies)),
        'frequency': np.tile(frequencies, len(levels)),
    }
    sizes = largest_in_short(rig, band)[0] / band['level']
    longer = np.geomspace(min(low, 1.0 / _LEVEL_RANGE), max(high, _LEVEL_RANGE), _COMPARED_LEVELS)
    along = {'level': longer}
    return Comparison(
        frequencies,
        levels,
        bare_amplitudes(rig, {'frequency': frequencies}),
        mass_damper_response(rig, den_hartog(rig), frequencies),
        mass_damper_response(rig, tuned_to_excitation(rig), frequencies),
        sizes.reshape(len(levels), len(frequencies)),
        longer,
        largest_in_short(rig, along)[0] / bare_amplitudes(rig, along),
    )
