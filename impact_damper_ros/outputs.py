# SPDX-License-Identifier: Apache-2.0
"""Output files: checked before the work, and written whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

_PLACE = 'choose another directory'
_ROOM = 'free some space there, or choose another directory'

#: Cause and remedy of failed system calls that a user can mend.
_CAUSES = {
    errno.EACCES: ('permission is denied', f'give yourself permission there, or {_PLACE}'),
    errno.EDQUOT: ('the disk quota is used up', _ROOM),
    errno.EEXIST: ('it exists already', 'choose another name; nothing is ever overwritten'),
    errno.EFBIG: (
        'the file has reached the largest size allowed',
        f'allow larger files (ulimit -f), or {_PLACE}',
    ),
    errno.EISDIR: ('it is a directory', 'give the name of a file'),
    errno.ENAMETOOLONG: ('the name is too long', 'give a shorter one'),
    errno.ENOENT: ('there is no such file or directory', 'give a path that exists'),
    errno.ENOSPC: ('the disk is full', _ROOM),
    errno.ENOTDIR: (
        'a part of the path is a file, not a directory',
        f'move that file away, or {_PLACE}',
    ),
    errno.EPERM: ('the operation is not permitted', f'give yourself permission, or {_PLACE}'),
    errno.EROFS: ('the file system is read-only', 'choose a directory on a writable one'),
}
#: Longest name of a file, bytes.
_LONGEST_NAME = 255
_STREAMS = ('/dev/stdout', '/dev/stderr', '/dev/fd/', '/proc/self/fd/')


def explain(error: OSError) -> tuple[str, str]:
    """Return the cause of a failed system call, and the remedy if there is one."""
    return _CAUSES.get(error.errno or 0, (error.strerror or str(error), ''))


def output_fault(error: OSError, path: Path | None = None) -> str:
    """Return what cannot be written, why, and the remedy; `path` if the error names no file."""
    if error.errno == errno.ENOENT and not (error.filename or path):
        try:
            path = Path.cwd()
        except OSError:
            return 'the current directory no longer exists: change to one that does'
    cause, remedy = explain(error)
    where = error.filename or path or 'the standard output'
    return f'cannot write {where}: {cause}' + (f': {remedy}' if remedy else '')


def is_stream(path: Path) -> bool:
    """Return whether this is a pipe or a device, or an open file such as /dev/stdout."""
    try:
        return path.exists() and (not path.is_file() or str(path).startswith(_STREAMS))
    except OSError:
        # As of a name that is too long, which is reported where it is written
        return False


def sync_directory(directory: Path) -> None:
    """Make the names in a directory survive a power cut; nothing where that is not supported."""
    with suppress(OSError):
        _sync(directory)


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
    if is_stream(path):
        return  # opened once only
    file = path.resolve()
    if not file.parent.is_dir():
        raise _refusal(errno.ENOTDIR if file.parent.exists() else errno.ENOENT, path)
    if len(os.fsencode(file.name)) > _LONGEST_NAME:
        raise _refusal(errno.ENAMETOOLONG, path)
    if file.exists() and not os.access(file, os.W_OK):
        raise _refusal(errno.EACCES, path)
    _try(file.parent, path)


def check_new(path: Path) -> None:
    """Raise OSError if a directory exists already, or cannot be made; it is not made."""
    if path.exists():
        raise _refusal(errno.EEXIST, path)
    check_directory(path)


def check_directory(path: Path) -> None:
    """Raise OSError if a directory cannot be made and written into; it is not made."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise _refusal(errno.ENOTDIR, path)
    _try(place, path)


def part_of(path: Path) -> Path:
    """Return where a table grows until it is complete: beside its file, in NAME.part."""
    if is_stream(path):
        return path
    file = path.resolve()
    kept = os.fsencode(file.name)[: _LONGEST_NAME - len('.part')]
    return file.with_name(f'{os.fsdecode(kept)}.part')


def _begin(draft: Path, file: Path) -> None:
    """Make an empty draft, with owner and mode of the file that it is to replace."""
    draft.unlink(missing_ok=True)
    draft.touch(exist_ok=False)
    with suppress(FileNotFoundError):
        there = file.stat()
        with suppress(PermissionError):
            os.chown(draft, there.st_uid, there.st_gid)
        draft.chmod(there.st_mode & 0o7777)


def _replace(draft: Path, file: Path) -> None:
    """Put a complete draft in the place of its file."""
    _sync(draft)
    try:
        draft.replace(file)
    except OSError as error:
        if error.errno != errno.EBUSY:
            raise
        # The file is mounted by itself, as into a container: it can only be written into.
        shutil.copyfile(draft, file)
        _sync(file)
        draft.unlink()
    sync_directory(file.parent)


@contextmanager
def whole(path: Path, *, part: bool = False) -> Iterator[Path]:
    """
    Write a file so that at any instant there is a whole one, the old or the new, or none.

    A new file has owner and mode of the old one.

    Parameters
    ----------
    path : Path
        The file. A pipe or a device is written to as it is.
    part : bool, optional
        Whether the draft is `part_of` the path, and stays if anything is raised: for what is of
        use though it ended early. Without, it is hidden and removed.

    Yields
    ------
    Path
        The draft to write, which replaces the file at the end if nothing was raised.

    Raises
    ------
    OSError
        If the file cannot be written; its `filename` is that of the file.
    """
    if is_stream(path):
        yield path
        return
    file = path.resolve()
    # The end of the name is what some writers know the format by.
    draft = part_of(path) if part else file.with_name(f'.{secrets.token_hex(4)}{file.suffix[-9:]}')
    try:
        _begin(draft, file)
        yield draft
        _replace(draft, file)
    except OSError as error:
        if error.filename in (None, str(draft)):
            error.filename = str(path)
        raise
    finally:
        if not part:
            draft.unlink(missing_ok=True)


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
            draft.write_text(text, encoding='utf-8')
