"""
The commands as console scripts, and how Ctrl-C ends them at any time.

A command imports for up to a second before it can handle a signal. An exception would then come
up anywhere in the import system, as a traceback or as whatever a library makes of it; so until the
command runs, and again once it has run, a signal ends the process at once. This module must not
import anything that takes time.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module

__all__ = [
    'begin',
    'begin_module',
    'compare_run',
    'recover_run',
    'replay_run',
    'rig_page',
    'run',
    'sim_node',
    'simulate_rig',
    'solve_periodic',
    'sweep_rig',
]

EXIT_INTERRUPTED, EXIT_TERMINATED = 130, 143
#: After so long, s, a signal that compiled code has kept from being handled ends the process.
_PATIENCE = 5.0

#: Errors of a standard output that is full or closed; they name no file.
_UNWRITTEN = errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EPIPE

_PACKAGE = 'impact_damper_ros'
_NODE = 'sim_node'


def begin(command: str) -> None:
    """
    Let signals end the process at once and without a traceback, until `run`.

    Ctrl-C says that the command is interrupted, with exit code 130. The node ends with 0 on
    SIGINT, SIGTERM and SIGHUP, as when it runs. A Ctrl-C that the process was started to ignore
    stays ignored.
    """
    _open_closed_streams()
    if command == _NODE:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            # nohup has SIGHUP ignored.
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, lambda *_: os._exit(0))
    elif signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, partial(_end, command))


def _open_closed_streams() -> None:
    """
    Put something in the place of standard streams that are closed.

    The first file of a recording would take the place otherwise, and with it what is meant for
    the terminal. What is written to stdout fails; messages are lost.
    """
    for number, mode in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    if sys.stdout is None:
        sys.stdout = open(1, 'w', encoding='utf-8', closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, 'w', encoding='utf-8', closefd=False)  # noqa: SIM115


def begin_module() -> None:
    """Call `begin` if ``python -m`` is about to run one of the commands."""
    named = [word.split('.') for word in sys.orig_argv if word.startswith(f'{_PACKAGE}.')]
    if named and named[0][1:-1] in (['cli'], ['node']):
        begin(named[0][-1])


def run(command: str, main: Callable[[], int]) -> int:
    """
    Run a command whose modules are imported.

    SIGTERM, as from ``timeout`` or a service manager, ends it as Ctrl-C does, with exit code 143.
    """
    # The node takes the signals itself, for good.
    code = (_called if command == _NODE else _interruptible)(command, main)
    # What is written must not be lost to a late Ctrl-C; a closed pipe is told again at exit.
    try:
        sys.stdout.flush()
    except OSError as error:
        if not code and not isinstance(error, BrokenPipeError):
            _say(command, f'cannot write output: {error.strerror}')
            code = 1
        if code:
            # Not to be said once more at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return code


def _called(command: str, main: Callable[[], int]) -> int:
    """Call the function of a command; return the exit code also where it prints and exits."""
    try:
        return main()
    except SystemExit as ended:
        if not isinstance(ended.code, int):
            raise
        return ended.code
    except OSError as error:
        if error.filename is not None or error.errno not in _UNWRITTEN:
            raise
        if not isinstance(error, BrokenPipeError):
            _say(command, f'cannot write output: {error.strerror}')
        return 1


def _interruptible(command: str, main: Callable[[], int]) -> int:
    """Call the function of a command, which a signal ends in its own way."""
    received = 0

    def interrupt(number: int, _: object) -> None:
        nonlocal received
        received = number
        raise KeyboardInterrupt

    before = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, interrupt)
    try:
        with _impatient(command, lambda: received):
            code = _called(command, main)
    except (Exception, KeyboardInterrupt):
        if not received:
            raise
        begin(command)
        _say(command, 'interrupted')
        code = EXIT_INTERRUPTED
    finally:
        begin(command)
        if signal.SIGTERM in before:
            signal.signal(signal.SIGTERM, before[signal.SIGTERM] or signal.SIG_DFL)
    if received == signal.SIGTERM and code == EXIT_INTERRUPTED:
        code = EXIT_TERMINATED
    return code


@contextlib.contextmanager
def _impatient(command: str, handled: Callable[[], int]) -> Iterator[None]:
    """End the process where a signal is not handled: Python does that between calls only."""
    reading, writing = os.pipe()

    def watch() -> None:
        while number := os.read(reading, 1)[0]:
            if number in (signal.SIGINT, signal.SIGTERM):
                time.sleep(_PATIENCE)
                if not handled():
                    _end(command, number)
        os.close(reading)

    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=watch, name='signals', daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.write(writing, b'\0')
        os.close(writing)


def _say(command: str, message: str) -> None:
    # Past sys.stderr, which a signal may have come in the midst of
    with contextlib.suppress(OSError):
        os.write(2, f'{command}: {message}\n'.encode())


def _end(command: str, number: int, *_: object) -> None:
    _say(command, 'interrupted')
    os._exit(EXIT_TERMINATED if number == signal.SIGTERM else EXIT_INTERRUPTED)


def _command(name: str, package: str = 'cli') -> int:
    """Import a command and run it."""
    begin(name)
    return run(name, import_module(f'{_PACKAGE}.{package}.{name}').main)


compare_run = partial(_command, 'compare_run')
recover_run = partial(_command, 'recover_run')
replay_run = partial(_command, 'replay_run')
rig_page = partial(_command, 'rig_page')
sim_node = partial(_command, _NODE, 'node')
simulate_rig = partial(_command, 'simulate_rig')
solve_periodic = partial(_command, 'solve_periodic')
sweep_rig = partial(_command, 'sweep_rig')
