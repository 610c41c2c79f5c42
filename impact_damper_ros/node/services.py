# SPDX-License-Identifier: Apache-2.0
"""The services of the node. A reset keeps rig time and the recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from types import coroutine
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from .engine import Engine
from .engine_state import Done, Request, wait_for

#: Longest wait of `~/step` for the end of a step.
STEP_TIMEOUT_S = 2.0


@coroutine
def _turn() -> Generator[None, None, None]:
    """Let the executor serve others first."""
    yield


class RigServices:
    """Serves reset, pause and single steps; `wake` wakes the executor, from any thread."""

    def __init__(self, node: Node, engine: Engine, wake: Callable[[], object]) -> None:
        self._engine, self._wake = engine, wake
        # The callback group of a step, which lets other callbacks begin before its end
        others = ReentrantCallbackGroup()
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Trigger, '~/step', self._on_step, callback_group=others)
        node.create_service(Trigger, '~/step_to_impact', self._on_step_to_impact)

    def _answer(self, response: Any, request: Request, text: str) -> Done | None:
        """Fill in the response to a request; return the result, or None if the request failed."""
        try:
            done = wait_for(request)
        except Exception as error:
            response.success, response.message = False, str(error)
            return None
        response.success = True
        response.message = f'{text}, at rig time {done.time_ns * 1e-9:.9g} s'
        return done

    def _on_reset(self, _request: Any, response: Any) -> Any:
        initial = self._engine.parameters.initial
        where = (
            f'primary at {initial.initial_primary_position:g} m with '
            f'{initial.initial_primary_velocity:g} m/s, damper at '
            f'{initial.initial_damper_offset:g} m in the gap with '
            f'{initial.initial_damper_velocity:g} m/s'
        )
        self._answer(response, self._engine.ask(self._engine.reset), f'reset to {where}')
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        request_ = self._engine.ask(self._engine.pause, request.data)
        done = self._answer(response, request_, 'paused' if request.data else 'running on')
        if done is not None and not done.result:
            response.message = f'was {"paused" if request.data else "running"} already'
        return response

    async def _on_step(self, _request: Any, response: Any) -> Any:
        engine = self._engine
        done = self._answer(
            response, engine.ask(engine.step), 'on the way to the next joint states'
        )
        # The answer comes when the rig is paused again; others are served meanwhile.
        if done is not None and await self._has_ended(done.result):
            self._answer(response, done.result, 'paused after a step')
        return response

    async def _has_ended(self, step: Request) -> bool:
        """Wait for the end of a step up to a limit; return whether it has come."""
        end = time.monotonic() + STEP_TIMEOUT_S
        step.add_done_callback(lambda _: self._wake())
        while not step.done() and time.monotonic() < end:
            await _turn()
        return step.done()

    def _on_step_to_impact(self, _request: Any, response: Any) -> Any:
        # There may be no impact for a long time.
        text = 'running on until after the next impact'
        engine = self._engine
        self._answer(response, engine.ask(engine.step, to_impact=True), text)
        return response
