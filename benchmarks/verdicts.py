"""
How far the verdicts over recordings can be trusted: what is wrong passes by, what is right is not.

Four tables are printed. *Altered*: a bag in which one number of one message is altered, by 1e-3
of its size or to 1e300, is handed to `compare_run` and to `replay_run`; the exit status 0, or an
exception, counts as unnoticed. The statistics of an altered bag are consistent. *Rearranged*: the
same for messages that are missing, there twice, or on another topic, with their numbers made good.
*Untouched*: bags of the same kinds with random rigs, and bags whose messages are recorded later or
in another order; any other exit status than 0 counts as a false alarm. *Soaks*: long bags with
random changes, made by ``simulate_rig --bag --change``; stretches that `compare_run` doubts are
counted.

The altered bags of one run are all compared with the theory of its first comparison: an alteration
must be noticed by the log alone, and theory takes most of the time.

`test/cli/test_verdicts.py` does a little of each. ``python benchmarks/verdicts.py`` takes an hour
on one core; with ``--places 10 --bags 10 --stretches 300``, a minute or two.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from impact_damper_ros.cli import compare_run, replay_run, simulate_rig
from impact_damper_ros.compare import comparison

ROOT = Path(__file__).parents[1]
BENCH, PAPER = (str(ROOT / 'config' / f'{name}.yaml') for name in ('bench_rig', 'paper'))
STORE = get_typestore(Stores.ROS2_JAZZY)
#: Joint states per second, and how long the runs with them take, s.
RATES = {50: 20.0, 200: 10.0, 1000: 4.0}
#: Part of a run after which a parameter changes.
CHANGED = 0.55
FACTORS = (1e-3, 1e300)
#: Parts of a bag that are taken out of it, one at a time.
_CHUNKS = 20
#: A picture of the rig and settings of the node, which the commands list as not checked.
UNCHECKED = {'/robot_description', '/parameter_events'}
SEED = 11


@dataclass(frozen=True)
class Kind:
    """A kind of run: its rig, what is set, and what changes on the way."""

    rig: str
    settings: tuple[str, ...]
    change: str


KINDS = {
    'settled': Kind(BENCH, (), 'gap=0.025'),
    'chaotic': Kind(BENCH, ('gap=0.034',), 'friction=0.01'),
    'controlled': Kind(BENCH, ('gap_control=timed',), 'gap_control=amplitude'),
    'stepped sine': Kind(
        BENCH,
        ('sweep_mode=up_down', 'sweep_low=28', 'sweep_high=34', 'sweep_dwell=0.7'),
        'angle=0.05',
    ),
}


def record(kind: Kind, directory: Path, rate: int, settings: tuple[str, ...] = ()) -> Path:
    """Record a run of a kind; return the bag."""
    duration = RATES[rate]
    change = f'{CHANGED * duration!r}:{kind.change}'
    return simulated(directory, kind.rig, rate, duration, (*kind.settings, *settings), (change,))


def simulated(
    directory: Path,
    rig: str,
    rate: int,
    duration: float,
    settings: tuple[str, ...],
    changes: tuple[str, ...],
) -> Path:
    """Record a run; return the bag."""
    words = [rig, '--duration', repr(duration), '--rate', repr(rate), '--quiet']
    for setting in settings:
        words += ['--set', setting]
    for change in changes:
        words += ['--change', change]
    status = simulate_rig.main([*words, '--bag', str(directory)])
    if status:
        raise RuntimeError(f'simulate_rig {" ".join(words)} ended with {status}')
    return directory


# Altered bags


@dataclass(frozen=True)
class Message:
    """A message of a bag, to be written again."""

    schema: str
    topic: str
    stamp_ns: int
    publish_ns: int
    sequence: int
    content: bytes


def read(bag: Path) -> list[Message]:
    """Return the messages of a bag by an independent reader."""
    (file,) = bag.glob('*.mcap')
    with file.open('rb') as stream:
        return [
            Message(s.name, c.topic, m.log_time, m.publish_time, m.sequence, m.data)
            for s, c, m in make_reader(stream).iter_messages(log_time_order=False)
        ]


def write(bag: Path, source: Path, messages: list[Message]) -> None:
    """Write a bag by an independent writer, with the descriptions of another one."""
    shutil.rmtree(bag, ignore_errors=True)
    bag.mkdir()
    (file,) = source.glob('*.mcap')
    shutil.copy(source / 'metadata.yaml', bag)
    with file.open('rb') as stream, (bag / file.name).open('wb') as target:
        reader = make_reader(stream)
        header, summary = reader.get_header(), reader.get_summary()
        notes = list(reader.iter_metadata())
        writer = Writer(target, compression=CompressionType.NONE)
        writer.start(header.profile, header.library)
        schemas = {
            number: writer.register_schema(s.name, s.encoding, s.data)
            for number, s in summary.schemas.items()
        }
        channels = {
            c.topic: writer.register_channel(
                c.topic, c.message_encoding, schemas[c.schema_id], c.metadata
            )
            for c in summary.channels.values()
        }
        for m in messages:
            writer.add_message(channels[m.topic], m.stamp_ns, m.content, m.publish_ns, m.sequence)
        for note in notes:
            writer.add_metadata(note.name, note.metadata)
        writer.finish()


def altered(value: Any, factor: float) -> Any:
    """Return a number altered by a part of its size, or to a size."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        if factor > 1.0:
            return 2**62
        return value + (math.ceil(abs(value) * factor) or 1)
    if factor > 1.0:
        return math.copysign(factor, value)
    return value * (1.0 + factor) if value else factor


