# SPDX-License-Identifier: Apache-2.0
"""The common parts of all commands: parser, options, progress, messages and exit codes."""

from __future__ import annotations

import argparse
import io
import logging
import os
import re
import signal
import sys
import threading
import time
from argparse import SUPPRESS
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.outputs import check_file, check_new, is_stream, output_fault, write_text
from impact_damper_ros.parameters.base_motion import QUANTITIES, quantity_of
from impact_damper_ros.parameters.plain import json_text
from impact_damper_ros.parameters.quoting import as_message, quote
from impact_damper_ros.parameters.units import UNITS, in_si, si_value, split_number
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD, RunawayError

from .completion import complete
from .needs import Need, check_needs

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from tqdm import tqdm


#: An output could not be written, or the work failed; the input is invalid.
EXIT_FAILED, EXIT_INPUT = 1, 2
MISSING_ROS = 'rclpy is missing: source ROS 2, or install the extra [ros]'


#: Further remedy of a command with ``--most-events`` where a rig has too many events.
ALLOW_MORE = ', or allow more with --most-events'


class CommandError(Exception):
    """The command cannot continue; the message has the reason, `code` the exit code."""

    def __init__(self, message: str, code: int = EXIT_INPUT) -> None:
        super().__init__(message)
        self.code = code


def say(command: str, message: object) -> None:
    """Print a line about a command to the standard error, above a progress bar if there is one."""
    line = as_message(f'{command}: {message}')
    if 'tqdm' in sys.modules:
        from tqdm import tqdm

        tqdm.write(line, file=sys.stderr)
    else:
        print(line, file=sys.stderr)


class _Notices(logging.Handler):
    """Prints log messages of the library as lines of a command, each line once."""

    def __init__(self, command: str) -> None:
        super().__init__(logging.WARNING)
        self._command = command
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text not in self._said:
            self._said.add(text)
            say(self._command, text)


@contextmanager
def _notices(command: str) -> Iterator[None]:
    """Print the log messages of the library while a command runs."""
    library, handler = logging.getLogger('impact_damper_ros'), _Notices(command)
    library.addHandler(handler)
    try:
        yield
    finally:
        library.removeHandler(handler)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM, as from ``timeout``, end the work, unless they are ignored."""

    def interrupt(number: int, _: object) -> None:
        raise KeyboardInterrupt(number)

    def interrupt_again(ignored: sys.UnraisableHookArgs) -> None:
        if isinstance(ignored.exc_value, KeyboardInterrupt):
            # The exception was raised in a destructor or a callback, where Python drops it.
            threading.Timer(0.1, os.kill, (os.getpid(), *ignored.exc_value.args)).start()
        else:
            sys.__unraisablehook__(ignored)

    before = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, interrupt)
    hook, sys.unraisablehook = sys.unraisablehook, interrupt_again
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


def discard_output() -> None:
    """Discard further output: the reader of the pipe has ended, as in ``... | head``."""
    with suppress(io.UnsupportedOperation):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def outcome(command: str, work: Callable[[], int], interrupted: str = 'interrupted') -> int:
    """Run the work of a command, and return the exit code; report an error in a line."""
    message: object
    try:
        with _notices(command), _interruptible():
            code = work()
            print(end='', flush=True)
            return code
    except CommandError as error:
        message, code = error, error.code
    except (RecordingError, ValueError) as error:
        message, code = error, EXIT_INPUT
    except KeyboardInterrupt as error:
        message, code = interrupted, 128 + (error.args or (signal.SIGINT,))[0]
    except BrokenPipeError:
        discard_output()
        return EXIT_FAILED
    except RunawayError as error:
        message, code = error, EXIT_FAILED
    except OSError as error:
        message, code = output_fault(error), EXIT_FAILED
        if error.filename is None:
            # Python would report the error again at exit.
            discard_output()
    say(command, message)
    return code


class _Parser(argparse.ArgumentParser):
    """A parser that also answers shell completion, and reports errors as the commands do."""

    def __init__(self, *arguments: Any, needs: Sequence[Need] = (), **named: Any) -> None:
        super().__init__(*arguments, **named)
        # -5kg is a value, as -5 is
        self._negative_number_matcher = re.compile(r'-\.?\d')
        self._needs = needs

    def parse_args(self, words: Any = None, namespace: Any = None) -> Any:
        complete(self)
        options = [a for a in self._actions if a.option_strings and a.default != SUPPRESS]
        defaults = {action.dest: action.default for action in options}
        for action in options:
            # Without this a given value could not be distinguished from a default.
            action.default = SUPPRESS
        given = vars(super().parse_args(words, namespace))
        check_needs(self, given, self._needs)
        return argparse.Namespace(**{**defaults, **given})

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        # Printed text may not be written yet, and perhaps cannot be.
        status = status or outcome(self.prog, lambda: 0)
        super().exit(status, message and as_message(message.rstrip()) + '\n')


class _Version(argparse.Action):
    """Prints the version, which takes long to find, and ends the command."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from impact_damper_ros import __version__

        print(f'{parser.prog} (impact_damper_ros) {__version__}')
        parser.exit()


