"""The best dampers of structures, against rigs that are run for many gaps."""

import math
from functools import cache

import numpy as np
import pytest
from design.brute_force import from_rest, trial

from impact_damper_ros import Rig, RigParameters, settle
from impact_damper_ros.design.damper_design import best_design, best_from_rest, optimal_gap
from impact_damper_ros.design.mass_damper import (
    compare_dampers,
    den_hartog,
    mass_damper_response,
    tuned_to_excitation,
)
from impact_damper_ros.design.runs_from_rest import (
    _sizes,
    at_level,
    bare_amplitudes,
    largest_from_rest,
    settling_cycles,
    widest_hit,
)
from impact_damper_ros.design.worst_case import worst_cases
from impact_damper_ros.motion.event import SAMPLE_TYPE


def structure(**values):
    known = {
        'primary_mass': 5.0,
        'natural_frequency': 10.0,
        'damping_ratio': 0.02,
        'mass_ratio': 0.05,
        'restitution_1': 0.6,
        'restitution_2': 0.6,
        'force_amplitudes': 0.0,
        'base_amplitudes': '0.2 g',
        'base_frequencies': '10 Hz',
    }
    return RigParameters.of_structure(**{**known, **values})


@cache
def best(**values):
    """Return the best damper of a structure, which several tests look at."""
    return best_design(structure(**values))


@pytest.mark.parametrize('seed', [1004, 1013])
def test_the_best_gap_is_that_of_running_rigs(seed):
    """Without friction and with it; `brute_force` runs any number, light dampers among them."""
    found = trial(seed)
    assert found.ok, str(found)


@pytest.mark.parametrize('seed', [4026, 5005])
def test_narrow_gaps_above_the_resonance(seed):
    """The only ones with a motion of two impacts, and the better ones of two branches."""
    found = trial(seed, 0.15)
    assert found.gap < 0.2 * optimal_gap(found.rig)
    assert found.ok, str(found)


def test_rigs_of_hard_stops_are_run_until_they_repeat():
    """
    They are irregular for some hundred cycles.

    Whether one repeats depends on the last bits of its gap: a chaotic motion is stable, too.
    """
    hard = dict.fromkeys(('restitution_1', 'restitution_2'), 0.95)
    design = best(mass_ratio=0.05, **hard)
    gaps = design.rig.gap * (1.0 + 1e-12 * np.arange(40))
    sizes = largest_from_rest(design.rig, {'gap': gaps})
    assert (np.abs(sizes / design.orbit.x_max - 1.0) < 0.01).sum() > 12


@pytest.mark.parametrize('mass_ratio', [0.03, 0.05])
def test_what_is_reached_from_rest(mass_ratio):
    design = best(mass_ratio=mass_ratio)
    settled = settle(Rig(design.rig))
    reached = settled.x_max == pytest.approx(design.orbit.x_max, rel=5e-3)
    assert design.reached_from_rest == reached
    assert (design.starts_by_itself is None) == reached
    built = settle(Rig(design.built)).x_max
    assert built == pytest.approx(design.x_max, rel=0.02)
    if not reached:
        # M at rest does not swing across half the gap.
        assert design.rig.gap > 2.0 * design.bare
        assert design.gap < 2.0 * design.bare
    assert design.x_max < design.bare


def test_a_damper_that_changes_nothing_is_not_taken_for_one_that_is_reached():
    """With a speck of dust M moves as far with impacts as without."""
    design = best(mass_ratio=1e-5)
    assert design.orbit.x_max == pytest.approx(design.bare, rel=5e-3)
    assert not design.reached_from_rest
    assert design.gap < 2.0 * design.bare


def test_the_best_from_rest_is_no_worse_than_others():
    rig = structure(mass_ratio=0.02)
    alone, any_gap = best_from_rest(rig, widest_hit(rig))
    others = largest_from_rest(rig, {'gap': np.linspace(0.2, 1.0, 90) * alone.gap})
    assert alone.x_max <= others.min() * 1.005
    # A gap without a margin is wider
    assert alone.keeps_margin
    assert not any_gap.keeps_margin
    assert any_gap.x_max < alone.x_max
    assert alone.gap < widest_hit(rig, 0.95) * (1.0 + 1e-3) < any_gap.gap


def test_ranges_are_where_the_motion_is_lost():
    design = best(mass_ratio=0.05)
    span = design.gap_range
    cycle = 0.1
    for gap, kept in ((0.995 * span.high, True), (1.01 * span.high, False)):
        running = Rig(design.rig, compiled=None)
        running.run(300 * cycle)
        running.change(design.rig.replace(gap=gap))
        running.run(900 * cycle)
        times = np.linspace(900.0, 930.0, 3841) * cycle
        x = np.abs(running.run(float(times[-1]), times).samples['x'])
        cycles = x[:3840].reshape(30, 128).max(axis=1)
        assert (np.ptp(cycles) < 1e-4 * cycles.max()) == kept
    # Of a level, weightless and smooth rig the levels are the gaps, to scale.
    assert design.level_range.low == pytest.approx(design.rig.gap / span.high)


