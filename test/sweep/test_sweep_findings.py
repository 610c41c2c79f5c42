"""What is found in a sweep: attractors and their basins, the optimum, and the figures of them."""

import json

import numpy as np
import pytest
from rigs import OFF_RESONANCE, TABLE

from impact_damper_ros import (
    InitialConditions,
    RigParameters,
    find_orbits,
    follow,
    load_parameters,
)
from impact_damper_ros.sweep import (
    Grid,
    Settling,
    branches_of,
    draw_sweep,
    find_optimum,
    summary_of,
    summary_text,
    sweep,
)
from impact_damper_ros.sweep.figures import (
    _fixed_text,
    basin_figure,
    bifurcation_figure,
    phases_along,
    surface_figure,
)
from impact_damper_ros.sweep.summary import attractors_of
from impact_damper_ros.sweep.table import attractor_numbers

pytest.importorskip('matplotlib')

START = InitialConditions(initial_primary_position=1.0)


def swept(rig=OFF_RESONANCE, start=START, follow='none', settling=None, **axes):
    return sweep(Grid(rig, start, follow=follow, settling=settling, **axes))


def test_two_mirrored_attractors_share_the_starts(tmp_path):
    """Three impacts per cycle are 1,1,2 or 1,2,2; turned about, a start leads to the other."""
    values = np.linspace(-20.0, 20.0, 10)
    table = swept(
        OFF_RESONANCE.replace(gap=18.0),
        InitialConditions(),
        initial_primary_position=values,
        initial_damper_velocity=values,
    )
    found = attractors_of(table)
    assert [one['stops'] for one in found] in (['1,1,2', '1,2,2'], ['1,2,2', '1,1,2'])
    assert [one['cycles'] for one in found] == [1, 1]
    assert sum(one['share'] for one in found) == 1.0
    assert found[0]['x_max'] == pytest.approx(found[1]['x_max'], rel=1e-6)
    assert 0.3 < found[0]['share'] < 0.7
    # Each row is where its own numbers say that it is
    assert list(table.stops) == [found[number]['stops'] for number in table.attractor]
    text = summary_text(tmp_path / 'sweep.parquet', summary_of(table, None))
    assert 'attractor 1:' in text
    assert 'periodic, 1 cycle, stops 1,' in text
    json.dumps(summary_of(table, None))


def labels_of(figure):
    return [text.get_text() for text in figure.legends[0].texts]


def row(x, *, motion='periodic', period=1, stops='1,2', impacts=2, offset=0.0):
    """Return the columns by which an attractor is known."""
    points = np.atleast_1d(np.array(x, dtype=float))
    return {
        'ok': True,
        'settled': bool(period),
        'kind': motion,
        'cycles': period,
        'stops': stops,
        'impacts': impacts,
        'cycle': 6.0,
        'x_max': 10.0,
        'section_x': points,
        'section_velocity': 0.1 * points,
        'section_offset': np.full(len(points), offset),
        'section_relative_velocity': np.zeros(len(points)),
    }


def test_attractors_are_distinguished_by_their_sections():
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
    assert attractor_numbers(rows) == [4, 0, 0, 1, 1, None, 2, 2, 3, 3, 0]


def test_optimum_gap_is_that_of_the_theory():
    """At resonance the least motion is a smooth minimum; followed upwards, the rig keeps to it."""
    rig = RigParameters(gravity=0.0)
    best = follow(find_orbits(rig, (1, 2)).orbits[0], 'gap', 30.0, 80.0).best()
    table = swept(rig, follow='up', settling=Settling(1000), gap=np.linspace(40.0, 65.0, 11))
    found = find_optimum(table, 'x_max')
    assert abs(found.values[0] - best.value) <= 1.25
    assert best.orbit.x_max <= found.value < 1.01 * best.orbit.x_max
    assert (found.point, found.direction, found.at_edge) == (table.x_max.argmin(), 'up', False)
    largest = find_optimum(table, 'x_max', 'greatest')
    assert largest.value == table.x_max[table.settled].max() > found.value
    assert largest.at_edge


