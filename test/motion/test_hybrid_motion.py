"""The whole hybrid motion: golden values, references, and properties of random rigs."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

from impact_damper_ros import EventKind, InitialConditions, Mode, Outcome, Rig, RigParameters
from impact_damper_ros.motion.event import events_of_table
from impact_damper_ros.motion.state import advance_time
from motion.random_rigs import random_rig, run
from oracle.reference import kept, load_reference

EPS = 2.0**-52
SLOPE = {'angle': math.pi / 4, 'gravity': 1.0, 'force_frequencies': [1.02]}


class TestGoldenValues:
    @pytest.mark.parametrize(
        ('rig', 'stop_1', 'stop_2', 'digits', 'ratio'),
        [
            (
                {'gravity': 0.0},
                (0.733784, 9.9294, -1.9340, -18.0987),
                (0.233784, -9.9294, 1.9340, 18.0987),
                (6, 4),
                None,
            ),
            (
                SLOPE,
                (0.7513744, 4.2199719, -1.3654370, -15.4743588),
                (0.2632173, -4.0551342, 1.8294568, 13.9932174),
                (7, 7),
                0.2032358,
            ),
            (
                {**SLOPE, 'friction': 0.5},
                (0.7579950, 4.1321400, -1.9067334, -15.9650212),
                (0.2697923, -3.9291024, 2.3620421, 14.4522209),
                (7, 7),
                0.2113439,
            ),
        ],
        ids=['horizontal', 'slope', 'friction'],
    )
    def test_steady_state(self, rig, stop_1, stop_2, digits, ratio):
        """Two impacts per cycle, and the largest X, to all the digits of the periodic theory."""
        parameters = RigParameters(**rig)
        period = 2 * math.pi / parameters.force_frequencies[0]
        motion = Rig(parameters)
        motion.run(900 * period)
        result = motion.run(902 * period, np.linspace(900 * period, 902 * period, 8001))
        events = events_of_table(result.impacts())
        assert sorted(e.stop for e in events) == [1, 1, 2, 2]
        for event in events:
            phase, *state = stop_1 if event.stop == 1 else stop_2
            tolerance = [0.51 * 10.0**-d for d in digits]
            assert event.time / period % 1 == pytest.approx(phase, abs=tolerance[0])
            got = (event.x, event.primary_velocity_after, event.damper_velocity_after)
            assert got == pytest.approx(state, abs=tolerance[1])
        if ratio is not None:
            top = np.abs(result.samples['x']).max()
            assert top / parameters.response_amplitude == pytest.approx(ratio, abs=3e-7)

    @pytest.mark.parametrize(('gap', 'count'), [(8.0, 4), (18.0, 3), (30.0, 2)])
    def test_attractors(self, gap, count):
        """Impacts per cycle of the frictionless horizontal rig at r = 1.02, from X = 1."""
        parameters = RigParameters(gravity=0.0, gap=gap, force_frequencies=[1.02])
        initial = InitialConditions(initial_primary_position=1.0, initial_damper_offset=-1.0)
        motion = Rig(parameters, initial)
        period = 2 * math.pi / 1.02
        motion.run(1000 * period)
        assert len(motion.run(1100 * period).impacts()) == count * 100


def without_last_bounces(events, reference):
    """Leave out the bounces of the reference that the simulator sums in closed form."""
    left = list(reference)
    for k, event in enumerate(events):
        while k < len(left) and event.kind == EventKind.REST and left[k].kind == 'impact':
            assert left[k].stop == event.stop
            assert event.time - 1e-5 < left[k].time <= event.time + 1e-12
            del left[k]
    return left


@pytest.mark.parametrize('reference', load_reference(), ids=lambda reference: reference.name)
def test_30_digit_runs_of_the_oracle(reference):
    """Events and states, each to what its condition lets round-off become."""
    rig = Rig(RigParameters(**reference.params), InitialConditions(**reference.initial))
    last = reference.events[-1]
    end = last.time * (1 + 1e-9 + min(64 * EPS * last.condition, 1e-3))
    states = [state.time for state in reference.states]
    result = rig.run(max([end, *states]), states)
    for got, want in zip(result.samples, reference.states, strict=True):
        blur = 64 * EPS * (1 + want.condition)
        assert abs(got['x'] - want.x) <= blur * reference.x_scale
        assert abs(got['z'] - want.z) <= blur * max(reference.x_scale, rig.parameters.gap)
        for name in ('primary_velocity', 'damper_velocity'):
            assert abs(got[name] - getattr(want, name)) <= blur * reference.v_scale
    events = events_of_table(result.events[result.events['time'] <= end])
    speeds = [e.damper_velocity_before - e.primary_velocity_before for e in events]
    mask = kept([e.kind.name.lower() for e in events], speeds, reference.floor)
    events = [e for e, keep in zip(events, mask, strict=True) if keep]
    expected = without_last_bounces(events, reference.events)
    for got, want in zip(events, expected, strict=False):
        assert got.kind.name.lower() == want.kind
        assert got.stop == want.stop
        blur = 64 * EPS * (1 + want.condition)
        if blur > 1e-3:
            return
        assert abs(got.time - want.time) <= blur * want.time
        state = 64 * EPS * (1 + want.state_condition)
        assert abs(got.x - want.x) <= state * reference.x_scale
        for name in got._fields[5:9]:
            assert abs(getattr(got, name) - getattr(want, name)) <= state * reference.v_scale
    assert len(events) >= len(expected)


def force(parameters, time):
    rows = zip(
        parameters.force_amplitudes,
        parameters.force_frequencies,
        parameters.force_phases,
        strict=True,
    )
    return sum(f * math.sin(w * time + p) for f, w, p in rows)


def grip_of(parameters):
    return parameters.friction * parameters.gravity * max(0.0, math.cos(parameters.angle))


@given(seed=st.integers(0, 10**9))
def test_what_holds_at_every_instant(seed):
    """Samples and events in order, m between the stops, and the thresholds of its support."""
    p, initial = random_rig(seed)
    rig, last, air, half = Rig(p, initial), 0.0, 0.0, p.gap / 2
    grip, pull = grip_of(p), p.gravity * math.sin(p.angle)
    together = p.primary_mass + p.damper_mass
    while rig.time < 30.0:
        run = rig.run(rig.time + 0.05, most_events=500)
        if run.outcome is not Outcome.COMPLETE:
            break
        events = events_of_table(run.events)
        sample = rig.sample()
        y, blur = sample.z - sample.x, 2 * EPS * (abs(sample.x) + abs(sample.z))
        assert y <= half + blur
        assert p.one_sided or y >= -half - blur
        assert all(map(math.isfinite, sample))
        for e in events:
            assert last <= e.time <= rig.time
            last = e.time
            assert e.y <= half
            assert p.one_sided or e.y >= -half
            if e.kind == EventKind.IMPACT:
                assert e.y == (half if e.stop == 1 else -half)
                air = p.air_force / p.damper_mass * (-1 if e.stop == 1 else 1)
                continue
            before, after = e.primary_velocity_before, e.primary_velocity_after
            assert e.impulse == 0.0
            assert abs(after - before) <= 1e-14 * (abs(before) + abs(after))
            if e.kind is EventKind.REVERSAL:
                continue
            # What m needs to go with M: the grip at a release, within it at a rest or sticking
            assert e.damper_velocity_after == pytest.approx(e.primary_velocity_after, abs=1e-15)
            drag, spring = p.damping * e.primary_velocity_after, p.stiffness * e.x
            terms = force(p, e.time), p.damper_mass * pull, -drag, -spring
            need = sum(terms) / together - pull - air
            # A REST after a chatter is known to the chatter's tolerance.
            blur = 1e-12 * (sum(map(abs, terms)) / together + abs(pull) + abs(air) + grip)
            if e.kind == EventKind.RELEASE and e.time > 0.0:
                limit = {1: grip, 2: -grip}.get(e.stop, math.copysign(grip, need))
                assert need == pytest.approx(limit, abs=blur)
            elif e.kind == EventKind.STICK:
                assert abs(need) <= grip + blur
            elif e.kind == EventKind.REST:
                assert (need <= grip + blur) if e.stop == 1 else (need >= -grip - blur)


class TestLimits:
    def test_light_damper_does_not_disturb(self):
        """Mu -> 0: M moves as the free oscillator, to O(mu)."""
        for mu in (1e-4, 1e-7):
            p = RigParameters(
                damper_mass=mu, restitution_1=1.0, restitution_2=1.0, gap=2.0, gravity=0.0
            )
            rig, free = Rig(p), Rig(p.replace(gap=1e6))
            assert len(rig.advance(30.0)) > 5
            assert free.advance(30.0) == []
            a, b = rig.sample(), free.sample()
            assert a.x == pytest.approx(b.x, abs=2e3 * mu)

    @pytest.mark.parametrize(('height', 'restitution'), [(1e-6, 0.2), (1e-6, 0.95), (1.0, 0.75)])
    def test_bouncing_ball(self, height, restitution):
        """On a nearly still M a chatter ends at sqrt(2h/g) (1+R)/(1-R)."""
        p = RigParameters(
            primary_mass=1e9,
            stiffness=1e9,
            damper_mass=1e-6,
            gap=2.0,
            angle=math.pi / 2,
            gravity=2.0,
            restitution_1=restitution,
            force_amplitudes=[0.0],
        )
        rig = Rig(p, InitialConditions(initial_damper_offset=1.0 - height))
        fall = math.sqrt(1.0 - (1.0 - height))
        events = rig.advance(200.0)
        assert events[-1].kind == EventKind.REST
        assert rig.mode == Mode.REST_1
        end = fall * (1 + restitution) / (1 - restitution)
        assert events[-1].time == pytest.approx(end, rel=1e-11)
        assert len(events) < 60 / (1 - restitution)

    def test_long_run_keeps_the_time(self):
        """1e4 cycles of resonance without damping: the force's phase does not drift."""
        p = RigParameters(damping=0.0, gap=1e9, gravity=0.0)
        rig = Rig(p)
        end = 2 * math.pi * 1e4
        rig.advance(end)
        want = (math.sin(end) - end * math.cos(end)) / 2
        assert rig.sample().x == pytest.approx(want, rel=1e-11)


