# SPDX-License-Identifier: Apache-2.0
"""`solve_periodic`: the periodic motions of a rig by theory, with stability and viability."""

from __future__ import annotations

import argparse
import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from impact_damper_ros.orbits.arguments import (
    check_forcing,
    period_of_force,
    plausible_stops,
    repeats_after,
)
from impact_damper_ros.orbits.branch import Branch, SpecialKind
from impact_damper_ros.orbits.continuation import follow, switch_branch
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.recurrence import LONGEST_PERIOD, MotionKind
from impact_damper_ros.orbits.search import SAME, OrbitSearch, find_orbits
from impact_damper_ros.orbits.settled_motion import SettledMotion, settle
from impact_damper_ros.orbits.solved_orbits import transmissibility
from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.orbits.varied_parameter import value_of
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters
from impact_damper_ros.report.branch_figure import branch_figure
from impact_damper_ros.report.orbit_text import branch_table, branch_text, orbit_text
from impact_damper_ros.rig.rig import Rig

from .command_line import (
    CommandError,
    add_json_option,
    add_path_option,
    check_outputs,
    command_parser,
    discard_output,
    draw,
    long_work,
    number_in,
    outcome,
    text_stream,
    write_json,
    write_output,
)
from .rig_options import GivenRig, add_params_argument, add_set_option, given_rig, hint, rig_line

EXIT_NONE, EXIT_NOT_VIABLE = 3, 4

_DESCRIPTION = """\
Find the periodic motions of an impact damper with N impacts in K cycles of the force, stable and
unstable, or the one that it settles into (--settled), and follow it while a parameter varies
(--follow). The parameters file is that of sim_node and simulate_rig. All quantities are in SI
units; velocities are absolute, along the axis, positive downwards. A phase is the time of an
impact from t = 0 in cycles of the force F sin(Omega t + phi): of force_amplitudes,
force_frequencies and force_phases.
"""
_EPILOG = """\
Exit code: 0 if a motion was found that the rig can perform; 3 if there is no solution, or the rig
does not settle into a periodic motion; 4 if there are solutions but none is viable (the table
gives the reasons); 2 if the input is invalid; 1 if a file cannot be written; 130 on Ctrl-C, 143 on
SIGTERM.
Examples:
  solve_periodic bench_rig --impacts 2 --cycles 1 --json orbits.json --set gap=0.03
  solve_periodic bench_rig --impacts 1:4 --cycles 1:3 --viable
  solve_periodic bench_rig --settled
  solve_periodic paper --impacts 2 --follow gap=20:60 --csv gap.csv --figure gap.png
"""


def _stops(text: str) -> tuple[int, ...]:
    words = [word.strip() for word in text.split(',')]
    if not all(word in ('1', '2') for word in words):
        raise argparse.ArgumentTypeError(
            f'{text!r}: give the stops hit in one period, in order, such as 1,2 or 1,1,2'
        )
    return tuple(int(word) for word in words)


def _counts(text: str) -> range:
    ends = [number_in(1, 64, whole=True)(word) for word in text.split(':')]
    if len(ends) > 2 or ends[0] > ends[-1]:
        raise argparse.ArgumentTypeError(f'{text!r}: give a number, or a range such as 1:4')
    return range(int(ends[0]), int(ends[-1]) + 1)


def _range(text: str) -> tuple[str, float, float]:
    name, _, ends = text.partition('=')
    try:
        spec = PARAMETER_SPECS.get(name)
        read = float if spec is None or spec.low is None else spec.in_si
        low, high = (read(end) for end in ends.split(':'))
    except ParameterError as error:
        raise argparse.ArgumentTypeError(f'{text!r}: {error}') from error
    except ValueError:
        low = high = math.nan
    if not low < high:
        raise argparse.ArgumentTypeError(
            f'{text!r}: give a parameter and its least and largest value, such as gap=20:60'
        )
    return name, low, high


