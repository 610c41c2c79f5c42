# SPDX-License-Identifier: Apache-2.0
"""
The services of the node: those of std_srvs, and of simulation_interfaces where that is installed.

Both ask the engine for the same. Rig time goes on in a reset, as a recording does.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Generator
from importlib import import_module
from types import coroutine
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.parameters.rig_parameters import InitialConditions

from .engine import Done, Engine, Request

if TYPE_CHECKING:
    from .sim_node import SimNode

#: Longest wait of a service call for the engine.
ANSWER_TIMEOUT_S = 10.0
#: Longest wait of `~/step` for the end of a step.
STEP_TIMEOUT_S = 2.0
_NAP_S = 1e-3


@coroutine
def _turn() -> Generator[None, None, None]:
    """Let the executor serve something else first."""
    yield


class RigServices:
    """Serves reset, pause and single steps; `initial` returns where a reset puts the rig."""

    def __init__(
        self, node: SimNode, engine: Engine, initial: Callable[[], InitialConditions]
    ) -> None:
        self._engine, self._initial, self._wake = engine, initial, node.wake
        # In a group of its own, which lets others begin before its end
        others = ReentrantCallbackGroup()
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Trigger, '~/step', self._on_step, callback_group=others)
        node.create_service(Trigger, '~/step_to_impact', self._on_step_to_impact)
        try:
            self._srv = import_module('simulation_interfaces.srv')
            self._msg = import_module('simulation_interfaces.msg')
        except ImportError:
            return
        for name, answer in (
            ('GetSimulatorFeatures', self._on_get_features),
            ('GetSimulationState', self._on_get_state),
            ('SetSimulationState', self._on_set_state),
            ('ResetSimulation', self._on_reset_simulation),
            ('StepSimulation', self._on_step_simulation),
        ):
            kind = getattr(self._srv, name)
            words = ''.join(f'_{c.lower()}' if c.isupper() else c for c in name)
            node.create_service(kind, f'~/{words[1:]}', answer, callback_group=others)

    def _asked(self, request: Request) -> tuple[Done | None, str]:
        """Wait for a request; return what was done and when, or None and why it failed."""
        try:
            done = request.result(ANSWER_TIMEOUT_S)
        except TimeoutError:
            return None, f'the rig has not answered within {ANSWER_TIMEOUT_S:g} s'
        except Exception as error:
            return None, str(error)
        return done, f'at rig time {done.time_ns * 1e-9:.9g} s'

    # std_srvs

    def _answer(self, response: Any, request: Request, text: str) -> Done | None:
        """Fill in the response to a request; return what was done, or None if it failed."""
        done, words = self._asked(request)
        response.success = done is not None
        response.message = f'{text}, {words}' if done is not None else words
        return done

    def _on_reset(self, _request: Any, response: Any) -> Any:
        initial = self._initial()
        where = (
            f'primary at {initial.initial_primary_position:g} m with '
            f'{initial.initial_primary_velocity:g} m/s, damper at '
            f'{initial.initial_damper_offset:g} m in the gap with '
            f'{initial.initial_damper_velocity:g} m/s'
        )
        engine = self._engine
        self._answer(response, engine.ask(engine.reset, initial), f'reset to {where}')
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
        # The caller may rely on the rig being paused again; others are served meanwhile.
        if done is not None and await self._ended(done.result, STEP_TIMEOUT_S):
            self._answer(response, done.result, 'paused after a step')
        return response

    async def _ended(self, step: Request, seconds: float) -> bool:
        """Wait for the end of a step, at most for a time; return whether it has come."""
        end = time.monotonic() + seconds
        step.add_done_callback(lambda _: self._wake())
        while not step.done() and time.monotonic() < end:
            # The engine needs the interpreter as well.
            time.sleep(_NAP_S)
            await _turn()
        return step.done()

    def _on_step_to_impact(self, _request: Any, response: Any) -> Any:
        # There may be none for a long time.
        text = 'running on until after the next impact'
        engine = self._engine
        self._answer(response, engine.ask(engine.step, to_impact=True), text)
        return response

    # simulation_interfaces

    def _result(self, response: Any, error: str, code: int | None = None) -> Any:
        """Fill in the result of a response: an error, or success where there is none."""
        kinds = self._msg.Result
        failed = kinds.RESULT_OPERATION_FAILED if code is None else code
        response.result.result = failed if error else kinds.RESULT_OK
        response.result.error_message = error
        return response

    def _on_get_features(self, _request: Any, response: Any) -> Any:
        kinds = self._msg.SimulatorFeatures
        response.features.features = [
            kinds.SIMULATION_RESET,
            kinds.SIMULATION_RESET_STATE,
            kinds.SIMULATION_STATE_GETTING,
            kinds.SIMULATION_STATE_SETTING,
            kinds.SIMULATION_STATE_PAUSE,
            kinds.STEP_SIMULATION_SINGLE,
            kinds.STEP_SIMULATION_MULTIPLE,
        ]
        response.features.custom_info = 'impact_damper_ros: a step is one message of joint_states'
        return response

    def _on_get_state(self, _request: Any, response: Any) -> Any:
        kinds = self._msg.SimulationState
        paused = self._engine.paused
        response.state.state = kinds.STATE_PAUSED if paused else kinds.STATE_PLAYING
        return self._result(response, '')

    def _on_set_state(self, request: Any, response: Any) -> Any:
        kinds, codes = self._msg.SimulationState, self._srv.SetSimulationState.Response
        target, engine = request.state.state, self._engine
        if target == kinds.STATE_QUITTING:
            # As Ctrl-C does: the answer goes out first, and the bag is finished.
            os.kill(os.getpid(), signal.SIGINT)
            return self._result(response, '')
        if target not in (kinds.STATE_PLAYING, kinds.STATE_PAUSED):
            text = 'the rig is played, paused or quit: its time does not go back to the start'
            return self._result(response, text, self._msg.Result.RESULT_FEATURE_UNSUPPORTED)
        done, words = self._asked(engine.ask(engine.pause, target == kinds.STATE_PAUSED))
        if done is None:
            return self._result(response, words, codes.STATE_TRANSITION_ERROR)
        text = '' if done.result else 'the rig is in that state already'
        return self._result(response, text, codes.ALREADY_IN_TARGET_STATE)

    def _on_reset_simulation(self, request: Any, response: Any) -> Any:
        if request.scope != self._srv.ResetSimulation.Request.SCOPE_STATE:
            text = 'rig time goes on and nothing is spawned: give SCOPE_STATE'
            return self._result(response, text, self._msg.Result.RESULT_FEATURE_UNSUPPORTED)
        done, words = self._asked(self._engine.ask(self._engine.reset, self._initial()))
        return self._result(response, '' if done is not None else words)

    async def _on_step_simulation(self, request: Any, response: Any) -> Any:
        for _ in range(request.steps):
            done, words = self._asked(self._engine.ask(self._engine.step))
            if done is None:
                return self._result(response, words)
            await self._ended(done.result, float('inf'))
            done, words = self._asked(done.result)
            if done is None:
                return self._result(response, words)
        return self._result(response, '')
