"""What is found in a sweep: attractors and their basins, the optimum, and the figures of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from sweep.made_tables import table_of

from impact_damper_ros.orbits import optimal_gap
from impact_damper_ros.orbits.settling import Settling
from impact_damper_ros.rig import InitialConditions, RigParameters
from impact_damper_ros.sweep.optimum import Best, find_optimum
from impact_damper_ros.sweep.plan import Follow, SweepPlan, axis_from_text
from impact_damper_ros.sweep.summary import attractors_of, summary_of, summary_text
from impact_damper_ros.sweep.table import FAILED, SweepTable, attractor_numbers

pytest.importorskip('pyarrow')

RIG = RigParameters(gravity=0.0, force_frequencies=1.02)
START = InitialConditions(initial_primary_position=1.0)


def swept(tmp_path, *ranges, rig=RIG, start=START, follow=Follow.NONE, failing=None, **settling):
    """Sweep; `failing` is a value more on the first axis, which the command would refuse."""
    first, *others = (axis_from_text(text, rig) for text in ranges)
    if failing is not None:
        first = replace(first, values=(failing, *first.values))
    plan = SweepPlan(rig, start, (first, *others), follow, Settling(**settling))
    path = tmp_path / 'sweep.parquet'
    table_of(plan, path)
    return SweepTable(path)


def test_two_mirrored_attractors_share_the_starts(tmp_path):
    """Three impacts per cycle are 1,1,2 or 1,2,2; turned about, a start leads to the other."""
    count = 10
    table = swept(
        tmp_path,
        f'initial_primary_position=-20:20:{count}',
        f'initial_damper_velocity=-20:20:{count}',
        rig=RIG.replace(gap=18.0),
        start=InitialConditions(),
    )
    found = attractors_of(table)
    assert [one['stops'] for one in found] in (['1,1,2', '1,2,2'], ['1,2,2', '1,1,2'])
    assert [one['period'] for one in found] == [1, 1]
    assert sum(one['share'] for one in found) == 1.0
    assert found[0]['x_max'] == pytest.approx(found[1]['x_max'], rel=1e-6)
    assert 0.3 < found[0]['share'] < 0.7
    # Each row is where its own numbers say that it is
    numbers = table.numbers('attractor').astype(int)
    assert all(
        stops == found[number]['stops']
        for stops, number in zip(table.texts('stops'), numbers, strict=True)
    )
    text = summary_text(tmp_path / 'sweep.parquet', summary_of(table, None))
    assert 'attractor 1:' in text
    assert 'periodic, 1 cycle, stops 1,' in text


def row(x, *, motion='periodic', period=1, stops='1,2', impacts=2, offset=0.0):
    """Return the columns by which an attractor is known."""
    points = np.atleast_1d(np.array(x, dtype=float))
    return {
        'ok': True,
        'settled': bool(period),
        'motion': motion,
        'period': period,
        'stops': stops,
        'impacts': impacts,
        'cycle': 6.0,
        'x_max': 10.0,
        'section_x': points.tolist(),
        'section_velocity': (0.1 * points).tolist(),
        'section_offset': [offset] * len(points),
        'section_relative_velocity': [0.0] * len(points),
    }


def test_attractors_are_distinguished_by_their_sections():
    rig = ('a rig',)
    rows = [
        row(1.0),
        row(2.0),
        row(2.0001),
        row([3.0, 4.0], period=2),
        row([4.0, 3.0], period=2),
        {'ok': False},
        row(0.0, motion='chaotic', period=None, stops=None),
        row(9.0, motion='chaotic', period=None, stops=None),
        row(7.0, impacts=0, stops='', offset=1.0),
        row(7.0, impacts=0, stops='', offset=2.0),
        row(2.0),
    ]
    numbers = attractor_numbers((rig, one) for one in rows)
    assert list(numbers) == [4, 0, 0, 1, 1, FAILED, 2, 2, 3, 3, 0]
    # Other rigs have numbers of their own
    assert list(attractor_numbers([(1.0, row(1.0)), (2.0, row(2.0)), (2.0, row(1.0))])) == [
        0,
        0,
        1,
    ]


def test_optimum_gap_is_that_of_the_theory(tmp_path):
    """At resonance the least motion is a smooth minimum; followed upwards, the rig keeps to it."""
    rig = RigParameters(gravity=0.0)
    best = optimal_gap(rig, gaps=(30.0, 80.0), points=20)
    table = swept(tmp_path, 'gap=40:65:11', rig=rig, follow=Follow.UP, cycles=1000)
    found = find_optimum(table, 'x_max')
    assert abs(found.grid_values[0] - best.gap) <= 1.25
    assert found.value == pytest.approx(best.x_max, rel=1e-7)
    assert found.values[0] == pytest.approx(best.gap, rel=2e-4)
    assert found.value <= found.grid_measure
    assert not found.at_edge
    assert found.trials > 10
    on_grid = find_optimum(table, 'x_max', refine=False)
    assert on_grid.values == on_grid.grid_values == found.grid_values
    assert on_grid.trials == 0


def test_optimum_of_a_surface(tmp_path):
    table = swept(
        tmp_path, 'gap=36:44:5', 'force_frequencies=1:1.02:3', rig=RIG, cycles=800, watch=21
    )
    least = find_optimum(table, 'x_rms')
    greatest = find_optimum(table, 'x_rms', Best.GREATEST, refine=False)
    measures = np.where(table.flags('settled'), table.numbers('x_rms'), np.nan)
    assert least.grid_measure == np.nanmin(measures)
    assert greatest.value == np.nanmax(measures)
    assert least.value <= least.grid_measure
    assert len(least.values) == 2
    summary = summary_of(table, least)
    assert summary['optimum']['names'] == ['gap', 'force_frequencies']
    assert summary['rigs'] == 15


@pytest.fixture(scope='module')
def hysteresis(tmp_path_factory):
    """Two impacts per cycle up to a gap of 57 m; from 48 m on M can also swing without any."""
    place = tmp_path_factory.mktemp('both')
    return swept(place, 'gap=40:80:21', start=InitialConditions(), follow=Follow.BOTH, cycles=1000)


def test_optimum_at_a_cliff_names_edge_and_coexisting_motion(hysteresis, tmp_path):
    found = find_optimum(hysteresis, 'x_max')
    assert found.values[0] == pytest.approx(54.96, abs=0.02)
    (edge,) = found.edges
    # The two impacts are lost at 57 m, as continuation in the gap finds
    assert edge.values[0] == pytest.approx(57.1, abs=0.2)
    assert edge.axis == 0
    assert edge.ratio > 5.0
    assert edge.motion == 'chaotic'
    swings = {other.start: other for other in found.coexisting}
    without = swings['followed downwards']
    assert without.motion == 'without impacts'
    assert without.measure == pytest.approx(RIG.response_amplitude, rel=1e-6)
    assert without.ratio == pytest.approx(9.22, abs=0.01)
    assert without.values == found.values
    summary = summary_of(hysteresis, found)
    said = summary_text(tmp_path / 'sweep.parquet', summary)
    assert f'edge: at gap = {edge.values[0]:.6g}' in said
    assert '9.22 times as much (without impacts, 1 cycle)' in said
    stored = json.loads(json.dumps(summary))['optimum']
    assert stored['edges'][0]['ratio'] == edge.ratio
    assert stored['coexisting'][-1]['motion'] == found.coexisting[-1].motion
    assert len(stored['cautions']) == 1 + len(found.coexisting)


def test_optimum_on_the_grid_names_what_the_table_shows(hysteresis):
    found = find_optimum(hysteresis, 'x_max', refine=False)
    assert found.trials == 0
    assert found.grid_values == (54.0,)
    (other,) = found.coexisting
    assert (other.start, other.motion) == ('followed downwards', 'without impacts')
    assert other.measure == pytest.approx(RIG.response_amplitude, rel=1e-6)
    assert found.edges == ()
    # At 56 m the next value is beyond the edge: of the greatest rms no other is better
    narrow = find_optimum(hysteresis, 'x_max', Best.GREATEST, refine=False)
    assert all(edge.ratio < 0.5 for edge in narrow.edges)


def test_a_smooth_optimum_has_no_cautions(tmp_path):
    """At resonance, followed, the least motion is 2 m from the end of its branch."""
    rig = RigParameters(gravity=0.0, damping=0.1)
    table = swept(tmp_path, 'gap=4:8:9', rig=rig, follow=Follow.UP, cycles=1000)
    found = find_optimum(table, 'x_max')
    summary = summary_of(table, found)
    assert (found.edges, found.coexisting) == ((), ())
    assert summary['optimum']['cautions'] == []


def test_edges_are_in_the_figures(hysteresis):
    pytest.importorskip('matplotlib')
    from impact_damper_ros.sweep.figures import bifurcation_figure

    found = find_optimum(hysteresis, 'x_max')
    figure = bifurcation_figure(hysteresis, 'x_max', found)
    labels = [text.get_text() for text in figure.legends[0].texts]
    (edge,) = found.edges
    assert f'least: {found.value:.4g} m at d = {found.values[0]:.5g} m' in labels
    assert f'edge at d = {edge.values[0]:.5g} m (× {edge.ratio:.3g}, chaotic)' in labels
    assert 'followed downwards (× 9.22, without impacts)' in labels


def test_no_optimum_without_a_motion_that_repeats(tmp_path):
    table = swept(tmp_path, 'damping=2,3')
    assert find_optimum(table, 'x_max') is None
    assert 'damping is 2.0 N s/m' in summary_text(tmp_path, summary_of(table, None))


def test_long_legends_stay_in_the_figure():
    pytest.importorskip('matplotlib')
    from matplotlib.lines import Line2D

    from impact_damper_ros.report.drawing import blank_figure, legend_below

    for length, columns in ((10, 3), (45, 2), (75, 1), (300, 1)):
        figure = blank_figure(6.3, 4.0)
        figure.subplots()
        legend_below(figure, [Line2D([], [], label='m' * (length // 2)) for _ in range(6)], 3)
        (legend,) = figure.legends
        assert legend._ncols == columns
        if length < 300:
            assert legend.get_window_extent().width <= figure.bbox.width


def panels(figure):
    return [axes for axes in figure.axes if axes.get_label() != '<colorbar>']


def test_bifurcation_diagram_has_units_and_every_impact(tmp_path):
    pytest.importorskip('matplotlib')
    from impact_damper_ros.sweep.figures import bifurcation_figure

    table = swept(tmp_path, 'gap=16,30', failing=-1.0, follow=Follow.BOTH, cycles=800)
    figure = bifurcation_figure(table, 'x_max', find_optimum(table, 'x_max', refine=False))
    upper, middle, lower = panels(figure)
    assert upper.get_ylabel() == 'Phase of the impacts [cycles]'
    assert middle.get_ylabel() == 'Largest |X| [m]'
    assert lower.get_xlabel() == 'Gap d [m]'
    drawn = np.concatenate([line.get_ydata() for line in upper.lines if line.get_alpha()])
    phases = np.concatenate(table.lists('impact_phase'))
    assert sorted(drawn) == sorted(phases)
    assert len(phases) == 2 * (3 + 2)
    assert 'K = 1 N/m' in figure.get_suptitle()


def test_legend_of_a_map_has_units(tmp_path):
    pytest.importorskip('matplotlib')
    from impact_damper_ros.sweep.figures import surface_figure

    table = swept(tmp_path, 'gap=30,32', 'damping=0.05,0.06', cycles=400, watch=21)
    for measure, unit in (('x_rms', ' m'), ('x_max_ratio', '')):
        best = find_optimum(table, measure, refine=False)
        gap, damping = best.values
        labels = [
            text.get_text() for text in surface_figure(table, measure, best).legends[0].texts
        ]
        assert labels[0] == (
            f'least of those that repeat: {best.value:.4g}{unit} at d = {gap:.5g} m, '
            f'C = {damping:.5g} N s/m'
        )


@pytest.mark.parametrize('suffix', ['png', 'svg', 'pdf'])
def test_maps_are_written_the_same_each_time(tmp_path, suffix):
    pytest.importorskip('matplotlib')
    from impact_damper_ros.sweep.figures import draw_sweep, surface_figure

    ranges = ('gap=12,30,200', 'damping=0.01:0.02:3')
    table = swept(tmp_path, *ranges, failing=-1.0, cycles=100, watch=21)
    figure = surface_figure(table, 'x_max_ratio', None)
    (panel,) = panels(figure)
    assert panel.get_xlabel() == 'Gap d [m]'
    assert panel.get_ylabel() == 'Damping C [N s/m]'
    assert figure.axes[1].get_ylabel() == 'Largest |X| / A'
    first, second = tmp_path / f'one.{suffix}', tmp_path / f'two.{suffix}'
    for path in (first, second):
        draw_sweep(table, 'x_max_ratio', None, path)
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 5000


def test_basins_are_drawn_with_their_shares(tmp_path):
    pytest.importorskip('matplotlib')
    from impact_damper_ros.sweep.figures import basin_figure

    table = swept(
        tmp_path,
        'initial_primary_velocity=-5:5:3',
        'initial_damper_offset=-30:10:3',
        rig=RIG.replace(gap=37.0),
        cycles=600,
    )
    figure = basin_figure(table)
    (panel,) = panels(figure)
    assert panel.get_xlabel() == "Initial velocity X' [m/s]"
    labels = [text.get_text() for text in figure.legends[0].texts]
    assert labels[0].startswith('periodic, 1 cycle, stops 1,2: 66.7%')
    # Beyond the stop m cannot start
    assert labels[-1] == 'failed'
