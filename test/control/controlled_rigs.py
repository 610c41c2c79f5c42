"""Controlled rigs for the tests: the rig of the design trials, and random ones."""

from __future__ import annotations

import json
import math
import random
from typing import Any

import pytest
from rig.random_rigs import random_rig

from impact_damper_ros.control import ControlledRig, GapControlParameters
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.studies.gap_control.runs import Case, Measured, run_case

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


def one_form_of_the_loop(patch: pytest.MonkeyPatch) -> None:
    """
    Let every law run in the loop that holds the predictive one, for any number of harmonics.

    The motion is the same, and the loop that holds the predictive law takes a minute to compile:
    with all rigs in one form it is compiled once for all tests.
    """
    patch.setattr('impact_damper_ros.control.controlled_run._ControlLoop._is_predictive', True)
    patch.setattr('impact_damper_ros.rig.long_run._MOST_IN_TUPLES', -1)


def run_in_one_form(case: Case) -> Measured:
    """Make a run of the study in that form, in whatever process."""
    with pytest.MonkeyPatch.context() as patch:
        one_form_of_the_loop(patch)
        return run_case(case)


def random_control(rng: random.Random) -> GapControlParameters:
    """Return a control of any kind."""
    gap_min = 10 ** rng.uniform(-3, 0)
    return GapControlParameters(
        gap_control=rng.choice(['amplitude', 'timed', 'timed', 'predictive']),
        gap_control_stops=rng.choice(['symmetric', 'independent']),
        gap_control_gain=rng.uniform(0.2, 1.2),
        gap_control_park=rng.uniform(0.5, 3),
        gap_control_lead=rng.choice([0.0, 0.05, 0.3]),
        gap_control_timing_gain=rng.choice([0.1, 0.5]),
        gap_control_smoothing=rng.choice([0.1, 0.3, 1.0]),
        gap_control_threshold=rng.choice([0.0, 0.0, 0.5]),
        gap_min=gap_min,
        gap_max=gap_min * 10 ** rng.uniform(0.2, 3),
        gap_control_rate=rng.choice([1.0, 4.0, 10.0]),
        gap_control_noise_position=rng.choice([0.0, 0.02]),
        gap_control_noise_velocity=rng.choice([0.0, 0.02]),
        gap_control_seed=rng.randrange(1000),
        actuator_delay=rng.choice([0.0, 0.0, 0.1, 1.0]),
        actuator_speed=rng.choice([0.0, 0.3, 3.0, 30.0]),
        actuator_mass=rng.choice([0.0, 0.01]),
    )


def random_controlled_rig(seed: int | str, **fixed: Any) -> ControlledRig:
    """Return a random rig under a random control."""
    parameters, initial = random_rig(seed, **fixed)
    return ControlledRig(parameters, initial, control=random_control(random.Random(f'c{seed}')))


def through_json(rig: ControlledRig) -> ControlledRig:
    """Return the rig after a journey of its snapshot through a JSON text."""
    return ControlledRig.restore(json.loads(json.dumps(rig.snapshot(), allow_nan=False)))


def amplitude_ratio(rig: ControlledRig, cycles: int, watched: int) -> float:
    """Return the rms amplitude of X in the last cycles, over that of the rig without impacts."""
    p = rig.parameters
    cycle = math.tau / p.force_frequencies[0]
    start = rig.time
    rig.advance(start + (cycles - watched) * cycle)
    begun = rig.time
    total = 0.0
    count = 32 * watched
    for k in range(1, count + 1):
        rig.advance(begun + k * cycle / 32)
        total += rig.sample().x ** 2
    return math.sqrt(2.0 * total / count) / p.response_amplitude
