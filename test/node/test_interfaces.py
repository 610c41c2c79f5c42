"""Topics and services of a running node: values, stamps, QoS and names."""

import json
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.bag.rig_topics import PAUSED_ACT
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.control import Rig
from impact_damper_ros.rig import EventKind, RigParameters
from node.rig_client import LIVELY, RigParametersClient, stamp_ns, until


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


def expected_from(snapshot, states):
    """Return what an offline simulator makes of a snapshot, up to the last of the states."""
    offset = snapshot['stamp_offset_ns']
    rig = Rig.restore(snapshot['state'])
    impacts, samples = [], []
    for message in states:
        events = rig.advance((stamp_ns(message.header.stamp) - offset) / 1e9)
        impacts += [e for e in events if e.kind is EventKind.IMPACT]
        samples.append(rig.sample())
    return impacts, samples


def test_the_node_shows_what_an_offline_simulator_computes(rig):
    """Samples and impacts, in values and stamps, bit for bit; from before and after a change."""
    for change in ({'gap': 0.012}, {'angle': 0.2, 'force_frequencies': [30.0]}):
        count = len(rig.snapshots)
        assert rig.parameters.set_atomically(**change) == ''
        (name, value), *_ = change.items()
        snapshot = snapshot_after(
            rig, count, lambda s, n=name, v=value: s['state']['parameters'][n] == v
        )
        assert snapshot['reason'] == 'change'
        # Positions count from where M is while its spring is unloaded.
        there = RigParameters(**snapshot['state']['parameters'])
        rest = there.static_deflection
        start_ns = snapshot['stamp_offset_ns'] + snapshot['time_ns']
        until(
            lambda ns=start_ns: sum(stamp_ns(m.header.stamp) > ns for m in list(rig.impacts)) >= 5,
            'the damper does not rattle',
        )
        fifth_ns = max(stamp_ns(m.header.stamp) for m in list(rig.impacts))
        until(lambda ns=fifth_ns: stamp_ns(rig.states[-1].header.stamp) >= ns)
        states = [m for m in list(rig.states) if stamp_ns(m.header.stamp) > start_ns]
        # Should this process stall, it may miss some; the bag tests assert that none is left out.
        assert all((stamp_ns(m.header.stamp) - start_ns) % 5_000_000 == 0 for m in states)
        impacts, samples = expected_from(snapshot, states)
        for message, sample in zip(states, samples, strict=True):
            assert message.name == ['primary', 'damper', 'stop_1', 'stop_2', 'incline']
            places = (sample.x, sample.z, sample.stop_1, sample.stop_2)
            assert list(message.position) == [*(place + rest for place in places), there.angle]
            v, w = sample.primary_velocity, sample.damper_velocity
            assert list(message.velocity) == [v, w, v, v, 0.0]
        last_ns = stamp_ns(states[-1].header.stamp)
        assert len(impacts) >= 5

        def published(start_ns=start_ns, last_ns=last_ns):
            messages = list(rig.impacts)
            return [m for m in messages if start_ns < stamp_ns(m.header.stamp) <= last_ns]

        # Of several topics the messages need not be taken in the order in which they were sent.
        count = len(impacts)
        until(lambda n=count, heard=published: len(heard()) >= n, 'impacts are missing')
        for event, message in zip(impacts, published(), strict=True):
            assert stamp_ns(message.header.stamp) == (
                snapshot['stamp_offset_ns'] + round(event.time * 1e9)
            )
            assert message.header.frame_id == f'stop_{event.stop}'
            assert list(message.position) == [event.x + rest, event.x + event.y + rest]
            assert list(message.velocity) == [
                event.primary_velocity_after,
                event.damper_velocity_after,
            ]


def test_quality_of_service(rig):
    info = rig.client.node.get_publishers_info_by_topic
    offered = {
        topic: until(lambda t=topic: info(t), f'nobody publishes {topic}')[0].qos_profile
        for topic in ('/joint_states', '/impacts', '/snapshot')
    }
    assert {q.reliability for q in offered.values()} == {ReliabilityPolicy.RELIABLE}
    assert offered['/joint_states'].durability == DurabilityPolicy.VOLATILE
    assert offered['/snapshot'].durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_reset(rig):
    assert (
        rig.parameters.set_atomically(initial_primary_position=0.01, initial_damper_offset=-0.002)
        == ''
    )
    count = len(rig.snapshots)
    answer = rig.client.call(Trigger, '/sim_node/reset')
    assert answer.success, answer.message
    assert 'primary at 0.01 m' in answer.message
    snapshot = snapshot_after(rig, count, lambda s: s['reason'] == 'reset')
    instant = snapshot['stamp_offset_ns'] + snapshot['time_ns']
    (state,) = until(lambda: [m for m in list(rig.states) if stamp_ns(m.header.stamp) == instant])
    assert list(state.position) == [0.01, 0.01 - 0.002, 0.015, 0.005, 0.0]
    assert list(state.velocity) == [0.0] * 5
    # The gap has closed on where the damper would start: said, and harmless.
    assert rig.parameters.set(gap=0.002) == ''
    answer = rig.client.call(Trigger, '/sim_node/reset')
    assert not answer.success
    assert 'between the stops' in answer.message
    rig.await_states(3)