@pytest.fixture(scope='module')
def hysteresis():
    """Two impacts per cycle up to a gap of 57 m; from 48 m on M can also swing without any."""
    gaps = np.linspace(40.0, 80.0, 21)
    return swept(start=InitialConditions(), follow='both', settling=Settling(1000), gap=gaps)


def test_optimum_of_a_hysteresis(hysteresis, tmp_path):
    found = find_optimum(hysteresis, 'x_max')
    down = hysteresis[hysteresis.direction == 'down'].set_index('gap')
    # Followed downwards, the rig keeps to what it had above
    assert down.kind[54.0] == 'without impacts'
    assert (down.kind[44.0], down.stops[44.0]) == ('periodic', '1,2')
    assert (found.values, found.direction) == ((54.0,), 'up')
    summary = summary_of(hysteresis, found)
    said = summary_text(tmp_path / 'sweep.parquet', summary)
    assert f'least x_max: {found.value:.7g} at gap = 54 m, followed upwards' in said
    assert json.loads(json.dumps(summary))['optimum']['values'] == [54.0]
    labels = labels_of(bifurcation_figure(hysteresis, 'x_max', found))
    assert f'least: {found.value:.4g} m at d = 54 m' in labels


def test_branches_run_through_what_has_settled(hysteresis):
    """The motion with two impacts, stable up to its Neimark-Sacker point, unstable beyond."""
    (branch,) = branches_of(hysteresis)
    (special,) = branch.special
    assert special.kind.value == 'Neimark-Sacker'
    assert special.value == pytest.approx(56.947, abs=1e-3)
    values = np.array([point.value for point in branch.points])
    assert (values.min(), values.max()) == pytest.approx((40.0, 80.0))
    stable = np.array([point.orbit.stable for point in branch.points])
    assert stable[values < 56.9].all()
    assert not stable[values > 57.0].any()
    up = hysteresis[(hysteresis.direction == 'up') & hysteresis.settled & (hysteresis.gap < 56.0)]
    at = np.interp(up.gap, values, [point.orbit.x_max for point in branch.points])
    assert at == pytest.approx(up.x_max.to_numpy(), rel=5e-3)
    figure = bifurcation_figure(hysteresis, 'x_max', None, [branch])
    labels = labels_of(figure)
    assert {'theory, stable', 'theory, unstable', 'Neimark-Sacker'} <= set(labels)
    lines = {
        line.get_linestyle(): line for line in panels(figure)[1].lines if len(line.get_xdata())
    }
    assert max(lines['-'].get_xdata()) == pytest.approx(special.value)
    assert min(lines['--'].get_xdata()) == pytest.approx(special.value)


def test_no_branches_where_there_is_no_theory():
    rest = {'settling': Settling(50, watch=21)}
    assert branches_of(swept(OFF_RESONANCE, gap=[30.0], friction=[0.0, 0.1], **rest)) == []
    assert branches_of(swept(OFF_RESONANCE, initial_primary_position=[0.0, 1.0], **rest)) == []
    assert branches_of(swept(OFF_RESONANCE, one_sided=[False, True], **rest)) == []


def panels(figure):
    return [axes for axes in figure.axes if axes.get_label() != '<colorbar>']


def test_bifurcation_diagram_has_units_and_every_impact():
    table = swept(follow='both', settling=Settling(800), gap=[16.0, 30.0])
    figure = bifurcation_figure(table, 'x_max', find_optimum(table, 'x_max'))
    upper, middle, lower = panels(figure)
    assert upper.get_ylabel() == 'Phase of the impacts [cycles]'
    assert middle.get_ylabel() == 'Largest |X| [m]'
    assert lower.get_xlabel() == 'Gap d [m]'
    drawn = np.concatenate([line.get_ydata() for line in upper.lines])
    phases = np.concatenate(list(table.impact_phase))
    assert sorted(drawn) == sorted(phases)
    assert len(phases) == 2 * (3 + 2)
    assert 'K = 1 N/m' in figure.get_suptitle()


