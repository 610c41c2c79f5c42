"""
The recordings that the page lists, plays, downloads and compares.

Only the bags directly in one directory are accessible, by name; no request contains a path.
"""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import yaml

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.metadata import read_listing
from impact_damper_ros.bag.run_reader import bag_files
from impact_damper_ros.rig.quoting import printable
from impact_damper_ros.theory.child_process import environment

_SUFFIXES = ('.mcap', '.mcap.zstd', '.db3', '.db3.zstd')
_MOST_LISTED = 500
#: Longest comparison, s.
_PATIENCE_S = 1800.0


class Recordings:
    """
    The bags below a directory.

    Parameters
    ----------
    place : Path
        A directory of bags, or a single bag or file.
    listed : bool, optional
        Whether a directory without `metadata.yaml` is one of bags, whatever files are in it.
    """

    def __init__(self, place: Path, *, listed: bool = False) -> None:
        self._place = place.absolute()
        #: Name of the bag, if it is a single one.
        self.single = ''
        whole = self._place.is_file() or (self._place / 'metadata.yaml').is_file()
        if _is_bag(self._place) and (whole or not (listed or _has_bags(self._place))):
            self.single, self._place = self._place.name, self._place.parent
        self._reports: Path | None = None
        #: Comparisons that are under way, with their processes once those run
        self._comparing: dict[str, asyncio.subprocess.Process | None] = {}
        # What has been read of each bag, and the files that it was read of
        self._known: dict[str, tuple[object, dict[str, Any]]] = {}

    def names(self) -> list[str]:
        """Return the names of the bags, the newest first."""
        if self.single:
            return [self.single]
        try:
            found = [path for path in self._place.iterdir() if _is_bag(path)]
        except OSError:
            return []
        return [path.name for path in sorted(found, key=_age)][:_MOST_LISTED]

    def path(self, name: str) -> Path:
        """
        Return the path of a bag.

        Raises
        ------
        LookupError
            If there is no bag of that name.
        """
        if name not in self.names():
            raise LookupError(f'there is no recording {printable(name[:200])}')
        return self._place / name

    def file(self, name: str) -> Path:
        """
        Return the file to download: the only one of a bag.

        Raises
        ------
        LookupError
            If there is none, or the bag has several.
        """
        try:
            files = bag_files(self.path(name))
        except RecordingError as error:
            raise LookupError(str(error)) from error
        if len(files) != 1:
            raise LookupError(f'{name} has {len(files)} files: copy its directory')
        # Neither the bag nor its file may lead out of the directory.
        if not files[0].resolve().is_relative_to(self._place.resolve()):
            raise LookupError(f'{name} is not in the directory of the recordings')
        return files[0]

    def list(self) -> list[dict[str, Any]]:
        """Return name, start, duration and size of each recording."""
        names = self.names()
        found = []
        for name in names:
            files = self._files(name)
            known = self._known.get(name)
            if known is None or known[0] != files:
                known = self._known[name] = files, self._described(name)
            found.append(known[1])
        for name in self._known.keys() - set(names):
            self._known.pop(name, None)
        return found

    def _files(self, name: str) -> object:
        """Return names, sizes and times of the files of a bag, to detect changes."""
        path = self._place / name
        with contextlib.suppress(OSError):
            files = sorted(path.iterdir()) if path.is_dir() else [path]
            return [(f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files]
        return None

    def _described(self, name: str) -> dict[str, Any]:
        path = self._place / name
        found: dict[str, Any] = {
            'name': name,
            'title': printable(name),
            'start': None,
            'duration': None,
            'size': 0,
            'whole': False,
        }
        with contextlib.suppress(OSError, RecordingError):
            found['size'] = sum(file.stat().st_size for file in bag_files(path))
        with contextlib.suppress(
            OSError, RecordingError, LookupError, TypeError, ValueError, yaml.YAMLError
        ):
            listing = read_listing(path) if path.is_dir() else None
            if listing is not None:
                found['start'] = int(listing['starting_time']['nanoseconds_since_epoch']) / 1e9
                found['duration'] = int(listing['duration']['nanoseconds']) / 1e9
                found['whole'] = True
        return found

    # Comparison

    def report(self, name: str, file: str) -> Path:
        """
        Return a file of a report.

        Raises
        ------
        LookupError
            If there is none.
        """
        if self._reports is None or file not in ('report.html', 'report.json'):
            raise LookupError('there is no such report')
        path = self._reports / self.path(name).name / file
        if not path.is_file():
            raise LookupError('there is no such report')
        return path

    def start_comparison(self, name: str) -> bool:
        """Return whether a comparison may start: a bag is compared only once at a time."""
        if name in self._comparing or len(self._comparing) > 1:
            return False
        self._comparing[name] = None
        return True

    def cancel_comparison(self, name: str) -> bool:
        """End a comparison; return whether there was one."""
        process = self._comparing.get(name)
        if process is not None and process.returncode is None:
            process.terminate()
        return name in self._comparing

    async def compare(self, path: Path) -> dict[str, Any]:
        """Compare a bag with theory in a child process; return the message for the pages."""
        name = path.name
        try:
            ok, text = await self._compare(path)
        finally:
            self._comparing.pop(name, None)
        url = f'/reports/{quote(name, safe="")}/report.html' if ok else ''
        return {'type': 'compare_done', 'recording': name, 'ok': ok, 'url': url, 'text': text}

    async def _compare(self, path: Path) -> tuple[bool, str]:
        name = path.name
        if self._reports is None:
            self._reports = Path(tempfile.mkdtemp(prefix='impact_damper_reports_'))
        directory = self._reports / path.name
        process = await asyncio.create_subprocess_exec(
            *('nice', '-n', '5', sys.executable, '-m', 'impact_damper_ros.cli.compare_run'),
            *(str(path), '--json', str(directory.with_suffix('.json'))),
            *('--report', str(directory)),
            env=environment(),
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
        text = printable(output.decode(errors='replace'))[-4000:]
        return (directory / 'report.html').is_file(), text

    def close(self) -> None:
        """Remove the reports."""
        if self._reports is not None:
            shutil.rmtree(self._reports, ignore_errors=True)


def _is_bag(path: Path) -> bool:
    if path.name.startswith('.'):
        return False
    if path.is_file():
        return path.name.endswith(_SUFFIXES)
    return path.is_dir() and any(True for _ in _bag_files(path))


def _has_bags(path: Path) -> bool:
    """Return whether there are bags that are directories in a directory."""
    children = path.iterdir() if path.is_dir() else ()
    return any(child.is_dir() and _is_bag(child) for child in children)


def _bag_files(path: Path) -> Iterator[Path]:
    with contextlib.suppress(OSError):
        yield from (file for file in path.iterdir() if file.name.endswith(_SUFFIXES))


def _age(path: Path) -> float:
    try:
        return -path.stat().st_mtime
    except OSError:
        return 0.0
