"""Messages with known values, serialised by `rosbags`, which shares no code with the package."""

import json
import math

import numpy as np
from rosbags.typesys import Stores, get_typestore

from impact_damper_ros.bag import LATCHED, RunWriter, Topic

STORE = get_typestore(Stores.ROS2_JAZZY)
START = 1_700_000_000_123_456_789

JOINT_STATE = 'sensor_msgs/msg/JointState'
PARAMETER_EVENT = 'rcl_interfaces/msg/ParameterEvent'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
STRING = 'std_msgs/msg/String'

TOPICS = (
    Topic('/joint_states', JOINT_STATE),
    Topic('/impacts', JOINT_STATE),
    Topic('/parameter_events', PARAMETER_EVENT),
    Topic('/diagnostics', DIAGNOSTIC_ARRAY),
    Topic('/snapshot', STRING, LATCHED),
)

#: Of a node that knows gap control.
CONTROLLED = (*TOPICS, Topic('/gap_control', JOINT_STATE))


def serialise(interface, message):
    return bytes(STORE.serialize_cdr(message, interface))


def make(interface, *fields):
    return STORE.types[interface](*fields)


def time(stamp_ns):
    return make('builtin_interfaces/msg/Time', stamp_ns // 10**9, stamp_ns % 10**9)


def header(stamp_ns, frame=''):
    return make('std_msgs/msg/Header', time(stamp_ns), frame)


def joint_state(stamp_ns, names, position, velocity=(), effort=(), frame=''):
    arrays = [np.array(values, dtype=np.float64) for values in (position, velocity, effort)]
    message = make(JOINT_STATE, header(stamp_ns, frame), list(names), *arrays)
    return serialise(JOINT_STATE, message)


def numbers(content):
    """Return the positions, velocities and efforts of joint states."""
    held = STORE.deserialize_cdr(content, JOINT_STATE)
    return [part.tolist() for part in (held.position, held.velocity, held.effort)]


def with_numbers(content, stamp_ns, *parts):
    """Return joint states with another stamp and other positions, velocities and efforts."""
    held = STORE.deserialize_cdr(content, JOINT_STATE)
    return joint_state(stamp_ns, held.name, *parts, frame=held.header.frame_id)


def state_values(step):
    """Return positions and velocities of the four joints at a step, all of them irrational."""
    x, z = 10.1 * math.sin(0.3 * step), 9.7 * math.cos(0.21 * step)
    return [x, z, x + 18.5, x - 18.5], [10.1 * math.cos(0.3 * step), math.sqrt(step + 2.0), x, x]


def state(step, stamp_ns):
    return joint_state(stamp_ns, ['primary', 'damper', 'stop_1', 'stop_2'], *state_values(step))


def impact(step, stamp_ns):
    values = [0.1 * step, math.pi * step]
    frame = f'stop_{1 + step % 2}'
    return joint_state(stamp_ns, ['primary', 'damper'], values, values[::-1], [1.5, -1.5], frame)


#: A value of each type of parameter, by the number of its type.
PARAMETERS = {
    'unset': (0, None),
    'one_sided': (1, True),
    'count': (2, -(2**62)),
    'gap': (3, 37.25),
    'gap_control': (4, 'amplitude µ'),
    'octets': (5, b'\x00\x01\xff'),
    'flags': (6, (True, False, True)),
    'integers': (7, (1, -2, 2**40)),
    'force_amplitudes': (8, (0.1, 1 / 3)),
    'names': (9, ('', 'a', 'stop_1')),
}


def parameter(name, kind, value):
    fields = [False, 0, 0.0, '']
    arrays = [np.array([], dtype) for dtype in ('u1', '?', 'i8', 'f8')]
    fields += [*arrays, []]
    if kind:
        dtype = {5: 'u1', 6: '?', 7: 'i8', 8: 'f8'}.get(kind)
        if kind == 5:
            value = list(value)
        if kind == 9:
            value = list(value)
        fields[kind - 1] = np.array(value, dtype) if dtype else value
    content = make('rcl_interfaces/msg/ParameterValue', kind, *fields)
    return make('rcl_interfaces/msg/Parameter', name, content)


def parameter_event(stamp_ns, node='/rig'):
    every = [parameter(name, kind, value) for name, (kind, value) in PARAMETERS.items()]
    message = make(PARAMETER_EVENT, time(stamp_ns), node, every, every[3:4], [])
    return serialise(PARAMETER_EVENT, message)


def diagnostics(stamp_ns, count=2):
    pairs = [('rate', '999.97'), ('überlauf', '0')]
    values = [make('diagnostic_msgs/msg/KeyValue', *pair) for pair in pairs]
    status = [
        make('diagnostic_msgs/msg/DiagnosticStatus', k % 4, f'part {k}', 'fine', 'rig', values[:k])
        for k in range(count)
    ]
    message = make(DIAGNOSTIC_ARRAY, header(stamp_ns, 'frame'), status)
    return serialise(DIAGNOSTIC_ARRAY, message)


def snapshot(stamp_ns):
    held = {'stamp_offset_ns': stamp_ns, 'state': {'format': 3}, 'note': 'µ, "quoted"'}
    text = json.dumps(held)
    return serialise(STRING, make(STRING, text))


def run(steps, rate=200):
    """Return a run as (topic, content, stamp), in the order in which a node writes it."""
    messages = [
        ('/snapshot', snapshot(START), START),
        ('/parameter_events', parameter_event(START), START),
    ]
    for step in range(steps):
        stamp = START + step * 10**9 // rate
        if step % 50 == 7:
            messages.append(('/impacts', impact(step, stamp - 1234), stamp - 1234))
        if step % rate == 0:
            messages.append(('/diagnostics', diagnostics(stamp), stamp))
        messages.append(('/joint_states', state(step, stamp), stamp))
    return messages


def record(directory, messages, topics=None, **options):
    """Record messages to a new bag, with the topics that its notes name; return its path."""
    if topics is None:
        topics = CONTROLLED if 'gap_control' in options.get('custom', ()) else TOPICS
    with RunWriter(directory, topics, **options) as writer:
        for message in messages:
            assert writer.write(*message)
    assert writer.error is None
    return directory