@pytest.mark.parametrize('suffix', ['png', 'svg', 'pdf'])
def test_maps_are_written_the_same_each_time(tmp_path, suffix):
    table = swept(settling=Settling(100, watch=21), gap=[12, 30, 200], damping=[0.01, 0.02, 2.5])
    figure = surface_figure(table, 'x_max_ratio', None)
    (panel,) = panels(figure)
    assert panel.get_xlabel() == 'Gap d [m]'
    assert panel.get_ylabel() == 'Damping C [N s/m]'
    assert figure.axes[1].get_ylabel() == 'Largest |X| / A'
    assert 'failed' in labels_of(figure)
    first, second = tmp_path / f'one.{suffix}', tmp_path / f'two.{suffix}'
    for path in (first, second):
        draw_sweep(table, 'x_max_ratio', None, path)
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 5000


def test_basins_are_drawn_with_their_shares():
    table = swept(
        OFF_RESONANCE.replace(gap=37.0),
        settling=Settling(600),
        initial_primary_velocity=[-5, 0, 5],
        initial_damper_offset=[-30, -10, 10],
    )
    figure = basin_figure(table)
    (panel,) = panels(figure)
    assert panel.get_xlabel() == "Initial velocity X' [m/s]"
    labels = labels_of(figure)
    assert labels[0].startswith('periodic, 1 cycle, stops 1,2: 66.7%')
    # Beyond the stop m cannot start
    assert labels[-1] == 'failed'


def test_the_best_row_of_a_sorted_table():
    table = swept(gap=[26.0, 30.0, 37.0, 45.0])
    shuffled = table.sort_values('x_max').reset_index(drop=True)
    best = find_optimum(shuffled, 'x_max')
    assert best == find_optimum(table, 'x_max')
    (row,) = table[table.gap == best.values[0]].itertuples()
    assert row.x_max == best.value
    with pytest.raises(ValueError, match='3 rows of a sweep of 4 rigs: give the whole table'):
        find_optimum(table[:3], 'x_max')
    with pytest.raises(ValueError, match='4 rigs: give the whole table'):
        draw_sweep(table[1:], 'x_max', None, 'none.png')
    table.attrs.clear()
    with pytest.raises(ValueError, match='no inputs in its attributes'):
        find_optimum(table, 'x_max')


SHAKEN = 'M = 5 kg,  K = 19739.2 N/m,  C = 12.5664 N s/m,  m = 0.25 kg'
BASE = 'b₀ = 1.96133 m/s² = 0.2 g,  Ω = 62.8319 rad/s = 10 Hz'


@pytest.mark.parametrize(
    ('rig', 'axis', 'rest'),
    [
        (TABLE, {'gap': [0.01, 0.02]}, f'R₁ = 0.6,  R₂ = 0.6,  θ = 0 rad,  γ = 0,  {BASE}'),
        (
            TABLE.replace(angle=0.1, air_force=0.5),
            {'gap': [0.01, 0.02]},
            f'R₁ = 0.6,  R₂ = 0.6,  θ = 0.1 rad,  γ = 0,  g = 9.81 m/s²,  p = 0.5 N,  {BASE}',
        ),
        (
            TABLE.replace(friction=0.1, one_sided=True),
            {'gap': [0.01, 0.02]},
            f'R₁ = 0.6,  R₂ = 0.6,  θ = 0 rad,  γ = 0.1,  g = 9.81 m/s²,  {BASE},  stop 1 only',
        ),
        (
            TABLE.replace(base_amplitudes=0.0, force_amplitudes=2.0),
            {'friction': [0.0, 0.1]},
            'd = 0.018 m,  R₁ = 0.6,  R₂ = 0.6,  θ = 0 rad,  g = 9.81 m/s²,  F = 2 N',
        ),
    ],
)
def test_a_figure_states_what_is_not_varied_and_acts(rig, axis, rest):
    """The weight only where m is pressed to M or slides, or may be among the rigs."""
    assert _fixed_text(Grid(rig, **axis)).startswith(f'{SHAKEN},  {rest}')


def test_an_impact_is_followed_where_a_branch_counts_from_another_one():
    bench, *_ = load_parameters('bench_rig')
    orbits = find_orbits(bench.replace(gap=0.017), (1, 2)).orbits
    branches = [follow(orbit, 'gap', 0.0165, 0.0175) for orbit in orbits]
    turned = [one for one in branches if len({orbit.stops for orbit in one.orbits}) > 1]
    assert turned
    for branch in turned:
        assert np.abs(np.diff(phases_along(branch))).max() < 0.01
