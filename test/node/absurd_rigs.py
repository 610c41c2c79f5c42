"""
Rigs that are admissible and absurd, on a live node: times to answer and to end, and the bag.

    PYTHONPATH=.:test python -m node.absurd_rigs [NAME ...]

Each rig is set on a node of its own that records at 1 kHz. It is reset while the node works on it,
and another parameter is set; then the node is interrupted. On a machine of its own each answer is
to come within 0.5 s and the end within 2 s; the bag must be whole, and its replay the same.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run
from node.rig_client import LIVELY, RigClient, RigParametersClient, SimProcess, until

ANSWER_S, END_S = 0.5, 2.0
ELASTIC = {'restitution_1': 1.0, 'restitution_2': 1.0}
RIGS = {
    'calm': {},
    'spring': {'stiffness': 1e15},
    'spring, light M': {'stiffness': 1e15, 'primary_mass': 1e-6, 'damping': 0.0},
    'force': {'force_frequencies': [1e6]},
    'gap': {'gap': 1e-9, 'gravity': 1e4, 'friction': 0.0, 'angle': 0.7854, **ELASTIC},
    'elastic': {**ELASTIC, 'angle': 0.7854, 'friction': 0.0},
    'air': {'air_force': 1e5, **ELASTIC},
    'more air': {'air_force': 1e9, **ELASTIC},
    'lines': {
        'multisine_level': 1.0,
        'multisine_low': 12000.0,
        'multisine_high': 12566.0,
        'multisine_lines': 512,
    },
    'balanced': {'angle': 0.7853981633974483, 'friction': 1.0, 'force_amplitudes': [0.0]},
    'timed': {'gap_control': 'timed', 'stiffness': 1e12},
    'runaway': {
        'gap': 1e-9,
        'gravity': 0.0,
        'friction': 0.0,
        'initial_damper_velocity': 1e9,
        **ELASTIC,
    },
}


class Found(NamedTuple):
    """Times of the answers and of the end, s; what diagnostics say; whether the bag is whole."""

    answers: tuple[float, ...]
    end: float
    code: int
    said: tuple[str, ...]
    whole: bool
    replay: int


def trial(name: str, directory: Path, seconds: float) -> Found:
    """Set a rig on a node, and ask it after some seconds each."""
    answers: list[float] = []

    with RigClient() as client:
        reports = client.listen(DiagnosticArray, '/diagnostics')
        states = client.listen(JointState, '/joint_states')
        process = SimProcess(
            directory, record=True, predict_motion=False, state_rate=1000.0, **LIVELY
        )
        parameters = RigParametersClient(client)
        try:
            until(lambda: len(states) > 20, lambda: process.output)

            def ask(**values: object) -> None:
                began = time.monotonic()
                if values:
                    assert parameters.set_atomically(**values) == ''
                else:
                    assert client.call(Trigger, '/sim_node/reset').success
                answers.append(time.monotonic() - began)
                time.sleep(seconds)

            # The first answer also takes the time in which client and node find each other
            assert parameters.set(damper_mass=0.1) == ''
            ask(**RIGS[name])
            # Initial values act from a reset on
            ask()
            reports.clear()
            until(lambda: len(reports) > 1)
            said = {s.message for r in list(reports) for s in r.status if s.level != b'\0'}
            ask(damper_mass=0.11)
            began = time.monotonic()
            code = process.stop()
            end = time.monotonic() - began
        finally:
            if process.running():
                process.kill()
    (bag,) = (directory / 'runs').iterdir()
    reader = RunReader(bag)
    whole = reader.complete and reader.unusable == 0
    whole = whole and recover_run([str(bag), '--output', str(directory / 'recovered')]) == 0
    return Found(tuple(answers), end, code, tuple(sorted(said)), whole, replay_run([str(bag)]))


def main() -> int:
    """Try rigs and return 1 if a limit is exceeded or a bag is not whole."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'of {", ".join(RIGS)}')
    parser.add_argument('--seconds', type=float, default=2.0, help='before each question [2]')
    options = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(30 + os.getpid() % 60))
    failed = 0
    for name in options.names or RIGS:
        with tempfile.TemporaryDirectory() as directory:
            found = trial(name, Path(directory) / 'node', options.seconds)
        good = max(found.answers) < ANSWER_S and found.end < END_S and found.whole
        good = good and (found.code, found.replay) == (0, 0)
        failed += not good
        times = ' '.join(f'{seconds:.3f}' for seconds in (*found.answers, found.end))
        print(f'{name}: {"good" if good else "FAILED"}, {times} s; {"; ".join(found.said)}')
    return min(1, failed)


if __name__ == '__main__':
    sys.exit(main())
