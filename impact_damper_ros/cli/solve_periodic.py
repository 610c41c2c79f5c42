"""`solve_periodic`: the periodic motions of a rig, with stability and viability, by theory."""

from __future__ import annotations

import argparse
import cmath
import math
import sys
import textwrap
from collections.abc import Sequence

from impact_damper_ros.entry_points import run
from impact_damper_ros.orbits import OrbitSearch, PeriodicOrbit, find_orbits, plausible_stops
from impact_damper_ros.outputs import check_file
from impact_damper_ros.rig import RigParameters

from .command_line import (
    add_json_option,
    command_parser,
    discard_output,
    outcome,
    say,
    text_stream,
    up_to,
    write_json,
)
from .rig_options import add_params_argument, add_set_option, given_rig, hint, rig_line

__all__ = ['main']


EXIT_NONE, EXIT_NOT_VIABLE = 3, 4

_DESCRIPTION = """\
Solve for the periodic motions of an impact damper with N impacts in K cycles of the force, stable
and unstable, from the same parameters file as sim_node and simulate_rig. All quantities are in SI
units; velocities are absolute, along the axis, positive downwards. Phases are impact times in
cycles of the force, whose own phase counts: F sin(W t + force_phase).
"""
_EPILOG = """\
Exit code: 0 if a motion was found that the rig can perform; 3 if there is no solution; 4 if there
are solutions but none is viable (the table says why); 2 if the input is not usable; 1 if the file
could not be written.
Example: solve_periodic config/paper.yaml --impacts 2 --cycles 1 --json orbits.json --set gap=30
"""


def _stops(text: str) -> tuple[int, ...]:
    words = [word.strip() for word in text.split(',')]
    if not all(word in ('1', '2') for word in words):
        raise argparse.ArgumentTypeError(
            f'{text!r}: give the stops hit in one period, in order, such as 1,2 or 1,1,2'
        )
    return tuple(int(word) for word in words)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('solve_periodic', _DESCRIPTION, _EPILOG)
    add_params_argument(parser)
    parser.add_argument(
        '--impacts', type=up_to(64), required=True, metavar='N', help='impacts in one period'
    )
    parser.add_argument(
        '--cycles',
        type=up_to(64),
        default=1,
        metavar='K',
        help='period in cycles of the force [1]',
    )
    parser.add_argument(
        '--stops',
        type=_stops,
        metavar='1,2,...',
        help='stops hit in one period, in order [every sequence of N impacts; 1 for N = 1]',
    )
    add_json_option(parser, 'the list of motions')
    add_set_option(parser)
    parser.add_argument('--quiet', action='store_true', help='no table')
    return parser


def _multiplier_text(multipliers: Sequence[complex]) -> str:
    """Return moduli, pairs once, with their angles."""
    words = []
    for value in multipliers:
        if value.imag < 0.0:
            continue
        if value.imag > 0.0:
            degrees = math.degrees(cmath.phase(value))
            words.append(f'{abs(value):.6f} (pair at +-{degrees:.2f} deg)')
        else:
            words.append(f'{value.real:.6f}')
    return ', '.join(words)


