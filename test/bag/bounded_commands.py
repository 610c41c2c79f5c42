"""Commands run on a bag in a process of their own, with limits to its memory and time."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import sys
import tempfile
from pathlib import Path

from impact_damper_ros.cli import compare_run, recover_run, replay_run

#: Exit codes that the help of each command names.
COMMANDS = {
    'compare_run': (compare_run.main, {0, 1, 2, 3}),
    'replay_run': (replay_run.main, {0, 1, 2, 3}),
    'recover_run': (recover_run.main, {0, 1, 2}),
}
#: Beyond what the process has at its start, bytes; and s.
MEMORY = 768 * 1024**2
SECONDS = 60


def _limited(command: str, bag: Path, output: Path, seconds: int) -> None:
    """Run a command in this process, with its output in a file."""
    os.setsid()
    with Path('/proc/self/statm').open() as stream:
        used = int(stream.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
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


def run(command: str, bag: Path, seconds: int = SECONDS) -> str:
    """Run a command on a bag; return what is wrong, or an empty text."""
    output = output_of(command, bag)
    process = multiprocessing.get_context('fork').Process(
        target=_limited, args=(command, bag, output, seconds)
    )
    process.start()
    # Longer on a machine with much else to do: the limit is that of the processor
    process.join(10 * seconds)
    if process.is_alive():
        process.kill()
        process.join()
        return f'it has not ended after {10 * seconds} s'
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
