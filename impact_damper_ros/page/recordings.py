# SPDX-License-Identifier: Apache-2.0
"""
The recordings that the page lists, plays, downloads and compares.

Only the bags directly in one directory are accessible, by name; no request contains a path. Names
are printable: bytes of a name that are not UTF-8 are shown as escapes.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import struct
import sys
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import quote

import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader

import impact_damper_ros
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.metadata import read_listing
from impact_damper_ros.bag.run_reader import bag_files
from impact_damper_ros.parameters.quoting import printable

_SUFFIXES = ('.mcap', '.mcap.zstd', '.db3', '.db3.zstd')
_MOST_LISTED = 500
#: Comparisons at a time, and the longest one, s.
_MOST_COMPARED = 2
_PATIENCE_S = 1800.0


def _environment() -> dict[str, str]:
    """Return the environment in which another Python finds this package."""
    root = str(Path(impact_damper_ros.__file__).parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
    return {**os.environ, 'PYTHONPATH': path}


class Recordings:
    """
    A bag or file, or the bags below a directory.

    If `listed`, a directory without `metadata.yaml` is a directory of bags, whatever its files
    are.
    """

    def __init__(self, place: Path, *, listed: bool = False) -> None:
        self._place = place.resolve()
        #: Name of the bag, if it is a single one.
        self.single = ''
        whole = self._place.is_file() or (self._place / 'metadata.yaml').is_file()
        single = _is_bag(self._place, Path(self._place.anchor))
        if single and (whole or not (listed or _has_bags(self._place))):
            self.single, self._place = self._place.name, self._place.parent
        # The directory of the reports, and the reports by the name of their bag
        self._directory: Path | None = None
        self._reports: dict[str, Path] = {}
        # Comparisons under way by recording, and the process of each once it runs
        self._comparing: dict[str, asyncio.subprocess.Process | None] = {}
        # Listing of each bag, and the state of the files from which it was read
        self._known: dict[Path, tuple[object, dict[str, Any]]] = {}

    def names(self) -> list[str]:
        """Return the names of the bags, the newest first."""
        return [printable(path.name) for path in self._bags()]

    def path(self, name: str) -> Path:
        """Return the path of a bag; raise a LookupError if there is no bag of that name."""
        for path in self._bags():
            if printable(path.name) == name:
                return path
        raise LookupError(f'there is no recording {printable(name[:200])}')

    def _bags(self) -> list[Path]:
        """Return the paths of the bags, the newest first."""
        if self.single:
            return [self._place / self.single]
        try:
            found = [path for path in self._place.iterdir() if _is_bag(path, self._place)]
        except OSError:
            return []
        return sorted(found, key=_age)[:_MOST_LISTED]

    def file(self, name: str) -> Path:
        """Return the file to download; LookupError if there is none, or the bag has several."""
        try:
            files = bag_files(self.path(name))
        except RecordingError as error:
            raise LookupError(str(error)) from error
        if len(files) != 1:
            raise LookupError(f'{name} has {len(files)} files: copy its directory')
        return files[0]

    def list(self) -> list[dict[str, Any]]:
        """Return name, start, duration, size and number of files of each recording."""
        described = {}
        for path in self._bags():
            files, known = _state_of(path), self._known.get(path)
            described[path] = known if known and known[0] == files else (files, _description(path))
        self._known = described
        return [entry for _, entry in described.values()]

    # Comparison

    def report(self, name: str) -> Path:
        """Return the report of a bag; LookupError if there is none."""
        if name not in self._reports:
            raise LookupError('there is no such report')
        return self._reports[name]

    def start_comparison(self, name: str) -> bool:
        """Return whether a comparison begins now; LookupError if too many run."""
        if name in self._comparing:
            return False
        if len(self._comparing) >= _MOST_COMPARED:
            raise LookupError(
                f'{_MOST_COMPARED} other recordings are being compared: wait for one'
            )
        self._comparing[name] = None
        return True

    def cancel_comparison(self, name: str) -> None:
        """End a comparison, if there is one."""
        process = self._comparing.get(name)
        if process is not None and process.returncode is None:
            process.terminate()

    async def compare(self, path: Path) -> dict[str, Any]:
        """Compare a bag with theory; return the message for the pages."""
        name = printable(path.name)
        try:
            ok, text = await self._compare(path, name)
        finally:
            self._comparing.pop(name, None)
        url = f'/reports/{quote(name, safe="")}/report.html' if ok else ''
        return {'type': 'compare_done', 'recording': name, 'ok': ok, 'url': url, 'text': text}

    async def _compare(self, path: Path, name: str) -> tuple[bool, str]:
        """Run `compare_run` in a child process; return whether it has written a report."""
        if self._directory is None:
            self._directory = Path(tempfile.mkdtemp(prefix='impact_damper_reports_'))
        directory = Path(tempfile.mkdtemp(dir=self._directory))
        process = await asyncio.create_subprocess_exec(
            *('nice', '-n', '5', sys.executable, '-m', 'impact_damper_ros.cli.compare_run'),
            *(str(path), '--report', str(directory)),
            env=_environment(),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        self._comparing[name] = process
        try:
            output, _ = await asyncio.wait_for(process.communicate(), _PATIENCE_S)
        except (TimeoutError, asyncio.CancelledError):
            process.kill()
            await process.wait()
            raise
        if process.returncode in (-signal.SIGTERM, 128 + signal.SIGTERM):
            return False, f'the comparison of {name} was cancelled'
        self._reports[name] = directory / 'report.html'
        text = printable(output.decode(errors='replace'))[-4000:]
        return self._reports[name].is_file(), text

    def close(self) -> None:
        """Remove the reports."""
        if self._directory is not None:
            shutil.rmtree(self._directory, ignore_errors=True)


def _state_of(path: Path) -> object:
    """Return names, sizes and times of the files of a bag, to detect changes."""
    with contextlib.suppress(OSError):
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        return [(f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files]
    return None


def _description(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {
        'name': printable(path.name),
        'start': None,
        'duration': None,
        'size': 0,
        'files': 1,
        'whole': False,
    }
    with contextlib.suppress(OSError, RecordingError):
        sizes = [file.stat().st_size for file in bag_files(path)]
        found |= {'size': sum(sizes), 'files': len(sizes)}
    with contextlib.suppress(
        *(OSError, RecordingError, LookupError, TypeError, ValueError, yaml.YAMLError),
        *(McapError, struct.error),
    ):
        if (span := _listed_span(path) if path.is_dir() else _file_span(path)) is not None:
            start_ns, duration_ns = span
            found |= {'start': start_ns / 1e9, 'duration': duration_ns / 1e9, 'whole': True}
    return found


def _listed_span(bag: Path) -> tuple[int, int] | None:
    """Return beginning and duration of a bag by its listing, ns; None if it has none."""
    listing = read_listing(bag)
    if listing is None:
        return None
    times = listing['starting_time']['nanoseconds_since_epoch'], listing['duration']['nanoseconds']
    return int(times[0]), int(times[1])


def _file_span(file: Path) -> tuple[int, int] | None:
    """Return beginning and duration of a whole MCAP file by its footer, ns; else None."""
    with file.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None:
        return None
    start_ns, end_ns = summary.statistics.message_start_time, summary.statistics.message_end_time
    return start_ns, end_ns - start_ns


def _is_bag(path: Path, place: Path) -> bool:
    """
    Return whether a path is a bag: a file, or a directory with files of one.

    Its files must lie in the directory `place`, without links out of it, and be regular files: a
    reader would wait for a pipe without end.
    """
    if path.name.startswith('.'):
        return False
    try:
        files = [path]
        if path.is_dir():
            files = [file for file in path.iterdir() if file.name.endswith((*_SUFFIXES, '.yaml'))]
        return any(file.name.endswith(_SUFFIXES) for file in files) and all(
            file.is_file() and file.resolve().is_relative_to(place) for file in files
        )
    except OSError:
        return False


def _has_bags(path: Path) -> bool:
    """Return whether there are bags that are directories in a directory."""
    children = path.iterdir() if path.is_dir() else ()
    return any(child.is_dir() and _is_bag(child, path) for child in children)


def _age(path: Path) -> float:
    try:
        return -path.stat().st_mtime
    except OSError:
        return 0.0
