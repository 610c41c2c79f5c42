# SPDX-License-Identifier: Apache-2.0
"""
A controller in a test: a run in lock-step, recorded, that is the same on any machine.

The rig and the controller are processes of their own. The rig waits at each measurement for the
command to it. So the motion does not depend on how fast either of them is.
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

HERE = Path(__file__).parent
#: Longest wall time for a run, s.
PATIENCE = 300.0


def command_line(program, space, parameters):
    """Return a program in a namespace, with parameters of ROS."""
    texts = [f'{n}:={str(v).lower() if isinstance(v, bool) else v}' for n, v in parameters.items()]
    words = [word for text in texts for word in ('-p', text)]
    return [sys.executable, *program, '--ros-args', '-r', f'__ns:={space}', *words]


def run_in_lock_step(controller, seconds, directory, rig, settings=None):
    """
    Run a rig with a controller in lock-step; return its bag.

    Parameters
    ----------
    controller : Path
        The controller, a script.
    seconds : float
        Duration, in rig time.
    directory : Path
        Where the bag is made.
    rig, settings : dict
        Parameters of the rig's node, and of the controller.
    """
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

    def look(states):
        now[0] = states.header.stamp.sec + states.header.stamp.nanosec * 1e-9

    # Others may test on this network as well.
    space = f'/lock_step_{os.getpid()}'
    node.create_subscription(JointState, f'{space}/joint_states', look, 1)
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
    with ExitStack() as stack:
        stack.callback(context.try_shutdown)
        stack.callback(node.destroy_node)
        programs = (['-m', 'impact_damper_ros.node.sim_node'], rig), ([controller], settings or {})
        processes = []
        for program, parameters in programs:
            line = command_line(map(str, program), space, parameters)
            processes.append(subprocess.Popen(line, env=environment))
            stack.callback(processes[-1].wait)
            stack.callback(processes[-1].kill)
        end = time.monotonic() + PATIENCE
        while now[0] < seconds:
            executor.spin_once(timeout_sec=0.1)
            assert time.monotonic() < end, f'the run has come to {now[0]} s only'
            assert all(process.poll() is None for process in processes), 'a process has ended'
        # The rig first: its bag ends in the middle of a run, not of a wait.
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE)
    (bag,) = Path(directory).iterdir()
    return bag
