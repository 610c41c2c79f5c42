"""The picture of two runs: whatever is drawn in it is in its legend."""

import numpy as np
import pytest

pytest.importorskip('matplotlib', reason='it draws')

import matplotlib as mpl
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from impact_damper_ros import EVENT_TYPE, SAMPLE_TYPE
from impact_damper_ros.report.drawing import save_figure
from impact_damper_ros.report.run_figures import RunRows, Side, draw_runs


def figure(changes=(), since=3.0):
    """Draw two runs, one twice as large as the other, and their ends from an instant on."""
    time = np.linspace(0.0, 4.0, 401)
    sides = []
    for size in (0.003, 0.006):
        x = size * np.sin(6.0 * time)
        samples, impacts = np.zeros(len(time), SAMPLE_TYPE), np.zeros(3, EVENT_TYPE)
        samples['time'], samples['x'], samples['z'] = time, x, 2.0 * x
        samples['stop_1'], samples['stop_2'] = x + 0.012, x - 0.012
        impacts['time'], impacts['stop'] = (0.5, 1.5, 3.5), (1, 2, 1)
        end = RunRows(samples[time >= since], impacts)
        sides.append(Side(f'{size} m', np.array([time, x, x]), end))
    return draw_runs(tuple(sides), changes)


def test_a_figure_leaves_the_style_of_others_alone(tmp_path):
    before = dict(mpl.rcParams)
    save_figure(figure(), tmp_path / 'run.png')
    assert dict(mpl.rcParams) == before


def test_the_band_is_in_the_legend():
    drawn = figure()
    overview = drawn.axes[0]
    bands = [patch for patch in overview.patches if isinstance(patch, Rectangle)]
    assert [band.get_x() for band in bands] == [3.0]
    (legend,) = drawn.legends
    texts = [text.get_text() for text in legend.get_texts()]
    shown = dict(zip(texts, legend.legend_handles, strict=True))
    patch = shown['close up below']
    for band in bands:
        assert to_hex(band.get_facecolor(), keep_alpha=True) == to_hex(
            patch.get_facecolor(), keep_alpha=True
        )
    # No mass, stop or line has that colour.
    others = [handle for text, handle in shown.items() if text != 'close up below']
    colors = {
        to_hex(h.get_color() if hasattr(h, 'get_color') else h.get_facecolor()) for h in others
    }
    assert to_hex(patch.get_facecolor()) not in colors
    drawn.draw_without_rendering()
    width = drawn.get_window_extent().width
    box = legend.get_window_extent()
    assert box.x0 >= 0.0
    assert box.x1 <= width


def test_labels_of_changes_do_not_run_into_each_other():
    """Five changes in a second, and one at the end of the run; of more, none is written out."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    names = 'gap', 'friction', 'restitution_1', 'restitution_2', 'damper_mass'
    changes = [(1.0 + 0.12 * k, f'{name} 0.025') for k, name in enumerate(names)]
    changes.append((3.95, 'damper_mass 0.05'))
    drawn = figure(changes)
    FigureCanvasAgg(drawn).draw()
    boxes = [text.get_window_extent() for text in drawn.axes[0].texts]
    assert len(boxes) == 6
    assert not any(one.overlaps(two) for i, one in enumerate(boxes) for two in boxes[:i])
    (left, _), (right, _) = drawn.axes[0].get_window_extent().get_points()
    assert all(left <= box.x0 < box.x1 <= right for box in boxes)
    assert not figure([*changes, (2.0, 'gap 0.02')]).axes[0].texts
