"""How deviations grow: against finite differences, trajectories and pairs of motions."""

import math

import numpy as np
import pytest
from sweep.example_rigs import CHATTERING, ON_THE_STOP

from impact_damper_ros import EventKind, InitialConditions, MotionKind, Rig, RigParameters, settle
from impact_damper_ros.orbits.flight_arrays import run_flights
from impact_damper_ros.orbits.lyapunov import monodromy_of

#: Frictionless and horizontal, with many impacts that never repeat.
CHAOTIC = RigParameters(gravity=0.0, force_frequencies=1.02, gap=12.0)
RIGS = {
    'inclined, with friction': RigParameters(angle=0.6, gravity=1.0, friction=0.4, gap=20.0),
    'sticking': RigParameters(gravity=1.0, friction=4.0, gap=9.0),
    'two harmonics': RigParameters(
        angle=0.2,
        gravity=1.0,
        friction=0.3,
        gap=15.0,
        force_amplitudes=(1.0, 0.6),
        force_frequencies=(1.02, 2.3),
        force_phases=(0.4, 1.9),
    ),
    'chattering': CHATTERING.replace(force_phases=0.6 * math.tau),
}


def run_from(parameters, state):
    """Return a run from X, X', Z and Z'; round-off must not put m beyond a stop."""
    half = 0.5 * parameters.gap
    x, velocity, z, damper = state
    initial = InitialConditions(
        initial_primary_position=x,
        initial_primary_velocity=velocity,
        initial_damper_offset=min(max(z - x, -half), half),
        initial_damper_velocity=damper,
    )
    return Rig(parameters, initial)


def state_of(run):
    sample = run.sample()
    return np.array([sample.x, sample.primary_velocity, sample.z, sample.damper_velocity])


#: From (X, X', Y, Y') to (X, X', Z, Z')
ABSOLUTE = np.eye(4) + np.eye(4, k=-2)


@pytest.mark.parametrize('name', RIGS)
def test_matrix_is_the_derivative_of_the_flow(name):
    """By central differences of whole runs from disturbed starts, m free at the start."""
    rig = RIGS[name]
    half = 0.5 * rig.gap
    start = np.array([1.3, -0.4, 1.3 + 0.3 * half, 9.0])
    if name == 'chattering':
        # In the flight of the settled motion: impact, chatter, rest, release and flight again
        run = Rig(rig, ON_THE_STOP, compiled=None)
        settle(run)
        start = state_of(run)
        assert start[2] - start[0] < half - 1e-5
    cycle = math.tau / rig.force_frequencies[0]
    end = (1.0 if name == 'chattering' else 1.7) * cycle
    run = run_from(rig, start)
    flights = run_flights(run, end)
    kinds = {EventKind(kind) for kind in flights.rows['kind'][1:-1]}
    assert EventKind.IMPACT in kinds
    assert (EventKind.STICK in kinds) is (name == 'sticking')
    assert (EventKind.REST in kinds) is (name == 'chattering')
    matrix = ABSOLUTE @ monodromy_of(flights, 0.0, end) @ np.linalg.inv(ABSOLUTE)
    step = 1e-7 * (1.0 if name == 'chattering' else 10.0)
    for column in range(4):
        ends = []
        for sign in (1.0, -1.0):
            disturbed = start.copy()
            disturbed[column] += sign * step
            other = run_from(rig, disturbed)
            other.run(end)
            ends.append(state_of(other))
        difference = (ends[0] - ends[1]) / (2.0 * step)
        assert matrix[:, column] == pytest.approx(difference, rel=2e-4, abs=2e-5), column


def test_exponent_of_a_chaotic_rig_against_pairs_of_motions():
    """Benettin's method: a second motion, 1e-7 off, brought near again after each cycle."""
    run = Rig(CHAOTIC, compiled=None)
    found = settle(run, cycles=1800, watch=1500)
    assert found.kind is MotionKind.CHAOTIC
    cycle, here = found.cycle, state_of(run)
    offset = 1e-7 * np.array([0.5, 0.5, -0.5, 0.5])
    growth = []
    for _ in range(500):
        ends = []
        for state in (here, here + offset):
            run = run_from(CHAOTIC, state)
            run.run(cycle, record=False)
            ends.append(state_of(run))
        apart = ends[1] - ends[0]
        size = float(np.linalg.norm(apart))
        growth.append(math.log(size / 1e-7))
        here, offset = ends[0], apart * (1e-7 / size)
    rates = np.array(growth[20:]) / cycle
    error = 2.0 * rates.std() / math.sqrt(len(rates) / 4)
    assert found.exponent.value > 10.0 * found.exponent.uncertainty
    assert found.exponent.value == pytest.approx(
        rates.mean(), abs=error + found.exponent.uncertainty
    )