def command_parser(
    command: str, description: str, epilog: str = '', needs: Sequence[Need] = ()
) -> argparse.ArgumentParser:
    """
    Return the parser of a command, with ``--version``; it keeps line breaks of the texts.

    An option whose `needs` are not given is refused.
    """
    parser = _Parser(
        command,
        description=description,
        epilog=epilog,
        needs=needs,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--version',
        action=_Version,
        nargs=0,
        default=SUPPRESS,
        help="show program's version number and exit",
    )
    return parser


def path_of(text: str) -> Path:
    """Return a path; an empty one, as of an unset variable of the shell, is refused."""
    if not text:
        raise argparse.ArgumentTypeError('the name is empty: give that of a file or directory')
    return Path(text)


def add_bag_argument(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Let a command take a recording, or several."""
    nargs = '+' if several else None
    text = 'bag directory or .mcap file'
    parser.add_argument('bag', type=path_of, metavar='BAG', nargs=nargs, help=text)


def add_node_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--node``, for a recording of several rigs."""
    parser.add_argument(
        '--node', metavar='NAME', help='name or namespace of the node, if the bag holds several'
    )


def add_run_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--run``, for a recording over a restart of the node."""
    parser.add_argument(
        '--run',
        type=up_to(10**6),
        metavar='N',
        help='number of the run, from 1 on, if the node was restarted while it was recorded '
        '[all runs, one after the other]',
    )


def add_path_option(
    parser: argparse._ActionsContainer, name: str, text: str, metavar: str = 'FILE'
) -> None:
    """Let a command take a path."""
    parser.add_argument(name, type=path_of, metavar=metavar, help=text)


def add_json_option(parser: argparse._ActionsContainer, what: str = 'the result') -> None:
    """Let a command take ``--json``, see `write_json`."""
    add_path_option(parser, '--json', f'write {what} as JSON (- : stdout)')


def add_quiet_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Let a command take ``--quiet``, which leaves out the progress bar and `what`."""
    parser.add_argument('--quiet', action='store_true', help=f'no progress bar and no {what}')


def add_most_events_option(parser: argparse.ArgumentParser, whose: str = '') -> None:
    """Let a command take ``--most-events``, see `Rig.advance`."""
    parser.add_argument(
        '--most-events',
        type=up_to(10**12),
        default=MOST_IN_PERIOD,
        metavar='N',
        help=f'end the run where there are more than N events{whose} in one period of the fastest '
        f'of spring and force [{MOST_IN_PERIOD}]',
    )


def number_in(
    low: float, high: float, unit: str = '', *, whole: bool = False
) -> Callable[[str], float]:
    """Return a function that reads numbers in a range, for `argparse`."""
    span = f'{low} to {high}' if whole else f'{low:g} to {high:g}'
    words = f'give a {"whole " * whole}number from {span} {unit}'.rstrip()

    def read(text: str) -> float:
        with suppress(ValueError):
            value = si_value(text, unit)
            if low <= value <= high and not (whole and value % 1.0):
                return int(value) if whole else value
        raise argparse.ArgumentTypeError(f'{text!r}: {words}')

    return read


def up_to(largest: int) -> Callable[[str], float]:
    """Return a function that reads whole numbers from 1 to the largest, for `argparse`."""
    return number_in(1, largest, whole=True)


def motion_size(text: str) -> tuple[float, str]:
    """Read the size of a motion, for `argparse`; return it in SI, and its quantity."""
    size, unit, _ = split_number(text)
    names = [name for units in QUANTITIES.values() for name in UNITS[units]]
    if size is None or not size > 0.0 or unit not in names:
        raise argparse.ArgumentTypeError(
            f'{quote(text)}: give a positive displacement, velocity or acceleration with its '
            'unit, such as 10mm, 2m/s or 3g'
        )
    of = quantity_of(unit)
    return in_si(size, UNITS[QUANTITIES[of]][unit]), of


def text_stream(json: Path | None) -> TextIO:
    """Return where a command prints its text: the standard output, unless its JSON goes there."""
    return sys.stderr if str(json) == '-' else sys.stdout


def write_json(path: Path | None, result: Any) -> None:
    """Write a result to the file given by ``--json``, if any."""
    if path is not None:
        write_text(path, json_text(result))


def write_output(path: Path | None, text_of: Callable[..., str], *args: object) -> None:
    """Write the text that a function returns to the file given by an option, if any."""
    if path is not None:
        write_text(path, text_of(*args))


def draw(path: Path | None, figure_of: Callable[..., Figure], *args: object) -> None:
    """Draw the figure that a function returns into the file given by ``--figure``, if any."""
    if path is not None:
        from impact_damper_ros.report.drawing import save_figure

        save_figure(figure_of(*args), path)


def need_matplotlib() -> None:
    """Raise CommandError if matplotlib is missing."""
    if find_spec('matplotlib') is None:
        raise CommandError(
            'matplotlib, which draws the figures, is not installed: install it, or install the '
            'package with its extra [plot]'
        )


#: Options that name a file to write.
_OUTPUTS = (
    *('output', 'json', 'csv', 'impacts', 'events', 'states'),
    *('rig_out', 'transmissibility', 'response'),
)


def check_outputs(arguments: argparse.Namespace, *inputs: Path | None) -> None:
    """
    Raise an error before the work if an output could not be written after it.

    An output that is an input, or within one, raises an error, too.
    """
    given = vars(arguments)
    figures = given.get('figure') or []
    figures = figures if isinstance(figures, list) else [figures]
    # An option that counts impacts has another type.
    paths = [given[n] for n in _OUTPUTS if isinstance(given.get(n), Path)]
    if [str(path) for path in paths].count('-') > 1:
        raise ValueError('two outputs go to the standard output: give one of them a file')
    streams = [path for path in paths if str(path) == '-' or is_stream(path)]
    folders = [path for name in ('report', 'recording') if (path := given.get(name)) is not None]
    files = [path.resolve() for path in paths + figures + folders if path not in streams]
    if len(set(files)) < len(files):
        raise ValueError('two outputs have the same name: give each its own')
    read = {path.resolve() for path in inputs if path is not None}
    for path in files:
        if read & {path, *path.parents}:
            raise ValueError(f'{path} is an input, or lies in one: give the output another name')
    for path in figures:
        if path.suffix.lower() not in ('.png', '.svg', '.pdf'):
            raise CommandError(f'{path}: give a name that ends in .png, .svg or .pdf')
        need_matplotlib()
    for path in paths + figures:
        check_file(path)
    if given.get('recording') is not None:
        check_new(given['recording'])


def progress_bar(what: str, total: float, unit: str, *, quiet: bool = False) -> tqdm[None]:
    """Return a progress bar (a context manager) that appears after a second."""
    from tqdm import tqdm

    return tqdm(
        total=total,
        desc=what,
        delay=1.0,
        leave=False,
        # Steps may become small: the bar is renewed by the clock, not by the number of steps.
        miniters=0,
        disable=True if quiet else None,
        bar_format='{l_bar}{bar}| {n:.0f}/{total:.0f} '
        + unit
        + ' [{elapsed}<{remaining}{postfix}]',
    )


#: Time between two lines on progress, where there is no terminal for a progress bar, s.
_REPORT_PERIOD = 15.0


@contextmanager
def share_done(
    command: str, what: str, count: int, *, quiet: bool = False
) -> Iterator[Callable[[float], None]]:
    """
    Show progress in a bar or, without a terminal, in a line now and then.

    Yields a function that takes the amount done, out of `count`.
    """
    with progress_bar(what, 100.0 * count, '%', quiet=quiet) as bar:
        reported = time.monotonic()

        def reached(done: float) -> None:
            nonlocal reported
            bar.update(max(0.0, 100.0 * done - bar.n))
            if bar.disable and not quiet and time.monotonic() > reported + _REPORT_PERIOD:
                reported = time.monotonic()
                say(command, f'{what} {100.0 * done / count:.0f} %')

        yield reached


#: Time after which work without a progress bar is reported to continue, s.
PATIENCE = 5.0


@contextmanager
def long_work(command: str, message: str, *, quiet: bool = False) -> Iterator[None]:
    """Print a message once the work has taken `PATIENCE`."""
    notice = threading.Timer(PATIENCE, say, (command, message))
    notice.daemon = True
    if not quiet:
        notice.start()
    try:
        yield
    finally:
        notice.cancel()
