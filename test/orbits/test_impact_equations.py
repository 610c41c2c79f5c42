"""The impact equations as starts, the sequences of stops, and what the theory excludes."""

import itertools
import math

import numpy as np
import pytest

from impact_damper_ros.cli import solve_periodic
from impact_damper_ros.orbits import ImpactEquations, OrbitError, find_orbits, plausible_stops
from impact_damper_ros.orbits.search import starting_points
from impact_damper_ros.rig import RigParameters

LEVEL = RigParameters(gravity=0.0)

RIG = RigParameters(
    friction=0.3,
    angle=0.4,
    gravity=1.3,
    restitution_2=0.5,
    force_frequencies=(1.02,),
    force_phases=(0.3,),
    air_force=0.02,
    damper_mass=0.1,
    damping=0.05,
)


def test_undamped_rig_at_resonance_is_finite():
    rig = RigParameters(damping=0.0, gravity=0.0)
    equations = ImpactEquations(rig, (1, 2), 1)
    rows = equations.linear_system(np.array([0.0, 2.0]))
    assert np.isfinite(rows).all()
    near = ImpactEquations(rig.replace(force_frequencies=(1.0 + 1e-9,)), (1, 2), 1)
    assert near.linear_system(np.array([0.0, 2.0])) == pytest.approx(rows, abs=1e-7)


@pytest.mark.parametrize(
    ('changes', 'stops', 'cycles', 'words'),
    [
        ({}, (1, 1, 2), 1, 'same stop'),
        ({'one_sided': True}, (1, 2), 1, 'one-sided'),
        ({'force_amplitudes': (0.0,)}, (1, 2), 1, 'amplitude 0'),
        ({'force_frequencies': (0.0,)}, (1, 2), 1, 'frequency 0'),
        (
            {
                'force_amplitudes': (1.0, 0.5),
                'force_frequencies': (1.0, 2.0),
                'force_phases': (0.0, 0.0),
            },
            (1, 2),
            1,
            '2 harmonics',
        ),
    ],
)
def test_what_the_theory_excludes(changes, stops, cycles, words):
    with pytest.raises(OrbitError, match=words):
        ImpactEquations(RIG.replace(**changes), stops, cycles)


@pytest.mark.parametrize(
    ('impacts', 'expected'),
    [
        (1, []),
        (2, [(1, 2)]),
        (3, [(1, 1, 2), (1, 2, 2)]),
        (4, [(1, 2, 1, 2), (1, 1, 1, 2), (1, 1, 2, 2), (1, 2, 2, 2)]),
    ],
)
def test_plausible_stops(impacts, expected):
    level = RIG.replace(angle=0.0, friction=0.0, air_force=0.0)
    alone = [(stop,) * impacts for stop in (1, 2)]
    assert plausible_stops(level, impacts) == (expected or [(1,)])
    assert plausible_stops(level.replace(angle=0.1), impacts) == [*expected, alone[0]]
    assert plausible_stops(level.replace(angle=-0.1), impacts) == [*expected, alone[1]]
    assert plausible_stops(level.replace(friction=0.1), impacts) == [*expected, *alone]
    pushed = level.replace(angle=0.1, air_force=1.1 * level.damper_mass * level.gravity)
    assert plausible_stops(pushed, impacts) == (expected or [(1,)])
    assert plausible_stops(level.replace(one_sided=True), impacts) == [(1,) * impacts]


@pytest.mark.parametrize('number', [0, -1, 1.5, 1001, 10**12, math.inf, math.nan, None, 'x'])
def test_numbers_that_no_period_can_have(number):
    """10**12 impacts were once listed, and as many cycles failed deep in linear algebra."""
    with pytest.raises(OrbitError, match=r'cycles is .*: give a whole number from 1 to 1000'):
        find_orbits(RigParameters(), (1, 2), number)
    for one_sided in (False, True):
        with pytest.raises(OrbitError, match=r'impacts is .*: give a whole number from 1 to 1000'):
            plausible_stops(RigParameters(one_sided=one_sided), number)
    if number is not None and number not in (0, 1001):
        with pytest.raises(OrbitError, match=r'starts is .*: give a whole number from 0 to 10000'):
            find_orbits(RigParameters(), (1, 2, 2), starts=number)


def test_too_many_sequences_to_list():
    with pytest.raises(OrbitError, match='7 impacts have too many stop sequences'):
        plausible_stops(RIG, 7)


@pytest.mark.parametrize('stops', [[], (1, 3), '12', (1, None), itertools.repeat(3)])
def test_stop_sequences(stops):
    with pytest.raises(OrbitError, match=r'stop sequence .*: give the stops hit in one period'):
        find_orbits(LEVEL, stops)


@pytest.mark.parametrize('kind', [np.int64, np.float32, np.array])
def test_any_kind_of_number(kind):
    found = find_orbits(LEVEL, [kind(1), kind(2)], kind(1)).orbits[0]
    assert found == find_orbits(LEVEL, (1, 2)).orbits[0]
    assert type(found.cycles) is int


@pytest.mark.parametrize('frequency', [1e-300, 1e-162, 1e-9])
def test_a_force_too_slow_for_a_vibration(frequency):
    """It once ended in a division by zero, or deep in linear algebra."""
    with pytest.raises(OrbitError, match='no vibration, give at least 1e-06 rad/s'):
        find_orbits(RigParameters(force_frequencies=frequency), (1, 2))


@pytest.mark.filterwarnings('error')
def test_free_vibration_that_dies_out_within_a_flight():
    """Its growth rate over a flight once was beyond the floats."""
    rig = RigParameters(gravity=0.0, damping=1.9, force_frequencies=1e-3)
    equations = ImpactEquations(rig, (1, 2), 1)
    system = equations.linear_system(np.array([0.0, 0.5 * equations.period]))
    assert np.all(np.isfinite(system))
    find_orbits(rig, (1, 2), simulate=False)


def test_starts_of_a_violent_rig():
    """Those of displacements below -1e9 m were once refused."""
    rig = LEVEL.replace(force_amplitudes=(1e12,), stiffness=1e-6, damping=0.0)
    assert min(start.initial_primary_position for start in starting_points(rig)) == -1e9


@pytest.mark.parametrize('damping', [5e-324, 1e-320, 1e-310])
def test_a_damping_that_is_hardly_a_float(damping, recwarn):
    """The quotient for the response near resonance was once inf/inf: the SVD did not converge."""
    damped = find_orbits(LEVEL.replace(damping=damping), (1, 2), simulate=False).orbits
    undamped = find_orbits(LEVEL.replace(damping=0.0), (1, 2), simulate=False).orbits
    assert [o.x for o in damped] == [pytest.approx(o.x, abs=1e-9) for o in undamped]
    assert not recwarn.list


def test_a_range_is_refused_before_the_search(capsys):
    assert solve_periodic.main(['paper', '--impacts', '2', '--follow', 'gap=50:60']) == 2
    assert 'gap is 37 where the branch begins' in capsys.readouterr().err
