"""Topics and services of a running node: values, stamps, QoS and names."""

import re

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from node.rig_client import stamp_ns


def test_quality_of_service(rig):
    info = rig.client.node.get_publishers_info_by_topic
    offered = {
        topic: rig.until(lambda t=topic: info(t))[0].qos_profile
        for topic in ('/joint_states', '/impacts', '/snapshot')
    }
    assert {q.reliability for q in offered.values()} == {ReliabilityPolicy.RELIABLE}
    assert offered['/joint_states'].durability == DurabilityPolicy.VOLATILE
    assert offered['/snapshot'].durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_services(rig):
    """Their answers, and what they do to the stamps; what to the motion is in `test_engine`."""
    first = len(rig.states)
    rig.change(initial_primary_position=0.01, initial_damper_offset=-0.002)

    def state_after_reset():
        """Return the first joint states after a reset, unless a busy machine lost them."""
        snapshot = rig.reset()
        instant = snapshot['stamp_offset_ns'] + snapshot['time_ns']
        rig.until(lambda: stamp_ns(rig.states[-1].header.stamp) >= instant)
        return [m for m in rig.states[first:] if stamp_ns(m.header.stamp) == instant]

    (state,) = rig.until(state_after_reset)
    assert list(state.position) == [0.01, 0.01 - 0.002, 0.015, 0.005, 0.0, 0.0, 0.01]
    assert 'primary at 0.01 m' in rig.call('reset')[1]
    # The gap has closed on where the damper would start: said, and harmless.
    rig.change(gap=0.002)
    ok, text = rig.call('reset')
    assert (ok, 'between the stops' in text) == (False, True), text
    ok, text = rig.call('step')
    assert (ok, 'pause it first' in text) == (False, True), text
    count = len(rig.snapshots())
    assert 'paused, at rig time' in rig.call('pause', data=True)[1]
    assert rig.call('pause', data=True) == (True, 'was paused already')
    rig.change(gap=0.02)

    def later(reason):
        return [s for s in rig.snapshots()[count:] if s['reason'] == reason]

    held = rig.until(lambda: later('change'))[-1]
    assert held['state']['parameters']['gap'] == 0.02
    rig.until(lambda: rig.stands_still)
    samples = len(samples_of(rig.states))
    for _ in range(3):
        ok, text = rig.call('step')
        assert ok
        assert re.fullmatch(r'paused after a step, at rig time [\d.]+ s', text)
    rig.until(lambda: rig.stands_still and len(samples_of(rig.states)) >= samples + 3)
    rig.await_states(2)
    assert len(samples_of(rig.states)) == samples + 3
    ok, text = rig.call('step_to_impact')
    assert (ok, text[:39]) == (True, 'running on until after the next impact,')
    rig.call('pause', data=False)
    assert rig.until(lambda: later('resume'))[0]['time_ns'] >= held['time_ns']
    rig.await_states(5)
    stamps = [stamp_ns(m.header.stamp) for m in rig.states[first:]]
    assert stamps == sorted(set(stamps))


def samples_of(states):
    """Return the joint states that are samples of the motion, not of a paused rig."""
    return [m for m in list(states) if m.header.frame_id != PAUSED_FRAME]


def test_others_are_answered_during_a_step(rig):
    """The next sample is seconds away."""
    rig.change(real_time_factor=0.001)

    def step_begun():
        """Return a step that is under way; a busy machine may be too late to notice one."""
        while True:
            rig.pause()
            step = rig.client.ask(rig.name, 'step')
            if rig.call('step')[1] == 'a step is under way':
                return step

    def answered_during_a_step():
        """Set a parameter meanwhile; return the answer, unless the step has come to its end."""
        step = step_begun()
        rig.change(gap=0.02)
        meanwhile = not step.done()
        answer = rig.until(lambda: step.done() and step.result())
        on_the_way = answer.message.startswith('on the way to the next joint states, at rig time')
        return answer if meanwhile and on_the_way else None

    assert rig.until(answered_during_a_step).success
    # A pause ends the step, and the answer comes at once.
    step = step_begun()
    rig.pause()
    answer = rig.until(lambda: step.done() and step.result())
    assert 'the step was ended by a pause' in answer.message or 'on the way' in answer.message


#: A file with units, a thousand parameters of other nodes, and entries of other names.
GIVEN = f"""\
/**:
  ros__parameters:
    gap: 12mm
    angle: 10 deg
    force_amplitudes: [1, 2]
    "\\e[31mred": 1
{''.join(f'    p{number}: 1{chr(10)}' for number in range(1000))}
/**/damper:
  ros__parameters: {{force_frequencies: [1.0, 1.5], initial_primary_position: 1}}
/other/sim_node: {{ros__parameters: {{gap: 0.5}}}}
"""
#: Files with entries for one node, which is not this one, and for two, one of which is.
OTHERS = {
    'camera.yaml': 'camera: {ros__parameters: {gap: 1.0}}',
    'two.yaml': '/one/damper: {ros__parameters: {friction: 0.1}}\n'
    '/given: {damper: {ros__parameters: {friction: 0.2}}}',
}


def test_what_a_node_is_started_with(client, start, tmp_path):
    """Parameters files, a quality of service, and a simulated clock as fast as possible."""
    best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    clocks = client.listen(Clock, '/clock', best_effort)
    files = [tmp_path / name for name in (*OTHERS, 'given.yaml')]
    for path, text in zip(files, (*OTHERS.values(), GIVEN), strict=True):
        path.write_text(text)
    quality = 'qos_overrides./given/joint_states.publisher.reliability'
    rig = start(
        space='/given',
        node='damper',
        parameters_file=files,
        **{quality: 'best_effort'},
        restitution_1=0.6,
        publish_clock=True,
        real_time_factor=0,
        state_rate=50,
    )
    rig.until(lambda: 'recording  off' in rig.process.output)
    text = rig.process.output
    assert 'runs as fast as possible' in text
    applied = f'{files[1]} (/given/damper), {files[2]} (/**), {files[2]} (/**/damper)'
    assert f'are given, by {applied}, the command line\n' in text
    assert 'no parameters for /given/damper among camera' in text
    assert 'gap 0.012 m; inclined by 10°' in text
    assert text.count('is not one of this node; it is ignored') == 8
    assert '993 more parameters are ignored as well' in text
    assert '\x1b[31m' not in text
    states = rig.listen(JointState, 'joint_states', best_effort)
    rig.until(lambda: clocks and states)
    (offered,) = client.node.get_publishers_info_by_topic('/given/joint_states')
    assert offered.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    names = ('gap', 'friction', 'force_amplitudes', 'force_frequencies', 'force_phases')
    assert rig.parameters.get(*names) == [0.012, 0.2, [1.0, 2.0], [1.0, 1.5], [0.0, 0.0]]
    assert rig.parameters.get('initial_primary_position', quality) == [1.0, 'best_effort']
    # The first ticks may be over before the client is known to the node.
    rig.until(lambda: stamp_ns(clocks[-1].clock) > 100e9)
    assert all(stamp_ns(c.clock) % 20_000_000 == 0 for c in list(clocks))
    assert all(stamp_ns(m.header.stamp) % 20_000_000 == 0 for m in list(states))
    assert rig.call('pause', data=True)[0]
    count = len(clocks)
    # /clock goes on while the rig is held, for those who join meanwhile.
    rig.until(lambda: len(clocks) >= count + 3 and clocks[-1] == clocks[-2] == clocks[-3])
    rig.stop()