#: See `needs`.
NEEDS = (
    *(('--csv', '--follow'), ('--figure', '--follow')),
    *(('--cycles', 'no --settled'), ('--stops', 'no --settled')),
)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('solve_periodic', _DESCRIPTION, _EPILOG, NEEDS)
    add_params_argument(parser)
    sought = parser.add_mutually_exclusive_group(required=True)
    sought.add_argument(
        '--impacts',
        type=_counts,
        metavar='N',
        help='impacts in one period, or a range such as 1:4; of a chatter, those before the rest',
    )
    sought.add_argument(
        '--settled',
        action='store_true',
        help='the motion that the rig settles into from its initial conditions: period and stops '
        'are taken from it',
    )
    parser.add_argument(
        '--cycles',
        type=_counts,
        default=range(1, 2),
        metavar='K',
        help='period in cycles of the force, or a range such as 1:3 [1]',
    )
    parser.add_argument(
        '--stops',
        type=_stops,
        metavar='1,2,...',
        help='stops hit in one period, in order [every sequence of N impacts]',
    )
    parser.add_argument(
        '--viable',
        action='store_true',
        help='list only the motions that the rig can perform, and the one that it settles into '
        'from its initial conditions',
    )
    parser.add_argument(
        '--follow',
        type=_range,
        metavar='NAME=LOW:HIGH',
        help='follow the first motion of the list while a parameter varies, and the branches '
        'that leave it at period doublings and branch points',
    )
    add_path_option(parser, '--csv', 'with --follow, write the branches to a table (17 digits)')
    add_path_option(
        parser, '--figure', 'with --follow, draw the branches; a .png, .svg or .pdf file'
    )
    add_json_option(parser, 'the list of motions')
    add_set_option(parser)
    parser.add_argument('--quiet', action='store_true', help='print no table')
    return parser


def _branches(
    orbit: PeriodicOrbit, name: str, low: float, high: float
) -> Iterator[tuple[str, Branch]]:
    """Yield the branch of a motion, and the branches that leave it, each with a title."""
    branch = follow(orbit, name, low, high)
    yield 'motion 1', branch
    for point in branch.special:
        if point.kind in (SpecialKind.PERIOD_DOUBLING, SpecialKind.BRANCH_POINT):
            title = f'branch from the {point.kind.value} at {name} = {point.value:.9g}'
            yield title, switch_branch(point, name, low, high, most_points=100)


class _Search(NamedTuple):
    """The motions with a number of impacts in a number of cycles, by sequence of stops."""

    impacts: int
    cycles: int
    found: dict[tuple[int, ...], OrbitSearch]

    @property
    def orbits(self) -> list[PeriodicOrbit]:
        """The motions of all sequences."""
        return [orbit for one in self.found.values() for orbit in one.orbits]

    @property
    def complete(self) -> bool:
        """Whether these are all motions."""
        return all(one.report.complete for one in self.found.values())

    @property
    def text(self) -> str:
        """Numbers of the motions in a line."""
        viable = sum(orbit.viable for orbit in self.orbits)
        return (
            f'{plural(self.impacts, "impact")} in {plural(self.cycles, "cycle")}: '
            f'{viable} viable, {len(self.orbits) - viable} not'
            + (', all solutions' if self.complete else '')
        )


def _stops_text(stops: tuple[int, ...], search: OrbitSearch) -> str:
    """Return the number of motions of a stop sequence, in a line."""
    complete, starts, converged = search.report
    line = f'stops {",".join(map(str, stops))}: '
    if complete:
        return f'{line}all solutions, {len(search.orbits)} found'
    found = len(search.orbits)
    these = 'these, or to ' if found else ''
    led = f', to {these}motions of other stops or fewer impacts' if converged else ''
    return f'{line}{found} found; {converged} of {starts} starts converged{led}'


def _settled_text(found: SettledMotion) -> str:
    """Return the motion into which the rig settles, in a line."""
    assert found.rhythm is not None
    assert found.period is not None
    return (
        f'after {found.cycles} cycles of the force the rig repeats to within '
        f'{found.period.level:.1e}: {plural(found.rhythm.impacts, "impact")} in '
        f'{plural(found.rhythm.cycles, "cycle")}'
    )


