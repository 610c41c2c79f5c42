"""Bags as `ros2 bag record` writes them, made of a recorded run by independent writers."""

import random
import struct
from pathlib import Path

import yaml
from bag import alterations, samples
from bag.alterations import kind_of
from mcap.writer import CompressionType
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as PeerWriter

from impact_damper_ros.bag import topics as interface

LIBRARY = 'libmcap 1.1.0'
QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""


def joined(messages, from_stamp, *, seed=1, topics=None):
    """
    Return what a recorder gets that joins at a stamp: times of arrival, the snapshot first.

    Each topic may be joined at a stamp of its own, given by `topics`.
    """
    rng = random.Random(seed)
    latched = [m for m in messages if m[0].endswith('/snapshot') and m[2] < from_stamp]
    arrived = [(t, c, from_stamp - 50_000_000) for t, c, _ in latched[-1:]]
    last = {}
    for topic, content, stamp in messages:
        if stamp < (topics or {}).get(topic, from_stamp):
            continue
        if topic.endswith('/parameter_events'):
            # rclpy publishes its own, with its own stamp.
            own = max(0, stamp - 5000)
            content = content[:4] + struct.pack('<iI', *divmod(own, 10**9)) + content[12:]
        last[topic] = max(stamp + 150_000 + rng.randrange(6_000_000), last.get(topic, 0) + 1)
        arrived.append((topic, content, last[topic]))
    return sorted(arrived, key=lambda message: message[2])


def described(topic):
    """Return what rosbag2 notes of a channel."""
    latched = topic.endswith('/snapshot')
    durability = 'transient_local' if latched else 'volatile'
    qos = QOS.format(depth=1 if latched else 10, durability=durability)
    return {'offered_qos_profiles': qos, 'topic_type_hash': interface.type_hash(kind_of(topic))}


def write_file(path, messages, topics, compression=CompressionType.NONE):
    """Write a file as rosbag2 does: received a little later than it was sent."""
    return alterations.write_file(
        path,
        messages,
        library=LIBRARY,
        notes=described,
        topics=topics,
        sent=lambda stamp: max(0, stamp - 100_000),
        sequence=0,
        chunk_size=100_000,
        compression=compression,
    )


def write_bag(directory, messages, *, files=1, compression=None):
    """Write a bag of so many files, compressed by chunk or not at all."""
    directory = Path(directory)
    directory.mkdir()
    topics = sorted({topic for topic, *_ in messages})
    each = -(-len(messages) // files)
    listed, names = [], []
    for number in range(files):
        part = messages[number * each : (number + 1) * each]
        path = directory / f'{directory.name}_{number}.mcap'
        write_file(path, part, topics, compression or CompressionType.NONE)
        start, end = part[0][2], max(stamp for *_, stamp in part)
        listed.append(
            {
                'path': path.name,
                'starting_time': {'nanoseconds_since_epoch': start},
                'duration': {'nanoseconds': end - start},
                'message_count': len(part),
            }
        )
        names.append(path.name)
    start, end = messages[0][2], max(stamp for *_, stamp in messages)
    content = {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': end - start},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': len(messages),
        'topics_with_message_count': [
            {
                'topic_metadata': {'name': topic, 'type': kind_of(topic)},
                'message_count': sum(topic == name for name, *_ in messages),
            }
            for topic in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': names,
        'files': listed,
        'custom_data': None,
        'ros_distro': 'jazzy',
    }
    text = yaml.safe_dump({'rosbag2_bagfile_information': content}, sort_keys=False)
    (directory / 'metadata.yaml').write_text(text)
    return directory


def write_by_rosbags(directory, messages, mode, storage=StoragePlugin.MCAP):
    """Write a bag by `rosbags`, with its mode of compression and its storage."""
    writer = PeerWriter(directory, version=9, storage_plugin=storage)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind_of(topic), typestore=samples.STORE)
            for topic in sorted({topic for topic, *_ in messages})
        }
        for topic, content, stamp in messages:
            writer.write(connections[topic], stamp, content)
    return directory
