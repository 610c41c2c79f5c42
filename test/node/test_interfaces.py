"""Topics and services of a running node: values, stamps, QoS and names."""

import json
import re

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from node.rig_client import LATCHED, RigParametersClient, stamp_ns


def snapshot_after(rig, count, condition=lambda _: True):
    """
    Return the first snapshot beyond so many that a condition holds for.

    An earlier one may still be under way when the answer to the request that caused it is there.
    """
    texts = until(
        lambda: [s for s in (json.loads(m.data) for m in rig.snapshots[count:]) if condition(s)],
        'no such snapshot came',
    )
    return texts[0]


def test_quality_of_service(rig):
    info = rig.client.node.get_publishers_info_by_topic
    offered = {
        topic: until(lambda t=topic: info(t), f'nobody publishes {topic}')[0].qos_profile
        for topic in ('/joint_states', '/impacts', '/snapshot')
    }
    assert {q.reliability for q in offered.values()} == {ReliabilityPolicy.RELIABLE}
    assert offered['/joint_states'].durability == DurabilityPolicy.VOLATILE
    assert offered['/snapshot'].durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_services(rig):
    """Their answers, and what they do to the stamps; what to the motion is in `test_engine`."""

    def call(name, kind=Trigger, **values):
        answer = rig.client.call(kind, f'/sim_node/{name}', kind.Request(**values))
        return answer.success, answer.message

    start = {'initial_primary_position': 0.01, 'initial_damper_offset': -0.002}
    assert rig.parameters.set_atomically(**start) == ''

    def state_after_reset():
        """Return the first joint states after a reset, unless a busy machine lost them."""
        count = len(rig.snapshots)
        ok, text = call('reset')
        assert (ok, 'primary at 0.01 m' in text) == (True, True), text
        snapshot = snapshot_after(rig, count, lambda s: s['reason'] == 'reset')
        instant = snapshot['stamp_offset_ns'] + snapshot['time_ns']
        until(lambda: stamp_ns(rig.states[-1].header.stamp) >= instant)
        return [m for m in list(rig.states) if stamp_ns(m.header.stamp) == instant]

    (state,) = until(state_after_reset)
    assert list(state.position) == [0.01, 0.01 - 0.002, 0.015, 0.005, 0.0, 0.0, 0.01]
    # The gap has closed on where the damper would start: said, and harmless.
    assert rig.parameters.set(gap=0.002) == ''
    ok, text = call('reset')
    assert (ok, 'between the stops' in text) == (False, True), text
    ok, text = call('step')
    assert (ok, 'pause it first' in text) == (False, True), text
    count = len(rig.snapshots)
    assert 'paused, at rig time' in call('pause', SetBool, data=True)[1]
    assert call('pause', SetBool, data=True) == (True, 'was paused already')
    assert rig.parameters.set(gap=0.02) == ''
    held = snapshot_after(rig, count, lambda s: s['state']['parameters']['gap'] == 0.02)
    for _ in range(3):
        samples = len(samples_of(rig.states))
        ok, text = call('step')
        assert ok
        assert re.fullmatch(r'paused after a step, at rig time [\d.]+ s', text)
        until(lambda: rig.states[-1].header.frame_id == PAUSED_FRAME)
    assert len(samples_of(rig.states)) == samples + 1
    ok, text = call('step_to_impact')
    assert (ok, text[:39]) == (True, 'running on until after the next impact,')
    call('pause', SetBool, data=False)
    resumed = snapshot_after(rig, count, lambda s: s['reason'] == 'resume')
    assert resumed['time_ns'] >= held['time_ns']
    rig.await_states(5)
    stamps = [stamp_ns(m.header.stamp) for m in list(rig.states)]
    assert stamps == sorted(set(stamps))


def samples_of(states):
    """Return the joint states that are samples of the motion, not of a paused rig."""
    return [m for m in list(states) if m.header.frame_id != PAUSED_FRAME]


def test_theory_is_published(client, launch, namespace):
    """Documents are latched, each with the rig that it is of."""
    texts = client.listen(String, f'{namespace}/theory', LATCHED)
    process = launch(f'__ns:={namespace}', gravity=0.0, predict_motion=True)
    parameters = RigParametersClient(client, f'{namespace}/sim_node')

    def orbit(gap):
        last = json.loads(texts[-1].data) if texts else {}
        there = (last.get('orbit') and last['time'] > 0.0) or gap == 37.0
        return last['orbit'] if there and last.get('orbit') else None

    assert until(lambda: orbit(37.0))['x_max_ratio'] == pytest.approx(0.104644, abs=1e-6)
    # That of the rig before does not stay.
    assert parameters.set(gap=36.0) == ''
    assert until(lambda: orbit(36.0))['x_max_ratio'] != pytest.approx(0.104644, abs=1e-6)
    assert parameters.set(predict_motion=False) == ''
    until(lambda: 'predict_motion is false' in texts[-1].data)
    assert process.stop() == 0, process.output


PARAMETERS_FILE = """
/**:
  ros__parameters:
    gap: 2
    force_amplitudes: [1, 2]
/**/damper:
  ros__parameters:
    force_frequencies: [1.0, 1.5]
    initial_primary_position: 1
another_node:
  ros__parameters:
    gap: 99
"""


def test_what_a_node_is_started_with(client, launch, namespace, tmp_path):
    """A parameters file, a quality of service, and a simulated clock as fast as possible."""
    best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    clocks = client.listen(Clock, '/clock', best_effort)
    states = client.listen(JointState, f'{namespace}/joint_states', best_effort)
    file = tmp_path / 'rig.yaml'
    file.write_text(PARAMETERS_FILE)
    quality = f'qos_overrides.{namespace}/joint_states.publisher.reliability'
    process = launch(
        *(f'__ns:={namespace}', '__node:=damper'),
        parameters_file=file,
        **{quality: 'best_effort'},
        publish_clock=True,
        real_time_factor=0,
        state_rate=50,
    )
    until(lambda: clocks and states, lambda: process.output)
    (offered,) = client.node.get_publishers_info_by_topic(f'{namespace}/joint_states')
    assert offered.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    parameters = RigParametersClient(client, f'{namespace}/damper')
    names = ('gap', 'force_amplitudes', 'force_frequencies', 'force_phases')
    assert parameters.get(*names) == [2.0, [1.0, 2.0], [1.0, 1.5], [0.0, 0.0]]
    assert parameters.get('initial_primary_position', quality) == [1.0, 'best_effort']
    # The first ticks may be over before the client is known to the node.
    until(lambda: stamp_ns(clocks[-1].clock) > 100e9)
    assert all(stamp_ns(c.clock) % 20_000_000 == 0 for c in list(clocks))
    assert all(stamp_ns(m.header.stamp) % 20_000_000 == 0 for m in list(states))
    assert client.call(SetBool, f'{namespace}/damper/pause', SetBool.Request(data=True)).success
    count = len(clocks)
    # /clock goes on while the rig is held, for those who join meanwhile.
    until(lambda: len(clocks) >= count + 3 and clocks[-1] == clocks[-2] == clocks[-3])
    assert process.stop() == 0
