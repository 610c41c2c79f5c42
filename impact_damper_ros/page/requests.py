# SPDX-License-Identifier: Apache-2.0
"""
The requests that a page may send, read from JSON.

`static/messages.d.ts` has the same, and the messages to the page, as types; a test compares them.
"""

from __future__ import annotations

import json
import math
from typing import Any

from impact_damper_ros.parameters.quoting import quote

#: Fields of each request, and their types in words.
REQUESTS = {
    'view': {'window': 'a number', 'rate': 'a number'},
    'set': {'values': 'an object'},
    'begin': {'values': 'an object'},
    'service': {'name': 'a text'},
    'structure': {'values': 'an object'},
    'compare': {'recording': 'a text', 'on': 'true or false'},
    'play': {'speed': 'a number'},
    'seek': {'time': 'a number'},
    'jump': {'to': 'a text', 'direction': 'a number'},
    'what_if': {'values': 'an object or null'},
}
_KINDS: dict[str, tuple[type, ...]] = {
    'a number': (int, float),
    'a text': (str,),
    'an object': (dict,),
    'true or false': (bool,),
    'an object or null': (dict, type(None)),
}
#: Longest identifier of a request.
_LONGEST_ID = 80


class RequestError(Exception):
    """A request of a page that is rejected; the message is for its user."""


def _refuse(name: str) -> float:
    raise ValueError(f'{name} is not a number in JSON')


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f'{text[:40]} is too large for a number')
    return value


def _whole(text: str) -> int | float:
    _finite(text)
    return int(text)


def read_json(text: str | bytes) -> dict[str, Any]:
    """Return the object of a message; RequestError if it is none."""
    try:
        message = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except (RecursionError, ValueError) as error:
        raise RequestError(f'the message cannot be read: {error}') from None
    if not isinstance(message, dict):
        raise RequestError('a message must be a JSON object with a type')
    return message


def identity_of(message: dict[str, Any]) -> int | str | None:
    """Return the identifier with which a request is answered; None if it has none."""
    identity = message.get('id')
    known = isinstance(identity, int | str) and len(str(identity)) <= _LONGEST_ID
    return identity if known else None


def check_request(message: dict[str, Any]) -> None:
    """Raise a RequestError unless a message is one of the `REQUESTS`."""
    kind = message.get('type')
    if not isinstance(kind, str) or kind not in REQUESTS:
        raise RequestError(f'{quote(kind)} is no request: give one of {", ".join(REQUESTS)}')
    for name, wanted in REQUESTS[kind].items():
        if name not in message:
            raise RequestError(f'{kind} has no {name}: give {wanted}')
        value = message[name]
        is_flag = isinstance(value, bool) and wanted != 'true or false'
        if is_flag or not isinstance(value, _KINDS[wanted]):
            raise RequestError(f'{name} of {kind} is {quote(value)}: give {wanted}')
