"""A rig as the page follows it, from its messages."""

import numpy as np

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
