"""The whole hybrid motion: golden values, references, and properties of random rigs."""

import itertools
import math
import random

import numpy as np
import pytest

from impact_damper_ros.rig import (
    EventKind,
    InitialConditions,
    Mode,
    ParameterError,
    RigParameters,
    Simulator,
)
from oracle.reference import PATH, kept, load_reference
from rig.random_rigs import random_rig, run, through_json

EPS = 2.0**-52
SLOPE = {'angle': math.pi / 4, 'gravity': 1.0, 'force_frequencies': [1.02]}
SEEDS = range(40)


def impacts(events):
    return [e for e in events if e.kind == EventKind.IMPACT]


class TestGoldenValues:
    def test_first_impacts_at_resonance(self):
        events = Simulator(RigParameters(gravity=0.0)).advance(51.0)
        times = [43.62266009691099, 45.40718583180668, 46.77474766084761, 50.874097144989875]
        assert [e.time for e in events] == pytest.approx(times, rel=1e-13)
        assert [e.stop for e in events] == [1, 2, 1, 2]

    def test_first_events_on_the_slope(self):
        events = Simulator(RigParameters(friction=0.5, **SLOPE)).advance(25.0)
        events = [e for e in events if e.kind != EventKind.REVERSAL]
        want = [
            (EventKind.STICK, 0, 0.733769482104),
            (EventKind.RELEASE, 0, 1.71677134162),
            (EventKind.IMPACT, 1, 10.061379083930),
            (EventKind.IMPACT, 2, 20.433504840227),
            (EventKind.IMPACT, 1, 22.929063529950),
            (EventKind.IMPACT, 2, 24.931810684244),
        ]
        assert [(e.kind, e.stop) for e in events] == [w[:2] for w in want]
        for event, (_, _, time) in zip(events, want, strict=True):
            assert event.time == pytest.approx(time, abs=6e-12)

    @pytest.mark.parametrize(
        ('rig', 'stop_1', 'stop_2', 'digits'),
        [
            (
                {'gravity': 0.0},
                (0.733784, 9.9294, -1.9340, -18.0987),
                (0.233784, -9.9294, 1.9340, 18.0987),
                (6, 4),
            ),
            (
                SLOPE,
                (0.7513744, 4.2199719, -1.3654370, -15.4743588),
                (0.2632173, -4.0551342, 1.8294568, 13.9932174),
                (7, 7),
            ),
            (
                {**SLOPE, 'friction': 0.5},
                (0.7579950, 4.1321400, -1.9067334, -15.9650212),
                (0.2697923, -3.9291024, 2.3620421, 14.4522209),
                (7, 7),
            ),
        ],
        ids=['horizontal', 'slope', 'friction'],
    )
    def test_steady_state(self, rig, stop_1, stop_2, digits):
        """Two impacts per cycle, to all the digits of the periodic theory."""
        parameters = RigParameters(**rig)
        period = 2 * math.pi / parameters.force_frequencies[0]
        motion = Simulator(parameters)
        motion.advance(900 * period)
        events = impacts(motion.advance(902 * period))
        assert sorted(e.stop for e in events) == [1, 1, 2, 2]
        for event in events:
            phase, *state = stop_1 if event.stop == 1 else stop_2
            tolerance = [0.51 * 10.0**-d for d in digits]
            assert event.time / period % 1 == pytest.approx(phase, abs=tolerance[0])
            got = (event.x, event.primary_velocity_after, event.damper_velocity_after)
            assert got == pytest.approx(state, abs=tolerance[1])

    @pytest.mark.parametrize(
        ('rig', 'ratio'),
        [({**SLOPE}, 0.2032358), ({**SLOPE, 'friction': 0.5}, 0.2113439)],
    )
    def test_largest_displacement(self, rig, ratio):
        parameters = RigParameters(**rig)
        period = 2 * math.pi / 1.02
        motion = Simulator(parameters)
        motion.advance(900 * period)
        top = 0.0
        for k in range(4000):
            motion.advance((900 + k / 4000) * period)
            top = max(top, abs(motion.sample().x))
        assert top / parameters.response_amplitude == pytest.approx(ratio, abs=3e-7)

    @pytest.mark.parametrize(
        ('gap', 'count'), [(8.0, 4), (16.0, 3), (18.0, 3), (24.0, 2), (30.0, 2), (37.0, 2)]
    )
    def test_attractors(self, gap, count):
        """Impacts per cycle of the frictionless horizontal rig at r = 1.02, from X = 1."""
        parameters = RigParameters(gravity=0.0, gap=gap, force_frequencies=[1.02])
        initial = InitialConditions(initial_primary_position=1.0, initial_damper_offset=-1.0)
        motion = Simulator(parameters, initial)
        period = 2 * math.pi / 1.02
        motion.advance(1000 * period)
        assert len(impacts(motion.advance(1100 * period))) == count * 100

    def test_range_of_the_vertical_one_sided_rig(self):
        """One impact per cycle is stable for 0.454 < A W^2/g < 1.1265, followed from within."""
        gain = 100 / math.hypot(99.0, 1.0)
        rig = {
            'damping': 0.1,
            'damper_mass': 0.01,
            'gravity': 1.0,
            'angle': math.pi / 2,
            'one_sided': True,
            'gap': 1.0,
            'force_frequencies': [10.0],
        }
        period = 2 * math.pi / 10
        for path, inside in (
            ((0.8, 0.6, 0.5, 0.47, 0.456), True),
            ((0.8, 0.6, 0.5, 0.47, 0.456, 0.450), False),
            ((0.8, 1.0, 1.08, 1.11, 1.124), True),
            ((0.8, 1.0, 1.08, 1.11, 1.124, 1.132), False),
        ):
            motion = Simulator(
                RigParameters(**rig, force_amplitudes=[path[0] / gain]),
                InitialConditions(initial_damper_offset=0.5, initial_damper_velocity=-0.3),
            )
            cycle = 0
            for value in path:
                motion.change(motion.parameters.replace(force_amplitudes=[value / gain]))
                cycle += 800
                motion.advance(cycle * period)
            events = impacts(motion.advance((cycle + 40) * period))
            gaps = np.diff([e.time for e in events])
            one = len(events) == 40 and float(np.ptp(gaps)) < 1e-6 * period
            assert one == inside, path


