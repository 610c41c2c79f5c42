"""Responses over frequency: the numbers in figures, tables and words are those that were found."""

import dataclasses
import math

import numpy as np
import pytest
from report.example_comparison import example
from rigs import BENCH

pytest.importorskip('matplotlib', reason='it draws')

from impact_damper_ros import RigParameters
from impact_damper_ros.compare.random_response import RandomResponse
from impact_damper_ros.orbits.swept_response import SweptResponse
from impact_damper_ros.report.comparison_tables import impact_table, response_table
from impact_damper_ros.report.drawing import blank_figure, finish_panel, unit_axis
from impact_damper_ros.report.plan_report import _sweep_options
from impact_damper_ros.report.random_response_figure import response_figure, response_text
from impact_damper_ros.report.ring_down_figure import percent_of_loss
from impact_damper_ros.report.swept_response_figure import swept_figure, swept_text

G, HERTZ = 9.80665, np.array([4.0, 5.0, 6.0, 5.0])
X, ALONE = np.array([2e-3, 8e-3, 3e-3, 2.5e-3]), np.array([3e-3, 4e-3, 5e-3, 4e-3])
SWEPT = SweptResponse(
    time=np.arange(4.0),
    frequency=math.tau * HERTZ,
    upwards=np.array([True, True, True, False]),
    level=np.array([0.1, 0.2, 0.3, 0.2]) * G,
    x=X,
    relative=2.0 * X,
    acceleration=3.0 * G * X,
    x_without=ALONE,
    relative_without=4.0 * ALONE,
    acceleration_without=5.0 * G * ALONE,
    impacts=np.array([0.0, 2.0, 2.0, 2.0]),
)
RIG = BENCH.replace(force_amplitudes=0.0, base_amplitudes='0.1 g', base_frequencies=20.0)


def test_a_sweep_in_a_figure():
    figure = swept_figure(RIG, SWEPT)
    for axes, values, alone in zip(
        figure.axes,
        (1e3 * X, 2e3 * X, 3.0 * X),
        (1e3 * ALONE, 4e3 * ALONE, 5.0 * ALONE),
        strict=True,
    ):
        without, up, down, *jumps = (line.get_xydata() for line in axes.lines)
        assert without == pytest.approx(np.array([HERTZ, alone]).T[[0, 1, 3, 2]])
        shown = np.array([HERTZ, values]).T
        assert (up, down) == (pytest.approx(shown[:3]), pytest.approx(shown[3:]))
        # Four times as large at 5 Hz, and 0.4 times at 6 Hz
        assert jumps[:2] == [pytest.approx(shown[:2]), pytest.approx(shown[1:3])]
    (base,) = (line.get_ydata() for line in figure.axes[-1].lines if line.get_label() == 'base')
    assert base == pytest.approx([0.1, 0.2, 0.2, 0.3])
    assert len(swept_figure(BENCH, SWEPT).axes) == 2
    assert swept_text(RIG, SWEPT).splitlines() == [
        'sweep       4 frequencies from 4 Hz to 6 Hz at 0.1 to 0.3 g',
        'largest |X| 8 mm at 5 Hz on the way up',
        'largest |X| 2.5 mm at 5 Hz on the way down',
        'jumps       at 5 Hz (up), 6 Hz (up)',
        'without damper 5 mm at 6 Hz, settled',
    ]


def test_tables_of_a_stretch():
    stretch = dataclasses.replace(example().stretches[0], response=SWEPT, parameters=RIG)
    (_, rows), *_ = response_table(stretch).groups
    # |b| is the level over the square of the frequency
    ratio = 8e-3 / (0.2 * G / (math.tau * 5.0) ** 2)
    assert rows[1] == ('up', '5', '0.2', '8', '4', '16', f'{ratio:.4g}', '0.024', '2')
    for count, note in ((8, ''), (9, 'The first 8 of 9 impacts of the period.')):
        last = dataclasses.replace(stretch.measured.last_period, stops=(1,) * count)
        measured = dataclasses.replace(stretch.measured, last_period=last)
        table = impact_table(dataclasses.replace(stretch, measured=measured))
        assert (len(table.groups), table.note) == (8, note)


