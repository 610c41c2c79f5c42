"""The solver against long simulation: random rigs that settle into a periodic motion."""

import pytest
from motion.random_rigs import any_rig

from impact_damper_ros import EventKind, Rig, RigParameters, find_orbits, settle

REVERSAL, STICK, RELEASE, REST = (
    EventKind.REVERSAL,
    EventKind.STICK,
    EventKind.RELEASE,
    EventKind.REST,
)
STICKS, RESTS = {REVERSAL, STICK, RELEASE}, {RELEASE, REST}
RESTS_AND_TURNS = {RELEASE, REST, REVERSAL}
#: Seed of a rig, impacts and cycles of the motion that it settles into, and other events of it.
#: No rig is here that settles elsewhere from a start that is 1e-15 to 1e-10 gaps away.
TABLE = [
    (1029, 1, 1, {REVERSAL}),
    (481, 1, 2, STICKS),
    (39, 2, 1, STICKS),
    (555, 2, 2, set()),
    (13605, 2, 3, {REVERSAL}),
    (1797, 2, 3, STICKS),
    (1093, 3, 1, STICKS),
    (396, 3, 2, set()),
    (18753, 3, 2, STICKS),
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
    (1645, 8, 2, RESTS_AND_TURNS),
    (2576, 8, 4, set()),
    (175, 9, 1, RESTS_AND_TURNS),
    (970, 9, 2, RESTS_AND_TURNS),
    (643, 10, 1, RESTS),
    (649, 10, 4, RESTS_AND_TURNS),
    (571, 10, 10, STICKS),
    (952, 11, 1, RESTS),
    (58, 11, 2, RESTS),
]


#: A rig with one stop, driven well above its resonance.
ONE_SIDED = RigParameters(
    primary_mass=1.47,
    stiffness=12.1,
    damping=2.6,
    damper_mass=0.165,
    restitution_1=0.724,
    angle=1.05,
    gravity=5.41,
    one_sided=True,
    force_amplitudes=4.98,
    force_frequencies=23.5,
    force_phases=0.915,
)


def is_found(rhythm, rig):
    """Return whether the search finds the motion that a rig has settled into."""
    orbits = find_orbits(rig, rhythm.stops, rhythm.cycles, starts=100).orbits
    return any(o.viable and o.stable and o.distance(rhythm) < 1e-6 for o in orbits)


@pytest.mark.parametrize(('loud', 'cycles'), [(1.0, 1), (1.8, 2)])
def test_one_stop(loud, cycles):
    rig = ONE_SIDED.replace(force_amplitudes=loud * ONE_SIDED.force_amplitudes[0])
    rhythm = settle(Rig(rig, compiled=None)).rhythm
    assert (rhythm.stops, rhythm.cycles) == ((1,) * cycles, cycles)
    assert is_found(rhythm, rig)


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
    if impacts < 4:
        assert is_found(found.rhythm, found.parameters)
