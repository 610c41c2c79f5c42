# SPDX-License-Identifier: Apache-2.0
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
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import yaml

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.metadata import read_listing
from impact_damper_ros.bag.run_reader import bag_files
from impact_damper_ros.parameters.quoting import printable
from impact_damper_ros.theory.child_process import environment

_SUFFIXES = ('.mcap', '.mcap.zstd', '.db3', '.db3.zstd')
_MOST_LISTED = 500
_LONGEST_NAME, _LONGEST_NOTE = 120, 2000
#: What is deleted goes there, and away when the server ends; and the file of a note.
_BIN, _NOTE = '.deleted', 'note.txt'
#: A bag without a listing that was written to within this time is being recorded, s.
_AT_WORK_S = 10.0
#: Longest comparison, s.
_PATIENCE_S = 1800.0


class Recordings:
    """
    A bag or file, or the bags below a directory.

    If `listed`, a directory without `metadata.yaml` is one of bags, whatever files are in it.
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
        """Return the path of a bag; raise a LookupError if there is no bag of that name."""
        if name not in self.names():
            raise LookupError(f'there is no recording {printable(name[:200])}')
        return self._place / name

    def file(self, name: str) -> Path:
        """Return the file to download; LookupError if there is none, or the bag has several."""
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
            'note': '',
        }
        with contextlib.suppress(OSError, UnicodeDecodeError):
            text = (path / _NOTE).read_text(encoding='utf-8').strip()
            found['note'] = printable(text[:_LONGEST_NOTE])
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

    # Changes

    def _own(self, name: str) -> Path:
        """Return the path of a bag that may be changed."""
        path = self.path(name)
        if self.single:
            raise LookupError('a bag that was given by its path is only played')
        if name in self._comparing:
            raise LookupError(f'{printable(name)} is being compared: wait for it, or cancel it')
        known = next(one for one in self.list() if one['name'] == name)
        latest = max((file.stat().st_mtime for file in _bag_files(path)), default=0.0)
        if path.is_dir() and not known['whole'] and time.time() - latest < _AT_WORK_S:
            raise LookupError(f'{printable(name)} is being recorded')
        return path

    def rename(self, name: str, new: str) -> None:
        """Give a bag another name; LookupError if that cannot be one or is taken."""
        path, new = self._own(name), new.strip()
        if path.is_file() and not new.endswith(_SUFFIXES):
            new += ''.join(path.suffixes)
        bad = new.startswith('.') or printable(new) != new or any(sign in new for sign in '/\\\n')
        if not new or bad or len(new.encode()) > _LONGEST_NAME:
            raise LookupError(
                f'{printable(new[:80])!r} cannot be a name: give up to {_LONGEST_NAME} letters, '
                'digits and signs, but no slash'
            )
        if (self._place / new).exists():
            raise LookupError(f'there is a recording {new} already')
        path.rename(self._place / new)

    def delete(self, name: str) -> None:
        """Delete a bag; until the server ends it can be restored."""
        path, deleted = self._own(name), self._place / _BIN / name
        deleted.parent.mkdir(exist_ok=True)
        if deleted.exists():
            _remove(deleted)
        path.rename(deleted)

    def restore(self, name: str) -> None:
        """Bring a deleted bag back; LookupError if another one has its name by now."""
        deleted = self._place / _BIN / name
        if '/' in name or name in ('', '.', '..') or not deleted.exists():
            raise LookupError(f'no recording {printable(name[:200])} has been deleted')
        if (self._place / name).exists():
            raise LookupError(f'there is another recording {printable(name)} by now')
        deleted.rename(self._place / name)

    def note(self, name: str, text: str) -> None:
        """Keep a note with a bag, which is a directory."""
        path = self._own(name)
        if not path.is_dir():
            raise LookupError(f'{printable(name)} is a file, which has no room for a note')
        if text.strip():
            (path / _NOTE).write_text(text.strip()[:_LONGEST_NOTE] + '\n', encoding='utf-8')
        else:
            (path / _NOTE).unlink(missing_ok=True)

    # Comparison

    def report(self, name: str, file: str) -> Path:
        """Return a file of a report; LookupError if there is none."""
        if self._reports is None or file not in ('report.html', 'report.json'):
            raise LookupError('there is no such report')
        path = self._reports / self.path(name).name / file
        if not path.is_file():
            raise LookupError('there is no such report')
        return path

    def start_comparison(self, name: str) -> None:
        """Note that a bag is being compared; LookupError if it is already, or two others are."""
        if name in self._comparing or len(self._comparing) > 1:
            raise LookupError('it is being compared already, or two others are: wait for them')
        self._comparing[name] = None

    def cancel_comparison(self, name: str) -> None:
        """End a comparison, if there is one."""
        process = self._comparing.get(name)
        if process is not None and process.returncode is None:
            process.terminate()

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
        """Remove the reports, and what was deleted."""
        _remove(self._place / _BIN)
        if self._reports is not None:
            shutil.rmtree(self._reports, ignore_errors=True)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


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
