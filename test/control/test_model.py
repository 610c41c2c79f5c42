"""The motion ahead as a law computes it, against the simulator."""

import math
import random

import pytest

from control.controlled_rigs import random_controlled_rig
from impact_damper_ros.control.model import motion_ahead, sent_off
from impact_damper_ros.rig import Simulator


@pytest.mark.parametrize('seed', range(40))
def test_it_is_the_motion_of_the_simulator(seed):
    """After any command to both stops, at once or at a speed."""
    rng = random.Random(seed)
    controlled = random_controlled_rig(f'p{seed}')
    controlled.advance(rng.uniform(2.0, 15.0))
    state = {k: v for k, v in controlled.snapshot().items() if k != 'gap_control'}
    rig = Simulator.restore(state)
    half = 0.5 * rig.parameters.gap
    stop_2, stop_1 = sorted(rng.uniform(-1.5, 1.5) * half for _ in range(2))
    speed = rng.choice([math.inf, math.inf, rng.uniform(0.5, 10.0)])
    constants, here = rig._constants, rig._present()
    end = rig.time + 3.0
    there = motion_ahead(constants, sent_off(constants, here, stop_1, stop_2, speed), end)
    rig.move_stops(stop_1, None if rig.parameters.one_sided else stop_2, speed=speed)
    rig.advance(end)
    sample = rig.sample()
    assert there.x == pytest.approx(sample.x, abs=1e-7)
    assert there.velocity == pytest.approx(sample.primary_velocity, abs=1e-7)
