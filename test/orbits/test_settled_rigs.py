"""The solver against long simulation: random rigs that settle into a periodic motion."""

import math

import numpy as np
import pytest
from rig.random_rigs import any_rig

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import find_orbits, settle
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters

# Random rigs that settle into a periodic motion of at most six impacts within 600 cycles
TWO_SIDED = (
    *(1, 16, 20, 22, 23, 25, 26, 28, 31, 34, 35, 37, 41),
    *(46, 49, 50, 55, 58, 64, 71, 76, 79, 80, 82, 88, 95),
)
ONE_SIDED = (24, 39, 48, 66, 72, 87, 96, 108, 123, 129, 132, 162)


def random_rig(seed):
    """Return a rig near resonance with a gap of the right order, or a one-sided one well above."""
    rng = np.random.default_rng(seed)

    def between(low, high):
        return float(rng.uniform(low, high))

    one_sided = seed % 3 == 0
    mass, stiffness = between(0.5, 3.0), between(0.5, 20.0)
    damper_mass = mass * between(0.02, 0.2)
    omega = math.sqrt(stiffness / mass)
    ratio = between(0.1, 0.4) if one_sided else between(0.015, 0.05)
    rig = RigParameters(
        primary_mass=mass,
        stiffness=stiffness,
        damping=2.0 * ratio * omega * mass,
        damper_mass=damper_mass,
        force_phases=(between(-3.0, 3.0),),
    )
    if one_sided:
        frequency = omega * between(3.0, 9.0)
        rig = rig.replace(
            one_sided=True,
            angle=between(0.3, 1.57),
            gravity=between(0.5, 9.8),
            restitution_1=between(0.3, 0.85),
            force_frequencies=(frequency,),
        )
        pull = rig.gravity * math.sin(rig.angle)
        swing = between(0.5, 1.6) * pull / frequency**2
        return rig.replace(force_amplitudes=(swing / rig.response_amplitude,))
    restitution = between(0.5, 0.85)
    rig = rig.replace(
        restitution_1=restitution,
        restitution_2=restitution + between(-0.05, 0.05),
        force_frequencies=(omega * between(0.97, 1.05),),
        force_amplitudes=(between(0.5, 5.0),),
        angle=between(-0.1, 0.8),
    )
    between(0.0, 0.05)
    rig = rig.replace(friction=float(rng.choice([0.0, 0.0, 0.2])))
    swing = rig.response_amplitude * between(0.1, 0.35)
    acceleration = swing * omega**2
    return rig.replace(
        gap=math.pi * swing * (1 + restitution) / (1 - restitution) * between(0.3, 0.9),
        gravity=10.0 * acceleration * between(0.0, 0.01),
        air_force=float(rng.choice([0.0, 0.0, 0.01])) * damper_mass * acceleration,
    )


def settled(rig):
    """Return what a rig settles into, to eleven digits."""
    start = InitialConditions(initial_primary_position=0.1 * rig.response_amplitude)
    found = settle(Rig(rig, start), cycles=700, tolerance=1e-11, longest=4)
    assert found.period is not None
    return found


@pytest.mark.parametrize('seed', TWO_SIDED + ONE_SIDED)
def test_solver_finds_what_the_rig_settles_into(seed):
    rig = random_rig(seed)
    rhythm = settled(rig).rhythm
    orbits = find_orbits(rig, rhythm.stops, rhythm.cycles, starts=100).orbits
    best = min((o for o in orbits if o.viable), key=lambda orbit: orbit.distance(rhythm))
    assert best.distance(rhythm) < 1e-9
    assert best.stable


def test_the_rigs_are_of_all_kinds():
    rhythms = [settled(random_rig(seed)).rhythm for seed in (20, 24, 39, 41, 46, 66)]
    assert {(rhythm.stops, rhythm.cycles) for rhythm in rhythms} == {
        ((1, 1, 2), 1),
        ((1, 1), 2),
        ((1, 1, 2, 2), 1),
        ((1,), 3),
        ((1, 2, 1, 2), 2),
        ((1, 1, 1), 3),
    }


REVERSAL, STICK, RELEASE, REST = (
    EventKind.REVERSAL,
    EventKind.STICK,
    EventKind.RELEASE,
    EventKind.REST,
)
STICKS, RESTS = {REVERSAL, STICK, RELEASE}, {RELEASE, REST}
RESTS_AND_TURNS = {RELEASE, REST, REVERSAL}
#: Seed of a rig, impacts and cycles of the motion that it settles into, and other events of it
TABLE = [
    (1029, 1, 1, {REVERSAL}),
    (481, 1, 2, STICKS),
    (39, 2, 1, STICKS),
    (555, 2, 2, set()),
    (793, 2, 3, {REVERSAL}),
    (1797, 2, 3, STICKS),
    (1093, 3, 1, STICKS),
    (396, 3, 2, set()),
    (1828, 3, 2, STICKS),
    (1746, 3, 3, {REVERSAL}),
    (454, 4, 1, set()),
    (193, 4, 2, {REVERSAL}),
    (2099, 4, 3, STICKS),
    (1074, 4, 6, STICKS),
    (31, 5, 1, RESTS_AND_TURNS),
    (762, 5, 3, RESTS),
    (1125, 5, 5, STICKS),
    (71, 6, 1, RESTS),
    (11, 7, 1, RESTS),
    (1569, 7, 2, RESTS),
    (2459, 7, 4, RESTS_AND_TURNS),
    (15, 8, 1, RESTS_AND_TURNS | STICKS),
    (63, 8, 2, RESTS_AND_TURNS),
    (1212, 8, 5, set()),
    (175, 9, 1, RESTS_AND_TURNS),
    (970, 9, 2, RESTS_AND_TURNS),
    (643, 10, 1, RESTS),
    (649, 10, 4, RESTS_AND_TURNS),
    (571, 10, 10, STICKS),
    (952, 11, 1, RESTS),
    (58, 11, 2, RESTS),
]


@pytest.mark.parametrize(('seed', 'impacts', 'cycles', 'events'), TABLE)
def test_theory_has_the_motion_that_was_reached(seed, impacts, cycles, events):
    found = settle(Rig(any_rig(seed), compiled=None), cycles=600)
    assert (found.rhythm.impacts, found.rhythm.cycles) == (impacts, cycles)
    orbit = found.orbit
    assert orbit.viable
    assert orbit.stable
    assert {event.kind for event in orbit.events} == events
    assert orbit.residual < 1e-12
    # What the tolerance leaves of the transient
    rest = 1e-8 / (1.0 - abs(orbit.multipliers[0]))
    assert orbit.distance(found.rhythm) < rest
    assert orbit.x_max == pytest.approx(found.x_max, rel=rest)
    assert abs(orbit.multipliers[0]) == pytest.approx(found.multiplier, abs=10.0 * rest)
