"""N = 1 and N = 2: nothing is missed. N = 3 and more: what is found, and from how many starts."""

import numpy as np
import pytest
from rigs import INCLINED

from impact_damper_ros import ImpactEquations, RigParameters, find_orbits
from impact_damper_ros.orbits import starts
from impact_damper_ros.orbits.solved_orbits import after_impact, orbit_of
from impact_damper_ros.orbits.starts import impact_roots


def random_rig(rng):
    return RigParameters(
        damping=float(rng.uniform(0.005, 0.4)),
        damper_mass=float(rng.uniform(0.01, 0.5)),
        gap=float(rng.uniform(1.0, 40.0)),
        restitution_1=float(rng.uniform(0.2, 1.0)),
        restitution_2=float(rng.uniform(0.2, 1.0)),
        angle=float(rng.uniform(-1.5, 1.5)),
        friction=float(rng.choice([0.0, 0.3])),
        gravity=float(rng.uniform(0.0, 3.0)),
        air_force=float(rng.choice([0.0, 0.01])),
        force_frequencies=(float(rng.uniform(0.4, 3.0)),),
        force_phases=(float(rng.uniform(-3.0, 3.0)),),
    )


def brute_force(equations, starts):
    """Return the motions that Newton's method finds from very many starts."""
    roots, _ = impact_roots(equations, starts)
    return [orbit_of(root) for root in roots]


def close(a, b):
    """Return whether two motions are the same, with room for a double root."""
    size = max(1.0, *(abs(x) for x in a.x))
    for shift in range(a.impacts):
        if a.stops[shift:] + a.stops[:shift] == b.stops:
            x = np.roll(a.x, -shift) - b.x
            lasts = np.roll(a.durations, -shift) - b.durations
            if np.abs(x).max() < 1e-6 * size and np.abs(lasts).max() < 1e-6 * a.period:
                return True
    return False


