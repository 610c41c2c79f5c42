# SPDX-License-Identifier: Apache-2.0
"""Results in types of JSON, and the differences between two of them."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import is_dataclass
from enum import Enum
from typing import Any


def as_plain(value: Any, without: Collection[str] = ()) -> Any:
    """
    Return a value in types of JSON: None for a number that is not finite, a complex one as a pair.

    Records, named tuples, mappings and rows of an array become objects, without the fields in
    `without`; a method `as_dict` decides for its class.
    """
    if isinstance(value, Enum):
        return value.value
    if hasattr(value, 'as_dict'):
        return as_plain(value.as_dict(), without)
    if is_dataclass(value) and not isinstance(value, type):
        value = vars(value)
    elif hasattr(value, '_asdict'):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(k): as_plain(v, without) for k, v in value.items() if k not in without}
    if names := getattr(getattr(value, 'dtype', None), 'names', None):
        return [as_plain(dict(zip(names, row, strict=True)), without) for row in value.tolist()]
    if hasattr(value, 'tolist'):
        value = value.tolist()
    if isinstance(value, complex):
        value = [value.real, value.imag]
    if isinstance(value, tuple | list):
        return [as_plain(entry, without) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(result: Any) -> str:
    """Return a result as JSON, see `as_plain`."""
    return json.dumps(as_plain(result), indent=1, allow_nan=False) + '\n'


def differences(
    there: Mapping[str, Any], here: Mapping[str, Any], path: str = ''
) -> list[tuple[str, Any, Any]]:
    """
    Return name and both values where two objects of JSON differ, None where one is missing.

    Values are compared as JSON writes them: 0.0 differs from -0.0, and 1 from 1.0.
    """
    found: list[tuple[str, Any, Any]] = []
    for name in {**here, **there}:
        one, other = there.get(name), here.get(name)
        if isinstance(one, dict) and isinstance(other, dict):
            found += differences(one, other, f'{path}{name}.')
        elif json.dumps(one) != json.dumps(other):
            found.append((f'{path}{name}', one, other))
    return found
