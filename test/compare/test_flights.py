"""The motion between events in closed form, and what adds up over it, against the simulator."""

import json
import math
import random
from dataclasses import replace

import numpy as np
import pytest
from bag.recorded_rig import RecordedRig
from compare.recorded import DISPLACED, built, replayed, simulated
from rigs import BENCH, FRICTION, LIVELY, OFF_RESONANCE, VERTICAL

from impact_damper_ros import GapControlParameters, InitialConditions, Order, Rig, run_flights
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.compare.measures import energy_balance, measured_motion
from impact_damper_ros.compare.result import Overall
from impact_damper_ros.compare.stretches import LoggedRig

AT_REST = InitialConditions()
BROAD = BENCH.replace(
    multisine_level=1.0, multisine_low=18.85, multisine_high=43.98, multisine_lines=16
)
SWEPT = BENCH.replace(
    sweep_mode='up_down', sweep_low=28.0, sweep_high=34.0, sweep_step=1.0, sweep_dwell=0.77
)
SHAKEN = SWEPT.replace(
    force_amplitudes=0.0, base_amplitudes=0.6, base_frequencies=31.4, base_phases=0.4
)
BASE = BENCH.replace(
    force_amplitudes=0.0,
    base_amplitudes=(0.002, 0.0005),
    base_frequencies=(31.0, 70.0),
    base_phases=(0.3, 1.0),
    base_quantity='displacement',
)
CHATTER = VERTICAL.replace(damping=0.5, force_amplitudes=(1.2,), restitution_1=0.6)
CASES = {
    'off resonance': (OFF_RESONANCE, DISPLACED),
    'inclined': (FRICTION.replace(air_force=0.02, damping=0.05), DISPLACED),
    'bench': (BENCH, AT_REST),
    'sticking': (FRICTION.replace(friction=4.0), DISPLACED),
    'plastic': (BENCH.replace(restitution_1=0.0, restitution_2=0.0), AT_REST),
    'chatter': (CHATTER, AT_REST),
    'multisine': (BROAD, AT_REST),
    'stepped sine': (SWEPT, AT_REST),
    'stepped sine of the base': (SHAKEN, AT_REST),
    'base': (BASE, AT_REST),
    'base and force': (BASE.replace(force_amplitudes=0.5, force_frequencies=25.0), AT_REST),
}


def between(parameters, initial, cycles, count=400):
    """Return samples of a run at random instants."""
    rig, end = Rig(parameters, initial), cycles * math.tau / parameters.force_frequencies[0]
    return rig.run(end, np.sort(np.random.default_rng(3).uniform(0.0, end, count))).samples


@pytest.mark.parametrize('name', CASES)
def test_the_closed_form_is_the_motion_of_the_rig(name):
    rig, initial = CASES[name]
    flights = replayed(rig, 40, initial, 4, part=23).flights
    expected = between(rig, initial, 40)
    index = np.searchsorted(flights.starts, expected['time'], side='right') - 1
    tau = expected['time'] - flights.starts[index]
    x, velocity, _, _ = flights.motion(index, tau)
    y, relative = flights.damper(index, tau, x, velocity)
    size, speed = (np.abs(expected[n]).max() for n in ('x', 'primary_velocity'))
    assert x == pytest.approx(expected['x'], abs=1e-11 * size)
    assert velocity == pytest.approx(expected['primary_velocity'], abs=1e-11 * speed)
    assert y == pytest.approx(expected['z'] - expected['x'], abs=1e-10 * size)
    damper = expected['damper_velocity']
    assert velocity + relative == pytest.approx(damper, abs=1e-11 * np.abs(damper).max())
    base, base_velocity, _ = flights.base(index, tau)
    assert base == pytest.approx(expected['base'], abs=1e-11 * size)
    assert base_velocity == pytest.approx(expected['base_velocity'], abs=1e-11 * speed)
    # All energy put in and taken out, to round-off
    found, largest = flights.integrals()
    assert found.covered == pytest.approx(expected['time'].max(), rel=0.02)
    left = found.force + found.air - found.dashpot - found.friction - found.both
    assert left == pytest.approx(flights.stored_energy(), abs=1e-11 * found.dashpot)
    # Cut in the middle of flights, and sampled finely
    start, end = 0.311 * flights.rows['time'][-1], 0.731 * flights.rows['time'][-1]
    part = flights.cut(start, end)
    _, x, *_ = part.curve(2000.0 / (end - start))
    swing = part.integrals()[1]
    assert np.abs(x).max() <= swing * (1.0 + 1e-12)
    assert np.abs(x).max() == pytest.approx(swing, rel=1e-3)
    whole = sum(flights.cut(*ends).integrals()[0].squares for ends in ((0, start), (end, 1e9)))
    assert whole + part.integrals()[0].squares == pytest.approx(found.squares, rel=1e-11)
    assert largest == max(f.integrals()[1] for f in (flights, part))


