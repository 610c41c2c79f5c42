# SPDX-License-Identifier: Apache-2.0
"""
Show a live rig, or a recording, in a browser.

The page is a client in a process of its own. With ``--start`` it also starts the node, and ends
the node at its own end.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import ctypes
import os
import re
import signal
import subprocess
import sys
import webbrowser
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from impact_damper_ros.motion.kernels import compile_elsewhere
from impact_damper_ros.parameters.parameters_file import load_parameters, preset_file
from impact_damper_ros.parameters.quoting import quote

from .command_line import (
    EXIT_FAILED,
    MISSING_ROS,
    CommandError,
    command_parser,
    outcome,
    path_of,
    say,
)

COMMAND = 'rig_page'
#: Time that a node has to end and to finish its recording, s.
NODE_END_S = 60.0
#: Interval at which the page checks that the node runs, s.
_LOOK_S = 0.2
#: Time after which a thread hands over the interpreter, s.
SWITCH_INTERVAL_S = 2e-4
_PR_SET_PDEATHSIG = 1


_DESCRIPTION = 'Show a live rig, or with --bag a recording, in a browser.\n'
_EPILOG = """\
Exit code: 0 after Ctrl-C or SIGTERM; 1 if the page cannot be served, as where another program has
the port; 2 if an argument or a recording is invalid.
Examples:
  rig_page --start bench_rig
  rig_page --bag runs/run_20250131_120000
