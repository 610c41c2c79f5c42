"""What the controller sees: noise, amplitude, rhythm and impacts."""

import math

import numpy as np
import pytest

from control.controlled_rigs import TRIAL, control
from impact_damper_ros import EventKind, GapControlParameters, Rig, RigParameters
from impact_damper_ros.control.controller import control_of, sensor_sample
from impact_damper_ros.control.sensors import (
    expected_passage,
    forget_hits,
    is_too_soon,
    mixed_seed,
    note_passage,
    observe_sample,
    sensor_noise,
)
from impact_damper_ros.control.state import Estimates, Measurement, damper_of
from impact_damper_ros.motion.kernels import has_numba

#: Time, X, X', Y, Y', and the stops
MOTION = (2.5, 1.0, -2.0, 0.75, 2.5, 2.0, -3.0)


def noise(seed, index):
    return sensor_noise(mixed_seed(seed), index, 1.0, 1.0)


def test_without_noise_the_sample_itself():
    there = control_of(GapControlParameters(), RigParameters())
    seen = sensor_sample(there.settings, there.estimates, 3, *MOTION)
    assert seen == (2.5, 1.0, -2.0, 0.75, 2.5, 2.0, -3.0)
    assert (seen.z, seen.z_rate) == (1.75, 0.5)


def test_noise_is_a_pure_function_of_seed_and_index():
    assert noise(5, 1000) == noise(5, 1000)
    assert noise(5, 1000) != noise(5, 1001)
    assert noise(5, 1000) != noise(6, 1000)
    # Recorded runs are replayed with it: these numbers must never change.
    assert noise(0, 1) == pytest.approx(
        (-0.2505689576568948, 1.600729306271481, 0.12112185055830514, -0.0715885785775911),
        abs=1e-15,
    )


def test_noise_is_standard_normal_and_uncorrelated():
    values = np.array([noise(seed, k) for seed in (1, 2) for k in range(10000)])
    count = len(values)
    assert np.abs(values.mean(axis=0)).max() < 4.0 / np.sqrt(count)
    assert np.abs(values.std(axis=0) - 1.0).max() < 4.0 / np.sqrt(2.0 * count)
    # Shares within 1 and 2 standard deviations
    assert np.mean(np.abs(values) < 1.0) == pytest.approx(0.6827, abs=0.006)
    assert np.mean(np.abs(values) < 2.0) == pytest.approx(0.9545, abs=0.003)
    covariance = np.corrcoef(values, rowvar=False) - np.eye(4)
    assert np.abs(covariance).max() < 4.0 / np.sqrt(count)
    following = np.sum(values[:-1] * values[1:], axis=0) / count
    assert np.abs(following).max() < 4.0 / np.sqrt(count)


def test_noise_has_the_standard_deviations_asked_for():
    control = GapControlParameters(
        gap_control_noise_position=0.1, gap_control_noise_velocity=2.0, gap_control_seed=9
    )
    there = control_of(control, RigParameters())
    sensors = there.settings, there.estimates
    seen = np.array([sensor_sample(*sensors, k, *MOTION) for k in range(5000)])
    assert np.std(seen[:, (1, 3)], axis=0) == pytest.approx([0.1, 0.1], rel=0.04)
    assert np.std(seen[:, (2, 4)], axis=0) == pytest.approx([2.0, 2.0], rel=0.04)
    # Instant and encoders are exact.
    assert set(seen[:, 0]) == {2.5}
    assert set(seen[:, 5]) == {2.0}


def sine(time, amplitude=3.0, frequency=0.7):
    """Return a sample of X = a sin(w t) and of m at Z = 1 + 0.4 t."""
    x = amplitude * math.sin(frequency * time)
    x_rate = amplitude * frequency * math.cos(frequency * time)
    z = 1.0 + 0.4 * time
    return Measurement(time, x, x_rate, z - x, 0.4 - x_rate, 5.0, -5.0)


def watched_sine(cycles=20, smoothing=0.3):
    estimates = Estimates()
    half = math.pi / 0.7
    time, k = 0.0, 0
    for crossing in range(1, 2 * cycles):
        while time < crossing * half:
            k += 1
            time = 0.02 * k
            if time < crossing * half:
                observe_sample(estimates, sine(time), 1.5 / 1.1, 0.0)
        k -= 1
        note_passage(estimates, crossing * half, smoothing)
    return estimates


