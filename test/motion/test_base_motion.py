"""Motion of the base, against an independent integration of the equations with a moving base."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy
from rigs import UNFORCED

from impact_damper_ros import EventKind, InitialConditions, Rig, run_ensemble
from impact_damper_ros.motion.state import carried_to

STRUCTURE = UNFORCED.replace(
    primary_mass=5.0,
    stiffness=5.0 * (20.0 * math.pi) ** 2,
    damping=2.0 * 0.02 * 5.0 * 20.0 * math.pi,
)


def base_of(**more):
    return UNFORCED.replace(**more)


def lines_of(rig):
    """Return b, b' and b'' as functions, written out from what the parameters mean."""
    power = {'displacement': 0, 'velocity': 1, 'acceleration': 2}[rig.base_quantity]

    def derivative(order):
        def value(t):
            return sum(
                a * w ** (order - power) * math.sin(w * t + p + (order - power) * 0.5 * math.pi)
                for a, w, p in zip(
                    rig.base_amplitudes, rig.base_frequencies, rig.base_phases, strict=True
                )
            )

        return value

    return [derivative(order) for order in range(3)]


def integrated(p, initial, until, *, relative):
    """Return impacts and reversals, (time, stop), and the last state, X, X', Z, Z', absolute."""
    mass, k, c, m = p.primary_mass, p.stiffness, p.damping, p.damper_mass
    slope = p.gravity * math.sin(p.angle)
    grip = p.friction * p.gravity * math.cos(p.angle)
    b, rate, acceleration = lines_of(p)
    shift = np.array([b(0.0), rate(0.0)] * 2) if relative else np.zeros(4)
    state, now, found = np.array(initial) - shift, 0.0, []
    sign = float(np.sign(state[3] - state[1])) if grip else 0.0
    while now < until:

        def slopes(t, y, sign=sign):
            pull = -acceleration(t) if relative else 0.0
            spring = 0.0 if relative else k * b(t) + c * rate(t)
            x = (spring - k * y[0] - c * y[1] + sign * m * grip) / mass + pull
            return [y[1], x, y[3], slope - sign * grip + pull]

        def stop_1(_, y):
            return 0.5 * p.gap - (y[2] - y[0])

        def stop_2(_, y):
            return 0.5 * p.gap + (y[2] - y[0])

        def reversal(_, y):
            return y[3] - y[1]

        for event in (stop_1, stop_2, reversal):
            event.terminal = True
            event.direction = -1
        reversal.direction = -sign
        watched = [stop_1, stop_2, reversal][: 3 if grip else 2]
        flight = scipy.integrate.solve_ivp(
            slopes,
            (now, until),
            state,
            'DOP853',
            rtol=1e-12,
            atol=1e-14,
            events=watched,
            max_step=0.05,
        )
        now, state = flight.t[-1], flight.y[:, -1].copy()
        if flight.status == 0:
            break
        kind = next(n for n, times in enumerate(flight.t_events) if len(times))
        approach = state[3] - state[1]
        if kind < 2:
            restitution = (p.restitution_1, p.restitution_2)[kind]
            state[1] += m / (mass + m) * (1.0 + restitution) * approach
            state[3] = state[1] - restitution * approach
            sign = float(np.sign(state[3] - state[1])) if grip else 0.0
        else:
            sign = -sign
        found.append((now, kind + 1 if kind < 2 else 0))
    shift = np.array([b(now), rate(now)] * 2) if relative else np.zeros(4)
    return found, state + shift


HARMONIC = {
    'base_amplitudes': 1.8e-3,
    'base_frequencies': 31.4,
    'base_phases': 0.3,
    'base_quantity': 'displacement',
}
VELOCITY = {**HARMONIC, 'base_quantity': 'velocity', 'base_amplitudes': 0.1}
RANDOM = {
    'base_amplitudes': np.linspace(0.3, 0.9, 12),
    'base_frequencies': np.linspace(19.0, 50.0, 12),
    'base_phases': np.linspace(0.0, 40.0, 12) % math.tau,
}


