"""A rig as the page follows it, from its messages."""

import numpy as np
import pytest

from impact_damper_ros.page.live import LiveRig
from impact_damper_ros.rig import RigParameters

from .fake_rig import FakeLink


@pytest.mark.parametrize('seconds', [1, 3600, -1, -3600])
def test_a_step_of_the_system_clock_leaves_the_motion_as_it_is(seconds):
    """Also of the messages from before it that come in with its snapshot."""
    found = []
    for step in (0, seconds):
        link = FakeLink(rig=RigParameters(gravity=0.0, gap=1.0))
        live = LiveRig(link, lambda _: None)
        for _ in range(3):
            link.run(5.0)
            live.look()
            link.run(0.1)
            link.slip(step)
            link.run(0.1)
            live.look()
        found.append((live.motion.samples.copy(), live.motion.impacts.copy()))
    (samples, impacts), (after, hits) = found
    assert len(samples) == 3120
    assert np.array_equal(after[:, :10], samples[:, :10])
    # The phase, counted from either snapshot
    assert np.abs(after[:, 10] - samples[:, 10]).max() < 1e-12
    assert len(impacts) > 0
    assert np.array_equal(hits, impacts)
