# SPDX-License-Identifier: Apache-2.0
"""`recover_run`: make a complete bag of a recording that was cut short."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from impact_damper_ros.bag import RecordingError, Recovery, recover_run
from impact_damper_ros.parameters.quoting import as_line, plural, printable

from .command_line import (
    EXIT_FAILED,
    CommandError,
    add_bag_argument,
    add_path_option,
    command_parser,
    outcome,
)

_DESCRIPTION = """\
Copy the intact part of a recording that was cut short (kill -9, power cut, full disk) or damaged
to a complete bag. What is not copied is listed. The recording itself is not changed.
"""
_EPILOG = """\
Exit code: 0 if messages were saved; 1 if not; 2 if an argument is invalid; 130 on Ctrl-C, 143 on
SIGTERM.
Example: recover_run runs/run_20250131_120000
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('recover_run', _DESCRIPTION, _EPILOG)
    add_bag_argument(parser)
    text = 'directory of the new bag, which must not exist [BAG_recovered beside BAG]'
    add_path_option(parser, '--output', text, 'DIR')
    return parser


#: Most faults, and most characters of a name from a file, that are shown.
_MOST_FAULTS = 20
_MOST_SHOWN = 100


def _short(name: str) -> str:
    return printable(name if len(name) <= _MOST_SHOWN else f'{name[:_MOST_SHOWN]}...')


def recovery_report(recovery: Recovery) -> str:
    """Return a report of the saved messages, topic by topic."""
    seconds = (recovery.end_ns - recovery.start_ns) / 1e9
    lines = []
    if recovery.was_complete:
        name = printable(recovery.source.name)
        lines.append(f'{name} is complete: nothing was lost; this is a copy of it')
    count = plural(recovery.message_count, 'message')
    lines.append(f'saved {count} over {seconds:.3f} s to {printable(str(recovery.output))}')
    lines.append(f'  stamps {recovery.start_ns} to {recovery.end_ns} ns')
    topics = [t._replace(name=_short(t.name), type=_short(t.type)) for t in recovery.topics]
    width = max(len(topic.name) for topic in topics)
    lines += [
        f'  {topic.name:<{width}}  {topic.message_count:>8}  {topic.type}' for topic in topics
    ]
    if not recovery.was_complete:
        lines.append(f'bytes not usable: {recovery.unusable}')
    if recovery.doubtful:
        count = plural(recovery.doubtful, 'message')
        lines.append(f'of damaged parts, so that some may be altered: {count}')
    lines += [f'fault: {as_line(fault)}' for fault in recovery.faults[:_MOST_FAULTS]]
    if len(recovery.faults) > _MOST_FAULTS:
        lines.append(f'and {len(recovery.faults) - _MOST_FAULTS} more faults')
    lines += [f'not copied: {as_line(thing)}' for thing in recovery.left_out[:_MOST_FAULTS]]
    return '\n'.join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        try:
            recovery = recover_run(arguments.bag, arguments.output)
        except RecordingError as error:
            raise CommandError(str(error), EXIT_FAILED) from error
        print(printable(recovery_report(recovery)))
        return 0

    return outcome('recover_run', work)


if __name__ == '__main__':
    sys.exit(main())
