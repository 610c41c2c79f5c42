# SPDX-License-Identifier: Apache-2.0
"""Names that a folder offers and that are imported when they are first used."""

from __future__ import annotations

TYPE_CHECKING = False

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any


def lazy_names(
    folder: str, modules: Mapping[str, str]
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a folder, by the names in its modules."""
    home = {name: module for module, names in modules.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in home:
            raise AttributeError(f'module {folder!r} has no attribute {name!r}')
        from importlib import import_module

        return getattr(import_module(f'{folder}.{home[name]}'), name)

    return sorted(home), find, lambda: sorted(home)
