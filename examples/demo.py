# SPDX-License-Identifier: Apache-2.0
"""
The live rig for half a minute: its gap and angle change, it is recorded and compared with theory.

Run by `make demo`. It leaves the recording and a report with pictures in demo_run/.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

from tqdm import tqdm

from impact_damper_ros import load_parameters
from impact_damper_ros.cli.command_line import CommandError, outcome
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.set_rig import RigParameterClient, ros_node
from impact_damper_ros.parameters.parameters_file import preset_file

#: Seconds of the rig per second of the demonstration, so that each stage has time to settle.
SPEED = 3.0
#: After which a node that neither ends nor publishes hangs, s.
PATIENCE_S = 120.0
BENCH = preset_file(Path('bench_rig'))


class Stage(NamedTuple):
    """What is set at the start of a stage of the demonstration."""

    parameter: str
    value: float
    text: str


STAGES = (
    Stage('gap', 0.0145, 'gap 14.5 mm: too narrow'),
    Stage('gap', 0.024, 'gap 24 mm: as it should be'),
    Stage('angle', 0.2, 'inclined by 0.2 rad (11°)'),
)


def start_node(directory: Path) -> subprocess.Popen[bytes]:
    """Start the node at the first stage; it records into a directory."""
    # Apart from other ROS systems, on this machine and on others
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))
    if (Path(sys.prefix) / 'share' / 'ament_index').is_dir():
        # ROS 2 from wheels, with no workspace sourced
        os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)
    first = STAGES[0]
    settings = (
        f'{first.parameter}:={first.value}',
        f'real_time_factor:={SPEED}',
        f'bag_directory:={directory}',
        'record:=true',
    )
    return subprocess.Popen(
        [
            *(sys.executable, '-m', 'impact_damper_ros.node.sim_node', '--ros-args'),
            *('--params-file', str(BENCH)),
            *(word for setting in settings for word in ('-p', setting)),
        ]
    )


class Listener:
    """Counts what arrives from the rig."""

    def __init__(self, client: Any, node: subprocess.Popen[bytes]) -> None:
        from sensor_msgs.msg import JointState

        self._client, self._node = client, node
        self.states = self.impacts = 0
        # Stamp of the newest joint states, s, and when they came
        self.time, self._heard = 0.0, monotonic()
        client.create_subscription(JointState, 'joint_states', self._take_states, 100)
        client.create_subscription(JointState, 'impacts', self._take_impact, 1000)

    def _take_states(self, message: Any) -> None:
        self.states += 1
        self._heard = monotonic()
        self.time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec

    def _take_impact(self, _message: Any) -> None:
        self.impacts += 1

    def next_time(self) -> float:
        """Return the stamp of the next joint states, at most a queue of them old."""
        import rclpy

        before = self.states
        while self.states == before:
            rclpy.spin_once(self._client, timeout_sec=1.0)
            if self._node.poll() is not None:
                raise CommandError(f'the node ended with exit code {self._node.returncode}')
            if monotonic() > self._heard + PATIENCE_S:
                raise CommandError(f'no joint_states arrived for {PATIENCE_S:g} s')
        return self.time

    def listen_until(self, time: float, bar: Any) -> None:
        """Listen until the time of the rig, which may lag behind the clock on a busy machine."""
        while (before := self.time) < time:
            passed = (self.next_time() - before) / SPEED
            bar.set_postfix_str(f'{self.impacts} impacts', refresh=False)
            bar.update(min(passed, bar.total - bar.n))


def perform(node: subprocess.Popen[bytes], duration: float) -> None:
    """Change parameters while the node runs."""
    bar = tqdm(
        total=duration,
        bar_format='{l_bar}{bar}| {n:.0f}/{total:.0f} s  {postfix}',
        disable=None,
    )
    with ros_node('demo') as client, bar:
        listener = Listener(client, node)
        listener.next_time()
        rig = RigParameterClient(client, '/sim_node')
        begin = 0.0
        for number, stage in enumerate(STAGES):
            if number:
                rig.set({stage.parameter: stage.value})
                # A stage has its length whatever the one before it and the request took.
                begin = listener.next_time()
            bar.write(f'  {stage.text}   (set_rig {stage.parameter}={stage.value:g})')
            listener.listen_until(begin + SPEED * duration / len(STAGES), bar)
        rig.set({'record': False})
    print(f'\n{listener.states} joint_states and {listener.impacts} impacts arrived over DDS.')


def table(measured: Sequence[Mapping[str, Any]]) -> str:
    """Return what was measured of each stage."""
    without = load_parameters(BENCH)[0].response_amplitude
    lines = [
        '                              impacts    largest   of the motion    mean      measured',
        'stage                         per cycle  |X|       without damper   impulse   from, to',
    ]
    lines += [
        f'{stage.text:<29} {part["impacts_per_cycle"]:<10.2f} '
        f'{1e3 * part["x_max"]:4.1f} mm   {part["x_max"] / without:<16.3f} '
        f'{1e3 * part["mean_impulse"]:.0f} mN s   {part["start"]:.1f} s, {part["end"]:.1f} s'
        for stage, part in zip(STAGES, measured, strict=False)
    ]
    return '\n'.join(lines)


def demonstrate(directory: Path, duration: float) -> int:
    """Run the demonstration."""
    directory.mkdir(parents=True, exist_ok=True)
    known = set(directory.iterdir())
    print(
        f'A 5 Hz bench rig runs live on ROS 2 for {duration:.0f} s, at {SPEED:g} times its speed, '
        'and is recorded to MCAP.'
    )
    node = start_node(directory)
    try:
        perform(node, duration)
    finally:
        node.send_signal(signal.SIGINT)
        node.wait(PATIENCE_S)
    (bag,) = (path for path in set(directory.iterdir()) - known if path.is_dir())
    report = directory / 'report'
    print('Comparing it with the exact periodic theory (compare_run) ...', flush=True)
    # Its tables are in the report; progress goes to stderr.
    with contextlib.redirect_stdout(io.StringIO()):
        code = compare_run([str(bag), '--report', str(report)])
    stretches = json.loads((report / 'report.json').read_text(encoding='utf-8'))['stretches']
    measured = [stretch['measured'] for stretch in stretches]
    print('From the recording:\n')
    print(table(measured), end='\n\n')
    for stretch in stretches:
        text = f'{stretch["cause"]}: {stretch["verdict"]}. {stretch["sentence"]}'
        print(textwrap.fill(text, 96, initial_indent='  ', subsequent_indent='      '))
    readers = '(rig_page --bag, ros2 bag play, or any MCAP reader)'
    print(f'\nrecording  {os.path.relpath(bag)}   {readers}')
    print(f'report     {os.path.relpath(report / "report.html")}   (any browser)')
    return code


def main(argv: Sequence[str] | None = None) -> int:
    """Read the options and run the demonstration."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n\n')[0])
    parser.add_argument('directory', nargs='?', type=Path, default=Path('demo_run'))
    parser.add_argument('--duration', type=float, default=30.0, help='seconds [30]')
    arguments = parser.parse_args(argv)
    return outcome(
        'demo',
        lambda: demonstrate(arguments.directory.resolve(), arguments.duration),
        'interrupted; the recording so far is kept',
    )


if __name__ == '__main__':
    sys.exit(main())
