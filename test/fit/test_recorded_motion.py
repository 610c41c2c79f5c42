"""Measured motions of bags: those of a rig, and topics of anybody."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.fit.measured_motion import ReadingOptions
from impact_damper_ros.fit.recorded_motion import (
    read_motion,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
TIME = np.arange(300) / 100.0
MOTION = 0.01 * np.sin(20.0 * TIME)


def simulated(path, *more):
    arguments = ['bench_rig', '--duration', '4', '--bag', str(path), *more]
    assert simulate_rig(arguments) == 0
    return path


def stamped(time):
    types = STORE.types
    seconds, rest = divmod(round(time * 1e9) + 1_700_000_000_000_000_000, 10**9)
    stamp = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=rest)
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id='')


def joint_state(time, value, names=('carriage',), velocity_only=False):
    values = np.array([value] * len(names))
    return STORE.types['sensor_msgs/msg/JointState'](
        header=stamped(time),
        name=list(names),
        position=np.array([]) if velocity_only else values,
        velocity=values if velocity_only else np.array([]),
        effort=np.array([]),
    )


def imu(time, value):
    types = STORE.types
    vector = types['geometry_msgs/msg/Vector3']
    return types['sensor_msgs/msg/Imu'](
        header=stamped(time),
        orientation=types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(x=0.0, y=0.0, z=0.0),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=0.1 * value, y=value, z=9.81),
        linear_acceleration_covariance=np.zeros(9),
    )


def number(_, value):
    return STORE.types['std_msgs/msg/Float64'](data=value)


def recorded(path, make, topic='/measured', **named):
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kind = make(0.0, 0.0, **named).__msgtype__
        connection = writer.add_connection(topic, kind, typestore=STORE)
        for time, value in zip(TIME, MOTION, strict=True):
            message = make(time, value, **named)
            stamp = 1_700_000_000_000_000_000 + round(time * 1e9)
            writer.write(connection, stamp, STORE.serialize_cdr(message, kind))
    return path


def test_a_recording_of_a_rig(tmp_path):
    bag = simulated(tmp_path / 'run', '--rate', '100', '--set', 'angle=0.1')
    data = read_motion(bag, ReadingOptions())
    assert data.quantity == 'displacement'
    assert data.time == pytest.approx(np.arange(401) / 100.0)
    assert data.motion[0] == pytest.approx(0.0, abs=1e-12)
    assert data.impact_deviation == 1e-4
    assert len(data.impact_times) > 10
    assert data.base is None
    measured = read_motion(bag, ReadingOptions(joint='damper'))
    assert not np.allclose(measured.motion, data.motion)
    with pytest.raises(ValueError, match=r"no joint 'mass' among 'primary', 'damper'.*--joint"):
        read_motion(bag, ReadingOptions(joint='mass'))


def test_of_a_rig_that_is_changed_the_part_before_is_used(tmp_path):
    bag = simulated(tmp_path / 'run', '--rate', '100', '--change', '2.5:gap=0.03')
    data = read_motion(bag, ReadingOptions())
    assert data.time[-1] == pytest.approx(2.49)
    assert data.impact_times[-1] < 2.5
    assert 'up to the first change' in data.source


def test_the_joint_states_of_anybody(tmp_path):
    data = read_motion(recorded(tmp_path / 'run', joint_state), ReadingOptions())
    assert data.quantity == 'displacement'
    assert data.time == pytest.approx(TIME, abs=1e-9)
    assert data.motion == pytest.approx(MOTION)
    assert data.impact_times is None


def test_velocities_and_several_joints(tmp_path):
    bag = recorded(tmp_path / 'run', joint_state, names=('left', 'right'), velocity_only=True)
    with pytest.raises(ValueError, match=r"several joints among 'left', 'right': name one"):
        read_motion(bag, ReadingOptions())
    data = read_motion(bag, ReadingOptions(joint='right'))
    assert data.quantity == 'velocity'
    assert data.motion == pytest.approx(MOTION)


def test_an_imu_shakes_along_its_axis(tmp_path):
    bag = recorded(tmp_path / 'run', imu)
    data = read_motion(bag, ReadingOptions())
    assert data.quantity == 'acceleration'
    assert data.motion[data.used] == pytest.approx(MOTION[data.used])
    assert read_motion(bag, ReadingOptions(joint='x')).motion == pytest.approx(0.1 * MOTION)
    with pytest.raises(ValueError, match=r"no axis 'u' among 'x', 'y', 'z'"):
        read_motion(bag, ReadingOptions(joint='u'))


def test_plain_numbers(tmp_path):
    bag = recorded(tmp_path / 'run', number)
    data = read_motion(bag, ReadingOptions(topic='/measured'))
    assert data.motion == pytest.approx(MOTION)
    assert data.time == pytest.approx(TIME, abs=1e-9)
    assert read_motion(bag, ReadingOptions(joint='velocity')).quantity == 'velocity'
    with pytest.raises(RecordingError, match=r'no topic /x of .*; there are: /measured of std'):
        read_motion(bag, ReadingOptions(topic='/x'))


@pytest.mark.parametrize(
    ('stamps', 'problem'),
    [
        (0.0 * TIME, 'all 300 messages have the stamp 0: set header.stamp where they are'),
        (
            TIME // 0.1,
            r'300 messages have 30 different stamps, of which \d+ ns is there 1\d times',
        ),
    ],
)
def test_stamps_that_are_none(tmp_path, stamps, problem):
    def make(time, value):
        message = joint_state(stamps[round(100.0 * time)], value)
        if not stamps.any():
            message.header.stamp.sec = 0
        return message

    with pytest.raises(ValueError, match=problem):
        read_motion(recorded(tmp_path / 'run', make), ReadingOptions())


@pytest.mark.parametrize('options', [{'topic': '/imu'}, {'joint': 'carriage'}])
def test_a_file_of_columns_has_no_topics(options, tmp_path):
    (path := tmp_path / 'run.csv').write_text('t [s],x [mm]\n0,1\n1,2\n')
    problem = f'has no topics: leave --{next(iter(options))} out'
    with pytest.raises(ValueError, match=problem):
        read_motion(path, ReadingOptions(**options))


def test_a_bag_has_no_columns(tmp_path):
    bag = recorded(tmp_path / 'run', joint_state)
    with pytest.raises(ValueError, match='a bag has no columns: name --topic and --joint'):
        read_motion(bag, ReadingOptions(column='carriage'))
    assert len(read_motion(bag, ReadingOptions(first=1.0, last=1.995)).time) == 100
