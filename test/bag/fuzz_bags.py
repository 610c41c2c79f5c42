"""
A seeded fuzz of bags: no traceback, no hang, bounded memory, only the documented exit codes.

    python test/bag/fuzz_bags.py --seconds 600 --seed 7

The mutations know the format: records, lengths, indexes, compression, YAML, JSON and CDR. Each
command runs in a process of its own with limits to its memory and time. A case that fails is
kept, with what it was made by.
"""
# ruff: noqa: E402

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

import lz4.frame
import yaml
import zstandard
from bag import ros2_bags
from bag.recorded_rig import RecordedRig
from bag.test_bag_check import of_records, records, write
from mcap.opcode import Opcode

from impact_damper_ros.cli import compare_run, recover_run, replay_run

#: Exit codes that the help of each command names.
COMMANDS = {
    'compare_run': (compare_run.main, {0, 1, 2, 3}),
    'replay_run': (replay_run.main, {0, 1, 2, 3}),
    'recover_run': (recover_run.main, {0, 1, 2}),
}
#: Beyond what the process has at its start, bytes; and s.
MEMORY = 1536 * 1024**2
SECONDS = 60
NUMBERS = (0, 1, 2, 255, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
VALUES = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 10**400, 10**4200, -0.0, 1e-320, 1e308, 'x', '',
    '1.0', 'NaN', '\x1b[31mred', '\u202e', [], [1], {}, {'a': 1}, [[[[]]]], 'A' * 5000,
)  # fmt: skip
TEXTS = (
    '[' * 50_000, '!!timestamp x', '&a [*a]', '{' * 20_000, 'a: ' + '9' * 5000, '\x1b]0;x\x07',
    '!!python/object:os.system x', '- ' * 3000, '- !!binary "?"', '', '0', '- 1\n- x', '[]',
    '? ' * 1000, 'a: &b [1]\nc: *b', '!!int x', '!!float x', '"\\ud800"', '\t', '---\n---\n',
)  # fmt: skip


# What is mutated, by kind


def flip(data: bytes, rng: random.Random) -> bytes:
    """Change bytes, or cut, double or insert some."""
    held = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(held) + 1)
        kind = rng.randrange(5)
        if kind == 0 and at < len(held):
            held[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and at < len(held):
            held[at] = rng.choice((0, 255, 27, 128, rng.randrange(256)))
        elif kind == 2:
            del held[at : at + rng.choice((1, 4, 8, 100))]
        elif kind == 3:
            held[at:at] = held[at : at + rng.choice((1, 8, 60))]
        else:
            held[at : at + 8] = struct.pack('<Q', rng.choice(NUMBERS))
    return bytes(held)


def value(held: object, rng: random.Random, depth: int = 0) -> object:
    """Replace a value somewhere in JSON or YAML, or remove or rename it."""
    if isinstance(held, dict) and held and (depth == 0 or rng.random() < 0.85):
        held = dict(held)
        key = rng.choice(list(held))
        kind = rng.randrange(12)
        if kind == 0:
            del held[key]
        elif kind == 1:
            held[rng.choice(('', 'x', '\x1b[2J'))] = held.pop(key)
        else:
            held[key] = value(held[key], rng, depth + 1)
        return held
    if isinstance(held, list) and held and rng.random() < 0.7:
        held = list(held)
        at = rng.randrange(len(held))
        held[at] = value(held[at], rng, depth + 1)
        return held
    if isinstance(held, float) and rng.random() < 0.5:
        return held * rng.choice((-1.0, 1e-12, 1e12, 1.0 + 1e-9))
    return rng.choice(VALUES)


def altered(
    text: str, load: Callable[[str], object], dump: Callable[..., str], rng: random.Random
) -> str:
    """Mutate the values in a text of JSON or YAML; numbers may have any length."""
    digits = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)
    try:
        held = load(text)
        for _ in range(rng.choice((1, 1, 3))):
            held = value(held, rng)
        return dump(held)
    except (ValueError, RecursionError, yaml.YAMLError):
        return text
    finally:
        sys.set_int_max_str_digits(digits)


def json_text(text: str, rng: random.Random) -> str:
    """Mutate the JSON of a snapshot."""
    kind = rng.randrange(10)
    if kind == 0:
        return rng.choice(('[' * 100_000, '{"a":' * 20_000, '', 'null', '1', '"x"', '\x1b[31m'))
    if kind == 1:
        return text.replace(': 1', f': {rng.choice(("Infinity", "NaN", "1e999", "9" * 4000))}', 1)
    return altered(text, json.loads, json.dumps, rng)


def yaml_text(text: str, rng: random.Random) -> str:
    """Mutate the YAML of the metadata."""
    return (
        rng.choice(TEXTS)
        if rng.random() < 0.3
        else altered(text, yaml.safe_load, yaml.safe_dump, rng)
    )