def _settled_orbit(given: GivenRig) -> tuple[SettledMotion, PeriodicOrbit]:
    """Return the motion into which a rig settles, and that of theory; or raise CommandError."""
    period_of_force(given.parameters, LONGEST_PERIOD)
    found = settle(Rig(given.parameters, given.initial, compiled=None))
    if found.reason:
        raise CommandError(f'the rig has too many events to settle: {found.reason}', EXIT_NONE)
    if found.kind is not MotionKind.PERIODIC:
        why = f'its motion is {found.kind.value} after {found.cycles} cycles of the force'
        if found.indications is not None:
            why += f' (Lyapunov exponent {found.indications.exponent:+.3g} per cycle)'
        raise CommandError(
            f'the rig does not settle into a periodic motion with impacts: {why}; try other '
            'initial conditions, or --impacts and --cycles',
            EXIT_NONE,
        )
    if found.orbit is None:
        raise CommandError(
            f'{_settled_text(found)}, but the solver finds no such motion: try --impacts, '
            '--cycles and --stops',
            EXIT_NONE,
        )
    return found, found.orbit


def _searches(parameters: RigParameters, arguments: argparse.Namespace) -> list[_Search]:
    """Search for the motions with each requested number of impacts and of cycles."""
    stops, impacts = arguments.stops, arguments.impacts
    if stops is not None and impacts != range(len(stops), len(stops) + 1):
        raise ValueError(
            f'--stops {",".join(map(str, stops))} names {len(stops)} impacts but --impacts is '
            f'{_span(impacts)}: give the stop of each impact in a period'
        )
    sequences = {n: [stops] if stops else plausible_stops(parameters, n) for n in impacts}
    periods = [cycles for cycles in arguments.cycles if repeats_after(parameters, cycles)]
    if not periods:
        check_forcing(parameters, arguments.cycles[-1])
    return [
        _Search(n, k, {word: find_orbits(parameters, word, k) for word in sequences[n]})
        for k in periods
        for n in impacts
    ]


def _with_settled(
    given: GivenRig, orbits: list[PeriodicOrbit], arguments: argparse.Namespace
) -> list[str]:
    """Add the motion into which a rig settles, if it is new; report the end of the search."""
    where = (
        f'the search ends at {plural(arguments.impacts[-1], "impact")} and '
        f'{plural(arguments.cycles[-1], "cycle")}: there may be other motions beyond'
    )
    try:
        settled, orbit = _settled_orbit(given)
    except CommandError as error:
        return [f'from its initial conditions {error}', where]
    text = _settled_text(settled)
    if min(map(orbit.distance, orbits), default=math.inf) > SAME:
        orbits.append(orbit)
        text += ', added to the list'
    return [f'from its initial conditions, {text}', where]


def _span(counts: range) -> str:
    return str(counts[0]) if len(counts) == 1 else f'{counts[0]} to {counts[-1]}'


def _reports(searches: Sequence[_Search]) -> list[str]:
    """Print the results of a search: a line for each sequence of stops, or for each period."""
    if len(searches) == 1:
        return [_stops_text(*item) for item in searches[0].found.items()]
    return [search.text for search in searches]


def _slow_words(rig: RigParameters) -> str:
    return (
        'still searching; the time grows with the impacts, the cycles and the ratio of the '
        'natural frequency to that of the force, here '
        f'{rig.omega / rig.first_harmonic[1]:.3g}; Ctrl-C ends the search'
        if rig.first_harmonic[1]
        else 'still searching; Ctrl-C ends the search'
    )


