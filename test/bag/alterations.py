"""Bags whose bytes, records or writer are others than those of a recording of this package."""

import json
import math
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


# Messages, as topic, content and stamp

_ARRAYS = ('position', 'velocity', 'effort')


def other_number(value, factor):
    """Return a number altered by a part of its size, or to a size."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return 2**62 if factor > 1.0 else value + (math.ceil(abs(value) * factor) or 1)
    if factor > 1.0:
        return math.copysign(factor, value)
    return value * (1.0 + factor) if value else factor


def _leaves(held, path=()):
    """Yield the places of all numbers in what JSON holds."""
    if isinstance(held, dict | list):
        for name, entry in held.items() if isinstance(held, dict) else enumerate(held):
            yield from _leaves(entry, (*path, name))
    elif isinstance(held, bool | int | float):
        yield path


def numbers_of(message):
    """Return the places of all numbers, and of the frame, in joint states or a snapshot."""
    topic, content, _ = message
    held = samples.STORE.deserialize_cdr(content, kind_of(topic))
    if kind_of(topic) == samples.STRING:
        return list(_leaves(json.loads(held.data)))
    found = [('stamp', 'sec'), ('stamp', 'nanosec')] + [('frame',)] * bool(held.header.frame_id)
    return found + [(a, i) for a in _ARRAYS for i in range(len(getattr(held, a)))]


def altered_message(message, place, factor):
    """Return a message with the number at a place altered."""
    topic, content, stamp = message
    held = samples.STORE.deserialize_cdr(content, kind_of(topic))
    first = place[0]
    if kind_of(topic) == samples.STRING:
        text = part = json.loads(held.data)
        for step in place[:-1]:
            part = part[step]
        part[place[-1]] = other_number(part[place[-1]], factor)
        held.data = json.dumps(text)
    elif first == 'stamp':
        most = 2**31 - 1 if place[1] == 'sec' else 10**9 - 1
        value = int(getattr(held.header.stamp, place[1]))
        new = most if factor > 1.0 else min(most, other_number(value, factor))
        setattr(held.header.stamp, place[1], new if new != value else value - 1)
    elif first == 'frame':
        other = {'stop_1': 'stop_2', 'stop_2': 'stop_1', 'command': 'crossing'}
        held.header.frame_id = other.get(held.header.frame_id, 'command')
    else:
        values = getattr(held, first).copy()
        values[place[1]] = other_number(float(values[place[1]]), factor)
        setattr(held, first, values)
    return topic, samples.serialise(kind_of(topic), held), stamp


def _at(topic, messages, share=0.5):
    """Return the index of the message of a topic at a part of the bag."""
    held = [i for i, message in enumerate(messages) if message[0] == topic]
    return held[min(int(share * len(held)), len(held) - 1)]


def rearranged(topic, messages):
    """Yield what is wrong with messages of a topic, and the messages of the bag."""
    i, j = _at(topic, messages), _at(topic, messages, 0.6)
    one, other = messages[i], messages[j]
    before, after = messages[:i], messages[i + 1 :]
    yield 'missing', before + after
    yield 'half of them missing', [m for k, m in enumerate(messages) if m[0] != topic or k % 2]
    yield 'twice', [*before, one, one, *after]
    yield 'twice, at the end', [*messages, one]
    yield 'all missing', [m for m in messages if m[0] != topic]
    yield 'without content', [*before, (topic, b'', one[2]), *after]
    for name in ('/joint_states', '/impacts'):
        if name != topic:
            yield f'on {name}', [*before, (name, *one[1:]), *after]
    if one[1] != other[1]:
        yield 'with the content of another', [*before, (topic, other[1], one[2]), *after]


def wrong_bags(messages):
    """Yield what is wrong with a bag as a whole, and its messages."""
    third, span = len(messages) // 3, messages[-1][2] - messages[0][2] + 10**7
    yield 'twice', messages + messages
    yield 'twice, one after the other', messages + [(t, c, s + span) for t, c, s in messages]
    for part in range(6):
        begin, end = (len(messages) * k // 7 for k in (part, part + 1))
        yield f'without part {part} of 7', messages[:begin] + messages[end:]
    yield 'without its middle', messages[:third] + messages[2 * third :]


def recorded_otherwise(messages):
    """Yield how else the same messages may be recorded, and the messages of the bag."""
    yield 'a second later', [(t, c, s + 10**9) for t, c, s in messages]
    yield 'at one instant', [(t, c, messages[0][2]) for t, c, _ in messages]
    for topic in sorted({m[0] for m in messages}):
        later = [(t, c, s + 3 * 10**8 * (t == topic)) for t, c, s in messages]
        yield f'{topic} later', sorted(later, key=lambda message: message[2])
        i, j = _at(topic, messages), _at(topic, messages, 0.6)
        exchanged = list(messages)
        for a, b in ((i, j), (j, i)):
            exchanged[a] = (topic, messages[b][1], messages[a][2])
        yield f'{topic} exchanged', exchanged
