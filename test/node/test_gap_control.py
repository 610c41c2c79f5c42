"""Gap control on the running node: switched live over DDS, published, recorded, replayed."""

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from impact_damper_ros.bag import RunReader
from node.rig_client import stamp_ns

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


def act_of(message):
    return stamp_ns(message.header.stamp), message.header.frame_id, *message.position


def test_live_switching_while_recording(rig, tmp_path):
    """What is recorded is replayed by `every_bag_is_replayed`."""
    acts = rig.acts
    first = len(acts)
    rig.change(**CONTROL, bag_directory=str(tmp_path / 'runs'))
    assert len(acts) == first
    rig.change(record=True)
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
        rig.change(**change)
        if change.get('gap_control') != 'off':
            rig.until(lambda n=count: len(acts) > n + 12)

    def controls(report):
        values = report.values
        moved = float(values['Amplitude of X [m]'] or 0.0) > 0.0
        return report.message == 'timed' and int(values['Commands']) > 20 and moved

    rig.await_report('gap control', holds=controls)
    rig.change(record=False)
    (directory,) = (tmp_path / 'runs').iterdir()
    # What came over DDS is what was recorded.
    reader = RunReader(directory)
    records = reader.messages(['/gap_control'])
    told = {act_of(deserialize_message(r.content, JointState)) for r in records}
    assert len(told) > 60
    begin, end = min(told)[0], max(told)[0]
    rig.until(lambda: act_of(acts[-1])[0] >= end)
    heard = {act_of(message) for message in list(acts)}
    # A machine with much else to do may lose some, but none was heard and not recorded.
    assert len(told & heard) > 60
    assert all(act in told for act in heard if begin < act[0] < end)
    # A crossing, and what the stops do, with names, units and frames as documented
    heard = acts[first:]
    stopped = {'arrived', 'touched', 'started'}
    assert {m.header.frame_id for m in heard} == {'command', 'crossing', *stopped}
    assert all(list(m.name) == ['stop_1', 'stop_2', 'primary'] for m in heard)
    assert {len(v) for m in heard for v in (m.position, m.velocity, m.effort)} == {3}
