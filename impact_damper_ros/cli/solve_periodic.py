"""`solve_periodic`: the periodic motions of a rig, with stability and viability, by theory."""

from __future__ import annotations

import argparse
import cmath
import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace

from impact_damper_ros.entry_points import run
from impact_damper_ros.orbits import (
    Branch,
    Continuation,
    OrbitSearch,
    PeriodicOrbit,
    SpecialKind,
    continue_orbit,
    find_orbits,
    plausible_stops,
    switch_branch,
)
from impact_damper_ros.outputs import check_file
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.quoting import counted

from .command_line import (
    CommandError,
    add_json_option,
    command_parser,
    discard_output,
    long_work,
    outcome,
    text_stream,
    up_to,
    write_json,
)
from .rig_options import add_params_argument, add_set_option, given_rig, hint, rig_line

EXIT_NONE, EXIT_NOT_VIABLE = 3, 4

_DESCRIPTION = """\
Find the periodic motions of an impact damper with N impacts in K cycles of the force, stable and
unstable, for the same parameters file as sim_node and simulate_rig. All quantities are in SI
units; velocities are absolute, along the axis, positive downwards. A phase is the time of an
impact from t = 0 in cycles of the force F sin(W t + force_phase).
"""
_EPILOG = """\
Exit code: 0 if a motion was found that the rig can perform; 3 if there is no solution; 4 if there
are solutions but none is viable (the table gives the reasons); 2 if the input is invalid; 1 if the
file cannot be written; 130 on Ctrl-C, 143 on SIGTERM.
Example: solve_periodic config/paper.yaml --impacts 2 --cycles 1 --json orbits.json --set gap=30
"""


def _stops(text: str) -> tuple[int, ...]:
    words = [word.strip() for word in text.split(',')]
    if not all(word in ('1', '2') for word in words):
        raise argparse.ArgumentTypeError(
            f'{text!r}: give the stops hit in one period, in order, such as 1,2 or 1,1,2'
        )
    return tuple(int(word) for word in words)


def _range(text: str) -> tuple[str, float, float]:
    name, _, ends = text.partition('=')
    try:
        low, high = (float(end) for end in ends.split(':'))
    except ValueError:
        low = high = math.nan
    if not low < high:
        raise argparse.ArgumentTypeError(
            f'{text!r}: give a parameter and its least and largest value, such as gap=20:60'
        )
    return name, low, high


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('solve_periodic', _DESCRIPTION, _EPILOG)
    add_params_argument(parser)
    parser.add_argument(
        '--impacts',
        type=up_to(64),
        required=True,
        metavar='N',
        help='impacts in one period, those of a chatter up to the rest',
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
        help='stops hit in one period, in order [every sequence of N impacts]',
    )
    parser.add_argument(
        '--vary',
        type=_range,
        metavar='NAME=LOW:HIGH',
        help='follow the first motion of the list while a parameter varies, and the branches '
        'that leave it at period doublings and branch points',
    )
    add_json_option(parser, 'the list of motions')
    add_set_option(parser)
    parser.add_argument('--quiet', action='store_true', help='print no table')
    return parser


