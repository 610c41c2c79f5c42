"""Checks of what callers of the library give it, by the name of the argument."""

from __future__ import annotations

import os
from collections.abc import Mapping
from math import inf, nan
from pathlib import Path
from typing import Any

from .quoting import shown


def need(kind: type | tuple[type, ...], *, or_none: bool = False, **given: object) -> None:
    """
    Raise TypeError for the first argument that is not of a kind.

    Examples
    --------
    >>> need(str, name='/sim_node', node=5)
    Traceback (most recent call last):
    TypeError: node is 5: give a str
    """
    for name, value in given.items():
        if isinstance(value, kind) or (or_none and value is None):
            continue
        kinds = kind if isinstance(kind, tuple) else (kind,)
        names = ' or '.join([*(one.__name__ for one in kinds), *(['None'] if or_none else [])])
        article = 'an' if names[0] in 'AEIOUaeiou' else 'a'
        raise TypeError(f'{name} is {shown(value)}: give {article} {names}')


def need_call(*, or_none: bool = False, **given: object) -> None:
    """Raise TypeError for the first argument that cannot be called."""
    for name, value in given.items():
        if not callable(value) and not (or_none and value is None):
            raise TypeError(
                f'{name} is {shown(value)}: give a function{" or None" if or_none else ""}'
            )


def as_float(value: Any) -> float:
    """
    Return a number as a float, one too large as infinity, and NaN for what is no number.

    A float32 would otherwise have its few digits in all that is computed with it.
    """
    try:
        return float(value) if hasattr(value, '__float__') else nan
    except (TypeError, ValueError):
        return nan
    except OverflowError:
        return inf if value > 0 else -inf


def path_of(name: str, value: object) -> Path:
    """Return an argument that names a file or directory as a path."""
    if not isinstance(value, str | os.PathLike) or isinstance(os.fspath(value), bytes):
        raise TypeError(f'{name} is {shown(value)}: give a path')
    path = Path(value)
    if '\0' in str(path):
        raise ValueError(f'{name} is {shown(value)}: no path holds a null character')
    return path


def texts_of(name: str, value: Mapping[str, str] | None) -> dict[str, str]:
    """Return a mapping of texts, of None an empty one."""
    need(Mapping, or_none=True, **{name: value})
    texts = dict(value or {})
    for key, text in texts.items():
        if not isinstance(key, str) or not isinstance(text, str):
            raise TypeError(f'{name} holds {shown(key)}: {shown(text)}: give texts')
    return texts
