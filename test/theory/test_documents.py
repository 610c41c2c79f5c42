"""The document of the theory: the numbers of the solvers, part by part."""

import json

import numpy as np
import pytest
from rigs import BENCH, FRICTION, HORIZONTAL, VERTICAL

from impact_damper_ros import GapControlParameters, Rig, RigParameters, find_orbits, follow, settle
from impact_damper_ros.theory.documents import answers
from impact_damper_ros.theory.gap_curve import follow_gap
from impact_damper_ros.theory.motion_curve import orbit_curve


def documents(rig, control=None):
    """Return the documents of a rig as they are sent."""
    rig = rig if isinstance(rig, Rig) else Rig(rig, control=control)
    return [json.loads(text) for _, text in answers(rig.snapshot(), None, documented=True)]


@pytest.fixture(scope='module')
def level():
    return documents(HORIZONTAL)


@pytest.fixture(scope='module')
def inclined():
    return documents(FRICTION)


def test_expected_motion_is_that_of_the_solver(inclined):
    first, last = (one['orbit'] for one in inclined)
    assert (first['complete'], last['complete']) == (False, True)
    differ = {name for name in last if first[name] != last[name]}
    assert differ <= {'complete', 'others'}
    orbit = next(o for o in find_orbits(FRICTION, (1, 2), 1).orbits if o.stable and o.viable)
    assert last['label'] == '2 impacts in 1 cycle'
    assert last['kind'] == 'periodic'
    assert last['x_max_ratio'] == pytest.approx(0.2113439, abs=1e-7)
    assert (last['stable'], last['viable'], last['period']) == (True, True, orbit.period)
    moduli = [abs(complex(*pair)) for pair in last['multipliers']]
    assert moduli == pytest.approx([0.94107, 0.94107, 0.57960, 0.57960], abs=1e-4)
    assert [i['phase'] for i in last['impacts']] == pytest.approx([0.7579950, 0.2697923], abs=1e-6)


def test_the_kind_of_motion_that_the_rig_comes_to_is_named():
    assert documents(BENCH.replace(gap=0.034))[-1]['orbit']['kind'] == 'chaotic'


def test_drawn_motion_is_that_of_the_rig(inclined):
    """Set going on the orbit, the rig is where the document says."""
    last = inclined[-1]['orbit']
    t, x, z = (np.array(last[name]) for name in ('t', 'x', 'z'))
    assert (np.diff(t) >= 0.0).all()
    assert last['t_zero'] == pytest.approx(0.0)
    rig = Rig(FRICTION, compiled=None)
    rig.advance(1000 * last['period'])
    began = rig.time
    for share in (0.05, 0.3, 0.55, 0.9):
        rig.advance(began + share * last['period'])
        at = (rig.time - last['t_zero']) % last['period']
        sample = rig.sample()
        assert np.interp(at, t, x) == pytest.approx(sample.x, abs=5e-3)
        assert np.interp(at, t, z) == pytest.approx(sample.z, abs=3e-2)
    y, velocity = np.array(last['y']), np.array(last['relative_velocity'])
    assert np.abs(y).max() == pytest.approx(0.5 * FRICTION.gap, rel=1e-6)
    assert velocity.max() > 0.0 > velocity.min()


def test_a_curve_goes_from_the_first_impact_to_the_same_one_a_period_later():
    """With 250 points in a cycle, of up to six cycles, and the states around each impact."""
    rig = VERTICAL.replace(force_amplitudes=1.48507)
    for orbit, per_cycle in (
        (next(o for o in find_orbits(FRICTION, (1, 2)).orbits if o.viable), 250),
        (find_orbits(rig, (1,), 3).orbits[0], 250),
        (find_orbits(rig.replace(force_amplitudes=3.4), (1,), 7).orbits[0], 1500 / 7),
    ):
        rows = orbit_curve(orbit)
        phase = rows[:, 0]
        assert (np.diff(phase) >= 0.0).all()
        assert len(rows) == pytest.approx(per_cycle * orbit.cycles, rel=0.02, abs=8.0)
        assert np.diff(phase).max() == pytest.approx(1.0 / per_cycle, rel=0.05)
        assert phase[[0, -1]] == pytest.approx(orbit.phases[0] + np.array([0.0, orbit.cycles]))
        assert rows[-1, 1:].tolist() == rows[0, 1:].tolist()
        after = orbit.primary_velocity_after[0], orbit.damper_velocity_after[0]
        assert rows[0, [1, 2]] == pytest.approx([orbit.x[0], after[0]], rel=1e-9)
        assert rows[0, 4] == pytest.approx(after[1] - after[0], rel=1e-9)
    others = [o for o in find_orbits(HORIZONTAL, (1, 2)).orbits if not o.viable]
    assert others
    assert [*map(orbit_curve, others)] == [None] * len(others)


def test_drawn_motion_of_a_force_that_repeats_after_several_cycles():
    """Zeros of its first harmonic differ: phases count from one that all harmonics agree with."""
    force = {'force_frequencies': (1.02, 1.7), 'force_phases': (0.1, 0.2)}
    rig = Rig(FRICTION, compiled=None)
    rig.advance(20.0)
    rig.change(FRICTION.replace(force_amplitudes=(1.0, 0.1), **force))
    rig.advance(20.0 + 600 * 2.0 * np.pi / 1.02)
    last = documents(rig)[0]
    assert (last['time'], last['orbit']['basis']) == (rig.time, 'run ahead')
    last = last['orbit']
    assert last['cycles'] == 3
    for _ in range(7):
        rig.advance(rig.time + 0.3 * last['period'])
        at = (rig.time - last['t_zero']) % last['period']
        assert np.interp(at, last['t'], last['x']) == pytest.approx(rig.sample().x, abs=5e-3)
    first = last['impacts'][0]
    assert np.interp(first['phase'], last['phase'], last['x']) == pytest.approx(
        first['x'], abs=1e-6
    )


