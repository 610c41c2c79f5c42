"""The impact equations as starts, the sequences of stops, and what the theory excludes."""

import numpy as np
import pytest

from impact_damper_ros import (
    ImpactEquations,
    OrbitError,
    RigParameters,
    find_orbits,
    plausible_stops,
)
from impact_damper_ros.orbits import arguments

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


@pytest.mark.parametrize(
    ('changes', 'stops', 'cycles', 'words'),
    [
        ({}, (1, 1, 2), 1, 'same stop'),
        ({'one_sided': True}, (1, 2), 1, 'one-sided'),
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


@pytest.mark.parametrize('stops', [(), (1, 3)])
def test_stop_sequences(stops):
    with pytest.raises(OrbitError, match=r'stop sequence .*: give the stops hit in one period'):
        find_orbits(LEVEL, stops)


def test_a_parameter_that_does_not_enter_the_equations(monkeypatch):
    monkeypatch.setattr(arguments, 'UNKNOWN', ('air_force',))
    assert find_orbits(LEVEL, (1, 2)).orbits
    with pytest.raises(OrbitError, match=r'air_force is 0.1: .* does not cover it, give 0.0'):
        find_orbits(LEVEL.replace(air_force=0.1), (1, 2))
    monkeypatch.undo()
    assert arguments.UNKNOWN == ()


@pytest.mark.parametrize('frequency', [1e-300, 1e-9])
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


@pytest.mark.parametrize('damping', [5e-324, 1e-310])
def test_a_damping_that_is_hardly_a_float(damping, recwarn):
    """The quotient for the response near resonance was once inf/inf: the SVD did not converge."""
    damped = find_orbits(LEVEL.replace(damping=damping), (1, 2), simulate=False).orbits
    undamped = find_orbits(LEVEL.replace(damping=0.0), (1, 2), simulate=False).orbits
    assert [o.x for o in damped] == [pytest.approx(o.x, abs=1e-9) for o in undamped]
    assert not recwarn.list
