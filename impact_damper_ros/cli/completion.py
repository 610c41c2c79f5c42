# SPDX-License-Identifier: Apache-2.0
"""Shell completion: options, presets and files, by argcomplete."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from typing import Any

from impact_damper_ros.parameters.parameters_file import presets


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a request of the shell for completion, and end; return if there is none."""
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
    }
    for action in parser._actions:
        if action.metavar in completers:
            action.completer = completers[action.metavar]  # type: ignore[attr-defined]
    autocomplete(parser, default_completer=SuppressCompleter())
