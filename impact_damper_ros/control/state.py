# SPDX-License-Identifier: Apache-2.0
"""States of the control, which are dataclasses of numbers, as a snapshot holds them."""

from __future__ import annotations

from dataclasses import fields
from math import nan
from typing import Any, TypeVar

S = TypeVar('S')


def as_stored(state: Any) -> dict[str, Any]:
    """Return a state as a snapshot holds it: None for NaN, which stands for what is not known."""
    values = {field.name: getattr(state, field.name) for field in fields(state)}
    return {name: None if value != value else value for name, value in values.items()}


def read_stored(cls: type[S], stored: dict[str, Any]) -> S:
    """Read a result of `as_stored`; a TypeError if it has an entry that the class lacks."""
    return cls(**{name: nan if value is None else value for name, value in stored.items()})
