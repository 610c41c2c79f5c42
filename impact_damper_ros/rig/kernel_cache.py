"""
Where compiled kernels are kept from one process to the next.

numba keeps compiled code beside the source file of a function and knows that it is stale by that
one file. A kernel calls others in other files; so all of them get one stamp file of their own for
a source, in a directory named by a digest of everything that compiled code depends on. Different
versions of the package then live side by side, and nothing is ever written beside the sources,
which may be read-only.

Compiled code is loaded as it is found, and runs with the rights of whoever loads it. So a
directory that belongs to somebody else, or that holds a file of somebody else, is not used.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ['compiling_alone', 'stamp_file']

_STAMP = 'kernels.py'
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def _digest() -> str:
    """Return a digest of all sources of this subpackage and of the versions of the compiler."""
    digest = hashlib.sha256()
    for text in (sys.version, version('numba'), version('llvmlite')):
        digest.update(text.encode() + b'\0')
    for path in sorted(Path(__file__).parent.glob('*.py')):
        digest.update(path.name.encode() + b'\0' + path.read_bytes() + b'\0')
    return digest.hexdigest()[:24]


def _bases() -> Iterator[Path]:
    """Yield the directories for caches that a user may have, the preferred one first."""
    if named := os.environ.get('NUMBA_CACHE_DIR'):
        yield Path(named)
    if named := os.environ.get('XDG_CACHE_HOME'):
        yield Path(named)
    try:
        yield Path.home() / '.cache'
    except RuntimeError:
        return


def _write_stamp(path: Path) -> None:
    """Write the stamp file at once, with a fixed time, however many processes do so."""
    handle, name = tempfile.mkstemp(dir=path.parent, suffix='.part')
    try:
        with os.fdopen(handle, 'w', encoding='utf-8') as stamp:
            stamp.write(f'# Stands for the sources of the kernels: {path.parent.name}\n')
        os.utime(name, (0, 0))
        Path(name).replace(path)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise


def _is_own(path: Path) -> bool:
    """Return whether a file or directory is one's own, and a link to it too, or gone."""
    user = os.geteuid()
    try:
        return path.lstat().st_uid == user and path.stat().st_uid == user
    except FileNotFoundError:
        return True  # the draft of another process


def _made_own(path: Path) -> bool:
    """Make a directory for oneself alone; return whether it is so, with all that is in it."""
    path.mkdir(mode=0o700, exist_ok=True)
    if not _is_own(path):
        return False
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & _OTHERS_WRITE:
        path.chmod(mode & ~_OTHERS_WRITE)
    return all(_is_own(inside) for inside in path.iterdir())


def _is_open_to_all(path: Path) -> bool:
    """Return whether anybody may put another directory in the place of one's own."""
    mode = path.stat().st_mode
    return bool(mode & stat.S_IWOTH) and not mode & stat.S_ISVTX


def stamp_file() -> Path | None:
    """
    Return the file that stands for the kernels' sources, beside which numba keeps their code.

    Returns
    -------
    Path or None
        A file in the first writable of the directories that ``NUMBA_CACHE_DIR`` and
        ``XDG_CACHE_HOME`` name and of ``~/.cache``; None if there is none, or no sources. One
        that somebody else could have put code into is passed over.
    """
    try:
        folder = f'kernels-{_digest()}'
    except (OSError, PackageNotFoundError):
        return None
    for base in _bases():
        path = base / 'impact_damper_ros' / folder / _STAMP
        try:
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_open_to_all(base) or not all(
                _made_own(place) for place in (path.parent.parent, path.parent)
            ):
                continue
            # numba's own files go here too: it must be writable now, not only have been once.
            _write_stamp(path)
        except OSError:
            continue
        return path
    return None


@contextmanager
def compiling_alone(stamp: Path | None) -> Iterator[None]:
    """
    Let one process compile at a time; the others find its result.

    Parameters
    ----------
    stamp : Path or None
        What `stamp_file` has returned; without a cache nobody waits.
    """
    if stamp is None:
        yield
        return
    try:
        import fcntl

        lock = os.open(stamp.with_suffix('.lock'), os.O_RDWR | os.O_CREAT, 0o600)
    except (ImportError, OSError):
        yield
        return
    try:
        with suppress(OSError):
            # Gone with its process, however that ends.
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)
