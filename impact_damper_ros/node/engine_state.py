# SPDX-License-Identifier: Apache-2.0
"""Requests of other threads to the engine, and its state as they read it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from enum import Enum
from typing import Any, NamedTuple, TypeAlias

from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters

from .external_control import ControllerStatus
from .pacing import ORDINARY, PacingCounts


class NotNowError(Exception):
    """A request that the engine cannot carry out in the present state."""


class Done(NamedTuple):
    """A request that was carried out: rig time at which it took effect, and its result."""

    time_ns: int
    result: Any = None


#: A request to the engine; it fails with the reason why it had no effect.
Request: TypeAlias = 'Future[Done]'

#: Longest wait for the engine.
ANSWER_TIMEOUT_S = 10.0


def wait_for(request: Request) -> Done:
    """Return the answer to a request, and withdraw the request if that takes too long."""
    try:
        return request.result(ANSWER_TIMEOUT_S)
    except TimeoutError:
        withdrawn = request.cancel()
        if not withdrawn and request.done():
            return request.result()
        rest = 'the request is withdrawn' if withdrawn else 'it is still being carried out'
        text = f'the rig has not answered within {ANSWER_TIMEOUT_S:g} s: {rest}'
        raise NotNowError(text) from None


class Running(Enum):
    """Whether the rig moves, and until when."""

    ON = 'on'
    STEP = 'step'
    PAUSED = 'paused'
    HELD = 'held'


class Step(NamedTuple):
    """A step of a paused rig: whether its end is reached, and the request that waits for it."""

    reached: Callable[[], bool]
    ended: Request


class State(NamedTuple):
    """Whether the rig moves, and if not, why."""

    running: Running = Running.ON
    held: str = ''  # the reason why it cannot continue
    after: Running = Running.ON  # the state of a held rig once it can continue
    step: Step | None = None

    @property
    def moves(self) -> bool:
        """Whether the rig moves."""
        return self.running in (Running.ON, Running.STEP)

    @property
    def paused(self) -> bool:
        """Whether the rig is paused, or will be once it can continue."""
        return Running.PAUSED in (self.running, self.after)


ON, PAUSED = State(), State(Running.PAUSED)


class EngineStatus(NamedTuple):
    """State of the engine, for other threads; all numbers are counted from its start."""

    time_ns: int
    paused: bool
    mode: str
    impacts: int
    recorded: int  # messages given to the recording
    pacing: PacingCounts
    control: GapControlParameters = GapControlParameters()
    commands: int = 0  # commands of the gap control
    last_act: ControlAct | None = None
    scheduling: str = ORDINARY
    held: str = ''  # the reason why the rig cannot continue
    events: int = 0  # impacts among them
    controller: ControllerStatus = ControllerStatus()