def test_amplitude_and_rhythm_of_a_sine():
    estimates = watched_sine()
    assert estimates.half_cycle == pytest.approx(math.pi / 0.7, rel=1e-12)
    assert estimates.amplitude == pytest.approx(3.0 * (1.0 - 0.7**38), rel=1e-4)


def test_the_amplitude_is_smoothed_as_the_law_says():
    estimates = Estimates()
    assert not note_passage(estimates, 0.0, 0.25)
    assert estimates.amplitude == 0.0
    for k, peak in enumerate((4.0, 2.0, 2.0), start=1):
        observe_sample(estimates, sine(k - 0.5)._replace(x=-peak), 1.5, 0.0)
        assert note_passage(estimates, float(k), 0.25)
    assert estimates.amplitude == pytest.approx(0.25 * 2 + 0.75 * (0.25 * 2 + 0.75 * 4))


@pytest.mark.parametrize('ahead', [0.1, 0.5, 1.0, 1.5])
def test_the_next_passage_is_foreseen(ahead):
    estimates = watched_sine()
    crossing = 40 * math.pi / 0.7
    observe_sample(estimates, sine(crossing - ahead), 1.5 / 1.1, 0.0)
    seen = expected_passage(estimates)
    assert seen.time == pytest.approx(crossing, rel=1e-9)
    assert seen.x_rate == pytest.approx(3.0 * 0.7, rel=1e-9)
    assert seen.y == pytest.approx(1.0 + 0.4 * crossing, rel=1e-9)
    assert seen.y_rate == pytest.approx(0.4 - 2.1, rel=1e-9)


def test_no_passage_is_foreseen_just_after_one():
    estimates = watched_sine()
    crossing = 39 * math.pi / 0.7
    for x in (1e-3, -1e-3):
        observe_sample(estimates, sine(crossing + 0.01)._replace(x=x), 1.5 / 1.1, 0.0)
        seen = expected_passage(estimates)
        assert math.isnan(seen.time) or seen.time > crossing + 2.0


@pytest.mark.parametrize('rate', [2.0, 5.0, 20.0])
def test_impacts_are_found_between_the_samples(rate):
    """As the simulator has them, in a run without control."""
    rig = Rig(TRIAL)
    rig.advance(200.0)
    estimates = Estimates()
    jump = damper_of(TRIAL).damper_jump
    found, events = [], []
    for k in range(int(200 * rate), int(300 * rate)):
        events += rig.advance(k / rate)
        s = rig.sample()
        y_rate = s.damper_velocity - s.primary_velocity
        observe_sample(
            estimates,
            Measurement(s.time, s.x, s.primary_velocity, s.z - s.x, y_rate, 10.0, -10.0),
            jump,
            0.0,
        )
        hits = (
            (estimates.hit_time_1, 1, estimates.hit_speed_1),
            (estimates.hit_time_2, 2, estimates.hit_speed_2),
        )
        found += [hit for hit in hits if not math.isnan(hit[0])]
        forget_hits(estimates)
    impacts = [
        (e.time, e.stop, abs(e.damper_velocity_before - e.primary_velocity_before))
        for e in events
        if e.kind is EventKind.IMPACT
    ]
    assert len(impacts) > 30
    assert [f[1] for f in found] == [i[1] for i in impacts]
    # Without friction and weight m flies straight, so that the instant is exact; the approach
    # speed is that of the sample before.
    for hit, impact in zip(found, impacts, strict=True):
        assert hit[0] == pytest.approx(impact[0], abs=1e-9)
        assert hit[2] == pytest.approx(impact[2], abs=4.0 / rate)


def faulty(fault, count=400, **values):
    """Return what faulty sensors see of a rig, and where it is."""
    control = GapControlParameters(
        sensor_fault=fault, sensor_fault_size=0.5, gap_control_seed=4, **values
    )
    rig = Rig(RigParameters(gravity=0.0), control=control)
    seen, there = [], []
    for index in range(count):
        rig.advance(index * 0.25)
        seen.append(rig.measure(index)[0])
        sample = rig.sample()
        there.append((sample.x, sample.z - sample.x, sample.primary_velocity))
    return seen, there


