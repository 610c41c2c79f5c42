"""Filled-in bytes read back, through the middleware, as the messages that they stand for."""

import random

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros import Action, ControlAct, Event, EventKind, Sample
from impact_damper_ros.bag import messages
from impact_damper_ros.bag.messages import clock_message, decode, encode, with_stamp
from impact_damper_ros.bag.rig_topics import RigMessages

STAMPS = (0, 1, 999_999_999, 1_000_000_000, 1_700_000_000_123_456_789, 2**31 * 10**9 - 1)


def time_of(stamp_ns):
    return Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


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


def test_the_bytes_are_those_of_an_independent_serialiser():
    """Joint states, impacts and acts: padding and all."""
    store, encoder = get_typestore(Stores.ROS2_JAZZY), RigMessages()
    name = 'sensor_msgs/msg/JointState'
    for seed in range(50):
        sample, stamp_ns = Sample(*numbers(11, seed)), STAMPS[seed % len(STAMPS)]
        rest = numbers(1, 50 + seed)[0]
        found = [encoder.states(stamp_ns, sample, rest, -rest)]
        for stop in (1, 2):
            event = Event(1.5, EventKind.IMPACT, stop, *numbers(7, 50 + seed))
            found.append(encoder.impact(stamp_ns, event, rest))
        for action in Action:
            record = ControlAct(1.5, action, *numbers(8, seed))
            found += [encoder.control(stamp_ns, record)]
        states = deserialize_message(found[0], JointState)
        # Not overwritten by those after it
        assert list(states.position[:2]) == [sample.x + rest, sample.z + rest]
        for content in found:
            read = store.deserialize_cdr(content, name)
            assert (read.header.stamp.sec, read.header.stamp.nanosec) == divmod(stamp_ns, 10**9)
            assert bytes(store.serialize_cdr(read, name)) == content
            assert encode(decode(name, content)) == content


def test_bytes_depend_on_the_values_alone():
    """Arbitrary bytes in the padding would end up in the log."""
    sample = Sample(*numbers(11, 1))
    first = RigMessages().states(1, sample, 0.5, 0.1)
    assert {RigMessages().states(1, sample, 0.5, 0.1) for _ in range(20)} == {first}
    encoder = RigMessages()
    encoder.states(2, Sample(*numbers(11, 2)), 0.5, 0.2)
    assert encoder.states(1, sample, 0.5, 0.1) == first


def test_clock_and_text_read_back():
    clock = deserialize_message(clock_message(5_000_000_007), Clock)
    assert clock == Clock(clock=time_of(5_000_000_007))
    text = encode(messages.String('{"a": 1}'))
    assert deserialize_message(text, String) == String(data='{"a": 1}')


@pytest.mark.parametrize('kind', [ParameterEvent, DiagnosticArray, JointState])
def test_messages_are_stamped_anew(kind):
    message, stamp_ns = kind(), 1_700_000_000_000_000_001
    holder = message if kind is ParameterEvent else message.header
    data = with_stamp(serialize_message(message), stamp_ns)
    holder.stamp = time_of(stamp_ns)
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
def test_encoded_messages_hold_the_message_and_no_more(count):
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
        name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
        data = encode(decode(name, serialize_message(message)))
        assert deserialize_message(data, kind) == message
        read = store.deserialize_cdr(data, name)
        # An independent serialiser makes the same of it, padding included.
        assert bytes(store.serialize_cdr(read, name)) == data


def test_a_parameter_without_a_value_or_with_an_empty_array():
    parameters = [Parameter('none').to_parameter_msg(), Parameter('empty', value=[0.5])]
    parameters[1] = parameters[1].to_parameter_msg()
    parameters[1].value.double_array_value = []
    event = ParameterEvent(node='/rig', new_parameters=parameters)
    data = encode(decode('rcl_interfaces/msg/ParameterEvent', serialize_message(event)))
    assert deserialize_message(data, ParameterEvent) == event
