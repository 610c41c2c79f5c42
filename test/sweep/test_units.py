"""Units of a sweep: as they were given, in its figures and texts; its table is in SI."""

import csv
import json
import math

import numpy as np
import pytest
from rigs import TABLE

from impact_damper_ros import Transmissibility
from impact_damper_ros.cli.sweep_rig import main
from impact_damper_ros.sweep import Grid, find_optimum, range_from_text, sweep
from impact_damper_ros.sweep.figures import bifurcation_figure, surface_figure
from impact_damper_ros.sweep.grid import GridError

WIDE = TABLE.replace(gap=1.0)


@pytest.mark.parametrize(
    ('text', 'values', 'unit'),
    [
        ('base_frequencies=7Hz:13Hz:2', [14.0 * math.pi, 26.0 * math.pi], 'Hz'),
        ('angle=0:90deg:2', [0.0, 0.5 * math.pi], ''),
        ('gap=4mm, 8 mm', [0.004, 0.008], 'mm'),
        ('gap=4mm,0.8cm', [0.004, 0.008], ''),
        ('gap=2 cm, 0.03', [0.02, 0.03], ''),
        ('gap=0.004:0.008:3', [0.004, 0.006, 0.008], ''),
        ('gap=4 m:8 m:3', [4.0, 6.0, 8.0], ''),
        ('base_amplitudes=1mm:2mm:2', [0.001, 0.002], 'mm'),
        ('one_sided=true,false', [True, False], ''),
    ],
)
def test_values_and_unit_of_a_range(text, values, unit):
    names, found, its_unit = range_from_text(text)
    assert (names, its_unit) == (text.partition('=')[0], unit)
    assert found == pytest.approx(values, rel=1e-12)


def test_units_go_with_the_inputs():
    grid = Grid(WIDE, base_frequencies=['9 Hz', '11 Hz'])
    again = Grid.from_inputs(json.loads(json.dumps(grid.inputs())))
    assert again == grid
    (axis,) = again.axes
    assert axis.unit == 'Hz'
    assert axis.values == pytest.approx((18.0 * math.pi, 22.0 * math.pi))
    assert axis.value_text(axis.values[0], WIDE) == '9 Hz'


def test_the_unit_of_a_base_is_its_quantity():
    """0.1 to 0.3 mm of a base that was given in g."""
    names, values, unit = range_from_text('base_amplitudes=0.1mm:0.3mm:3')
    grid = Grid(WIDE, units={names: unit}, **{names: values})
    rigs = [grid.setup.vary(grid.settings(grid.values(row))).parameters for row in range(3)]
    assert [rig.base_motion.size for rig in rigs] == pytest.approx([1e-4, 2e-4, 3e-4])
    table = sweep(grid, jobs=1)
    assert table.attrs['units']['base_amplitudes'] == 'm'
    assert table.x_max.to_numpy() == pytest.approx(
        [rig.response_amplitude for rig in rigs], rel=1e-6
    )


def labels_of(axis):
    """Return the numbers at an axis of a figure that is drawn."""
    return [float(label.get_text()) for label in axis.get_ticklabels() if label.get_text()]


def drawn(figure):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).draw()
    return figure


def test_figure_of_a_frequency_in_hertz():
    """Round numbers of hertz, M alone in closed form, and the base in the title."""
    pytest.importorskip('matplotlib')
    table = sweep(Grid(WIDE, base_frequencies=['8 Hz', '10 Hz', '12 Hz']), jobs=1)
    figure = drawn(bifurcation_figure(table, 'transmissibility', None))
    axes = figure.axes[1]
    assert figure.axes[-1].get_xlabel() == 'Frequency of the base Ω [Hz]'
    assert {8.0, 10.0, 12.0} <= set(labels_of(figure.axes[-1].xaxis))
    (alone,) = [line for line in axes.lines if line.get_label() == 'without the damper']
    rates, heights = alone.get_data()
    assert rates[-1] == pytest.approx(12.0)
    peak = Transmissibility.without_damper(WIDE).absolute
    assert np.max(heights) == pytest.approx(peak, rel=1e-3)
    title = figure.get_suptitle()
    assert 'b₀ = 1.96133 m/s² = 0.2 g' in title
    assert 'F =' not in title
    row = table.iloc[1]
    assert row.transmissibility == pytest.approx(row.transmissibility_without_damper, rel=1e-6)


def test_figure_of_two_axes():
    pytest.importorskip('matplotlib')
    gaps, sizes = np.geomspace(4.0, 20.0, 3), ['0.1 mm', '0.3 mm']
    grid = Grid(WIDE, base_amplitudes=sizes, gap=[f'{gap} mm' for gap in gaps])
    figure = drawn(surface_figure(sweep(grid, jobs=1), 'x_max', None))
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        'Amplitude of the base b₀ [mm]',
        'Gap d [mm]',
    )
    assert {5.0, 10.0, 20.0} <= set(labels_of(axes.yaxis))
    assert 'Ω = 62.8319 rad/s = 10 Hz' in figure.get_suptitle()


def test_lengths_in_si_are_drawn_in_a_handy_unit():
    pytest.importorskip('matplotlib')
    table = sweep(Grid(WIDE, gap=[0.004, 0.01, 0.02], damper_mass=[0.1, 0.2]), jobs=1)
    best = find_optimum(table, 'x_max')
    figure = drawn(surface_figure(table, 'x_max', best))
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ('Gap d [mm]', 'Damper mass m [kg]')
    assert {5.0, 10.0, 15.0, 20.0} <= set(labels_of(axes.xaxis))
    assert bar.get_ylabel() == 'Largest |X| [mm]'
    (gap, mass), size = best.values, best.value
    text = figure.legends[0].get_texts()[0].get_text()
    assert text.endswith(f': {1e3 * size:.4g} mm at d = {1e3 * gap:.5g} mm, m = {mass:g} kg')


def test_command(tmp_path, capsys):
    path = tmp_path / 'table.csv'
    words = ['bench_rig', '--set', 'force_amplitudes=0', '--set', 'base_amplitudes=0.05g']
    words += ['--vary', 'base_frequencies=4Hz:6Hz:5', '--set', 'gap=1', '-o', str(path)]
    assert main([*words, '--measure', 'x_max']) == 0
    assert 'at base_frequencies = 6 Hz' in capsys.readouterr().err
    lines = [line for line in path.read_text().splitlines() if not line.startswith('#')]
    rows = list(csv.DictReader(lines))
    assert float(rows[0]['base_frequencies']) == pytest.approx(8.0 * math.pi)


def test_a_unit_of_something_else():
    with pytest.raises(GridError, match="'kg' is no unit of it"):
        Grid(WIDE, gap=['1 kg'])
