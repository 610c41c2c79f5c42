"""A few settled motions with rest, sticking, reversals and long periods against the oracle."""

import pytest

from impact_damper_ros.rig import EventKind
from oracle.settled_motions import trial


@pytest.mark.parametrize(
    ('seed', 'impacts', 'cycles', 'events'),
    [
        (11, 7, 1, {EventKind.RELEASE, EventKind.REST}),
        (15, 8, 1, {EventKind.RELEASE, EventKind.REST, EventKind.STICK, EventKind.REVERSAL}),
        (19, 2, 1, set()),
    ],
)
def test_settled_motion(seed, impacts, cycles, events):
    """Any number of them: `python -m oracle.settled_motions --rigs 200`."""
    pytest.importorskip('numba')
    found = trial(seed)
    assert (found.orbit.impacts, found.orbit.cycles) == (impacts, cycles)
    assert {event.kind for event in found.orbit.events} == events
    assert found.phases < 1e-13
    assert found.multipliers < 1e-12
    # The oracle completes a chatter, of which the theory has the first impacts
    assert (found.extra > 0) is (EventKind.REST in events)
