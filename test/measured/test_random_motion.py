"""Random signals from the table of a density, against the integral and Welch's estimate."""

import math

import numpy as np
import pytest
import scipy

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.measured.random_motion import Density, random_lines
from impact_damper_ros.measured.table import TableError

TABLE = 'f [Hz],level [g^2/Hz]\n3,1e-4\n5,1e-3\n8,1e-4\n'
POINTS = [3.0, 5.0, 8.0], [1e-4, 1e-3, 1e-4]


def level(frequency):
    return np.exp(np.interp(np.log(frequency), np.log(POINTS[0]), np.log(POINTS[1])))


def test_the_mean_square_is_the_integral():
    density = Density(*POINTS)
    expected = scipy.integrate.quad(level, 3.0, 8.0, points=[5.0])[0]
    assert density.integral(3.0, 8.0) == pytest.approx(expected)
    assert density.integral(0.0, 4.0) == pytest.approx(scipy.integrate.quad(level, 3.0, 4.0)[0])
    inverse = Density([1.0, math.e], [1.0, 1.0 / math.e])
    assert inverse.integral(1.0, math.e) == pytest.approx(1.0)


@pytest.mark.parametrize('count', [1, 7, 400])
def test_lines(tmp_path, count):
    path = tmp_path / 'psd.csv'
    path.write_text(TABLE)
    found = random_lines(path, count, seed=7)
    assert found.quantity == 'acceleration'
    assert found.rms / 9.80665 == pytest.approx(0.0439, abs=5e-5)
    assert math.sqrt(sum(a * a for a in found.amplitudes) / 2.0) == pytest.approx(found.rms)
    # All lines are multiples of one frequency, so that the signal repeats.
    turns = np.array(found.frequencies) * found.period / math.tau
    assert turns == pytest.approx(np.round(turns))
    assert found == random_lines(path, count, seed=7)
    assert found.phases != random_lines(path, count, seed=8).phases


def test_a_base_has_the_density(tmp_path):
    """The acceleration of the base, from its velocity, has the density of the table."""
    path = tmp_path / 'psd.csv'
    path.write_text(TABLE)
    found = random_lines(path, 400, seed=3)
    rig = RigParameters(
        stiffness=1974.0,
        primary_mass=2.0,
        damping=1.26,
        gap=10.0,
        force_amplitudes=0.0,
        base_amplitudes=found.amplitudes,
        base_frequencies=found.frequencies,
        base_phases=found.phases,
    )
    step = 1.0 / 64.0
    times = np.arange(0.0, found.period, step)
    samples = Rig(rig, compiled=True).run(float(times[-1]), times).samples
    acceleration = np.gradient(samples['base_velocity'], step)
    assert math.sqrt(np.mean(acceleration**2)) == pytest.approx(found.rms, rel=0.05)
    frequencies, estimate = scipy.signal.welch(acceleration, 64.0, nperseg=512)
    inside = (frequencies > 3.5) & (frequencies < 7.5)
    ratio = estimate[inside] / (level(frequencies[inside]) * 9.80665**2)
    # The difference quotient lowers them by sinc^2 of the frequency.
    assert np.median(ratio) == pytest.approx(0.88, abs=0.12)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('f [Hz],level [g^2/Hz]\n3,1e-4\n', '1 rows: give at least 2'),
        ('f [Hz],level [g^2/Hz]\n3,1e-4\n2,1e-4\n', 'line 3.*must rise'),
        ('f [Hz],level [g^2/Hz]\n0,1e-4\n2,1e-4\n', 'line 2.*give a positive number'),
        ('f [Hz],level [g^2/Hz]\n1,1e-4\n2,-1e-4\n', 'line 3.*: -0.0001: give a positive number'),
        ('f [Hz],level [g]\n1,1e-4\n2,1e-4\n', "has the unit 'g'.*g.2/Hz"),
        ('f [Hz],level\n1,1e-4\n2,1e-4\n', 'has no unit'),
    ],
)
def test_refusals(tmp_path, text, problem):
    path = tmp_path / 'psd.csv'
    path.write_text(text)
    with pytest.raises(TableError, match=problem):
        random_lines(path)
    with pytest.raises(TableError, match='give a number from 1'):
        random_lines(path, 0)
