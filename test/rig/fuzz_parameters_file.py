"""
Read parameters files that nobody would write: no other error than one line, and soon.

In the suite some hundred, from a fixed seed. By hand, for as long as one likes:

    PYTHONPATH=.:test python -m rig.fuzz_parameters_file --seconds 600 --seed 7
"""

import argparse
import random
import string
import sys
import tempfile
import time
from pathlib import Path

from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    ParameterError,
    ParametersFileError,
    load_parameters,
)

NAMES = [*PARAMETER_SPECS, *INITIAL_SPECS, 'state_rate', 'gap_control', 'record']
#: What values are made of; one in a few is what a parameter can have.
VALUES = (
    *('1', '0.5', '1e-3', '[1.0]', '[1, 0.5]', 'true', 'off', '"off"', '-1', '37'),
    *('.nan', '-.inf', '1e999', '0x1F', '0o17', '1:30:15', '2026-13-45', '1_000', '~', ''),
    *('!!bool abc', '!!int x', '!!float []', '!!null {a: b}', '!!binary =', '!!set {a, b}'),
    *('!!timestamp x', '!!omap [a]', '!!python/object:os.system x', '!local x', '! y'),
    *('&a 1', '*a', '&a [*a]', '<<: {gap: 1}', '"\\x1b[2J"', "'\\n'", '|\n', '>-\n  text'),
    *(
        '[[[[1]]]]',
        '{a: {b: c}}',
        '[',
        '}',
        '"',
        "'",
        '%TAG',
        '--- 1',
        '...',
        '? [a, b]',
        '@',
        '`',
    ),
    *('9' * 5000, '[' + '1,' * 2000 + ']', '"' + 'x' * 20000 + '"', '\t1', '\ufeff', '\u2028'),
    *('é', '\x00', '\x7f', '\ud7ff', '😀', '# comment', '1 # comment', 'yes', 'No', '1.'),
)
PIECES = (*VALUES, *NAMES, ':', ': ', '\n', '\n    ', '-', ' - ', ',', '/**', 'ros__parameters')


def bomb(numbers: random.Random) -> str:
    """Return a text that is far larger than it looks."""
    count = numbers.randrange(2, 40)
    kind = numbers.randrange(6)
    if kind == 0:
        lines = ['a0: &a0 [1]']
        lines += [f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]' for k in range(1, count)]
        return '\n'.join(lines)
    if kind == 1:
        return '&a {/**: *a}'
    if kind == 2:
        return '/**: ' + '[' * 10 ** numbers.randrange(1, 6)
    if kind == 3:
        return '/**:\n  ros__parameters:\n' + '# no\n' * 10 ** numbers.randrange(1, 6)
    if kind == 4:
        return '/**:\n  ros__parameters:\n' + ''.join(
            f'    p{k}: {k}\n' for k in range(10 ** numbers.randrange(1, 5))
        )
    return '\n'.join(f'{"  " * k}k:' for k in range(10 ** numbers.randrange(1, 3)))


def plausible(numbers: random.Random) -> str:
    """Return a file as it should be, but for some values."""
    head = numbers.choice(['/**', 'sim_node', '/rig1/sim_node', '/*', 'other', '"/**"'])
    names = numbers.choices(NAMES, k=numbers.randrange(1, 8))
    lines = [f'    {name}: {numbers.choice(VALUES)}' for name in names]
    return '\n'.join([f'{head}:', '  ros__parameters:', *lines, ''])


def cut(text: str, numbers: random.Random) -> str:
    """Return a text with a few pieces put in, taken out or put elsewhere."""
    for _ in range(numbers.randrange(1, 6)):
        begin = numbers.randrange(len(text) + 1)
        end = min(len(text), begin + numbers.randrange(12))
        piece = numbers.choice([numbers.choice(PIECES), numbers.choice(string.printable), ''])
        text = text[:begin] + piece + text[end:]
    return text


def made(numbers: random.Random) -> bytes:
    """Return the bytes of a file."""
    kind = numbers.random()
    if kind < 0.1:
        return bomb(numbers).encode()
    if kind < 0.2:
        return numbers.randbytes(numbers.randrange(400))
    if kind < 0.4:
        pieces = numbers.choices(PIECES, k=numbers.randrange(30))
        return ''.join(pieces).encode('utf-8', 'surrogatepass')
    text = plausible(numbers)
    return (text if kind < 0.6 else cut(text, numbers)).encode('utf-8', 'surrogatepass')


def read(path: Path) -> str:
    """Return what is said of a file, or an empty text if it is taken; other errors are faults."""
    try:
        load_parameters(path)
    except (ParametersFileError, ParameterError) as error:
        return str(error)
    return ''


def check(said: str, path: Path) -> None:
    """Check that a message is one line, not long, that names the file and the remedy."""
    assert said.isprintable(), said
    assert len(said) < 1000 + len(str(path)), said
    assert str(path) in said, said
    assert ':' in said.removeprefix(str(path)), said


def run(seed: int, count: int | None = None, seconds: float | None = None) -> dict[str, int]:
    """Read files until so many are read or the time is over; return how many were taken."""
    numbers = random.Random(seed)
    result = {'read': 0, 'taken': 0}
    end = time.monotonic() + (seconds or 0.0)
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / 'rig.yaml'
        while result['read'] < count if count is not None else time.monotonic() < end:
            path.write_bytes(made(numbers))
            try:
                if said := read(path):
                    check(said, path)
                else:
                    result['taken'] += 1
            except BaseException:
                print(f'file {result["read"]} of seed {seed}:', path.read_bytes()[:2000])
                raise
            result['read'] += 1
    return result


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--seed', type=int, default=0)
    given = parser.parse_args()
    print(run(given.seed, seconds=given.seconds))
    sys.exit(0)
