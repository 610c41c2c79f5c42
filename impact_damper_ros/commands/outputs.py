"""Files that commands write: tried before the work, written whole, and errors told in words."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

__all__ = ['check_directory', 'check_figure', 'check_file', 'in_words', 'whole', 'write_text']

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
    """
    Say what cannot be written, why, and what to do.

    Parameters
    ----------
    error : OSError
        What the attempt ended with.
    path : Path, optional
        What is meant where the error does not name it.
    """
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


def _is_stream(path: Path) -> bool:
    """Return whether this is a pipe or a device, or an open file such as /dev/stdout."""
    return path.exists() and (not path.is_file() or path.is_relative_to('/dev'))


def check_file(path: Path) -> None:
    """
    Find out before the work whether a file can be written after it; nothing is changed.

    Parameters
    ----------
    path : Path
        The file; - stands for standard output.

    Raises
    ------
    OSError
        If it cannot; its `filename` is the path.
    """
    if str(path) == '-':
        return
    if path.is_dir():
        raise _refusal(errno.EISDIR, path)
    if _is_stream(path):
        return  # opened once only
    directory = path.resolve().parent
    if not directory.is_dir():
        raise _refusal(errno.ENOTDIR if directory.exists() else errno.ENOENT, path)
    _try(directory, path)


def check_figure(path: Path) -> None:
    """
    Find out before the work whether a figure can be drawn after it.

    Raises
    ------
    ValueError
        If its name does not say a known format, or matplotlib is missing.
    OSError
        If the file cannot be written.
    """
    if path.suffix.lower() not in ('.png', '.svg', '.pdf'):
        raise ValueError(f'{path}: give a name that ends in .png, .svg or .pdf')
    if find_spec('matplotlib') is None:
        raise ValueError(
            'matplotlib, which draws the figure, is missing: install it, or the package with its '
            'extra [plot]'
        )
    check_file(path)


def check_directory(path: Path) -> None:
    """
    Find out before the work whether a directory can be made, and written into; nothing is changed.

    Raises
    ------
    OSError
        If it cannot; its `filename` is the path.
    """
    place = path.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise _refusal(errno.ENOTDIR, path)
    _try(place, path)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """
    Write a file so that at any instant there is a whole one, the old or the new, or none.

    Parameters
    ----------
    path : Path
        The file. A pipe or a device is just written to.

    Yields
    ------
    Path
        Where to write it; it has the same suffix.

    Raises
    ------
    OSError
        If it cannot be written; its `filename` is the path.
    """
    if _is_stream(path):
        yield path
        return
    file = path.resolve()
    draft = file.with_name(f'.{os.getpid()}.{file.name}')
    try:
        yield draft
        with draft.open('rb') as stream:
            os.fsync(stream.fileno())
        draft.replace(file)
    except OSError as error:
        error.filename = str(path)
        raise
    finally:
        with suppress(OSError):
            draft.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text so that there is a `whole` file; - stands for standard output."""
    if str(path) == '-':
        sys.stdout.write(text)
        return
    with whole(path) as draft:
        draft.write_text(text, encoding='utf-8')
