"""Logs with known faults: each is found, with the quantity and by how much."""

import math
from dataclasses import replace

import numpy as np
import pytest
from compare.recorded import metered, recorded
from rigs import BENCH, FRICTION, HORIZONTAL, OFF_RESONANCE

from impact_damper_ros.compare.log_findings import with_fitted_clock
from impact_damper_ros.compare.result import Verdict
from impact_damper_ros.compare.verdict import compare_stretch


@pytest.fixture(scope='module')
def bench():
    """Return a run of the bench rig that settles, as it was recorded."""
    return recorded(BENCH, 120, None)


@pytest.fixture(scope='module')
def chaotic():
    """Return one that never settles."""
    return recorded(OFF_RESONANCE.replace(gap=20.0), 120)


def judged(states, impacts, clock, **options):
    return compare_stretch(*metered(states, impacts, clock, **options))


def test_a_sound_log(bench, chaotic):
    found = judged(*bench)
    assert (found.verdict, found.findings) == (Verdict.AGREES, ())
    found = judged(*chaotic)
    assert found.verdict is not Verdict.DIFFERS
    assert found.findings == ()


@pytest.mark.parametrize('late', [1e-3, -4e-3, 2e-8])
@pytest.mark.parametrize('part', [3000, 251])
def test_a_shifted_impact(bench, late, part):
    states, impacts, clock = bench
    time = impacts.time.copy()
    time[101] += late
    found = judged(states, replace(impacts, time=time), clock, part=part)
    assert found.verdict is Verdict.DIFFERS
    (finding,) = found.findings
    assert finding.quantity == 'instant at impact'
    assert finding.difference == pytest.approx(late, abs=1.1e-9)
    assert finding.time == pytest.approx(impacts.time[101], abs=1e-9)
    assert ('early' if late < 0.0 else 'late') in finding.text
    # The rest of the run is as predicted.
    assert found.decay.distance < 1e-5


def test_a_shifted_impact_of_a_chaotic_run(chaotic):
    states, impacts, clock = chaotic
    time = impacts.time.copy()
    time[200] += 1e-3
    found = judged(states, replace(impacts, time=time), clock)
    (finding,) = found.findings
    assert finding.difference == pytest.approx(1e-3, abs=1.1e-9)
    assert found.sentence == finding.text


def test_a_missing_and_a_surplus_impact(bench):
    states, impacts, clock = bench
    kept = np.arange(len(impacts)) != 150
    found = judged(states, impacts[kept], clock)
    (finding,) = found.findings
    assert finding.quantity == 'missing impact'
    assert finding.time == pytest.approx(impacts.time[150], abs=1e-9)
    assert found.decay.distance < 1e-5
    # A recorder may have lost it.
    assert judged(states, impacts[kept], clock, lossy=True).verdict is Verdict.AGREES
    near = (states.time < impacts.time[150] - 0.02) | (states.time > impacts.time[150] + 0.02)
    excused = judged(states[near], impacts[kept], clock)
    assert (excused.verdict, excused.missing_samples) == (Verdict.AGREES, 8)
    twice = np.insert(np.arange(len(impacts)), 150, 140)
    surplus = impacts[twice]
    surplus.time[150] = impacts.time[150] - 0.03
    found = judged(states, surplus, clock)
    assert {f.quantity for f in found.findings} == {'surplus impact'}


def test_a_scaled_velocity(bench):
    states, impacts, clock = bench
    velocity = impacts.velocity_after.copy()
    velocity[151] *= 1.01
    found = judged(states, replace(impacts, velocity_after=velocity), clock)
    (finding,) = found.findings
    assert finding.quantity == "X' after at impact"
    assert finding.difference == pytest.approx(0.01 * impacts.velocity_after[151], rel=1e-5)
    every = replace(impacts, velocity_after=1.01 * impacts.velocity_after)
    found = judged(states, every, clock)
    assert found.verdict is Verdict.DIFFERS
    quantities = {f.quantity for f in found.findings}
    # By itself the log contradicts the coefficients of restitution.
    assert {'restitution_1', 'restitution_2'} <= quantities
    one = replace(impacts, primary_impulse=impacts.primary_impulse * (1.0 + 1e-6))
    (finding,) = [f for f in judged(states, one, clock).findings if f.quantity == 'impulse']
    assert abs(finding.difference) == pytest.approx(
        1e-6 * np.abs(impacts.primary_impulse).max(), rel=1e-3
    )


