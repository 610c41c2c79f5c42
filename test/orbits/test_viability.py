"""Viability: what the simulator does decides, and the reason says why."""

import numpy as np
import pytest
from rigs import INCLINED

from impact_damper_ros import EventKind, find_orbits
from impact_damper_ros.motion.flight import motion_at
from impact_damper_ros.orbits.flights import machine_of, moving_at
from impact_damper_ros.orbits.viability import extremes
from orbits.begun_rigs import begun_on


def follows(orbit):
    """Return whether the simulator has the orbit's events, and no others, for a period."""
    run = begun_on(orbit).advance(orbit.period * (1 + 1e-9))
    found = [e for e in run if e.time > 1e-9 * orbit.period]
    impacts = [(EventKind.IMPACT, *pair) for pair in zip(orbit.stops, orbit.phases, strict=True)]
    # The first impact comes again at the end
    expected = sorted(
        ((phase - orbit.phases[0]) % orbit.cycles or orbit.cycles, kind.value, stop)
        for kind, stop, phase in (*impacts, *orbit.events)
    )
    if [(e.kind.value, e.stop) for e in found] != [each[1:] for each in expected]:
        return False
    late = [e.time - phase * orbit.cycle for e, (phase, *_) in zip(found, expected, strict=True)]
    return max(map(abs, late)) < 1e-8 * orbit.period


@pytest.mark.parametrize(
    ('changes', 'stops', 'cycles'),
    [
        ({}, (1, 2), 3),
        ({'gap': 16.0, 'angle': 0.0}, (1, 1, 2), 1),
        ({'gap': 8.0, 'angle': 0.2}, (1, 1, 2, 2), 1),
        ({'gap': 3.0}, (1, 2), 1),
        ({'friction': 2.0, 'gap': 60.0}, (1, 2), 1),
        ({'one_sided': True, 'angle': 1.2, 'gravity': 9.81}, (1, 1), 2),
        # With reversals, stable and unstable
        ({'friction': 0.5, 'gap': 16.0}, (1, 1, 2), 1),
        ({'friction': 0.5, 'gap': 8.0}, (1, 1, 2, 2), 1),
        ({'friction': 0.05, 'gap': 8.0, 'angle': 0.0}, (1, 1, 2, 2), 1),
        ({'friction': 2.0, 'gap': 20.0}, (1, 2), 1),
    ],
)
def test_simulator_follows_exactly_the_viable_ones(changes, stops, cycles):
    orbits = find_orbits(INCLINED.replace(**changes), stops, cycles).orbits
    assert orbits
    if 'friction' in changes and changes['gap'] < 60.0:
        assert any(orbit.viable and orbit.events for orbit in orbits)
    for orbit in orbits:
        assert orbit.viable == follows(orbit), orbit.reason
        assert orbit.viable == (orbit.reason == '')


def reasons(changes, stops, cycles=1):
    orbits = find_orbits(INCLINED.replace(**changes), stops, cycles).orbits
    return [orbit.reason for orbit in orbits if not orbit.viable]


def test_reason_friction_reverses():
    texts = [t for t in reasons({'friction': 2.0, 'gap': 20.0}, (1, 2)) if 'sign' in t]
    (text,) = [t for t in texts if 'm turns back between the impacts on stop 2 and' in t]
    assert '1.09321 s after the former' in text
    assert '6.497 m from stop 2: friction changes sign there' in text


def test_turning_points_against_a_dense_look():
    rng = np.random.default_rng(3)
    for _ in range(12):
        rig = INCLINED.replace(force_frequencies=(float(rng.uniform(0.2, 6.0)),))
        x, velocity, relative = 5.0 * rng.normal(size=3)
        instant = float(rng.uniform(0.0, 10.0))
        start = machine_of(rig), instant, x, velocity, 0.0, relative, 0, 1
        duration = float(rng.uniform(1.0, 20.0))
        moving = moving_at(*start)
        motions = [motion_at(moving, tau) for tau in np.linspace(0.0, duration, 5001)]
        seen_of = {False: [m.x for m in motions], True: [m.travel for m in motions]}
        for to_m, seen in seen_of.items():
            low, high = extremes(moving_at(*start), duration, to_m)
            span = max(seen) - min(seen)
            assert -1e-12 * span <= high - max(seen) < 1e-4 * span
            assert -1e-12 * span <= min(seen) - low < 1e-4 * span
