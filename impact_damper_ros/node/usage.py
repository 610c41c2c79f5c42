# SPDX-License-Identifier: Apache-2.0
"""Usage and version of the node, which need no rig and no ROS."""

from __future__ import annotations

from collections.abc import Sequence

from impact_damper_ros import __version__

USAGE = """usage: sim_node [-h] [--version]
                [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] ...]

The digital rig of an impact damper as a ROS 2 node. For instance:
  sim_node --ros-args --params-file rig.yaml -p gap:=12mm -p record:=true -r __ns:=/rig1
Parameters, with unit and range: ros2 param describe /sim_node NAME"""


def answer(arguments: Sequence[str]) -> bool:
    """Print usage or version if the first argument requests it."""
    texts = {'--version': f'sim_node (impact_damper_ros) {__version__}'}
    text = {'-h': USAGE, '--help': USAGE, **texts}.get(arguments[0]) if arguments else None
    if text is not None:
        print(text)
    return text is not None
