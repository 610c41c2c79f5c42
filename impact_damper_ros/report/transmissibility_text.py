# SPDX-License-Identifier: Apache-2.0
"""The transmissibility of a rig in words, with and without its damper."""

from __future__ import annotations

from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.parameters.rig_parameters import RigParameters

#: Names of the fields of a `Transmissibility`; X counts from a fixed place.
TRANSMISSIBILITY_NAMES = ('rms X/rms b', 'rms (X - b)/rms b', "rms X''/rms b''")


def transmissibility_text(found: Transmissibility, rig: RigParameters) -> str:
    """Return the transmissibility of a rig in a line."""
    alone = Transmissibility.without_damper(rig)
    parts = [
        f'{name} {value:.6g} ({without:.6g} without the damper)'
        for name, value, without in zip(TRANSMISSIBILITY_NAMES, found, alone, strict=True)
    ]
    return f'transmissibility: {"; ".join(parts)}'
