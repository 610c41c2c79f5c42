"""Grids: what ranges mean, the order of the rigs, and what is said of grids that cannot be."""

import json
import math

import numpy as np
import pytest

from impact_damper_ros import RigParameters
from impact_damper_ros.sweep import Grid, GridError, Settling, range_from_text
from impact_damper_ros.sweep.grid import Varied

RIG = RigParameters()
TWO = RigParameters(
    force_amplitudes=(1.0, 2.0), force_frequencies=(1.0, 3.0), force_phases=(0.0, 0.0)
)


def grid_of(*ranges, rig=RIG, **options):
    axes = {name: values for name, values, _ in map(range_from_text, ranges)}
    return Grid(rig, **axes, **options)


def test_linear_and_logarithmic_ranges_and_lists():
    def values(text):
        return grid_of(text).axes[0].values

    assert values('gap=10:60:6') == (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
    assert values('damping=1e-3:1e-1:3:log') == pytest.approx((1e-3, 1e-2, 1e-1), rel=1e-12)
    assert values('gap=30,10,20.5') == (10.0, 20.5, 30.0)
    assert values('gap=[7]') == (7.0,)
    assert values('one_sided=true,false') == (False, True)
    assert values('gap=60:10:3') == (10.0, 35.0, 60.0)


def test_several_names_take_the_same_value():
    grid = Grid(RIG, **{'restitution_1=restitution_2': [0.5, 0.9]})
    rig = grid.setup.vary(grid.settings(grid.values(1))).parameters
    assert (rig.restitution_1, rig.restitution_2) == (0.9, 0.9)
    assert grid.columns()['restitution_2'] == [0.5, 0.9]


def test_entries_of_arrays():
    assert grid_of('force_frequencies=1:2:3').axes[0].varied == (Varied('force_frequencies'),)
    assert grid_of('force_frequencies[0]=1:2:3').axes[0].name == 'force_frequencies'
    grid = grid_of('force_frequencies[1]=3:7:2', 'force_amplitudes[0]=4', rig=TWO)
    assert grid.axes[0].name == 'force_frequencies[1]'
    rig = grid.setup.vary(grid.settings(grid.values(1))).parameters
    assert rig.force_frequencies == (1.0, 7.0)
    assert rig.force_amplitudes == (4.0, 2.0)
    with pytest.raises(GridError, match=r'has 2 entries.*such as force_frequencies\[0\]'):
        grid_of('force_frequencies=1:2:3', rig=TWO)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('gab=1:2:3', r"'gab' is not a parameter of the rig: did you mean gap\?"),
        ('gap', 'give NAME=LOW:HIGH:COUNT'),
        ('gap=1:2', 'give LOW:HIGH:COUNT'),
        ('gap=1:2:0', '0 values: give a whole number from 1'),
        ('gap=1:2:2.5', r'2\.5 values: give a whole number'),
        ('gap=1:2:1', 'one value cannot reach from 1 to 2'),
        ('gap=2:2:5', 'is not a range: give two different ends'),
        ('gap=nan:2:5', "'nan' is not a finite number"),
        ('gap=1:inf:5', "'inf' is not a finite number"),
        ('gap=1:x:5', "'x' is not a number"),
        ('gap=', 'there are no values'),
        ('gap=1,,nan', "'nan' is not a finite number"),
        ('gap=1,1', 'the value 1.0 is given twice'),
        ('gap=0:2:5:log', 'a logarithmic range needs positive ends'),
        ('gap=1:2:5:cubic', "spacing 'cubic': give linear or log"),
        ('gap=true,false', 'gap takes numbers, not'),
        ('one_sided=0,1', 'one_sided takes true and false'),
        ('gap[0]=1:2:3', 'gap is one value, not an array'),
        ('force_phases[1]=1:2:3', r'has 1 entry in this rig: give force_phases\[0\]'),
        ('multisine_lines=1:2:3', r'multisine_lines takes whole numbers, not 1\.5'),
        ('sweep_mode=up,down', 'sweep_mode is a text and has no range'),
        ('gap=gap=1:2:3', 'the same name is given twice'),
        ('gap=initial_damper_offset=1:2:3', 'cannot share values'),
    ],
)
def test_errors_name_the_value_and_the_remedy(text, message):
    with pytest.raises(GridError, match=message):
        grid_of(text)


def test_rows_are_in_the_order_of_the_axes():
    grid = grid_of('gap=1,2,3', 'friction=0.1,0.2', follow='both')
    assert grid.size == 12
    columns = grid.columns()
    assert columns['direction'] == ['up'] * 6 + ['down'] * 6
    assert columns['gap'][:4] == [1.0, 1.0, 2.0, 2.0]
    assert [grid.values(row) for row in (1, 2, 7)] == [(1.0, 0.2), (2.0, 0.1), (1.0, 0.2)]
    # Followed along the first axis, for each value of the others
    assert [list(chain) for chain in grid.chains()] == [
        [0, 2, 4],
        [1, 3, 5],
        [10, 8, 6],
        [11, 9, 7],
    ]


def test_a_grid_comes_back_from_its_inputs():
    grid = grid_of('gap=1:9:5:log', 'one_sided=true,false', follow='up')
    assert Grid.from_inputs(json.loads(json.dumps(grid.inputs()))) == grid
    assert np.array_equal(grid.axes[0].values, np.geomspace(1.0, 9.0, 5))


def test_grids_that_cannot_be():
    for match, make in (
        ('nothing is varied: give --vary', lambda: Grid(RIG)),
        (
            r'sweep_mode is up: .* has no steady state',
            lambda: Grid(RIG.replace(sweep_mode='up'), gap=[1, 2]),
        ),
        ('gap is varied twice', lambda: Grid(RIG, **{'gap': [1, 2], 'gap=friction': [0.1]})),
        ('cannot be followed', lambda: grid_of('initial_damper_offset=0,1', follow='up')),
        (
            '2250000 rigs: give ranges that make at most 2000000',
            lambda: grid_of('gap=1:2:1500', 'friction=1:2:1500'),
        ),
        ('follow is .*: give one of none, up, down, both', lambda: Grid(RIG, gap=1, follow='in')),
        ("gap: 'a' is not a number", lambda: Grid(RIG, gap=['a'])),
        ('gap is 0.0 m: give a number', lambda: Grid(RIG, gap=[0.0])),
    ):
        with pytest.raises(GridError, match=match):
            make()


@pytest.mark.parametrize('name', ['cycles', 'watch', 'events', 'section'])
@pytest.mark.parametrize('number', [0, 2.5, math.nan])
def test_how_long_a_rig_may_settle(name, number):
    """2.5 cycles were once refused for the instants of samples, and 2.5 events taken."""
    with pytest.raises(ValueError, match=f'{name} is .*: give a whole number from'):
        Settling(**{name: number})
    with pytest.raises(ValueError, match=r'tolerance is 1\.0: give a number'):
        Settling(tolerance=1.0)
