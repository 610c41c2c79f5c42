# SPDX-License-Identifier: Apache-2.0
"""What every example shares: its options, its table on the terminal and as CSV, its picture."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from impact_damper_ros.report.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    blank_figure,
    finish_panel,
    print_style,
    save_figure,
)

__all__ = [
    'BLUE', 'GREEN', 'GREY', 'MARKS', 'ORANGE', 'PURPLE', 'blank_figure', 'finish_panel',
    'options', 'print_style', 'save', 'say', 'set_ticks', 'show', 'write_rows',
]  # fmt: skip

GREY = '#777777'
#: Marks: open, so that a line is seen through them.
MARKS: dict[str, Any] = {'markersize': 4.2, 'markerfacecolor': 'white', 'markeredgewidth': 0.9}


def options(doc: str) -> argparse.Namespace:
    """Read --out and --quick; make the directory."""
    parser = argparse.ArgumentParser(description=doc.strip().partition('\n\n')[0])
    parser.add_argument('--out', type=Path, default=Path(), metavar='DIR', help='write there [.]')
    parser.add_argument('--quick', action='store_true', help='a coarse look, much sooner')
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    return arguments


def say(text: str) -> None:
    """Print what is being computed on the standard error, and flush it."""
    print(text, file=sys.stderr, flush=True)


def show(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table as Markdown; numbers with four digits."""

    def text(value: object) -> str:
        return f'{value:.4g}' if isinstance(value, float) else str(value)

    lines = [[*head], ['---'] * len(head), *([text(value) for value in row] for row in rows)]
    print('\n'.join(f'| {" | ".join(line)} |' for line in lines), end='\n\n')


def write_rows(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table as CSV; numbers with eight digits."""
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(head)
        for row in rows:
            writer.writerow([f'{v:.8g}' if isinstance(v, float) else v for v in row])
    print(path)


def set_ticks(axis: Any, values: Sequence[float]) -> None:
    """Put ticks of a logarithmic axis at some values within its range, as plain numbers."""
    low, high = sorted(axis.get_view_interval())
    inside = [value for value in values if low <= value <= high]
    axis.set_ticks(inside, [f'{value:g}' for value in inside])
    axis.set_ticks([], minor=True)


def save(figure: Figure, path: Path, columns: int = 0) -> None:
    """Write a picture, with the legend of its first panel below it in some columns, if given."""
    if columns:
        handles = figure.axes[0].get_legend_handles_labels()
        figure.legend(*handles, loc='outside lower center', ncols=columns, frameon=False)
    save_figure(figure, path)
    print(path)
