"""A file system that is soon full, for tests of what happens then."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def mounted(directory: Path, kilobytes: int) -> Iterator[Path]:
    """Mount a small file system on a directory; skip the test where that is not allowed."""
    directory.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', f'size={kilobytes}k', 'tmpfs', str(directory)]
    mount = shutil.which('mount')
    result = subprocess.run(command, capture_output=True, text=True) if mount else None
    if result is None or result.returncode:
        reason = result.stderr.strip() if result else 'no mount command'
        pytest.skip(f'a small file system cannot be mounted here: {reason}')
    try:
        yield directory
    finally:
        subprocess.run(['umount', '-l', str(directory)], check=True)
