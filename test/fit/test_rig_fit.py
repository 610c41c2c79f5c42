"""A rig is found again from its noisy motion, with intervals that hold."""

import math

import numpy as np
import pytest
from rigs import TWIN

from impact_damper_ros import Rig
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.rig_fit import FitOptionError, _are_right, fit_rig

from .other_rigs import measure_other
from .random_rigs import errors, guess_of, measure, random_rig, true_values


def fitted(seed, also=(), uncertain=None, friction=None, **options):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    if friction is not None:
        rig = rig.replace(friction=friction)
    record = measure(rig, rng, **options).record
    return rig, record, fit_rig(record, guess_of(rig, rng), also=also, uncertain=uncertain)


@pytest.mark.parametrize(
    ('seed', 'options'),
    [
        (105, {}),
        (108, {'missing': 0.05, 'false': 0.02}),
        (104, {'timed': False}),
        (105, {'quantity': 'velocity', 'timed': False}),
        (105, {'quantity': 'acceleration'}),
        # m bounces on a stop at the start, with jumps that the noise hides
        (70019, {'timed': False, 'impacts': 100}),
        # m sticks in many flights, and where it rests on a stop they do not count
        (110, {'friction': 0.1}),
    ],
)
def test_a_rig_is_found_from_its_motion(seed, options):
    rig, record, fit = fitted(seed, **{'impacts': 60, **options})
    assert fit.accepted, fit.reasons
    z = errors(fit, rig)
    assert max(map(abs, z.values())) < 3.5, z
    for name, value in true_values(rig).items():
        estimate = fit.parameters[name]
        low, high = estimate.interval
        assert low < estimate.value < high
        assert high - estimate.value == pytest.approx(1.96 * estimate.standard_deviation, rel=1e-3)
        if name not in ('friction', 'damping'):
            assert estimate.value == pytest.approx(value, rel=0.05)
    if 'friction' in options:
        assert sum(flight.used and flight.sticks for flight in fit.flights) > 1
    assert 0.9 < np.sqrt(fit.chi_squared) < 1.1
    assert fit.fit_percent > 97.0
    # The rig that was found hits its stops as the record has it
    assert fit.rig.gap == fit.parameters['gap'].value
    counted = np.isfinite(fit.residuals)
    assert counted.mean() > 0.6
    np.testing.assert_allclose(
        fit.residuals[counted], (record.motion - fit.motion)[counted], atol=1e-12
    )


def test_a_flight_that_begins_at_an_impact_nobody_measured_does_not_count():
    """
    The damper sticks before the first impact from rest, and a fit takes it to reverse there.

    With that flight K was five standard deviations off, and the gap 4.9.
    """
    time = np.arange(2400) / 200.0
    run = Rig(TWIN).run(12.0, time)
    hits, off = run.impacts()['time'], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        record = MeasuredMotion(
            time,
            run.samples['x'] + rng.normal(0.0, 2e-5, len(time)),
            'displacement',
            np.ones(len(time), bool),
            impact_times=hits + rng.normal(0.0, 5e-4, len(hits)),
            impact_deviation=5e-4,
        )
        fit = fit_rig(record, TWIN.replace(stiffness=2135.0, damping=1.3))
        assert fit.accepted, fit.reasons
        assert not any(
            flight.used and np.isnan(fit.impacts['measured_time'][k])
            for k, flight in enumerate(fit.flights)
            if k == 0 or not fit.flights[k - 1].used
        )
        off.append(list(errors(fit, TWIN).values()))
    assert np.abs(off).max() < 3.5, off


def test_impact_times_of_another_clock_are_pointed_out():
    rng = np.random.default_rng(105)
    rig = random_rig(rng)
    record = measure(rig, rng, impacts=60).record
    late = record._replace(impact_times=record.impact_times + 0.02)
    fit = fit_rig(late, guess_of(rig, rng))
    assert any('impact times' in text and '20 ms late' in text for text in fit.remarks) or (
        not fit.accepted
    )


