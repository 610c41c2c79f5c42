"""
The committed reference runs: 30-digit events of some rigs, read without multiprecision.

A run with a `floor` leaves out the impacts of a chatter slower than it; `kept` applies the same
rule to any other list of events.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

PATH = Path(__file__).with_name('reference.json')


class ReferenceEvent(NamedTuple):
    """
    One event, rounded to double precision; `digits` are the strings of 30 digits it is made of.

    An input error of relative size e moves the time by about e * condition * time, and position
    and velocities by e * state_condition * (their largest value so far).
    """

    kind: str
    stop: int
    time: float
    x: float
    primary_velocity_before: float
    primary_velocity_after: float
    damper_velocity_before: float
    damper_velocity_after: float
    condition: float
    state_condition: float
    digits: tuple[str, ...]


class ReferenceState(NamedTuple):
    """State at an instant between events: positions and velocities of M and m."""

    time: float
    x: float
    primary_velocity: float
    z: float
    damper_velocity: float
    condition: float


@dataclass(frozen=True)
class ReferenceRun:
    """One rig, its events in order, and some states on the way."""

    name: str
    params: dict[str, Any]
    initial: dict[str, float]
    duration: float
    floor: float
    x_scale: float
    v_scale: float
    events: tuple[ReferenceEvent, ...]
    states: tuple[ReferenceState, ...]


def load_reference(path: Path = PATH) -> list[ReferenceRun]:
    """Return all committed runs; the events of a run are complete up to the last one given."""
    runs = []
    for run in json.loads(path.read_text(encoding='utf-8'))['runs']:
        events = tuple(
            ReferenceEvent(*row[:2], *map(float, row[2:]), tuple(row[2:8]))
            for row in run.pop('events')
        )
        states = tuple(ReferenceState(*map(float, row)) for row in run.pop('states'))
        runs.append(ReferenceRun(events=events, states=states, **run))
    return runs


def kept(kinds: Sequence[str], speeds: Sequence[float], floor: float) -> list[bool]:
    """
    Return which events remain when slow impacts are left out.

    Parameters
    ----------
    kinds : sequence of str
        Of the events, in order.
    speeds : sequence of float
        Relative speed before each impact (of other events: ignored).
    floor : float
        Impacts slower than this go, and with them the reversals that follow each of them.

    """
    mask, skipping = [], False
    for kind, speed in zip(kinds, speeds, strict=True):
        if kind == 'impact':
            skipping = abs(speed) < floor
        elif kind != 'reversal':
            skipping = False
        mask.append(not skipping)
    return mask
