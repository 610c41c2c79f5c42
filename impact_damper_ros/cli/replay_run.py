# SPDX-License-Identifier: Apache-2.0
"""`replay_run`: reproduce a recorded run from its log, alone or with other parameters."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from impact_damper_ros.motion.event import Sample, events_of_table
from impact_damper_ros.parameters.quoting import plural, printable
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
)
from impact_damper_ros.replay import RecordedRun, Replay, Setting
from impact_damper_ros.replay.run import runs_of
from impact_damper_ros.replay.what_if import WhatIf
from impact_damper_ros.report.csv_tables import IMPACT_COLUMNS, impact_rows, open_table, row
from impact_damper_ros.report.replay_report import findings_json, findings_text
from impact_damper_ros.report.run_pair import RunPair
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
    add_run_option,
    check_outputs,
    command_parser,
    draw,
    outcome,
    path_of,
    progress_bar,
    text_stream,
    write_json,
)
from .rig_options import GivenRig, add_recorded_law_option, announce, overridden

_DESCRIPTION = """\
Replay a recorded run from its log. Without --set, every recorded sample and impact is computed
again from the first snapshot and the logged parameter changes and resets, and compared bit for
bit. With --set, the same history is also run with other values of some parameters, and the two
runs are compared; --bag records that run, so that every other command takes it, too. Works without
ROS, on a bag directory or a single .mcap file, also a recovered one.
"""
_EPILOG = """\
Exit code: 0 if all is reproduced, bit for bit or, of a bag of another C library, processor or
arithmetic, within round-off; 1 if something differs, a file cannot be written, or
the what-if has more than --most-events events (--states, --impacts and --bag then end there); 2 if
the bag or an argument is invalid; 3 if all that can be compared is reproduced, but the bag is cut,
damaged, lacks messages, or holds some twice; 130 on Ctrl-C, 143 on SIGTERM.
Example: replay_run runs/run_20250131_120000 --set gap=0.03 --figure what_if.png --bag runs/wider
As CSV:  replay_run runs/run_20250131_120000 --states samples.csv --impacts impacts.csv
"""


#: See `needs`.
NEEDS = (('--figure', '--set'), ('--bag', '--set'), ('--most-events', '--set'))


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('replay_run', _DESCRIPTION, _EPILOG, NEEDS)
    add_bag_argument(parser)
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='what-if: give a parameter this value throughout the run, for example '
        '--set gap=0.03; may be repeated',
    )
    add_node_option(parser)
    add_run_option(parser)
    add_recorded_law_option(parser)
    add_json_option(parser)
    add_path_option(parser, '--figure', 'draw the recorded run and the what-if')
    parser.add_argument(
        '--bag',
        dest='recording',
        type=path_of,
        metavar='DIR',
        help='record the what-if as a bag; DIR must not exist',
    )
    states = 'write the samples (of the what-if with --set) as CSV, in SI units (- : stdout)'
    add_path_option(parser, '--states', states)
    add_path_option(parser, '--impacts', 'write the impacts of the same run as CSV (- : stdout)')
    add_most_events_option(parser, ' of the what-if')
    add_quiet_option(parser, 'report')
    return parser


def _overrides_of(
    settings: Sequence[str], logged: Setting
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read ``--set`` options; return the overridden parameters and initial conditions."""
    given = GivenRig(logged.rig, InitialConditions(), logged.control)
    rig, initial, control, _ = overridden(settings, given)
    changed, start = Setting(rig, control).as_dict(), initial.as_dict()
    names = [setting.partition('=')[0] for setting in settings]
    # The unit of base amplitudes, as in 0.5 mm, may mean another quantity
    if rig.base_quantity != logged.rig.base_quantity:
        names.append('base_quantity')
    return (
        {name: changed[name] for name in names if name in changed},
        {name: start[name] for name in names if name in INITIAL_SPECS},
    )


