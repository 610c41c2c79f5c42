"""A course with wrong impacts is set right by the engine."""

from dataclasses import replace

import numpy as np
import pytest

from impact_damper_ros.fit.contradictions import contradiction_of
from impact_damper_ros.fit.gauss_newton import solve
from impact_damper_ros.fit.replayed_course import Memory, ReplayedCourse
from impact_damper_ros.fit.revision import UNCONFIRMED, Revised
from impact_damper_ros.fit.shooting import Shooting
from impact_damper_ros.fit.unknowns import Unknowns

from .random_rigs import DEVIATION, measure, random_rig, true_course


def truth(seed, impacts=40, timed=False, friction=None):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    if friction is not None:
        rig = rig.replace(friction=friction)
    measurement = measure(rig, rng, impacts=impacts, timed=timed)
    unknowns = Unknowns(rig, False, ())
    record, course = true_course(unknowns, measurement)
    times = measurement.record.impact_times
    times = np.zeros(0) if times is None else times

    def problem(of):
        return Shooting(record, measurement.deviation, unknowns, of, times, DEVIATION)

    return unknowns, course, problem


def picked(course, index):
    """Return the course of some impacts."""
    arrays = ('time', 'x', 'velocity', 'damper_velocity', 'stop', 'begins', 'measured')
    return replace(
        course,
        **{name: getattr(course, name)[index] for name in arrays},
        turns=[course.turns[k] for k in index[:-1]],
        after=[course.after[k] for k in index[:-1]],
        held=[course.held[k] for k in index[:-1]],
    )


def revised(course, problem):
    turn = ReplayedCourse(course, problem(course), Memory(0.01), {}, 0.006)
    return turn.revise(), turn


@pytest.mark.parametrize('timed', [False, True])
def test_wrong_impacts_are_replaced_by_those_of_the_engine(timed):
    _, course, problem = truth(105, timed=timed)
    assert course.flies.all()
    _, turn = revised(course, problem)
    assert not turn.changed
    # One is missing, one is false, and one is in a wrong place
    wrong = picked(course, [*range(12), *range(13, 22), *range(21, len(course))])
    wrong.time[21] = 0.5 * (wrong.time[20] + wrong.time[22])
    wrong.stop[21], wrong.measured[21] = 1, -1
    wrong.time[30] += 0.012
    wrong.begins[[21, 22, 30, 31]] = True
    found, turn = revised(wrong, problem)
    assert found.flies.all(), turn.why_cut
    np.testing.assert_allclose(found.time, course.time, atol=1e-9)
    np.testing.assert_array_equal(found.stop, course.stop)
    for mine, true in zip(found.turns, course.turns, strict=True):
        np.testing.assert_allclose(mine, true, atol=1e-9)


@pytest.mark.parametrize('friction', [0.15, 0.25])
def test_sticks_of_the_engine_become_nodes(friction):
    _, course, problem = truth(108, friction=friction)
    assert sum((ways == 0).any() for ways in course.after) > 10
    found, turn = revised(course, problem)
    assert not turn.changed
    assert found.structure[2] == course.structure[2]
    for mine, true in zip(found.turns, course.turns, strict=True):
        np.testing.assert_allclose(mine, true, atol=1e-9)


def test_what_the_data_contradict_is_not_changed():
    _, course, problem = truth(105)
    wrong = picked(course, [*range(12), *range(13, len(course))])
    shooting = problem(course)
    # M moves as if nothing had hit it between the two
    inside = (shooting.record.time > course.time[11]) & (shooting.record.time < course.time[13])
    shooting.record.motion[inside] += 20.0 * shooting.deviation
    found, turn = revised(wrong, problem)
    assert not found.flies[11]
    assert turn.why_cut


def test_only_flights_that_the_engine_makes_are_confirmed():
    _, course, problem = truth(105)
    course.damper_velocity[12] *= 1.1
    course.turns[20] = np.append(course.turns[20], 0.5 * (course.time[20:22].sum()))
    course.after[20] = np.append(course.after[20], 0)
    course.held[20] = np.zeros(len(course.turns[20]), bool)
    turn = ReplayedCourse(course, problem(course), Memory(0.01), {}, 0.006)
    confirmed = [turn.confirms(k) for k in range(len(course) - 1)]
    assert [k for k, sure in enumerate(confirmed) if not sure] == [12, 20]


def test_there_is_one_verdict_for_each_flight():
    _, course, problem = truth(108)
    turning = next(k for k in range(25) if course.flies[k] and len(course.turns[k]))
    course.held[turning] = np.ones(len(course.turns[turning]), bool)
    shooting = problem(course)
    # M moves on behind the impact as before it
    before = shooting.speeds_before(shooting.start())
    course.velocity[30] = before[shooting.impacts[30] - 1]
    shooting = problem(course)
    solution = solve(shooting, shooting.start(), most=0)
    gains = np.zeros(len(course) - 1)
    gains[5] = 25.0
    revised = Revised(course, shooting, solution, gains, {})
    wanted = {
        turning: 'm hardly reverses in it',
        29: 'm hardly touches a stop',
        30: 'computed from its start, m does not arrive as measured',
        5: contradiction_of(25.0),
    }
    found = revised.verdicts()
    assert {k: why for k, why in found.items() if why != UNCONFIRMED} == wanted
    assert revised.grazes.nonzero()[0].tolist() == [30]
    left = revised.without_rejected(problem)
    assert left.verdicts() == {}
    assert left.why_cut.items() >= {k + 1: why for k, why in wanted.items()}.items()
    # A measured time shows that there was an impact
    course.measured[30] = 0
    assert not revised.grazes.any()
