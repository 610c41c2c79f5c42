"""Response to measured records: X - b at even instants, and where the base is at the end."""

import math

import numpy as np
import pytest
from rigs import BENCH

from impact_damper_ros import Rig, run
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
    assert found.displacement == pytest.approx(rows['x'] - rows['base'], abs=1e-15)
    assert rows['base'] == pytest.approx(0.15 * found.times**2, abs=1e-12)
    assert found.base == pytest.approx((0.15 * 1.5**2, 0.45))
