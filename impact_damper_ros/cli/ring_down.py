# SPDX-License-Identifier: Apache-2.0
"""`ring_down`: release a rig, and measure what each cycle loses."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import NamedTuple

from impact_damper_ros.orbits.ring_down import RELEASES, ring_down
from impact_damper_ros.outputs import write_text
from impact_damper_ros.parameters.base_motion import QUANTITIES, quantity_of
from impact_damper_ros.parameters.quoting import shown
from impact_damper_ros.parameters.units import UNITS, in_si, split_number

from .command_line import (
    add_json_option,
    add_path_option,
    check_outputs,
    command_parser,
    long_work,
    need_matplotlib,
    number,
    outcome,
    text_stream,
    write_json,
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


class _Start(NamedTuple):
    """A first amplitude of displacement, velocity or acceleration, in SI."""

    size: float
    quantity: str

    def amplitude(self, omega: float) -> float:
        """Return the amplitude of the displacement, m."""
        power = list(QUANTITIES).index(self.quantity)
        return float(self.size / omega**power)


def _start(text: str) -> _Start:
    size, unit, _ = split_number(text)
    names = [name for units in QUANTITIES.values() for name in UNITS[units]]
    if size is None or not size > 0.0 or unit not in names:
        raise argparse.ArgumentTypeError(
            f'{shown(text)}: give a positive displacement, velocity or acceleration of M with its '
            'unit, such as 10mm, 2m/s or 3g'
        )
    quantity = quantity_of(unit)
    return _Start(in_si(size, UNITS[QUANTITIES[quantity]][unit]), quantity)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('ring_down', _DESCRIPTION, _EPILOG)
    add_params_argument(parser)
    parser.add_argument(
        '--from',
        dest='start',
        type=_start,
        required=True,
        metavar='SIZE',
        help='first amplitude of M: a displacement, a velocity or an acceleration, with its unit',
    )
    add_set_option(parser)
    parser.add_argument(
        '--releases',
        type=number(1, 1000, whole=True),
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
        if arguments.figure is not None:
            need_matplotlib()
        rig = given_rig(
            arguments.params, arguments.set, arguments.node, with_control=False
        ).parameters
        hint('ring_down', rig)
        amplitude = arguments.start.amplitude(rig.omega)
        with long_work('ring_down', 'still ringing down; Ctrl-C ends it'):
            found = ring_down(rig, amplitude, releases=int(arguments.releases))
        if not found.runs:
            raise ValueError(
                f'from {amplitude:.4g} m M does not swing up once: give a larger amplitude'
            )
        from impact_damper_ros.report.ring_down_figure import (
            ring_down_figure,
            ring_down_table,
            ring_down_text,
        )

        title = rig_line(found.parameters)
        write_json(arguments.json, found.as_dict())
        if arguments.csv is not None:
            write_text(arguments.csv, ring_down_table(found))
        if arguments.figure is not None:
            from impact_damper_ros.report.drawing import save_figure

            save_figure(ring_down_figure(found, title), arguments.figure)
        print(f'{title}\n{ring_down_text(found)}', file=text_stream(arguments.json))
        return 0

    return outcome('ring_down', work)


if __name__ == '__main__':
    sys.exit(main())
