# SPDX-License-Identifier: Apache-2.0
"""
States of the control: what their numbers are, and how a snapshot holds them.

A state is a dataclass of numbers with `KINDS`: by name of the entry in a
snapshot, what its numbers are. NaN stands for what is not known; a snapshot holds None for it.
Fields that a snapshot holds as one list are named in `LISTS`; a list of NaN is empty there.
"""

from __future__ import annotations

from dataclasses import fields
from math import nan
from typing import Any, TypeAlias, TypeVar

LENGTH, SPEED, TIME = 'length', 'speed', 'time'
#: What the numbers of a state are, by entry; of a list by its index, where its items differ.
Kinds: TypeAlias = dict[str, str | tuple[str, ...]]
#: Fields of each list.
Lists: TypeAlias = dict[str, tuple[str, ...]]

S = TypeVar('S')


def _lists(state: Any) -> Lists:
    lists: Lists = getattr(state, 'LISTS', {})
    return lists


def _is_nan(value: Any) -> bool:
    return bool(value != value)


def as_stored(state: Any) -> dict[str, Any]:
    """Return a state as a snapshot holds it."""
    lists = _lists(state)
    entries = {name: entry for entry, names in lists.items() for name in names}
    stored: dict[str, Any] = {}
    for field in fields(state):
        entry = entries.get(field.name, field.name)
        if entry in lists:
            values = [getattr(state, name) for name in lists[entry]]
            stored[entry] = [] if all(map(_is_nan, values)) else values
        else:
            value = getattr(state, field.name)
            stored[entry] = None if _is_nan(value) else value
    return stored


def read_stored(cls: type[S], stored: dict[str, Any]) -> S:
    """
    Read a result of `as_stored`; an entry that it lacks is that of a state at the start.

    Raises
    ------
    TypeError
        If it has an entry that the state does not have, or a list of another length.
    """
    lists = _lists(cls)
    values: dict[str, Any] = {}
    for entry, value in stored.items():
        if entry in lists:
            names = lists[entry]
            items = value or [nan] * len(names)
            if len(items) != len(names):
                raise TypeError(f'{entry} has {len(items)} entries, not {len(names)}')
            values.update(zip(names, items, strict=True))
        else:
            values[entry] = nan if value is None else value
    return cls(**values)
