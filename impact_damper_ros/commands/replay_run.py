"""`replay_run`: prove that a recorded run comes out again, or ask what would have been."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from tqdm import tqdm

from impact_damper_ros.commands.command_line import add_version_option, announce
from impact_damper_ros.commands.csv_tables import IMPACT_COLUMNS, impact_rows, open_table, row
from impact_damper_ros.commands.outcome import outcome
from impact_damper_ros.commands.outputs import check_figure, check_file, whole, write_text
from impact_damper_ros.commands.replay_report import as_json, findings_text
from impact_damper_ros.commands.what_if_comparison import Comparison, held_values
from impact_damper_ros.entry_points import run
from impact_damper_ros.recording.replay import Replay
from impact_damper_ros.recording.replayed_rig import setting_of
from impact_damper_ros.recording.run_history import RunHistory
from impact_damper_ros.rig import PARAMETER_SPECS, Event, Sample
from impact_damper_ros.rig.shown import printable

__all__ = ['main']

#: Samples between two updates of the progress bar.
_STRIDE = 256

_DESCRIPTION = """\
Replay a recorded run from its own log. Without --set, every recorded sample and impact is computed
anew from the first snapshot and the logged parameter changes and resets, and compared bit for bit.
With --set, the same history is also run with parameters held at other values, and both are
compared. Works without ROS, on a bag directory or a single .mcap file, also a recovered one.
"""
_EPILOG = """\
Exit status: 0 if all is reproduced bit for bit; 1 if something differs (or a file cannot be
written); 2 if the bag or an argument cannot be used; 3 if all that can be compared is reproduced,
but the bag is cut, damaged, lacks messages, or holds some twice or out of order; 130 on Ctrl-C.
Example: replay_run runs/run_20250131_120000 --set gap=0.03 --figure what_if.png
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        'replay_run',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('bag', type=Path, metavar='BAG', help='bag directory or .mcap file')
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='what if: hold a parameter at a value throughout, for example --set gap=0.03; may '
        'be repeated',
    )
    parser.add_argument(
        '--node', metavar='NAME', help='which node, by name or namespace, if the bag has several'
    )
    parser.add_argument(
        '--json', type=Path, metavar='FILE', help='write the result as JSON (- : stdout)'
    )
    parser.add_argument(
        '--figure', type=Path, metavar='FILE.png', help='draw the recorded run and the what-if'
    )
    parser.add_argument(
        '--states',
        type=Path,
        metavar='FILE.csv',
        help='write the replayed states (with --set, those of the what-if) as CSV',
    )
    parser.add_argument(
        '--impacts', type=Path, metavar='FILE.csv', help='write its impacts as CSV, likewise'
    )
    parser.add_argument('--quiet', action='store_true', help='no progress bar and no report')
    add_version_option(parser)
    return parser


class _Table:
    """The states and impacts of the rig, as CSV files like those of `simulate_rig`."""

    def __init__(self, states: Path | None, impacts: Path | None, stack: ExitStack) -> None:
        self._states = open_table(states, Sample._fields, stack) if states else None
        self._impacts = open_table(impacts, IMPACT_COLUMNS, stack) if impacts else None

    def write(self, sample: Sample, events: Sequence[Event]) -> None:
        """Write a sample, and the impacts among the events before it."""
        if self._states is not None:
            self._states.write(row(sample))
        if self._impacts is not None:
            self._impacts.write(impact_rows(events))


def _run(arguments: argparse.Namespace, replay: Replay) -> Comparison | None:
    """Replay and write the tables; return the what-if, if one was asked for."""
    comparison = None
    reader = replay.history.reader
    span = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9
    count = max(1, reader.topics[replay.history.topics.joint_states].message_count)
    with ExitStack() as stack:
        table = _Table(arguments.states, arguments.impacts, stack)
        bar = stack.enter_context(
            tqdm(
                total=span,
                desc='replayed',
                delay=1.0,
                leave=False,
                disable=True if arguments.quiet else None,
                bar_format='{l_bar}{bar}| {n:.0f}/{total:.0f} s [{elapsed}<{remaining}]',
            )
        )
        if not (arguments.set or arguments.states or arguments.impacts):
            start = replay.history.start.time_ns / 1e9
            replay.run(lambda time: bar.update(max(0.0, min(span, time - start) - bar.n)))
            return None
        for number, tick in enumerate(replay.ticks()):
            if arguments.set:
                if comparison is None:
                    drawn = arguments.figure is not None
                    comparison = Comparison(replay, arguments.set, drawn=drawn)
                table.write(*comparison.look(tick))
            else:
                table.write(tick.sample, tick.events)
            if number % _STRIDE == 0:
                bar.update(min(span, span * number / count) - bar.n)
    return comparison


def _report(arguments: argparse.Namespace, replay: Replay, comparison: Comparison | None) -> int:
    findings, history = replay.findings, replay.history
    result = as_json(findings, history)
    text = findings_text(findings, history)
    if comparison is not None:
        result['what_if'] = comparison.as_json()
        text += '\n' + comparison.text()
        if findings.difference_count:
            text += '\ncaution     the run is not reproduced from its log: see above'
        if arguments.figure is not None:
            with whole(arguments.figure) as draft:
                comparison.draw(draft)
    to_stdout = arguments.json is not None and str(arguments.json) == '-'
    if arguments.json is not None:
        content = json.dumps(result, indent=2) + '\n'
        write_text(arguments.json, content)
    if not arguments.quiet:
        print(printable(text), file=sys.stderr if to_stdout else sys.stdout)
    return findings.verdict.value if findings.samples else 2


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the command.

    Returns
    -------
    int
        Exit status, as the help says.
    """
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.figure is not None and not arguments.set:
        parser.error('--figure draws a what-if beside the recorded run: give --set NAME=VALUE too')

    def work() -> int:
        # Before the work, not after it
        if arguments.json is not None:
            check_file(arguments.json)
        if arguments.figure is not None:
            check_figure(arguments.figure)
        replay = Replay(RunHistory(arguments.bag, arguments.node))
        if arguments.set:
            # A slip of the pen is told at once.
            logged = setting_of(replay.history.start.state)
            held, _ = held_values(arguments.set, logged)
            if not arguments.quiet:
                rig = {n: value for n, value in held.items() if n in PARAMETER_SPECS}
                announce('replay_run', logged.rig.replace(**rig))
        return _report(arguments, replay, _run(arguments, replay))

    return outcome('replay_run', work)


if __name__ == '__main__':
    sys.exit(run('replay_run', main))
