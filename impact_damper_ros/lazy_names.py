# SPDX-License-Identifier: Apache-2.0
"""Names that a folder offers and that are imported when they are first used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(folder: str, modules: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a folder whose modules define these names."""
    home = {name: module for module, names in modules.items() for name in names}

    def find(name: str) -> Any:
        if name not in home:
            raise AttributeError(f'module {folder!r} has no attribute {name!r}')
        return getattr(import_module(f'{folder}.{home[name]}'), name)

    return find