def test_speed_impulse_and_acceleration_are_those_of_a_rig_that_runs():
    design = best(friction=0.01)
    rig = Rig(design.rig)
    settle(rig)
    cycle = math.tau / design.rig.first_harmonic[1]
    times = rig.time + np.linspace(0.0, cycle, 4001)
    run = rig.run(float(times[-1]), times)
    hits = run.impacts()
    speed = np.abs(hits['damper_velocity_before'] - hits['primary_velocity_before'])
    assert design.impact_speed == pytest.approx(speed.max(), rel=1e-6)
    assert design.impulse == pytest.approx(hits['impulse'].max(), rel=1e-6)
    # Differences of X', but for those across an impact
    rates = np.abs(np.diff(run.samples['primary_velocity']) / np.diff(times))
    ordinary = np.sort(rates)[: -len(hits)]
    assert design.acceleration == pytest.approx(ordinary.max(), rel=5e-3)


def test_levels_scale_the_motion():
    rig = structure(gap=0.015)
    twice = at_level(rig, 2.0).replace(gap=0.03)
    assert from_rest(twice) == pytest.approx(2.0 * from_rest(rig), rel=1e-9)


@pytest.mark.parametrize(
    'values',
    [
        {},
        {'base_quantity': 'velocity', 'base_amplitudes': 0.03, 'restitution_speed': 0.3},
        {'base_quantity': 'displacement', 'base_amplitudes': 5e-4},
        {'base_amplitudes': 0.0, 'force_amplitudes': 10.0, 'force_frequencies': '10 Hz'},
    ],
)
def test_many_rigs_at_once_move_as_one_of_them(values):
    """At other levels and frequencies of a force or a base, with friction, weight and air."""
    rig = structure(**values, friction=0.02, angle=0.1, air_force=0.02)
    cases = {
        'level': np.array([0.8, 1.0, 1.3, 2.0]),
        'frequency': rig.omega * np.array([1.02, 1.0, 1.05, 0.97]),
        'gap': np.array([0.010, 0.012, 0.014, 0.012]),
        'damping': rig.damping * np.array([1.0, 1.1, 0.9, 1.2]),
    }
    sizes, bare = largest_from_rest(rig, cases), bare_amplitudes(rig, cases)
    for k in range(4):
        level, frequency, gap, damping = (column[k] for column in cases.values())
        there = at_level(rig.with_first_frequency(frequency), level)
        there = there.replace(gap=gap, damping=damping)
        times = math.tau / frequency * np.linspace(150.0, 180.0, 30 * 256 + 1)
        x = np.abs(Rig(there).run(float(times[-1]), times).samples['x']).max()
        assert bare[k] == pytest.approx(there.response_amplitude, rel=1e-12)
        # Irregular motions are run longer
        assert x * 0.999 < sizes[k] < x * 1.1


def test_the_largest_of_an_irregular_motion_is_that_of_many_cycles():
    rig = structure(gap=0.0236, mass_ratio=0.05)
    cycle = 0.1
    times = np.linspace(150.0, 650.0, 500 * 128 + 1) * cycle
    x = np.abs(Rig(rig, compiled=None).run(float(times[-1]), times).samples['x'])
    assert x[: 30 * 128].max() < 0.97 * x.max()
    assert from_rest(rig) == pytest.approx(x.max(), rel=0.005)


def test_friction_and_incline():
    design = best(friction=0.02, angle=0.1, mass_ratio=0.08)
    assert design.orbit.viable
    assert design.orbit.stable
    assert design.level_range.low < 1.0 < design.level_range.high


def test_gaps_can_be_built():
    """They have four digits, and what is stated of them holds for just these."""
    for mass_ratio in (0.01, 0.05):
        design = best(mass_ratio=mass_ratio)
        for gap in (design.rig.gap, design.gap):
            assert gap == float(f'{gap:.4g}')
        assert design.orbit.parameters.gap == design.rig.gap
    assert from_rest(design.built) == pytest.approx(design.x_max, rel=1e-3)


@pytest.fixture(scope='module')
def unsure():
    """Return a design, and its worst cases."""
    design = best(mass_ratio=0.1)
    ranges = {'restitution_1': (0.4, 0.7), 'restitution_2': (0.4, 0.7)}
    return design, worst_cases(design, ranges, (0.7, 1.4))