@pytest.mark.parametrize('seed', range(12))
def test_no_motion_with_two_impacts_is_missed(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    cycles = int(rng.integers(1, 4))
    found = find_orbits(rig, (1, 2), cycles).orbits
    for orbit in brute_force(ImpactEquations(rig, (1, 2), cycles), 2000):
        assert any(close(orbit, other) for other in found), orbit


@pytest.mark.parametrize('seed', range(4))
def test_no_motion_with_two_impacts_on_one_stop_is_missed(seed):
    rng = np.random.default_rng(100 + seed)
    rig = random_rig(rng).replace(one_sided=True, friction=0.0)
    found = find_orbits(rig, (1, 1), 2).orbits
    for orbit in brute_force(ImpactEquations(rig, (1, 1), 2), 2000):
        equispaced = abs(orbit.durations[0] - orbit.durations[1]) < 1e-6 * orbit.period
        # An impact in each cycle, twice, is no motion of two cycles; nor is one without impacts.
        trivial = min(
            abs(a - b)
            for a, b in zip(
                orbit.damper_velocity_before, orbit.primary_velocity_before, strict=True
            )
        )
        if equispaced or trivial < 1e-6 * abs(orbit.x_max):
            continue
        assert any(close(orbit, other) for other in found), orbit


@pytest.mark.parametrize('tilt', [0.0, 1e-14, 1e-8, 1e-3])
def test_symmetric_branch_does_not_get_lost_nearby(tilt):
    """Two solutions whose second instants are as close to half a period as the rig to level."""
    for rig in (
        RigParameters(gravity=1.0, angle=tilt, friction=0.1),
        RigParameters(gravity=1.0, restitution_1=0.75 - tilt / 2, force_frequencies=(1.02,)),
    ):
        orbits = find_orbits(rig, (1, 2)).orbits
        assert len(orbits) == 2
        assert orbits[0].viable
        assert orbits[0].stable
        if tilt < 1e-4:
            level = find_orbits(rig.replace(angle=0.0, restitution_1=0.75), (1, 2)).orbits
            for orbit, other in zip(orbits, level, strict=True):
                assert orbit.x == pytest.approx(other.x, abs=3e3 * tilt + 1e-11)


def test_two_motions_meet_and_vanish_at_a_fold():
    """Found on one side until they are one, and neither on the other side."""
    rig = INCLINED.replace(angle=0.3)

    def count(gap):
        return len(find_orbits(rig.replace(gap=gap), (1, 2)).orbits)

    low, high = 40.0, 4000.0
    many, few = count(low), count(high)
    assert many > few
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if count(middle) >= many - 1 else (low, middle)
    # Two at once; those closer than 1e-7 to each other count as one
    assert many - count(high + 1e-3) == 2
    near = find_orbits(rig.replace(gap=low), (1, 2)).orbits
    # One of the two that meet has a multiplier close to +1
    assert min(abs(m - 1.0) for orbit in near for m in orbit.multipliers) < 1e-2


def test_motion_without_impacts_is_none():
    """M alone satisfies the equations of one impact, with no speed at it."""
    assert find_orbits(RigParameters(gravity=0.0), (1,)).orbits == ()


def test_starts_are_counted():
    rig = INCLINED.replace(gap=16.0, angle=0.0)
    found = find_orbits(rig, (1, 1, 2), starts=200)
    report = found.report
    assert not report.complete
    alone = find_orbits(rig, (1, 1, 2), starts=200, simulate=False).report
    # The stops 1, 2, 2 are those of its mirror images.
    assert alone.starts == 2 * 200 < report.starts
    assert 50 < alone.converged <= 200
    assert alone.converged < report.converged <= report.starts


@pytest.mark.parametrize(
    ('gap', 'stops', 'angle'), [(8.0, (1, 1, 2, 2), 0.4), (14.0, (1, 1, 2), 0.0)]
)
def test_ten_times_the_starts_find_no_more(gap, stops, angle):
    rig = INCLINED.replace(gap=gap, angle=angle)
    usual = find_orbits(rig, stops, simulate=False).orbits
    many = find_orbits(rig, stops, starts=4000, simulate=False).orbits
    assert len(usual) == len(many) > 0
    for one, other in zip(usual, many, strict=True):
        assert close(one, other)


def test_starts_are_the_same_in_parts(monkeypatch):
    """So that many impacts do not need memory for all of them at once."""
    rig = INCLINED.replace(gap=8.0, angle=0.4)
    whole = find_orbits(rig, (1, 1, 2, 2), simulate=False)
    monkeypatch.setattr(starts, '_MOST_AT_ONCE', 300_000)
    assert find_orbits(rig, (1, 1, 2, 2), simulate=False) == whole


def test_stop_sequences_that_mirror_each_other_have_the_same_motions():
    """Each of the two searches alone misses motions of this rig that the other one finds."""
    rig = RigParameters(
        gravity=0.1, friction=0.1, gap=34.2, restitution_1=0.45, restitution_2=0.45, damping=0.05
    )
    rig = rig.replace(force_frequencies=1.044)
    one, other = find_orbits(rig, (1, 1, 2), 3), find_orbits(rig, (1, 2, 2), 3)
    assert len(one) == len(other) > 0
    assert any(orbit.viable for orbit in one)
    for orbit in one:
        assert min(orbit.mirror_image().distance(image) for image in other) < 1e-7
    assert one.report == other.report


def test_mirror_images_of_a_symmetric_rig():
    """Simulated starts lead to one of the two only; the other one is its mirror image."""
    rig = RigParameters(
        damping=0.02583601604965474,
        damper_mass=0.16204478524792512,
        restitution_1=0.819734905868688,
        restitution_2=0.819734905868688,
        gravity=1.0,
        friction=0.3798491860491305,
        gap=7.938217835924714,
        force_amplitudes=(1.0, 0.5468286678652607),
        force_frequencies=(1.0382379920686677, 3.114713976206003),
        force_phases=(2.2512898093669103, 2.439469788991656),
    )
    one, other = (o for o in find_orbits(rig, (1, 2, 1, 2), 2).orbits if o.stable)
    assert one.distance(other) > 0.1
    assert one.distance(other.mirror_image()) < 1e-9
    assert other.mirror_image().mirror_image().distance(other) < 1e-12
    run = after_impact(one.mirror_image(), rig)
    hits = run.run(1.01 * one.period).impacts()
    assert hits['x'][-1] == pytest.approx(one.mirror_image().x[0], rel=1e-7)


@pytest.mark.parametrize('stops', [(1, 2, 2, 1, 2, 2), (2, 1, 2, 2, 1, 2)])
def test_the_doubled_motion_of_an_unstable_one(stops):
    """Which no simulated start leads to; it can be counted from any of its impacts."""
    rig = RigParameters(
        damping=0.09099351376873849,
        damper_mass=0.5685983431479422,
        restitution_1=0.6813998489496847,
        restitution_2=0.21152854266456037,
        angle=0.27816241976909184,
        gravity=0.47953767908786615,
        friction=0.21826592173421538,
        gap=4.171341514171308,
        force_frequencies=1.0422458744992213,
    )
    (simple,) = find_orbits(rig, stops[:3]).orbits
    assert simple.multipliers[0].real == pytest.approx(-1.0455, abs=1e-4)
    (orbit,) = (o for o in find_orbits(rig, stops, 2).orbits if o.stable)
    assert abs(orbit.multipliers[0]) == pytest.approx(0.6735, abs=1e-4)
    assert not orbit.repeats(1e-3)


@pytest.mark.parametrize('cycles', [0, -1, 1.5, float('nan')])
def test_cycles_that_are_no_number_of_them(cycles):
    with pytest.raises(ValueError, match='give a whole number from 1 to'):
        find_orbits(INCLINED, (1, 2), cycles)
