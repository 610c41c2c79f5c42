"""What all commands share: options, checks of outputs, messages and exit status."""

from __future__ import annotations

import argparse
import errno
import os
import sys
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from impact_damper_ros import __version__
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.outputs import is_stream, whole, write_text
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.description import described, frequency_hint
from impact_damper_ros.rig.parameters_file import presets
from impact_damper_ros.rig.shown import printable

__all__ = [
    'add_jobs_option',
    'add_params_argument',
    'add_version_option',
    'announce',
    'check_directory',
    'check_figure',
    'check_file',
    'hint',
    'in_words',
    'outcome',
    'rig_line',
    'say',
    'up_to',
    'whole',
    'write_text',
]


_PLACE = 'give a place that can be written'
_ROOM = 'free some space there, or give another place'
_REMEDIES = {
    errno.ENOENT: 'give a directory that exists and can be written',
    errno.ENOTDIR: 'a part of the path is a file: give a directory that can be written',
    errno.EISDIR: 'give the name of a file',
    errno.EACCES: _PLACE,
    errno.EPERM: _PLACE,
    errno.EROFS: _PLACE,
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
}


def in_words(error: OSError, path: Path | None = None) -> str:
    """Say what cannot be written, why, and what to do."""
    remedy = _REMEDIES.get(
        error.errno or 0, 'give a directory that exists and can be written, with room on the disk'
    )
    return (
        f'cannot write {error.filename or path or "output"}: {error.strerror or error}: {remedy}'
    )


def _try(directory: Path, wanted: Path) -> None:
    """Write a file without a name into a directory."""
    try:
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(wanted)) from error


def _refusal(number: int, path: Path) -> OSError:
    return OSError(number, os.strerror(number), str(path))


def check_file(path: Path) -> None:
    """Find out before the work whether a file can be written after it; nothing is changed."""
    if str(path) == '-':
        return
    if path.is_dir():
        raise _refusal(errno.EISDIR, path)
    if is_stream(path):
        return  # opened once only
    directory = path.resolve().parent
    if not directory.is_dir():
        raise _refusal(errno.ENOTDIR if directory.exists() else errno.ENOENT, path)
    _try(directory, path)


def check_figure(path: Path) -> None:
    """Find out before the work whether a figure can be drawn after it."""
    if path.suffix.lower() not in ('.png', '.svg', '.pdf'):
        raise ValueError(f'{path}: give a name that ends in .png, .svg or .pdf')
    if find_spec('matplotlib') is None:
        raise ValueError(
            'matplotlib, which draws the figure, is missing: install it, or the package with its '
            'extra [plot]'
        )
    check_file(path)


def check_directory(path: Path) -> None:
    """Check that a directory can be made and written into, without making it."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise _refusal(errno.ENOTDIR, path)
    _try(place, path)


def add_version_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--version``."""
    parser.add_argument(
        '--version', action='version', version=f'{parser.prog} (impact_damper_ros) {__version__}'
    )


def add_params_argument(parser: argparse.ArgumentParser) -> None:
    """Let a command take the parameters file of a rig."""
    parser.add_argument(
        'params',
        type=Path,
        metavar='PARAMS',
        help=f'ROS 2 parameters file of the rig, or a preset: {", ".join(presets())}',
    )


def say(command: str, message: object) -> None:
    """Print a line about a command to the standard error."""
    print(printable(f'{command}: {message}'), file=sys.stderr)


def rig_line(rig: RigParameters, control: GapControlParameters | None = None) -> str:
    """Return the rig that a command works on in a line, with its gap control."""
    text = described(rig)
    if control is not None and control.active:
        text += f'; gap control {control.gap_control}'
    return text


def announce(
    command: str,
    rig: RigParameters,
    control: GapControlParameters | None = None,
    *,
    frequencies: tuple[float, float] | None = None,
) -> None:
    """Say which rig a command works on, before it does, and whether a frequency may be in Hz."""
    say(command, rig_line(rig, control))
    hint(command, rig, frequencies)


def hint(command: str, rig: RigParameters, frequencies: tuple[float, float] | None = None) -> None:
    """Say whether a frequency may be in Hz, as `announce` does."""
    if note := frequency_hint(rig, frequencies):
        say(command, f'note: {note}')


def up_to(largest: int) -> Callable[[str], int]:
    """Return what reads a number from 1 to the largest one, for `argparse`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = 0
        if not 1 <= value <= largest:
            raise argparse.ArgumentTypeError(f'{text!r}: give a whole number from 1 to {largest}')
        return value

    return read


def add_jobs_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--jobs``."""
    parser.add_argument('--jobs', type=up_to(64), default=2, metavar='N', help='processes [2]')


def outcome(command: str, work: Callable[[], int]) -> int:
    """Do the work of a command."""
    try:
        return work()
    except (RecordingError, ValueError) as error:
        say(command, error)
        return 2
    except KeyboardInterrupt:
        print(f'{command}: interrupted', file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        say(command, in_words(error))
        return 1
