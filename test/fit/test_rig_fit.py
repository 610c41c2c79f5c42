"""A rig is found again from its noisy motion, with intervals that hold."""

import numpy as np
import pytest

from impact_damper_ros.fit.rig_fit import FitOptionError, fit_rig

from .random_rigs import errors, guess_of, measure, random_rig, true_values


def fitted(seed, also=(), **options):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    record = measure(rig, rng, **options).record
    return rig, record, fit_rig(record, guess_of(rig, rng), also=also)


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
            assert estimate.value == pytest.approx(value, rel=0.03)
    assert 0.9 < np.sqrt(fit.chi_squared) < 1.1
    assert fit.fit_percent > 97.0
    # The rig that was found hits its stops as the record has it
    assert fit.rig.gap == fit.parameters['gap'].value
    counted = np.isfinite(fit.residuals)
    assert counted.mean() > 0.6
    np.testing.assert_allclose(
        fit.residuals[counted], (record.motion - fit.motion)[counted], atol=1e-12
    )


def test_names_that_cannot_be_fitted_are_refused():
    with pytest.raises(FitOptionError, match='restitution_2, bias, force_delay'):
        fitted(105, impacts=10, also=('mass',))


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
        assert abs(estimate.value - getattr(rig, name)) < 4.0 * estimate.standard_deviation, name
