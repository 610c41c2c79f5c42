"""Bags whose bytes, records or writer are others than those of a recording of this package."""

import struct

from bag import samples
from bag.recorded_rig import NOTES
from mcap.opcode import Opcode
from mcap.writer import Writer

from impact_damper_ros.bag import topics as interface
from impact_damper_ros.bag.bag_file import BagFile

MAGIC = b'\x89MCAP0\r\n'
CHANNELS = {topic.name: index for index, topic in enumerate(samples.CONTROLLED)}
TYPES = {
    'joint_states': samples.JOINT_STATE,
    'impacts': samples.JOINT_STATE,
    'gap_control': samples.JOINT_STATE,
    'snapshot': samples.STRING,
    'restart_point': samples.STRING,
    'parameter_events': samples.PARAMETER_EVENT,
    'diagnostics': samples.DIAGNOSTIC_ARRAY,
}


def kind_of(topic):
    """Return the type of the messages of a topic."""
    return TYPES.get(topic.rpartition('/')[2], samples.JOINT_STATE)


def definition_of(kind):
    """Return the text of the definition of a type."""
    return interface.definition(kind).encode()


# Written as a whole


def write(directory, messages, *, every=250, notes=NOTES):
    """Write the node's own bag, with a chunk of so many messages each."""
    bag = BagFile(directory, [topic.channel() for topic in samples.CONTROLLED], notes)
    for number, (topic, content, stamp) in enumerate(messages):
        bag.add(CHANNELS[topic], content, stamp)
        if number % every == every - 1:
            bag.flush()
    bag.finish()
    return directory


def write_file(
    path,
    messages,
    *,
    profile='ros2',
    library='other',
    kinds=kind_of,
    definition=definition_of,
    notes=lambda _: {},
    topics=(),
    sent=lambda stamp: stamp - 777,
    sequence=5,
    schemas=True,
    extra=None,
    extra_first=False,
    **options,
):
    """
    Write an MCAP file by the library of MCAP; return its path.

    Channels are those of `topics` and then those of the messages, in their order. `kinds`,
    `definition`, `notes` and `sent` return the type of a topic, the text of a type, what is noted
    of a topic, and when a message was sent; `extra` is done to the writer, last or first.
    """
    with path.open('wb') as stream:
        writer = Writer(stream, **{'chunk_size': 30_000, **options})
        writer.start(profile, library)
        numbers, channels = {}, {}

        def channel_of(topic):
            if topic not in channels:
                kind = kinds(topic)
                if kind not in numbers:
                    text = definition(kind_of(topic))
                    numbers[kind] = writer.register_schema(kind, 'ros2msg', text)
                number = numbers[kind] * schemas
                channels[topic] = writer.register_channel(topic, 'cdr', number, notes(topic))
            return channels[topic]

        if extra is not None and extra_first:
            extra(writer)
        for topic in topics:
            channel_of(topic)
        for topic, content, stamp in messages:
            writer.add_message(channel_of(topic), stamp, content, sent(stamp), sequence)
        if extra is not None and not extra_first:
            extra(writer)
        writer.finish()
    return path


# Bytes


def file_of(bag):
    """Return the one file of a bag that holds messages."""
    if bag.is_file():
        return bag
    (file,) = (path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))
    return file


def rewritten(bag, change, copy=None):
    """
    Write other bytes into the file of a bag, or into a copy; return its path.

    `change` alters the `bytearray` that it is given, or returns other bytes.
    """
    file = file_of(bag)
    content = bytearray(file.read_bytes())
    changed = change(content)
    target = copy or file
    target.write_bytes(content if changed is None else changed)
    return target


def cut(part):
    """Return a change that leaves so much of a file, as a share or a number of bytes."""
    return lambda content: content[: int(len(content) * part) if isinstance(part, float) else part]


def flipped(content, dice):
    """Return bytes of which some are altered, missing or there twice."""
    held = bytearray(content)
    for _ in range(dice.choice((1, 4))):
        at = dice.randrange(len(held))
        part = dice.choice((bytes([dice.randrange(256)]), b'', bytes(held[at : at + 60])))
        held[at : at + 1] = part
    return bytes(held)


# Records


def placed(content):
    """Yield opcode, start and end of the records of an MCAP file, by the format's definition."""
    position = len(MAGIC)
    while position < len(content) - len(MAGIC):
        opcode, length = struct.unpack_from('<BQ', content, position)
        yield opcode, position, position + 9 + length
        position += 9 + length


def records(content):
    """Return the records of an MCAP file as opcode and content."""
    return [(opcode, bytes(content[start + 9 : end])) for opcode, start, end in placed(content)]


def of_records(found):
    """Return the bytes of an MCAP file of some records."""
    parts = [struct.pack('<BQ', opcode, len(held)) + held for opcode, held in found]
    return MAGIC + b''.join(parts) + MAGIC


def chunks_of(found):
    """Return at which places of the records the chunks are."""
    return [i for i, (opcode, _) in enumerate(found) if opcode == Opcode.CHUNK]


def with_records(change):
    """Return a change of bytes from one that alters the list of records, or returns another."""

    def changed(content):
        found = records(content)
        return of_records(change(found) or found)

    return changed


def altered(bag, directory, change, *, listing=True):
    """Copy a bag with other records."""
    directory.mkdir()
    path = rewritten(bag, with_records(change), directory / file_of(bag).name)
    if not listing:
        return path
    (directory / 'metadata.yaml').write_bytes((bag / 'metadata.yaml').read_bytes())
    return directory


def without_chunk(number):
    """Return a change that leaves a chunk out, with its indexes."""

    def change(found):
        end = first = chunks_of(found)[number]
        while found[end + 1][0] == Opcode.MESSAGE_INDEX:
            end += 1
        return found[:first] + found[end + 1 :]

    return change


def edited(opcode, at, layout, value, number=0):
    """Return a change that puts a value into the record of a kind."""

    def change(found):
        which = [i for i, (code, _) in enumerate(found) if code == opcode][number]
        held = bytearray(found[which][1])
        struct.pack_into(layout, held, at, value)
        found[which] = (opcode, bytes(held))

    return change