KINDS = {
    'impact': EventKind.IMPACT,
    'rest': EventKind.REST,
    'stick': EventKind.STICK,
    'release': EventKind.RELEASE,
    'reversal': EventKind.REVERSAL,
}


def without_last_bounces(events, reference):
    """Leave out the bounces of the reference that the simulator sums in closed form."""
    left = list(reference)
    for k, event in enumerate(events):
        while k < len(left) and event.kind == EventKind.REST and left[k].kind == 'impact':
            assert left[k].stop == event.stop
            assert event.time - 1e-5 < left[k].time <= event.time + 1e-12
            del left[k]
    return left


@pytest.mark.skipif(not PATH.exists(), reason='no reference.json yet')
class TestReferences:
    """Against the 30-digit runs of the oracle."""

    @pytest.mark.parametrize(
        'reference',
        load_reference() if PATH.exists() else [],
        ids=lambda reference: reference.name,
    )
    def test_events(self, reference):
        rig = Simulator(RigParameters(**reference.params), InitialConditions(**reference.initial))
        last = reference.events[-1]
        events = rig.advance(last.time * (1 + 1e-9 + min(64 * EPS * last.condition, 1e-3)))
        speeds = [e.damper_velocity_before - e.primary_velocity_before for e in events]
        mask = kept([e.kind.name.lower() for e in events], speeds, reference.floor)
        events = [e for e, keep in zip(events, mask, strict=True) if keep]
        expected = without_last_bounces(events, reference.events)
        for got, want in zip(events, expected, strict=False):
            assert got.kind == KINDS[want.kind]
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

    def test_thirty_impacts_of_regular_motion(self):
        """1e-10 relative is promised; where the condition is small it is far better."""
        seen = 0
        for reference in load_reference():
            rig = Simulator(
                RigParameters(**reference.params), InitialConditions(**reference.initial)
            )
            want = [e for e in reference.events if e.kind == 'impact'][:30]
            events = rig.advance(want[-1].time + 1e-6)
            regular = not any(e.kind == EventKind.REST for e in events)
            if len(want) < 30 or not regular or want[-1].condition > 1e4:
                continue
            for a, b in zip(impacts(events)[:30], want, strict=True):
                assert a.time == pytest.approx(b.time, rel=1e-10)
            seen += 1
        assert seen >= 8

    @pytest.mark.parametrize(
        'reference',
        load_reference() if PATH.exists() else [],
        ids=lambda reference: reference.name,
    )
    def test_states(self, reference):
        rig = Simulator(RigParameters(**reference.params), InitialConditions(**reference.initial))
        for want in reference.states:
            rig.advance(want.time)
            got = rig.sample()
            blur = 64 * EPS * (1 + want.condition)
            assert abs(got.x - want.x) <= blur * reference.x_scale
            assert abs(got.z - want.z) <= blur * max(reference.x_scale, rig.parameters.gap)
            assert abs(got.primary_velocity - want.primary_velocity) <= blur * reference.v_scale
            assert abs(got.damper_velocity - want.damper_velocity) <= blur * reference.v_scale


