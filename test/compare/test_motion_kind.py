"""
What short recordings of rigs are found to be, whose motion after 20,000 cycles is known.

The rigs are those of `motion_kinds.py`, which finds the answers by long runs and judges
all of them; here are a few, with the answers as it printed them.
"""

import math
from functools import cache

import numpy as np
import pytest
from compare import motion_kinds
from compare.recorded import impact_rows, recorded
from rigs import BENCH, FRICTION, OFF_RESONANCE

from impact_damper_ros.compare.motion_kind import kind_of, largest_exponent
from impact_damper_ros.compare.recorded_stretch import ForceClock
from impact_damper_ros.control import Rig
from impact_damper_ros.orbits.irregularity import (
    Indications,
    average_spread,
    quiet_phase,
    zero_one_test,
)
from impact_damper_ros.orbits.recurrence import MotionKind
from impact_damper_ros.sweep import Settling
from impact_damper_ros.sweep.steady_state import steady_state

CHAOTIC, QUASI = MotionKind.CHAOTIC, MotionKind.QUASI_PERIODIC
TRANSIENT, PERIODIC = MotionKind.TRANSIENT, MotionKind.PERIODIC
UNDECIDED = MotionKind.UNDECIDED


@cache
def known():
    return {case.name: case for case in motion_kinds.cases(0)}


def found_of(name, cycles):
    case = known()[name]
    run = Rig(case.parameters, case.initial)
    impacts = motion_kinds.impacts_of(case, run.run(cycles * case.cycle).events)
    return kind_of(ForceClock(case.parameters, 0.0, (0.0,)), impacts)


def test_the_third_stage_of_the_demonstration():
    """It was called quasi-periodic, at an exponent of +0.383 with a standard error of 0.143."""
    rig = Rig(BENCH.replace(gap=0.0145))
    rig.advance(30.0)
    rig.change(BENCH)
    rig.advance(60.0)
    tilted = BENCH.replace(angle=0.2)
    rig.change(tilted)
    events = rig.advance(80.0)
    for seconds in (4.0, 10.0, 20.0):
        impacts = impact_rows([event for event in events if event.time <= 60.0 + seconds])
        found = kind_of(ForceClock(tilted, 0.0, (0.0,)), impacts)
        assert found.kind is CHAOTIC, found.evidence
        exponent, error = found.measures['lyapunov_exponent'], found.measures['lyapunov_error']
        # Over 20,000 cycles 0.312 +- 0.006
        assert exponent == pytest.approx(0.312, abs=4.0 * error)
        assert error < 0.04
        assert f'{exponent:+.3f}' in found.evidence


@pytest.mark.parametrize(
    ('name', 'cycles', 'kind'),
    [
        ('level, gap 37', 30, TRANSIENT),
        ('level, gap 37', 300, PERIODIC),
        ('level, gap 50', 30, CHAOTIC),
        ('bench, gap 0.012', 100, CHAOTIC),
        ('bench, angle 0.14', 100, TRANSIENT),
        ('vertical, force 1.6', 100, CHAOTIC),
        ('heavy at 1.1, gap 8.757', 30, QUASI),
        ('heavy at 1.1, gap 8.757', 300, QUASI),
        ('heavy, gap 10.062', 300, QUASI),
        # A torus about to break up
        ('heavy at 1.1, gap 9.0', 30, UNDECIDED),
        # Locked to a period of 13 cycles, after hundreds of others
        ('heavy at 1.1, gap 9.2', 1000, PERIODIC),
        # Its exponent is +0.019 +- 0.001 in the end.
        ('heavy at 1.1, gap 9.3', 100, UNDECIDED),
    ],
)
def test_short_recordings(name, cycles, kind):
    found = found_of(name, cycles)
    assert found.kind is kind, found.evidence
    if kind in (CHAOTIC, QUASI):
        exponent, error = found.measures['lyapunov_exponent'], found.measures['lyapunov_error']
        assert (exponent > 5.0 * error) is (kind is CHAOTIC)
    if kind is TRANSIENT:
        assert found.recurrence is not None
    if kind is UNDECIDED:
        assert 'would decide' in found.evidence
        assert found.short


