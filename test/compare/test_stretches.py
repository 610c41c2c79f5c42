"""Stretches as they are read, part by part."""

import math
from dataclasses import replace

import numpy as np
import pytest
from compare.recorded import metered, recorded
from rigs import BENCH, FRICTION

from impact_damper_ros.compare.force_phase import with_fitted_clock
from impact_damper_ros.compare.result import Verdict
from impact_damper_ros.compare.verdict import compare_stretch


def test_memory_of_long_stretches_is_bounded(monkeypatch):
    """All is checked and counted; of joint states the last ones are kept."""
    module = 'impact_damper_ros.compare.stretches'
    monkeypatch.setattr(f'{module}._MOST_STATES', 1000)
    monkeypatch.setattr(f'{module}._FIRST_IMPACTS', 20)
    monkeypatch.setattr(f'{module}._LAST_IMPACTS', 50)
    states, impacts, clock = recorded(FRICTION, 200)
    stretch = metered(states, impacts, clock, part=200)
    assert (stretch.state_count, stretch.impact_count) == (len(states), len(impacts))
    assert 1000 <= len(stretch.states) < 1400
    assert stretch.states.time[-1] == states.time[-1]
    assert 70 <= len(stretch.impacts) < 110
    # Those in between are left out.
    steps = np.diff(np.searchsorted(impacts.time, stretch.impacts.time))
    assert (steps > 1).sum() == 1
    assert 0 < np.argmax(steps) + 1 < 40
    assert len(stretch.envelope.time) <= 2000
    assert stretch.envelope.high.max() == states.x.max()


def test_the_phase_of_the_force_is_found():
    """By momentum: to the error of the cubic between two joint states, which falls as step^5."""
    states, impacts, clock = recorded(BENCH, 120, None)
    later = states[1000:]
    unknown = replace(
        metered(states, impacts, clock), clock=None, states=later, start=float(later.time[0])
    )
    fitted = with_fitted_clock(unknown)
    here = np.array([10.0])
    turned = fitted.clock.angles_at(here) - clock.angles_at(here)
    assert math.remainder(float(turned[0, 0]), math.tau) == pytest.approx(0.0, abs=1e-4)
    assert compare_stretch(fitted).verdict is Verdict.AGREES
    # Nothing is made up where the force is not what is logged.
    other = replace(unknown, parameters=BENCH.replace(stiffness=2100.0))
    assert with_fitted_clock(other).clock is None
    found = compare_stretch(with_fitted_clock(other))
    assert found.verdict is Verdict.NO_PREDICTION
    assert 'phase of the force is not in the bag' in found.sentence
