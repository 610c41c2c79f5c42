"""What the node answers on its command line, and why it does not start."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from impact_damper_ros import __version__
from impact_damper_ros.rig.guarded_yaml import YamlError, check_yaml
from impact_damper_ros.rig.shown import printable, shown

__all__ = ['answer_foreign', 'check_params_files', 'in_words', 'refuse']

USAGE = """usage: sim_node [-h] [--version]
                [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] ...]

The digital rig of an impact damper as a ROS 2 node. For instance:
  sim_node --ros-args -p gap:=30 -p record:=true -r __ns:=/rig1
Parameters, with unit and range: ros2 param describe /sim_node NAME"""


def refuse(reason: object) -> int:
    """Say why the node does not start, and return the exit code."""
    print(printable(f'sim_node: cannot start: {reason}'), file=sys.stderr)
    return 1


def answer_foreign(arguments: Sequence[str]) -> int | None:
    """Answer arguments that are not for ROS; None if there are none."""
    if not arguments:
        return None
    if arguments[0] in ('-h', '--help'):
        print(USAGE)
        return 0
    if arguments[0] == '--version':
        print(f'sim_node (impact_damper_ros) {__version__}')
        return 0
    return refuse(
        f'unknown argument {shown(arguments[0])}; parameters and remappings follow --ros-args, as '
        'in: sim_node --ros-args -p gap:=30'
    )


def check_params_files(arguments: Sequence[str]) -> None:
    """
    Check the files that follow ``--params-file``, before ROS reads them.

    Its parser refuses aliases by itself, but takes a minute for some ten thousand entries, and of
    a name that stands there twice the last value.

    Raises
    ------
    ValueError
        If one of them is not sensible; the message names it, the line and the remedy.
    """
    for option, name in pairwise(arguments):
        if option == '--params-file':
            with suppress(OSError):  # ROS says so
                try:
                    check_yaml(Path(name))
                except YamlError as error:
                    raise ValueError(f'{name}: {error}') from None


def in_words(error: Exception) -> str:
    """Shorten what rcl says about arguments it cannot parse to its two telling parts."""
    text = str(error).split(', at /')[0].removeprefix('failed to initialize rcl: ')
    if 'Sequence should be of same type' in text:
        text += ' (write [1.0, 0.5], not [1, 0.5])'
    return text
