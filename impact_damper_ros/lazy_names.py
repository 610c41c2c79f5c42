# SPDX-License-Identifier: Apache-2.0
"""Names that a folder offers and that are imported when they are first used."""

from __future__ import annotations

TYPE_CHECKING = False

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any


def lazy_names(
    folder: str, file: str
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__`, by the imports that type checkers see."""
    home, module = {}, ''
    with open(file, encoding='utf-8') as text:  # noqa: PTH123 - pathlib takes longer than all else
        for line in text:
            words = line.translate({ord(mark): ' ' for mark in '(),'}).split()
            if words[:1] == ['from']:
                module = words[1]
            for name, word, again in zip(words, words[1:], words[2:], strict=False):
                if word == 'as' and name == again:
                    home[name] = module

    def find(name: str) -> Any:
        if name not in home:
            raise AttributeError(f'module {folder!r} has no attribute {name!r}')
        from importlib import import_module

        return getattr(import_module(home[name], folder), name)

    return sorted(home), find, lambda: sorted(home)
