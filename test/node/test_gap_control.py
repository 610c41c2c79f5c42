"""Gap control on the running node: switched live over DDS, published, recorded, replayed."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from running import until
from sensor_msgs.msg import JointState

from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.replay_run import main as replay_run
from node.rig_client import LIVELY, RigParametersClient, stamp_ns

CONTROL = {
    'gap_min': 0.002,
    'gap_max': 0.5,
    'gap_control_rate': 200.0,
    'gap_control_noise_position': 1e-5,
    'gap_control_noise_velocity': 1e-3,
    'gap_control_seed': 7,
    'actuator_speed': 0.5,
    'actuator_delay': 0.004,
}


@pytest.fixture
def node(client, launch, namespace):
    """Start a node of its own, recording is off, and return how to talk to it."""
    acts = client.listen(JointState, f'{namespace}/gap_control')
    states = client.listen(JointState, f'{namespace}/joint_states')
    reports = client.listen(DiagnosticArray, '/diagnostics')
    process = launch(f'__ns:={namespace}', **LIVELY)
    until(lambda: states or not process.running(), 'no joint states come')
    assert process.running(), process.output
    parameters = RigParametersClient(client, f'{namespace}/sim_node')

    def status():
        name = f'{namespace[1:]}/sim_node: gap control'
        for report in reversed(list(reports)):
            for one in report.status:
                if one.name == name:
                    return one.message, {v.key: v.value for v in one.values}
        return '', {}

    return process, parameters, acts, status


def _told(message):
    return stamp_ns(message.header.stamp), message.header.frame_id, *message.position


def test_live_switching_while_recording_is_replayed_bit_for_bit(node, tmp_path, capsys):
    process, parameters, acts, status = node
    assert parameters.set_atomically(**CONTROL, bag_directory=str(tmp_path / 'runs')) == ''
    assert not acts
    assert parameters.set(record=True) == ''
    for change in (
        {'gap_control': 'amplitude'},
        {'gap_control': 'timed'},
        # While it is on: the gap, the law's other form, sensors and actuators
        {'gap': 0.02},
        {'gap_control_stops': 'symmetric', 'gap_control_smoothing': 0.5},
        {'actuator_speed': 0.0, 'gap_control_rate': 1000.0},
        {'gap_control': 'amplitude', 'restitution_1': 0.6},
        {'gap_control': 'off'},
        {'gap_control': 'timed', 'gap_control_stops': 'independent', 'actuator_delay': 0.02},
    ):
        count = len(acts)
        assert parameters.set_atomically(**change) == ''
        if change.get('gap_control') != 'off':
            until(lambda n=count: len(acts) > n + 12)
    until(lambda: status()[0] == 'timed' and int(status()[1]['Commands']) > 20)
    until(lambda: float(status()[1]['Amplitude of X [m]']) > 0.0)
    assert parameters.set(record=False) == ''
    (directory,) = (tmp_path / 'runs').iterdir()
    assert replay_run([str(directory)]) == 0
    assert 'of the gap control' in capsys.readouterr().out
    # What came over DDS is what was recorded.
    reader = RunReader(directory)
    (topic,) = [name for name, _ in reader.topics if name.endswith('/gap_control')]
    told = {_told(deserialize_message(r.content, JointState)) for r in reader.records([topic])}
    assert len(told) > 60
    first, last = min(told)[0], max(told)[0]
    until(lambda: _told(acts[-1])[0] >= last, 'acts are missing')
    heard = {_told(message) for message in list(acts)}
    # A machine with much else to do may lose some, but none was heard and not recorded.
    assert len(told & heard) > 60
    assert all(act in told for act in heard if first < act[0] < last)
    # A crossing, and what the stops do, with names, units and frames as documented
    heard = list(acts)
    stopped = {'arrived', 'touched', 'started'}
    assert {m.header.frame_id for m in heard} == {'command', 'crossing', *stopped}
    assert all(list(m.name) == ['stop_1', 'stop_2', 'primary'] for m in heard)
    assert {len(v) for m in heard for v in (m.position, m.velocity, m.effort)} == {3}
    assert process.running(), process.output
