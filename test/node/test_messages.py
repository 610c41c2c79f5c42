"""Filled-in bytes read back, through the middleware, as the messages that they stand for."""

import random

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros.bag.rig_messages import RigMessages
from impact_damper_ros.node.publishing import (
    ClockTemplate,
    ImpactTemplate,
    StateTemplate,
    restamped,
    serialised,
    time_from_ns,
)
from impact_damper_ros.rig import Event, EventKind, Sample

STAMPS = (0, 1, 999_999_999, 1_000_000_000, 1_700_000_000_123_456_789, 2**31 * 10**9 - 1)


def numbers(count, seed):
    """Awkward doubles: of all sizes, signed zeros, subnormal."""
    draw = random.Random(seed)
    special = [0.0, -0.0, 5e-324, 1e308, -1e-300]
    return [
        draw.choice(special)
        if draw.random() < 0.2
        else draw.uniform(-1, 1) * 10 ** draw.randint(-30, 30)
        for _ in range(count)
    ]


@pytest.mark.parametrize('stamp_ns', STAMPS)
def test_joint_states_read_back(stamp_ns):
    template = StateTemplate()
    for seed in range(50):
        sample = Sample(*numbers(9, seed))
        rest = numbers(1, 50 + seed)[0]
        message = deserialize_message(template.of(stamp_ns, sample, rest), JointState)
        assert message.header.stamp == time_from_ns(stamp_ns)
        assert message.header.frame_id == ''
        assert message.name == ['primary', 'damper', 'stop_1', 'stop_2']
        places = (sample.x, sample.z, sample.stop_1, sample.stop_2)
        assert list(message.position) == [place + rest for place in places]
        assert list(message.velocity) == [
            sample.primary_velocity,
            sample.damper_velocity,
            sample.stop_1_velocity,
            sample.stop_2_velocity,
        ]
        assert list(message.effort) == []


def test_without_ros_the_same_bytes():
    messages = RigMessages()
    for seed in range(50):
        sample = Sample(*numbers(9, seed))
        rest = numbers(1, 50 + seed)[0]
        expected = StateTemplate().of(STAMPS[4], sample, rest)
        assert messages.states(STAMPS[4], sample, rest) == expected
        for stop in (1, 2):
            event = Event(1.5, EventKind.IMPACT, stop, *numbers(7, 50 + seed))
            expected = ImpactTemplate(stop).of(STAMPS[5], event, rest)
            assert messages.impact(STAMPS[5], event, rest) == expected


@pytest.mark.parametrize('stop', [1, 2])
def test_impacts_read_back(stop):
    template = ImpactTemplate(stop)
    for seed in range(50):
        x, y, vb, va, wb, wa, impulse, rest = numbers(8, seed)
        impulse = abs(impulse)
        event = Event(1.5, EventKind.IMPACT, stop, x, y, vb, va, wb, wa, impulse)
        message = deserialize_message(template.of(1_500_000_000, event, rest), JointState)
        assert message.header.stamp == time_from_ns(1_500_000_000)
        assert message.header.frame_id == f'stop_{stop}'
        assert message.name == ['primary', 'damper']
        assert list(message.position) == [x + rest, x + y + rest]
        assert list(message.velocity) == [va, wa]
        # Stop 1 pushes the damper against the axis, and the primary mass along it.
        sign = 1.0 if stop == 1 else -1.0
        assert list(message.effort) == [sign * impulse, -sign * impulse]


def test_bytes_depend_on_the_values_alone():
    """The middleware leaves arbitrary bytes in the padding; they would end up in the log."""
    sample = Sample(*numbers(9, 1))
    first = StateTemplate().of(1, sample, 0.5)
    assert {StateTemplate().of(1, sample, 0.5) for _ in range(20)} == {first}
    template = StateTemplate()
    template.of(2, Sample(*numbers(9, 2)), 0.5)
    assert template.of(1, sample, 0.5) == first


def test_a_filled_message_is_not_overwritten_by_the_next():
    template = StateTemplate()
    first = template.of(1, Sample(*numbers(9, 1)), 0.5)
    copy = bytes(bytearray(first))
    template.of(2, Sample(*numbers(9, 2)), 0.5)
    assert first == copy


def test_clock_and_text_read_back():
    assert deserialize_message(ClockTemplate().of(5_000_000_007), Clock) == Clock(
        clock=time_from_ns(5_000_000_007)
    )
    assert deserialize_message(serialised(String(data='{"a": 1}')), String) == String(
        data='{"a": 1}'
    )


@pytest.mark.parametrize('kind', [ParameterEvent, DiagnosticArray, JointState])
def test_messages_are_stamped_anew(kind):
    message = kind()
    if kind is ParameterEvent:
        message.node = '/rig'
    data = restamped(serialize_message(message), 1_700_000_000_000_000_001)
    stamp = time_from_ns(1_700_000_000_000_000_001)
    if kind is ParameterEvent:
        message.stamp = stamp
    else:
        message.header.stamp = stamp
    assert deserialize_message(data, kind) == message


PARAMETERS = [
    ('a', True),
    ('bb', 3),
    ('ccc', 0.5),
    ('dddd', 'text'),
    ('e', [b'\x01', b'\x02']),
    ('ff', [True, False, True]),
    ('ggg', [1, 2, 3]),
    ('hhhh', [0.5]),
    ('i', ['x', 'yy', '']),
]


@pytest.mark.parametrize('count', range(len(PARAMETERS) + 1))
def test_serialised_messages_hold_the_message_and_no_more(count):
    """The middleware's own bytes end in arbitrary ones, up to hundreds; rosbags refuses that."""
    store = get_typestore(Stores.ROS2_JAZZY)
    parameters = [Parameter(n, value=v).to_parameter_msg() for n, v in PARAMETERS[:count]]
    event = ParameterEvent(
        node='/rig', new_parameters=parameters, changed_parameters=parameters[::-1]
    )
    status = DiagnosticStatus(
        level=b'\x01',
        name='n' * count,
        values=[KeyValue(key='k', value='v' * i) for i in range(count)],
    )
    for message in (event, DiagnosticArray(status=[status] * count), String(data='s' * count)):
        kind = type(message)
        data = serialised(message)
        assert deserialize_message(data, kind) == message
        name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
        read = store.deserialize_cdr(data, name)
        # An independent serialiser makes the same of it, padding included.
        assert bytes(store.serialize_cdr(read, name)) == data