def test_the_stops_may_move():
    control = GapControlParameters(
        gap_control='timed', gap_min=0.002, gap_max=0.05, actuator_speed=2.0
    )
    rig = Rig(BENCH, control=control)
    state, instants = rig.snapshot(), np.arange(1, 2001) / 200.0
    result = rig.run(10.0, instants)
    stretch = built(LoggedRig(BENCH, state=state), result.samples, result.events, rig.snapshot())
    flights, samples = stretch.flights, result.samples
    index = np.searchsorted(flights.starts, samples['time'], side='right') - 1
    index = np.minimum(index, len(flights) - 1)
    tau = samples['time'] - flights.starts[index]
    x, velocity, _, _ = flights.motion(index, tau)
    assert x == pytest.approx(samples['x'], abs=1e-13)
    y, _ = flights.damper(index, tau, x, velocity)
    assert y == pytest.approx(samples['z'] - samples['x'], abs=1e-12)


def test_the_closed_form_without_impacts():
    """X = A sin(W t) at resonance, from the start: all is known without any integration."""
    rig = OFF_RESONANCE.replace(force_frequencies=(1.0,), gap=1e6)
    amplitude = rig.response_amplitude
    stretch = replayed(rig, 30, InitialConditions(initial_primary_position=-amplitude))
    overall, balance = stretch.overall, energy_balance(stretch, 0.0, stretch.end, 30)
    span = 30.0 * math.tau
    assert overall.x_max == pytest.approx(amplitude, rel=1e-12)
    assert overall.x_rms == pytest.approx(amplitude / math.sqrt(2.0), rel=1e-9)
    # The force does the work that the dashpot takes, C (W A)^2/2 in each second.
    power = 0.5 * rig.damping * amplitude**2
    assert overall.dashpot_energy == pytest.approx(power * span, rel=1e-9)
    assert overall.force_work == pytest.approx(power * span, rel=1e-9)
    assert (balance.force, balance.dashpot) == pytest.approx((power * span,) * 2, rel=1e-9)
    assert (balance.air, balance.friction, balance.impacts) == (0.0, 0.0, 0.0)
    assert (overall.impacts, overall.impact_energy) == (0, 0.0)
    assert measured_motion(stretch, 0.0, span).x_rms == pytest.approx(overall.x_rms, rel=1e-9)


def test_the_closed_form_on_a_moving_base():
    """The dashpot takes C (W |X - b|)^2/2 in each second, and the base gives that."""
    base = {'base_amplitudes': 0.01, 'base_frequencies': 1.3, 'base_quantity': 'displacement'}
    rig = OFF_RESONANCE.replace(force_amplitudes=0.0, damping=0.2, gap=1e6, **base)
    flights = replayed(rig, 200, AT_REST).flights
    cycle = math.tau / 1.3
    found = flights.cut(900.0, 900.0 + 10.0 * cycle).integrals()[0]
    pull = complex(rig.stiffness, 0.2 * 1.3)
    ratio = pull / (pull - rig.primary_mass * 1.3**2)
    power = 0.5 * 0.2 * (1.3 * 0.01 * abs(ratio - 1.0)) ** 2
    assert found.dashpot == pytest.approx(power * 10.0 * cycle, rel=1e-9)
    assert found.force == pytest.approx(power * 10.0 * cycle, rel=1e-9)
    expected = abs(ratio), abs(ratio - 1.0), abs(ratio)
    assert found.transmissibility == pytest.approx(expected, rel=1e-9)


