# SPDX-License-Identifier: Apache-2.0
"""The error of recording and reading, with cause and remedy."""

from __future__ import annotations

from pathlib import Path

from impact_damper_ros.outputs import explain
from impact_damper_ros.parameters.quoting import as_line


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
        return cls(attempt, path, *explain(error))
