"""Numbers over a whole stretch and run, against integrals along the exact motion."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from bag.recorded_rig import LIVELY, RecordedRig
from compare.recorded import DISPLACED, metered, recorded
from rigs import BENCH, FRICTION, OFF_RESONANCE, VERTICAL

from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.compare.measured_motion import (
    energy_balance,
    measured_motion,
    turning_points,
)
from impact_damper_ros.compare.recorded_stretch import ForceClock, RecordedImpacts, knots_of
from impact_damper_ros.compare.result import Overall
from impact_damper_ros.control import Rig
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters
from impact_damper_ros.rig.swing import Swing

NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)
AT_REST = InitialConditions()
BROAD = BENCH.replace(
    multisine_level=1.0, multisine_low=18.85, multisine_high=43.98, multisine_lines=16
)
CASES = {
    'off resonance': (OFF_RESONANCE, DISPLACED),
    'inclined': (FRICTION, DISPLACED),
    'bench': (BENCH, AT_REST),
    'one-sided': (VERTICAL, AT_REST),
    'multisine': (BROAD, AT_REST),
}


def exact(clock, initial, times):
    """
    Return integrals of X^2, C X'^2, F X' and |F X'| along the exact motion, between `times`.

    Between two events, and two of the times, the motion is smooth, and five Gauss points in each
    piece leave nothing but round-off.
    """
    rig = clock.parameters
    events = [e.time for e in Rig(rig, initial).advance(float(times[-1]))]
    breaks = np.unique(np.concatenate([times, events]))
    begin, width = breaks[:-1], np.diff(breaks)
    simulator, rows = Rig(rig, initial), []
    places = (begin[:, None] + 0.5 * (NODES + 1.0) * width[:, None]).ravel()
    for instant in places:
        simulator.advance(float(instant))
        sample = simulator.sample()
        rows.append((sample.x, sample.primary_velocity))
    x, v = np.array(rows).T
    power = clock.force(places) * v
    values = np.stack([x**2, rig.damping * v**2, power, np.abs(power)])
    pieces = (values.reshape(4, -1, 5) * (0.5 * WEIGHTS)).sum(axis=2) * width
    index = np.searchsorted(times, begin, side='right') - 1
    return np.stack([np.bincount(index, row, minlength=len(times) - 1) for row in pieces])


def largest_swing(rig, initial, times):
    """Return the largest |X|, with 10 samples for each one recorded."""
    simulator, swing = Rig(rig, initial), Swing()
    for begin, end in pairwise(times):
        for instant in np.linspace(begin, end, 10, endpoint=False):
            events = simulator.advance(float(instant))
            swing.look(simulator.sample(), events)
    return swing.largest


def total_energy(rig, sample):
    """Return kinetic and potential energy of both masses on a level rig, J."""
    moving = rig.primary_mass * sample.primary_velocity**2
    moving += rig.damper_mass * sample.damper_velocity**2
    return 0.5 * (moving + rig.stiffness * sample.x**2)


class HeardRig(RecordedRig):
    """A recorded rig that keeps its events."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.events = []

    def impacts(self, events):
        self.events += events
        super().impacts(events)


@pytest.mark.parametrize(('name', 'per_cycle'), [*((name, 40) for name in CASES), ('bench', 15)])
def test_against_the_exact_motion(name, per_cycle):
    rig, initial = CASES[name]
    states, impacts, clock = recorded(rig, 60, initial, per_cycle)
    overall = metered(states, impacts, clock).overall
    squares, dashpot, force, there_and_back = exact(clock, initial, states.time).sum(axis=1)
    span = states.time[-1]
    assert overall.duration == span
    assert overall.covered == pytest.approx(span, rel=1e-12)
    assert (
        1e-9 < overall.accuracy < (2e-5 if per_cycle == 40 else 5e-4) * (1 + 99 * ('mul' in name))
    )
    close = {'rel': overall.accuracy, 'abs': 0.0}
    assert overall.x_rms == pytest.approx(math.sqrt(squares / span), **close)
    assert overall.dashpot_energy == pytest.approx(dashpot, **close)
    assert overall.force_work == pytest.approx(force, abs=overall.accuracy * there_and_back)
    assert overall.x_max == pytest.approx(largest_swing(rig, initial, states.time), **close)
    events = Rig(rig, initial).advance(float(span))
    hits = [e for e in events if e.kind is EventKind.IMPACT]
    assert overall.impacts == len(hits) > 10
    assert overall.impacts_on_stop_1 == sum(e.stop == 1 for e in hits)
    assert overall.impacts_on_stop_2 == sum(e.stop == 2 for e in hits)
    taken = [e.primary_velocity_before**2 - e.primary_velocity_after**2 for e in hits]
    assert overall.impact_energy == pytest.approx(
        0.5 * rig.primary_mass * math.fsum(taken), rel=1e-11
    )


def test_however_it_is_read():
    run = recorded(BENCH, 40, AT_REST)
    whole, parts = (metered(*run, part=part).overall for part in (10**6, 7))
    for name, value in vars(whole).items():
        assert getattr(parts, name) == pytest.approx(value, rel=1e-12), name


