"""CSV tables of impacts and states, the same from every command; 17 digits."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO

from impact_damper_ros.rig import Event, EventKind

IMPACT_COLUMNS = (
    'time',
    'stop',
    'x',
    'primary_velocity_before',
    'primary_velocity_after',
    'damper_velocity_before',
    'damper_velocity_after',
)


def row(values: Sequence[object]) -> str:
    """Return one line; floats keep all their digits."""
    return ','.join(f'{v:.17g}' if isinstance(v, float) else str(v) for v in values) + '\n'


def impact_rows(events: Sequence[Event]) -> str:
    """Return the lines of the impacts among some events, and of rests, which end chatters."""
    return ''.join(
        row([getattr(event, column) for column in IMPACT_COLUMNS])
        for event in events
        if event.kind in (EventKind.IMPACT, EventKind.REST)
    )


def open_table(path: Path | None, columns: Sequence[str], stack: ExitStack) -> IO[str] | None:
    """Open a table, if one is asked for, and write its head; - stands for standard output."""
    if path is None:
        return None
    stream: IO[str] = sys.stdout
    if str(path) != '-':
        stream = stack.enter_context(path.open('w', encoding='utf-8', newline=''))
    stream.write(row(columns))
    return stream
