"""What the engine says of itself to other threads."""

from __future__ import annotations

from typing import NamedTuple

from impact_damper_ros.control import ControlRecord, GapControlParameters
from impact_damper_ros.nodes.pacing import PacingCounts
from impact_damper_ros.nodes.scheduling import ORDINARY

__all__ = ['ControlStatus', 'EngineStatus', 'Load']


class ControlStatus(NamedTuple):
    """What the gap control is about: its parameters, acts so far, and the last one of them."""

    parameters: GapControlParameters = GapControlParameters()
    commands: int = 0
    last: ControlRecord | None = None


class Load(NamedTuple):
    """
    What the rig has the engine do.

    Attributes
    ----------
    events : int
        Events so far, impacts among them.
    busy_ns : int
        Computing time of the engine's thread so far.
    fastest : float
        Circular frequency of the fastest of spring and harmonics, rad/s.
    harmonics : int
        How many the force has.
    """

    events: int = 0
    busy_ns: int = 0
    fastest: float = 0.0
    harmonics: int = 1


class EngineStatus(NamedTuple):
    """A look at the engine from another thread; `held` says why the rig cannot go on."""

    time_ns: int
    paused: bool
    mode: str
    impacts: int
    recorded: int
    pacing: PacingCounts
    control: ControlStatus = ControlStatus()
    scheduling: str = ORDINARY
    held: str = ''
    load: Load = Load()
