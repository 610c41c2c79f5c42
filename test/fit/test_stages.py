"""The stages of a fit, each alone, against a motion that is known."""

from itertools import pairwise

import numpy as np
import pytest

from impact_damper_ros import RigParameters
from impact_damper_ros.fit.acceptance import judge_fit
from impact_damper_ros.fit.candidates import Candidate, Evidence, ParameterColumn
from impact_damper_ros.fit.contradictions import gains_of, to_release, without_contradictions
from impact_damper_ros.fit.course import Course
from impact_damper_ros.fit.estimate import Estimate
from impact_damper_ros.fit.first_course import first_course, match_times
from impact_damper_ros.fit.first_guess import regress
from impact_damper_ros.fit.gauss_newton import System, solve
from impact_damper_ros.fit.impact_search import PENALTY, ImpactSearch, Jumps
from impact_damper_ros.fit.record import Record, noise_between, noise_of
from impact_damper_ros.fit.replayed_course import RESTS
from impact_damper_ros.fit.revision import UNCONFIRMED, Revised
from impact_damper_ros.fit.shooting import Shooting
from impact_damper_ros.fit.unknowns import CONSTANTS, Unknowns
from impact_damper_ros.fit.vibration import Vibration
from impact_damper_ros.parameters.base_motion import ORDERS

from .random_rigs import DEVIATION, measure, random_rig, true_course


