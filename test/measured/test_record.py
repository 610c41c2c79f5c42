"""Records of a force or a base: how long a value is held, and copies."""

import numpy as np
import pytest

from impact_damper_ros.measured.record import MeasuredRecord

TIMES, VALUES = np.array([0.0, 0.1, 0.3, 0.4]), np.array([1.0, 0.0, -2e3, 4.0])


def test_values_are_held_around_their_instants_in_a_copy_too():
    record = MeasuredRecord('force', TIMES, VALUES, 'f.csv').with_copy()
    for one in (record, MeasuredRecord.of_copy(dict(record.copy))):
        starts, values = one.steps()
        assert starts == pytest.approx([0.0, 0.05, 0.2, 0.35, 0.45], rel=1e-15)
        assert values == [1.0, 0.0, -2e3, 4.0, 0.0]
        assert (one.duration, one.rate) == pytest.approx((0.45, 7.5), rel=1e-15)


@pytest.mark.parametrize(
    ('quantity', 'times', 'values', 'problem'),
    [
        ('force', TIMES, 1e9 * VALUES, r"'f.csv' has the value -2e\+12: give at most 1e\+12"),
        ('force', TIMES, VALUES[1:], 'has 4 times and 3 values: give as many'),
        ('speed', TIMES, VALUES, "of 'speed' has 4 times"),
        ('base', TIMES + 0.1, VALUES, 'do not rise from 0'),
        ('base', TIMES[[0, 2, 1, 3]], VALUES, 'do not rise from 0'),
        ('base', TIMES[:1], VALUES[:1], 'do not rise from 0'),
        ('base', np.array([0.0, np.inf, np.inf, np.inf]), VALUES, 'do not rise from 0'),
    ],
)
def test_copies_that_are_none(quantity, times, values, problem):
    copy = dict(MeasuredRecord(quantity, times, values, 'f.csv').with_copy().copy)
    with pytest.raises(ValueError, match=problem):
        MeasuredRecord.of_copy(copy)
