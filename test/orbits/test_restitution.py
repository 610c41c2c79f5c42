"""Periodic motions of rigs whose restitution falls with the speed."""

import math

import numpy as np
import pytest

from impact_damper_ros import (
    InitialConditions,
    OrbitError,
    Rig,
    RigParameters,
    find_orbits,
    follow,
    value_of,
    with_value,
)
from impact_damper_ros.orbits.search import carried_over

HORIZONTAL = RigParameters(gravity=0.0, force_frequencies=1.02)
FALLING = HORIZONTAL.replace(restitution_speed=5.0, restitution_exponent=0.3)


def drawn(seed):
    """Return a random rig with two stable impacts in a cycle, more often than not."""
    draw = np.random.default_rng(seed)
    return RigParameters(
        gravity=float(draw.choice([0.0, 1.0])),
        angle=float(draw.uniform(-0.3, 0.3)),
        friction=float(draw.choice([0.0, 0.1])),
        gap=float(draw.uniform(5.0, 40.0)),
        damper_mass=float(draw.uniform(0.03, 0.2)),
        restitution_1=float(draw.uniform(0.5, 1.0)),
        restitution_2=float(draw.uniform(0.5, 1.0)),
        restitution_speed=float(10.0 ** draw.uniform(-0.5, 2.0)),
        restitution_exponent=float(draw.uniform(0.1, 0.6)),
        force_frequencies=(float(draw.uniform(0.9, 1.1)),),
    )


def found(seed):
    """Return the viable motions of two impacts in a cycle of a random rig."""
    return [o for o in find_orbits(drawn(seed), (1, 2), simulate=False) if o.viable]


ORBITS = [orbit for seed in range(8) for orbit in found(seed)]


def product_of_slopes(orbit):
    """Return the product of R and R + v dR/dv over the impacts, of the law as it is written."""
    p, product = orbit.parameters, 1.0
    before = np.subtract(orbit.damper_velocity_before, orbit.primary_velocity_before)
    for stop, v in zip(orbit.stops, np.abs(before), strict=True):
        rise = 1.0 + v / p.restitution_speed
        R = (p.restitution_1 if stop == 1 else p.restitution_2) * rise**-p.restitution_exponent
        product *= R * (R - p.restitution_exponent * R * v / (p.restitution_speed + v))
    return product


def test_the_product_of_the_multipliers():
    """Liouville's formula: exp(-2 zeta omega T) times R (R + v R') of each impact."""
    assert len(ORBITS) >= 8
    for orbit in ORBITS:
        p = orbit.parameters
        period = orbit.cycles * math.tau / p.first_harmonic[1]
        expected = math.exp(-2.0 * p.zeta * p.omega * period) * product_of_slopes(orbit)
        assert np.prod(orbit.multipliers).real == pytest.approx(expected, rel=1e-8)


def map_of(orbit, state):
    """Return the state just after an impact a period later, of the simulator."""
    p, first = orbit.parameters, orbit.instants[0]
    x, velocity, damper_velocity, late = state
    phase = p.force_phases[0] + p.force_frequencies[0] * (first + late)
    rig = Rig(
        p.replace(force_phases=phase),
        InitialConditions(
            initial_primary_position=x,
            initial_primary_velocity=velocity,
            initial_damper_velocity=damper_velocity,
            initial_damper_offset=(0.5 if orbit.stops[0] == 1 else -0.5) * p.gap,
        ),
    )
    period = orbit.cycles * math.tau / p.first_harmonic[1]
    events = rig.run(1.5 * period).events
    impacts = events[events['kind'] == 1]
    (last, *_) = impacts[impacts['stop'] == orbit.stops[0]]
    return np.array(
        [
            last['x'],
            last['primary_velocity_after'],
            last['damper_velocity_after'],
            late + last['time'] - period,
        ]
    )


@pytest.mark.parametrize('orbit', ORBITS[::2], ids=lambda orbit: f'{orbit.x_max:.3f}')
def test_multipliers_are_those_of_a_map_of_differences(orbit):
    start = np.array(
        [orbit.x[0], orbit.primary_velocity_after[0], orbit.damper_velocity_after[0], 0.0]
    )
    assert map_of(orbit, start) == pytest.approx(start, abs=1e-11)
    columns = []
    for k in range(4):
        move = np.zeros(4)
        move[k] = 2e-6 * max(1.0, abs(start[k]))
        one, two = (
            map_of(orbit, start + n * move) - map_of(orbit, start - n * move) for n in (1, 2)
        )
        columns.append((8.0 * one - two) / (12.0 * move[k]))
    expected = np.poly(np.linalg.eigvals(np.transpose(columns)))
    assert np.poly(orbit.multipliers).real == pytest.approx(
        expected.real, abs=1e-7 * np.abs(expected).max()
    )


def test_motions_are_followed_from_a_constant_restitution():
    """Along 1/v_c from 0, and along v_c and p; each end is what a search finds."""
    constant = HORIZONTAL.replace(restitution_exponent=0.3)
    (orbit, *_), (wanted, *_) = find_orbits(constant, (1, 2)), find_orbits(FALLING, (1, 2))
    branch = follow(orbit, 'restitution_slowness', 0.0, 0.2)
    last = max(branch.points, key=lambda point: point.value).orbit
    assert last.parameters == FALLING
    assert last.distance(wanted) < 1e-10
    assert carried_over(orbit, FALLING).distance(wanted) < 1e-10
    for name, low, high in (
        ('restitution_exponent', 0.1, 0.3),
        ('restitution_speed', 2.0, 5.0),
        ('gap', 30.0, 37.0),
        ('restitution', 0.7, 0.75),
    ):
        end = min(follow(wanted, name, low, high).points, key=lambda point: point.value).orbit
        there = with_value(FALLING, name, low)
        assert end.parameters == there
        assert min(o.distance(end) for o in find_orbits(there, (1, 2))) < 1e-10


def test_a_slowness_is_varied_within_its_range():
    with pytest.raises(OrbitError, match=r'give a range within 0 to 1000000$'):
        follow(find_orbits(HORIZONTAL, (1, 2))[0], 'restitution_slowness', 0.0, 2e6)
    assert value_of(FALLING, 'restitution_slowness') == 0.2
    assert with_value(FALLING, 'restitution_slowness', 0.0).restitution_speed == 0.0


@pytest.mark.parametrize(('seed', 'stops', 'cycles'), [(5, (2, 1, 2, 1), 2), (5, (2, 1, 1), 1)])
def test_a_motion_that_a_rig_settles_into_is_found(seed, stops, cycles):
    search = find_orbits(drawn(seed), stops, cycles)
    assert not search.report.complete
    assert any(orbit.stable and orbit.viable for orbit in search)
