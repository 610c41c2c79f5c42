# SPDX-License-Identifier: Apache-2.0
"""Results as JSON has them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import is_dataclass
from enum import Enum
from typing import Any


def as_plain(value: Any, without: Collection[str] = ()) -> Any:
    """
    Return a value in types of JSON: None for a number that is not finite.

    Of what has no `as_dict` of its own, records, tuples with names, mappings and rows of an array
    are objects, without some of their fields.
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
    if isinstance(value, tuple | list):
        return [as_plain(entry, without) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
