"""What cannot be fitted is refused, with a reason that names it; no number without an interval."""

import numpy as np
import pytest

from fit.other_rigs import measure_other
from fit.random_rigs import guess_of, measure, random_rig
from impact_damper_ros import Rig
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.rig_fit import fit_rig


@pytest.fixture(scope='module')
def bench():
    """Return a rig, the start of a fit, and its record."""
    rng = np.random.default_rng(108)
    rig = random_rig(rng)
    return rig, guess_of(rig, rng), measure(rig, rng, impacts=60).record


def refused(record, start):
    fit = fit_rig(record, start)
    assert not fit.accepted
    assert fit.reasons
    return fit


def test_a_constant_signal(bench):
    _, start, record = bench
    fit = refused(record._replace(motion=np.full(len(record.time), 0.25)), start)
    assert fit.reasons == ['displacement is 0.25 at all times: connect the sensor']
    assert not fit.parameters
    assert fit.rig is None


def test_millimetres_for_metres(bench):
    _, start, record = bench
    fit = refused(record._replace(motion=1e3 * record.motion), start)
    assert 'check the units' in fit.reasons[0]


def test_g_for_metres_per_second_squared():
    rng = np.random.default_rng(108)
    rig = random_rig(rng)
    record = measure(rig, rng, impacts=60, quantity='acceleration').record
    fit = refused(record._replace(motion=record.motion / 9.80665), guess_of(rig, rng))
    assert 'g were taken for m/s^2' in fit.reasons[0]


def test_noise_alone(bench):
    _, start, record = bench
    noise = np.random.default_rng(1).normal(0.0, 1e-3, len(record.time))
    assert 'mostly noise' in refused(record._replace(motion=noise), start).reasons[0]


def test_a_gap_in_time(bench):
    _, start, record = bench
    used = record.used & ~((record.time > 2.0) & (record.time < 2.5))
    reason = refused(record._replace(used=used), start).reasons[0]
    assert 'gap of' in reason
    assert 'from 2 s' in reason


def test_milliseconds_that_are_called_seconds(bench):
    _, start, record = bench
    reason = refused(record._replace(time=1e3 * record.time), start).reasons[0]
    assert 'are its times in ms?' in reason


def test_a_motion_relative_to_the_base():
    rng = np.random.default_rng(108)
    rig = random_rig(rng).replace(force_amplitudes=(0.0,))
    rig = rig.replace(base_amplitudes=(0.6,), base_frequencies=rig.force_frequencies)
    record = measure(rig, rng, impacts=40).record
    base = 0.6 / -(rig.force_frequencies[0] ** 2) * np.sin(rig.force_frequencies[0] * record.time)
    fit = refused(record._replace(motion=record.motion - base), guess_of(rig, rng))
    assert any('relative to the base' in reason for reason in fit.reasons)


def test_times_that_do_not_rise(bench):
    _, start, record = bench
    time = record.time.copy()
    time[[40, 41]] = time[[41, 40]]
    assert 'time does not rise after' in refused(record._replace(time=time), start).reasons[0]


def test_too_few_impacts(bench):
    rig, start, _ = bench
    # The loose mass is held at first: the record ends before its fourth impact
    end = Rig(rig).run(60.0).impacts()['time'][3]
    time = np.arange(0.0, end, 0.005)
    x = Rig(rig).run(time[-1], time).samples['x']
    x = x + np.random.default_rng(2).normal(0.0, 0.01 * x.std(), len(x))
    record = MeasuredMotion(time, x, 'displacement', np.ones(len(time), bool))
    assert 'impacts' in refused(record, start).reasons[0]


def test_a_force_of_another_size(bench):
    """It is refused, recorded by a wrong sensor as well as described."""
    rig, start, record = bench
    other = start.replace(force_amplitudes=(1.5 * rig.force_amplitudes[0],))
    reasons = refused(_first(record, 600), other).reasons
    assert any('force' in reason for reason in reasons), reasons


def test_a_sign_is_named_and_no_level_for_a_mass(bench):
    rig, start, record = bench
    backwards = refused(record._replace(motion=-record.motion), start).reasons
    assert 'the other way round' in backwards[0]
    # Half of m: the impacts that it would make are too weak, not the force
    lighter = start.replace(mass_ratio=0.5 * rig.mass_ratio)
    reasons = refused(record, lighter).reasons
    assert not any('times as large as the file says' in one for one in reasons), reasons


def test_a_spring_that_is_not_linear():
    """One that is 0.5 % stiffer where X has its rms: by an integrator of its own."""
    rng = np.random.default_rng(1957933478)
    rig = random_rig(rng)
    start = guess_of(rig, rng)
    record = measure_other(rig, rng, cubic=0.01)
    fit = refused(record, start)
    assert 'the spring is not linear' in fit.reasons[0]
    found = fit.checks[0]
    true = 0.01 * float(np.mean(record.motion**2)) / (0.25 * rig.gap) ** 2
    assert found.value == pytest.approx(true, abs=3.0 * found.standard_deviation)
    assert found.z > 8.0


def test_a_second_mode_beside_flights_that_do_not_count():
    """2 % of M on a spring of its own: its impacts in these flights count, too."""
    rng = np.random.default_rng(1335684043)
    rig = random_rig(rng)
    start = guess_of(rig, rng)
    fit = refused(measure_other(rig, rng, second_mode=0.02), start)
    assert 'M has a second mode' in fit.reasons[0]
    # The frequency of both masses on both springs.
    squares = np.linalg.eigvals([[1.0 + 0.02 * 1.5**2, -0.02 * 1.5**2], [-(1.5**2), 1.5**2]])
    frequency = np.sqrt(squares.max()) * rig.omega / (2.0 * np.pi)
    assert float(fit.checks[0].name.split()[3]) == pytest.approx(frequency, rel=0.02)
    assert fit.checks[0].z > 5.0


def test_an_offset_of_the_sensor(bench):
    """A laser is 35 mm from M; a record of M without its damper has no impacts."""
    _, start, record = bench
    reasons = refused(record._replace(motion=record.motion + 0.035), start).reasons
    assert 'subtract the offset of the sensor, or give --also bias' in reasons[0]
    alone = np.real(np.exp((-0.3 + 1j * start.omega) * record.time)) * 0.01
    alone += np.random.default_rng(3).normal(0.0, 1e-4, len(alone))
    still = start.replace(force_amplitudes=(0.0,))
    reasons = refused(record._replace(motion=alone, impact_times=None), still).reasons
    assert 'the damper is not in it' in reasons[0]


def test_two_rigs_in_one_record(bench):
    rig, start, record = bench
    rng = np.random.default_rng(5)
    other = rig.replace(gap=1.4 * rig.gap, restitution_1=0.9, restitution_2=0.9)
    second = measure(other, rng, impacts=30).record
    first, second = _first(record, 400), _first(second, 400)
    time = np.concatenate([first.time, record.time[400] + second.time])
    motion = np.concatenate([first.motion, second.motion])
    mixed = MeasuredMotion(time, motion, 'displacement', np.ones(len(time), bool))
    refused(mixed, start)


def _first(record, count):
    """Return the first samples of a record."""
    parts = {name: getattr(record, name)[:count] for name in ('time', 'motion', 'used')}
    return record._replace(**parts)
