"""Sweeps of the base: the motion against an independent integration, and the response over it."""

import math

import numpy as np
import pytest
import scipy
from rigs import TABLE

from impact_damper_ros import Observer, Rig, run
from impact_damper_ros.orbits.swept_response import SweptRun
from impact_damper_ros.rig.stepped_sine import rig_at, stepped_sine

SWEPT = TABLE.replace(
    gap=0.016,
    base_frequencies=1.0,
    sweep_mode='up',
    sweep_low=7.6 * math.tau,
    sweep_high=12.4 * math.tau,
    sweep_step=2.4 * math.tau,
    sweep_dwell=2.0,
)
ACCELERATION = 0.2 * 9.80665


class Table:
    """The table by itself: b'' = a sin(phi), whose b rises through zero at phi = pi."""

    def __init__(self, hertz, dwell):
        self.pieces, begin, phase = [], 0.0, 0.0
        for f in hertz:
            w = f * math.tau
            self.pieces.append((begin, w, phase))
            turns = math.ceil(
                (phase + w * (dwell * len(self.pieces) - begin) - math.pi) / math.tau
            )
            end = begin + (math.pi + turns * math.tau - phase) / w
            phase, begin = math.pi, end
        self.ends = [piece[0] for piece in self.pieces[1:]]

    def at(self, time, piece):
        begin, w, phase = self.pieces[piece]
        angle = phase + w * (time - begin)
        return (
            -ACCELERATION / w**2 * math.sin(angle),
            -ACCELERATION / w * math.cos(angle),
        )


def integrated(rig, table, until):
    """Integrate M and m on the moving table; return X at every 0.5 ms, and the times."""
    mass, k, c, m = rig.primary_mass, rig.stiffness, rig.damping, rig.damper_mass
    restitution, half = rig.restitution_1, 0.5 * rig.gap
    state, now, found = np.zeros(4), 0.0, []
    for piece, end in enumerate([*table.ends, until]):
        while now < end:

            def slopes(t, y, piece=piece):
                b, rate = table.at(t, piece)
                return [y[1], (k * (b - y[0]) + c * (rate - y[1])) / mass, y[3], 0.0]

            def stop_1(_, y):
                return half - (y[2] - y[0])

            def stop_2(_, y):
                return half + (y[2] - y[0])

            for stop in (stop_1, stop_2):
                stop.terminal, stop.direction = True, -1
            times = np.arange(math.floor(now / 5e-4) + 1, math.floor(end / 5e-4) + 1) * 5e-4
            times = times[times < end]
            solved = scipy.integrate.solve_ivp(
                slopes,
                (now, end),
                state,
                'DOP853',
                rtol=1e-11,
                atol=1e-13,
                events=(stop_1, stop_2),
                dense_output=True,
                max_step=0.01,
            )
            now, state = float(solved.t[-1]), solved.y[:, -1].copy()
            reached = times[times <= now]
            if len(reached):
                found.append(np.column_stack([reached, solved.sol(reached)[0]]))
            if solved.status == 1:
                v, w = state[1], state[3]
                state[1] = v + m / (mass + m) * (1.0 + restitution) * (w - v)
                state[3] = w - mass / (mass + m) * (1.0 + restitution) * (w - v)
    return np.concatenate(found).T


def response_of(rig, until, compiled=False):
    moving = Rig(rig, compiled=compiled)
    swept = SweptRun(moving)
    run(moving, until, [swept])
    return swept.response()


def test_a_sweep_at_constant_acceleration_is_that_of_an_independent_integration():
    """At 7.6, 10 and 12.4 Hz, steps and impacts included."""
    hertz = [7.6, 10.0, 12.4]
    table = Table(hertz, 2.0)
    moving = Rig(SWEPT)
    assert [s.time for s in stepped_sine(SWEPT, moving.sweep)] == pytest.approx(
        table.ends, abs=1e-12
    )
    time, x = integrated(SWEPT, table, 6.0)
    simulated = moving.run(6.0, time)
    assert len(simulated.impacts()) > 20
    # Round-off of the integration grows from impact to impact
    assert np.abs(simulated.samples['x'] - x).max() < 1e-4 * np.abs(x).max()
    found = response_of(SWEPT, 6.0)
    assert found.frequency / math.tau == pytest.approx(hertz)
    assert found.level == pytest.approx(ACCELERATION)
    for k, (begin, end) in enumerate(zip([0.0, *table.ends], [*table.ends, 6.0], strict=True)):
        late = (time >= 0.5 * (begin + end)) & (time < end)
        assert found.x[k] == pytest.approx(np.abs(x[late]).max(), rel=0.01)


def test_without_impacts_the_sweep_settles_to_the_closed_form():
    """T = sqrt((1 + (2 zeta r)^2)/D), and r^2/sqrt(D) of X - b, at 7.6, 10 and 12.4 Hz."""
    found = response_of(SWEPT.replace(gap=1.0, sweep_dwell=20.0, sweep_mode='up_down'), 100.0)
    ratio = found.frequency / SWEPT.omega
    below = np.hypot((1.0 - ratio) * (1.0 + ratio), 0.04 * ratio)
    base = ACCELERATION / found.frequency**2
    taken, apart = np.hypot(1.0, 0.04 * ratio) / below * base, ratio**2 / below * base
    assert found.x_without == pytest.approx(taken, rel=1e-12)
    assert found.relative_without == pytest.approx(apart, rel=1e-12)
    assert found.acceleration_without == pytest.approx(taken * found.frequency**2, rel=1e-12)
    assert found.x == pytest.approx(taken, rel=1e-3)
    assert found.relative == pytest.approx(apart, rel=1e-3)
    assert found.acceleration == pytest.approx(found.acceleration_without, rel=1e-3)
    assert not found.impacts.any()
    assert found.upwards.tolist() == [True, True, True, False, False]


