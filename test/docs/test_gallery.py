"""Every figure of the gallery can be drawn, here from a few values."""

import re
import shutil
from pathlib import Path

import pytest

import impact_damper_ros

GALLERY = Path(impact_damper_ros.__file__).parents[1] / 'examples' / 'gallery'
SCRIPTS = sorted(GALLERY.glob('plot_*.py'))


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda script: script.stem)
def test_figure(script, monkeypatch, tmp_path):
    plt = pytest.importorskip('matplotlib.pyplot')
    monkeypatch.setattr(plt, 'show', lambda: None)
    shutil.copy(GALLERY / 'print.mplstyle', tmp_path)
    monkeypatch.chdir(tmp_path)
    text = script.read_text(encoding='utf-8')
    text = re.sub(r'(linspace\([^*]*?, )\d{2,3}\)', r'\g<1>7)', text)
    plt.switch_backend('agg')
    try:
        exec(compile(text, str(script), 'exec'), {'__name__': '__main__'})
        assert (tmp_path / f'{script.stem.removeprefix("plot_")}.png').stat().st_size > 10_000
        panels = plt.gcf().axes
        assert panels
        for axes in panels:
            # A quantity and its unit; panels above one another share the label of the lowest
            shared = axes.get_shared_x_axes().get_siblings(axes)
            labels = [one.get_xlabel() for one in shared if one.get_xlabel()]
            assert labels
            assert all(re.search(r', \S+$|ratio r$', label) for label in labels)
            assert axes.lines or axes.collections
    finally:
        plt.close('all')
        plt.rcdefaults()
