"""What all commands do alike: their version, the rig in a line, errors on the terminal."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from impact_damper_ros import __version__
from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.description import described, frequency_hint
from impact_damper_ros.rig.presets import presets
from impact_damper_ros.rig.shown import printable

__all__ = [
    'add_params_argument',
    'add_version_option',
    'announce',
    'hint',
    'rig_line',
    'say',
]


def add_version_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--version``."""
    parser.add_argument(
        '--version', action='version', version=f'{parser.prog} (impact_damper_ros) {__version__}'
    )


def add_params_argument(parser: argparse.ArgumentParser) -> None:
    """Let a command take the parameters file of a rig."""
    parser.add_argument(
        'params',
        type=Path,
        metavar='PARAMS',
        help=f'ROS 2 parameters file of the rig, or a preset: {", ".join(presets())}',
    )


def say(command: str, message: object) -> None:
    """Print a line about a command to the standard error."""
    print(printable(f'{command}: {message}'), file=sys.stderr)


def rig_line(rig: RigParameters, control: GapControlParameters | None = None) -> str:
    """Return the rig that a command works on in a line, with its gap control."""
    text = described(rig)
    if control is not None and control.active:
        text += f'; gap control {control.gap_control}'
    return text


def announce(
    command: str,
    rig: RigParameters,
    control: GapControlParameters | None = None,
    *,
    frequencies: tuple[float, float] | None = None,
) -> None:
    """
    Say which rig a command works on, before it does, and whether a frequency may be in Hz.

    Parameters
    ----------
    command : str
        Its name.
    rig : RigParameters
        The rig.
    control : GapControlParameters, optional
        Its gap control.
    frequencies : tuple of float, optional
        Lowest and highest frequency of the first harmonic, rad/s, if it is varied.
    """
    say(command, rig_line(rig, control))
    hint(command, rig, frequencies)


def hint(command: str, rig: RigParameters, frequencies: tuple[float, float] | None = None) -> None:
    """Say whether a frequency may be in Hz, as `announce` does."""
    if note := frequency_hint(rig, frequencies):
        say(command, f'note: {note}')