def test_pause(rig):
    call = rig.client.call
    count = len(rig.snapshots)
    answer = call(SetBool, '/sim_node/pause', SetBool.Request(data=True))
    assert answer.success
    assert 'paused, at rig time' in answer.message
    answer = call(SetBool, '/sim_node/pause', SetBool.Request(data=True))
    assert answer.success
    assert 'already' in answer.message
    assert rig.parameters.set(gap=0.02) == ''
    assert rig.parameters.get('gap') == 0.02
    held = snapshot_after(rig, count, lambda s: s['state']['parameters']['gap'] == 0.02)
    time.sleep(0.2)
    answer = call(SetBool, '/sim_node/pause', SetBool.Request(data=False))
    assert answer.success
    resumed = snapshot_after(rig, count, lambda s: s['reason'] == 'resume')
    assert resumed['time_ns'] == held['time_ns']
    rig.await_states(5)
    stamps = [stamp_ns(m.header.stamp) for m in list(rig.states)]
    assert stamps == sorted(set(stamps))
    # While the rig was held, no sample was published, and the wall clock went on.
    held_ns = held['stamp_offset_ns'] + held['time_ns']
    resumed_ns = resumed['stamp_offset_ns'] + resumed['time_ns']
    assert resumed_ns - held_ns > 0.2e9
    meanwhile = [m for m in rig.states if held_ns < stamp_ns(m.header.stamp) <= resumed_ns]
    assert {(m.header.frame_id, m.name[-1]) for m in meanwhile} == {('', PAUSED_ACT)}


def test_simulation_interfaces_where_they_are_installed(client, launch, namespace, tmp_path):
    srv = pytest.importorskip('simulation_interfaces.srv')
    msg = pytest.importorskip('simulation_interfaces.msg')
    process = launch(f'__ns:={namespace}', predict_motion=False, record=True, **LIVELY)
    states = client.listen(JointState, f'{namespace}/joint_states')
    until(lambda: states or not process.running(), lambda: process.output)

    def call(name, **fields):
        kind = getattr(srv, name)
        words = ''.join(f'_{c.lower()}' if c.isupper() else c for c in name)
        service = client.node.create_client(kind, f'{namespace}/sim_node/{words[1:]}')
        until(service.service_is_ready, name)
        future = service.call_async(kind.Request(**fields))
        return until(lambda: future.done() and future.result(), name)

    def put(state):
        answer = call('SetSimulationState', state=msg.SimulationState(state=state)).result
        return answer.result, answer.error_message

    ok = msg.Result.RESULT_OK
    state, reset = msg.SimulationState, srv.ResetSimulation.Request
    features = set(call('GetSimulatorFeatures').features.features)
    assert {20, 22, 24, 25, 26, 31, 32} == features
    assert call('GetSimulationState').state.state == state.STATE_PLAYING
    assert put(state.STATE_PLAYING)[0] == srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
    refused = call('StepSimulation', steps=1).result
    assert (refused.result, 'pause it first' in refused.error_message) == (4, True)
    assert put(state.STATE_PAUSED) == (ok, '')
    assert call('GetSimulationState').state.state == state.STATE_PAUSED
    count = len(samples_of(states))
    assert call('StepSimulation', steps=7).result.result == ok
    until(lambda: len(samples_of(states)) == count + 7, lambda: len(samples_of(states)) - count)
    assert put(state.STATE_STOPPED)[0] == msg.Result.RESULT_FEATURE_UNSUPPORTED
    for scope in (reset.SCOPE_DEFAULT, reset.SCOPE_TIME, reset.SCOPE_ALL):
        assert 'SCOPE_STATE' in call('ResetSimulation', scope=scope).result.error_message
    assert call('ResetSimulation', scope=reset.SCOPE_STATE).result.result == ok
    assert put(state.STATE_QUITTING) == (ok, '')
    assert process.wait() == 0, process.output
    assert replay_run([str(next((tmp_path / 'process_0' / 'runs').iterdir()))]) == 0


def samples_of(states):
    """Return the joint states that are samples of the motion, not of a paused rig."""
    return [m for m in list(states) if m.name[-1] != PAUSED_ACT]


