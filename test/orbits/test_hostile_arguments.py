"""What no search for periodic motion can work with is refused at once, by name and range."""

import itertools
import math

import numpy as np
import pytest

from impact_damper_ros.cli import solve_periodic
from impact_damper_ros.orbits import (
    Continuation,
    OrbitError,
    continue_orbit,
    find_orbits,
    orbit_near,
    plausible_stops,
    switch_branch,
    value_of,
)
from impact_damper_ros.orbits.search import starting_points
from impact_damper_ros.rig import Event, EventKind, RigParameters
from impact_damper_ros.sweep import Settling

LEVEL = RigParameters(gravity=0.0)
NO_NUMBERS = [None, 'x', math.nan, math.inf, -1, 0, 2.5, True, [], [1.0], 10**30, 1j]
NO_RANGES = [None, 'x', math.nan, math.inf, -math.inf, [], 1e300, True]


@pytest.fixture(scope='module')
def orbit():
    return find_orbits(LEVEL, (1, 2)).orbits[0]


@pytest.mark.parametrize('number', NO_NUMBERS)
def test_numbers_of_cycles_and_impacts(orbit, number):
    with pytest.raises(OrbitError, match=r'force cycles: give a period of at least 1 cycle'):
        find_orbits(LEVEL, (1, 2), number)
    impact = Event(0.0, EventKind.IMPACT, 1, orbit.x[0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(OrbitError, match=r'force cycles: give a period of at least 1 cycle'):
        orbit_near(LEVEL, impact, orbit.phases[0], number)
    with pytest.raises(OrbitError, match='impacts: give at least 1 in a period'):
        plausible_stops(LEVEL, number)


@pytest.mark.parametrize('starts', [s for s in NO_NUMBERS if s not in (0, None)])
def test_numbers_of_starts(starts):
    with pytest.raises(OrbitError, match=r'starts is .*: give a whole number from 0 to 1000000'):
        find_orbits(LEVEL, (1, 2, 2), starts=starts)


@pytest.mark.parametrize(
    'stops', [None, 'x', 3.0, [], (1, 3), (True, 2), '12', (1, None), (math.nan,), 5]
)
def test_stop_sequences(stops):
    with pytest.raises(OrbitError, match=r'stop sequence .*: give the stops hit in one period'):
        find_orbits(LEVEL, stops)


def test_a_stop_sequence_without_end():
    with pytest.raises(OrbitError, match='stop sequence'):
        find_orbits(LEVEL, itertools.repeat(3))


@pytest.mark.parametrize('kind', [np.int64, np.float32, np.array])
def test_any_kind_of_number(orbit, kind):
    found = find_orbits(LEVEL, [kind(1), kind(2)], kind(1)).orbits[0]
    assert found == orbit
    assert type(found.cycles) is int


@pytest.mark.parametrize('end', NO_RANGES)
def test_ends_of_a_range(orbit, end):
    for low, high in ((end, 40.0), (30.0, end)):
        with pytest.raises(OrbitError, match=r'end of gap is .*: give a number from -1e'):
            continue_orbit(orbit, Continuation('gap', low, high))


@pytest.mark.parametrize(
    ('low', 'high', 'words'),
    [
        (40.0, 30.0, 'gap from 40 to 30 is no range: give the low end first'),
        (37.0, 37.0, 'gap from 37 to 37 is no range'),
        (50.0, 60.0, 'gap is 37 where the branch begins: give a range around that, not 50 to 60'),
    ],
)
def test_ranges_without_the_motion(orbit, low, high, words):
    """Such a range once ended in a message of a root finder, or at an end that was not reached."""
    with pytest.raises(OrbitError, match=words):
        continue_orbit(orbit, Continuation('gap', low, high))


@pytest.mark.parametrize('step', [None, 'x', math.nan, math.inf, -1, 0, 2.0, []])
def test_steps_of_a_branch(orbit, step):
    with pytest.raises(OrbitError, match=r'largest_step is .*: give a number from 1e-09 to 1'):
        continue_orbit(orbit, Continuation('gap', 30.0, 40.0, largest_step=step))


@pytest.mark.parametrize('points', NO_NUMBERS)
def test_points_of_a_branch(orbit, points):
    with pytest.raises(OrbitError, match=r'most_points is .*: give a whole number from 1 to'):
        continue_orbit(orbit, Continuation('gap', 30.0, 40.0, most_points=points))


@pytest.mark.parametrize('name', [None, 'x', 5, [], np.array(1), 'one_sided', 'multisine_lines'])
def test_names_of_what_varies(orbit, name):
    for varied in (
        lambda: value_of(LEVEL, name),
        lambda: continue_orbit(orbit, Continuation(name, 30.0, 40.0)),
    ):
        with pytest.raises(OrbitError, match='cannot be varied: give one of primary_mass'):
            varied()


def test_a_branch_that_leaves_in_no_range():
    with pytest.raises(OrbitError, match='gap from 2 to 1 is no range'):
        switch_branch(None, Continuation('gap', 2.0, 1.0))


@pytest.mark.parametrize('name', ['cycles', 'watch', 'events', 'section'])
@pytest.mark.parametrize('number', NO_NUMBERS)
def test_how_long_a_rig_may_settle(name, number):
    """2.5 cycles were once refused for the instants of samples, and 2.5 events taken."""
    with pytest.raises(ValueError, match=f'{name} is .*: give a whole number from'):
        Settling(**{name: number})


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
