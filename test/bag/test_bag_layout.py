"""A bag is what rosbag2 writes: read by an independent library, values compared."""

import json

import numpy as np
import pytest
import yaml
from bag import samples
from mcap.reader import make_reader
from mcap.records import DataEnd
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from impact_damper_ros.bag import RunReader, topics as interface


@pytest.fixture(scope='module')
def messages():
    return samples.run(1000)


@pytest.fixture(scope='module')
def bag(tmp_path_factory, messages):
    directory = tmp_path_factory.mktemp('bags') / 'run_1'
    return samples.record(directory, messages, custom={'note': 'yes'})


def test_rosbags_reads_and_decodes_every_message(bag, messages):
    """With the definitions in the bag, and with the quality of service."""
    with AnyReader([bag]) as reader:
        assert reader.message_count == len(messages)
        assert (reader.start_time, reader.end_time) == (messages[0][2], messages[-1][2] + 1)
        for connection in reader.connections:
            assert connection.digest == interface.type_hash(connection.msgtype)
            (profile,) = connection.ext.offered_qos_profiles
            latched = connection.topic == '/snapshot'
            assert profile.durability.name == ('TRANSIENT_LOCAL' if latched else 'VOLATILE')
            assert profile.depth == (1 if latched else 10)
            assert (profile.reliability.name, profile.history.name) == ('RELIABLE', 'KEEP_LAST')
            assert (profile.deadline.sec, profile.deadline.nsec) == (9223372036, 854775807)
        read = [(c.topic, bytes(content), stamp, c) for c, stamp, content in reader.messages()]
        assert [row[:3] for row in read] == sorted(messages, key=lambda message: message[2])
        step = 0
        for topic, content, stamp, connection in read:
            message = reader.deserialize(content, connection.msgtype)
            if topic == '/joint_states':
                position, velocity = samples.state_values(step)
                np.testing.assert_array_equal(message.position, position)
                np.testing.assert_array_equal(message.velocity, velocity)
                within = message.header.stamp
                assert (within.sec, within.nanosec) == divmod(stamp, 10**9)
                step += 1
            elif topic == '/parameter_events':
                values = {p.name: p.value for p in message.new_parameters}
                assert values['gap'].double_value == 37.25
                assert values['gap_control'].string_value == 'amplitude µ'
            elif topic == '/snapshot':
                assert json.loads(message.data)['stamp_offset_ns'] == samples.START
    assert step == 1000


def test_records_of_the_file(bag):
    (path,) = bag.glob('*.mcap')
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        head, summary = reader.get_header(), reader.get_summary()
        stream.seek(0)
        found = list(StreamReader(stream, validate_crcs=True).records)
    (end,) = (record for record in found if isinstance(record, DataEnd))
    assert end.data_section_crc != 0
    assert (head.profile, head.library.partition('/')[0]) == ('ros2', 'impact_damper_ros')
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        assert (channel.message_encoding, schema.encoding) == ('cdr', 'ros2msg')
        assert channel.metadata.keys() == {'offered_qos_profiles', 'topic_type_hash'}
        assert channel.metadata['topic_type_hash'] == interface.type_hash(schema.name)


def test_metadata_has_every_field_that_rosbag2_reads(bag, tmp_path):
    """Compare names and types with what `rosbags` writes for version 9."""
    with Writer(tmp_path / 'peer', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        msgtype = samples.STRING
        writer.add_connection('/a', msgtype, typestore=samples.STORE)

    def shape(value):
        if isinstance(value, dict):
            return {key: shape(item) for key, item in value.items()}
        if isinstance(value, list):
            return [shape(item) for item in value[:1]]
        return type(value).__name__

    peer = yaml.safe_load((tmp_path / 'peer' / 'metadata.yaml').read_text())
    ours = yaml.safe_load((bag / 'metadata.yaml').read_text())
    ours['rosbag2_bagfile_information']['custom_data'] = None
    for bagfile in (peer, ours):
        topics = bagfile['rosbag2_bagfile_information']['topics_with_message_count']
        topics[0]['topic_metadata']['offered_qos_profiles'] = []
    assert shape(ours) == shape(peer)
    information = ours['rosbag2_bagfile_information']
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['run_1_0.mcap']


def test_an_empty_bag_is_valid(tmp_path):
    bag = samples.record(tmp_path / 'empty', [])
    with Reader(bag) as reader:
        assert reader.message_count == 0
        assert list(reader.messages()) == []
        assert len(reader.connections) == len(samples.TOPICS)
    content = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert content['starting_time']['nanoseconds_since_epoch'] == 2**63 - 1
    run = RunReader(bag)
    assert run.complete
    assert (run.message_count, run.start_ns, list(run)) == (0, None, [])


@pytest.mark.parametrize('name', interface.type_hashes())
def test_definitions_give_the_hashes(name):
    """An independent implementation of REP 2016 finds the same hashes."""
    assert samples.STORE.hash_rihs01(name) == interface.type_hash(name)
