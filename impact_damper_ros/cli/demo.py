"""
The demonstration: run the node, change its parameters, record, compare the recording with theory.

Run by ``make demo``, or ``python -m impact_damper_ros.cli.demo [DIRECTORY]``.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from impact_damper_ros.entry_points import run
from impact_damper_ros.outputs import check_directory
from impact_damper_ros.replay import RecordedRun, Replay
from impact_damper_ros.replay.rows import impacts_of
from impact_damper_ros.report.drawing import print_style
from impact_damper_ros.report.run_figures import Closeup, SampledMotion, draw_motion
from impact_damper_ros.rig import load_parameters

from .command_line import EXIT_FAILED, CommandError, command_parser, end_node, outcome

PATIENCE_S = 30.0
CLOSEUP_CYCLES = 3
#: Seconds of the rig per second of the demonstration, so that each stage has time to settle.
SPEED = 3.0
#: Shortest duration, s.
LEAST_S = 15.0


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


class Row(NamedTuple):
    """One stage, and the motion measured, as in ``report.json``."""

    stage: Stage
    measured: Mapping[str, Any]


def _environment() -> None:
    """Isolate the demonstration from other ROS systems, on this machine and others."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))
    if (Path(sys.prefix) / 'share' / 'ament_index').is_dir():
        # ROS 2 from wheels, with no workspace sourced
        os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)


def _start_node(preset: Path, directory: Path) -> subprocess.Popen[bytes]:
    first = STAGES[0]
    return subprocess.Popen(
        [
            sys.executable,
            *('-m', 'impact_damper_ros.node.sim_node', '--ros-args'),
            *('--params-file', str(preset)),
            *('-p', f'{first.parameter}:={first.value}'),
            *('-p', f'real_time_factor:={SPEED}'),
            *('-p', f'bag_directory:={directory}'),
            *('-p', 'record:=true'),
        ]
    )


