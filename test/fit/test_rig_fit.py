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
    ],
)
def test_a_rig_is_found_from_its_motion(seed, options):
    rig, record, fit = fitted(seed, impacts=60, **options)
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
    with pytest.raises(FitOptionError, match='restitution_2, gain, bias'):
        fitted(105, impacts=10, also=('mass',))
