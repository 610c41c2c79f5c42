"""The boundary-value problem: against differences, the simulator and the equations."""

import math

import numpy as np
import pytest
from rigs import FRICTION, VERTICAL

from impact_damper_ros import (
    EventKind,
    ImpactEquations,
    RigParameters,
    find_orbits,
    value_of,
    with_value,
)
from impact_damper_ros.motion.flight import begin_flight, motion_at
from impact_damper_ros.motion.state import (
    CHATTER_1,
    NUMBERS,
    REST_1,
    REST_2,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
)
from impact_damper_ros.orbits.closed_flights import (
    DERIVATIVE,
    END,
    INSTANT,
    JERK,
    RATE_END,
    SPAN,
    VALUE,
    fly_all,
    set_rig,
    write_equations,
)
from impact_damper_ros.orbits.flights import machine_of, moving_at
from impact_damper_ros.orbits.impact_equations import set_coefficients, write_velocities
from impact_damper_ros.orbits.newton import add_parameter
from impact_damper_ros.orbits.periodic_problem import (
    Node,
    PeriodicProblem,
    impact_nodes,
    parameter_numbers,
)
from impact_damper_ros.orbits.solved_orbits import guess_on

RIG = RigParameters(
    friction=0.3,
    angle=0.4,
    gravity=1.3,
    gap=30.0,
    restitution_2=0.5,
    restitution_speed=2.0,
    restitution_exponent=0.4,
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


def without_compiler(monkeypatch):
    for place in ('orbits.periodic_problem', 'orbits.flights', 'motion.kernels'):
        monkeypatch.setattr(f'impact_damper_ros.{place}.has_numba', lambda: False)


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    """Run the kernels as they are, uncompiled."""
    without_compiler(monkeypatch)


def problem_of(pattern, rig=RIG):
    """Return a problem at unknowns that solve nothing, with events in order."""
    problem = PeriodicProblem(rig, PATTERNS[pattern], 2)
    arrays = problem.arrays
    set_rig(arrays.moving.constants, arrays.moving.lines, problem.rig)
    rng = np.random.default_rng(1)
    n = len(problem.nodes)
    states = 3.0 * rng.normal(size=(n, 4))
    instants = np.sort(rng.uniform(0.0, problem.period, n))
    problem.place[:-1] = problem.unknowns(states, instants)
    return problem


def equations_at(problem):
    """Return the residual and its derivative."""
    write_equations(problem.arrays, True)
    values = problem.arrays.sheet[VALUE, : len(problem.place) - 1].copy()
    return values, problem.matrix(DERIVATIVE)[:-1, :-1].copy()


@pytest.mark.parametrize('pattern', PATTERNS)
def test_the_derivative_is_that_of_the_residual(pattern):
    problem = problem_of(pattern)
    place = problem.place
    _, jacobian = equations_at(problem)
    for k in range(len(place) - 1):
        here = place[k]
        place[k] = here + 1e-6
        ahead, _ = equations_at(problem)
        place[k] = here - 1e-6
        behind, _ = equations_at(problem)
        place[k] = here
        slope = (ahead - behind) / 2e-6
        assert jacobian[:, k] == pytest.approx(slope, abs=1e-8 * np.abs(jacobian).max())


@pytest.mark.parametrize('name', [*NUMBERS, 'force_amplitudes', 'force_phases'])
@pytest.mark.parametrize('pattern', PATTERNS)
def test_the_derivative_by_a_parameter(pattern, name):
    """That along a path of rigs is that of the residuals of rigs on both sides."""
    problem = problem_of(pattern)
    value, sides, numbers = value_of(RIG, name), [], []
    place, step = problem.place.copy(), 1e-5
    for move in (step, -step):
        other = PeriodicProblem(with_value(RIG, name, value + move), problem.nodes, 2)
        set_rig(other.arrays.moving.constants, other.arrays.moving.lines, other.rig)
        # The length may change with the parameter.
        other.units[:2] = problem.units[:2]
        other.place[:] = place
        sides.append(equations_at(other)[0])
        numbers.append(other.rig)
    slope = (numbers[0] - numbers[1]) / (2.0 * step)
    problem.set_path(parameter_numbers(RIG) - value * slope, slope)
    problem.place[-1] = value
    add_parameter(problem.arrays)
    by_value = problem.matrix(DERIVATIVE)[:-1, -1]
    size = max(1.0, np.abs(by_value).max())
    assert by_value == pytest.approx((sides[0] - sides[1]) / (2.0 * step), abs=1e-6 * size)


@pytest.mark.parametrize('pattern', PATTERNS)
def test_flights_are_those_of_the_simulator(pattern):
    problem = problem_of(pattern)
    arrays, half = problem.arrays, 0.5 * RIG.gap
    equations_at(problem)
    for row, node in zip(arrays.table, problem.layout.nodes, strict=True):
        x, velocity, way, relative = row[:4]
        beyond = way if node.last == 1 else way - 2.0 * half
        resting = node.resting
        at = machine_of(RIG), row[INSTANT], x, velocity, beyond, relative, resting, node.last
        moving = moving_at(*at)
        moving.run.mode = resting or node.mode
        begin_flight(moving)
        motion = motion_at(moving, float(row[SPAN]))
        travel = 0.0 if resting else motion.travel
        expected = [motion.x, motion.velocity, way + travel]
        expected.append(0.0 if resting else motion.relative_velocity)
        # Where m just begins to move, it does so as the condition of the node says.
        known = 2 if not resting and relative == 0.0 else 4
        assert row[END : END + known] == pytest.approx(expected[:known], rel=1e-12, abs=1e-12)
        assert row[RATE_END + 1] == pytest.approx(motion.x_2, rel=1e-12, abs=1e-12)
        assert row[JERK] == pytest.approx(motion.x_3, rel=1e-11, abs=1e-12)


def test_the_way_of_a_short_bounce_keeps_its_digits():
    """A hundred millionth of the period, on a stop that rides on a large displacement."""
    bounce = Node(EventKind.IMPACT, 1, 0)
    problem = PeriodicProblem(VERTICAL, (bounce, bounce), 1)
    arrays = problem.arrays
    set_rig(arrays.moving.constants, arrays.moving.lines, problem.rig)
    states = np.array([[5.0, -3.0, 0.0, -1e-6], [4.0, 2.0, 0.0, -1.0]])
    instants = np.array([0.1, 0.1 + 1e-8 * problem.period])
    problem.place[:-1] = problem.unknowns(states, instants)
    fly_all(arrays)
    moving = moving_at(machine_of(VERTICAL), 0.1, 5.0, -3.0, 0.0, -1e-6, 0, 1)
    motion = motion_at(moving, float(instants[1] - instants[0]))
    assert arrays.table[0, END + 2] == pytest.approx(motion.travel, rel=1e-9)


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
        problem = PeriodicProblem(there, impact_nodes(stops), cycles)
        arrays = problem.arrays
        set_rig(arrays.moving.constants, arrays.moving.lines, problem.rig)
        rng = np.random.default_rng(1)
        n = len(stops)
        x = 3.0 * rng.normal(size=n)
        instants = np.sort(rng.uniform(0.0, equations.period, n))
        phase = equations.frequency * instants[0] + equations.phase
        rows = equations.linear_system(instants - instants[0])
        vector = np.concatenate([x, [math.cos(phase), math.sin(phase), 1.0]])
        problem.place[:-1:4], problem.place[3:-1:4] = (
            x / problem.length,
            equations.frequency * instants,
        )
        set_coefficients(arrays)
        write_velocities(arrays)
        fly_all(arrays)
        end = arrays.table[:, END]
        assert np.roll(x, -1) - end == pytest.approx((rows @ vector)[:n], abs=1e-12)


@pytest.mark.parametrize('gap', [16.0, 20.0])
def test_without_a_compiler_motions_are_the_same(gap, monkeypatch):
    """With reversals, and with sticking."""
    monkeypatch.undo()
    rig = FRICTION.replace(gap=gap, gravity=1.0 if gap < 18.0 else 2.0)
    orbit = find_orbits(rig, (1, 1, 2) if gap < 18.0 else (1, 2)).orbits[0]
    guess = guess_on(orbit)
    assert len(guess.nodes) > orbit.impacts
    solution = PeriodicProblem(rig, guess.nodes, 1).solve(*guess[1:])
    without_compiler(monkeypatch)
    plain_solution = PeriodicProblem(rig, guess.nodes, 1).solve(*guess[1:])
    assert (plain_solution.viable, plain_solution.reason) == (True, solution.reason)
    assert plain_solution.x_max == pytest.approx(solution.x_max, rel=1e-13)
    assert plain_solution.multipliers == pytest.approx(solution.multipliers, abs=1e-11)
