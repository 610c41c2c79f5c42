"""Ranges: what they mean, and what is said of those that mean nothing."""

import numpy as np
import pytest

from impact_damper_ros.rig import InitialConditions, RigParameters
from impact_damper_ros.sweep.plan import (
    AxisError,
    Follow,
    SweepPlan,
    SweptParameter,
    axis_from_mapping,
    axis_from_text,
)

RIG = RigParameters()
TWO = RigParameters(
    force_amplitudes=(1.0, 2.0), force_frequencies=(1.0, 3.0), force_phases=(0.0, 0.0)
)
START = InitialConditions()


def test_linear_and_logarithmic_ranges_and_lists():
    assert axis_from_text('gap=10:60:6', RIG).values == (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
    decades = axis_from_text('damping=1e-3:1e-1:3:log', RIG)
    assert decades.values == pytest.approx((1e-3, 1e-2, 1e-1), rel=1e-12)
    assert decades.logarithmic
    assert axis_from_text('gap=30,10,20.5', RIG).values == (10.0, 20.5, 30.0)
    assert axis_from_text('gap=[7]', RIG).values == (7.0,)
    assert axis_from_text('one_sided=true,false', RIG).values == (False, True)
    assert axis_from_text('gap=60:10:3', RIG).values == (10.0, 35.0, 60.0)


def test_ranges_file_entries():
    text = axis_from_mapping('gap', '10:60:6', RIG)
    assert axis_from_mapping('gap', {'from': 10, 'to': 60, 'count': 6}, RIG) == text
    assert axis_from_mapping('gap', [10, 20, 30, 40, 50, 60], RIG) == text
    assert axis_from_mapping('gap', 12, RIG).values == (12.0,)
    spaced = axis_from_mapping('gap', {'from': 1, 'to': 100, 'count': 3, 'spacing': 'log'}, RIG)
    assert spaced == axis_from_text('gap=1:100:3:log', RIG)


def test_several_names_take_the_same_value():
    axis = axis_from_text('restitution_1=restitution_2=0.5,0.9', RIG)
    settings = [(parameter, 0.9) for parameter in axis.parameters]
    rig = plan_of('gap=1,2').setup.varied(settings).parameters
    assert (rig.restitution_1, rig.restitution_2) == (0.9, 0.9)


def test_entries_of_arrays():
    assert axis_from_text('force_frequencies=1:2:3', RIG).parameters == (
        SweptParameter('force_frequencies'),
    )
    assert axis_from_text('force_frequencies[0]=1:2:3', RIG).name == 'force_frequencies'
    (parameter,) = axis_from_text('force_frequencies[1]=1:2:3', TWO).parameters
    assert str(parameter) == 'force_frequencies[1]'
    setup = SweepPlan(TWO, START, (axis_from_text('gap=1,2', TWO),)).setup
    settings = [(parameter, 7.0), (SweptParameter('force_amplitudes', 0), 4.0)]
    rig = setup.varied(settings).parameters
    assert rig.force_frequencies == (1.0, 7.0)
    assert rig.force_amplitudes == (4.0, 2.0)


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
    with pytest.raises(AxisError, match=message):
        axis_from_text(text, RIG)


def test_an_array_of_several_needs_an_index():
    with pytest.raises(AxisError, match=r'has 2 entries.*such as force_frequencies\[0\]'):
        axis_from_text('force_frequencies=1:2:3', TWO)


def plan_of(*ranges, follow=Follow.NONE):
    return SweepPlan(RIG, START, tuple(axis_from_text(text, RIG) for text in ranges), follow)


def test_rows_are_in_the_order_of_the_axes():
    plan = plan_of('gap=1,2,3', 'friction=0.1,0.2', follow=Follow.BOTH)
    assert plan.size == 12
    points = [plan.point(i) for i in range(12)]
    assert [p.direction for p in points] == ['up'] * 6 + ['down'] * 6
    assert [p.values for p in points[:3]] == [(1.0, 0.1), (1.0, 0.2), (2.0, 0.1)]
    assert points[6].values == (1.0, 0.1)
    # Followed along the first axis, for each value of the others
    assert [list(chain) for chain in plan.chains()] == [
        [0, 2, 4],
        [1, 3, 5],
        [10, 8, 6],
        [11, 9, 7],
    ]


def test_plan_comes_back_from_its_inputs():
    plan = plan_of('gap=1:9:5:log', 'one_sided=true,false', follow=Follow.UP)
    assert SweepPlan.from_inputs(plan.inputs()) == plan
    assert np.array_equal(plan.axes[0].values, np.geomspace(1.0, 9.0, 5))


def test_plans_that_cannot_be():
    with pytest.raises(AxisError, match='nothing is varied: give --vary'):
        plan_of()
    stepped = RIG.replace(sweep_mode='up')
    with pytest.raises(AxisError, match=r'sweep_mode is up: .* has no steady state'):
        SweepPlan(stepped, START, plan_of('gap=1,2').axes)
    with pytest.raises(AxisError, match='gap is varied twice'):
        plan_of('gap=1,2', 'gap=3,4')
    with pytest.raises(AxisError, match='cannot be followed'):
        plan_of('initial_damper_offset=0,1', follow=Follow.UP)
    with pytest.raises(AxisError, match='2250000 rigs: give ranges that make at most 2000000'):
        plan_of('gap=1:2:1500', 'friction=1:2:1500')


@pytest.mark.parametrize('text', ['gap', '', 'gap:1'])
def test_what_is_no_range(text):
    with pytest.raises(AxisError, match='give NAME=LOW:HIGH:COUNT, such as gap=10:60:200'):
        axis_from_text(text, RIG)


def test_a_long_range_is_quoted_in_short():
    with pytest.raises(AxisError, match=r'characters\).*the value 3.0 is given twice') as caught:
        axis_from_text('gap=1,2,' + '3,' * 100_000, RIG)
    assert len(str(caught.value)) < 200
