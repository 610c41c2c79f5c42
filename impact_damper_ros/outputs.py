"""Files that are written completely or not at all."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ['is_stream', 'whole', 'write_text']


def is_stream(path: Path) -> bool:
    """Return whether a path is a pipe, a device, or an open file such as /dev/stdout."""
    return path.exists() and (not path.is_file() or path.is_relative_to('/dev'))


def _sync(path: Path) -> None:
    """Have the disk keep a file, or the names in a directory."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """
    Replace a file atomically.

    Parameters
    ----------
    path : Path
        The file. A pipe or a device is written to directly.

    Yields
    ------
    Path
        A draft next to it, to be written in the block. It takes the place of the file at the end
        of the block, and is deleted after an exception, which leaves the old file as it was.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    if is_stream(path):
        yield path
        return
    file = path.resolve()
    draft = file.with_name(f'.{os.getpid()}.{file.name}')
    try:
        yield draft
        _sync(draft)
        draft.replace(file)
        _sync(file.parent)
    except OSError as error:
        error.filename = str(path)
        raise
    finally:
        with suppress(OSError):
            draft.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file as `whole` does; - stands for the standard output."""
    if str(path) == '-':
        sys.stdout.write(text)
        return
    with whole(path) as draft:
        draft.write_text(text, encoding='utf-8')
