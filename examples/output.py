"""What every example shares: its options, its table on the terminal and as CSV, its picture."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

# Of Okabe and Ito: distinguished with any kind of colour vision
BLUE, ORANGE, GREEN, PURPLE, GREY = '#0072b2', '#d55e00', '#009e73', '#aa4499', '#777777'
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


def blank_figure(width: float, height: float) -> Figure:
    """Return an empty figure, its size in inches."""
    mpl.rcParams.update({'font.size': 9, 'axes.titlesize': 9, 'legend.fontsize': 8.5})
    return Figure(figsize=(width, height), layout='constrained', dpi=180)


def finish_panel(axes: Any, letter: str, x_label: str, y_label: str) -> None:
    """Label a panel, and give it a light grid."""
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.grid(color='0.9', linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(direction='in', top=True, right=True)
    if letter:
        axes.set_title(f'({letter})', loc='left', fontweight='bold')


def set_ticks(axis: Any, values: Sequence[float]) -> None:
    """Put ticks of a logarithmic axis at some values within its range, as plain numbers."""
    low, high = sorted(axis.get_view_interval())
    inside = [value for value in values if low <= value <= high]
    axis.set_ticks(inside, [f'{value:g}' for value in inside])
    axis.set_ticks([], minor=True)


def save(figure: Figure, path: Path) -> None:
    """Write a picture."""
    figure.savefig(path, metadata={'Software': None})
    print(path)
