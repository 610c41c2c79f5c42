"""
Published numbers and texts of a rig: joint states, impacts and snapshots.

Node, recorder and replay use the same functions, so that their numbers agree to the last bit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .event import Event, Sample

JOINTS = ('primary', 'damper', 'stop_1', 'stop_2')
IMPACT_JOINTS = JOINTS[:2]
#: Format of the messages, which the snapshots name. In format 1 all positions counted from the
#: static equilibrium of M, and the stops had the velocity of M.
FORMAT = 2

#: Frame of the joint states of a rig that is held, which are no samples of its motion.
PAUSED_FRAME = 'paused'

_Numbers = tuple[float, ...]


def state_numbers(
    sample: Sample, deflection: float, version: int = FORMAT
) -> tuple[_Numbers, _Numbers]:
    """
    Return the published positions and velocities of `JOINTS` from a sample.

    Positions count from M with an unloaded spring, which no change of the rig moves; `deflection`
    is the static deflection of the rig, m.
    """
    _, x, velocity, z, damper_velocity, stop_1, stop_2, velocity_1, velocity_2 = sample
    if version == 1:
        return (x, z, stop_1, stop_2), (velocity, damper_velocity, velocity, velocity)
    return (
        (x + deflection, z + deflection, stop_1 + deflection, stop_2 + deflection),
        (velocity, damper_velocity, velocity_1, velocity_2),
    )


def impact_numbers(
    event: Event, deflection: float, version: int = FORMAT
) -> tuple[_Numbers, _Numbers, _Numbers]:
    """
    Return the published positions, velocities and efforts of `IMPACT_JOINTS` from an impact.

    The velocities are those after the impact, the efforts the impulses on M and m. The parameters
    are those of `state_numbers`.
    """
    impulse = event.impulse if event.stop == 1 else -event.impulse
    x, z = event.x, event.x + event.y
    if version > 1:
        x, z = x + deflection, z + deflection
    return (
        (x, z),
        (event.primary_velocity_after, event.damper_velocity_after),
        (impulse, -impulse),
    )


def snapshot_text(offset_ns: int, time_ns: int, reason: str, state: Mapping[str, Any]) -> str:
    """Return the text of a snapshot, from which a run continues bit for bit."""
    return json.dumps(
        {
            'format': FORMAT,
            'stamp_offset_ns': offset_ns,
            'time_ns': time_ns,
            'reason': reason,
            'state': state,
        }
    )