"""


#: See `needs`.
NEEDS = (('--recordings', 'no --bag'),)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(COMMAND, _DESCRIPTION, _EPILOG, NEEDS)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        '--node', type=_node, default='', metavar='NAME', help='node of the rig to show first'
    )
    what.add_argument(
        '--bag',
        type=path_of,
        metavar='BAG',
        help='recording to play, or a directory of them; without ROS',
    )
    what.add_argument(
        '--start',
        type=path_of,
        metavar='PARAMS',
        help='also start the node of this rig: a parameters file, or bench_rig or paper',
    )
    parser.add_argument(
        '--recordings',
        type=path_of,
        default=Path('runs'),
        metavar='DIR',
        help='directory of the recordings to list [runs]',
    )
    parser.add_argument(
        '--port', type=_port, metavar='PORT', default=8088, help='port [8088]; 0: any free port'
    )
    parser.add_argument(
        '--host',
        default='127.0.0.1',
        metavar='ADDRESS',
        help='address to listen on [127.0.0.1, this machine only]; other machines watch, or steer '
        'with the token that is printed',
    )
    parser.add_argument(
        '--name',
        action='append',
        default=[],
        metavar='NAME',
        help='another host name of this machine; may be repeated',
    )
    parser.add_argument('--open', action='store_true', help='open the page in a browser')
    return parser


def _node(text: str) -> str:
    """Return the full name of a node; without a slash it is in no namespace."""
    name = f'/{text.removeprefix("/")}' if text else ''
    if text and not re.fullmatch(r'(/[A-Za-z_][A-Za-z0-9_]*)+', name):
        raise argparse.ArgumentTypeError(
            f'{quote(text)}: no node has such a name; give one such as /sim_node'
        )
    return name


def _port(text: str) -> int:
    if not (text.isdecimal() and int(text) <= 65535):
        raise argparse.ArgumentTypeError(f'{text!r}: give a whole number from 0 to 65535')
    return int(text)


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


class _Node:
    """The node of a rig, which ends with the page."""

    def __init__(self, file: Path, report: Callable[[str], object]) -> None:
        self._report = report
        libc = ctypes.CDLL(None)

        def leave_to_the_page() -> None:
            # The node ends with this process in any case, and finishes its recording.
            libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
            # Until the node has its own handler, Ctrl-C in the terminal would stop its imports.
            signal.signal(signal.SIGINT, signal.SIG_IGN)

        self._process = subprocess.Popen(
            [
                *(sys.executable, '-m', 'impact_damper_ros.node.sim_node', '--ros-args'),
                *('--params-file', str(file)),
            ],
            preexec_fn=leave_to_the_page,
        )

    async def watch(self) -> None:
        """Report the end of a node that was not ended by the page."""
        while (code := self._process.poll()) is None:
            await asyncio.sleep(_LOOK_S)
        how = f'by signal {-code}' if code < 0 else f'with code {code}'
        self._report(f'the node has ended {how}: start it again with sim_node, or this command')

    def end(self) -> None:
        """End the node; kill it if that takes long."""
        if self._process.poll() is None:
            self._process.terminate()
        try:
            self._process.wait(NODE_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _open(url: str) -> None:
    """Open a page in a browser with windows, if there is one."""
    if sys.platform == 'linux' and not {'DISPLAY', 'WAYLAND_DISPLAY'} & os.environ.keys():
        return
    with contextlib.suppress(webbrowser.Error, OSError):
        webbrowser.open(url)


async def _serve(arguments: argparse.Namespace) -> None:
    from impact_damper_ros.page.gate import Gate
    from impact_damper_ros.page.recordings import Recordings
    from impact_damper_ros.page.server import PageServer
    from impact_damper_ros.replay import RecordedRun

    gate = Gate(arguments.host, arguments.name)
    recordings = Recordings(arguments.bag or arguments.recordings, listed=arguments.bag is None)
    # Recordings that cannot be shown are rejected before anything starts.
    if arguments.bag is not None and not recordings.names():
        raise CommandError(f'{arguments.bag} is no bag: give a file .mcap, or a directory of bags')
    if arguments.start is not None:
        load_parameters(preset_file(arguments.start), '/sim_node')
    if recordings.single:
        RecordedRun(arguments.bag, purpose='play')
    if arguments.bag is None:
        from impact_damper_ros.page.ros_client import RosClient

        server = PageServer(gate, recordings, RosClient(), arguments.node)
    else:
        server = PageServer(gate, recordings)
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            loop.add_signal_handler(number, end.set)
    try:
        await server.start(arguments.port)
    except OSError as error:
        other = arguments.port % 65535 + 1
        await server.close()
        raise CommandError(
            f'cannot listen on {gate.host}, port {arguments.port}: {error.strerror or error}: '
            f'give another --host or --port, as in: make page ARGS="--port {other}"',
            EXIT_FAILED,
        ) from error

    def report(text: str) -> None:
        say(COMMAND, text)
        server.notify(f'{text[0].upper()}{text[1:]}.')

    node = watch = None
    if arguments.start is not None:
        node = _Node(preset_file(arguments.start), report)
        watch = loop.create_task(node.watch())
    try:
        print(f'{COMMAND}: the page is at {gate.url(gate.token)}', flush=True)
        if gate.token:
            print(f'{COMMAND}: without the token it is to watch only: {gate.url()}', flush=True)
        if arguments.open:
            loop.run_in_executor(None, _open, gate.url(gate.token))
        await end.wait()
        await server.close()
    finally:
        if watch is not None:
            watch.cancel()
        if node is not None:
            node.end()


def _check(arguments: argparse.Namespace) -> None:
    """Raise CommandError if the command lacks a package, ROS or the recording."""
    if find_spec('tornado') is None:
        raise CommandError(
            'tornado, which serves the page, is missing: install python3-tornado, or the package '
            'with its extra [page]'
        )
    if arguments.bag is None and find_spec('rclpy') is None:
        raise CommandError(f'{MISSING_ROS}; or play a recording with --bag')
    if arguments.bag is not None and not arguments.bag.exists():
        raise CommandError(f'{arguments.bag}: there is no such bag or directory')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    given = _without_ros_arguments(sys.argv[1:] if argv is None else argv)
    arguments = _parser().parse_args(given)
    if arguments.start is not None:
        arguments.node = '/sim_node'

    # Frames wait neither for the threads of theory, designs and what-ifs nor for a compiler.
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    compile_elsewhere()

    def work() -> int:
        _check(arguments)
        asyncio.run(_serve(arguments))
        return 0

    return outcome(COMMAND, work)


if __name__ == '__main__':
    sys.exit(main())