def known(seed, changes=None, separate=False, **options):
    """Return what is known of a rig, its record, course, equations and measurement."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng).replace(**(changes or {}))
    measurement = measure(rig, rng, **{'impacts': 40, 'timed': False, **options})
    unknowns = Unknowns(rig, separate, ())
    record, course = true_course(unknowns, measurement)
    times = measurement.record.impact_times
    times = np.zeros(0) if times is None else times

    def problem(of):
        return Shooting(record, measurement.deviation, unknowns, of, times, DEVIATION)

    return unknowns, record, course, problem, measurement


def test_the_noise_of_a_vibration_with_impacts():
    """To the 3 % that 4,000 samples leave; a smooth motion has none."""
    rng = np.random.default_rng(1)
    time = np.arange(4000) / 1000.0
    smooth = np.sin(31.0 * time) * np.exp(-0.3 * time)
    smooth[2000:] += 0.4 * np.sin(31.0 * (time[2000:] - 2.0))
    noise = rng.normal(0.0, 0.01, len(time))
    assert noise_of(smooth + noise) == pytest.approx(0.01, rel=0.05)
    assert noise_of(smooth) < 1e-6
    assert noise_of(np.zeros(3)) == 0.0
    steps = np.where(time > 1.0, 5.0, 0.0) + noise
    assert noise_between(steps, time, np.array([1.0])) == pytest.approx(0.01, rel=0.05)
    assert np.isnan(noise_between(noise[:20], time[:20], np.zeros(0)))


@pytest.mark.parametrize('quantity', list(ORDERS))
def test_impacts_are_found_by_the_shocks_that_explain_the_motion(quantity):
    """Exact pieces with noise of a hundredth: all shocks, none else, and what M does there."""
    rng = np.random.default_rng(4)
    rig = RigParameters(
        primary_mass=2.0,
        stiffness=2000.0,
        damping=1.0,
        force_amplitudes=0.5,
        force_frequencies=30.0,
    )
    vibration, order = Vibration.of(rig, 2000.0, 1.0), ORDERS[quantity]
    time, impacts = np.arange(800) / 400.0, np.array([0.501, 0.703, 1.2013, 1.6489])
    edges = np.searchsorted(time, [-1.0, *impacts, 9.0])
    root = vibration.root
    # X is continuous at each impact, X' jumps
    state, begin, jumps = 0.01 + 0.0j, 0.0, (0.1, -0.12, 0.15, -0.09)
    motion, before = np.zeros(len(time)), []
    for k, (low, high) in enumerate(pairwise(edges)):
        motion[low:high] = (state * root**order * np.exp(root * (time[low:high] - begin))).real
        if k < len(impacts):
            state *= np.exp(root * (impacts[k] - begin))
            before.append((state.real, (root * state).real))
            begin, state = impacts[k], state - 1j * jumps[k] / vibration.damped
    motion += vibration.steady(time, order)
    deviation = 0.01 * float(np.std(motion))
    noisy = motion + rng.normal(0.0, deviation, len(time))
    # Samples that do not count are as if they were not there
    weight = np.ones(len(time))
    weight[300:310], noisy[300:310] = 0.0, 1.0
    record = Record(time, noisy, weight, order)
    for measured in (np.zeros(0), impacts):
        search = ImpactSearch(record, rig, deviation, measured, 1e-3)
        cost = search.find(vibration, merge=True)
        assert search.cost == cost
        found = search.jumps(vibration)
        clear = np.abs(found.jump) > 5.0 * found.deviation
        assert (~clear).sum() <= 2
        found = Jumps(*(column[clear] for column in found))
        assert found.time == pytest.approx(impacts, abs=2e-4 if len(measured) else 4e-3)
        assert found.jump == pytest.approx(jumps, abs=0.012)
        assert (np.abs(found.jump - jumps) < 6.0 * found.deviation).all()
        x, v = np.transpose(before)
        assert found.x == pytest.approx(x + vibration.steady(impacts, 0), abs=5e-4)
        assert found.velocity == pytest.approx(v + vibration.steady(impacts, 1), abs=0.02)
        assert np.std(search.innovations[10:][weight[10:] > 0.0]) < 1.1
    # Every second sample of a record, in the same process
    few = Record(time[::2], noisy[::2], weight[::2], order)
    copied = Record(*(part.copy() for part in few[:3]), order)
    costs = [ImpactSearch(one, rig, deviation).find(vibration) for one in (few, copied)]
    assert costs[0] == costs[1]
    # With another stiffness more shocks are needed
    assert search.find(Vibration.of(rig, 2100.0, 1.0)) > cost + 20.0
    # A record without shocks has none
    free = Record(time, vibration.steady(time, order) + noisy - motion, weight, order)
    search = ImpactSearch(free, rig, deviation)
    search.find(vibration)
    assert search.shocks.sum() <= 1


@pytest.mark.parametrize(
    ('changes', 'separate'),
    [
        # Flights with reversals, which friction bends, are outliers to it
        ({'friction': 0.0}, False),
        ({'friction': 0.0, 'restitution_2': 0.4}, True),
        ({'air_force': 0.02, 'angle': 0.02}, False),
    ],
)
def test_a_regression_over_exact_jumps_gives_the_rig(changes, separate):
    unknowns, _, course, _, measurement = known(105, changes, separate)
    rig = unknowns.rig
    hits = measurement.events[measurement.events['stop'] > 0][: len(course)]
    before = hits['primary_velocity_before']
    sizes = hits['primary_velocity_after'] - before
    jumps = Jumps(course.time, course.x, before, sizes, np.full(len(sizes), 1e-4))
    alphas, grip, gap, saved = regress(unknowns, jumps, course.stop, rig.omega)
    assert [unknowns.restitution(a) for a in alphas] == pytest.approx(
        [rig.restitution_1, rig.restitution_2], rel=1e-6
    )
    assert grip == pytest.approx(rig.friction * unknowns.normal, rel=1e-4, abs=1e-6)
    assert gap == pytest.approx(rig.gap, rel=1e-6)
    # One false impact among forty is an outlier
    wrong = jumps._replace(jump=np.where(np.arange(len(course)) == 20, -1.0, 1.0) * jumps.jump)
    other = regress(unknowns, wrong, course.stop, rig.omega)
    assert other.gap == pytest.approx(gap, rel=0.01)
    # It saves the penalties of flights whose laws hold
    transits = int((np.diff(course.stop) != 0).sum())
    assert 0.0 < other.saved < saved <= PENALTY * transits


def test_friction_and_restitution_that_are_exchanged_are_as_usual():
    """Flights that are all alike, with noise: neither takes a value that no bench has."""
    unknowns, _, _, _, _ = known(105, {'friction': 0.03})
    rng = np.random.default_rng(1)
    rate, count = unknowns.rig.omega, 60
    time = np.arange(count) * np.pi / rate
    stops = np.where(np.arange(count) % 2, -1, 1)
    speed, size = 0.04, 0.03
    noise = rng.normal(0.0, 2e-4, (2, count))
    sizes = stops * size + noise[0]
    deviation = np.full(count, 2e-4)
    jumps = Jumps(time, stops * 1e-3, -stops * speed + noise[1], sizes, deviation)
    alphas, grip, gap, _ = regress(unknowns, jumps, stops, rate)
    assert 0.2 < unknowns.restitution(alphas[0]) <= 1.0
    assert 0.0 <= grip < 0.2 * unknowns.normal
    assert gap > 0.0


def test_times_are_matched_one_to_one():
    measured = np.array([1.0, 1.9, 2.0, 5.0])
    assert match_times(np.array([1.01, 2.02, 3.0]), measured, 0.05).tolist() == [0, 2, -1]
    assert match_times(np.array([1.99, 2.01]), measured, 0.05).tolist() in ([2, -1], [-1, 2])
    assert match_times(np.zeros(0), measured, 0.05).tolist() == []


GUESS = {'stiffness': 1.03, 'damping': 1.4}


@pytest.mark.parametrize('quantity', list(ORDERS))
@pytest.mark.parametrize('timed', [True, False])
def test_a_first_course_is_near_the_motion(timed, quantity):
    """Weak impacts apart it is that of the events, and K, R and gap are near."""
    unknowns, record, course, _, measurement = known(108, timed=timed, quantity=quantity)
    times = measurement.record.impact_times if timed else np.zeros(0)
    start = {name: factor * getattr(unknowns.rig, name) for name, factor in GUESS.items()}
    guessed = unknowns._replace(rig=unknowns.rig.replace(**start))
    found = first_course(record, guessed, measurement.deviation, times, DEVIATION)
    # K, C, alpha, grip, gap
    near = np.abs(found.shared / course.shared - 1.0)
    assert near[0] < 0.015
    assert near[[2, 4]].max() < 0.2
    pairs = match_times(found.time, course.time, 0.006)
    assert (pairs >= 0).mean() > 0.75
    same = pairs >= 0
    assert (found.stop[same] == course.stop[pairs[same]]).mean() > 0.95


def test_flights_that_contradict_the_others_are_cut():
    _, _, course, problem, _ = known(105)
    solution = solve(problem(course), problem(course).start())
    assert gains_of(problem(course), solution).max() < 20.0
    wrong = course.copy()
    wrong.stop[12] *= -1
    why: dict[int, str] = {}
    shooting, solution, gains = without_contradictions(problem, problem(wrong), why, softly=True)
    cut = set(np.flatnonzero(~shooting.course.flies).tolist())
    assert cut & {11, 12}
    assert len(cut) <= 4
    assert {k - 1 for k in why} == cut
    assert all(text.startswith('it contradicts the other flights: ') for text in why.values())
    assert gains.max() < 100.0
    assert solution.broken < 0.01


@pytest.mark.parametrize('timed', [True, False])
def test_flights_beside_rejected_ones_do_not_count_unless_their_impact_was_measured(timed):
    _, _, course, problem, _ = known(101, timed=timed)
    flights = range(len(course) - 1)
    left_out = 10, 12, 20
    for k in left_out:
        course.leave_out(k)
    shooting = problem(course)
    solution = solve(shooting, shooting.start())
    gains = gains_of(shooting, solution)
    found = Revised(course, shooting, solution, gains, dict.fromkeys((11, 13, 21), 'rejected'))
    found = found.without_rejected(problem)
    alone = [k for k in flights if found.why_cut.get(k + 1) == UNCONFIRMED]
    assert alone == ([11] if timed else [0, 9, 11, 13, 19, 21, flights[-1]])
    assert found.obey == len(flights) - len(left_out)
    assert found.verdicts() == {}


def test_the_worst_of_neighbours_are_released():
    gains = np.array([0.0, 30.0, 80.0, 70.0, 5.0, 60.0])
    assert to_release(gains, 20.0) == {2: 80.0, 5: 60.0}
    assert to_release(gains, 100.0) == {}
    assert to_release(np.zeros(0), 20.0) == {}


@pytest.mark.parametrize(
    ('name', 'changes', 'value', 'within'),
    [
        ('force_amplitudes', {'force_amplitudes': (1.2 / 1.02,)}, 0.02, 0.25),
        ('primary_mass', {'primary_mass': 2.0 * 1.02}, -0.02, 0.25),
        ('damper_mass', {'damper_mass': 1.02}, -0.02, 0.25),
        # One restitution for both fits far from there: a step does not lead all the way
        ('restitution_2 less restitution_1', {}, -0.02, 0.75),
        ('force delay', {}, 0.002, 0.25),
    ],
)
def test_one_step_finds_what_a_model_lacks(name, changes, value, within):
    """Of a motion without noise to some per cent; the other checks are further from it."""
    rig_changes = {'restitution_2': 0.5, 'restitution_1': 0.52} if 'restitution' in name else {}
    unknowns, record, course, _, measurement = known(105, rig_changes, noise=1e-3)
    if name == 'damper_mass':
        changes = {name: changes[name] * unknowns.rig.damper_mass}
    described = unknowns.rig.replace(**changes)
    if name == 'force delay':
        w = described.force_frequencies[0]
        described = described.replace(force_phases=(described.force_phases[0] + w * value,))
    lacking = unknowns._replace(rig=described, uncertain=dict.fromkeys(CONSTANTS, 0.0))
    shooting = Shooting(record, measurement.deviation, lacking, course, np.zeros(0), DEVIATION)
    solution = solve(shooting, shooting.start())
    checks = Evidence.of(shooting, solution, 1.0).candidates({})
    found = {check.name: check for check in checks}
    assert found[name].value == pytest.approx(value, rel=within)
    assert abs(found[name].z) > 4.0
    assert found[name].z == found[name].value / found[name].standard_deviation
    assert abs(checks[0].z) == max(abs(check.z) for check in checks)


@pytest.mark.parametrize('since', [0.0, 0.02])
@pytest.mark.parametrize('best', [0.0, -0.03, -0.05, -0.09])
def test_a_constant_of_a_file_may_be_wrong(best, since):
    """Mean and deviations of all that is possible, summed on a grid, wherever the step begins."""
    none = np.zeros(0)
    columns = [
        ParameterColumn('force_amplitudes', '', '', none, none, 0.01, 0.2),
        ParameterColumn('other', '', '', none, none),
    ]
    information = np.linalg.inv(np.array([[0.02, 0.007], [0.007, 0.01]]) ** 2)
    middle = np.array([best, 0.004])
    now = np.array([since, 0.0])
    evidence = Evidence(columns, information, information @ (now - middle), np.zeros((0, 2)))
    step, covariance = evidence.step([0, 1], now)
    a, b = np.meshgrid(np.linspace(-0.4, 0.4, 1601), np.linspace(-0.1, 0.1, 401), indexing='ij')
    off = np.stack([a - best, b - 0.004], axis=-1)
    likely = np.exp(-0.5 * np.einsum('...i,ij,...j', off, information, off))
    known = 0.8 * np.exp(-0.5 * (a / 0.01) ** 2) / 0.01 + 0.2 * np.exp(-0.5 * (a / 0.1) ** 2) / 0.1
    weight = likely * known / (likely * known).sum()
    mean = np.array([(weight * a).sum(), (weight * b).sum()])
    assert now + step == pytest.approx(mean, abs=2e-5)
    left = np.stack([a, b], axis=-1) - mean
    assert covariance == pytest.approx(np.einsum('ij,ijk,ijl', weight, left, left), rel=1e-3)
    # If the constant is wrong for sure, its deviation is 10 %.
    step, covariance = evidence.if_wrong().step([0, 1], now)
    wrong = information + np.diag([0.1**-2, 0.0])
    assert covariance == pytest.approx(np.linalg.inv(wrong))
    assert now + step == pytest.approx(np.linalg.solve(wrong, information @ middle))


@pytest.mark.parametrize(('seed', 'held'), [(101, False), (105, False), (108, True)])
def test_friction_is_not_fitted_below_zero(seed, held):
    """Where the best value is, it is zero, and the others are the best for that."""
    unknowns, record, course, problem, _ = known(seed, {'friction': 1e-5}, noise=0.03)
    grip = unknowns.column('grip')
    shooting = problem(course)
    solution = solve(shooting, shooting.start())
    free = Shooting(record, shooting.deviation, unknowns, course, np.zeros(0), DEVIATION)
    equations = free.equations(solution.unknowns)
    step, _ = System(equations, 1e-11).step(equations)
    if shooting.frictionless:
        assert solution.unknowns[grip] == pytest.approx(0.0, abs=1e-6)
        assert step[grip] < 0.0
    else:
        assert solution.unknowns[grip] > 0.0
        assert abs(step[grip]) < solution.unknowns[grip]
    assert shooting.frictionless is held
    assert solution.broken < 1e-2


def judgement(course, checks=(), deviations=(0.1,), **changes):
    """Return what the rule says of a course with ten parameters of some deviations."""
    revised = Revised(course, None, None, np.zeros(len(course) - 1), changes.pop('why', {}))
    parameters = {f'p{k}': Estimate.normal(1.0, one) for k, one in enumerate(deviations)}
    correlations = {a: {b: float(a == b) for b in parameters} for a in parameters}
    correlations.update(changes.pop('correlations', {}))
    chi = changes.pop('chi', 1.0)
    return judge_fit(revised, chi, list(checks), parameters, correlations)


def course_of(used, flights):
    """Return a course of some flights, of which the first ones count."""
    begins = np.array([True, *(k >= used for k in range(flights))])
    zeros = np.zeros(flights + 1)
    stops = np.resize([1, -1], flights + 1)
    return Course(np.ones(5), np.arange(flights + 1.0), zeros, zeros, zeros, stops, begins, -stops)


CHECK = Candidate('force amplitude', 0.1, 0.02, '', 'the force is not as large as described')


@pytest.mark.parametrize(
    ('used', 'flights', 'changes', 'words'),
    [
        (93, 100, {}, []),
        (75, 100, {}, []),
        (74, 100, {}, ['only 74 of 100 flights obey']),
        # What sticks contradicts nothing, but half of the flights must count
        (69, 100, {'why': dict.fromkeys(range(80, 101), RESTS)}, []),
        (49, 100, {'why': dict.fromkeys(range(50, 101), RESTS)}, ['only 49 of 100 flights obey']),
        # What nothing confirms is neither right nor wrong: 21 of the 40 here
        (60, 100, {'why': dict.fromkeys(range(80, 101), UNCONFIRMED)}, []),
        (
            *(55, 100, {'why': dict.fromkeys(range(80, 101), UNCONFIRMED)}),
            ['only 55 of 79 flights obey'],
        ),
        (9, 9, {}, ['9 of 9 flights between impacts obey']),
        (93, 100, {'chi': 1.09}, []),
        (93, 100, {'chi': 1.12}, ['the residuals are 1.12 times as large']),
        (93, 100, {'checks': [CHECK]}, ['the force is not as large', '5 standard deviations']),
        (93, 100, {'checks': [CHECK._replace(value=0.07)]}, []),
        (93, 100, {'deviations': (0.1, np.inf)}, ['does not determine every parameter']),
        (93, 100, {'deviations': (0.1, 0.0)}, ['does not determine every parameter']),
    ],
)
def test_the_rule_of_acceptance(used, flights, changes, words):
    found = judgement(course_of(used, flights), **changes)
    assert found.accepted is not bool(words)
    assert len(found.reasons) == bool(words)
    assert all(word in ' '.join(found.reasons) for word in words)
    assert found.remarks == []


def test_parameters_that_are_hardly_distinguished_are_remarked():
    correlations = {'p0': {'p0': 1.0, 'p1': -0.95}, 'p1': {'p0': -0.95, 'p1': 1.0}}
    course = course_of(95, 100)
    found = judgement(course, deviations=(0.05, 0.2), correlations=correlations)
    assert found.accepted
    (remark,) = found.remarks
    assert remark.startswith('p0 and p1 are hardly distinguished (correlation -0.950), and p1 is')
    assert judgement(course, deviations=(0.05, 0.2)).remarks == []