def test_times_that_agree_with_a_fit_without_them_are_not_to_blame():
    impacts, rng = np.cumsum(np.full(50, 0.1)), np.random.default_rng(1)
    times = impacts + rng.normal(0.0, 5e-4, 50)
    assert _are_right(times, impacts, 5e-4)
    # A few false ones, a clock that is late, and times of something else
    assert _are_right(np.append(times, [0.33, 0.75, 1.26]), impacts, 5e-4)
    assert not _are_right(times + 2e-3, impacts, 5e-4)
    assert not _are_right(np.linspace(0.0, 5.0, 60), impacts, 5e-4)


@pytest.mark.parametrize('seed', [9109, 9125])
def test_restitution_that_falls_with_the_speed(seed):
    """It is fitted without being asked for, and all intervals hold."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    rig = rig.replace(restitution_speed=float(rng.uniform(0.05, 1.0)))
    fit = fit_rig(measure(rig, rng, impacts=100, noise=0.01).record, guess_of(rig, rng))
    assert fit.accepted, fit.reasons
    for name in ('restitution_1', 'restitution_speed', 'friction', 'gap', 'stiffness'):
        low, high = fit.parameters[name].interval
        assert low < getattr(rig, name) < high, name
    assert fit.parameters['restitution_speed'].unit == 'm/s'
    assert fit.rig.restitution_speed == pytest.approx(fit.parameters['restitution_speed'].value)


def test_restitution_that_falls_otherwise_is_named():
    """By more than the exponent lets it: the equations have no solution."""
    rng = np.random.default_rng(495468043)
    rig = random_rig(rng)
    start = guess_of(rig, rng)
    fit = fit_rig(measure_other(rig, rng, noise=0.01, fall=0.3), start)
    assert not fit.accepted
    assert 'but not as a restitution_exponent of 0.25 has it' in fit.reasons[0]


def test_a_constant_restitution_stays_one_if_a_fall_is_asked_for():
    """Its slowness is about zero: the interval has no upper end, or it is left out."""
    rng = np.random.default_rng(105)
    rig = random_rig(rng)
    fit = fit_rig(
        measure(rig, rng, impacts=60).record, guess_of(rig, rng), also=('restitution_speed',)
    )
    assert fit.accepted, fit.reasons
    speed = fit.parameters.get('restitution_speed')
    assert speed is None or speed.interval[1] == math.inf
    words = 'does not fall with the speed', 'do not exclude a constant'
    assert any(word in remark for word in words for remark in fit.remarks)
    low, high = fit.parameters['restitution_1'].interval
    assert low < rig.restitution_1 < high


def test_names_that_cannot_be_fitted_are_refused():
    with pytest.raises(FitOptionError, match='restitution_2, restitution_speed, bias'):
        fitted(105, impacts=10, also=('mass',))
    with pytest.raises(
        FitOptionError, match="'gap' cannot be uncertain: give names of damper_mass"
    ):
        fitted(105, impacts=10, uncertain={'gap': 0.1})


@pytest.mark.parametrize(
    ('also', 'uncertain'),
    [(('damper_mass',), {}), (('primary_mass',), {}), ((), {'damper_mass': 0.1})],
)
def test_a_mass_that_is_not_that_of_the_file(also, uncertain):
    """It is named, and found where it is asked for or said to be uncertain."""
    rng = np.random.default_rng(105)
    rig = random_rig(rng)
    record = measure(rig, rng, impacts=60).record
    (name,) = also or uncertain
    wrong = guess_of(rig, rng).replace(**{name: 1.1 * getattr(rig, name)})
    refused = fit_rig(record, wrong)
    assert not refused.accepted
    assert f'--also {name} fits' in refused.reasons[0]
    fit = fit_rig(record, wrong, also=also, uncertain=uncertain)
    assert fit.accepted, fit.reasons
    for one in (name, *true_values(rig)):
        estimate = fit.parameters[one]
        assert abs(estimate.value - getattr(rig, one)) < 4.0 * estimate.standard_deviation, one
    assert getattr(fit.rig, name) == fit.parameters[name].value


def test_sensor_clocks_and_both_stops_are_fitted_where_asked_for():
    rng = np.random.default_rng(104)
    rig = random_rig(rng)
    rig = rig.replace(restitution_2=rig.restitution_1 - 0.1)
    record = measure(rig, rng, impacts=60).record
    changed = {'bias': 2e-4, 'force_delay': 1e-3}
    start = guess_of(rig, rng)
    later = tuple(
        p + w * 1e-3 for w, p in zip(start.force_frequencies, start.force_phases, strict=True)
    )
    fit = fit_rig(
        record._replace(motion=record.motion + changed['bias']),
        start.replace(force_phases=later),
        also=('restitution_2', *changed),
    )
    assert fit.accepted, fit.reasons
    for name, value in {**changed, **true_values(rig), 'restitution_2': rig.restitution_2}.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - value) < 4.0 * estimate.standard_deviation, name
    # The rig has the force at the time at which it came
    assert fit.rig.force_phases == pytest.approx(rig.force_phases, abs=0.1)


@pytest.mark.parametrize(
    'changes',
    [
        {'angle': 0.02, 'base_amplitudes': (0.6,), 'force_amplitudes': (0.0,)},
        {'angle': np.pi / 2, 'gravity': 0.5},
    ],
)
def test_inclined_and_vertical_rigs_and_a_base_that_moves(changes):
    rng = np.random.default_rng(108)
    rig = random_rig(rng)
    changes = {'base_frequencies': rig.force_frequencies, **changes}
    rig = rig.replace(**changes)
    record = measure(rig, rng, impacts=60).record
    fit = fit_rig(record, guess_of(rig, rng))
    assert fit.accepted, fit.reasons
    vertical = rig.angle > 1.0
    assert ('friction' in fit.parameters) != vertical
    for name, estimate in fit.parameters.items():
        true = np.ravel(getattr(rig, name))[0]
        assert abs(estimate.value - true) < 4.0 * estimate.standard_deviation, name


@pytest.mark.parametrize(
    ('seed', 'changes', 'beside'),
    [
        (1710679200, {'force_amplitudes': 1.1}, {}),
        (362611937, {'force_amplitudes': 1.1}, {}),
        (362611937, {'damper_mass': 0.9}, {}),
        (362611937, {}, {'second_mode': 0.02}),
    ],
)
def test_what_the_file_has_wrong_is_named_or_in_the_intervals(seed, changes, beside):
    """These records distinguish it by three to five standard deviations only."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    start = guess_of(rig, rng)
    record = measure_other(rig, rng, noise=0.01, **beside)
    wrong = {name: factor * np.ravel(getattr(rig, name))[0] for name, factor in changes.items()}
    fit = fit_rig(record, start.replace(**wrong))
    off = errors(fit, rig)
    assert max(map(abs, off.values())) < 4.0, off
    if not fit.accepted:
        # Of the masses the record has the ratio
        named = *changes, 'primary_mass', 'second mode'
        assert any(name in fit.reasons[0] for name in named), fit.reasons


def test_a_wrong_mass_is_seen_though_the_flights_that_show_it_are_left_out():
    """With the mass of the file 88 of 98 flights obey, and say nothing against it."""
    rig, rng = random_rig(np.random.default_rng(656539336)), np.random.default_rng(1009)
    start = guess_of(rig, rng).replace(damper_mass=0.9 * rig.damper_mass)
    fit = fit_rig(measure_other(rig, rng, noise=0.01), start)
    mass = fit.parameters['damper_mass']
    assert abs(mass.value - rig.damper_mass) < 3.0 * mass.standard_deviation
    assert mass.value > 0.93 * rig.damper_mass
    assert max(map(abs, errors(fit, rig).values())) < 4.0
