"""Random rigs for property tests: all kinds of motion, at scales where much happens."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Sequence
from functools import cache
from math import nan
from typing import Any

import numpy as np
import pytest
from control import laws

from impact_damper_ros import (
    EVENT_TYPE,
    Event,
    GapControlParameters,
    InitialConditions,
    Order,
    Rig,
    RigParameters,
)

#: Events to the last field, as the tables of `Rig.run` have them but for the mode.
_NAMES = EVENT_TYPE.names[:-1]


def random_parameters(rng: random.Random, **fixed: Any) -> RigParameters:
    """Return a rig of unit mass and stiffness, more or less, with friction, slope, air, ..."""
    harmonics = rng.choice([1, 1, 1, 2, 4])
    angle = rng.choice([0.0, 0.0, rng.uniform(-1.5, 1.5), math.pi / 2, -math.pi / 2])
    drawn: dict[str, Any] = {
        'primary_mass': rng.choice([1.0, rng.uniform(0.5, 3)]),
        'stiffness': rng.choice([1.0, rng.uniform(0.5, 3)]),
        'damping': rng.choice([0.0, 0.01, 0.1, 1.0]),
        'damper_mass': rng.choice([0.042, 0.3, 2.0]),
        'gap': 10 ** rng.uniform(-0.7, 1.3),
        'restitution_1': rng.choice([0.0, 0.5, 0.75, 1.0, rng.random()]),
        'restitution_2': rng.choice([0.0, 0.5, 0.75, 0.9, rng.random()]),
        'angle': angle,
        'friction': rng.choice([0.0, 0.0, 0.1, 0.5, abs(math.tan(angle)) % 50.0]),
        'gravity': rng.choice([0.3, 1.0, 1.0, 9.81]),
        'air_force': rng.choice([0.0, 0.0, 0.02]),
        'one_sided': rng.random() < 0.15,
        'force_amplitudes': [rng.uniform(0.3, 2) / harmonics for _ in range(harmonics)],
        'force_frequencies': [rng.choice([1.0, rng.uniform(0.2, 4)]) for _ in range(harmonics)],
        'force_phases': [rng.uniform(-3, 3) for _ in range(harmonics)],
    }
    return RigParameters(**{**drawn, **fixed})


def random_initial(rng: random.Random, parameters: RigParameters) -> InitialConditions:
    """Return where it starts: anywhere in the gap, or on a stop."""
    half = parameters.gap / 2
    return InitialConditions(
        initial_primary_position=rng.choice([0.0, rng.uniform(-3, 3)]),
        initial_primary_velocity=rng.choice([0.0, rng.uniform(-3, 3)]),
        initial_damper_offset=rng.choice([0.0, rng.uniform(-half, half), half, -half]),
        initial_damper_velocity=rng.choice([0.0, rng.uniform(-3, 3)]),
    )


def random_rig(seed: int | str, **fixed: Any) -> tuple[RigParameters, InitialConditions]:
    """Return parameters and initial conditions of one seed."""
    rng = random.Random(seed)
    parameters = random_parameters(rng, **fixed)
    return parameters, random_initial(rng, parameters)


def random_change(rng: random.Random, parameters: RigParameters) -> RigParameters:
    """Return changed parameters of the kinds a user turns knobs at."""
    fresh = random_parameters(rng)
    names = rng.choice(
        [
            *[('gap',)] * 3,
            ('angle',),
            ('gravity', 'friction'),
            ('stiffness',),
            ('primary_mass', 'damper_mass'),
            ('restitution_1', 'restitution_2'),
            ('air_force',),
            ('one_sided',),
            ('force_amplitudes', 'force_frequencies', 'force_phases'),
        ]
    )
    return parameters.replace(damping=0.1, **{n: getattr(fresh, n) for n in names})


def random_command(rng: random.Random, rig: Rig) -> tuple[float | None, float | None, float]:
    """Return places and a speed: closing past m, opening, one stop or both, any speed."""
    half = rig.parameters.gap / 2
    width = rng.choice([rng.uniform(-1.2, 1.2), rng.uniform(-1.0, 1.0), 1.0, rng.uniform(0, 3)])
    place = half * width
    other = half * rng.choice([rng.uniform(-1.0, 1.0), 1.0, rng.uniform(0.0, 3.0)])
    first = rng.choice([None, place, place])
    second = None if rig.parameters.one_sided else rng.choice([None, -other, -other])
    return first, second, rng.choice([math.inf, 10 ** rng.uniform(-2, 1.5)])


def random_control(rng: random.Random, **fixed: Any) -> GapControlParameters:
    """Return a control of any kind."""
    gap_min = 10 ** rng.uniform(-3, 0)
    drawn: dict[str, Any] = {
        'gap_control': rng.choice(['amplitude', 'timed', 'timed']),
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


def through_json(rig: Rig) -> Rig:
    """Return the rig after a journey of its snapshot through a JSON text."""
    text = json.dumps(rig.snapshot(), allow_nan=False)
    return Rig.restore(json.loads(text), rig.own_law, compiled=rig.compiled)


def rows(events: list[Event]) -> list[tuple[float, ...]]:
    """Return events as the table of a run has them, without the mode."""
    return [tuple(getattr(event, name) for name in _NAMES) for event in events]


def without_mode(table: Any) -> list[tuple[float, ...]]:
    """Return the rows of the table of a run, without the mode."""
    return [row[:-1] for row in table.tolist()]


def run(rig: Rig, until: float, most: int = 4000) -> list[Event]:
    """Advance in steps, and stop early where an elastic chatter has very many impacts."""
    events: list[Event] = []
    start, steps = rig.time, 64
    for k in range(1, steps + 1):
        events += rig.advance(start + (until - start) * k / steps)
        if len(events) > most:
            break
    return events


def any_rig(seed: int) -> RigParameters:
    """Return a rig near its resonance: light or heavy, plastic or elastic, level or steep."""
    draw = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return round(float(draw.uniform(low, high)), 2)

    return RigParameters(
        gravity=float(draw.choice([0.0, 1.0, 9.8])),
        friction=float(draw.choice([0.0, 0.0, 0.1, 0.5])),
        angle=between(-1, 1) * float(draw.integers(0, 2)),
        gap=between(2, 60),
        damper_mass=between(0.02, 0.4),
        restitution_1=between(0, 0.9),
        restitution_2=between(0, 0.9),
        force_frequencies=(between(0.6, 1.6),),
        damping=between(0.01, 0.2),
    )


KINDS = ('free', 'stops', 'swept', 'multisine', 'off', 'amplitude', 'timed', 'own')
KINDS += ('external',)


@cache
def compiled_law() -> Any:
    """Return a law of one's own that moves one stop after the other, compiled once."""
    numba = pytest.importorskip('numba')
    return numba.njit(laws.push)


