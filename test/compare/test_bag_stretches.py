"""Stretches as they are read, part by part."""

import numpy as np
from compare.recorded import metered, recorded
from rigs import FRICTION


def test_memory_of_long_stretches_is_bounded(monkeypatch):
    """All is checked and counted; of joint states the last ones are kept."""
    module = 'impact_damper_ros.compare.bag_stretches'
    monkeypatch.setattr(f'{module}._MOST_STATES', 1000)
    monkeypatch.setattr(f'{module}._FIRST_IMPACTS', 20)
    monkeypatch.setattr(f'{module}._LAST_IMPACTS', 50)
    states, impacts, clock = recorded(FRICTION, 200)
    stretch, search = metered(states, impacts, clock, part=200)
    assert (stretch.state_count, stretch.impact_count) == (len(states), len(impacts))
    assert search.intervals == len(states) + len(impacts) - 1
    assert 1000 <= len(stretch.states) < 1400
    assert stretch.states.time[-1] == states.time[-1]
    assert 70 <= len(stretch.impacts) < 110
    # Those in between are left out.
    steps = np.diff(np.searchsorted(impacts.time, stretch.impacts.time))
    assert (steps > 1).sum() == 1
    assert 0 < np.argmax(steps) + 1 < 40
    assert len(stretch.envelope.time) <= 2000
    assert stretch.envelope.high.max() == states.x.max()
