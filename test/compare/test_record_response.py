"""Responses to a base that moves: over time under a record, and at the lines of a random one."""

import math

import numpy as np
import pytest
from rigs import BENCH

from impact_damper_ros import Rig, run
from impact_damper_ros.compare.random_response import ResponseSamples, common_period
from impact_damper_ros.compare.record_response import RecordSamples
from impact_damper_ros.measured.record import BASE_RECORD, MeasuredRecord


def test_displacement_from_a_base_that_moves():
    """A constant acceleration a of the base moves it by a t²/2; beside it a second rig."""
    times = np.linspace(0.0, 2.0, 101)
    record = MeasuredRecord(BASE_RECORD, times, np.full(101, 0.3), 'pulse.csv')
    rig = BENCH.replace(force_amplitudes=0.0)
    shaken, twin = Rig(rig, records=[record]), Rig(rig, records=[record])
    samples = RecordSamples(shaken, 1.5)
    run(shaken, 1.5, [samples])
    found = samples.response()
    assert len(found.times) > 1.5 * rig.omega / math.tau * 60
    assert np.diff(found.times) == pytest.approx(1.5 / (len(found.times) - 1))
    rows = twin.run(1.5, found.times).samples
    assert found.name == 'X - b'
    assert found.displacement == pytest.approx(rows['x'] - rows['base'], abs=1e-15)
    assert rows['base'] == pytest.approx(0.15 * found.times**2, abs=1e-12)
    assert found.base == pytest.approx((0.15 * 1.5**2, 0.45))


@pytest.mark.parametrize(('duration', 'periods', 'left_out'), [(28.0, 12, 44), (5.0, 1, 9)])
def test_periods_in_which_the_start_decays_are_left_out(duration, periods, left_out):
    """As many as it takes, or there are; then the motion is that without a damper."""
    rig = BENCH.replace(
        force_amplitudes=0.0,
        friction=0.0,
        gap=10.0,
        damper_mass=1e-4,
        base_amplitudes=[0.1] * 6,
        base_frequencies=[math.tau * hertz for hertz in range(2, 14, 2)],
        base_phases=[float(k * k) for k in range(6)],
    )
    shaken = Rig(rig)
    samples = ResponseSamples(shaken, duration)
    run(shaken, duration, [samples])
    found = samples.response()
    assert (found.period, found.periods, found.left_out) == (0.5, periods, left_out)
    assert found.left == pytest.approx(math.exp(-1.26 / (2.0 * 2.0001) * 0.5 * left_out))
    assert found.frequencies == pytest.approx(range(2, 14, 2))
    assert found.base == pytest.approx(0.25 * 0.1**2)
    assert found.base_rms == pytest.approx(0.1 * math.sqrt(3.0))
    if periods > 1:
        assert found.absolute == pytest.approx(found.absolute_without, rel=2e-3)
        assert found.relative == pytest.approx(found.relative_without, rel=2e-3)
        assert found.primary == pytest.approx(found.base * found.absolute**2)
        squares = np.array([np.ones(6), found.absolute**2, found.relative**2])
        base, *moved = np.sqrt((squares / found.frequencies**4).sum(axis=1))
        assert found.total == pytest.approx(np.divide(moved, base))
    # A mean over three lines, by what the base has of each
    loud = found._replace(base=np.arange(1.0, 7.0))
    middle = math.sqrt((1 * 3.0**2 + 2 * 1.0 + 3 * 2.0**2) / 6.0)
    assert loud.smooth(np.array([3.0, 1.0, 2.0, 5.0, 5.0, 5.0]), 3)[[1, 5]] == pytest.approx(
        [middle, 5.0]
    )


@pytest.mark.parametrize(
    ('hertz', 'period'),
    [
        ([0.2, 0.3, 0.7], 10.0),
        ([12.5, 13.0, 100.0], 2.0),
        ([5.0], math.nan),
        ([1.0, math.sqrt(2.0)], math.nan),
        # More multiples than are looked at
        ([1.0, 1.0 + 1e-7], math.nan),
    ],
)
def test_after_which_time_lines_repeat(hertz, period):
    found = common_period([math.tau * one for one in hertz])
    assert found == pytest.approx(period, rel=1e-9, nan_ok=True)