def _check_found(searches: Sequence[_Search], arguments: argparse.Namespace) -> None:
    """Raise CommandError if no motion was found that the rig can perform."""
    orbits = [orbit for search in searches for orbit in search.orbits]
    asked = (
        f'{_span(arguments.impacts)} impact{"s" * (arguments.impacts[-1] > 1)} in '
        f'{_span(arguments.cycles)} cycle{"s" * (arguments.cycles[-1] > 1)}'
    )
    if not orbits:
        none = f'no periodic motion with {asked} was found from any start'
        if all(search.complete for search in searches):
            none = f'there is no periodic motion with {asked}'
        raise CommandError(
            f'{none}: try other --impacts, --cycles or --stops, or --settled, which runs the rig '
            'until its motion repeats',
            EXIT_NONE,
        )
    raise CommandError(
        f'none of the {len(orbits)} solutions with {asked} is viable; the first: '
        f'{orbits[0].reason}',
        EXIT_NOT_VIABLE,
    )


def _solve(arguments: argparse.Namespace) -> int:
    given = given_rig(arguments.params, arguments.set, arguments.node, with_control=False)
    _check(arguments, given.parameters)
    if not arguments.quiet:
        hint('solve_periodic', given.parameters)
    searches: list[_Search] = []
    with long_work('solve_periodic', _slow_words(given.parameters), quiet=arguments.quiet):
        if arguments.settled:
            settled, orbit = _settled_orbit(given)
            orbits, reports = [orbit], [_settled_text(settled)]
        else:
            searches = _searches(given.parameters, arguments)
            orbits = [orbit for search in searches for orbit in search.orbits]
            reports = _reports(searches)
            if arguments.viable and arguments.stops is None:
                reports += _with_settled(given, orbits, arguments)
            orbits.sort(key=lambda orbit: (not orbit.viable, not orbit.stable))
    if arguments.viable:
        orbits = [orbit for orbit in orbits if orbit.viable]
    write_json(arguments.json, [_plain(orbit) for orbit in orbits])
    followed: list[tuple[str, Branch]] = []
    if arguments.follow is not None and orbits:
        words = 'still following the branch; Ctrl-C ends it'
        with long_work('solve_periodic', words, quiet=arguments.quiet):
            followed = list(_branches(orbits[0], *arguments.follow))
        if drawn := [pair for pair in followed if pair[1].points]:
            title = f'{drawn[0][1].name} varied; {rig_line(given.parameters)}'
            branches = [branch for _, branch in drawn]
            write_output(arguments.csv, branch_table, drawn)
            draw(arguments.figure, branch_figure, branches, textwrap.fill(title, 120))
    if not arguments.quiet:
        texts = [textwrap.fill(rig_line(given.parameters), 99, subsequent_indent='  '), *reports]
        texts += ['\n' + orbit_text(number, orbit) for number, orbit in enumerate(orbits, 1)]
        for title, branch in followed:
            texts.append(f'\n{title}, {branch.name} varied:\n{branch_text(branch)}')
        try:
            print('\n'.join(texts), file=text_stream(arguments.json), flush=True)
        except BrokenPipeError:
            discard_output()
    if searches and not any(orbit.viable for orbit in orbits):
        _check_found(searches, arguments)
    return 0


def _plain(orbit: PeriodicOrbit) -> dict[str, Any]:
    """Return a motion for JSON; on a moving base with its transmissibility."""
    plain = orbit.as_dict()
    if orbit.viable and orbit.parameters.base_motion.moves:
        alone = Transmissibility.without_damper(orbit.parameters)
        plain |= transmissibility(orbit).by_name() | alone.by_name('_without_damper')
    return plain


def _check(arguments: argparse.Namespace, parameters: RigParameters) -> None:
    """Raise an error before the work if a file cannot be written, or a range is invalid."""
    check_outputs(arguments, arguments.params)
    if arguments.follow is not None:
        name, low, high = arguments.follow
        value = value_of(parameters, name)
        if not low <= value <= high:
            raise ValueError(
                f'{name} is {value:.9g} where the branch begins: give a range around that, not '
                f'{low:.9g} to {high:.9g}'
            )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome('solve_periodic', lambda: _solve(arguments))


if __name__ == '__main__':
    sys.exit(main())