class TestReproducibility:
    """Bit for bit: how a run is sampled, cut or interrupted does not matter."""

    @pytest.mark.parametrize('seed', SEEDS)
    def test_split(self, seed):
        rng = random.Random(f'split {seed}')
        parameters, initial = random_rig(seed)
        whole = Simulator(parameters, initial)
        pieces = Simulator(parameters, initial)
        events = run(whole, 40.0)
        cuts = sorted(rng.uniform(0, whole.time) for _ in range(rng.choice([1, 7, 300])))
        # Cuts at the very instants of events, and next to them
        cuts += [e.time for e in events[:: max(1, len(events) // 20)]]
        cuts += [math.nextafter(e.time, 0) for e in events[:: max(1, len(events) // 7)]]
        got = []
        for cut in sorted(cuts):
            got += pieces.advance(cut)
            assert not got or got[-1].time <= cut
            for _ in range(rng.choice([0, 1, 2])):
                pieces.sample()
            if rng.random() < 0.2:
                assert pieces.stops[0] >= parameters.gap / 2
                assert pieces.mode in Mode
        got += pieces.advance(whole.time)
        assert got == events
        assert pieces.sample() == whole.sample()
        assert pieces.snapshot() == whole.snapshot()

    @pytest.mark.parametrize('rate', [10.0, 333.0])
    def test_sampling_rate(self, rate):
        parameters = RigParameters(friction=0.5, **SLOPE)
        whole, fine = Simulator(parameters), Simulator(parameters)
        events = whole.advance(60.0)
        got, samples = [], {}
        for k in range(int(60 * rate) + 1):
            got += fine.advance(k / rate)
            samples[k / rate] = fine.sample()
        assert got == events
        for k in (0, 7, 123, 599):
            fresh = Simulator(parameters)
            fresh.advance(k / 10.0)
            if k / 10.0 in samples:
                assert fresh.sample() == samples[k / 10.0]

    @pytest.mark.parametrize('seed', SEEDS)
    def test_snapshot(self, seed):
        rng = random.Random(f'snapshot {seed}')
        parameters, initial = random_rig(seed)
        rig = Simulator(parameters, initial, time=rng.choice([0.0, 1234.5]))
        run(rig, rig.time + rng.uniform(0, 25), 1000)
        other = through_json(rig)
        assert other.snapshot() == rig.snapshot()
        assert (other.time, other.mode, other.stops) == (rig.time, rig.mode, rig.stops)
        assert other.sample() == rig.sample()
        end = rig.time + 15.0
        assert run(other, end, 1000) == run(rig, end, 1000)
        assert other.sample() == rig.sample()

    def test_snapshot_in_every_mode(self):
        seen = set()
        for seed in range(60):
            rig = Simulator(*random_rig(seed))
            step = 0
            while rig.time < 10.0 and step < 60:
                step += 1
                rig.advance(rig.time + 0.17)
                if rig.mode in seen:
                    continue
                seen.add(rig.mode)
                other = through_json(rig)
                assert other.mode == rig.mode
                assert other.advance(rig.time + 2.0) == rig.advance(rig.time + 2.0)
        assert {
            Mode.FREE,
            Mode.SLIDE_DOWN,
            Mode.SLIDE_UP,
            Mode.STICK,
            Mode.REST_1,
            Mode.REST_2,
        } <= seen

    def test_snapshot_during_chatter(self):
        """M is on the stop, in bounces too small to be resolved."""
        found = 0
        for seed in range(100):
            rig = Simulator(*random_rig(seed))
            for event in run(rig, 10.0, 300):
                if event.kind != EventKind.REST or event.time == 0.0:
                    continue
                before = Simulator(*random_rig(seed))
                before.advance(event.time - 1e-9)
                if before.mode not in (Mode.CHATTER_1, Mode.CHATTER_2):
                    continue
                sample = before.sample()
                stop = sample.stop_1 if event.stop == 1 else sample.stop_2
                assert sample.z == pytest.approx(stop, abs=1e-12)
                other = through_json(before)
                assert other.advance(event.time) == before.advance(event.time)
                found += 1
                break
        assert found >= 3

    def test_bad_snapshots(self):
        good = Simulator(RigParameters()).snapshot()
        for bad in ({}, {**good, 'format': 3}, {**good, 'origin': {}}, {'format': 1}):
            with pytest.raises(ValueError, match='snapshot'):
                Simulator.restore(bad)

    def test_only_forwards(self):
        rig = Simulator(RigParameters(), time=5.0)
        rig.advance(7.0)
        assert rig.advance(7.0) == []
        for time in (6.9, math.nan, math.inf):
            with pytest.raises(ValueError, match='advance'):
                rig.advance(time)
        assert rig.time == 7.0

    def test_start_outside_the_gap(self):
        with pytest.raises(ParameterError):
            Simulator(RigParameters(), InitialConditions(initial_damper_offset=20.0))

    def test_reset_starts_the_force_anew(self):
        rig = Simulator(RigParameters(gravity=0.0))
        rig.advance(100.0)
        rig.reset()
        fresh = Simulator(RigParameters(gravity=0.0))
        late, early = rig.advance(160.0), fresh.advance(60.0)
        assert [e.time - 100.0 for e in late] == pytest.approx([e.time for e in early], rel=1e-9)
        with pytest.raises(ParameterError):
            rig.reset(InitialConditions(initial_damper_offset=20.0))
        assert rig.time == 160.0


def force(parameters, time):
    rows = zip(
        parameters.force_amplitudes,
        parameters.force_frequencies,
        parameters.force_phases,
        strict=True,
    )
    return sum(f * math.sin(w * time + p) for f, w, p in rows)


def energy(parameters, x, v, z, w):
    p = parameters
    pull = p.damper_mass * p.gravity * math.sin(p.angle)
    return (p.primary_mass * v * v + p.stiffness * x * x + p.damper_mass * w * w) / 2 - pull * z


def grip_of(parameters):
    return parameters.friction * parameters.gravity * max(0.0, math.cos(parameters.angle))


class TestProperties:
    @pytest.mark.parametrize('seed', SEEDS)
    def test_samples_and_events(self, seed):
        """M stays between the stops; impacts approach, keep momentum and lose energy exactly."""
        parameters, initial = random_rig(seed)
        rig = Simulator(parameters, initial)
        half, M, m = parameters.gap / 2, parameters.primary_mass, parameters.damper_mass
        last, step = 0.0, 0
        while rig.time < 40.0 and step < 2000:
            step += 1
            events = rig.advance(rig.time + 0.02)
            if len(events) > 500:
                break
            sample = rig.sample()
            y, blur = sample.z - sample.x, 2 * EPS * (abs(sample.x) + abs(sample.z))
            assert y <= half + blur
            assert parameters.one_sided or y >= -half - blur
            assert all(map(math.isfinite, sample))
            for e in events:
                assert last <= e.time <= rig.time
                last = e.time
                assert e.y <= half
                assert parameters.one_sided or e.y >= -half
                v, V = e.primary_velocity_before, e.primary_velocity_after
                w, W = e.damper_velocity_before, e.damper_velocity_after
                if e.kind != EventKind.IMPACT:
                    assert e.impulse == 0.0
                    assert abs(V - v) <= 1e-14 * (abs(v) + abs(V))
                    continue
                fast = abs(v) + abs(w)
                side = 1 if e.stop == 1 else -1
                restitution = parameters.restitution_1 if e.stop == 1 else parameters.restitution_2
                assert e.y == side * half
                assert side * (w - v) >= -4 * EPS * fast
                assert M * V + m * W == pytest.approx(M * v + m * w, abs=9 * EPS * (M + m) * fast)
                assert pytest.approx(-restitution * (w - v), abs=9 * EPS * fast) == W - V
                assert e.impulse == pytest.approx(abs(M * (V - v)), abs=9 * EPS * (M + m) * fast)
                loss = (M * (v * v - V * V) + m * (w * w - W * W)) / 2
                want = M * m / (M + m) * (1 - restitution**2) * (w - v) ** 2 / 2
                assert loss == pytest.approx(want, abs=20 * EPS * (M + m) * fast**2)

    @pytest.mark.parametrize('seed', SEEDS)
    def test_energy_balance(self, seed):
        """Work of force and air = change + dashpot + friction + impacts, by Gauss quadrature."""
        p, initial = random_rig(seed, air_force=0.0)
        probe, rig = Simulator(p, initial), Simulator(p, initial)
        # The first sample is after an impact with which the rig starts.
        events = [e for e in run(probe, 12.0, 150) if e.time > 0.0]
        if len(events) > 150:
            events = events[:150]
        cuts = sorted({0.0, *(e.time for e in events), events[-1].time if events else 12.0})
        nodes, weights = np.polynomial.legendre.leggauss(24)
        drag = p.damper_mass * grip_of(p)
        work = lost = 0.0
        s = rig.sample()
        before = energy(p, *s[1:5])
        size = abs(before)
        for a, b in itertools.pairwise(cuts):
            if b - a < 1e-9:
                continue
            for k in range(pieces := max(1, math.ceil((b - a) / 0.5))):
                low, width = a + (b - a) * k / pieces, (b - a) / pieces
                for node, weight in zip(nodes, weights, strict=True):
                    rig.advance(low + width * (node + 1) / 2)
                    s = rig.sample()
                    area = weight * width / 2
                    v, u = s.primary_velocity, s.damper_velocity - s.primary_velocity
                    work += area * force(p, rig.time) * v
                    lost += area * (p.damping * v * v + drag * abs(u))
        rig.advance(cuts[-1])
        for e in events:
            u = e.damper_velocity_before - e.primary_velocity_before
            R = {1: p.restitution_1, 2: p.restitution_2, 0: 1.0}[e.stop]
            if e.kind == EventKind.IMPACT:
                reduced = p.primary_mass * p.damper_mass / (p.primary_mass + p.damper_mass)
                lost += reduced * (1 - R * R) * u * u / 2
        after = energy(p, *rig.sample()[1:5])
        size += abs(after) + abs(work) + lost
        assert after - before == pytest.approx(work - lost, abs=2e-9 * size)

    @pytest.mark.parametrize('seed', SEEDS)
    def test_thresholds(self, seed):
        """At a release |n| is the grip, to round-off; at a rest or sticking n is within."""
        p, initial = random_rig(seed)
        rig, air = Simulator(p, initial), 0.0
        grip, pull = grip_of(p), p.gravity * math.sin(p.angle)
        together = p.primary_mass + p.damper_mass
        for e in run(rig, 40.0, 1500):
            if e.kind == EventKind.IMPACT:
                air = p.air_force / p.damper_mass * (-1 if e.stop == 1 else 1)
            if e.kind not in (EventKind.RELEASE, EventKind.REST, EventKind.STICK):
                continue
            assert e.damper_velocity_after == pytest.approx(e.primary_velocity_after, abs=1e-15)
            terms = (
                force(p, e.time),
                p.damper_mass * pull,
                -p.damping * e.primary_velocity_after,
                -p.stiffness * e.x,
            )
            need = sum(terms) / together - pull - air
            # A REST after a chatter is known to the chatter's tolerance.
            blur = 1e-12 * (sum(map(abs, terms)) / together + abs(pull) + abs(air) + grip)
            if e.kind == EventKind.RELEASE:
                if e.time == 0.0:
                    continue
                limit = {1: grip, 2: -grip}.get(e.stop, math.copysign(grip, need))
                assert need == pytest.approx(limit, abs=blur)
            elif e.kind == EventKind.STICK:
                assert abs(need) <= grip + blur
            else:
                assert (need <= grip + blur) if e.stop == 1 else (need >= -grip - blur)


class TestLimits:
    def test_light_damper_does_not_disturb(self):
        """Mu -> 0: M moves as the free oscillator, to O(mu)."""
        for mu in (1e-4, 1e-7):
            p = RigParameters(
                damper_mass=mu, restitution_1=1.0, restitution_2=1.0, gap=2.0, gravity=0.0
            )
            rig, free = Simulator(p), Simulator(p.replace(gap=1e6))
            assert len(rig.advance(30.0)) > 5
            assert free.advance(30.0) == []
            a, b = rig.sample(), free.sample()
            assert a.x == pytest.approx(b.x, abs=2e3 * mu)

    def test_elastic_impacts_keep_the_energy(self):
        """R = 1, no friction, no dashpot, no force: for hundreds of impacts."""
        p = RigParameters(
            damping=0.0, restitution_1=1.0, restitution_2=1.0, gap=2.0, force_amplitudes=[0.0]
        )
        initial = InitialConditions(initial_primary_velocity=1.0, initial_damper_velocity=0.3)
        rig = Simulator(p, initial)
        start = energy(p, *rig.sample()[1:5])
        assert len(rig.advance(500.0)) > 100
        assert energy(p, *rig.sample()[1:5]) == pytest.approx(start, rel=1e-12)

    def test_plastic_impact(self):
        """R = 0: one impact, then rest or an immediate departure, never a bounce."""
        p = RigParameters(restitution_1=0.0, restitution_2=0.0, gravity=0.0, gap=2.0)
        events = Simulator(p).advance(200.0)
        assert len(events) > 20
        for a, b in itertools.pairwise(events):
            if a.kind == EventKind.IMPACT:
                assert a.damper_velocity_after == a.primary_velocity_after
                assert b.kind in (EventKind.REST, EventKind.IMPACT)
            if a.kind == EventKind.REST:
                assert (b.kind, b.stop) == (EventKind.RELEASE, a.stop)

    @pytest.mark.parametrize('restitution', [0.2, 0.75, 0.95])
    @pytest.mark.parametrize('height', [1e-6, 1.0])
    def test_bouncing_ball(self, restitution, height):
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
        rig = Simulator(p, InitialConditions(initial_damper_offset=1.0 - height))
        fall = math.sqrt(1.0 - (1.0 - height))
        events = rig.advance(200.0)
        assert events[-1].kind == EventKind.REST
        assert rig.mode == Mode.REST_1
        end = fall * (1 + restitution) / (1 - restitution)
        assert events[-1].time == pytest.approx(end, rel=1e-11)
        assert len(events) < 60 / (1 - restitution)

    @pytest.mark.parametrize('seed', range(10))
    def test_chatter_does_not_run_away(self, seed):
        """A pressed m comes to rest after a number of impacts that follows from ln R."""
        rng = random.Random(f'chatter {seed}')
        p = RigParameters(
            angle=rng.uniform(0.3, 1.5),
            restitution_1=rng.uniform(0.3, 0.97),
            friction=rng.choice([0.0, 0.1]),
            gap=rng.uniform(0.5, 5.0),
            damping=0.2,
            force_amplitudes=[0.1],
        )
        events = Simulator(p).advance(60.0)
        assert events[-1].kind == EventKind.REST
        assert len(events) < 40 / -math.log(p.restitution_1) + 40
        times = [e.time for e in events]
        assert times == sorted(times)

    def test_long_run_keeps_the_time(self):
        """1e4 cycles of resonance without damping: the force's phase does not drift."""
        p = RigParameters(damping=0.0, gap=1e9, gravity=0.0)
        rig = Simulator(p)
        end = 2 * math.pi * 1e4
        rig.advance(end)
        want = (math.sin(end) - end * math.cos(end)) / 2
        assert rig.sample().x == pytest.approx(want, rel=1e-11)


def scaled(p, length, time, mass):
    """Return the same rig in other units."""
    forced = mass * length / time**2
    return RigParameters(
        primary_mass=p.primary_mass * mass,
        stiffness=p.stiffness * mass / time**2,
        damping=p.damping * mass / time,
        damper_mass=p.damper_mass * mass,
        gap=p.gap * length,
        restitution_1=p.restitution_1,
        restitution_2=p.restitution_2,
        angle=p.angle,
        friction=p.friction,
        gravity=p.gravity * length / time**2,
        air_force=p.air_force * forced,
        one_sided=p.one_sided,
        force_amplitudes=[f * forced for f in p.force_amplitudes],
        force_frequencies=[w / time for w in p.force_frequencies],
        force_phases=p.force_phases,
    )


class TestSymmetries:
    @pytest.mark.parametrize('seed', SEEDS)
    @pytest.mark.parametrize('units', [(8.0, 0.25, 1024.0), (0.3048, 60.0, 0.45359237)])
    def test_units(self, seed, units):
        """Powers of two change no digit; other units change the last ones."""
        length, time, mass = units
        p, initial = random_rig(seed)
        mine = Simulator(p, initial)
        other = Simulator(
            scaled(p, length, time, mass),
            InitialConditions(
                initial_primary_position=initial.initial_primary_position * length,
                initial_primary_velocity=initial.initial_primary_velocity * length / time,
                initial_damper_offset=initial.initial_damper_offset * length,
                initial_damper_velocity=initial.initial_damper_velocity * length / time,
            ),
        )
        exact = length == 8.0
        events = run(mine, 20.0, 200)
        got = other.advance(mine.time * time)
        if exact:
            assert len(got) == len(events)
        for a, b in list(zip(events, got, strict=False))[: None if exact else 4]:
            assert (a.kind, a.stop) == (b.kind, b.stop)
            want = (a.time * time, a.x * length, a.primary_velocity_after * length / time)
            have = (b.time, b.x, b.primary_velocity_after)
            if exact:
                assert have == want
            else:
                assert have == pytest.approx(want, rel=1e-9, abs=1e-9 * length)

    @pytest.mark.parametrize('seed', SEEDS)
    @pytest.mark.parametrize('by_sign', [True, False])
    def test_mirror(self, seed, by_sign):
        """Slope, stops and force reversed: the same motion, reversed."""
        p, initial = random_rig(seed, one_sided=False)
        mirrored = p.replace(
            angle=-p.angle,
            restitution_1=p.restitution_2,
            restitution_2=p.restitution_1,
            **(
                {'force_amplitudes': [-f for f in p.force_amplitudes]}
                if by_sign
                else {'force_phases': [q + math.pi for q in p.force_phases]}
            ),
        )
        back = InitialConditions(**{k: -v for k, v in initial.as_dict().items()})
        mine, other = Simulator(p, initial), Simulator(mirrored, back)
        events = run(mine, 20.0, 200)
        got = other.advance(mine.time)
        if by_sign:
            assert len(got) == len(events)
        for a, b in list(zip(events, got, strict=False))[: None if by_sign else 3]:
            assert a.kind == b.kind
            assert a.stop == {0: 0, 1: 2, 2: 1}[b.stop]
            have = (b.time, -b.x, -b.y, -b.primary_velocity_after, -b.damper_velocity_after)
            want = (a.time, a.x, a.y, a.primary_velocity_after, a.damper_velocity_after)
            if by_sign:
                assert have == want
            else:
                assert have == pytest.approx(want, rel=1e-8, abs=1e-8)


def test_an_impact_at_the_start_is_reported_once():
    """Also across a snapshot, so that a recording that begins with it can be replayed."""
    initial = InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=1.0)
    rig = Simulator(RigParameters(gravity=0.0), initial)
    other = through_json(rig)
    (first,) = rig.advance(0.0)
    assert (first.kind, first.time, first.stop) == (EventKind.IMPACT, 0.0, 1)
    assert first.damper_velocity_before == 1.0
    assert rig.advance(0.0) == []
    assert other.advance(0.0) == [first]
