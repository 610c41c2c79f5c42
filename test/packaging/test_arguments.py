"""A number out of its range is refused by name and value before anything is made."""

import math
from functools import partial

import pytest

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.bag import RigRecorder

LEVEL = RigParameters(gravity=0.0)
RECORDER = partial(RigRecorder, 'bag', Rig(LEVEL), {})
BEYOND = (math.nan, math.inf, -math.inf, 10**400, -(10**400))

#: What is called, the argument, and values out of its range.
RANGES = [
    (partial(RECORDER, duration=1.0), 'rate', (*BEYOND, 0.0, -1.0)),
    # Without an end it is inf.
    (partial(RECORDER, rate=9.0), 'duration', (math.nan, -math.inf, 10**400, -1.0)),
]


@pytest.mark.parametrize(('call', 'name', 'values'), RANGES)
def test_ranges(call, name, values, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for value in values:
        words = rf'{name}.* is .*[:;] (give|it must be)|{name} is empty'
        with pytest.raises(ValueError, match=words):
            call(**{name: value})
    assert list(tmp_path.iterdir()) == []
