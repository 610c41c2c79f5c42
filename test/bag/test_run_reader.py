"""Reading bags back: values, order, and files that are no bags."""

import contextlib
import json
import math
import random
import tracemalloc

import numpy as np
import pytest
from bag import samples
from bag.alterations import rewritten, write_file

from impact_damper_ros.bag import (
    DiagnosticArray,
    JointState,
    ParameterEvent,
    RecordingError,
    RunReader,
    RunWriter,
    String,
    Topic,
    decode,
)
from impact_damper_ros.bag.messages import CdrError


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return samples.record(tmp_path_factory.mktemp('bags') / 'run_1', samples.run(500))


def test_decoded_values(bag):
    """Each message, against the numbers that it was made of."""
    step = 0
    for topic, kind, stamp, content in RunReader(bag):
        message = decode(kind, content)
        if topic == '/joint_states':
            position, velocity = (tuple(values) for values in samples.state_values(step))
            names = ('primary', 'damper', 'stop_1', 'stop_2')
            assert message == JointState(stamp, '', names, position, velocity, ())
            step += 1
        elif topic == '/impacts':
            assert isinstance(message, JointState)
            assert message.frame_id in ('stop_1', 'stop_2')
            assert message.position[1] == math.pi * round(message.position[0] * 10)
            assert message.effort == (1.5, -1.5)
        elif topic == '/parameter_events':
            assert isinstance(message, ParameterEvent)
            values = {p.name: p.value for p in message.new_parameters}
            assert values == {name: value for name, (_, value) in samples.PARAMETERS.items()}
            assert [p.name for p in message.changed_parameters] == ['gap']
            assert (message.node, message.deleted_parameters) == ('/rig', ())
        elif topic == '/diagnostics':
            assert isinstance(message, DiagnosticArray)
            assert [status.level for status in message.status] == [0, 1]
            assert message.status[1].values == (('rate', '999.97'),)
            assert message.frame_id == 'frame'
        else:
            assert isinstance(message, String)
            assert json.loads(message.data)['note'] == 'µ, "quoted"'
    assert step == 500


def test_topics_and_times(bag):
    messages = samples.run(500)
    types = {topic.name: topic.type for topic in samples.TOPICS}
    run = RunReader(bag)
    assert run.message_count == len(messages)
    assert run.topics['/impacts', samples.JOINT_STATE].message_count == 10
    assert (run.start_ns, run.end_ns) == (messages[0][2], messages[-1][2])
    assert [tuple(record) for record in run] == [
        (topic, types[topic], stamp, content)
        for topic, content, stamp in sorted(messages, key=lambda message: message[2])
    ]


def test_memory_does_not_grow_with_the_run(tmp_path):
    """Reading 20 times as much takes no more memory than 2 times as much, or nearly so."""
    peaks = []
    for chunks in (4, 40):
        bag = tmp_path / f'bag_{chunks}'
        text = 'x' * 10_000
        content = samples.serialise(samples.STRING, samples.make(samples.STRING, text))
        with RunWriter(bag, [Topic('/a', samples.STRING)]) as writer:
            for stamp in range(80 * chunks):
                writer.write('/a', content, stamp)
        tracemalloc.start()
        assert sum(1 for _ in RunReader(bag)) == 80 * chunks
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]


def test_an_mcap_file_not_of_ros_2(tmp_path):
    path = tmp_path / 'other.mcap'
    write_file(path, [], profile='ros1')
    with pytest.raises(RecordingError, match="its MCAP profile is 'ros1', not ros2"):
        RunReader(path)


def test_paths_that_hold_no_bag(tmp_path):
    with pytest.raises(RecordingError, match=r'there is no \.mcap file'):
        RunReader(tmp_path)


def test_a_damaged_chunk_is_named(bag, tmp_path):
    def hurt(content):
        content[content.index(b'\x28\xb5\x2f\xfd') + 200] ^= 0xFF  # in the first zstd frame

    rewritten(bag, hurt, tmp_path / 'hurt.mcap')
    with pytest.raises(RecordingError, match=r'the chunk at byte \d+ is damaged'):
        list(RunReader(tmp_path / 'hurt.mcap'))


@pytest.mark.parametrize('seed', range(3))
def test_joint_states_of_any_shape(seed):
    """The decoder and `rosbags` agree, whatever comes after whatever."""
    random_ = random.Random(seed)
    for _ in range(60):
        sizes = random_.choice([(4, 4, 0), (2, 2, 2), (0, 0, 0), (1, 0, 1), (3, 1, 2)])
        names = [random_.choice(['primary', 'stop_1', 'ä', '']) for _ in range(sizes[0])]
        values = [[random_.gauss(0, 1) for _ in range(size)] for size in sizes]
        stamp = random_.randrange(2**31 * 10**9)
        frame = random_.choice(['', 'stop_1', 'world'])
        content = samples.joint_state(stamp, names, *values, frame)
        expected = JointState(stamp, frame, tuple(names), *map(tuple, values))
        assert decode(samples.JOINT_STATE, content) == expected
        peer = samples.STORE.deserialize_cdr(content, samples.JOINT_STATE)
        np.testing.assert_array_equal(peer.effort, expected.effort)


@pytest.mark.parametrize('interface_name', ['JOINT_STATE', 'PARAMETER_EVENT', 'DIAGNOSTIC_ARRAY'])
def test_cut_or_garbled_messages_raise_only_cdr_errors(interface_name):
    name = getattr(samples, interface_name)
    content = {
        'JOINT_STATE': samples.state(3, 4),
        'PARAMETER_EVENT': samples.parameter_event(4),
        'DIAGNOSTIC_ARRAY': samples.diagnostics(4),
    }[interface_name]
    random_ = random.Random(1)
    for cut in range(len(content)):
        with pytest.raises(CdrError):
            decode(name, content[:cut])
    for _ in range(2000):
        garbled = bytearray(content)
        for _ in range(random_.randrange(1, 5)):
            garbled[random_.randrange(len(garbled))] = random_.randrange(256)
        with contextlib.suppress(CdrError):
            decode(name, bytes(garbled))