def test_the_dashpot_on_a_swept_base():
    """The amplitude of the base follows from the frequency of each step."""
    flights = replayed(SHAKEN, 40, AT_REST).flights
    nodes, weights = np.polynomial.legendre.leggauss(200)
    index, half = np.repeat(np.arange(len(flights)), 200), 0.5 * flights.spans
    tau = np.outer(half, nodes + 1.0).ravel()
    slip = flights.motion(index, tau)[1] - flights.base(index, tau)[1]
    expected = SHAKEN.damping * (np.outer(half, weights).ravel() @ slip**2)
    assert flights.integrals()[0].dashpot == pytest.approx(expected, rel=1e-11)


def test_where_samples_are_missing():
    """A replay needs none; those missing are counted."""
    start, samples, events, end = simulated(BENCH, 60, AT_REST)
    kept = np.full(len(samples), True)
    kept[700:760] = kept[1500] = kept[-5:-2] = False
    period = float(samples['time'][1])
    exact = built(LoggedRig(BENCH, state=start), samples, events, end)
    rig = LoggedRig(BENCH, state=start)
    fewer = built(rig, samples[kept], events, end, part=500, period=period)
    assert fewer.counts[:2] == (len(samples) - 64, 64)
    assert vars(fewer.overall) == pytest.approx(vars(exact.overall), rel=1e-12)


def test_over_several_stretches():
    """Two halves and the whole, whose rms goes by the time of each."""
    start, samples, events, end = simulated(FRICTION, 60)
    rig, middle = Rig.restore(start), float(samples['time'][700])
    rig.advance(middle)
    early = events['time'] <= middle
    one = built(LoggedRig(FRICTION, state=start), samples[:701], events[early], rig.snapshot())
    late = LoggedRig(FRICTION, state=rig.snapshot())
    other = built(late, samples[701:], events[~early], end).overall
    # The second half begins at the first of its samples that is not the last of the first.
    duration = float(samples['time'][-1]) - middle
    both = Overall.join([one.overall, replace(other, duration=duration)])
    whole = built(LoggedRig(FRICTION, state=start), samples, events, end).overall
    assert vars(both) == pytest.approx(vars(whole), rel=1e-12)
    # A stretch of which nothing is known takes no part in what is.
    nothing = dict.fromkeys(vars(whole), 0) | {'x_max': math.nan, 'x_rms': math.nan}
    none = Overall(**nothing)
    assert vars(Overall.join([none, whole])) == pytest.approx(vars(whole))
    assert math.isnan(Overall.join([none]).x_rms)


def test_memory_of_long_stretches_is_bounded(monkeypatch):
    """All is counted and added up; of flights and samples the last ones are kept."""
    whole = replayed(FRICTION, 200)
    module = 'impact_damper_ros.compare.stretches'
    monkeypatch.setattr(f'{module}._MOST_SAMPLES', 1000)
    monkeypatch.setattr(f'{module}._MOST_ROWS', 100)
    few = replayed(FRICTION, 200, part=7)
    assert few.counts == whole.counts
    assert vars(few.overall) == pytest.approx(vars(whole.overall), rel=1e-12)
    assert 1000 <= len(few.samples) < 1007
    assert 100 <= len(few.flights) < 110
    assert few.flights.rows['time'][-1] == whole.flights.rows['time'][-1]
    assert few.envelope.shape[1] <= 2000
    assert few.envelope[2].max() == whole.samples['x'].max()
    assert few.envelope[1].min() == whole.samples['x'].min()


def test_the_energy_of_periods():
    stretch = replayed(FRICTION.replace(air_force=0.02, damping=0.05), 60)
    balance = energy_balance(stretch, 100.0, stretch.end, 40)
    parts = (balance.force, balance.air, balance.dashpot, balance.friction, balance.impacts)
    assert min(parts) > 0.1
    assert abs(balance.residual) < balance.tolerance < 1e-8 * balance.force
    measured = measured_motion(stretch, 100.0, stretch.end)
    assert (measured.start, measured.end) == (100.0, stretch.end)
    cycles = (stretch.end - 100.0) * stretch.parameters.force_frequencies[0] / math.tau
    assert measured.impacts_per_cycle == pytest.approx(measured.impacts / cycles)


