# SPDX-License-Identifier: Apache-2.0
"""
A client of a rig's services and parameters, which is polled.

It needs no executor: its user polls it now and then and takes the answers; `call` polls until an
answer comes.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from math import inf
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.rig_parameters import base_quantity_of

from .raw_subscription import Polled

#: Time after which a request is repeated, since its answer may have been lost during discovery, s;
#: it doubles each time.
ASK_AGAIN_S = 1.0
#: Interval at which `call` polls, s.
LOOK_S = 0.002
#: A node discovers the clients in their order: once it has answered the last, it can answer all.
LAST = 'get_parameters'
SERVICES = {
    'pause': SetBool,
    'reset': Trigger,
    'step': Trigger,
    'step_to_impact': Trigger,
    'set_parameters_atomically': SetParametersAtomically,
    'list_parameters': ListParameters,
    LAST: GetParameters,
}
#: Services of the parameters.
PARAMETERS = {key: kind for key, kind in SERVICES.items() if 'parameters' in key}


@dataclass
class _Request:
    """A request whose answer is awaited."""

    content: Any
    answer: Future[Any]
    due: float = 0.0  # time at which it is sent, or sent again
    pause: float = 0.0
    sent: int = 0


class _Service:
    """One service; its requests are sent, and their answers taken, by `poll`."""

    def __init__(self, node: Node, kind: Any, name: str) -> None:
        self.name, self.kind = name, kind
        self._node = node
        self._client = node.create_client(kind, name, callback_group=Polled())
        self._requests: list[_Request] = []
        self._numbers: dict[int, _Request] = {}

    @property
    def ready(self) -> bool:
        return bool(self._client.service_is_ready())

    def ask(self, content: Any) -> Future[Any]:
        request = _Request(content, Future(), pause=ASK_AGAIN_S)
        self._requests.append(request)
        return request.answer

    def poll(self, *, repeated: bool) -> bool:
        """Take answers, then send due requests; return whether an answer has come."""
        answered = False
        handle = self._client.handle
        with handle:
            while self._numbers:
                header, content = handle.take_response(self.kind.Response)
                if header is None:
                    break
                answered = True
                request = self._numbers.pop(header.request_id.sequence_number, None)
                if request is not None and not request.answer.done():
                    request.answer.set_result(content)
        self._requests = [one for one in self._requests if not one.answer.done()]
        for request in self._requests:
            if request.sent and not repeated:
                request.due = inf
            if time.monotonic() >= request.due and self.ready:
                with handle:
                    self._numbers[handle.send_request(request.content)] = request
                request.sent += 1
                request.due = time.monotonic() + request.pause
                request.pause *= 2.0
        self._numbers = {n: one for n, one in self._numbers.items() if not one.answer.done()}
        return answered

    def is_sent(self, answer: Future[Any]) -> bool:
        return any(one.answer is answer and one.sent for one in self._requests)

    def begin_again(self, *, repeated: bool) -> None:
        """Send requests to a new node; a request that was sent and must not be repeated fails."""
        for request in self._requests:
            if repeated:
                request.due, request.sent = 0.0, 0
            elif request.sent and not request.answer.done():
                reason = 'the node was started again before its answer'
                request.answer.set_exception(TimeoutError(reason))

    def close(self) -> None:
        for request in self._requests:
            request.answer.cancel()
        self._node.destroy_client(self._client)


class RigClient:
    """
    The services and parameters of one rig, or of any node.

    `LAST`, which changes nothing, is sent again until the rig has answered this client once, as
    earlier answers are lost. All other requests follow that answer, and are sent once: a repeated
    step would be made twice, and a repeated change would undo that of another client.
    """

    def __init__(self, node: Node, name: str, services: Mapping[str, Any] = SERVICES) -> None:
        self.name = name
        self._services = {key: _Service(node, k, f'{name}/{key}') for key, k in services.items()}
        #: Whether the answers of the rig reach this client
        self.answers = False

    @property
    def ready(self) -> bool:
        """Whether all services are there."""
        return all(service.ready for service in self._services.values())

    def ask(self, key: str, **fields: Any) -> Future[Any]:
        """Request a service; `poll` takes the answer."""
        service = self._services[key]
        return service.ask(service.kind.Request(**fields))

    def call(self, key: str, patience_s: float, **fields: Any) -> Any:
        """Request a service, and wait for the answer; a TimeoutError if none comes."""
        if key != LAST and not self.answers:
            self.call(LAST, patience_s, names=[])
        answer, end = self.ask(key, **fields), time.monotonic() + patience_s
        while not answer.done():
            if time.monotonic() > end:
                raise TimeoutError(f'{self.name} does not answer')
            self.poll()
            time.sleep(LOOK_S)
        return answer.result()

    def poll(self) -> None:
        """Send due requests, and take the answers that have come."""
        for key, service in self._services.items():
            repeated = key == LAST and not self.answers
            self.answers |= service.poll(repeated=repeated) and key == LAST

    def may_be_made(self, key: str, answer: Future[Any]) -> bool:
        """Return whether an unanswered request may have changed something."""
        reading = key in ('list_parameters', LAST)
        return not reading and self._services[key].is_sent(answer)

    def begin_again(self) -> None:
        """Expect no answer of the old node: a new one has its name."""
        self.answers = False
        for key, service in self._services.items():
            service.begin_again(repeated=key == LAST)

    def close(self) -> None:
        """Give up all requests."""
        for service in self._services.values():
            service.close()


def parameter_messages(values: Mapping[str, Any]) -> list[Any]:
    """Return messages that set values; ParameterError for a value that no rig can have."""
    messages = []
    # The node gets a number in SI, not the text 0.5 mm.
    if quantity := base_quantity_of(values.get('base_amplitudes')):
        values = {**values, 'base_quantity': quantity}
    for name, value in values.items():
        checked = ALL_SPECS[name].check(value)
        given = list(checked) if isinstance(checked, tuple) else checked
        messages.append(Parameter(name, value=given).to_parameter_msg())
    return messages


def plain_values(names: Iterable[str], values: Iterable[Any]) -> dict[str, Any]:
    """Return values from messages as those of Python, by name."""
    python = map(parameter_value_to_python, values)
    plain = (v if isinstance(v, bool | int | float | str) else list(v or ()) for v in python)
    return dict(zip(names, plain, strict=False))
