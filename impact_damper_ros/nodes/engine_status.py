"""What the engine says of itself to other threads."""

from __future__ import annotations

from typing import NamedTuple

from impact_damper_ros.control import ControlRecord, GapControlParameters
from impact_damper_ros.nodes.pacing import PacingCounts
from impact_damper_ros.nodes.scheduling import ORDINARY

__all__ = ['ControlStatus', 'EngineStatus']


class ControlStatus(NamedTuple):
    """What the gap control is about: its parameters, acts so far, and the last one of them."""

    parameters: GapControlParameters = GapControlParameters()
    commands: int = 0
    last: ControlRecord | None = None


class EngineStatus(NamedTuple):
    """A look at the engine from another thread."""

    time_ns: int
    paused: bool
    mode: str
    impacts: int
    recorded: int
    pacing: PacingCounts
    control: ControlStatus = ControlStatus()
    scheduling: str = ORDINARY
