"""Frequency and damping of a structure from its ring-down or a sweep, and what is refused."""

import math

import numpy as np
import pytest
import scipy

from impact_damper_ros import InitialConditions, Rig, RigParameters
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.structure import fit_structure

FREQUENCY, RATIO = 5.0, 0.01
OMEGA = math.tau * FREQUENCY


def measured(time, motion, quantity='displacement', **more):
    used = np.ones(len(time), bool)
    return MeasuredMotion(time, motion, quantity, used, source='free.csv', **more)


def ring_down(seed=1, *, quantity='displacement', noise=0.01, before=0.0, offset=0.0, ratio=RATIO):
    """Return a motion that is held, released after a while, and measured with noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(int((before + 8.0) * 200.0)) / 200.0
    later = np.maximum(0.0, time - before)
    place = 0.01 * np.exp((-ratio + 1j * math.sqrt(1.0 - ratio**2)) * OMEGA * later)
    root = (-ratio + 1j * math.sqrt(1.0 - ratio**2)) * OMEGA
    power = ('displacement', 'velocity', 'acceleration').index(quantity)
    motion = (place * root**power).real * ((time >= before) if power else 1.0)
    size = 0.01 * OMEGA**power
    return measured(time, motion + offset * size + noise * size * rng.normal(size=len(time)))


def non_linear(friction=0.0, air=0.0, cubic=0.0):
    time = np.arange(1600) / 200.0

    def rates(_, state):
        x, v = state
        stiff = OMEGA**2 * x * (1.0 + cubic * (x / 0.01) ** 2)
        lost = 2.0 * RATIO * OMEGA * v + friction * np.tanh(v / 1e-3) + air * abs(v) * v
        return [v, -stiff - lost]

    solve = scipy.integrate.solve_ivp
    motion = solve(rates, (0.0, 8.0), [0.01, 0.0], 'LSODA', time, rtol=1e-8, atol=1e-10).y[0]
    return measured(time, motion + np.random.default_rng(3).normal(0.0, 5e-5, len(time)))


@pytest.mark.parametrize('quantity', ['displacement', 'velocity', 'acceleration'])
def test_a_ring_down_with_its_release(quantity):
    data = ring_down(quantity=quantity, before=1.3, offset=0.4)
    found = fit_structure(data)
    assert found.accepted, found.reasons
    for estimate, true in ((found.frequency, FREQUENCY), (found.damping_ratio, RATIO)):
        assert abs(estimate.value - true) < 3.5 * estimate.standard_deviation
    assert found.frequency.standard_deviation < 1e-3
    assert found.damping_ratio.standard_deviation < 2e-4
    assert 1.3 < found.data.time[0] < 1.8
    assert found.noise == pytest.approx(0.01 * np.ptp(data.motion[300:330]) / 2.0, rel=0.3)
    assert len(found.parts) > 5
    assert found.whiteness < 0.1


def test_intervals_hold():
    held = np.zeros(2)
    for seed in range(40):
        found = fit_structure(ring_down(seed))
        for k, (estimate, true) in enumerate(
            ((found.frequency, FREQUENCY), (found.damping_ratio, RATIO))
        ):
            held[k] += estimate.interval[0] < true < estimate.interval[1]
    # 38 of 40; fewer than 34 in one of a hundred
    assert (held >= 34).all()


def test_samples_that_are_not_used_do_not_count():
    data = ring_down()
    motion = data.motion.copy()
    used = data.used.copy()
    motion[200:230], used[200:230] = 99.0, False
    found = fit_structure(data._replace(motion=motion, used=used))
    assert found.accepted, found.reasons
    assert abs(found.damping_ratio.value - RATIO) < 3.5 * found.damping_ratio.standard_deviation


@pytest.mark.parametrize(
    ('law', 'name', 'expected', 'reason'),
    [
        # In an amplitude A dry friction adds 2 f/(pi omega^2 A), and air 4 q A/(3 pi)
        (
            {'friction': 0.02},
            'damping_ratio',
            lambda a: RATIO + 2.0 * 0.02 / (math.pi * OMEGA**2 * a),
            'the damping is not viscous',
        ),
        (
            {'air': 0.5},
            'damping_ratio',
            lambda a: RATIO + 4.0 * 0.5 * a / (3.0 * math.pi),
            'the damping is not viscous',
        ),
        # omega^2 (1 + 3/4 k A^2)
        (
            {'cubic': 0.02},
            'frequency',
            lambda a: FREQUENCY * math.sqrt(1.0 + 0.75 * 0.02 * (a / 0.01) ** 2),
            'the stiffness is not linear',
        ),
    ],
)
def test_what_is_not_linear_is_named_with_its_change(law, name, expected, reason):
    found = fit_structure(non_linear(**law))
    assert not found.accepted
    assert reason in found.reasons[0]
    assert f'the {name.replace("_", " ")} changes with the amplitude' in found.reasons[0]
    parts = sorted(found.parts, key=lambda part: part.amplitude)
    percent = name == 'damping_ratio'
    for part in (parts[0], parts[-1]):
        value, true = getattr(part, name), expected(part.amplitude)
        deviation = getattr(part, f'{name.partition("_")[0]}_deviation')
        assert value == pytest.approx(true, abs=4.0 * deviation)
        assert deviation < (0.1 if percent else 1e-3) * true
        shown = f'{100.0 * value:.3g} ±' if percent else f'{value:.5g} ±'
        assert f'{shown} ' in found.reasons[0]
        assert f'at {part.amplitude:.3g} m' in found.reasons[0]
    # The other quantity stays as it is
    assert sum('changes with the amplitude' in text for text in found.reasons) == 1


def swept(quantity, kind, *, noise=0.02, mass=2.0, input_noise=0.0, gain=1.0, seed=5, fine=20):
    """Return a sweep at 40 samples a period, of a motion that is computed at 20 times as many."""
    rng = np.random.default_rng(seed)
    time = np.arange(4000 * fine) / (200.0 * fine)
    angle = math.tau * (3.0 * time + 0.5 * (5.0 / 20.0) * time**2)
    drive = np.sin(angle)
    above = {'displacement': [1.0], 'velocity': [1.0, 0.0], 'acceleration': [1.0, 0.0, 0.0]}
    numerator = np.array(above[quantity]) / mass
    if kind == 'base':
        numerator = [2.0 * RATIO * OMEGA, OMEGA**2]
    system = (numerator, [1.0, 2.0 * RATIO * OMEGA, OMEGA**2])
    _, motion, _ = scipy.signal.lsim(system, drive, time)
    time, drive, motion = time[::fine], drive[::fine], gain * motion[::fine]
    motion += noise * np.std(motion) * rng.normal(size=len(time))
    drive += input_noise * rng.normal(size=len(time))
    if kind == 'force':
        return measured(time, motion, quantity, force=drive)
    return measured(time, motion, quantity, base=drive, base_quantity=quantity)


@pytest.mark.parametrize('input_noise', [0.0, 0.005, 0.02])
@pytest.mark.parametrize('quantity', ['displacement', 'velocity', 'acceleration'])
@pytest.mark.parametrize('kind', ['force', 'base'])
def test_a_sweep(quantity, kind, input_noise):
    found = fit_structure(swept(quantity, kind, input_noise=input_noise))
    assert found.kind == kind
    assert found.accepted, found.reasons
    assert abs(found.frequency.value - FREQUENCY) < 3.5 * found.frequency.standard_deviation
    assert abs(found.damping_ratio.value - RATIO) < 3.5 * found.damping_ratio.standard_deviation
    assert found.input_noise == pytest.approx(input_noise, rel=0.1, abs=1e-3)
    if kind == 'force':
        assert abs(found.mass.value - 2.0) < 3.5 * found.mass.standard_deviation
        # 0.2 % is what straight lines between 40 samples a period make of it
        assert found.mass.value == pytest.approx(2.0, rel=1.5e-3)
    else:
        assert found.mass is None


@pytest.mark.parametrize(('gain', 'reason'), [(-1.0, 'reverse the sign'), (9.81, '9.8')])
def test_a_sensor_the_other_way_round_or_in_another_unit(gain, reason):
    found = fit_structure(swept('acceleration', 'base', gain=gain))
    assert not found.accepted
    assert reason in found.reasons[0]


def test_a_ring_down_with_the_damper_in_it():
    """The loose mass takes the more of the amplitude, the less there is of it."""
    rig = RigParameters(
        primary_mass=2.0,
        stiffness=2.0 * OMEGA**2,
        damping=4.0 * RATIO * OMEGA,
        damper_mass=0.12,
        gap=0.006,
        restitution_1=0.6,
        restitution_2=0.6,
        friction=0.05,
        force_amplitudes=(0.0,),
    )
    time = np.arange(1600) / 200.0
    run = Rig(rig, InitialConditions(initial_primary_position=0.03)).run(8.0, time)
    x = run.samples['x'] + np.random.default_rng(3).normal(0.0, 5e-5, len(time))
    found = fit_structure(measured(time, x))
    assert not found.accepted
    assert 'is the damper still in it?' in found.reasons[0]


def test_what_is_no_free_vibration():
    time = np.arange(1600) / 200.0
    rng = np.random.default_rng(2)
    steady = np.sin(OMEGA * time) + rng.normal(0.0, 0.01, len(time))
    found = fit_structure(measured(time, steady))
    assert not found.accepted
    assert 'does not decay' in found.reasons[0]
    assert 'switch the shaker off' in found.reasons[0]
    two = ring_down().motion + 3e-3 * np.exp(-0.3 * time) * np.cos(1.7 * OMEGA * time)
    found = fit_structure(measured(time, two))
    assert not found.accepted
    short = ring_down()
    with pytest.raises(ValueError, match=r'2\.5 cycles of .* Hz: record at least 4'):
        fit_structure(short.between(0.0, 0.5))
    mixed = swept('displacement', 'base')._replace(base_quantity='acceleration')
    with pytest.raises(ValueError, match='displacement of M beside the acceleration of the base'):
        fit_structure(mixed)
    found = fit_structure(swept('displacement', 'force', mass=-2.0))
    assert 'reverse the sign' in found.reasons[0]
