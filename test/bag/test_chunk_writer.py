"""The files of `ChunkWriter` against those of the `mcap` library, byte for byte."""

from __future__ import annotations

import io
import random

import pytest
from mcap.writer import CompressionType, Writer

from impact_damper_ros.bag.bag_file import ChunkWriter

PROFILE, LIBRARY = 'ros2', 'test'
CHUNK_SIZE = 20_000


def written(seed: int, messages: int, channels: int) -> tuple[bytes, bytes]:
    """Make the same calls of the library and of `ChunkWriter`; return both files."""
    theirs, ours = io.BytesIO(), io.BytesIO()
    library = Writer(theirs, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD)
    library.start(profile=PROFILE, library=LIBRARY)
    writer = ChunkWriter(ours, CHUNK_SIZE, PROFILE, LIBRARY)
    dice = random.Random(seed)
    for metadata in ({'head': 'µ'}, {}):
        library.add_metadata('rosbag2', metadata)
        writer.add_metadata('rosbag2', metadata)
    for number in range(channels):
        schema = f'pkg/msg/Type{number}', 'ros2msg', dice.randbytes(5 * number)
        name, about = f'/topic_{number}', {'kind': str(number)}
        theirs_id = library.register_channel(name, 'cdr', library.register_schema(*schema), about)
        ours_id = writer.register_channel(name, 'cdr', writer.register_schema(*schema), about)
        assert ours_id == theirs_id
    for sequence in range(messages):
        channel = 1 + min(int(dice.expovariate(1.0)), channels - 1)
        # Not in the order of their stamps
        stamp = dice.choice((0, sequence, 2**63 - 1 - sequence))
        content = dice.randbytes(dice.choice((0, 4, 200, 200, 200, 3000)))
        library.add_message(channel, stamp, content, stamp, sequence)
        writer.add_message(channel, stamp, content, sequence)
        if dice.random() < 0.02:
            library.flush()
            writer.flush()
            assert ours.getvalue() == theirs.getvalue()
    library.finish()
    writer.finish()
    return theirs.getvalue(), ours.getvalue()


@pytest.mark.parametrize('seed', range(4))
def test_many_messages(seed: int) -> None:
    theirs, ours = written(seed, 700, 1 + seed)
    assert len(ours) > 3 * CHUNK_SIZE
    assert ours == theirs


@pytest.mark.parametrize('messages', [0, 1])
def test_hardly_anything(messages: int) -> None:
    theirs, ours = written(5, messages, 2)
    assert ours == theirs


def test_schemas_larger_than_a_chunk() -> None:
    theirs, ours = io.BytesIO(), io.BytesIO()
    library = Writer(theirs, chunk_size=100, compression=CompressionType.ZSTD)
    library.start(profile=PROFILE, library=LIBRARY)
    writer = ChunkWriter(ours, 100, PROFILE, LIBRARY)
    assert writer.register_schema('a', 'b', bytes(500)) == library.register_schema(
        'a', 'b', bytes(500)
    )
    library.flush()
    writer.flush()
    assert ours.getvalue() == theirs.getvalue()
    library.finish()
    writer.finish()
    assert ours.getvalue() == theirs.getvalue()