def test_an_impact_is_drawn_from_before_it_to_after_it(level):
    """There Y' is multiplied by -R at once; elsewhere it is the rate of Y."""
    orbit = level[-1]['orbit']
    t, y, rate = (np.array(orbit[name]) for name in ('t', 'y', 'relative_velocity'))
    off = np.diff(y) - np.diff(t) * 0.5 * (rate[1:] + rate[:-1])
    assert np.abs(off).max() < 1e-4 * 37.0
    (hits,) = np.nonzero(np.diff(t) < 1e-9)
    turned = [(y[n], rate[n + 1] / rate[n]) for n in hits if rate[n] * rate[n + 1] < 0.0]
    assert sorted(turned) == [pytest.approx((place, -0.75)) for place in (-18.5, 18.5)]


def test_gap_curve_of_the_motion_comes_first_and_then_those_of_the_others(level):
    first, last = (one['gap_curve'] for one in level)
    assert first['branches'] == last['branches'][:1]
    assert len(last['branches']) > 1
    main = last['branches'][0]
    gap, ratio = np.array(main['gap']), np.array(main['x_max_ratio'])
    assert (gap.min(), gap.max()) == (pytest.approx(37.0 / 4), pytest.approx(37.0 * 4))
    # Golden case at the rig's own gap
    here = int(np.abs(gap - 37.0).argmin())
    assert ratio[here] == pytest.approx(last['x_max_ratio'])
    assert ratio[here] == pytest.approx(0.104644, abs=1e-6)
    for k in range(0, len(gap), 15):
        orbits = find_orbits(HORIZONTAL.replace(gap=float(gap[k])), (1, 2), 1).orbits
        near = min(orbits, key=lambda o: abs(o.x_max_ratio - ratio[k]))
        assert near.x_max_ratio == pytest.approx(ratio[k], rel=1e-6)
        assert (near.stable, near.viable) == (main['stable'][k], main['viable'][k])
    assert 'Neimark-Sacker' in {special['kind'] for special in last['special']}


def test_optimum_of_the_curve_is_the_best_gap(level):
    best = follow(find_orbits(HORIZONTAL, (1, 2)).orbits[0], 'gap', 30.0, 70.0).best()
    for one in level:
        optimum = one['gap_curve']['optimum']
        assert optimum['gap'] == pytest.approx(best.value, rel=1e-5)
        assert optimum['x_max_ratio'] == pytest.approx(best.orbit.x_max_ratio, rel=1e-9)


def test_a_branch_knows_its_motions_and_their_mirror_images():
    rig = HORIZONTAL.replace(gap=18.0, force_frequencies=1.02)
    motion, mirrored = (find_orbits(rig, stops).orbits[0] for stops in ((1, 1, 2), (1, 2, 2)))
    branch = follow_gap(motion)
    assert branch.contains(motion)
    assert branch.contains(mirrored)
    assert branch.contains(find_orbits(rig.replace(gap=17.5), (1, 1, 2)).orbits[0])
    assert not branch.contains(find_orbits(rig, (1, 2)).orbits[0])
    other = find_orbits(rig.replace(damping=0.011), (1, 1, 2)).orbits[0]
    assert not branch.contains(other)


def test_the_curve_goes_on_where_it_falls_at_the_end_of_its_range():
    """The best gap is almost seven times the present one, or smaller than all that is followed."""
    rig = HORIZONTAL.replace(gap=8.0, force_frequencies=1.02)
    branch = follow_gap(find_orbits(rig, (1, 2), simulate=False).orbits[0])
    assert (branch.best.value, branch.bound) == (pytest.approx(54.963753, abs=1e-4), '')
    assert np.all(np.diff(branch.branch.values) > 0.0)
    # Below its resonance, M moves the less the smaller the gap is.
    rig = HORIZONTAL.replace(gap=0.5, damper_mass=0.02, force_frequencies=(0.9,))
    plastic = rig.replace(restitution_1=0.0, restitution_2=0.0)
    branch = follow_gap(settle(Rig(plastic, compiled=None)).orbit)
    assert (branch.best.value, branch.bound) == (min(branch.branch.values), 'at most')
    assert branch.best.value < 0.01


def test_where_there_is_no_theory_it_says_why():
    last = documents(RigParameters(), GapControlParameters(gap_control='timed'))[-1]
    assert 'gap_control is timed' in last['theory_failed']['text']
    assert (last['orbit']['found'], last['gap_curve']) == (False, None)


def test_a_one_sided_rig_has_an_orbit_but_no_curve():
    last = documents(HORIZONTAL.replace(one_sided=True, gravity=1.0, angle=1.5, gap=0.1))[-1]
    assert last['orbit']['complete']
    assert last['gap_curve']['branches'] == []
    assert 'one-sided' in last['gap_curve']['text']


def test_an_undamped_rig_at_resonance_has_no_ratio_to_draw():
    *_, last = documents(HORIZONTAL.replace(damping=0.0))
    assert (last['gap_curve']['branches'], last['theory_failed']) == ([], None)
    assert last['gap_curve']['text']