@pytest.mark.parametrize('relative', [False, True])
@pytest.mark.parametrize(
    ('more', 'until', 'least'),
    [
        (HARMONIC, 3.0, 20),
        ({**HARMONIC, 'friction': 0.02, 'angle': 0.1}, 1.8, 35),
        ({**VELOCITY, 'damping': 12.6, 'restitution_2': 0.8}, 2.0, 10),
        (RANDOM, 3.0, 20),
    ],
)
def test_against_the_equations_with_a_moving_base(more, until, least, relative):
    rig = base_of(**more)
    start = InitialConditions(initial_damper_velocity=0.1)
    expected, last = integrated(rig, (0.0, 0.0, 0.0, 0.1), until, relative=relative)
    result = Rig(rig, start).run(until, [until])
    assert len(result.events) == len(expected) >= least
    assert result.events['stop'].tolist() == [stop for _, stop in expected]
    # The tolerance of the integration, through thirty impacts.
    assert result.events['time'] == pytest.approx([time for time, _ in expected], abs=2e-9)
    (row,) = result.samples
    motion = [row[n] for n in ('x', 'primary_velocity', 'z', 'damper_velocity')]
    assert motion == pytest.approx(last, abs=1e-8)
    b, rate, _ = lines_of(rig)
    assert row['base'] == pytest.approx(b(until), abs=1e-15)
    assert row['base_velocity'] == pytest.approx(rate(until), abs=1e-13)


@pytest.mark.parametrize('ratio', [0.5, 1.0, math.sqrt(2.0), 3.0])
def test_transmissibility_of_one_mass(ratio):
    """With m locked in its gap: |K + i C W| / |K - (M + m) W^2 + i C W|."""
    rate = ratio * math.sqrt(1974.0 / 2.1)
    rig = base_of(
        damping=12.6,
        gap=1e-9,
        friction=50.0,
        base_amplitudes=1e-3,
        base_frequencies=rate,
        base_quantity='displacement',
    )
    simulated = Rig(rig)
    simulated.run(8.0)
    times = np.linspace(8.0, 8.0 + math.tau / rate, 400)
    samples = simulated.run(times[-1], times).samples
    expected = abs(complex(1974.0, 12.6 * rate) / complex(1974.0 - 2.1 * rate**2, 12.6 * rate))
    assert np.abs(samples['x']).max() / 1e-3 == pytest.approx(expected, rel=1e-4)


def test_compiled_and_cut_runs_have_the_same_bits():
    rig = base_of(**RANDOM, friction=0.01)
    times = np.linspace(0.0, 4.0, 321)
    whole = Rig(rig).run(4.0, times)
    assert np.ptp(whole.samples['base']) > 1e-4
    pieces = Rig(rig)
    parts = [pieces.run(float(t), [float(t)]).samples for t in times]
    assert np.concatenate(parts).tobytes() == whole.samples.tobytes()
    compiled = Rig(rig, compiled=True).run(4.0, times)
    assert compiled.samples.tobytes() == whole.samples.tobytes()
    assert compiled.events.tobytes() == whole.events.tobytes()


def test_rigs_of_an_ensemble_are_those_alone():
    rig = base_of(**RANDOM)
    stiffness = [1500.0, 1974.0, 2500.0]
    together = run_ensemble(rig, {'stiffness': stiffness}, 3.0, instants=[1.0, 3.0])
    for value, samples in zip(stiffness, together.samples, strict=True):
        alone = Rig(rig.replace(stiffness=value)).run(3.0, [1.0, 3.0]).samples
        assert samples.tobytes() == alone.tobytes()


def test_force_and_base_shake_together():
    """Two harmonics that cancel each other leave M at rest."""
    base = base_of(**HARMONIC)
    amplitude, frequency, phase = base.first_harmonic
    both = base.replace(
        force_amplitudes=-amplitude, force_frequencies=frequency, force_phases=phase
    )
    assert len(both.harmonics[0]) == 2
    simulated = Rig(both)
    assert simulated.run(3.0, [3.0]).samples['x'] == pytest.approx(0.0, abs=1e-13)
    assert simulated.sample().base == pytest.approx(1.8e-3 * math.sin(31.4 * 3.0 + 0.3))


