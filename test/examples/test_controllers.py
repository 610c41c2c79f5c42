"""The controllers of the examples with a live rig; lock-step runs are reproduced bit for bit."""

import cmath
import math
import sys
from pathlib import Path

import numpy as np
import pytest

CONTROLLERS = Path(__file__).parents[2] / 'examples' / 'controllers'
sys.path.append(str(CONTROLLERS))

import test_specification as specification  # noqa: E402
from rigs import LIVELY  # noqa: E402

from impact_damper_ros import GapControlParameters, Rig  # noqa: E402
from impact_damper_ros.bag import RunReader  # noqa: E402
from impact_damper_ros.node import lock_step  # noqa: E402
from impact_damper_ros.replay import RecordedRun, Replay  # noqa: E402

RIG = specification.RIG

#: On-off control that doubles the force on the way, and asks for a gap that is refused; as on a
#: machine that has no processor for it at times.
FORCE_STEP = f"""
import random
import sys
import time as clock

from impact_damper_ros.node.controller import run_controller

sys.path.append({str(CONTROLLERS)!r})
from on_off_gap import OnOffGap


class ForceStep(OnOffGap):
    force = 10

    def __init__(self):
        super().__init__()
        self.declare_parameter('slow', False)

    def command(self, time, seen):
        if self.value('slow') and random.random() < 0.05:
            clock.sleep(random.uniform(0.0, 0.1))
        if time > 1.5 and self.force == 10:
            self.force = 20
            self.set_rig(force_amplitudes=[self.force])
            try:
                self.set_rig(gap=-1, damping=0.8)
            except ValueError:
                return super().command(time, seen)
            raise RuntimeError('a gap of -1 m was accepted')
        return super().command(time, seen)


run_controller(ForceStep)
"""


#: What is the same in each run, with the instants of changes.
TOPICS = ('joint_states', 'impacts', 'gap_control', 'measurements', 'parameter_events')


def recorded(bag, seconds):
    """Return the messages of each topic of the rig up to a rig time, as bytes."""
    reader = RunReader(bag)
    return {
        name.rpartition('/')[2]: [
            (r.stamp_ns, r.content) for r in reader.messages([name]) if r.stamp_ns < seconds * 1e9
        ]
        for name, _ in reader.topics
        if name.endswith(TOPICS)
    }


def replayed(bag, seconds):
    """Return the samples of a run up to a rig time, which must be as recorded."""
    replay = Replay(RecordedRun(bag))
    samples = np.concatenate([part.samples for part in replay])
    assert replay.findings.verdict.name == 'IDENTICAL'
    return samples[samples['time'] <= seconds]


def rms(values):
    return math.sqrt(float(np.mean(values**2)))


def test_two_runs_in_lock_step_are_the_same_bits(tmp_path):
    """With noise, latency, jitter, losses and a change of the force; of a slow controller, too."""
    script = tmp_path / 'force_step.py'
    script.write_text(FORCE_STEP)
    rig = {
        **RIG,
        'gap_control_noise_position': 1e-4,
        'gap_control_noise_velocity': 1e-3,
        'gap_control_resolution_position': 1e-5,
        'gap_control_seed': 3,
        'measurement_latency': 0.002,
        'measurement_jitter': 0.004,
        'measurement_loss': 0.1,
    }
    seconds = 2.0
    # Switched by the noise as well
    gaps = {'narrow': 0.1, 'wide': 0.2, 'threshold': 0.03, 'hysteresis': 0.001, 'memory': 0.05}
    runs = []
    for slow in (False, True):
        place, settings = tmp_path / f'slow_{slow}', {**gaps, 'slow': slow}
        bag = lock_step.run_in_lock_step(script, seconds, place, rig, settings)
        runs.append(recorded(bag, seconds))
        replayed(bag, seconds)
    assert runs[0].keys() == set(TOPICS)
    for topic in TOPICS[:-1]:
        assert runs[0][topic] == runs[1][topic], topic
    # The start, and the one change that was accepted, at the instant its measurement came
    one, other = ([stamp for stamp, _ in run['parameter_events']] for run in runs)
    assert one == other
    assert len(one) == 2
    assert 1.5e9 < one[1] < 1.52e9
    # A tenth is lost.
    assert 335 < len(runs[0]['measurements']) < 385
    assert len(runs[0]['gap_control']) >= len(runs[0]['measurements'])


def test_the_timed_law_as_a_node_is_as_good_as_that_of_the_rig(tmp_path):
    seconds, rig = 9.0, {k: v for k, v in RIG.items() if k != 'actuator_speed'}
    known = {'primary_mass': 1.0, 'restitution': 0.75, 'gap': 0.01, 'gap_max': 0.5}
    known |= {'gap_min': 0.001, 'speed': 0.0, 'delay': 0.0}
    bag = lock_step.run_in_lock_step(
        CONTROLLERS / 'timed_gap.py', seconds, tmp_path / 'runs', {**rig, 'gap': 0.01}, known
    )
    samples = replayed(bag, seconds)
    law = GapControlParameters(gap_control='timed', gap_control_rate=200.0, gap_max=0.5)
    twin = Rig(LIVELY, control=law).run(seconds, samples['time']).samples
    late = samples['time'] > seconds - 2.0
    assert rms(samples['x'][late]) == pytest.approx(rms(twin['x'][late]), rel=0.05)


def test_skyhook_damping(tmp_path):
    """Without impacts: the frequency response with a dashpot that is held, half a hold late."""
    seconds, rate, dashpot = 3.0, 200.0, 10.0
    bag = lock_step.run_in_lock_step(
        CONTROLLERS / 'skyhook.py',
        seconds,
        tmp_path / 'runs',
        {
            **RIG,
            'gap': 10.0,
            'gap_max': 100.0,
            'lock_step': 'force_command',
            # A file ends after the command of its last stamp.
            'max_bag_duration': 1.0,
        },
        {'damping': dashpot},
    )
    samples = replayed(bag, seconds)
    frequency = RIG['force_frequencies'].strip('[]')
    turn = float(frequency)
    half = 0.5 * turn / rate
    held = dashpot * math.sin(half) / half * cmath.exp(-1j * half)
    stiffness = RIG['stiffness'] - RIG['primary_mass'] * turn**2
    response = 10.0 / abs(stiffness + 1j * turn * (RIG['damping'] + held))
    late = samples['time'] > seconds - 10 * math.tau / turn
    assert math.sqrt(2.0) * rms(samples['x'][late]) == pytest.approx(response, rel=5e-3)


def test_the_specification(tmp_path):
    specification.test_the_gap_follows_the_amplitude(tmp_path)
