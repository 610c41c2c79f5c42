"""The end of a chatter against the oracle, which resolves every bounce."""

import math
import random

import pytest

from impact_damper_ros.rig import EventKind, RigParameters, Simulator
from oracle.hybrid_oracle import mp
from oracle.hybrid_oracle import run as run_precisely

UNFORCED = {'gravity': 9.81, 'angle': math.pi / 2, 'force_amplitudes': (0.0,)}
BOUNCING_BALL = {**UNFORCED, 'damping': 0.02, 'gap': 2.0, 'restitution_1': 0.6, 'one_sided': True}
LIGHT = {
    'a millionth of M': {**BOUNCING_BALL, 'damper_mass': 1e-6},
    'a ten thousandth of M': {**BOUNCING_BALL, 'damper_mass': 1e-4},
    'on the bench rig': {
        **UNFORCED,
        'primary_mass': 2.0,
        'stiffness': 1974.0,
        'damping': 1.26,
        'damper_mass': 1e-6,
        'gap': 0.024,
        'restitution_1': 0.7,
    },
}


def pressed_rig(seed):
    """Return a rig whose weight brings m to rest on stop 1."""
    rng = random.Random(f'end of a chatter {seed}')
    return {
        'primary_mass': rng.uniform(0.5, 3.0),
        'stiffness': 10 ** rng.uniform(-1.0, 3.0),
        'damping': rng.choice([0.0, 0.02, 0.3]),
        'damper_mass': 10 ** rng.uniform(-6.0, 0.5),
        'gap': 10 ** rng.uniform(-1.5, 1.0),
        'restitution_1': rng.uniform(0.2, 0.6),
        'angle': rng.choice([math.pi / 2, rng.uniform(0.5, 1.5)]),
        'friction': rng.choice([0.0, 0.2]),
        'gravity': rng.choice([1.0, 9.81]),
        'force_amplitudes': (rng.choice([0.0, rng.uniform(0.0, 0.1)]),),
        'force_frequencies': (rng.uniform(0.3, 3.0),),
    }


@pytest.mark.parametrize(
    'params',
    [*LIGHT.values(), *(pressed_rig(seed) for seed in range(5))],
    ids=[*LIGHT, *(f'seed {seed}' for seed in range(5))],
)
def test_rest_is_where_the_bounces_end(params):
    """Its instant to 1e-12/omega; X and X' to 1e-12 of the amplitude."""
    p = RigParameters(**params)
    events = Simulator(p).advance(20.0)
    rest = next(event for event in events if event.kind is EventKind.REST)
    omega = math.sqrt(p.stiffness / p.primary_mass)
    precise = run_precisely(params, rest.time + 1e-3 / omega)
    true = next(event for event in precise.events if event.kind == 'rest')
    assert abs(true.time - mp.mpf(rest.time)) < 1e-12 / omega
    fastest = max(abs(event.primary_velocity_after) for event in precise.events)
    largest = max(fastest / omega, *(abs(event.x) for event in precise.events))
    # Both at one instant, that of the oracle's rest or just after.
    when = max(mp.mpf(rest.time), true.time)
    x, velocity, _, damper_velocity = precise.state(when)
    assert damper_velocity == velocity
    assert abs(x - mp.mpf(rest.x)) < 1e-12 * largest
    assert abs(velocity - mp.mpf(rest.primary_velocity_after)) < 1e-12 * fastest


@pytest.mark.parametrize('params', LIGHT.values(), ids=LIGHT)
def test_no_bounce_higher_than_a_billionth_of_the_gap_is_left_out(params):
    p = RigParameters(**params)
    impacts = [e for e in Simulator(p).advance(20.0) if e.kind is EventKind.IMPACT]
    last = impacts[-1]
    speed = abs(last.damper_velocity_after - last.primary_velocity_after)
    assert speed**2 / (2.0 * p.gravity) < 1e-9 * p.gap
