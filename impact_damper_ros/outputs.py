# SPDX-License-Identifier: Apache-2.0
"""Output files: checked before the work, and written whole or not at all."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

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
    errno.EFBIG: 'allow larger files (ulimit -f), or give another place',
}


def in_words(error: OSError, path: Path | None = None) -> str:
    """Return what cannot be written, why, and the remedy; `path` if the error names no file."""
    if error.errno == errno.ENOENT and not (error.filename or path):
        with suppress(OSError):
            return _in_words(error, Path.cwd())
        return 'the current directory no longer exists: change to one that does'
    return _in_words(error, path)


def _in_words(error: OSError, path: Path | None) -> str:
    remedy = _REMEDIES.get(
        error.errno or 0, 'give a directory that exists and can be written, with room on the disk'
    )
    return (
        f'cannot write {error.filename or path or "output"}: {error.strerror or error}: {remedy}'
    )


def _is_stream(path: Path) -> bool:
    """Return whether this is a pipe or a device, or an open file such as /dev/stdout."""
    return path.exists() and (not path.is_file() or path.is_relative_to('/dev'))


def _sync(path: Path) -> None:
    """Flush a file, or the names in a directory, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _refusal(number: int, path: Path) -> OSError:
    return OSError(number, os.strerror(number), str(path))


def _try(directory: Path, wanted: Path) -> None:
    """Write a file without a name into a directory."""
    try:
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(wanted)) from error


def check_file(path: Path) -> None:
    """Raise OSError if a file cannot be written; nothing is changed. - is standard output."""
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


def check_directory(path: Path) -> None:
    """Raise OSError if a directory cannot be made and written into; it is not made."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise _refusal(errno.ENOTDIR, path)
    _try(place, path)


def draft_of(path: Path) -> Path:
    """Return the draft that is to take the place of a file; a pipe or a device is its own."""
    if _is_stream(path):
        return path
    file = path.resolve()
    return file.with_name(f'.{os.getpid()}.{file.name}')


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """
    Write a file so that at any instant there is a whole one, the old or the new, or none.

    Parameters
    ----------
    path : Path
        The file. A pipe or a device is written to as it is.

    Yields
    ------
    Path
        The draft to write, which takes the place of the file at the end if nothing was raised.

    Raises
    ------
    OSError
        If the file cannot be written; its `filename` is that of the file.
    """
    draft, file = draft_of(path), path.resolve()
    if draft == path:
        yield path
        return
    try:
        yield draft
        _sync(draft)
        draft.replace(file)
        _sync(file.parent)
    except OSError as error:
        if error.filename in (None, str(draft)):
            error.filename = str(path)
        raise
    finally:
        with suppress(OSError):
            draft.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text so that there is a `whole` file; - stands for standard output."""
    if str(path) == '-':
        sys.stdout.write(text)
    else:
        write_texts({path: text})


def write_texts(texts: Mapping[Path, str]) -> None:
    """Write several files, so that all of them are new and `whole`, or all are as before."""
    with ExitStack() as stack:
        for path, text in texts.items():
            draft = stack.enter_context(whole(path))
            try:
                with draft.open('w', encoding='utf-8') as stream:
                    stream.write(text)
                    stream.flush()
                    if draft != path:
                        os.fsync(stream.fileno())
            except OSError as error:
                # A full disk is reported without a name
                raise OSError(error.errno, error.strerror, str(path)) from error
