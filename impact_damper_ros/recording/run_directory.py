"""Where a run is recorded: one new directory each, whoever else records there at the time."""

from __future__ import annotations

import time
from pathlib import Path

from .errors import RecordingError

__all__ = ['create_run_directory']

#: Names tried within one second before giving up.
_ATTEMPTS = 1000


def create_run_directory(parent: Path | str, when: float | None = None) -> Path:
    """
    Make a new directory ``run_<YYYYmmdd_HHMMSS>`` and return its path.

    A name that is taken gets a number (``run_20250131_120000_2``). The directory is made by a call
    that fails if it exists, so two recorders that start in the same second never share one.

    Parameters
    ----------
    parent : Path or str
        Directory of all runs; made if absent.
    when : float, optional
        Seconds since the epoch; now if not given. Written in local time.

    Returns
    -------
    Path
        The new, empty directory.

    Raises
    ------
    RecordingError
        If it cannot be made.
    """
    parent = Path(parent)
    stem = time.strftime('run_%Y%m%d_%H%M%S', time.localtime(when))
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        cause = 'it is a file, not a directory'
        remedy = 'move that file away, or set bag_directory to another path'
        raise RecordingError('record to', parent, cause, remedy) from None
    except OSError as error:
        raise RecordingError.from_os_error('record to', parent, error) from error
    for number in range(1, _ATTEMPTS + 1):
        directory = parent / (stem if number == 1 else f'{stem}_{number}')
        try:
            directory.mkdir()
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordingError.from_os_error('record to', directory, error) from error
        return directory
    cause = f'{_ATTEMPTS} recordings were started there within one second'
    raise RecordingError('record to', parent / stem, cause, 'record again a second later')
