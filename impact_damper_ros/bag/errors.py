# SPDX-License-Identifier: Apache-2.0
"""The error of recording and reading, with cause and remedy."""

from __future__ import annotations

import errno
from pathlib import Path

from impact_damper_ros.rig.quoting import as_line

_SPACE = 'free some space there, or record to another file system (bag_directory, --bag, --output)'
_RIGHTS = 'give yourself write permission there, or choose another directory'

#: Cause and remedy of failures that a user can remove.
_KNOWN: dict[int, tuple[str, str]] = {
    errno.ENOSPC: ('the disk is full', _SPACE),
    errno.EDQUOT: ('the disk quota is used up', _SPACE),
    errno.EFBIG: ('the file has reached the largest size allowed', _SPACE),
    errno.EACCES: ('permission is denied', _RIGHTS),
    errno.EPERM: ('the operation is not permitted', _RIGHTS),
    errno.EROFS: ('the file system is read-only', 'choose a directory on a writable one'),
    errno.ENOTDIR: (
        'a part of the path is a file, not a directory',
        'move that file away, or choose another directory',
    ),
    errno.EEXIST: ('it exists already', 'choose another name; nothing is ever overwritten'),
    errno.ENOENT: ('there is no such file or directory', 'check the path'),
}


class RecordingError(Exception):
    """
    A recording cannot be written, read or recovered.

    Parameters
    ----------
    attempt : str
        What was attempted, as an infinitive without 'to': ``'write'``.
    path : Path or str
        The file or directory concerned.
    cause : str
        Why it failed.
    remedy : str, optional
        What the user can do about it.

    Attributes
    ----------
    path : Path
        The file or directory concerned.
    cause, remedy : str
        As above.
    """

    def __init__(self, attempt: str, path: Path | str, cause: str, remedy: str = '') -> None:
        self.path = Path(path)
        self.cause = as_line(cause)
        self.remedy = remedy
        text = f"cannot {attempt} '{path}': {cause}"
        super().__init__(as_line(text) + (f'; {as_line(remedy)}' if remedy else ''))

    @classmethod
    def from_os_error(cls, attempt: str, path: Path | str, error: OSError) -> RecordingError:
        """Return the error for a failed system call."""
        cause = error.strerror or str(error)
        remedy = ''
        if error.errno in _KNOWN:
            cause, remedy = _KNOWN[error.errno]
        return cls(attempt, path, cause, remedy)