class _Client:
    """A plain rclpy client of the node: it counts what arrives and sets parameters."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.parameter_client import AsyncParameterClient
        from rclpy.signals import SignalHandlerOptions
        from sensor_msgs.msg import JointState as JointStateMessage

        # Ctrl-C is Python's here: it ends the waiting, which is never long.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._rclpy = rclpy
        self._node = rclpy.create_node('demo')
        self.states = self.impacts = 0
        # Stamp of the newest joint states, s
        self.time = 0.0
        self._node.create_subscription(JointStateMessage, 'joint_states', self._on_state, 100)
        self._node.create_subscription(JointStateMessage, 'impacts', self._on_impact, 1000)
        self._parameters = AsyncParameterClient(self._node, 'sim_node')

    def _on_state(self, message: Any) -> None:
        self.states += 1
        stamp = message.header.stamp
        self.time = stamp.sec + 1e-9 * stamp.nanosec

    def _on_impact(self, _message: Any) -> None:
        self.impacts += 1

    def until(self, condition: Callable[[], bool], patience: float) -> bool:
        """Listen until a condition holds or the time is up."""
        deadline = time.monotonic() + patience
        while not condition() and time.monotonic() < deadline:
            self._rclpy.spin_once(self._node, timeout_sec=0.02)
        return condition()

    def set(self, name: str, value: Any) -> None:
        """Set a parameter of the node; raise RuntimeError if it is rejected."""
        from rclpy.parameter import Parameter

        if not self._parameters.wait_for_services(PATIENCE_S):
            raise RuntimeError('the node does not offer its parameter services')
        future = self._parameters.set_parameters([Parameter(name, value=value)])
        if not self.until(future.done, PATIENCE_S):
            raise RuntimeError(f'the node does not answer to setting {name}')
        result = future.result().results[0]
        if not result.successful:
            raise RuntimeError(f'the node rejected {name} = {value}: {result.reason}')

    def close(self) -> None:
        """Leave the network."""
        self._node.destroy_node()
        self._rclpy.try_shutdown()


def _has_reached(node: subprocess.Popen[bytes], client: _Client, time: float) -> bool:
    return client.time >= time or node.poll() is not None


def _perform(node: subprocess.Popen[bytes], duration: float) -> tuple[int, int]:
    """Change parameters while the node runs; return how many messages arrived."""
    client = _Client()
    try:
        if not client.until(lambda: client.states > 0 or node.poll() is not None, PATIENCE_S):
            raise RuntimeError('no joint_states arrived from the node')
        # In the time of the rig, which may lag behind the clock on a busy machine
        share = SPEED * duration / len(STAGES)
        bar = tqdm(
            total=duration,
            bar_format='{l_bar}{bar}| {n:.0f}/{total:.0f} s  {postfix}',
            disable=None,
        )
        with bar:
            for number, stage in enumerate(STAGES):
                if number:
                    client.set(stage.parameter, stage.value)
                bar.write(
                    f'  {stage.text}   (ros2 param set /sim_node '
                    f'{stage.parameter} {stage.value:g})'
                )
                end = client.time + share
                while (before := client.time) < end:
                    reached = partial(_has_reached, node, client, min(before + 0.25 * SPEED, end))
                    client.until(reached, PATIENCE_S)
                    if node.poll() is not None:
                        raise RuntimeError(f'the node ended with exit code {node.returncode}')
                    if client.time == before:
                        raise RuntimeError(f'no joint_states arrived for {PATIENCE_S:g} s')
                    bar.set_postfix_str(f'{client.impacts} impacts', refresh=False)
                    bar.update((client.time - before) / SPEED)
        client.set('record', False)
        return client.states, client.impacts
    finally:
        client.close()


def _read(bag: Path) -> tuple[SampledMotion, list[float]]:
    """Read the motion from the equilibrium of each stage, and the instants of the changes."""
    replay = Replay(RecordedRun(bag))
    parts = list(replay)
    samples = np.concatenate([part.samples for part in parts])
    impacts = impacts_of(np.concatenate([part.events for part in parts]))
    start, turned = float(samples['time'][0]), {stage.parameter for stage in STAGES}
    changes = [
        part.command.time - start
        for part in parts
        if part.command is not None
        for deed in part.command.done
        if isinstance(deed, Mapping) and deed.keys() & turned
    ]
    motion = SampledMotion(
        samples['time'] - start,
        samples['x'],
        samples['z'],
        samples['stop_1'],
        samples['stop_2'],
        impacts['time'] - start,
        impacts['x'] + impacts['y'],
        impacts['stop'].astype(np.int64),
    )
    return motion, changes


def _table(rows: Sequence[Row], without: float) -> str:
    lines = [
        '                              impacts    largest   of the motion    mean      measured',
        'stage                         per cycle  |X|       without damper   impulse   from, to',
    ]
    lines.extend(
        f'{stage.text:<29} {measured["impacts_per_cycle"]:<10.2f} '
        f'{1e3 * measured["x_max"]:4.1f} mm   {measured["x_max"] / without:<16.3f} '
        f'{1e3 * measured["mean_impulse"]:.0f} mN s   '
        f'{measured["start"]:.1f} s, {measured["end"]:.1f} s'
        for stage, measured in rows
    )
    return '\n'.join(
        [
            *lines,
            '',
            'The last periods of a settled motion are measured, up to 20, or else the second half',
            'of the stage, as in the report; |X| is counted from the equilibrium.',
        ]
    )


def _rows(report: Path) -> list[Row]:
    """Return the stages as the report has them."""
    result = json.loads((report / 'report.json').read_text(encoding='utf-8'))
    pairs = zip(STAGES, result['stretches'], strict=False)
    return [Row(stage, stretch['measured']) for stage, stretch in pairs if stretch['measured']]


def _draw(bag: Path, preset: Path, picture: Path, rows: Sequence[Row]) -> None:
    parameters, _, _ = load_parameters(preset)
    cycle = math.tau / parameters.force_frequencies[0]
    motion, changes = _read(bag)
    ends = [*changes, float(motion.time[-1])]
    closeups = [
        Closeup(
            end - CLOSEUP_CYCLES * cycle,
            end,
            f'{stage.text}\n{measured["impacts_per_cycle"]:.2f} impacts per cycle, '
            f'|X| up to {1e3 * measured["x_max"]:.1f} mm',
        )
        for (stage, measured), end in zip(rows, ends, strict=False)
    ]
    labels = [(0.0, STAGES[0].text)]
    labels += [(at, stage.text) for at, stage in zip(changes, STAGES[1:], strict=True)]
    figure = draw_motion(
        motion, closeups, labels, 'Impact damper, 5 Hz bench rig, recorded live from ROS 2'
    )
    with print_style():
        figure.savefig(picture, dpi=110)


def _compare(bag: Path, directory: Path) -> int:
    """Compare the recording with theory; return the exit code."""
    from .compare_run import main as compare_run

    return compare_run(['--quiet', os.path.relpath(bag), '--report', os.path.relpath(directory)])


def _print_verdicts(directory: Path) -> None:
    print('\ncompared with the exact periodic theory (compare_run):\n')
    result = json.loads((directory / 'report.json').read_text(encoding='utf-8'))
    for stretch in result['stretches']:
        text = f'{stretch["cause"]}: {stretch["verdict"]}. {stretch["sentence"]}'
        text += '; the log differs from its replay' * (stretch['log'] == 'differs')
        print(textwrap.fill(text, 96, initial_indent='  ', subsequent_indent='      '))


def _demonstrate(directory: Path, duration: float) -> int:
    check_directory(directory)
    directory.mkdir(parents=True, exist_ok=True)
    _environment()
    from ament_index_python.packages import get_package_share_directory

    preset = Path(get_package_share_directory('impact_damper_ros')) / 'config' / 'bench_rig.yaml'
    known = set(directory.iterdir())
    print(
        f'A 5 Hz bench rig runs live on ROS 2 for {duration:.0f} s, at {SPEED:g} times its speed, '
        'and is recorded to MCAP.'
    )
    node = _start_node(preset, directory)
    try:
        states, impacts = _perform(node, duration)
    except RuntimeError as error:
        raise CommandError(str(error), EXIT_FAILED) from error
    finally:
        end_node(node, PATIENCE_S)
    bags = sorted(path for path in set(directory.iterdir()) - known if path.is_dir())
    if not bags:
        raise CommandError(f'the node left no recording in {directory}', EXIT_FAILED)
    picture, report = directory / 'motion.png', directory / 'report'
    print(f'\n{states} joint_states and {impacts} impacts arrived over DDS.')
    code = _compare(bags[-1], report)
    compared = (report / 'report.json').is_file()
    rows = _rows(report) if compared else []
    _draw(bags[-1], preset, picture, rows)
    if compared:
        print('From the recording:\n')
        print(_table(rows, load_parameters(preset)[0].response_amplitude))
        _print_verdicts(report)
    readers = '(rig_page --bag, ros2 bag play, or any MCAP reader)'
    print(f'\nrecording  {os.path.relpath(bags[-1])}   {readers}')
    print(f'picture    {os.path.relpath(picture)}')
    if compared:
        print(f'report     {os.path.relpath(report / "report.html")}   (any browser)')
    return code


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demonstration."""
    parser = command_parser('demo', __doc__.split('\n\n')[0])
    parser.add_argument('directory', nargs='?', type=Path, default=Path('demo_run'))
    parser.add_argument(
        '--duration', type=float, default=30.0, help=f'seconds, at least {LEAST_S:g} [30]'
    )
    arguments = parser.parse_args(argv)
    directory, duration = arguments.directory.resolve(), max(LEAST_S, arguments.duration)
    return outcome(
        'demo',
        lambda: _demonstrate(directory, duration),
        'interrupted; the recording so far is kept',
    )


if __name__ == '__main__':
    sys.exit(run('demo', main))
