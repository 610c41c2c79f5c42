# SPDX-License-Identifier: Apache-2.0
"""
A controller held to its specification, in lock-step: the same result on any machine, and in CI.

pytest test_specification.py
"""

from pathlib import Path

import numpy as np

from impact_damper_ros.node.lock_step import run_in_lock_step
from impact_damper_ros.replay import RecordedRun, Replay

#: A rig of 1 kg at its resonance of 5 Hz, with stops on actuators.
RIG = {
    'primary_mass': 1.0,
    'stiffness': 1000.0,
    'damping': 0.6,
    'damper_mass': 0.1,
    'force_amplitudes': '[10.0]',
    'force_frequencies': '[31.6]',
    'gap': 0.03,
    'gap_max': 0.5,
    'actuator_speed': 2.0,
    'actuator_mass': 0.01,
}
SECONDS = 6.0


def test_the_gap_follows_the_amplitude(tmp_path):
    """Amplitude of M, energy of the actuators, and speed of the stops."""
    gaps = {'narrow': 0.1, 'wide': 0.2, 'threshold': 0.012}
    controller = Path(__file__).with_name('on_off_gap.py')
    bag = run_in_lock_step(controller, SECONDS, tmp_path / 'runs', RIG, gaps)
    replay = Replay(RecordedRun(bag))
    samples = np.concatenate([part.samples for part in replay])
    samples = samples[samples['time'] <= SECONDS]
    late = samples[samples['time'] > SECONDS / 2]
    assert replay.findings.verdict.name == 'IDENTICAL'
    # The specification
    assert np.sqrt(np.mean(late['x'] ** 2)) < 0.020
    assert sum(replay.rig.energies) < 0.1
    for stop in ('stop_1', 'stop_2'):
        speed = np.abs(samples[f'{stop}_velocity'] - samples['primary_velocity'])
        assert speed.max() <= RIG['actuator_speed'] * (1.0 + 1e-12)
    assert Path(bag, 'metadata.yaml').exists()
