# SPDX-License-Identifier: Apache-2.0
"""`replay_run`: reproduce a recorded run from its log, alone or with other parameters."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from impact_damper_ros.motion.event import Sample, events_of_table
from impact_damper_ros.parameters.quoting import printable
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
)
from impact_damper_ros.replay import RecordedRun, Replay, Setting
from impact_damper_ros.report.csv_tables import IMPACT_COLUMNS, impact_rows, open_table, row
from impact_damper_ros.report.drawing import save_figure
from impact_damper_ros.report.replay_report import findings_json, findings_text
from impact_damper_ros.report.what_if_report import WhatIfReport
from impact_damper_ros.rig.runaway import RunawayError

from .command_line import (
    ALLOW_MORE,
    EXIT_FAILED,
    CommandError,
    add_bag_argument,
    add_json_option,
    add_most_events_option,
    add_node_option,
    add_path_option,
    add_quiet_option,
    check_outputs,
    command_parser,
    outcome,
    progress_bar,
    text_stream,
    write_json,
)
from .rig_options import GivenRig, add_recorded_law_option, announce, overridden

_DESCRIPTION = """\
Replay a recorded run from its own log. Without --set, every recorded sample and impact is computed
again from the first snapshot and the logged parameter changes and resets, and compared bit for
bit. With --set, the same history is also run with parameters held at other values, and the two
runs are compared. Works without ROS, on a bag directory or a single .mcap file, also a recovered
one.
"""
_EPILOG = """\
Exit code: 0 if all is reproduced bit for bit; 1 if something differs, a file cannot be written, or
the what-if has more than --most-events events (--states and --impacts then end there); 2 if the
bag or an argument is invalid; 3 if all that can be compared is reproduced, but the bag is cut,
damaged, lacks messages, or holds some twice or out of order; 130 on Ctrl-C, 143 on SIGTERM.
Example: replay_run runs/run_20250131_120000 --set gap=0.03 --figure what_if.png
As CSV:  replay_run runs/run_20250131_120000 --states samples.csv --impacts impacts.csv
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('replay_run', _DESCRIPTION, _EPILOG)
    add_bag_argument(parser)
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='what-if: hold a parameter at this value throughout the run, for example '
        '--set gap=0.03; may be repeated',
    )
    add_node_option(parser)
    add_recorded_law_option(parser)
    add_json_option(parser)
    add_path_option(parser, '--figure', 'draw the recorded run and the what-if')
    states = 'write the samples (of the what-if with --set) as CSV, in SI units (- : stdout)'
    add_path_option(parser, '--states', states)
    add_path_option(parser, '--impacts', 'write the impacts of the same run as CSV (- : stdout)')
    add_most_events_option(parser, ' of the what-if')
    add_quiet_option(parser, 'report')
    return parser


def _held_values(
    settings: Sequence[str], logged: Setting
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read ``--set`` options; return the parameters that are held, and the initial conditions."""
    given = GivenRig(logged.rig, InitialConditions(), logged.control)
    rig, initial, control = overridden(settings, given)
    changed, start = Setting(rig, control).as_dict(), initial.as_dict()
    names = [setting.partition('=')[0] for setting in settings]
    return (
        {name: changed[name] for name in names if name in changed},
        {name: start[name] for name in names if name in INITIAL_SPECS},
    )


def _run(arguments: argparse.Namespace, replay: Replay, report: WhatIfReport | None) -> None:
    """Replay, and write the tables."""
    reader = replay.recorded.reader
    span = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9
    with ExitStack() as stack:
        states = open_table(arguments.states, Sample._fields, stack)
        impacts = open_table(arguments.impacts, IMPACT_COLUMNS, stack)
        bar = stack.enter_context(progress_bar('replayed', span, 's', quiet=arguments.quiet))
        for part in replay:
            samples, events, ended = part.samples, part.events, None
            if report is not None:
                try:
                    samples, events = report.look(part)
                except RunawayError as error:
                    (samples, events), ended = report.other.reached, error
            if states is not None:
                for sample in samples.tolist():
                    states.write(row(sample))
            if impacts is not None:
                impacts.write(impact_rows(events_of_table(events)))
            if ended is not None:
                raise CommandError(f'what if: {ended}{ALLOW_MORE}', EXIT_FAILED) from ended
            time = replay.rig.time - replay.start.time
            bar.update(max(0.0, min(span, time) - bar.n))


def _report(arguments: argparse.Namespace, replay: Replay, what_if: WhatIfReport | None) -> int:
    findings, recorded = replay.findings, replay.recorded
    result = findings_json(findings, recorded)
    text = findings_text(findings, recorded)
    if what_if is not None:
        result['what_if'] = what_if.as_json()
        text += '\n' + what_if.text()
        if findings.difference_count:
            text += '\ncaution     the run is not reproduced from its log: see above'
        if arguments.figure is not None:
            save_figure(what_if.figure(), arguments.figure)
    write_json(arguments.json, result)
    if not arguments.quiet:
        print(printable(text), file=text_stream(arguments.json))
    return findings.verdict.value if findings.samples else 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.figure is not None and not arguments.set:
        parser.error(
            '--figure draws a what-if beside the recorded run: give --set NAME=VALUE as well'
        )

    def work() -> int:
        check_outputs(arguments, arguments.bag)
        replay = Replay(RecordedRun(arguments.bag, arguments.node, law=arguments.law))
        what_if = None
        if arguments.set:
            # A misspelt name is reported at once
            logged = Setting.of(replay.start.state)
            held, held_initial = _held_values(arguments.set, logged)
            what_if = WhatIfReport(
                *(replay, held, held_initial),
                drawn=arguments.figure is not None,
                most_in_period=arguments.most_events,
            )
            if not arguments.quiet:
                rig = {n: value for n, value in held.items() if n in PARAMETER_SPECS}
                announce('replay_run', logged.rig.replace(**rig))
        _run(arguments, replay, what_if)
        return _report(arguments, replay, what_if)

    return outcome('replay_run', work)


if __name__ == '__main__':
    sys.exit(main())
