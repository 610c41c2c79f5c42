"""The style of all figures for print: colours, fonts, panels, and files written whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from impact_damper_ros.outputs import whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ['BLUE', 'GREEN', 'ORANGE', 'PURPLE', 'blank_figure', 'finish_panel', 'save_figure']


# Okabe and Ito's colours, told apart with any kind of colour vision
BLUE, ORANGE, GREEN, PURPLE = '#0072B2', '#D55E00', '#009E73', '#AA4499'
_FONT = {
    'font.size': 9,
    'axes.labelsize': 9,
    'axes.titlesize': 9,
    'legend.fontsize': 8.5,
    'mathtext.fontset': 'dejavusans',
    'svg.hashsalt': 'impact_damper_ros',
}


def blank_figure(width: float, height: float) -> Figure:
    """Return an empty figure, its size in inches."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams.update(_FONT)
    return Figure(figsize=(width, height), layout='constrained', dpi=180)


def finish_panel(axes: Any, panel: str, x_label: str, y_label: str) -> None:
    """Label a panel: its letter, axes, a light grid."""
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    # Marks are drawn whole at the frame, but not beyond it
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for line in axes.lines:
        if line.get_linestyle() == 'None':
            pairs = zip(*line.get_data(), strict=True)
            inside = [(x, y) for x, y in pairs if left <= x <= right and bottom <= y <= top]
            line.set_data(*zip(*inside, strict=True) if inside else ([], []))
    axes.grid(color='0.9', linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(direction='in', top=True, right=True)
    if panel:
        axes.set_title(f'({panel})', loc='left', fontweight='bold')


def save_figure(figure: Figure, path: Path) -> None:
    """
    Write a figure, whole or not at all, without a date.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    path : Path
        The file; its suffix is the format, png, svg or pdf.
    """
    kind = path.suffix.lower().lstrip('.')
    dated = {'png': 'Software', 'svg': 'Date', 'pdf': 'CreationDate'}[kind]
    with whole(path) as draft:
        figure.savefig(draft, format=kind, metadata={dated: None})