def test_faults_of_the_sensors():
    seen, there = faulty('bias')
    assert all(
        (s.x, s.y) == (x + 0.5, pytest.approx(y + 0.5))
        for s, (x, y, _) in zip(seen, there, strict=True)
    )
    seen, there = faulty('spike')
    off = [round(s.x - x, 12) for s, (x, *_) in zip(seen, there, strict=True)]
    assert set(off) == {-0.5, 0.0, 0.5}
    # 40 of 400 within three standard deviations
    assert abs(sum(map(bool, off)) - 40) < 18
    assert faulty('spike')[0] == seen


@pytest.mark.parametrize('step', [1e-22, 1e-300, 5e-324])
def test_steps_finer_than_the_digits_of_a_value_leave_it(step):
    fine = {'gap_control_resolution_position': step, 'gap_control_resolution_velocity': step}
    rigs = [Rig(TRIAL, control=control('timed', **values)) for values in ({}, fine)]
    if has_numba():
        rigs.append(Rig(TRIAL, control=control('timed', **fine), compiled=True))
    runs = [rig.run(100.0, [30.0, 100.0]) for rig in rigs]
    assert len(runs[0].events) > 10
    for other in runs[1:]:
        assert other.events.tolist() == runs[0].events.tolist()
        assert other.samples.tolist() == runs[0].samples.tolist()


def test_samples_are_rounded_to_whole_steps():
    steps = {
        'gap_control_resolution_position': 0.125,
        'gap_control_resolution_velocity': 0.25,
    }
    seen, there = faulty('none', **steps)
    for one, (x, _, velocity) in zip(seen, there, strict=True):
        assert one.x % 0.125 == one.x_rate % 0.25 == 0.0
        assert abs(one.x - x) <= 0.0625
        assert abs(one.x_rate - velocity) <= 0.125


@pytest.mark.parametrize(('fault', 'moves'), [('none', True), ('dropout', False)])
def test_a_law_without_samples_does_nothing(fault, moves):
    control = GapControlParameters(gap_control='timed', sensor_fault=fault)
    rig = Rig(RigParameters(gravity=0.0), control=control)
    rig.advance(60.0)
    assert (rig.amplitude > 0.0) is moves


def test_a_frozen_sensor_repeats_its_last_sample():
    control = GapControlParameters(gap_control='amplitude', gap_control_rate=10.0)
    rig = Rig(RigParameters(gravity=0.0), control=control)
    rig.advance(10.0)
    last, _ = rig.measure(101)
    rig.change(rig.parameters, control.replace(sensor_fault='frozen'))
    rig.advance(11.0)
    assert rig.measure(111)[0][1:5] == last[1:5]
    assert rig.sample().x != last.x


def jump(share, speed, side, noise=0.0):
    """Return with which speed an impact is detected in m that reverses; NaN if none is."""
    estimates, jump = Estimates(), 1.5
    y_rate, z_rate = -0.001 * side, side * speed * (1.0 - share * jump)
    for seen in (
        Measurement(0.0, 0.0, 0.0, 0.0, side * speed, 5.0, -5.0),
        Measurement(0.1, 0.0, z_rate - y_rate, 0.0, y_rate, 5.0, -5.0),
    ):
        observe_sample(estimates, seen, jump, noise)
    return estimates.hit_speed_1 if side > 0 else estimates.hit_speed_2


@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize('speed', [0.1, 1.0, 20.0])
def test_an_impact_is_a_jump_by_a_share_of_its_approach(speed, side):
    assert math.isnan(jump(0.29, speed, side))
    assert jump(0.31, speed, side) == speed
    # Clear of the noise of four rates
    assert math.isnan(jump(1.0, speed, side, noise=1.51 * speed / 8.0))
    assert jump(1.0, speed, side, noise=1.49 * speed / 8.0) == speed


def test_a_passage_just_after_another_one_does_not_count():
    estimates = Estimates(crossed=103.0, half_cycle=3.0)
    assert is_too_soon(estimates, 103.05)
    assert not is_too_soon(estimates, 103.07)
