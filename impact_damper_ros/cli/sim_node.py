# SPDX-License-Identifier: Apache-2.0
"""`sim_node`: the rig as a ROS 2 node, whose arguments ROS reads."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from impact_damper_ros.node.usage import answer
from impact_damper_ros.parameters.parameters_file import presets
from impact_damper_ros.parameters.quoting import quote

from .command_line import EXIT_INPUT, MISSING_ROS, outcome, say


def _missing(words: Sequence[str]) -> str:
    """Return a message if ROS or a parameters file is missing; else an empty text."""
    if find_spec('rclpy') is None:
        return MISSING_ROS
    for option, name in pairwise(words):
        if option == '--params-file' and not Path(name).is_file():
            known = presets()
            example = known.get(name, known['bench_rig'])
            return (
                f'--params-file {quote(name)}: there is no such file; give the path of a '
                f'parameters file, such as {example}'
            )
    return ''


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node."""
    words = sys.argv[1:] if argv is None else argv
    if answer(words):
        return outcome('sim_node', lambda: 0)
    if missing := _missing(words):
        say('sim_node', missing)
        return EXIT_INPUT
    # Imported here: ROS takes a second to import.
    from impact_damper_ros.node.sim_node import main as run

    # `outcome` reports an output that cannot be written.
    return run(argv) or outcome('sim_node', lambda: 0)


if __name__ == '__main__':
    sys.exit(main())