def leaves(held: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the places of all numbers in what JSON holds."""
    if isinstance(held, dict):
        for name, entry in held.items():
            yield from leaves(entry, (*path, name))
    elif isinstance(held, list):
        for place, entry in enumerate(held):
            yield from leaves(entry, (*path, place))
    elif isinstance(held, bool | int | float):
        yield path


_ARRAYS = ('position', 'velocity', 'effort')


def places(message: Message) -> list[tuple[Any, ...]]:
    """Return the places of all numbers in a message."""
    held = STORE.deserialize_cdr(message.content, message.schema)
    kind = message.schema.rpartition('/')[2]
    if kind == 'JointState':
        found: list[tuple[Any, ...]] = [('stamp', 'sec'), ('stamp', 'nanosec')]
        if held.header.frame_id:
            found.append(('frame',))
        return found + [(a, i) for a in _ARRAYS for i in range(len(getattr(held, a)))]
    if kind == 'String':
        return list(leaves(json.loads(held.data)))
    found = [('stamp', 'sec'), ('stamp', 'nanosec')]
    for group in ('new_parameters', 'changed_parameters'):
        for number, parameter in enumerate(getattr(held, group)):
            value = parameter.value
            if value.type in (1, 2, 3):
                field = {1: 'bool_value', 2: 'integer_value', 3: 'double_value'}[value.type]
                found.append((group, number, parameter.name, field))
            elif value.type == 8:
                found += [
                    (group, number, parameter.name, i)
                    for i in range(len(value.double_array_value))
                ]
    return found


def _stamped(time: Any, field: str, factor: float) -> None:
    value = int(getattr(time, field))
    most = 2**31 - 1 if field == 'sec' else 10**9 - 1
    new = most if factor > 1.0 else min(most, altered(value, factor))
    setattr(time, field, new if new != value else value - 1)


def alter(message: Message, place: tuple[Any, ...], factor: float) -> Message:
    """Return a message with one number altered."""
    held = STORE.deserialize_cdr(message.content, message.schema)
    first = place[0]
    if message.schema.endswith('/String'):
        text = json.loads(held.data)
        at = text
        for step in place[:-1]:
            at = at[step]
        at[place[-1]] = altered(at[place[-1]], factor)
        held.data = json.dumps(text)
    elif first == 'stamp':
        stamp = held.header.stamp if hasattr(held, 'header') else held.stamp
        _stamped(stamp, place[1], factor)
    elif first == 'frame':
        other = {'stop_1': 'stop_2', 'stop_2': 'stop_1', 'command': 'crossing'}
        held.header.frame_id = other.get(held.header.frame_id, 'command')
    elif first in _ARRAYS:
        numbers = getattr(held, first).copy()
        numbers[place[1]] = altered(float(numbers[place[1]]), factor)
        setattr(held, first, numbers)
    else:
        value = getattr(held, first)[place[1]].value
        if isinstance(place[3], str):
            setattr(value, place[3], altered(getattr(value, place[3]), factor))
        else:
            array = value.double_array_value.copy()
            array[place[3]] = altered(float(array[place[3]]), factor)
            value.double_array_value = array
    content = bytes(STORE.serialize_cdr(held, message.schema))
    return replace(message, content=content)


def status(command: Callable[[list[str]], int], bag: Path) -> int:
    """Return the exit status of a command on a bag."""
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            return command([str(bag), '--quiet'])
        except Exception:
            return 0


@contextlib.contextmanager
def theory_once() -> Iterator[None]:
    """Compare the stretches of one run with theory when they first occur only."""
    compare, known = comparison.compare_stretch, {}

    def compared(stretch: Any) -> Any:
        if stretch.number not in known:
            known[stretch.number] = compare(stretch)
        return known[stretch.number]

    comparison.compare_stretch = compared
    try:
        yield
    finally:
        comparison.compare_stretch = compare


def one_place(messages: list[Message], draw: random.Random) -> tuple[int, tuple[Any, ...]]:
    """Draw a topic, one of its messages, and one of its numbers."""
    topic = draw.choice(sorted({m.topic for m in messages} - UNCHECKED))
    index = draw.choice([i for i, m in enumerate(messages) if m.topic == topic])
    return index, draw.choice(places(messages[index]))


COMMANDS = {'compare_run': compare_run.main, 'replay_run': replay_run.main}


def unnoticed_by(bag: Path) -> list[str]:
    """Return the commands that end with the status 0 on a bag."""
    return [name for name, command in COMMANDS.items() if status(command, bag) == 0]


def altered_bags(name: str, rate: int, factor: float, count: int) -> list[str]:
    """Alter so many numbers of one run, one at a time; return what went unnoticed."""
    draw = random.Random(f'{SEED} {name} {rate} {factor}')
    missed = []
    with tempfile.TemporaryDirectory() as directory, theory_once():
        source = record(KINDS[name], Path(directory, 'run'), rate)
        messages = read(source)
        bag = Path(directory, 'altered')
        write(bag, source, messages)
        if unnoticed_by(bag) != list(COMMANDS):
            raise RuntimeError('a command refuses the bag written again')
        for _ in range(count):
            index, place = one_place(messages, draw)
            new = alter(messages[index], place, factor)
            write(bag, source, [*messages[:index], new, *messages[index + 1 :]])
            where = f'{messages[index].topic} {".".join(map(str, place))}'
            missed += [f'{command}: {where}' for command in unnoticed_by(bag)]
    return missed


# Rearranged bags


def numbered(messages: list[Message]) -> list[Message]:
    """Return messages with their numbers in order."""
    counts: Counter[str] = Counter()
    found = []
    for message in messages:
        counts[message.topic] += 1
        found.append(replace(message, sequence=counts[message.topic] - 1))
    return found


def _at(topic: str, messages: list[Message], place: float = 0.5) -> int:
    """Return the index of the message of a topic at a part of the bag."""
    held = [i for i, message in enumerate(messages) if message.topic == topic]
    return held[min(int(place * len(held)), len(held) - 1)]


def _put(messages: list[Message], index: int, *others: Message) -> list[Message]:
    return [*messages[:index], *others, *messages[index + 1 :]]


def rearranged(topic: str, messages: list[Message]) -> Iterator[tuple[str, list[Message]]]:
    """Yield what is wrong with messages of a topic, and the messages of the bag."""
    i, j = _at(topic, messages), _at(topic, messages, 0.6)
    one, other = messages[i], messages[j]
    yield 'missing', _put(messages, i)
    yield 'twice', _put(messages, i, one, one)
    yield 'twice, at the end', [*messages, one]
    yield 'all missing', [m for m in messages if m.topic != topic]
    yield 'without content', _put(messages, i, replace(one, content=b''))
    for name in ('/joint_states', '/impacts'):
        if name != topic:
            yield f'on {name}', _put(messages, i, replace(one, topic=name))
    if one.content != other.content:
        alike = replace(one, content=other.content)
        yield 'with the content of another', _put(messages, i, alike)


def whole_bags(messages: list[Message]) -> Iterator[tuple[str, list[Message]]]:
    """Yield what is wrong with a bag as a whole, and its messages."""
    third = len(messages) // 3
    span = messages[-1].stamp_ns - messages[0].stamp_ns + 10**7

    def moved(ns: int) -> list[Message]:
        return [
            replace(m, stamp_ns=m.stamp_ns + ns, publish_ns=m.publish_ns + ns) for m in messages
        ]

    yield 'twice', messages + messages
    yield 'twice, one after the other', messages + moved(span)
    yield 'without its middle', messages[:third] + messages[2 * third :]
    yield 'without its end', messages[:third]
    for part in range(_CHUNKS):
        begin, end = (len(messages) * k // _CHUNKS for k in (part, part + 1))
        yield f'without chunk {part} of {_CHUNKS}', messages[:begin] + messages[end:]


def rearranged_bags(name: str, rate: int) -> tuple[int, list[str]]:
    """Rearrange one run in all ways; return how many, and what went unnoticed."""
    unnoticed = []
    with tempfile.TemporaryDirectory() as directory, theory_once():
        source = record(KINDS[name], Path(directory, 'run'), rate)
        messages = read(source)
        cases = [
            (f'{topic} {what}', numbered(held))
            for topic in sorted({m.topic for m in messages} - UNCHECKED)
            for what, held in rearranged(topic, messages)
        ]
        cases += [(what, numbered(held)) for what, held in whole_bags(messages)]
        bag = Path(directory, 'altered')
        for what, held in cases:
            write(bag, source, held)
            unnoticed += [f'{command}: {what}' for command in unnoticed_by(bag)]
    return len(cases), unnoticed


# Untouched bags


def recorded_otherwise(messages: list[Message]) -> Iterator[tuple[str, list[Message]]]:
    """Yield how else the same messages may be recorded, and the messages of the bag."""

    def at(stamps: Iterable[int]) -> list[Message]:
        pairs = zip(messages, stamps, strict=True)
        return [replace(m, stamp_ns=stamp, publish_ns=stamp) for m, stamp in pairs]

    yield 'a second later', at(m.stamp_ns + 10**9 for m in messages)
    yield 'at one instant', at(messages[0].stamp_ns for m in messages)
    for topic in sorted({m.topic for m in messages}):
        late = 3 * 10**8
        later = at(m.stamp_ns + (late if m.topic == topic else 0) for m in messages)
        yield f'{topic} later', sorted(later, key=lambda m: m.stamp_ns)
        i, j = _at(topic, messages), _at(topic, messages, 0.6)
        one, other = messages[i], messages[j]
        exchanged = _put(messages, i, replace(one, content=other.content))
        yield f'{topic} exchanged', _put(exchanged, j, replace(other, content=one.content))


def bags_recorded_otherwise(name: str, rate: int) -> list[str]:
    """Record one run in other ways; return the false alarms."""
    alarms = []
    with tempfile.TemporaryDirectory() as directory, theory_once():
        source = record(KINDS[name], Path(directory, 'run'), rate)
        bag = Path(directory, 'other')
        for what, held in recorded_otherwise(read(source)):
            write(bag, source, numbered(held))
            alarms += [f'{c}: {what}' for c, command in COMMANDS.items() if status(command, bag)]
    return alarms


def random_settings(kind: str, draw: random.Random) -> tuple[str, ...]:
    """Return a rig like that of a kind."""
    common = (
        f'gap={draw.uniform(0.015, 0.04):.6g}',
        f'friction={draw.choice([0.0, 0.02, 0.1]):g}',
        f'angle={draw.choice([0.0, 0.0, draw.uniform(-0.3, 0.3)]):.6g}',
        f'restitution_1={draw.uniform(0.3, 0.9):.6g}',
        f'force_amplitudes=[{draw.uniform(0.5, 5.0):.6g}]',
    )
    if kind == 'controlled':
        return (
            *common,
            f'gap_control={draw.choice(["timed", "amplitude"])}',
            f'gap_control_stops={draw.choice(["symmetric", "independent"])}',
            f'actuator_speed={draw.choice([0.0, 1.0, 3.0]):g}',
            f'gap_control_noise_position={draw.choice([0.0, 1e-5]):g}',
        )
    if kind == 'stepped sine':
        return (*common, f'sweep_step={draw.uniform(0.1, 1.0):.4g}')
    return common


def untouched_bag(number: int) -> tuple[str, list[int]]:
    """Record a random rig; return its kind and the exit status of both commands."""
    draw = random.Random(f'{SEED} untouched {number}')
    name = sorted(KINDS)[number % len(KINDS)]
    with tempfile.TemporaryDirectory() as directory:
        rate = draw.choice(list(RATES))
        bag = record(KINDS[name], Path(directory, 'run'), rate, random_settings(name, draw))
        return name, [status(command, bag) for command in COMMANDS.values()]


# Soaks


def random_change(draw: random.Random) -> list[str]:
    """Return what somebody at the knobs might do at one instant."""
    return draw.choice(
        [
            lambda: [f'gap={draw.uniform(0.008, 0.05):.6g}'],
            lambda: [f'gap={draw.uniform(0.008, 0.05):.6g}'],
            lambda: [f'angle={draw.uniform(-0.5, 0.5):.6g}'],
            lambda: [f'friction={draw.choice([0.0, 0.02, 0.2]):g}'],
            lambda: [f'force_frequencies=[{draw.uniform(20.0, 45.0):.6g}]'],
            lambda: [f'force_amplitudes=[{draw.uniform(0.0, 6.0):.6g}]'],
            lambda: [f'restitution_{draw.choice([1, 2])}={draw.uniform(0.2, 0.95):.6g}'],
            lambda: [f'stiffness={draw.uniform(1500.0, 2500.0):.6g}'],
            lambda: [f'primary_mass={draw.uniform(1.0, 3.0):.6g}'],
            lambda: [f'damper_mass={draw.uniform(0.05, 0.3):.6g}'],
            lambda: [f'damping={draw.uniform(0.2, 5.0):.6g}'],
            lambda: [f'gravity={draw.choice([0.0, 1.62, 9.81]):g}'],
            lambda: [f'air_force={draw.choice([0.0, 0.0, 0.2]):g}'],
            lambda: [f'one_sided={draw.choice(["true", "false", "false"])}'],
            lambda: [f'gap_control={draw.choice(["off", "amplitude", "timed"])}'],
            lambda: [f'gap_control={draw.choice(["off", "amplitude", "timed"])}'],
            lambda: ['gap_control=off', f'gap={draw.uniform(0.008, 0.05):.6g}'],
            lambda: [f'multisine_level={draw.choice([0.0, 0.0, 1.0]):g}'],
            lambda: [f'sweep_mode={draw.choice(["off", "off", "up", "up_down"])}'],
            lambda: [f'actuator_speed={draw.choice([0.0, 0.5, 3.0]):g}'],
        ]
    )()


def soak(number: int, stretches: int) -> tuple[int, int, int]:
    """Record a run with random changes; return stretches, doubted ones and faults."""
    draw = random.Random(f'{SEED} soak {number}')
    changes, time = [], 0.0
    for _ in range(stretches - 1):
        time += draw.choice([0.05, 0.5, 2.0, 8.0, 16.0]) * draw.uniform(0.5, 1.5)
        changes += [f'{time:.6f}:{change}' for change in random_change(draw)]
    with tempfile.TemporaryDirectory() as directory:
        bag = simulated(
            Path(directory, 'run'),
            BENCH,
            draw.choice([50, 200]),
            time + 10.0,
            ('multisine_lines=8',),
            tuple(changes),
        )
        out = Path(directory, 'result.json')
        compare_run.main([str(bag), '--quiet', '--json', str(out)])
        result = json.loads(out.read_text())
        doubted = sum('differs' in (s['verdict'], s['log']) for s in result['stretches'])
        return len(result['stretches']), doubted, len(result['faults'])


def print_altered(pool: ProcessPoolExecutor, options: argparse.Namespace) -> None:
    """Alter numbers, and print how many went unnoticed."""
    runs = [(name, rate, f) for name in KINDS for rate in RATES for f in FACTORS]
    each = math.ceil(options.places / len(RATES))
    results = pool.map(altered_bags, *zip(*runs, strict=True), [each] * len(runs))
    total: Counter[str] = Counter()
    fields: Counter[str] = Counter()
    print(f'altered: {each} numbers of each run, one at a time; unnoticed by')
    print(f'{"run":<14}{"rate [Hz]":>10}{"altered":>10}' + ''.join(f'{c:>13}' for c in COMMANDS))
    for (name, rate, factor), places_missed in zip(runs, results, strict=True):
        how = 'by 1e-3' if factor < 1.0 else 'to 1e300'
        missed = Counter(place.partition(':')[0] for place in places_missed)
        total += missed
        fields.update(places_missed)
        numbers = ''.join(f'{missed[command]:>13}' for command in COMMANDS)
        print(f'{name:<14}{rate:>10}{how:>10}{numbers}', flush=True)
    print(f'in all {each * len(runs)}: ' + ', '.join(f'{c} {total[c]}' for c in COMMANDS))
    for field, number in fields.most_common(40):
        print(f'  {number:4} {field}')


def print_rearranged(pool: ProcessPoolExecutor) -> None:
    """Rearrange bags, and print what went unnoticed."""
    for name, (count, unnoticed) in zip(
        KINDS, pool.map(rearranged_bags, KINDS, [50] * len(KINDS)), strict=True
    ):
        print(f'rearranged: {name}, {count} ways; unnoticed {len(unnoticed)}', flush=True)
        for what in unnoticed:
            print(f'  {what}')


def print_untouched(pool: ProcessPoolExecutor, options: argparse.Namespace) -> None:
    """Print the false alarms."""
    found = pool.map(bags_recorded_otherwise, KINDS, [50] * len(KINDS))
    for name, wrong in zip(KINDS, found, strict=True):
        print(f'recorded otherwise: {name}; false alarms {len(wrong)}', flush=True)
        for what in wrong:
            print(f'  {what}')
    alarms: Counter[str] = Counter()
    for name, found in pool.map(untouched_bag, range(options.bags)):
        for command, code in zip(COMMANDS, found, strict=True):
            alarms[command] += code != 0
            if code:
                print(f'  false alarm: {name}, {command} {code}')
    counts = ', '.join(f'{alarms[command]} of {command}' for command in COMMANDS)
    print(f'untouched: {options.bags} bags; false alarms: {counts}')


def print_soaks(pool: ProcessPoolExecutor, options: argparse.Namespace) -> None:
    """Print how many stretches of long bags are doubted."""
    each = min(options.stretches, 100)
    soaks, sums = 0, [0, 0, 0]
    # Changes at the same instant begin only one stretch.
    while sums[0] < options.stretches:
        numbers = range(soaks, soaks + options.workers)
        for found in pool.map(soak, numbers, [each] * len(numbers)):
            soaks += 1
            sums = [a + b for a, b in zip(sums, found, strict=True)]
            print(f'  {sums[0]} stretches, {sums[1]} doubted, {sums[2]} faults', file=sys.stderr)
    print(f'soaks: {sums[0]} stretches in {soaks} bags; doubted {sums[1]}, faults {sums[2]}')


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument(
        '--places',
        type=int,
        default=200,
        help='alterations of each kind and size, spread over the rates [200]',
    )
    parser.add_argument('--bags', type=int, default=200, help='untouched bags [200]')
    parser.add_argument('--stretches', type=int, default=10_000, help='of the soaks [10000]')
    parser.add_argument('--workers', type=int, default=1)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.workers, get_context('spawn')) as pool:
        if options.places:
            print_altered(pool, options)
            print_rearranged(pool)
        if options.bags:
            print_untouched(pool, options)
        if options.stretches:
            print_soaks(pool, options)


if __name__ == '__main__':
    main()