def test_the_closed_form_without_impacts():
    """X = A sin(W t) at resonance, from the start: all is known without any integration."""
    rig = OFF_RESONANCE.replace(force_frequencies=(1.0,), gap=1e6)
    amplitude = rig.response_amplitude
    initial = InitialConditions(initial_primary_position=-amplitude)
    states, impacts, clock = recorded(rig, 30, initial)
    overall = metered(states, impacts, clock).overall
    span = 30.0 * math.tau
    assert overall.x_max == pytest.approx(amplitude, rel=1e-9)
    assert overall.x_rms == pytest.approx(amplitude / math.sqrt(2.0), rel=overall.accuracy)
    # The force does the work that the dashpot takes, C (W A)^2/2 in each second.
    power = 0.5 * rig.damping * amplitude**2
    assert overall.dashpot_energy == pytest.approx(power * span, rel=overall.accuracy)
    assert overall.force_work == pytest.approx(power * span, rel=overall.accuracy)
    assert (overall.impacts, overall.impact_energy) == (0, 0.0)


def test_where_samples_are_missing():
    """What is missing is left out, and is not guessed; the impacts there are counted."""
    states, impacts, clock = recorded(BENCH, 60, AT_REST)
    kept = np.full(len(states), True)
    kept[700:760] = kept[1500] = kept[-5:-2] = False
    stretch = metered(states[kept], impacts, clock, part=500)
    assert (stretch.missing_states, len(stretch.gaps)) == (64, 3)
    used = kept[1:] & kept[:-1]
    squares, dashpot, force, there_and_back = exact(clock, AT_REST, states.time)[:, used].sum(
        axis=1
    )
    covered = np.diff(states.time)[used].sum()
    overall = stretch.overall
    assert overall.covered == pytest.approx(covered, rel=1e-12)
    assert overall.duration == states.time[-1]
    assert overall.x_rms == pytest.approx(math.sqrt(squares / covered), rel=overall.accuracy)
    assert overall.dashpot_energy == pytest.approx(dashpot, rel=overall.accuracy)
    assert overall.force_work == pytest.approx(force, abs=overall.accuracy * there_and_back)
    assert overall.accuracy < 1e-5
    assert overall.impacts == len(impacts)
    # So is the rms of the part that is measured, over a time that is no whole number of cycles.
    last = float(states.time[-1])
    start = float(states.time[285])
    late = used & (states.time[:-1] >= start)
    squares = exact(clock, AT_REST, states.time)[0, late].sum()
    rms = math.sqrt(squares / np.diff(states.time)[late].sum())
    assert measured_motion(stretch, start, last).x_rms == pytest.approx(rms, rel=1e-5)


def test_over_several_stretches():
    """Two halves and the whole, whose rms goes by the time of each."""
    states, impacts, clock = recorded(FRICTION, 60)
    cut = 700
    whole = metered(states, impacts, clock).overall
    early = impacts.time <= states.time[cut]
    one = metered(states[: cut + 1], impacts[early], clock).overall
    late = metered(states[cut:], impacts[~early], clock)
    other = replace(late.overall, duration=late.end - states.time[cut])
    both = Overall.joined([one, other])
    for name, value in vars(whole).items():
        assert getattr(both, name) == pytest.approx(value, rel=1e-12), name
    # A stretch of which nothing is known takes no part in what is.
    none = metered(states[:0], RecordedImpacts.none(), clock).overall
    assert math.isnan(none.x_max)
    assert math.isnan(none.x_rms)
    assert vars(Overall.joined([none, whole])) == pytest.approx(vars(whole))


def test_what_cannot_be_known():
    states, impacts, clock = recorded(BENCH, 20, AT_REST)
    # Without joint states there are impacts, and nothing between them.
    alone = metered(states[:0], impacts, clock).overall
    meter = metered(states[:1], impacts, clock).overall
    assert alone.covered == meter.covered == 0.0
    assert math.isnan(meter.x_rms)
    # A number that is no displacement of anything makes no warning.
    x = states.x.copy()
    x[100] = 1e300
    wild = metered(replace(states, x=x), impacts, clock).overall
    assert wild.x_max >= 1e300
    assert not math.isfinite(wild.x_rms)