def test_the_base_goes_on_where_spring_and_dashpot_change():
    rig = base_of(**RANDOM)
    simulated = Rig(rig)
    simulated.advance(1.234)
    before = simulated.sample()
    simulated.change(rig.replace(stiffness=3000.0, damping=20.0))
    after = simulated.sample()
    assert (after.base, after.base_velocity) == pytest.approx(
        (before.base, before.base_velocity), rel=1e-12
    )
    simulated.advance(2.0)
    assert simulated.sample().base == pytest.approx(lines_of(rig)[0](2.0), abs=1e-14)


@pytest.mark.parametrize(
    'change',
    [
        {'base_amplitudes': 4e-3},
        {'base_frequencies': 25.0, 'base_quantity': 'acceleration', 'base_amplitudes': 1.0},
        {
            'base_amplitudes': [1e-3, 2e-3],
            'base_frequencies': [31.4, 47.0],
            'base_phases': [1.0, 2.0],
        },
        {'base_amplitudes': 0.0},
    ],
)
def test_a_change_of_the_base_waits_for_an_upward_zero(change):
    rig = base_of(**HARMONIC)
    simulated, new = Rig(rig), rig.replace(**change)
    simulated.advance(1.0)
    wait = simulated.wait_for_change(new)
    zero = (math.tau * 6 - 0.3) / 31.4  # 31.4 + 0.3 rad are 5.05 turns
    assert simulated.time + wait == pytest.approx(zero)
    simulated.advance(simulated.time + wait)
    before = simulated.sample()
    simulated.change(new)
    after = simulated.sample()
    assert before.base == pytest.approx(0.0, abs=1e-15)
    assert before.base_velocity > 0.0
    assert after.base == pytest.approx(0.0, abs=1e-14)
    assert after.base_velocity > 0.0 or not any(new.base_amplitudes)
    assert (after.x, after.primary_velocity) == (before.x, before.primary_velocity)


def test_a_change_that_keeps_the_base_continuous_does_not_wait():
    rig = base_of(**HARMONIC)
    simulated = Rig(rig)
    simulated.advance(1.0)
    place = simulated.sample().base
    for new in (rig.replace(gap=0.03), rig.replace(base_frequencies=28.0)):
        assert simulated.wait_for_change(new) == 0.0
        simulated.change(new)
        assert simulated.sample().base == pytest.approx(place, rel=1e-12)


def test_snapshots_hold_the_base():
    simulated = Rig(base_of(**RANDOM))
    simulated.advance(1.7)
    other = Rig.restore(simulated.snapshot())
    times = np.linspace(2.0, 3.0, 11)
    assert other.run(3.0, times).samples.tobytes() == simulated.run(3.0, times).samples.tobytes()


def test_structure_on_a_table():
    """A structure of 5 kg, 10 Hz and 2 % on a table at 0.2 g: X without the damper is A."""
    rig = STRUCTURE.replace(
        damper_mass=1e-9,
        gap=10.0,
        base_amplitudes=0.2 * 9.80665,
        base_frequencies=20.0 * math.pi,
    )
    b = 0.2 * 9.80665 / (20.0 * math.pi) ** 2
    assert rig.response_amplitude == pytest.approx(b * math.hypot(1.0, 0.04) / 0.04)
    simulated = Rig(rig)
    simulated.run(20.0)
    times = np.linspace(20.0, 20.1, 200)
    x = simulated.run(20.1, times).samples['x']
    assert np.abs(x).max() == pytest.approx(rig.response_amplitude, rel=1e-3)
    assert not (simulated.run(20.2).events['kind'] == EventKind.IMPACT).any()


@pytest.mark.parametrize('since', [0.0, 0.25, 3.0])
def test_a_record_carries_the_base_with_constant_acceleration(since):
    record = {'base_from': 2.0, 'base_place': 0.3, 'base_speed': -1.5, 'base_acceleration': 4.0}
    place, speed = carried_to(SimpleNamespace(**record), 2.0 + since)
    assert speed == -1.5 + 4.0 * since
    assert place == pytest.approx(0.3 - 1.5 * since + 2.0 * since**2, abs=1e-15)
