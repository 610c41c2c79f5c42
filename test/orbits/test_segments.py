"""The boundary-value problem: against differences, the simulator and the equations."""

import math

import numpy as np
import pytest
from rigs import VERTICAL

from impact_damper_ros import EventKind, ImpactEquations, RigParameters
from impact_damper_ros.motion.state import CHATTER_1, REST_1, REST_2, SLIDE_DOWN, SLIDE_UP, STICK
from impact_damper_ros.orbits.segments import Node, Segments, impact_nodes

RIG = RigParameters(
    friction=0.3,
    angle=0.4,
    gravity=1.3,
    gap=30.0,
    restitution_2=0.5,
    force_amplitudes=(1.0, 0.3, 0.2),
    force_frequencies=(1.02, 2.04, 3.06),
    force_phases=(0.3, 1.0, -2.0),
    air_force=0.02,
    damper_mass=0.1,
    damping=0.05,
)
UP_1, DOWN_2 = Node(EventKind.IMPACT, 1, SLIDE_UP), Node(EventKind.IMPACT, 2, SLIDE_DOWN)
TURN_DOWN = Node(EventKind.REVERSAL, 0, SLIDE_DOWN)
PATTERNS = {
    'impacts': (UP_1, DOWN_2),
    'one impact': (UP_1,),
    'reversal': (UP_1, TURN_DOWN, UP_1, DOWN_2),
    'sticking': (
        UP_1,
        DOWN_2,
        Node(EventKind.STICK, 0, STICK),
        Node(EventKind.RELEASE, 0, SLIDE_UP),
        TURN_DOWN,
    ),
    'rest': (
        UP_1,
        TURN_DOWN,
        Node(EventKind.IMPACT, 1, REST_1),
        Node(EventKind.RELEASE, 1, SLIDE_UP),
        Node(EventKind.IMPACT, 2, REST_2),
        Node(EventKind.RELEASE, 2, SLIDE_DOWN),
    ),
    'chatter': (
        UP_1,
        TURN_DOWN,
        UP_1,
        TURN_DOWN,
        Node(EventKind.IMPACT, 1, CHATTER_1),
        Node(EventKind.RELEASE, 1, SLIDE_UP),
        DOWN_2,
    ),
}


def anywhere(segments):
    """Return unknowns that solve nothing, with events in order."""
    rng = np.random.default_rng(1)
    n = len(segments.nodes)
    states = 3.0 * rng.normal(size=(n, 4))
    instants = np.sort(rng.uniform(0.0, segments.period, n))
    return segments.unknowns(states, instants)


@pytest.mark.parametrize('pattern', PATTERNS)
def test_the_derivative_is_that_of_the_residual(pattern):
    segments = Segments(RIG, PATTERNS[pattern], 2)
    unknowns = anywhere(segments)
    _, jacobian = segments.residual(unknowns)
    assert jacobian.shape == (len(unknowns), len(unknowns))
    for k in range(len(unknowns)):
        move = np.zeros_like(unknowns)
        move[k] = 1e-6
        ahead, _ = segments.residual(unknowns + move)
        behind, _ = segments.residual(unknowns - move)
        slope = (ahead - behind) / 2e-6
        assert jacobian[:, k] == pytest.approx(slope, abs=1e-8 * np.abs(jacobian).max())


@pytest.mark.parametrize('pattern', PATTERNS)
def test_the_derivative_by_the_gap(pattern):
    sides = []
    segments = Segments(RIG, PATTERNS[pattern], 2)
    unknowns = anywhere(segments)
    for gap in (30.0 + 1e-3, 30.0 - 1e-3):
        other = Segments(RIG.replace(gap=gap), PATTERNS[pattern], 2)
        # The length may change with the gap.
        other.set_units(segments.length, segments.length * segments.rate, segments.rate)
        sides.append(other.residual(unknowns)[0])
    slope = (sides[0] - sides[1]) / 2e-3
    assert segments.by_gap() == pytest.approx(slope, abs=1e-9)
    both = len({node.stop for node in segments.nodes} - {0}) == 2
    assert bool(np.abs(slope).max() > 1e-3) is both


@pytest.mark.parametrize('pattern', PATTERNS)
def test_flights_are_those_of_the_simulator(pattern):
    segments = Segments(RIG, PATTERNS[pattern], 2)
    states, instants = segments.motion(anywhere(segments))
    after = segments.flights(states, instants)
    for j, duration in enumerate(segments.durations(instants)):
        flight = segments.flight(j, states[j], instants[j])
        motion = flight.motion(float(duration))
        relative = 0.0 if flight.run.joint else motion.relative_velocity
        travel = 0.0 if flight.run.joint else motion.travel
        expected = [motion.x, motion.velocity, states[j, 2] + travel, relative]
        # Where m just begins to move, it does so as the condition of the node says.
        known = 2 if not flight.run.joint and states[j, 3] == 0.0 else 4
        assert after.end[j, :known] == pytest.approx(expected[:known], rel=1e-12, abs=1e-12)
        assert after.rate_end[j, 1] == pytest.approx(motion.x_2, rel=1e-12, abs=1e-12)
        assert after.jerk[j] == pytest.approx(motion.x_3, rel=1e-11, abs=1e-12)


def test_the_way_of_a_short_bounce_keeps_its_digits():
    """A hundred millionth of the period, on a stop that rides on a large displacement."""
    segments = Segments(VERTICAL, (Node(EventKind.IMPACT, 1, 0), Node(EventKind.IMPACT, 1, 0)), 1)
    states = np.array([[5.0, -3.0, 0.0, -1e-6], [4.0, 2.0, 0.0, -1.0]])
    instants = np.array([0.1, 0.1 + 1e-8 * segments.period])
    end = segments.flights(states, instants).end[0]
    motion = segments.flight(0, states[0], 0.1).motion(float(instants[1] - instants[0]))
    assert end[2] == pytest.approx(motion.travel, rel=1e-9)


def test_flights_lead_to_where_the_impact_equations_say():
    """X after each flight, with the velocities of the equations, is that of their linear form."""
    rig = RIG.replace(force_amplitudes=1.0, force_frequencies=1.02, force_phases=0.3)
    for stops, cycles, friction in (
        ((1, 2), 1, 0.3),
        ((1, 2, 1, 2), 2, 0.3),
        ((1, 1, 2), 1, 0.0),
        ((1,), 2, 0.0),
    ):
        there = rig.replace(friction=friction)
        equations = ImpactEquations(there, stops, cycles)
        segments = Segments(there, impact_nodes(stops), cycles)
        rng = np.random.default_rng(1)
        n = len(stops)
        x = 3.0 * rng.normal(size=n)
        instants = np.sort(rng.uniform(0.0, equations.period, n))
        phase = equations.frequency * instants[0] + equations.phase
        rows = equations.linear_system(instants - instants[0])
        vector = np.concatenate([x, [math.cos(phase), math.sin(phase), 1.0]])
        end = segments.flights(equations.states(x, instants), instants).end
        assert np.roll(x, -1) - end[:, 0] == pytest.approx((rows @ vector)[:n], abs=1e-12)
