# SPDX-License-Identifier: Apache-2.0
"""
A controller in a test: a run in lock-step, recorded, that is the same on any machine.

The rig and the controller are processes of their own. The rig waits at each measurement for the
command to it. The motion therefore does not depend on the speed of either process.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from .external_control import NOT_AWAITED

#: Longest wall time in which a run may stand still, s.
PATIENCE_S = 300.0


def _command_line(
    program: Sequence[str], space: str, parameters: Mapping[str, object]
) -> list[str]:
    """Return a program in a namespace, with parameters of ROS."""
    texts = [f'{n}:={str(v).lower() if isinstance(v, bool) else v}' for n, v in parameters.items()]
    words = [word for text in texts for word in ('-p', text)]
    return [sys.executable, *program, '--ros-args', '-r', f'__ns:={space}', *words]


class Progress:
    """Whether a run still moves; a slow run may take any time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._reached, self._since = 0.0, clock()

    def look(self, reached: float) -> None:
        """Raise a RuntimeError if rig time, s, has stood still for `PATIENCE_S`."""
        if reached > self._reached:
            self._reached, self._since = reached, self._clock()
        elif self._clock() > self._since + PATIENCE_S:
            raise RuntimeError(f'the run has stood still at {reached:g} s for {PATIENCE_S:g} s')


def run_in_lock_step(
    controller: str | Path,
    seconds: float,
    directory: str | Path,
    rig: Mapping[str, object],
    settings: Mapping[str, object] | None = None,
) -> Path:
    """
    Run a rig with a controller in lock-step; return its bag.

    Parameters
    ----------
    controller : path
        The controller, a Python script that takes the arguments of ROS.
    seconds : float
        Duration, in rig time.
    directory : path
        Directory of the bag; empty or absent.
    rig, settings : dict
        Parameters of the rig's node, and of the controller.

    Raises
    ------
    FileExistsError
        If the directory is not empty.
    RuntimeError
        If the rig or the controller ends early, rig time stands still for minutes, or the
        commands come on another topic than `lock_step` names: `stop_commands`, if not in `rig`.
    """
    if Path(directory).exists() and any(Path(directory).iterdir()):
        raise FileExistsError(f'{directory} is not empty: give each run a directory of its own')
    rig = {
        'gap_control': 'external',
        'lock_step': 'stop_commands',
        'measurement_rate': 200.0,
        # As fast as possible
        'real_time_factor': 0.0,
        'predict_motion': False,
        'record': True,
        'bag_directory': directory,
        **rig,
    }
    context = Context()
    rclpy.init(context=context)
    node = Node('lock_step', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    now = [0.0]

    def look(states: Any) -> None:
        now[0] = states.header.stamp.sec + states.header.stamp.nanosec * 1e-9

    # Other tests may run on this network.
    space = f'/lock_step_{os.getpid()}'
    node.create_subscription(JointState, f'{space}/joint_states', look, 1)
    refusals: list[tuple[float, str]] = []

    def watch(report: Any) -> None:
        refusals.extend(
            (now[0], status.message)
            for status in report.status
            if status.name == f'{space[1:]}/sim_node: controller' and NOT_AWAITED in status.message
        )

    node.create_subscription(DiagnosticArray, '/diagnostics', watch, 10)
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
    with ExitStack() as stack:
        stack.callback(context.try_shutdown)
        stack.callback(node.destroy_node)
        programs: Sequence[tuple[list[str], Mapping[str, object]]] = (
            (['-m', 'impact_damper_ros.node.sim_node'], rig),
            ([str(controller)], settings or {}),
        )
        processes = []
        for program, parameters in programs:
            line = _command_line(program, space, parameters)
            processes.append(subprocess.Popen(line, env=environment))
            stack.callback(processes[-1].wait)
            stack.callback(processes[-1].kill)
        progress = Progress()
        while now[0] < seconds:
            executor.spin_once(timeout_sec=0.1)
            progress.look(now[0])
            if len({reached for reached, _ in refusals}) < len(refusals):
                raise RuntimeError(refusals[-1][1])
            for process, (program, _) in zip(processes, programs, strict=True):
                if process.poll() is not None:
                    raise RuntimeError(f'{program[-1]} has ended at {now[0]:g} s')
        # The rig is stopped first: its bag then ends in the middle of a run, not of a wait.
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)
    (bag,) = Path(directory).iterdir()
    return bag
