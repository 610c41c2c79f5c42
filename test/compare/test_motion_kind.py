"""
What short recordings of rigs are found to be, whose motion after 20,000 cycles is known.

The rigs are those of `motion_kinds.py`, which finds the answers by long runs and judges
all of them; here are a few, with the answers as it printed them.
"""

import math
import re
from functools import cache

import numpy as np
import pytest
from compare import motion_kinds
from rigs import BENCH

from impact_damper_ros import Rig
from impact_damper_ros.compare.prediction import decay_rate
from impact_damper_ros.orbits.irregularity import Indications, average_spread, quiet_phase
from impact_damper_ros.orbits.recurrence import MotionKind

CHAOTIC, QUASI = MotionKind.CHAOTIC, MotionKind.QUASI_PERIODIC
TRANSIENT, PERIODIC = MotionKind.TRANSIENT, MotionKind.PERIODIC
UNDECIDED = MotionKind.UNDECIDED


@cache
def known():
    return {case.name: case for case in motion_kinds.cases(6)}


def test_the_third_stage_of_the_demonstration():
    """It was called quasi-periodic, at an exponent of +0.383 with a standard error of 0.143."""
    rig = Rig(BENCH.replace(gap=0.0145))
    rig.advance(30.0)
    rig.change(BENCH)
    rig.advance(60.0)
    rig.change(BENCH.replace(angle=0.2))
    found = motion_kinds.kind_after(rig, 50)
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
        ('heavy at 1.1, gap 8.757', 30, QUASI),
        ('heavy, gap 10.062', 300, QUASI),
        # A torus about to break up
        ('heavy at 1.1, gap 9.0', 30, UNDECIDED),
        # Locked to a period of 13 cycles, after hundreds of others
        ('heavy at 1.1, gap 9.2', 1000, PERIODIC),
        ('random 0', 100, PERIODIC),
        ('random 1', 100, CHAOTIC),
        ('random 3', 100, PERIODIC),
        ('random 5', 100, PERIODIC),
    ],
)
def test_short_recordings(name, cycles, kind):
    case = known()[name]
    found = motion_kinds.kind_after(Rig(case.parameters, case.initial), cycles)
    assert found.kind is kind, found.evidence
    if kind in (CHAOTIC, QUASI):
        exponent, error = found.measures['lyapunov_exponent'], found.measures['lyapunov_error']
        assert (exponent > 5.0 * error) is (kind is CHAOTIC)
    if kind is TRANSIENT:
        assert found.recurrence is not None or found.later.period is not None
    if kind is UNDECIDED:
        more = re.search(r'about (\d+) (more )?cycles (in all )?would decide', found.evidence)
        assert int(more[1]) > cycles
        assert found.short


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


def test_the_decay_of_a_linear_map():
    angle, factor = 0.4, 0.93
    turn = factor * np.array(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    )
    mixed = np.random.default_rng(5).normal(size=(3, 8))
    state, rows = np.array([1e-3, 2e-3, 3e-3]), []
    for _ in range(200):
        rows.append(state @ mixed)
        state = np.array([*(turn @ state[:2]), 0.5 * state[2]])
    measured, _, periods = decay_rate(np.array(rows) + 7.0, 1e-12)
    assert measured == pytest.approx(factor, rel=1e-6)
    assert periods > 100
    assert math.isnan(decay_rate(np.array(rows)[:4], 1e-12)[0])


def test_a_judgement():
    """Of all rigs, and of more random ones: `python -m compare.motion_kinds`."""
    pytest.importorskip('numba')
    judged = motion_kinds.judge(known()['random 2'], (100, 300))
    assert judged is not None
    assert [outcome for outcome, _ in judged.found.values()] == [motion_kinds.RIGHT] * 2, judged