def test_a_worst_case_can_be_run(unsure):
    """Last bits decide when an irregular rig settles: it moves no more than is stated."""
    design, worst = unsure
    for one in (worst.chosen, worst.best):
        (size,) = largest_from_rest(design.rig, {'gap': [one.gap], **one.case})
        values = dict(one.case)
        there = at_level(design.rig, values.pop('level')).replace(**values, gap=one.gap)
        assert size / there.response_amplitude == pytest.approx(one.ratio, abs=1e-9)
        assert one.ratio == one.ratios.max()
        assert 0.7 * one.ratio < from_rest(there) / there.response_amplitude < 1.03 * one.ratio
        assert len(one.ratios) > 800


def worst_of(design, gap, levels, restitution):
    """Return the largest |X| over that without the damper, of rigs from rest."""
    cases = {'level': levels, 'restitution_1': restitution, 'restitution_2': restitution}
    sizes = largest_from_rest(design.rig, {**cases, 'gap': np.full(len(levels), gap)})
    return max(sizes / bare_amplitudes(design.rig, cases))


def test_no_case_is_worse_than_the_worst(unsure):
    design, worst = unsure
    draw = np.random.default_rng(5)
    restitution, levels = draw.uniform(0.4, 0.7, 100), draw.uniform(0.7, 1.4, 100)
    for one in (worst.chosen, worst.best):
        assert worst_of(design, one.gap, levels, restitution) < 1.03 * one.ratio


def test_the_gap_with_the_best_worst_case(unsure):
    """No gap is much better in the few cases that were run of all, for 30 cycles."""
    design, worst = unsure
    assert worst.best.ratio < 0.9 * worst.chosen.ratio
    assert worst.ratios.max(axis=1).min() > 0.85 * worst.best.ratio
    assert worst.best.gap in worst.gaps
    assert worst.best.gap == float(f'{worst.best.gap:.3g}')
    # What is as good, and no more, is around it; of its ends all cases were run.
    least = worst.whole[worst.best.gap]
    assert least == min(worst.whole.values())
    low, high = worst.as_good
    assert low <= worst.best.gap <= high
    assert max(worst.whole[low], worst.whole[high]) <= 1.02 * least
    levels = np.repeat(np.geomspace(0.7, 1.4, 20), 20)
    restitution = np.tile(np.linspace(0.4, 0.7, 20), 20)
    between = worst.gaps[(worst.gaps > low) & (worst.gaps < high)]
    assert len(between) > 0
    for gap in between:
        assert worst_of(design, gap, levels, restitution) < 1.03 * worst.best.ratio
    for gap in (worst.gaps[worst.gaps < low].max(), worst.gaps[worst.gaps > high].min()):
        assert worst.whole[gap] > 1.02 * least


def test_friction_is_at_its_ends():
    design = best(mass_ratio=0.1)
    worst = worst_cases(design, {'friction': (0.01, 0.05)}, (1.0, 1.0))
    assert worst.chosen.case['level'] == 1.0
    sizes = largest_from_rest(design.built, {'friction': [0.01, 0.05]}) / design.bare
    assert worst.chosen.ratio == pytest.approx(max(sizes))
    assert worst.chosen.case['friction'] == [0.01, 0.05][int(np.argmax(sizes))]


@pytest.mark.parametrize('ratio', [1.0, 0.8, 1.3])
@pytest.mark.parametrize('speed', [0.0, 0.2])
def test_the_gap_of_theory_is_its_formula(ratio, speed):
    """With the mean restitution, at the speed of the impacts of the very amplitude."""
    values = {'restitution_1': 0.5, 'restitution_2': 0.7, 'restitution_speed': speed}
    rig = structure(**values, base_frequencies=f'{10.0 * ratio} Hz', mass_ratio=0.1)
    rate, mu = math.tau * 10.0 * ratio, 0.1
    x, mean = 0.0, 0.6
    for _ in range(200):
        if speed:
            approach = 2.0 * rate * x / (1.0 - mean)
            mean = 0.5 * (mean + 0.6 * (1.0 + approach / speed) ** -rig.restitution_exponent)
        added = 2.0 / math.pi * mu / (1.0 + mu) * (1.0 + mean) / (1.0 - mean)
        # The base moves by 0.2 g over the square of the frequency; as a force, with its dashpot
        force = 0.2 * 9.80665 / rate**2 * math.hypot(1.0, 2.0 * 0.02 * ratio)
        x = force / math.hypot(1.0 - ratio**2, 2.0 * ratio * (0.02 + added))
    expected = math.pi * x * (1.0 + mean) / (1.0 - mean) / (1.0 + mu)
    assert optimal_gap(rig) == pytest.approx(expected, rel=1e-6)