def test_a_random_base():
    hertz = np.linspace(3.0, 8.0, 21)
    size = 1.0 / (1.0 + (hertz - 5.0) ** 2)
    level, motion = np.full(21, 0.02 * G**2), 0.08 * G**2 * size
    sizes = (size, 2.0 * size, 3.0 * size, 4.0 * size)
    found = RandomResponse(hertz, level, motion, *sizes, (1.5, 2.5), 4.0, 3, 1, 0.02)
    text = response_text(found)
    assert 'over 3 periods of 4 s, after 1; a vibration of the start has decayed to 2 %' in text
    assert 'give a longer --duration: rms X/rms b 1.5; rms (X - b)/rms b 2.5' in text
    for one, values in (("b''", level), ("X''", motion)):
        assert f'{one} {math.sqrt(values.sum() / 4.0) / G:.4g} g rms' in text
    smooth = found.smooth(size)
    assert f'is largest at 5 Hz, {smooth.max():.4g}; without damper at 5 Hz' in text
    absolute, relative, density = response_figure(found).axes
    for axes, (one, alone) in ((absolute, (1.0, 3.0)), (relative, (2.0, 4.0))):
        lines = [line.get_ydata() for line in axes.lines]
        assert lines == [pytest.approx(k) for k in (one * size, one * smooth, alone * smooth)]
    assert [line.get_ydata() for line in density.lines] == [
        pytest.approx(0.08 * size),
        pytest.approx(np.full(21, 0.02)),
    ]


def test_the_damping_ratio_of_a_loss():
    assert percent_of_loss(1.0 - math.exp(-2.0 * math.tau * 0.01)) == pytest.approx(1.0)
    assert percent_of_loss(1.0) == math.inf


def test_marks_beyond_the_frame_are_left_out():
    """Those on it, and lines, are drawn whole."""
    axes = blank_figure(3.0, 3.0).subplots()
    places = np.array([[0.0, 0.0], [1.0, 1.0], [0.5, 1.1], [-0.1, 0.5], [1.1, 0.5], [0.5, -0.1]])
    marks, line = (axes.plot(*places.T, 'o', ls=style)[0] for style in ('none', '-'))
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    finish_panel(axes, 'a', 'x', 'y')
    assert marks.get_xydata().tolist() == places[:2].tolist()
    assert line.get_xydata().tolist() == places.tolist()


def test_the_sweep_of_a_plan():
    """From 0.8 to 1.2 times the frequency and back in 40 steps, each as long as M needs."""
    rig = RigParameters.of_structure(
        primary_mass=5.0, natural_frequency=10.0, damping_ratio=0.02, base_amplitudes='0.2 g',
        base_frequencies='10 Hz', force_amplitudes=0.0,
    )  # fmt: skip
    assert _sweep_options(rig) == (
        '--duration 518.4 --set sweep_mode=up_down --set sweep_low=8Hz --set sweep_high=12Hz '
        '--set sweep_step=0.1Hz --set sweep_dwell=6.4 --response sweep.csv'
    )


@pytest.mark.parametrize(
    ('low', 'high', 'labels'),
    [(4e-4, 6e-3, ['0.5', '1', '2', '5']), (2e-4, 0.3, ['1', '10', '100'])],
)
def test_ticks_of_a_logarithmic_axis_are_plain_numbers(low, high, labels):
    """Of less than a decade, too; over three decades only at its powers."""
    axes = blank_figure(4.0, 3.0).subplots()
    axes.plot([0.0, 1.0], [low, high])
    axes.set_yscale('log')
    axes.set_ylim(low, high)
    unit_axis(axes.yaxis, 'X', 'm', 1e-3)
    axes.figure.draw_without_rendering()
    ends = axes.get_ylim()
    shown = [t for t in axes.yaxis.get_major_ticks() if ends[0] <= t.get_loc() <= ends[1]]
    assert [t.label1.get_text() for t in shown] == labels
    assert not any(t.label1.get_text() for t in axes.yaxis.get_minor_ticks())