@pytest.mark.parametrize(
    ('name', 'cycles', 'kind'),
    [
        ('level, gap 50', 400, CHAOTIC),
        ('heavy at 1.1, gap 8.757', 400, QUASI),
        # At first its exponent is 0.09.
        ('heavy at 1.1, gap 9.3', 1000, UNDECIDED),
    ],
)
def test_a_sweep_says_the_same(name, cycles, kind):
    case = known()[name]
    run = Rig(case.parameters, case.initial)
    assert steady_state(run, Settling(cycles=cycles, watch=500)).kind is kind


def test_weighted_averages_of_known_sequences():
    n = np.arange(1000)
    golden = math.tau * 0.5 * (math.sqrt(5.0) - 1.0)
    circle = np.column_stack([np.cos(golden * n), np.sin(2.0 * golden * n)])
    assert average_spread(circle) < 1e-8
    logistic = np.empty((1000, 1))
    logistic[0] = 0.3
    for i in range(999):
        logistic[i + 1] = 3.97 * logistic[i] * (1.0 - logistic[i])
    assert average_spread(logistic) > 0.01
    assert math.isnan(average_spread(circle[:299]))
    assert quiet_phase(np.array([0.1, 0.3, 7.2])) == pytest.approx(0.7)
    assert quiet_phase(np.array([0.9, 0.5])) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ('exponent', 'error', 'cycles', 'spread', 'kind'),
    [
        (0.383, 0.143, 50, math.nan, UNDECIDED),
        (0.3, 0.02, 1500, 0.1, CHAOTIC),
        (0.3, 0.02, 1500, 1e-4, UNDECIDED),
        # Certain, but it grows by no more than e to the ninth
        (0.006, 0.001, 1500, 0.1, UNDECIDED),
        (0.0005, 0.001, 1500, 1e-5, QUASI),
        (0.0005, 0.001, 1500, 0.1, UNDECIDED),
        (0.0005, 0.001, 200, 1e-5, UNDECIDED),
        (0.0015, 0.001, 1500, 1e-5, UNDECIDED),
        (-0.01, 0.001, 1500, 1e-5, UNDECIDED),
    ],
)
def test_the_thresholds(exponent, error, cycles, spread, kind):
    assert Indications(exponent, error, cycles, spread).kind() is kind


def test_how_much_more_would_decide():
    # Five standard errors, which shrink with the root of the cycles
    assert Indications(0.4, 0.1, 100, math.nan).cycles_to_decide() == 157
    # Growth by e to the tenth
    assert Indications(0.01, 0.001, 400, math.nan).cycles_to_decide() == 1000
    assert Indications(0.01, 0.01, 400, math.nan).cycles_to_decide() == 0


def test_the_zero_one_test():
    logistic = np.empty(600)
    logistic[0] = 0.3
    for i in range(599):
        logistic[i + 1] = 3.97 * logistic[i] * (1.0 - logistic[i])
    assert zero_one_test(logistic) > 0.95
    assert abs(zero_one_test(np.cos(np.arange(600) * 0.618 * math.tau))) < 0.1
    assert math.isnan(zero_one_test(logistic[:50]))


def test_the_exponent_of_a_periodic_motion_is_that_of_its_multipliers():
    _, impacts, clock = recorded(FRICTION, 400, per_cycle=4)
    found = largest_exponent(clock, impacts[len(impacts) // 2 :])
    assert found.exponent == pytest.approx(math.log(0.94107), abs=0.006)
    assert largest_exponent(clock, impacts[:10]) is None


def test_the_exponent_against_two_neighbouring_runs():
    """Two simulated runs part as fast as the exponent along one of them says."""
    rig = OFF_RESONANCE.replace(gap=20.0)
    _, impacts, clock = recorded(rig, 700, per_cycle=4)
    exponent = largest_exponent(clock, impacts[200:])
    assert 0.2 < exponent.exponent < 0.5
    assert exponent.error < 0.08


@pytest.mark.parametrize('case', list(motion_kinds.cases(12))[-12:], ids=lambda case: case.name)
def test_random_rigs(case):
    """All rigs, and more random ones: `python -m compare.motion_kinds`."""
    pytest.importorskip('numba')
    judged = motion_kinds.judge(case, (100, 300))
    assert judged is not None
    outcomes = {cut: outcome for cut, (outcome, _) in judged.found.items()}
    assert motion_kinds.WRONG not in outcomes.values(), judged
