"""The force or the base as it was recorded, and a force whose phase is not known."""

import numpy as np
import pytest
from rigs import TWIN

from fit.random_rigs import errors, guess_of, measure, random_rig
from impact_damper_ros import InitialConditions, Rig
from impact_damper_ros.fit.excitation import tones_of, with_excitation
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.rig_fit import fit_rig


@pytest.fixture(scope='module')
def bench():
    """Return a rig, the start of a fit, and its record."""
    rng = np.random.default_rng(108)
    rig = random_rig(rng)
    return rig, guess_of(rig, rng), measure(rig, rng, impacts=60).record


def test_a_recorded_force_counts_and_not_the_described_one(bench):
    """The description is wrong in all; the record has an offset and noise."""
    rig, start, record = bench
    rng = np.random.default_rng(3)
    wave = rig.force_amplitudes[0] * np.sin(
        rig.force_frequencies[0] * record.time + rig.force_phases[0]
    )
    wave += 0.3 + rng.normal(0.0, 0.01, len(wave))
    other = start.replace(force_amplitudes=(0.7,), force_frequencies=(11.0,))
    # On a clock that counts from 1970 on
    late = 1.7e9 + record.time
    found, remarks = with_excitation(record._replace(time=late, force=wave), other)
    assert found.force_amplitudes == pytest.approx(rig.force_amplitudes, rel=2e-3)
    assert found.force_frequencies == pytest.approx(rig.force_frequencies, rel=1e-4)
    drive = found.force_amplitudes[0] * np.sin(
        found.force_frequencies[0] * late + found.force_phases[0]
    )
    assert drive == pytest.approx(wave - 0.3, abs=0.06)
    assert 'the recorded force is used, 1.2' in remarks[0]
    # A file that has the base only leaves the force as it is by default, which is none here
    base = start.replace(force_amplitudes=1.0, force_frequencies=1.0, force_phases=0.0)
    shaken, _ = with_excitation(record._replace(base=wave, base_quantity='acceleration'), base)
    assert shaken.base_amplitudes == pytest.approx(rig.force_amplitudes, rel=2e-3)
    assert shaken.force_amplitudes == (0.0,)
    # A described force that agrees is kept
    assert with_excitation(record._replace(force=wave), rig) == (rig, [])
    fit = fit_rig(record._replace(force=wave), other)
    assert fit.accepted, fit.reasons
    assert fit.remarks[0].startswith('the recorded force is used')
    for name in ('stiffness', 'damping', 'gap', 'restitution_1'):
        one = fit.parameters[name]
        assert abs(one.value - getattr(rig, name)) < 4.0 * one.standard_deviation, name


def test_a_swept_force_is_refused(bench):
    """All tones of a signal are found, including a small one."""
    _, start, record = bench
    time = record.time
    two = tones_of(time, 1.5 * np.sin(30.0 * time) + 0.05 * np.cos(90.0 * time))
    assert two.amplitudes == pytest.approx([1.5, 0.05], rel=1e-6)
    assert two.frequencies == pytest.approx([30.0, 90.0], rel=1e-6)
    sweep = np.sin(2.0 * np.pi * (3.0 * time + 0.2 * time**2))
    reasons = fit_rig(record._replace(force=sweep), start).reasons
    assert 'the recorded force: 6 tones leave' in reasons[0]
    assert 'sweeps, random excitation and blows are not fitted' in reasons[0]


@pytest.mark.parametrize('phase', [-2.0, 3.1])
def test_a_force_whose_phase_is_not_known(bench, phase):
    """It is looked for all around, from a stiffness that is 3 % off."""
    rig, start, record = bench
    other = start.replace(
        force_phases=(rig.force_phases[0] + phase,), stiffness=1.03 * rig.stiffness
    )
    # On a clock that counts from 1970 on, and one from 0 on
    began = 1.7e9 if phase > 0.0 else 0.0
    record = record._replace(time=record.time + began, impact_times=record.impact_times + began)
    if began:
        turn = rig.force_frequencies[0] * began
        other = other.replace(
            force_phases=float(np.mod(other.force_phases[0] - turn, 2.0 * np.pi))
        )
    fit = fit_rig(record, other, also=('force_delay',))
    assert fit.accepted, fit.reasons
    assert fit.impacts['time'] == pytest.approx(
        fit.impacts['measured_time'], abs=0.01, nan_ok=True
    )
    assert abs(fit.flights[0].start - began) < 5.0
    assert max(map(abs, errors(fit, rig).values())) < 4.0
    delay = fit.parameters['force_delay']
    turned = rig.force_frequencies[0] * delay.value - phase
    assert abs(np.angle(np.exp(1j * turned))) < 0.02


def test_a_shaken_base(bench):
    """It is recorded by an accelerometer, with 1 % of noise."""
    rig, start, _ = bench
    rng = np.random.default_rng(8)
    w, level = rig.force_frequencies[0], rig.force_amplitudes[0] / rig.primary_mass
    true = rig.replace(force_amplitudes=0.0, base_amplitudes=level, base_frequencies=w)
    record = _recorded(true, InitialConditions(), 1000, rng)
    base = level * np.sin(w * record.time) + rng.normal(0.0, 0.01 * level, 1000)
    record = record._replace(base=base, base_quantity='acceleration')
    fit = fit_rig(record, start.replace(force_amplitudes=0.0))
    assert fit.accepted, fit.reasons
    assert max(map(abs, errors(fit, true).values())) < 4.0


def test_a_release_without_a_force():
    """M is pulled back, and rings down with the damper in it."""
    rig = TWIN.replace(damping=0.6, force_amplitudes=0.0)
    state = InitialConditions(initial_primary_position=0.03)
    record = _recorded(rig, state, 900, np.random.default_rng(1))
    fit = fit_rig(record, rig.replace(stiffness=2100.0, damping=0.9, gap=1.0, friction=0.0))
    assert fit.accepted, fit.reasons
    assert max(map(abs, errors(fit, rig).values())) < 4.0


def _recorded(rig, state, count, rng):
    """Return displacements at 200 Hz with noise of 1 %, and impact times."""
    time = np.arange(count) / 200.0
    run = Rig(rig, state).run(time[-1], time)
    hits, x = run.impacts()['time'], run.samples['x']
    return MeasuredMotion(
        time,
        x + rng.normal(0.0, 0.01 * np.sqrt(2.0) * x.std(), count),
        'displacement',
        np.ones(count, bool),
        impact_times=hits + rng.normal(0.0, 5e-4, len(hits)),
        impact_deviation=5e-4,
    )
