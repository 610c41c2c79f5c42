"""A few settled motions with rest, sticking, reversals and long periods against the oracle."""

import pytest

from impact_damper_ros import EventKind
from oracle.settled_motions import trial

TURNS, RESTS = {EventKind.REVERSAL}, {EventKind.RELEASE, EventKind.REST}
STICKS = {EventKind.STICK, EventKind.RELEASE, EventKind.REVERSAL}


@pytest.mark.parametrize(
    ('seed', 'impacts', 'cycles', 'events'),
    [
        (11, 7, 1, RESTS),
        (19, 2, 1, set()),
        (555, 2, 2, set()),
        # With friction
        (193, 4, 2, TURNS),
        (1569, 7, 2, RESTS),
        (793, 2, 3, TURNS),
        (1797, 2, 3, STICKS),
        (1074, 4, 6, STICKS),
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
