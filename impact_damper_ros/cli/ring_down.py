# SPDX-License-Identifier: Apache-2.0
"""`ring_down`: release a rig, and measure the loss of each cycle."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from impact_damper_ros.orbits.ring_down import RELEASES, ring_down
from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.report.ring_down_figure import (
    ring_down_csv,
    ring_down_figure,
    ring_down_text,
)

from .command_line import (
    add_json_option,
    add_path_option,
    check_outputs,
    command_parser,
    draw,
    long_work,
    motion_size,
    number_in,
    outcome,
    text_stream,
    write_json,
    write_output,
)
from .rig_options import add_params_argument, add_set_option, given_rig, hint, rig_line

_DESCRIPTION = """\
Release the primary mass M of a rig and let it ring down, without force and with its base at rest.
From the velocity V of M at the upward passages of X through its middle: the energy that each
cycle loses, Psi = 1 - E_next/E with E = M V^2/2, over the amplitude V/omega. The release is
repeated with m let go at other phases of the vibration; the curve is the median of all cycles,
with the range of the middle 80 %.
"""
_EPILOG = """\
Exit code: 0 if done; 2 if the input is invalid; 1 if a file cannot be written; 130 on Ctrl-C, 143
on SIGTERM.
Examples:
  ring_down bench_rig --from 40mm --figure ring_down.png
  ring_down bench_rig --from 2m/s --set gap=8mm --csv cycles.csv --json ring_down.json
  ring_down bench_rig --from 3g --set angle=90deg
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('ring_down', _DESCRIPTION, _EPILOG)
    add_params_argument(parser)
    parser.add_argument(
        '--from',
        dest='start',
        type=motion_size,
        required=True,
        metavar='SIZE',
        help='first amplitude of M: a displacement, a velocity or an acceleration, with its unit',
    )
    add_set_option(parser)
    parser.add_argument(
        '--releases',
        type=number_in(1, 1000, whole=True),
        default=RELEASES,
        metavar='N',
        help=f'phases of the vibration at which m is let go [{RELEASES}]',
    )
    add_path_option(parser, '--csv', 'write every cycle as a table')
    add_json_option(parser, 'the curve over amplitude')
    add_path_option(parser, '--figure', 'draw decay and loss; .png, .svg or .pdf')
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        check_outputs(arguments, arguments.params)
        # Neither the force nor records act here.
        rig = given_rig(
            *(arguments.params, arguments.set, arguments.node),
            with_control=False,
            with_records=True,
        ).parameters
        hint('ring_down', rig)
        size, quantity = arguments.start
        amplitude = size / rig.omega ** ORDERS[quantity]
        with long_work('ring_down', 'still ringing down; Ctrl-C ends it'):
            found = ring_down(rig, amplitude, releases=int(arguments.releases))
        title = rig_line(found.parameters)
        write_json(arguments.json, found)
        write_output(arguments.csv, ring_down_csv, found)
        draw(arguments.figure, ring_down_figure, found, title)
        print(f'{title}\n{ring_down_text(found)}', file=text_stream(arguments.json))
        return 0

    return outcome('ring_down', work)


if __name__ == '__main__':
    sys.exit(main())