#: Powers of length, time and mass in the units of parameters; of others there are none.
UNITS = {
    'primary_mass': (0, 0, 1),
    'stiffness': (0, -2, 1),
    'damping': (0, -1, 1),
    'damper_mass': (0, 0, 1),
    'gap': (1, 0, 0),
    'gravity': (1, -2, 0),
    'air_force': (1, -2, 1),
    'force_amplitudes': (1, -2, 1),
    'force_frequencies': (0, -1, 0),
    'initial_primary_position': (1, 0, 0),
    'initial_damper_offset': (1, 0, 0),
    'initial_primary_velocity': (1, -1, 0),
    'initial_damper_velocity': (1, -1, 0),
}


def scaled(table, units):
    """Return parameters in other units."""
    changed = {}
    for name, value in table.as_dict().items():
        unit = math.prod(u**n for u, n in zip(units, UNITS.get(name, (0, 0, 0)), strict=True))
        if unit != 1.0:
            changed[name] = tuple(v * unit for v in value) if name[:5] == 'force' else value * unit
    return table.replace(**changed)


def mirrored(rig, initial):
    """Return a rig with slope, stops and force reversed."""
    ends = {'restitution_1': rig.restitution_2, 'restitution_2': rig.restitution_1}
    force = [-f for f in rig.force_amplitudes]
    other = rig.replace(angle=-rig.angle, force_amplitudes=force, **ends)
    return other, InitialConditions(**{k: -v for k, v in initial.as_dict().items()})