def _multiplier_text(multipliers: Sequence[complex]) -> str:
    """Return the multipliers as text: real ones, and modulus and angle of each pair."""
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
    lines = [
        f'motion {number}: stops {stops} in {counted(orbit.cycles, "cycle")} '
        f'({orbit.period:.9g} s), {orbit.stability}, '
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
        for node in orbit.events
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


def _branch_text(branch: Branch) -> str:
    if not branch.orbits:
        return f'  {branch.ended}'
    swings = [orbit.x_max for orbit in branch.orbits]
    lines = [
        f'  {branch.name} from {branch.values[0]:.9g} to {branch.values[-1]:.9g}: '
        f'{counted(len(swings), "motion")}, largest |X| between {min(swings):.6g} and '
        f'{max(swings):.6g} m',
    ]
    lines.extend(
        f'  {point.kind.value} {"at" if point.converged else "near"} {branch.name} = '
        f'{point.value:.9g}' + (f': {point.reason}' if point.reason else '')
        for point in branch.special
    )
    return '\n'.join([*lines, f'  end: {branch.ended}'])


def _branch_texts(orbit: PeriodicOrbit, along: Continuation) -> Iterator[str]:
    """Yield the branch of a motion in both directions, and those that leave it."""
    name = along.name
    for upwards in (True, False):
        branch = continue_orbit(orbit, along, upwards=upwards)
        yield f'\nmotion 1, {name} {"rising" if upwards else "falling"}:\n{_branch_text(branch)}'
        for point in branch.special:
            if point.kind in (SpecialKind.PERIOD_DOUBLING, SpecialKind.BRANCH_POINT):
                leaves = switch_branch(point, replace(along, most_points=100))
                yield (
                    f'\nbranch from the {point.kind.value} at {name} = {point.value:.9g}:\n'
                    f'{_branch_text(leaves)}'
                )


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


def _slow_words(rig: RigParameters) -> str:
    return (
        'still searching; the time grows with the impacts, the cycles and the ratio of the '
        'natural frequency to that of the force, here '
        f'{rig.omega / rig.force_frequencies[0]:.3g}; Ctrl-C ends the search'
        if rig.force_frequencies[0]
        else 'still searching; Ctrl-C ends the search'
    )


def _check_found(searches: list[OrbitSearch], arguments: argparse.Namespace) -> None:
    """Raise CommandError if no motion was found that the rig can perform."""
    orbits = [orbit for search in searches for orbit in search.orbits]
    asked = f'{counted(arguments.impacts, "impact")} in {counted(arguments.cycles, "cycle")}'
    if not orbits:
        none = f'no periodic motion with {asked} was found from any start'
        if all(search.report.complete for search in searches):
            none = f'there is no periodic motion with {asked}'
        raise CommandError(
            f'{none}: try other --impacts, --cycles or --stops; simulate_rig shows what the rig '
            'does',
            EXIT_NONE,
        )
    if not any(orbit.viable for orbit in orbits):
        raise CommandError(
            f'none of the {len(orbits)} solutions with {asked} is viable; the first: '
            f'{orbits[0].reason}',
            EXIT_NOT_VIABLE,
        )


def _solve(arguments: argparse.Namespace) -> int:
    given = given_rig(arguments.params, arguments.set, with_control=False)
    if arguments.json is not None:
        check_file(arguments.json)  # before the work, not after it
    if not arguments.quiet:
        hint('solve_periodic', given.parameters)
    if arguments.vary is not None:
        along = Continuation(*arguments.vary)
        along.check_start(given.parameters)
    with long_work('solve_periodic', _slow_words(given.parameters), quiet=arguments.quiet):
        searches = _searches(given.parameters, arguments)
    orbits = [orbit for search in searches for orbit in search.orbits]
    orbits.sort(key=lambda orbit: (not orbit.viable, not orbit.stable))
    write_json(arguments.json, [orbit.as_dict() for orbit in orbits])
    if not arguments.quiet:
        texts = [textwrap.fill(rig_line(given.parameters), 99, subsequent_indent='  ')]
        texts += [search.report.text for search in searches]
        texts += ['\n' + _orbit_text(number, orbit) for number, orbit in enumerate(orbits, 1)]
        if arguments.vary is not None and orbits:
            with long_work('solve_periodic', 'still following the branch; Ctrl-C ends it'):
                texts += _branch_texts(orbits[0], along)
        try:
            print('\n'.join(texts), file=text_stream(arguments.json), flush=True)
        except BrokenPipeError:
            discard_output()
    _check_found(searches, arguments)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome('solve_periodic', lambda: _solve(arguments))


if __name__ == '__main__':
    sys.exit(run('solve_periodic', main))