def rig_of(kind: str, seed: int, times: Sequence[float] = (0.0, 1234.5), **fixed: Any) -> Rig:
    """Return a rig of a kind that sees much; elastic stops would keep it busy for ever."""
    rng = random.Random(f'{kind} {seed}')
    parameters, initial = random_rig(f'{kind} {seed}', **fixed)
    parameters = parameters.replace(restitution_1=min(0.9, parameters.restitution_1))
    if kind == 'swept':
        parameters = parameters.replace(
            sweep_mode=rng.choice(['up', 'down', 'up_down']),
            sweep_low=0.5,
            sweep_high=2.5,
            sweep_step=rng.choice([0.05, 0.3]),
            sweep_dwell=rng.choice([0.05, 0.31]),
        )
    elif kind == 'multisine':
        parameters = parameters.replace(multisine_level=0.4, multisine_lines=8)
    control = None
    if kind not in ('free', 'stops', 'swept', 'multisine', 'off'):
        control = _control_of(kind, rng, 'timed' if kind == 'own' else kind)
    law = compiled_law() if kind == 'own' else None
    return Rig(parameters, initial, rng.choice(times), control, law)


def _control_of(kind: str, rng: random.Random, mode: str) -> GapControlParameters:
    wide = {'gap_min': 1e-3, 'gap_max': 1e3} if kind == 'own' else {}
    return random_control(rng, gap_control=mode).replace(**wide)


def act(kind: str, rng: random.Random, rigs: Sequence[Rig]) -> list[tuple[list[Event], list[str]]]:
    """Let the same happen to all the rigs; return the events and the records of each."""
    rig = rigs[0]
    if rig.control.gap_control == 'external' and rng.random() < 0.8:
        low, high = 0.5 * rig.control.gap_min, 0.5 * rig.control.gap_max
        # A stop that stands at a gap below the least one is in the way of the other alone.
        alone = rig.parameters.gap >= rig.control.gap_min
        stop_1, stop_2 = (
            rng.choice([nan if alone else low, rng.uniform(low, high)]) for _ in range(2)
        )
        stop_2 = nan if rig.parameters.one_sided else stop_2
        speeds = rng.choice([(nan, 2.0), (0.5, 0.5), (nan, nan)])
        order = Order(stop_1, -stop_2, *speeds, rng.choice([nan, 0.0, rng.gauss(0.0, 1.0)]))
        return [_seen(one, one.order(order)) for one in rigs]
    other = 'command' if kind in ('stops', 'swept') else 'control'
    chosen = rng.choice(['nothing', 'change', other])
    if chosen == 'change':
        changed = random_change(rng, rig.parameters)
        if kind == 'swept':
            changed = rig.parameters.replace(sweep_dwell=rng.choice([0.05, 0.31]))
        changed = changed.replace(restitution_1=min(0.9, changed.restitution_1))
        return [_seen(one, one.change(changed)) for one in rigs]
    if chosen == 'command':
        command = random_command(rng, rig)
        return [_seen(one, one.move_stops(*command)) for one in rigs]
    if chosen == 'control' and rig.control.active and rng.random() < 0.5:
        control = _control_of(kind, rng, rng.choice(['off', rig.control.gap_control]))
        return [_seen(one, one.change(rig.parameters, control)) for one in rigs]
    return [([], []) for _ in rigs]


def _seen(rig: Rig, events: list[Event]) -> tuple[list[Event], list[str]]:
    return events, list(map(str, rig.acts))
