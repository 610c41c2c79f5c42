"""Long runs of random rigs under random control, with random switching: nothing runs away."""

import math
import random

import pytest

from control.controlled_rigs import random_control, random_controlled_rig


def bound(parameters):
    """Return a bound of |X| that holds whatever m does: M under the force, m and its weight."""
    p = parameters
    # A rig with so much damping that the force and what m can add stay small multiples of this.
    force = sum(map(abs, p.force_amplitudes))
    weight = p.damper_mass * p.gravity * (1.0 + p.friction)
    return 40.0 * (force + weight + p.air_force) / p.stiffness / p.zeta


@pytest.mark.parametrize('seed', range(16))
def test_random_rigs_stay_bounded(seed):
    rng = random.Random(f'b{seed}')
    rig = random_controlled_rig(
        f'b{seed}',
        damping=rng.choice([0.02, 0.1, 0.5]),
        air_force=0.0,
        one_sided=False,
        restitution_1=rng.uniform(0.0, 0.9),
        restitution_2=rng.uniform(0.0, 0.9),
    )
    largest = 0.0
    for k in range(1, 41):
        rig.advance(8.0 * k)
        sample = rig.sample()
        assert all(map(math.isfinite, sample))
        stop_1, stop_2 = rig.stops
        y = sample.z - sample.x
        assert stop_2 - 1e-9 <= y <= stop_1 + 1e-9
        largest = max(largest, abs(sample.x))
        assert all(map(math.isfinite, rig.energies))
        if rng.random() < 0.1:
            rig.change(
                rig.parameters,
                random_control(rng).replace(gap_control=rng.choice(['off', 'amplitude', 'timed'])),
            )
    assert largest < bound(rig.parameters)