def test_the_largest_displacement_of_a_cycle_is_between_its_samples():
    """A cubic turns at -1 and 1, where it is 2.5 and -1.5; at samples it is less."""
    times = np.array([-1.7, -0.6, 0.1, 1.2, 1.6])
    samples = np.zeros((2, 5), SAMPLE_TYPE)
    samples['time'] = times
    samples['x'] = times**3 - 3.0 * times + 0.5, times
    samples['primary_velocity'] = 3.0 * times**2 - 3.0, np.ones(5)
    assert _sizes(samples, 2) == pytest.approx(np.array([[2.5, 1.5], [1.7, 1.6]]), rel=1e-12)


@pytest.mark.parametrize('speed', [0.0, 0.1])
def test_the_gap_of_theory_is_near(speed):
    """As well with the restitution at the speed of the impacts."""
    for mass_ratio in (0.05, 0.1):
        design = best(mass_ratio=mass_ratio, damping_ratio=0.005, restitution_speed=speed)
        assert optimal_gap(design.rig) == pytest.approx(design.rig.gap, rel=0.1)


def test_mass_damper_against_den_hartog():
    """Of an undamped structure both peaks have the height sqrt(1 + 2/mu) of the static one."""
    for mass_ratio in (0.01, 0.05, 0.2):
        rig = structure(
            mass_ratio=mass_ratio,
            damping_ratio=0.0,
            base_amplitudes=0.0,
            force_amplitudes=3.0,
            force_frequencies=1.0,
        )
        rates = rig.omega * np.linspace(0.5, 1.5, 2001)
        response = mass_damper_response(rig, den_hartog(rig), rates) / (3.0 / rig.stiffness)
        inner = (response[1:-1] > response[:-2]) & (response[1:-1] > response[2:])
        peaks = response[1:-1][inner]
        assert len(peaks) == 2
        # Den Hartog's damping is a mean, which makes both maxima to a part in a hundred.
        assert peaks == pytest.approx(math.sqrt(1.0 + 2.0 / mass_ratio), rel=0.01)
        assert den_hartog(rig).frequency == rig.omega / (1.0 + mass_ratio)


def test_bare_response_of_a_base():
    rig = structure()
    rates = np.array([0.5, 1.0, 2.0]) * rig.omega
    b = 0.2 * 9.80665 / rates**2
    r = rates / rig.omega
    ratio = np.abs((1.0 + 0.04j * r) / (1.0 - r**2 + 0.04j * r))
    assert bare_amplitudes(rig, {'frequency': rates}) == pytest.approx(b * ratio)
    light = rig.replace(mass_ratio=1e-9)
    for tuning in (den_hartog(light), tuned_to_excitation(light)):
        assert mass_damper_response(light, tuning, rates) == pytest.approx(b * ratio, rel=1e-3)


def test_a_mass_damper_tuned_to_the_excitation():
    """At resonance it leaves 2 zeta/(2 zeta + mu/(2 zeta_d)) or so of what is left without."""
    rig = structure(mass_ratio=0.05)
    rates = np.array([rig.omega])
    left = mass_damper_response(rig, tuned_to_excitation(rig), rates) / rig.response_amplitude
    assert left == pytest.approx(0.04 / (0.04 + 0.05 / 0.01), rel=0.01)


def test_dampers_side_by_side():
    """The band has the level and the frequency of the design, and rigs that are run alone."""
    design = best(mass_ratio=0.05)
    compared = compare_dampers(design.built, 0.5, 2.0)
    middle = compared.frequencies[50]
    assert middle == pytest.approx(design.rig.omega)
    levels = compared.levels.tolist()
    assert compared.damper[levels.index(1.0), 50] == pytest.approx(design.x_max, rel=1e-3)
    k, n = 4, 30
    there = at_level(design.built, levels[k]).with_first_frequency(compared.frequencies[n])
    assert compared.damper[k, n] * levels[k] == pytest.approx(from_rest(there), rel=1e-3)
    assert compared.level_ratios[0] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    ('values', 'cycles'),
    [
        # 8 time constants of M: 8 / (2 pi zeta) of its cycles
        ({'damping_ratio': 0.005}, 255),
        ({'damping_ratio': 0.005, 'base_frequencies': '5 Hz'}, 150),
        ({'damping_ratio': 0.002, 'base_frequencies': '5 Hz'}, 319),
        ({'damping_ratio': 0.0001}, 1500),
        # 45 / (1 - R) impacts, with the mean of both R
        ({'restitution_1': 0.9, 'restitution_2': 0.6}, 180),
        ({'restitution_1': 1.0, 'restitution_2': 1.0}, 1500),
        ({'damping_ratio': 0.0}, 1500),
    ],
)
def test_a_start_is_forgotten_by_the_structure_and_by_its_impacts(values, cycles):
    assert settling_cycles(structure(**values)) == cycles
