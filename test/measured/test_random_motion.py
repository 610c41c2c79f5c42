"""Random signals from the table of a density, against the integral and Welch's estimate."""

import math

import numpy as np
import pytest
import scipy
from rigs import UNFORCED

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.measured.random_motion import Density, random_lines
from impact_damper_ros.measured.sheet import TableError
from impact_damper_ros.measured.sweep_levels import sweep_levels

G = 9.80665
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
    rig = UNFORCED.replace(
        gap=10.0,
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
    ('text', 'square', 'band'),
    [
        ('f [Hz],psd [G^2/Hz]\n3,1e-3\n8,1e-3\n', 5e-3, (3.0, 8.0)),
        ('f [Hz],s [m²/s³]\n3,0.1\n8,0.1\n', 0.5 / G**2, (3.0, 8.0)),
        ('f [Hz],s [(m/s2)2/Hz]\n3,0.1\n8,0.1\n', 0.5 / G**2, (3.0, 8.0)),
        ('f [Hz],level [g2/Hz]\n3,1e-3\n5,1e-3\n5,2e-4\n8,2e-4\n', 2.6e-3, (3.0, 8.0)),
        (
            'f [Hz],level [g^2/Hz]\n0,0\n3,0\n3.01,1e-3\n8,1e-3\n8.01,0\n20,0\n',
            4.99e-3,
            (3.01, 8.0),
        ),
        ('f [Hz],level [g^2/Hz]\n3,1e-3\n4,1e-3\n5,0\n6,1e-3\n8,1e-3\n', 3e-3, (3.0, 8.0)),
        # Six dB per octave are the square of the frequency, but for a part in a thousand
        ('f [Hz],level [g^2/Hz],slope [dB/oct]\n3,,6.0206\n6,4e-3,0\n8,,\n', 15e-3, (3.0, 8.0)),
        ('f [Hz],level [g^2/Hz],slope [dB/oct]\n3,1e-3,6.0206\n6,,0\n8,,\n', 15e-3, (3.0, 8.0)),
    ],
)
def test_units_steps_zeros_and_slopes(tmp_path, text, square, band):
    path = tmp_path / 'psd.csv'
    path.write_text(text, encoding='utf-8')
    found = random_lines(path, 100)
    assert (found.integral / G) ** 2 == pytest.approx(square, rel=1e-4)
    assert found.rms == pytest.approx(found.integral, rel=1e-3)
    ends = np.array([found.frequencies[0], found.frequencies[-1]]) / math.tau
    assert ends == pytest.approx(band, abs=0.03)


def test_columns_that_are_not_used(tmp_path):
    path = tmp_path / 'psd.csv'
    path.write_text('f [Hz],level [g^2/Hz],phase [rad]\n3,1e-4,1\n5,1e-3,2\n')
    words = random_lines(path, 4).description()
    assert words.endswith(
        "; reads frequency 'f [Hz]', level 'level [g^2/Hz]'; not used: 'phase [rad]'"
    )


def test_a_step_of_a_sweep(tmp_path):
    path = tmp_path / 'levels.csv'
    path.write_text('f [Hz],level [g]\n3,0.1\n5,0.1\n5,0.05\n8,0.05\n')
    values, _ = sweep_levels(path)
    hertz = np.array(values['sweep_notch_frequencies']) / math.tau
    assert hertz == pytest.approx([3.0, 5.0, 5.0, 8.0], rel=2e-6)
    assert (np.diff(hertz) > 0.0).all()
    assert values['base_amplitudes'] == (pytest.approx(0.1 * G),)
    assert values['sweep_notch_factors'] == pytest.approx((1.0, 1.0, 0.5, 0.5))
    rig = RigParameters(
        sweep_low=20.0, sweep_high=50.0, sweep_rate=2.0, force_amplitudes=0.0, **values
    )
    assert rig.sweep_notch_factors == values['sweep_notch_factors']


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('f [Hz],level [g^2/Hz]\n3,1e-4\n', '1 rows: give at least 2'),
        ('f [Hz],level [g^2/Hz]\n3,1e-4\n2,1e-4\n', 'line 3.*must rise'),
        ('f [Hz],level [g^2/Hz]\n0,1e-4\n2,1e-4\n', 'line 2.*: 0 Hz: begin at the lowest'),
        (
            'f [Hz],level [g^2/Hz]\n1,1e-4\n2,-1e-4\n',
            'line 3.*: -0.0001: give a number of at least 0',
        ),
        ('f [Hz],level [g]\n1,1e-4\n2,1e-4\n', "has the unit 'g'.*g.2/Hz"),
        ('f [Hz],level\n1,1e-4\n2,1e-4\n', 'has no unit'),
        ('f [Hz],level [g^2/Hz]\n1,0\n2,1e-4\n3,0\n', 'no band with a level above 0'),
        ('f [Hz],level [g^2/Hz]\n3,1\n3,1\n', 'no band with a level above 0'),
        ('f [Hz],level [g^2/Hz],slope [dB/oct]\n1,,1\n2,,1\n', 'line 2.*no number'),
    ],
)
def test_refusals(tmp_path, text, problem):
    path = tmp_path / 'psd.csv'
    path.write_text(text)
    with pytest.raises(TableError, match=problem):
        random_lines(path)
    with pytest.raises(TableError, match='give a number from 1'):
        random_lines(path, 0)
