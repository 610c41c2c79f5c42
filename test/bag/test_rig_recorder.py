"""Bags of the headless command against those that the test driver writes by another library."""

import json
import re
from fractions import Fraction
from math import floor

import pytest
from bag import samples
from bag.recorded_rig import RecordedRig, params_file
from rigs import LIVELY
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from impact_damper_ros import InitialConditions, Rig
from impact_damper_ros.bag import RigRecorder, RunReader, decode, recover_run
from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main

JAZZY = get_typestore(Stores.ROS2_JAZZY)
PICTURE = '/robot_description'


def simulated(tmp_path, initial, *arguments, rig=LIVELY):
    """Let the command record the rig of the test driver."""
    params = params_file(tmp_path / 'params.yaml', rig, initial)
    assert main([str(params), '--bag', str(tmp_path / 'bag'), '--quiet', *arguments]) == 0
    return RunReader(tmp_path / 'bag')


def snapshots(reader):
    return [
        json.loads(decode(samples.STRING, r.content).data) for r in reader.messages(['/snapshot'])
    ]


@pytest.mark.parametrize('rate', [200.0, 333.0])
def test_the_same_messages_in_the_same_order(tmp_path, rate):
    initial = InitialConditions(initial_damper_offset=0.005, initial_damper_velocity=0.5)
    # Other tables ask for instants of their own; the last tick comes before the end.
    table = ('--states', str(tmp_path / 'states.csv'))
    duration = ('--duration', '2.001', '--rate', str(rate))
    reader = simulated(tmp_path, initial, *duration, *table)
    ticks = int(2.001 * rate)
    driver = RecordedRig(initial=initial, rate=rate, offset=0)
    (driver.run_id,) = {snapshot['run'] for snapshot in snapshots(reader)}
    driver.start().run(ticks)
    assert reader.complete
    assert reader.custom['joint_states'] == '/joint_states'
    recorded = [(r.topic, r.content, r.stamp_ns) for r in reader.messages()]
    (description,) = (m for m in recorded if m[0] == PICTURE)
    assert description[2] == 0
    assert [m for m in recorded if m is not description] == driver.messages
    assert reader.topics['/impacts', samples.JOINT_STATE].message_count > 20
    assert {t.name for t in samples.TOPICS} - {name for name, _ in reader.topics} == {
        '/diagnostics'
    }


@pytest.mark.parametrize('rate', [1024.0, 2048.0, 1e9 / 3.0])
def test_stamps_are_rounded_half_up_as_those_of_the_node(tmp_path, rate):
    """Every second tick at 1,024 Hz falls between two nanoseconds."""
    words = ('--rate', repr(rate), '--duration', repr(20.0 / rate))
    recorded = simulated(tmp_path, InitialConditions(), *words).messages(['/joint_states'])
    exact = [Fraction(tick) * 10**9 / Fraction(rate) for tick in range(21)]
    assert [r.stamp_ns for r in recorded] == [floor(k + Fraction(1, 2)) for k in exact]


def test_viewers_can_draw_the_recording(tmp_path, capsys):
    """The robot description is a latched topic, anew for a wider gap, and a file."""
    changes = ('--change', '0.5:gap=0.3', '--change', '0.7:restitution_1=0.5')
    simulated(tmp_path, InitialConditions(), '--duration', '1', *changes)
    with AnyReader([tmp_path / 'bag'], default_typestore=JAZZY) as reader:
        (connection,) = (c for c in reader.connections if c.topic == PICTURE)
        messages = [
            (stamp, reader.deserialize(raw, connection.msgtype).data)
            for _, stamp, raw in reader.messages([connection])
        ]
    (qos,) = connection.ext.offered_qos_profiles
    assert qos.durability.name == 'TRANSIENT_LOCAL'
    assert messages == [
        (0, robot_description(LIVELY)),
        (500_000_000, robot_description(LIVELY.replace(gap=0.3))),
    ]
    assert (tmp_path / 'bag' / 'rig.urdf').read_text(encoding='utf-8') == messages[0][1]
    # No command takes it for a fault, nor for a snapshot.
    bag = RunReader(tmp_path / 'bag')
    assert (bag.complete, list(bag.faults())) == (True, [])
    assert replay_run([str(tmp_path / 'bag')]) == 0
    compare_run([str(tmp_path / 'bag'), '--json', str(tmp_path / 'found.json'), '--quiet'])
    log = json.loads((tmp_path / 'found.json').read_text(encoding='utf-8'))['log']
    assert (log['differences'], PICTURE in log['unchecked']) == (0, True)
    recovered = recover_run(tmp_path / 'bag')
    assert recovered.was_complete
    assert PICTURE in {topic.name for topic in recovered.topics}
    assert 'Traceback' not in capsys.readouterr().err


def test_minus_zero_is_zero(tmp_path):
    """A change to -0.0 is none, neither for the rig nor for its log, nor with another change."""
    changes = ('0.2:angle=-0.0', '0.3:force_phases=-0.0', '0.5:gap=0.012', '0.7:friction=-0.0')
    words = [word for change in changes for word in ('--change', change)]
    initial = InitialConditions(initial_primary_velocity=-0.0)
    reader = simulated(tmp_path, initial, '--duration', '1', *words)
    done = [deed for snapshot in snapshots(reader) for deed in snapshot['done']]
    assert done == [['change', {'gap': 0.012}]]
    for snapshot in snapshots(reader):
        text = json.dumps([snapshot['initial'], snapshot['state']['parameters']])
        assert not re.search(r'-0\.0\b', text)
    assert replay_run([str(tmp_path / 'bag'), '--quiet']) == 0


@pytest.mark.parametrize('number', [float('nan'), -1.0])
def test_rates_and_durations_that_no_recording_has(tmp_path, number):
    """They once left a bag behind, and the threads that write it."""
    for rate, duration, words in (
        (number, 1.0, r'rate is .*: give a number from 1e-12 to 1e\+09'),
        (10.0, number, r'duration is .*: give a number from 0 to 1e\+13'),
    ):
        with pytest.raises(ValueError, match=words):
            RigRecorder(tmp_path / 'bag', Rig(LIVELY), {}, rate, duration)
    assert not (tmp_path / 'bag').exists()
