"""A rig as the page follows it, from its messages."""

import numpy as np
import pytest

from impact_damper_ros.bag.messages import (
    JointStateDecoder,
    JointStateLayout,
    String,
    decode,
    encode,
)
from impact_damper_ros.bag.rig_topics import AXIS_JOINTS
from impact_damper_ros.page.live import LiveRig
from impact_damper_ros.rig import RigParameters

from .fake_rig import FakeLink


def as_before_the_incline(messages):
    """Turn messages into those of format 2, whose joint states have no incline."""
    layout, decoder = JointStateLayout.of('', AXIS_JOINTS, 4, 4, 0), JointStateDecoder()
    for place, content in enumerate(messages.states):
        message = decoder.decode(content)
        assert message.name == (*AXIS_JOINTS, 'incline')
        numbers = message.position[:4], message.velocity[:4]
        messages.states[place] = layout.filled(message.stamp_ns, *numbers)
    for place, content in enumerate(messages.snapshots):
        text = decode('std_msgs/msg/String', content).data
        assert text.startswith('{"format": 3,')
        messages.snapshots[place] = encode(String(text.replace('3', '2', 1)))


def test_a_node_of_the_format_before_is_shown_too():
    """The angle is that of its snapshots."""
    found = []
    for older in (False, True):
        link = FakeLink(rig=RigParameters(angle=0.3, gravity=1.0))
        live = LiveRig(link, lambda _: None)
        link.run(2.0)
        if older:
            as_before_the_incline(link.messages)
        live.look()
        found.append(live.motion.samples.copy())
    assert len(found[0]) == 400
    assert set(found[0][:, 9]) == {0.3}
    assert np.array_equal(*found)


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