@pytest.mark.parametrize('friction', [0.0, 0.2])
def test_a_force_that_a_controller_commands(tmp_path, friction):
    """It pushes in flight, at rest and while m sticks; its work is in the balance."""
    rng = random.Random(5)
    external = GapControlParameters(gap_control='external', gap_min=0.001, gap_max=0.1)
    parameters = LIVELY.replace(friction=friction)
    orders = [Order(force=rng.choice([math.nan, rng.gauss(0.0, 3.0)])) for _ in range(600)]
    rig = RecordedRig(parameters, control=external, offset=0).start()
    rig.run(600, order=iter(orders).__next__)
    path = tmp_path / 'result.json'
    bag = rig.save(tmp_path / 'bag')
    assert compare_run([str(bag), '--json', str(path)]) == 0
    (stretch,) = json.loads(path.read_text(encoding='utf-8'))['stretches']
    balance, overall = stretch['energy'], stretch['overall']
    assert abs(balance['residual']) < balance['tolerance'] < 1e-7 * abs(balance['force'])
    # Against the same run, sampled densely
    twin, x = Rig(parameters, control=external), []
    for count, order in enumerate(orders, 1):
        instants = np.linspace(twin.time, count / 200.0, 51)[1:]
        x += twin.run(count / 200.0, instants).samples['x'].tolist()
        twin.order(order)
    assert overall['x_max'] == pytest.approx(np.abs(x).max(), rel=1e-6)
    assert overall['x_rms'] == pytest.approx(math.sqrt(np.mean(np.square(x))), rel=1e-3)


@pytest.mark.parametrize('speed', [0.05, 0.2])
def test_energies_under_moving_stops(tmp_path, speed):
    """A stop that follows m, or brings it to rest, is no chatter; m may fly on from it."""
    timed = GapControlParameters(gap_control='timed', actuator_speed=speed)
    parameters = BENCH.replace(angle=0.2, gravity=9.81)
    path = tmp_path / 'result.json'
    bag = RecordedRig(parameters, control=timed, offset=0).start().run(3000).save(tmp_path / 'bag')
    assert compare_run([str(bag), '--json', str(path)]) == 0
    (stretch,) = json.loads(path.read_text(encoding='utf-8'))['stretches']
    balance, overall = stretch['energy'], stretch['overall']
    assert abs(balance['residual']) < 1e-13
    found, largest = run_flights(Rig(parameters, control=timed), 15.0).integrals()
    assert (overall['x_max'], overall['force_work']) == pytest.approx(
        (largest, found.force), rel=1e-9
    )


def test_a_wrong_velocity_unbalances_the_energy():
    stretch = replayed(BENCH, 40, AT_REST)
    rows = stretch.flights.rows.copy()
    rows['damper_velocity_after'][-20] *= 1.01
    wrong = replace(stretch, flights=replace(stretch.flights, rows=rows))
    balance = energy_balance(wrong, 0.0, stretch.end, 40)
    assert abs(balance.residual) > 100.0 * balance.tolerance
    balance = energy_balance(stretch, 0.0, stretch.end, 40)
    assert abs(balance.residual) < balance.tolerance


def test_a_bag_with_changes(tmp_path, capsys):
    """Per stretch and over all, in JSON and text; the energy adds up over the run."""
    level = LIVELY.replace(gravity=0.0)
    rig = RecordedRig(level, offset=0).start().run(900)
    for change in ({'gap': 0.02}, {'damping': 1.5}, {'force_amplitudes': (4.0,)}):
        rig.run(700, ('change', change))
    bag = rig.save(tmp_path / 'bag')
    path = tmp_path / 'result.json'
    assert compare_run([str(bag), '--json', str(path)]) == 0
    result = json.loads(path.read_text(encoding='utf-8'))
    parts = [stretch['overall'] for stretch in result['stretches']]
    whole = result['overall']
    assert len(parts) == 4
    assert whole['duration'] == pytest.approx(15.0)
    assert whole['impacts'] == result['impacts'] == sum(part['impacts'] for part in parts)
    for stretch in result['stretches']:
        assert abs(stretch['energy']['residual']) < stretch['energy']['tolerance']
    printed = capsys.readouterr().out
    rows = printed[printed.index('\nLargest |X|, impacts and energy') :].splitlines()[3:8]
    assert [row.split()[0] for row in rows] == ['1', '2', '3', '4', 'all']
    last = rows[-1].split()
    assert last[1:3] == ['15', f'{1e3 * whole["x_max"]:.5g}']
    assert last[4] == str(whole['impacts'])
    assert last[8:] == [
        f'{whole[name]:.5g}' for name in ('impact_energy', 'impact_loss', 'dashpot_energy')
    ]