def test_diagnostics(rig):
    reports = rig.client.listen(DiagnosticArray, '/diagnostics')

    def whole():
        """Return the statuses of the first report after an impact."""
        for report in list(reports):
            statuses = {s.name: s for s in report.status}
            if 'sim_node: pacing' in statuses and value('Impacts', statuses['sim_node: rig']) > 0:
                return statuses
        return None

    def value(key, status):
        return next(float(v.value) for v in status.values if v.key == key)

    statuses = until(whole)
    tasks = ('pacing', 'rig', 'recording', 'gap control', 'controller')
    tasks += ('measured motion', 'predicted motion')
    assert list(statuses) == [f'sim_node: {task}' for task in tasks]
    assert {status.hardware_id for status in statuses.values()} == {'sim_node'}
    pacing = {v.key: v.value for v in statuses['sim_node: pacing'].values}
    assert float(pacing['State rate [Hz]']) == 200.0
    assert int(pacing['Ticks']) > 0
    overruns = int(pacing['Overruns since the last report'])
    slips = int(pacing['Slips (late by more than 250 ms)'])
    # Of a stall that lasts, nothing is counted yet.
    if not overruns and not slips and float(pacing['Achieved rate [Hz]']):
        assert statuses['sim_node: pacing'].level == DiagnosticStatus.OK
        assert 'holds 200 Hz' in statuses['sim_node: pacing'].message
    assert statuses['sim_node: recording'].message == 'off'


def test_theory_is_published_while_someone_listens(client, launch, namespace):
    """Documents are latched, and the curve over the gap is computed only for a listener."""
    states = client.listen(JointState, f'{namespace}/joint_states')
    reports = client.listen(DiagnosticArray, '/diagnostics')
    process = launch(f'__ns:={namespace}', gravity=0.0)
    until(lambda: states, lambda: process.output)
    task = f'{namespace[1:]}/sim_node: predicted motion'

    def complete():
        values = [v for r in list(reports) for s in r.status if s.name == task for v in s.values]
        return ('Complete', 'True') in [(v.key, v.value) for v in values]

    until(complete, lambda: process.output)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    texts = client.listen(String, f'{namespace}/theory', latched)
    first = json.loads(until(lambda: texts, 'nothing is latched')[0].data)
    assert (first['time'], first['orbit'], first['gap_curve']) == (0.0, None, None)

    def curve():
        last = json.loads(texts[-1].data)
        return last if last['gap_curve'] and last['gap_curve']['done'] else None

    last = until(curve, 'no curve comes')
    assert last['orbit']['x_max_ratio'] == pytest.approx(0.104644, abs=1e-6)
    assert last['gap_curve']['optimum']['gap'] == pytest.approx(58.3, rel=0.02)
    # That of the rig before does not stay.
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    assert parameters.set(gap=36.0) == ''
    until(lambda: json.loads(texts[-1].data)['time'] > 0.0)
    assert parameters.set(predict_motion=False) == ''
    until(lambda: 'predict_motion is false' in texts[-1].data)
    assert process.stop() == 0, process.output


def test_quality_of_service_is_that_of_the_user(client, launch, namespace):
    name = f'qos_overrides.{namespace}/joint_states.publisher.reliability'
    process = launch(f'__ns:={namespace}', **{name: 'best_effort'})
    info = client.node.get_publishers_info_by_topic
    (states,) = until(lambda: info(f'{namespace}/joint_states'), lambda: process.output)
    assert states.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    assert parameters.get(name) == 'best_effort'
    assert process.stop() == 0


def test_simulated_clock_as_fast_as_possible(client, launch, namespace):
    best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    clocks = client.listen(Clock, '/clock', best_effort)
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(f'__ns:={namespace}', publish_clock=True, real_time_factor=0, state_rate=50)
    until(lambda: clocks and states, lambda: process.output)
    # The first ticks may be over before the client is known to the node.
    until(lambda: stamp_ns(clocks[-1].clock) > 100e9)
    assert all(stamp_ns(c.clock) % 20_000_000 == 0 for c in list(clocks))
    assert all(stamp_ns(m.header.stamp) % 20_000_000 == 0 for m in list(states))
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    for gap in range(30, 50):
        assert parameters.set(gap=gap) == ''
    assert client.call(SetBool, f'{namespace}/sim_node/pause', SetBool.Request(data=True)).success
    count = len(clocks)
    # /clock goes on while the rig is held, for those who join meanwhile.
    until(lambda: len(clocks) >= count + 3 and clocks[-1] == clocks[-2] == clocks[-3])
    assert process.stop() == 0


def test_two_nodes_at_once(rig, client, launch, namespace):
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(f'__ns:={namespace}', initial_primary_position=5)
    until(lambda: len(states) > 20, lambda: process.output)
    rig.await_states(20)
    other = RigParametersClient(client, f'{namespace}/sim_node')
    assert other.set(gap=2) == ''
    assert (other.get('gap'), rig.parameters.get('gap')) == (2.0, 0.01)
    assert process.stop() == 0


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


def test_a_parameters_file(client, launch, namespace, tmp_path):
    file = tmp_path / 'rig.yaml'
    file.write_text(PARAMETERS_FILE)
    launch(f'__ns:={namespace}', '__node:=damper', parameters_file=file)
    parameters = RigParametersClient(client, f'{namespace}/damper')
    names = ('gap', 'force_amplitudes', 'force_frequencies', 'force_phases')
    assert parameters.get(*names) == [2.0, [1.0, 2.0], [1.0, 1.5], [0.0, 0.0]]
    assert parameters.get('initial_primary_position') == 1.0
