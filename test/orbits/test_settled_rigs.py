"""The solver against long simulation: random rigs that settle into a periodic motion."""

import math

import numpy as np
import pytest

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.orbits.recognition import repeated_impacts
from impact_damper_ros.orbits.settling import settled_impacts
from impact_damper_ros.rig import InitialConditions, RigParameters

# Random rigs that settle into a periodic motion of at most six impacts within 600 cycles
TWO_SIDED = (
    *(
        1,
        16,
        20,
        22,
        23,
        25,
        26,
        28,
        31,
        34,
        35,
        37,
        41,
        46,
        49,
        50,
        55,
        58,
        64,
        71,
        76,
        79,
        80,
        82,
        88,
    ),
    95,
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
    """Return the impacts of a period and its number of cycles."""
    start = InitialConditions(initial_primary_position=0.1 * rig.response_amplitude)
    impacts = settled_impacts(rig, start, 600, 20)
    motion = repeated_impacts(impacts, math.tau / rig.force_frequencies[0], 4, 1e-10)
    assert motion is not None
    return motion


def apart(orbit, impacts, cycle):
    """Return how far a settled motion is from an orbit, whichever impact it is counted from."""
    size = max(abs(event.x) for event in impacts)
    speed = max(abs(event.damper_velocity_after) for event in impacts)
    period = orbit.period
    best = math.inf
    for shift in range(len(impacts)):
        turned = impacts[shift:] + [e._replace(time=e.time + period) for e in impacts[:shift]]
        if tuple(event.stop for event in turned) != orbit.stops:
            continue
        late = turned[0].time - orbit.instants[0]
        late = cycle * round(late / cycle)
        differences = [
            max(
                abs(event.time - instant - late) / cycle,
                abs(event.x - x) / size,
                abs(event.damper_velocity_after - after) / speed,
            )
            for event, instant, x, after in zip(
                turned, orbit.instants, orbit.x, orbit.damper_velocity_after, strict=True
            )
        ]
        best = min(best, max(differences))
    return best


@pytest.mark.parametrize('seed', TWO_SIDED + ONE_SIDED)
def test_solver_finds_what_the_rig_settles_into(seed):
    rig = random_rig(seed)
    impacts, cycles = settled(rig)
    stops = tuple(event.stop for event in impacts)
    orbits = [o for o in find_orbits(rig, stops, cycles, starts=100).orbits if o.viable]
    best = min(orbits, key=lambda orbit: apart(orbit, impacts, orbit.cycle))
    assert apart(best, impacts, best.cycle) < 1e-9
    assert best.stable


def test_the_rigs_are_of_all_kinds():
    motions = [settled(random_rig(seed)) for seed in (20, 24, 39, 41, 46, 66)]
    kinds = {(tuple(event.stop for event in impacts), cycles) for impacts, cycles in motions}
    assert kinds == {
        ((1, 1, 2), 1),
        ((1, 1), 2),
        ((1, 1, 2, 2), 1),
        ((1,), 3),
        ((1, 2, 1, 2), 2),
        ((1, 1, 1), 3),
    }


@pytest.mark.parametrize('tolerance', [1e-6, 1e-10])
def test_repetition_is_recognised(tolerance):
    rig = RigParameters(gravity=0.0)
    impacts = settled_impacts(rig, InitialConditions(), 700, 10)
    found = repeated_impacts(impacts, math.tau, 8, tolerance)
    assert found is not None
    period, cycles = found
    assert cycles == 1
    assert [event.stop for event in period] == [1, 2]


def test_transient_is_no_repetition():
    impacts = settled_impacts(RigParameters(gravity=0.0), InitialConditions(), 40, 30)
    assert repeated_impacts(impacts, math.tau) is None
    assert repeated_impacts([], math.tau) is None
