"""Controlled rigs for the tests: the rig of the design trials, and random ones."""

from __future__ import annotations

import math
import random
from typing import Any

from rig.random_rigs import random_rig

from impact_damper_ros.control import GapControlParameters, Rig
from impact_damper_ros.rig import RigParameters

#: zeta = 0.01, mu = 0.1, R = 0.5, at resonance and level: X = 50 without impacts.
TRIAL = RigParameters(
    damping=0.02, damper_mass=0.1, restitution_1=0.5, restitution_2=0.5, gravity=0.0, gap=20.0
)
#: X over that without impacts, at best: zeta/(zeta + zeta_eq).
_ZETA_EQ = 2.0 / math.pi * 0.1 / 1.1 * 1.5 / 0.5
IDEAL = 0.01 / (0.01 + _ZETA_EQ)


def control(mode: str, **values: Any) -> GapControlParameters:
    """Return a control that samples some thirty times a cycle of a rig of unit frequency."""
    return GapControlParameters(gap_control=mode, **{'gap_control_rate': 5.0, **values})


def random_control(rng: random.Random, **fixed: Any) -> GapControlParameters:
    """Return a control of any kind."""
    gap_min = 10 ** rng.uniform(-3, 0)
    drawn: dict[str, Any] = {
        'gap_control': rng.choice(['amplitude', 'timed', 'timed', 'predictive']),
        'gap_control_stops': rng.choice(['symmetric', 'independent']),
        'gap_control_gain': rng.uniform(0.2, 1.2),
        'gap_control_park': rng.uniform(0.5, 3),
        'gap_control_lead': rng.choice([0.0, 0.05, 0.3]),
        'gap_control_timing_gain': rng.choice([0.1, 0.5]),
        'gap_control_smoothing': rng.choice([0.1, 0.3, 1.0]),
        'gap_control_threshold': rng.choice([0.0, 0.0, 0.5]),
        'gap_min': gap_min,
        'gap_max': gap_min * 10 ** rng.uniform(0.2, 3),
        'gap_control_rate': rng.choice([1.0, 4.0, 10.0]),
        'gap_control_noise_position': rng.choice([0.0, 0.02]),
        'gap_control_noise_velocity': rng.choice([0.0, 0.02]),
        'gap_control_seed': rng.randrange(1000),
        'actuator_delay': rng.choice([0.0, 0.0, 0.1, 1.0]),
        'actuator_speed': rng.choice([0.0, 0.3, 3.0, 30.0]),
        'actuator_mass': rng.choice([0.0, 0.01]),
    }
    return GapControlParameters(**{**drawn, **fixed})


def random_controlled_rig(seed: int | str, **fixed: Any) -> Rig:
    """Return a random rig under a random control."""
    parameters, initial = random_rig(seed, **fixed)
    return Rig(parameters, initial, control=random_control(random.Random(f'c{seed}')))


def amplitude_ratio(rig: Rig, cycles: int, watched: int) -> float:
    """Return the rms amplitude of X in the last cycles, over that of the rig without impacts."""
    cycle = math.tau / rig.parameters.force_frequencies[0]
    begun = rig.time + (cycles - watched) * cycle
    rig.run(begun, record=False)
    instants = [begun + k * cycle / 32 for k in range(1, 32 * watched + 1)]
    x = rig.run(instants[-1], instants, record=False).samples['x']
    return math.sqrt(2.0 * float((x**2).mean())) / rig.parameters.response_amplitude