@given(seed=st.integers(0, 10**9))
@pytest.mark.parametrize('units', [(8.0, 0.25, 1024.0), (0.3048, 60.0, 0.45359237), None])
def test_symmetries(units, seed):
    """Powers of two and signs change no digit, other units the last ones."""
    own = random_rig(seed, **({} if units else {'one_sided': False}))
    other = mirrored(*own) if units is None else [scaled(table, units) for table in own]
    exact = units is None or units[0] == 8.0
    length, time, _ = units or (-1.0, 1.0, 1.0)
    stops = (0, 1, 2) if units else (0, 2, 1)
    mine = Rig(*own)
    events = run(mine, 20.0, 200)
    got = Rig(*other).advance(mine.time * time)
    assert not exact or len(got) == len(events)
    for a, b in list(zip(events, got, strict=False))[: None if exact else 3]:
        assert (a.kind, stops[a.stop]) == (b.kind, b.stop)
        speed = length / time
        want = [a.time * time, length * a.x, length * a.y]
        want += [speed * a.primary_velocity_after, speed * a.damper_velocity_after]
        have = [b.time, b.x, b.y, b.primary_velocity_after, b.damper_velocity_after]
        assert have == (want if exact else pytest.approx(want, rel=1e-8, abs=1e-8 * length))


def test_instants_lose_no_digits():
    """A thousand flights from a late instant add up as fractions do, to twice the digits."""
    rng, instant, exact = random.Random(1), (1e6, 0.0), Fraction(10**6)
    for _ in range(1000):
        tau = rng.expovariate(1.0)
        exact += Fraction(tau)
        instant = advance_time(*instant, tau)
    assert abs(sum(map(Fraction, instant)) - exact) < 1e-20