def _what_if(
    arguments: argparse.Namespace, replay: Replay, stack: ExitStack
) -> tuple[WhatIf | None, RunPair | None]:
    """Return the rig of ``--set``, and the collector of both runs; None without ``--set``."""
    if not arguments.set:
        return None, None
    logged = Setting.of(replay.start.state)
    overrides, initial_overrides = _overrides_of(arguments.set, logged)
    what_if = WhatIf(
        *(replay.start, overrides, initial_overrides),
        most_in_period=arguments.most_events,
        bag=arguments.recording,
        compiled=replay.recorded.is_long,
    )
    stack.callback(what_if.close)
    if not arguments.quiet:
        rig = {n: value for n, value in overrides.items() if n in PARAMETER_SPECS}
        announce('replay_run', logged.rig.replace(**rig))
    drawn = arguments.figure is not None
    return what_if, RunPair(replay.start, what_if, {**overrides, **initial_overrides}, drawn=drawn)


def _replay(arguments: argparse.Namespace, recorded: RecordedRun) -> tuple[int, Any, str]:
    """Replay a run and write its tables; return the exit code, the result and a text."""
    replay, span = Replay(recorded), recorded.reader.span
    with ExitStack() as stack:
        what_if, runs = _what_if(arguments, replay, stack)
        states = open_table(arguments.states, Sample._fields, stack)
        impacts = open_table(arguments.impacts, IMPACT_COLUMNS, stack)
        bar = stack.enter_context(progress_bar('replayed', span, 's', quiet=arguments.quiet))
        for part in replay:
            shown, ended = part, None
            if what_if is not None and runs is not None:
                try:
                    shown = what_if.follow(part)
                except RunawayError as error:
                    shown, ended = what_if.reached, error
                else:
                    runs.take(part, shown)
            if states is not None:
                for sample in shown.samples.tolist():
                    states.write(row(sample))
            if impacts is not None:
                impacts.write(impact_rows(events_of_table(shown.events)))
            if ended is not None:
                raise CommandError(f'what if: {ended}{ALLOW_MORE}', EXIT_FAILED) from ended
            time = replay.rig.time - replay.start.time
            bar.update(max(0.0, min(span, time) - bar.n))
    findings = replay.findings
    result, text = findings_json(findings, recorded), findings_text(findings, recorded)
    if runs is not None:
        runs.finish()
        result['what_if'] = runs.as_json()
        text += '\n' + runs.text()
        refusals = what_if.refusals if what_if is not None else []
        result['what_if']['refused_orders'] = len(refusals)
        for time, reason in refusals[:1]:
            count = plural(len(refusals), 'order')
            text += f'\nrefused     {count} of the controller, from {time:.9g} s on: {reason}'
        if arguments.recording is not None:
            text += f'\nrecorded    {arguments.recording}'
        if findings.difference_count:
            text += '\ncaution     the run is not reproduced from its log: see above'
        draw(arguments.figure, runs.figure)
    return findings.verdict.exit_code if findings.samples else 2, result, text


def _runs(arguments: argparse.Namespace) -> list[RecordedRun]:
    """Return the runs to replay."""
    runs = runs_of(arguments.bag, arguments.node, arguments.run, law=arguments.law)
    one = arguments.set or arguments.states is not None or arguments.impacts is not None
    if one and len(runs) > 1:
        raise CommandError(
            f'{arguments.bag} holds {len(runs)} runs of {runs[0].topics.name}, which was '
            f'restarted: choose one with --run 1 to --run {len(runs)}'
        )
    return runs


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        check_outputs(arguments, arguments.bag)
        done = [_replay(arguments, recorded) for recorded in _runs(arguments)]
        codes, results, texts = zip(*done, strict=True)
        write_json(arguments.json, results[0] if len(done) == 1 else {'runs': results})
        if not arguments.quiet:
            print(printable('\n\n'.join(texts)), file=text_stream(arguments.json))
        return 1 if 1 in codes else max(codes)

    return outcome('replay_run', work)


if __name__ == '__main__':
    sys.exit(main())