def test_a_bag_with_changes(tmp_path, capsys):
    """Per stretch and over all, in JSON and text; the energy adds up in each stretch."""
    level = LIVELY.replace(gravity=0.0)
    rig = HeardRig(level, offset=0).start()
    pairs = [[rig.rig.sample()]]
    rig.run(900)
    for change in ({'gap': 0.02}, {'damping': 1.5}, {'force_amplitudes': (4.0,)}):
        pairs[-1].append(rig.rig.sample())
        rig.run(1, ('change', change))
        pairs.append([rig.rig.sample()])
        rig.run(699)
    pairs[-1].append(rig.rig.sample())
    bag = rig.save(tmp_path / 'bag')
    path = tmp_path / 'result.json'
    assert compare_run([str(bag), '--json', str(path)]) == 0
    result = json.loads(path.read_text(encoding='utf-8'))
    parts = [stretch['overall'] for stretch in result['stretches']]
    whole = result['overall']
    assert len(parts) == 4
    assert whole['duration'] == pytest.approx(15.0)
    assert whole['covered'] == pytest.approx(15.0 - 3 * 0.005)
    assert whole['impacts'] == result['impacts'] == sum(part['impacts'] for part in parts)
    assert whole['x_max'] == max(part['x_max'] for part in parts)
    squares = sum(part['x_rms'] ** 2 * part['covered'] for part in parts)
    assert whole['x_rms'] == pytest.approx(math.sqrt(squares / whole['covered']), rel=1e-12)
    for name in ('impact_energy', 'dashpot_energy', 'force_work'):
        assert whole[name] == pytest.approx(sum(part[name] for part in parts), rel=1e-12)
    # Against the simulator's own velocities, and all energy put in and taken out
    for part, since, states in zip(parts, (0.0, 4.505, 8.005, 11.505), pairs, strict=True):
        until = since + part['duration']
        hits = [e for e in rig.events if since < e.time < until and e.kind is EventKind.IMPACT]
        assert part['impacts'] == len(hits) > 70
        taken = [e.primary_velocity_before**2 - e.primary_velocity_after**2 for e in hits]
        mass = level.primary_mass
        assert part['impact_energy'] == pytest.approx(0.5 * mass * math.fsum(taken), rel=1e-9)
        # The integrals go from joint state to joint state; what came after the last is not theirs.
        lost = 0.0
        for e in hits:
            if e.time <= states[1].time:
                lost += mass * (e.primary_velocity_before**2 - e.primary_velocity_after**2)
                speeds = e.damper_velocity_before**2 - e.damper_velocity_after**2
                lost += level.damper_mass * speeds
        begin, end = (total_energy(level, state) for state in states)
        put = part['force_work'] - part['dashpot_energy'] - 0.5 * lost
        scale = part['force_work'] + 2.0 * part['dashpot_energy']
        assert put == pytest.approx(end - begin, abs=part['accuracy'] * scale)
    printed = capsys.readouterr().out
    assert printed.count('\n  overall    largest |X| ') == 5
    last = printed[printed.index('\nin all ') :]
    assert f'largest |X| {whole["x_max"]:.7g} m, rms X {whole["x_rms"]:.6g} m in 15 s' in last
    lost = f'({whole["impact_loss"]:.6g} J of it lost)'
    assert f'taken from M by impacts {whole["impact_energy"]:.6g} J {lost}' in last


def test_turning_points_of_a_cubic():
    # s^3 - s: its rate 3 s^2 - 1 changes sign at s = 1 / sqrt 3, after a step of 2.
    intervals, out = turning_points(
        np.array([2.0, 1.0]), np.array([0.0, 1.0]), np.array([-0.5, 1.0]), np.array([1.0, 1.0])
    )
    assert intervals.tolist() == [0]
    assert out == pytest.approx([-2.0 / (3.0 * math.sqrt(3.0))])


def test_energy_of_a_resonant_oscillator():
    """Without impacts: F sin t on X = -A cos t gives pi F A in a cycle, all to the dashpot."""
    rig = RigParameters(damping=0.1, gap=1e6, gravity=0.0, damper_mass=1e-9)
    step = math.tau / 100
    time = np.arange(0, 501) * step
    x, velocity = -10.0 * np.cos(time), 10.0 * np.sin(time)
    zero = np.zeros_like(time)
    states, impacts, _ = recorded(rig, 1, None)
    states = type(states)(time, x, velocity, zero, zero, x + 5e5, x - 5e5, velocity, velocity)
    clock = ForceClock(rig, 0.0, (0.0,))
    balance = energy_balance(clock, knots_of(rig, states, impacts[:0], 0), 5)
    assert balance.force == pytest.approx(5 * math.pi * 10.0, rel=1e-6)
    assert balance.dashpot == pytest.approx(5 * math.pi * 10.0, rel=1e-6)
    assert abs(balance.residual) < balance.tolerance < 1e-4
    assert (balance.air, balance.friction, balance.impacts) == (0.0, 0.0, 0.0)


def test_energy_of_a_run_with_everything():
    rig = FRICTION.replace(air_force=0.02, damping=0.05)
    states, impacts, clock = recorded(rig, 60, per_cycle=80)
    balance = energy_balance(clock, knots_of(rig, states, impacts, 0), 60)
    parts = (balance.force, balance.air, balance.dashpot, balance.friction, balance.impacts)
    assert min(parts) > 0.1
    assert abs(balance.residual) < balance.tolerance < 1e-4 * balance.force
    # Wrong numbers do not balance.
    other = ForceClock(rig.replace(stiffness=1.01), 0.0, (0.0,))
    wrong = energy_balance(other, knots_of(rig, states, impacts, 0), 60)
    assert abs(wrong.residual) > 10.0 * wrong.tolerance
