# SPDX-License-Identifier: Apache-2.0
"""
What a report of a bug needs: ``python -m impact_damper_ros --version``.

The commands themselves are scripts, and modules of `impact_damper_ros.cli`.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from impact_damper_ros import __version__
from impact_damper_ros.bag.snapshots import mathematics
from impact_damper_ros.cli.command_line import outcome
from impact_damper_ros.parameters.upgrades import newest
from impact_damper_ros.rig.snapshot import ARITHMETIC, UPGRADES
from impact_damper_ros.sweep.grid import UPGRADES as SWEEP_UPGRADES

#: What the package imports, in the order of how much depends on it.
_PACKAGES = 'numpy', 'scipy', 'numba', 'llvmlite', 'mcap', 'matplotlib', 'pandas', 'tornado'


def _version_of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return 'not installed'


def _ros() -> str:
    """Return the distribution of ROS 2, the place of its Python library, and the middleware."""
    found = find_spec('rclpy')
    if found is None or found.origin is None:
        return 'not found'
    place = Path(found.origin).parents[1]
    middleware = os.environ.get('RMW_IMPLEMENTATION', 'its default middleware')
    return (
        f'{os.environ.get("ROS_DISTRO", "jazzy")}, rclpy {_version_of("rclpy")} in {place}, '
        f'{middleware}'
    )


def _system() -> str:
    try:
        name = platform.freedesktop_os_release()['PRETTY_NAME']
    except OSError:
        name = platform.system()
    return f'{name}, {platform.machine()}, {" ".join(platform.libc_ver())}'


def report_lines() -> Iterator[str]:
    """Yield the lines of the report."""
    yield f'impact_damper_ros {__version__} in {Path(__file__).parent}'
    yield f'Python {platform.python_version()} ({sys.executable})'
    yield f'system: {_system()}'
    yield f'ROS 2: {_ros()}'
    for package in _PACKAGES:
        yield f'{package}: {_version_of(package)}'
    yield (
        f'formats: bags {newest(UPGRADES)}, sweeps {newest(SWEEP_UPGRADES)}; arithmetic '
        f'{ARITHMETIC}; mathematical functions {mathematics()}'
    )


def main() -> int:
    """Print the report."""
    parser = argparse.ArgumentParser(
        'python -m impact_damper_ros',
        description=__doc__.strip().partition('\n')[0],
        epilog='The commands have a --help of their own, as in: simulate_rig --help',
    )
    parser.add_argument(
        '--version', action='store_true', help='versions of all that a result depends on'
    )
    if not parser.parse_args().version:
        parser.print_help()
        return 0
    return outcome(parser.prog, lambda: print(*report_lines(), sep='\n') or 0)


if __name__ == '__main__':
    sys.exit(main())
