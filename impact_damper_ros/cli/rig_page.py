"""Show a live rig, or a recording, in a browser."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import signal
import sys
import webbrowser
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from impact_damper_ros.entry_points import run

from .command_line import add_version_option, outcome, say

__all__ = ['main']


COMMAND = 'rig_page'


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=COMMAND,
        description='Show a live rig, or with --bag a recording, in a browser.',
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--node', default='', metavar='NAME', help='the rig to show first')
    what.add_argument(
        '--bag', type=Path, metavar='BAG', help='a recording to play, without ROS; or a directory'
    )
    parser.add_argument(
        '--recordings',
        type=Path,
        default=Path('runs'),
        metavar='DIR',
        help='directory of the recordings that are listed [runs]',
    )
    parser.add_argument('--port', type=_port, default=8088, help='port [8088]; 0: a free one')
    parser.add_argument(
        '--host',
        default='127.0.0.1',
        metavar='ADDRESS',
        help='address to listen on [127.0.0.1, this machine only]; another one asks for a token',
    )
    parser.add_argument(
        '--name',
        action='append',
        default=[],
        metavar='NAME',
        help='a further name under which this machine is reached',
    )
    parser.add_argument('--open', action='store_true', help='open the page in a browser')
    add_version_option(parser)
    return parser


def _port(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f'{text!r}: give a whole number from 0 to 65535')
    return number


def _without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments without those that a launch file adds for ROS."""
    kept, of_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            of_ros = True
        elif of_ros and argument == '--':
            of_ros = False
        elif not of_ros:
            kept.append(argument)
    return kept


async def _serve(arguments: argparse.Namespace) -> int:
    from impact_damper_ros.page.gate import Gate
    from impact_damper_ros.page.recordings import Recordings
    from impact_damper_ros.page.server import PageServer

    gate = Gate(arguments.host, arguments.name)
    recordings = Recordings(arguments.bag or arguments.recordings)
    if arguments.bag is None:
        from impact_damper_ros.page.ros_client import NoAnswerError, RosClient

        server = PageServer(gate, recordings, RosClient(), NoAnswerError, arguments.node)
    else:
        server = PageServer(gate, recordings)
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end.set)
    try:
        await server.start(arguments.port)
    except OSError as error:
        say(COMMAND, f'cannot listen on {gate.host}: {error.strerror}: give another --port')
        await server.close()
        return 1
    print(f'the page is at {gate.url()}', flush=True)
    if arguments.open:
        with contextlib.suppress(webbrowser.Error):
            webbrowser.open(gate.url())
    await end.wait()
    await server.close()
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    given = _without_ros_arguments(sys.argv[1:] if argv is None else argv)
    arguments = _parser().parse_args(given)
    if find_spec('tornado') is None:
        say(
            COMMAND,
            'tornado, which serves the page, is missing: install python3-tornado, or the package '
            'with its extra [page]',
        )
        return 2
    if arguments.bag is None and find_spec('rclpy') is None:
        say(COMMAND, 'rclpy is missing: source ROS 2, or play a recording with --bag')
        return 2
    if arguments.bag is not None and not arguments.bag.exists():
        say(COMMAND, f'{arguments.bag}: there is no such bag or directory')
        return 2
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(name, '1')
    return outcome(COMMAND, lambda: asyncio.run(_serve(arguments)))


if __name__ == '__main__':
    sys.exit(run(COMMAND, main))