def test_joint_states_that_are_no_motion(bench):
    states, impacts, clock = bench
    found = judged(replace(states, velocity=1.001 * states.velocity), impacts, clock)
    assert found.verdict is Verdict.DIFFERS
    assert 'does not follow' in found.findings[0].text
    x = states.x.copy()
    x[2000] += 1e-6
    found = judged(replace(states, x=x), impacts, clock)
    (finding,) = found.findings
    assert (finding.quantity, finding.time) == ('X', states.time[2000])
    assert finding.difference == pytest.approx(1e-6, rel=1e-3)


@pytest.mark.parametrize(
    ('rig', 'name', 'logged', 'unit'),
    [
        (BENCH, 'primary_mass', 2.04, 'kg'),
        (BENCH, 'damper_mass', 0.102, 'kg'),
        (BENCH, 'stiffness', 1975.0, 'N/m'),
        (BENCH, 'damping', 1.3, 'N s/m'),
        (BENCH, 'gap', 0.0242, 'm'),
        (BENCH, 'restitution_2', 0.601, ''),
        (BENCH, 'friction', 0.021, ''),
        (BENCH, 'force_amplitudes', (1.21,), 'N'),
        (BENCH, 'force_frequencies', (31.42,), 'rad/s'),
        (BENCH, 'force_phases', (0.01,), 'rad'),
        (FRICTION, 'angle', 0.79, 'rad'),
        (FRICTION, 'gravity', 1.001, 'm/s^2'),
    ],
)
def test_a_wrong_parameter(rig, name, logged, unit):
    """What is logged is not what the rig had: the true value is found."""
    true = getattr(rig, name)
    states, impacts, clock = recorded(rig, 40, None)
    wrong = replace(clock, parameters=rig.replace(**{name: logged}))
    found = judged(states, impacts, wrong)
    assert found.verdict is Verdict.DIFFERS
    finding = next(f for f in found.findings if f.quantity == name)
    there, here = (v[0] if isinstance(v, tuple) else v for v in (true, logged))
    assert (finding.unit, finding.expected) == (unit, here)
    assert finding.measured == pytest.approx(there, rel=1e-7, abs=1e-7)
    assert f'logged is {here:.9g}'.split('=')[0].split()[0] in finding.text
    assert found.findings[0].quantity == name
    if name == 'friction':
        assert 'or another gravity instead' in finding.text


def test_a_gap_that_changed_unlogged(bench):
    """Half-way the stops were moved, and it is not logged."""
    states, impacts, clock = bench
    first = recorded(BENCH, 60, None)
    half = states.time <= first[0].time[-1]
    wider = recorded(BENCH.replace(gap=0.026), 120, None)
    late = wider[0].time > first[0].time[-1]
    hits = wider[1].time > first[0].time[-1]
    mixed = type(states).joined([states[half], wider[0][late]])
    hit = type(impacts).joined([first[1], wider[1][hits]])
    found = judged(mixed, hit, clock)
    finding = next(f for f in found.findings if f.quantity == 'gap')
    assert finding.measured == pytest.approx(0.026, rel=1e-9)
    assert finding.expected == 0.024
    assert finding.time == pytest.approx(60 * math.tau / 31.416, abs=0.15)


def test_the_phase_of_the_force_is_found(bench):
    states, impacts, clock = bench
    later = states[1000:]
    meter, _ = metered(states, impacts, clock)
    unknown = replace(meter, clock=None, states=later, start=float(later.time[0]))
    fitted, search = with_fitted_clock(unknown)
    here = np.array([10.0])
    turned = fitted.clock.angles_at(here) - clock.angles_at(here)
    assert math.remainder(float(turned[0, 0]), math.tau) == pytest.approx(0.0, abs=1e-9)
    assert search.unsound == 0
    assert compare_stretch(fitted, search).verdict is Verdict.AGREES
    # Nothing is made up where the force is not what is logged.
    other = replace(unknown, parameters=BENCH.replace(stiffness=2100.0))
    assert with_fitted_clock(other)[0].clock is None
    found = compare_stretch(*with_fitted_clock(other))
    assert found.verdict is Verdict.NO_PREDICTION
    assert 'phase of the force is not in the bag' in found.sentence


def test_no_false_alarm_where_the_rig_is_sensitive():
    """Sticking, rest, chatter and air: every interval is checked, none is wrong."""
    for rig in (
        FRICTION.replace(friction=3.0, gap=3.0),
        FRICTION.replace(air_force=0.02),
        HORIZONTAL.replace(restitution_1=0.0, restitution_2=0.3),
        BENCH.replace(angle=0.2),
    ):
        stretch, search = metered(*recorded(rig, 60, None), part=500)
        assert search.faults == []
        assert search.plain + search.followed >= search.intervals
        assert search.intervals == stretch.state_count + stretch.impact_count - 1
