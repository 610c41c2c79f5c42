# SPDX-License-Identifier: Apache-2.0
"""Shell completion: options, presets, files, and parameters with their values, by argcomplete."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from typing import Any

from impact_damper_ros.parameters.parameters_file import presets
from impact_damper_ros.parameters.rig_parameters import ALL_SPECS


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks how a command goes on, and end; return if none does."""
    if '_ARGCOMPLETE' not in os.environ:
        return
    from argcomplete import autocomplete
    from argcomplete.completers import FilesCompleter, SuppressCompleter

    files = FilesCompleter()

    def rigs(prefix: str, **_: Any) -> list[str]:
        return [*presets(), *files(prefix)]

    completers: dict[Any, Callable[..., Any]] = {
        **dict.fromkeys(('BAG', 'DIR', 'FILE'), files),
        'PARAMS': rigs,
        **{f'NAME={value}': _settings('=') for value in ('VALUE', 'RANGE', 'LOW:HIGH')},
        'NAME:=VALUE': _settings(':='),
    }
    for action in parser._actions:
        if action.metavar in completers:
            action.completer = completers[action.metavar]  # type: ignore[attr-defined]
    autocomplete(parser, default_completer=SuppressCompleter())


def _settings(sign: str) -> Callable[..., list[str]]:
    """Return a completer of parameters, and after the sign of the values that one of them has."""

    def completer(prefix: str, **_: Any) -> list[str]:
        name = prefix.partition(sign)[0]
        if name == prefix:
            return [f'{name}{sign}' for name in ALL_SPECS]
        spec = ALL_SPECS.get(name)
        values = () if spec is None else spec.choices
        if spec is not None and spec.kind == 'bool':
            values = ('true', 'false')
        return [f'{name}{sign}{value}' for value in values]

    return completer