def test_the_response_of_a_force():
    rig = SWEPT.replace(force_amplitudes=3.0, base_amplitudes=0.0, gap=1.0, sweep_dwell=20.0)
    found = response_of(rig, 60.0)
    assert found.level == pytest.approx(3.0)
    expected = [rig_at(rig, k).response_amplitude for k in range(3)]
    assert found.x_without == pytest.approx(expected)
    assert found.x == pytest.approx(expected, rel=1e-3)
    assert found.relative == pytest.approx(found.x)


def test_up_and_down_have_other_motions_where_two_exist():
    """The jumps of the response: with impacts on the way down, where there are none on that up."""
    rig = SWEPT.replace(
        sweep_mode='up_down', sweep_low=8.0 * math.tau, sweep_high=10.5 * math.tau
    ).replace(sweep_step=0.25 * math.tau, sweep_dwell=4.0)
    found = response_of(rig, 88.0, compiled=None)
    up = {round(f, 6): k for k, f in enumerate(found.frequency) if found.upwards[k]}
    down = {round(f, 6): k for k, f in enumerate(found.frequency) if not found.upwards[k]}
    assert len(found.time) == 21
    slow = [(up[f], down[f]) for f in down if f < 9.1 * math.tau]
    assert len(slow) == 5
    for one, other in slow:
        assert found.impacts[one] < 0.1
        assert found.impacts[other] > 1.5
        assert found.x[other] > 1.15 * found.x[one]


class Watch(Observer):
    def __init__(self, rig):
        self.rig, self.rows = rig, []

    def ticks(self):
        return (k * 2e-3 for k in range(10**6))

    def look_at(self, instant):
        b = self.rig.sample()
        self.rows.append((instant, b.base, b.base_velocity, self.rig.force_frequency))


@pytest.mark.parametrize('way', ['up', 'down'])
def test_a_logarithmic_sweep_in_octaves_a_minute_through_a_notch(way):
    """Frequency doubles in the time of the rate; the level is that of the table."""
    rig = SWEPT.replace(
        gap=1.0,
        sweep_mode=way,
        sweep_low=5.0 * math.tau,
        sweep_high=20.0 * math.tau,
        sweep_step=0.05 * math.tau,
        sweep_spacing='logarithmic',
        sweep_rate=6.0,
        sweep_notch_frequencies=[8.0 * math.tau, 10.0 * math.tau, 12.0 * math.tau],
        sweep_notch_factors=[1.0, 0.25, 1.0],
    )
    moving = Rig(rig)
    watch, swept = Watch(moving), SweptRun(moving)
    run(moving, 20.0, [watch, swept])
    time, b, rate, frequency = np.array(watch.rows).T
    octaves = np.log2(frequency / (5.0 * math.tau))
    expected = time / 10.0 if way == 'up' else 2.0 - time / 10.0
    # In steps of 0.0144 octaves, each at the first upward zero after its time
    late = np.abs(octaves - expected)
    assert late.max() < 2 * 0.0144 + 0.2 / 10.0
    # b never jumps
    assert np.abs(np.diff(b)).max() < 2e-3 * 1.01 * ACCELERATION / (5.0 * math.tau)
    # From b and b' of a sine, its acceleration
    level = np.hypot(b * frequency**2, rate * frequency)
    notch = np.interp(
        np.log(frequency), np.log(rig.sweep_notch_frequencies), np.log(rig.sweep_notch_factors)
    )
    assert level == pytest.approx(ACCELERATION * np.exp(notch), rel=1e-9)
    found = swept.response()
    assert found.level.min() == pytest.approx(0.25 * ACCELERATION, rel=0.05)
    assert found.level.max() == pytest.approx(ACCELERATION)


@pytest.mark.parametrize(
    ('quantity', 'level'), [('velocity', 0.03), ('displacement', 5e-4), ('acceleration', 2.0)]
)
def test_a_level_of_another_quantity_stays_constant(quantity, level):
    rig = SWEPT.replace(base_quantity=quantity, base_amplitudes=level, sweep_dwell=0.5)
    found = response_of(rig, 1.6)
    assert found.level == pytest.approx(level)


def test_a_notched_force_is_continuous():
    rig = SWEPT.replace(
        force_amplitudes=3.0,
        base_amplitudes=0.0,
        gap=1.0,
        sweep_notch_frequencies=[7.6 * math.tau, 12.4 * math.tau],
        sweep_notch_factors=[1.0, 0.1],
        sweep_dwell=0.1,
    )
    moving, forces = Rig(rig), []
    for k in range(1000):
        moving.advance(k * 5e-4)
        forces.append(moving.drive()[0])
    assert np.abs(np.diff(forces)).max() < 5e-4 * 3.0 * 12.4 * math.tau
    assert np.abs(forces[-200:]).max() == pytest.approx(0.3, rel=1e-2)