def _orbit_text(number: int, orbit: PeriodicOrbit) -> str:
    stops = ','.join(map(str, orbit.stops))
    cycles = f'{orbit.cycles} cycle' + ('s' if orbit.cycles > 1 else '')
    verdict = 'stable' if orbit.stable else 'unstable'
    lines = [
        f'motion {number}: stops {stops} in {cycles} ({orbit.period:.9g} s), {verdict}, '
        + ('viable' if orbit.viable else 'NOT VIABLE'),
        "  stop  phase [cycles]         X [m]   X' before    X' after   Z' before    Z' after "
        '[m/s]',
    ]
    lines.extend(
        f'  {stop:4d}  {phase:14.9f}  {x:12.7f} {vb:12.7f} {va:12.7f} {ub:12.7f} {ua:12.7f}'
        for stop, phase, x, vb, va, ub, ua in zip(
            orbit.stops,
            orbit.phases,
            orbit.x,
            orbit.primary_velocity_before,
            orbit.primary_velocity_after,
            orbit.damper_velocity_before,
            orbit.damper_velocity_after,
            strict=True,
        )
    )
    lines.extend(
        f'        {node.phase:14.9f}  {node.kind.name.lower()}'
        + (f' on stop {node.stop}' if node.stop else '')
        for node in orbit.nodes
    )
    swing = f'  largest |X|  {orbit.x_max:.9g} m'
    amplitude = orbit.parameters.response_amplitude
    if 0.0 < amplitude < math.inf:
        swing += f', {orbit.amplitude_ratio:.7f} of the {amplitude:.7g} m without impacts'
    lines.append(swing)
    lines.append(f'  multipliers  {_multiplier_text(orbit.multipliers)}')
    steps = len(orbit.residual_history) - 1
    lines.append(f'  residual     {orbit.residual:.1e} (relative) after {steps} Newton steps')
    if orbit.reason:
        lines.append(f'  not viable   {orbit.reason}')
    return '\n'.join(lines)


def _searches(parameters: RigParameters, arguments: argparse.Namespace) -> list[OrbitSearch]:
    if arguments.stops is not None and len(arguments.stops) != arguments.impacts:
        raise ValueError(
            f'--stops {",".join(map(str, arguments.stops))} names {len(arguments.stops)} impacts '
            f'but --impacts is {arguments.impacts}: give the stop of each impact in a period'
        )
    sequences = (
        [arguments.stops]
        if arguments.stops is not None
        else plausible_stops(parameters, arguments.impacts)
    )
    return [find_orbits(parameters, stops, arguments.cycles) for stops in sequences]


def _verdict(searches: list[OrbitSearch], arguments: argparse.Namespace) -> tuple[int, str]:
    """Return the exit code, and what to say if it is not 0."""
    orbits = [orbit for search in searches for orbit in search.orbits]
    asked = f'{arguments.impacts} impacts in {arguments.cycles} cycles'
    if not orbits:
        certain = all(search.report.complete for search in searches)
        return EXIT_NONE, (
            f'no periodic motion with {asked}'
            + ('' if certain else ' was found from any start')
            + ': try other --impacts, --cycles or --stops; simulate_rig shows what the rig does'
        )
    if not any(orbit.viable for orbit in orbits):
        return EXIT_NOT_VIABLE, (
            f'none of the {len(orbits)} solutions with {asked} is viable; the first: '
            f'{orbits[0].reason}'
        )
    return 0, ''


def _solve(arguments: argparse.Namespace) -> int:
    given = given_rig(arguments.params, arguments.set, with_control=False)
    if arguments.json is not None:
        check_file(arguments.json)  # before the work, not after it
    if not arguments.quiet:
        hint('solve_periodic', given.parameters)
    searches = _searches(given.parameters, arguments)
    orbits = [orbit for search in searches for orbit in search.orbits]
    orbits.sort(key=lambda orbit: (not orbit.viable, not orbit.stable))
    write_json(arguments.json, [orbit.as_dict() for orbit in orbits])
    if not arguments.quiet:
        texts = [textwrap.fill(rig_line(given.parameters), 99, subsequent_indent='  ')]
        texts += [search.report.text for search in searches]
        texts += ['\n' + _orbit_text(number, orbit) for number, orbit in enumerate(orbits, 1)]
        try:
            print('\n'.join(texts), file=text_stream(arguments.json), flush=True)
        except BrokenPipeError:
            discard_output()
    code, complaint = _verdict(searches, arguments)
    if complaint:
        say('solve_periodic', complaint)
    return code


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome('solve_periodic', lambda: _solve(arguments))


if __name__ == '__main__':
    sys.exit(run('solve_periodic', main))