def message(topic: str, content: bytes, rng: random.Random) -> bytes:
    """Mutate a message."""
    if topic.endswith('snapshot') and rng.random() < 0.8:
        text = json_text(content[8:-1].decode(errors='replace'), rng).encode(
            'utf-8', 'surrogatepass'
        )
        return b'\0\1\0\0' + struct.pack('<I', len(text) + 1) + text + b'\0'
    held = bytearray(content)
    if rng.random() < 0.5 and len(held) > 12:
        at = 4 + 4 * rng.randrange((len(held) - 4) // 4)
        layout = rng.choice(('<I', '<d'))
        if at + struct.calcsize(layout) <= len(held):
            number = rng.choice(NUMBERS[:8])
            if layout == '<d':
                number = rng.choice((float('nan'), float('inf'), -1e300, 1e300, 0.0, 5e-324))
            struct.pack_into(layout, held, at, number)
        return bytes(held)
    return flip(bytes(held), rng)


def chunk(content: bytes, rng: random.Random) -> bytes:
    """Mutate a chunk: what is in it, how it is compressed, or what it declares."""
    start, end, size, crc, length = struct.unpack_from('<QQQII', content)
    inner = zstandard.ZstdDecompressor().decompressobj().decompress(content[36 + length + 4 :])
    kind = rng.randrange(6)
    name = b'zstd'
    if kind == 0:
        inner = bytes(rng.choice((10**6, 3 * 10**8)))
        size = rng.choice((size, len(inner), 2**63))
    elif kind == 1:
        size = rng.choice(NUMBERS)
    elif kind == 2:
        start, end = rng.choice(NUMBERS), rng.choice(NUMBERS)
    else:
        inner = flip(inner, rng)
        size, crc = len(inner), 0
    if rng.random() < 0.3:
        name = rng.choice((b'lz4', b'', b'\x1b[31m', b'zstd'))
    packed = {b'lz4': lz4.frame.compress, b'': bytes}.get(
        name, zstandard.ZstdCompressor().compress
    )(inner)
    return (
        struct.pack('<QQQII', start, end, size, crc, len(name))
        + name
        + struct.pack('<Q', len(packed))
        + packed
    )


def file_bytes(content: bytes, rng: random.Random) -> bytes:
    """Mutate an MCAP file: by records, or wherever."""
    kind = rng.randrange(8)
    if kind == 0:
        return flip(content, rng)
    if kind == 1:
        return content[: rng.randrange(len(content))]
    found = records(content)
    for _ in range(rng.choice((1, 1, 1, 3))):
        at = rng.randrange(len(found))
        if kind in (2, 3):
            # The few records count as much as the many.
            code = rng.choice(sorted({code for code, _ in found}))
            at = rng.choice([i for i, (other, _) in enumerate(found) if other == code])
        opcode, held = found[at]
        if kind == 4:
            del found[at]
        elif kind == 5:
            found.insert(rng.randrange(len(found)), found[at])
        elif opcode == Opcode.CHUNK and rng.random() < 0.8:
            found[at] = opcode, chunk(held, rng)
        elif opcode == Opcode.METADATA:
            text = rng.choice(TEXTS).encode('utf-8', 'surrogatepass')
            key = b'serialized_metadata'
            pair = struct.pack('<I', len(key)) + key + struct.pack('<I', len(text)) + text
            new = b'\7\0\0\0rosbag2' + struct.pack('<I', len(pair)) + pair
            found[at] = opcode, new
        else:
            found[at] = rng.choice((opcode, rng.randrange(256))), flip(held, rng)
        if not found:
            break
    return of_records(found)


# The bags


class Fuzz:
    """Makes bags from sound ones; the seed and the number of a case give the case."""

    def __init__(self, directory: Path, seed: int) -> None:
        self.directory, self.seed = directory, seed
        rig = RecordedRig(rate=50.0).start().run(20).run(20, ('change', {'gap': 0.007}))
        self.messages = rig.run(20, ('reset', None)).messages
        self.own = write(directory / 'own', self.messages, every=80)
        self.database = directory / 'database'
        ros2_bags.write_database(self.database, ros2_bags.joined(self.messages, 0))

    def case(self, number: int) -> tuple[Path, str]:
        """Write the bag of a number; return it, and what kind it is."""
        rng = random.Random(f'{self.seed} {number}')
        bag = self.directory / f'case_{number}'
        kind = rng.choice((*('file',) * 3, *('message',) * 4, 'listing', 'sqlite'))
        if kind == 'file':
            shutil.copytree(self.own, bag)
            (path,) = bag.glob('*.mcap')
            path.write_bytes(file_bytes(path.read_bytes(), rng))
        elif kind == 'listing':
            shutil.copytree(self.own, bag)
            path = bag / 'metadata.yaml'
            path.write_bytes(yaml_text(path.read_text(), rng).encode('utf-8', 'surrogatepass'))
        elif kind == 'message':
            changed = list(self.messages)
            wanted = rng.choice(
                ('/snapshot', '/snapshot', '/joint_states', '/impacts', '/parameter_events')
            )
            places = [i for i, (topic, *_) in enumerate(changed) if topic == wanted]
            for _ in range(rng.choice((1, 1, 4))):
                at = rng.choice(places[:1] + places)
                topic, content, stamp = changed[at]
                if rng.random() < 0.1:
                    stamp = rng.choice(NUMBERS[:9])
                changed[at] = topic, message(topic, content, rng), stamp
            if rng.random() < 0.5:
                write(bag, changed, every=80)
            else:
                form = rng.choice(({}, {'files': 2}, {'file_zstd': True}, {'message_zstd': True}))
                arrived = sorted(changed, key=lambda held: held[2])
                ros2_bags.write_bag(bag, arrived, **form)
                if form and rng.random() < 0.5:
                    path = rng.choice(sorted(bag.glob('*.mcap*')))
                    path.write_bytes(flip(path.read_bytes(), rng))
        else:
            shutil.copytree(self.database, bag)
            (path,) = bag.glob('*.db3')
            path.write_bytes(flip(path.read_bytes(), rng))
        if rng.random() < 0.1:
            for path in bag.glob('metadata.yaml'):
                path.unlink()
        return bag, kind


# The commands


def _limited(command: str, bag: Path, output: Path, memory: int) -> None:
    """Run a command in this process, with its output in a file."""
    os.setsid()
    with Path('/proc/self/statm').open() as stream:
        used = int(stream.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    descriptor = os.open(output, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    sys.stdout, sys.stderr = os.fdopen(1, 'w', closefd=False), os.fdopen(2, 'w', closefd=False)
    os.environ['TMPDIR'] = str(output.parent)
    tempfile.tempdir = None
    code = COMMANDS[command][0]([str(bag)])
    sys.stdout.flush()
    sys.stderr.flush()
    sys.exit(code)


def output_of(command: str, bag: Path) -> Path:
    """Return the file that gets what a command has to say of a bag."""
    return bag.with_name(f'{bag.name}_{command}.txt')


def run(command: str, bag: Path, memory: int = MEMORY) -> str:
    """Run a command on a bag; return what is wrong, or an empty text."""
    output = output_of(command, bag)
    process = multiprocessing.get_context('fork').Process(
        target=_limited, args=(command, bag, output, memory)
    )
    process.start()
    process.join(2 * SECONDS)
    if process.is_alive():
        process.kill()
        process.join()
        return f'it has not ended after {2 * SECONDS} s'
    code, text = process.exitcode, output.read_bytes()
    if code is None or code < 0:
        return f'it was ended by {signal.Signals(-(code or 0)).name}'
    if b'Traceback' in text:
        return 'a traceback: ' + text.decode(errors='replace').strip().rpartition('\n')[2]
    if code not in COMMANDS[command][1]:
        return f'exit code {code}'
    odd = [c for c in text.decode(errors='replace') if not c.isprintable() and c != '\n']
    if odd:
        return f'{odd[0]!r} reached the terminal'
    if max(map(len, text.splitlines()), default=0) > 5000:
        return 'a line of more than 5,000 bytes'
    return ''


def fuzz(directory: Path, seed: int, numbers: range, seconds: float = 1e9) -> list[str]:
    """Run the commands on so many cases, or for so long; return what went wrong."""
    made, failed, begun = Fuzz(directory, seed), [], time.monotonic()
    kinds: dict[str, int] = {}
    for number in numbers:
        if time.monotonic() - begun > seconds:
            break
        bag, kind = made.case(number)
        kinds[kind] = kinds.get(kind, 0) + 1
        wrong = [f'{command}: {text}' for command in COMMANDS if (text := run(command, bag))]
        failed += [f'case {number} of seed {seed} ({kind}), {text}' for text in wrong]
        for text in wrong:
            print(failed[-1] if len(wrong) == 1 else text, flush=True)
        if not wrong:
            for path in directory.glob(f'case_{number}*'):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    print(f'{sum(kinds.values())} bags ({kinds}), {len(failed)} failures')
    return failed


def main() -> int:
    """Fuzz for a time."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0].strip())
    parser.add_argument('--seconds', type=float, default=60.0, help='how long')
    parser.add_argument('--seed', type=int, default=1, help='of the cases')
    parser.add_argument('--case', type=int, help='only the case of this number')
    arguments = parser.parse_args()
    directory = Path(tempfile.mkdtemp(prefix='fuzz_bags_'))
    first = arguments.case or 0
    numbers = range(first, first + 1) if arguments.case is not None else range(10**9)
    failed = fuzz(directory, arguments.seed, numbers, arguments.seconds)
    if failed:
        print(f'kept in {directory}')
    else:
        shutil.rmtree(directory)
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
