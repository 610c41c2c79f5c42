"""What the commands of the studies share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from importlib.util import find_spec
from pathlib import Path

from .command_line import add_jobs_option, add_version_option, check_directory, outcome, say

__all__ = ['make_directory', 'run_study', 'study_parser']


def study_parser(
    command: str, description: str, epilog: str, *, output: Path, quick: str
) -> argparse.ArgumentParser:
    """Return a parser with the options of all studies."""
    parser = argparse.ArgumentParser(
        command,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=output,
        metavar='DIR',
        help=f'directory of the files [{output}]',
    )
    add_jobs_option(parser)
    parser.add_argument('--quick', action='store_true', help=quick)
    add_version_option(parser)
    return parser


def make_directory(path: Path) -> None:
    """Make the output directory before the work, which takes minutes."""
    check_directory(path)
    path.mkdir(parents=True, exist_ok=True)


def run_study(command: str, work: Callable[[], int]) -> int:
    """Run a study and return the exit code."""
    if find_spec('matplotlib') is None:
        say(command, 'matplotlib is missing: install it, or the package with its extra [plot]')
        return 2
    try:
        return outcome(command, work)
    except BrokenProcessPool:
        say(command, 'a process died, perhaps for lack of memory: give fewer --jobs')
        return 1
