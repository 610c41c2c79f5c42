"""Records that are held between samples, against an independent integration and closed forms."""

import json
import math

import numpy as np
import pytest
import scipy
from rigs import UNFORCED

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.measured.record import MeasuredRecord
from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import RECORDED, STORED
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.rig_parameters import InitialConditions
from impact_damper_ros.rig.order import Order

BENCH = UNFORCED.replace(restitution_2=0.7)
#: The state at the origin of a flight
ORIGIN = (*STORED[:21], *RECORDED)
MOVING = InitialConditions(initial_damper_velocity=0.3)
FRICTION = {'friction': 0.02, 'angle': 0.1}


def noise(quantity, seconds=3.0, rate=50.0, seed=1):
    """Return a record of smoothed noise, strong enough for an impact now and then."""
    times = np.arange(0.0, seconds, 1.0 / rate)
    values = np.convolve(np.random.default_rng(seed).normal(size=len(times)), np.ones(3), 'same')
    return MeasuredRecord(quantity, times, values * (3.0 if quantity == 'force' else 1.5), 'n.csv')


class Reference:
    """DOP853 from step to step of a record, by absolute or relative coordinates, with events."""

    def __init__(self, rig, record, state, relative):
        self.rig, self.relative = rig, relative
        starts, values = record.steps()
        self.pieces = list(zip(starts, [*starts[1:], math.inf], values, strict=True))
        self.base = record.quantity == 'base'
        self.grip = rig.friction * rig.gravity * math.cos(rig.angle)
        self.slope = rig.gravity * math.sin(rig.angle)
        self.state, self.direction = np.array(state, float), math.copysign(1.0, state[3])
        self.events = []

    def rates(self, since, held, place, speed):
        p = self.rig

        def of(time, y):
            x, v, _, u = y
            rub = self.direction * self.grip
            if not self.base:
                pull = -p.stiffness * x - p.damping * v + held
                return [v, (pull + p.damper_mass * rub) / p.primary_mass, u, self.slope - rub]
            if self.relative:
                pull = -p.stiffness * x - p.damping * v
                own = (pull + p.damper_mass * rub) / p.primary_mass - held
                return [v, own, u, self.slope - rub - held]
            after = time - since
            b, rate = place + after * (speed + 0.5 * held * after), speed + held * after
            pull = p.stiffness * (b - x) + p.damping * (rate - v)
            return [v, (pull + p.damper_mass * rub) / p.primary_mass, u, self.slope - rub]

        return of

    def to(self, end):
        """Return X, X', Z and Z' at a time, absolute, and the events: instant, stop, X."""
        place = speed = 0.0
        for since, until, held in self.pieces:
            self.go(since, min(until, end), self.rates(since, held, place, speed))
            span = min(until, end) - since
            if self.base:
                place, speed = place + span * (speed + 0.5 * held * span), speed + held * span
            if end <= until:
                break
        carried = np.array([place, speed] * 2) if self.relative else 0.0
        return self.state + carried, self.events

    def go(self, time, end, rates):
        half = 0.5 * self.rig.gap
        watched = [
            lambda _, y: half - (y[2] - y[0]),
            lambda _, y: half + (y[2] - y[0]),
            lambda _, y: y[3] - y[1],
        ]
        for function in watched[:2]:
            function.terminal, function.direction = True, -1
        watched[2].terminal, watched[2].direction = True, -self.direction
        while time < end:
            watched[2].direction = -self.direction
            used = watched if self.grip else watched[:2]
            found = scipy.integrate.solve_ivp(
                rates, (time, end), self.state, 'DOP853', rtol=1e-12, atol=1e-14, events=used
            )
            self.state, time = found.y[:, -1].copy(), found.t[-1]
            if found.status == 0:
                return
            kind = [len(times) > 0 for times in found.t_events].index(True)
            x, v, z, u = self.state
            if kind < 2:
                p, pace = self.rig, u - v
                bounce = (p.restitution_1, p.restitution_2)[kind]
                v += p.damper_mass / (p.primary_mass + p.damper_mass) * (1.0 + bounce) * pace
                self.state = np.array([x, v, z, v - bounce * pace])
                self.direction = -math.copysign(1.0, pace)
            else:
                need = rates(time, [x, v, z, v])
                assert abs(need[1] - need[3]) > 0.1, 'the reference does not stick'
                self.direction = -self.direction
            self.events.append((time, kind + 1 if kind < 2 else 0))


@pytest.mark.parametrize(
    ('quantity', 'relative'), [('force', False), ('base', False), ('base', True)]
)
@pytest.mark.parametrize('more', [{'friction': 0.0}, FRICTION], ids=['smooth', 'friction'])
def test_an_independent_integration(quantity, relative, more):
    parameters, record = BENCH.replace(**more), noise(quantity)
    rig = Rig(parameters, MOVING, records=[record])
    end = 1.6
    found = rig.run(end, [end])
    expected, events = Reference(parameters, record, (0.0, 0.0, 0.0, 0.3), relative).to(end)
    sample = found.samples[0]
    got = [sample[n] for n in ('x', 'primary_velocity', 'z', 'damper_velocity')]
    assert len(events) > 8
    assert found.events['stop'].tolist() == [stop for _, stop in events]
    assert found.events['time'] == pytest.approx([time for time, _ in events], abs=1e-10)
    assert got == pytest.approx(expected, abs=1e-10)


def test_the_base_is_the_integral():
    """Under a constant acceleration M lags by M b''/K, and the base is a parabola."""
    times = np.linspace(0.0, 60.0, 601)
    record = MeasuredRecord('base', times, np.full(601, 0.5), 'c.csv')
    parameters = BENCH.replace(damping=60.0, one_sided=True, gap=1e6)
    rig = Rig(parameters, records=[record])
    rig.advance(50.0)
    sample = rig.sample()
    assert sample.base == pytest.approx(0.25 * 50.0**2, rel=1e-13)
    assert sample.base_velocity == pytest.approx(25.0, rel=1e-13)
    assert sample.x - sample.base == pytest.approx(-2.0 * 0.5 / 1974.0, rel=1e-9)
    assert rig.drive()[1] == pytest.approx(0.5)
    # Nothing holds m in space.
    assert (sample.z, sample.damper_velocity) == pytest.approx((0.0, 0.0), abs=1e-9)
    rig.advance(70.0)
    assert rig.sample().base_velocity == pytest.approx(0.5 * (60.0 + 0.05), rel=1e-13)


@pytest.mark.parametrize('quantity', ['force', 'base'])
def test_the_error_is_of_the_second_order(quantity):
    """A sine, sampled ever finer, comes to the harmonic of the parameters."""
    omega, size = 20.0, 0.7
    lines = {f'{quantity}_{n}': v for n, v in (('amplitudes', size), ('frequencies', omega))}
    parameters = BENCH.replace(gap=1.0, **lines)
    exact = Rig(parameters)
    exact.advance(1.0)
    # That base starts with a velocity of its own.
    start = -size / omega if quantity == 'base' else 0.0
    expected = exact.sample()
    errors = []
    for rate in (100.0, 200.0, 400.0):
        times = np.arange(0.0, 1.2, 1.0 / rate)
        initial = InitialConditions(
            initial_primary_velocity=-start, initial_damper_velocity=-start
        )
        record = MeasuredRecord(quantity, times, size * np.sin(omega * times), 's.csv')
        rig = Rig(BENCH.replace(gap=1.0), initial, records=[record])
        rig.advance(1.0)
        found = rig.sample()
        errors.append(abs((found.x - found.base) - (expected.x - expected.base)))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)
    assert errors[2] < 2e-5


@pytest.mark.parametrize('quantity', ['force', 'base'])
def test_the_motion_does_not_depend_on_samples_pieces_or_code(quantity):
    parameters, record = BENCH.replace(**FRICTION), noise(quantity, 1.0)

    def at_end(instants, **how):
        rig = Rig(parameters, MOVING, records=[record], **how)
        events = [event for instant in instants for event in rig.advance(instant)]
        return rig.sample(), [getattr(rig.state().run, name) for name in ORIGIN], events

    once = at_end([1.5])
    assert len(once[2]) > 5
    assert at_end(np.linspace(0.0, 1.5, 77)[1:]) == once
    pytest.importorskip('numba')
    assert at_end([0.3, 1.5], compiled=True) == once


def test_going_back_and_reset():
    parameters, record = BENCH.replace(**FRICTION), noise('base', 0.6)
    rig = Rig(parameters, MOVING, records=[record])
    rig.advance(0.2)
    mark = rig.mark()
    first = rig.advance(1.0), rig.sample()
    rig.go_back(mark)
    assert (rig.advance(1.0), rig.sample()) == first
    rig.reset(MOVING)
    again = [event.time - 1.0 for event in rig.advance(1.9)]
    fresh = Rig(parameters, MOVING, records=[record])
    assert again == pytest.approx([event.time for event in fresh.advance(0.9)], abs=1e-9)


def test_a_step_releases_m():
    """Friction holds m until the base is accelerated by more than friction can give it."""
    parameters = BENCH.replace(friction=0.1, gravity=10.0)
    times = np.arange(0.0, 1.0, 0.1)
    values = np.where(times < 0.45, 0.0, 3.0)
    rig = Rig(parameters, records=[MeasuredRecord('base', times, values, 'b.csv')])
    events = rig.advance(0.6)
    assert events[0].kind is EventKind.RELEASE
    # Halfway between the samples at 0.4 and 0.5 s the base begins to move, M and m do not.
    force = Rig(parameters, records=[MeasuredRecord('force', times, 10.0 * values, 'f.csv')])
    release = force.advance(0.6)[0]
    assert (release.kind, release.time) == (EventKind.RELEASE, 0.45)


def test_records_beside_each_other_and_orders():
    """A force record, one of the base and the force of a controller add up."""
    parameters = BENCH.replace(gap=1.0)
    external = GapControlParameters(gap_control='external', gap_min=1e-3)
    times = np.arange(0.0, 1.0, 0.1)
    push = [MeasuredRecord('force', times, np.full(10, 3.0), 'f.csv')]
    both = Rig(parameters, control=external, records=push)
    both.order(Order(force=2.0))
    assert (both.force, both.drive()) == (2.0, (5.0, pytest.approx(2.5)))
    both.advance(1.5)
    assert both.drive()[0] == 2.0
    plain = Rig(parameters, control=external)
    plain.order(Order(force=5.0))
    plain.advance(0.9)
    again = Rig(parameters, control=external, records=push)
    again.order(Order(force=2.0))
    again.advance(0.9)
    assert again.sample().x == pytest.approx(plain.sample().x, rel=1e-12)
    # An inertia of -M b'' is the same as a force on M, if m is not there to feel it.
    pushed = Rig(parameters, records=push)
    shaken = Rig(parameters, records=[MeasuredRecord('base', times, np.full(10, -1.5), 'b.csv')])
    for rig in (pushed, shaken):
        rig.advance(0.7)
    sample = shaken.sample()
    assert sample.x - sample.base == pytest.approx(pushed.sample().x, rel=1e-12)


def test_the_event_of_an_order_counts_from_a_fixed_place():
    """Not from the base, which a record carries along."""
    external = GapControlParameters(gap_control='external', gap_min=1e-3)
    rig = Rig(BENCH.replace(gap=1.0), MOVING, control=external, records=[noise('base')])
    rig.advance(0.73)
    sample = rig.sample()
    assert min(abs(sample.base), abs(sample.base_velocity)) > 1e-3
    (step,) = rig.order(Order(force=2.0))
    assert (step.time, step.x, step.y) == (0.73, sample.x, pytest.approx(sample.z - sample.x))
    for name in ('primary', 'damper'):
        for side in ('before', 'after'):
            speed = getattr(sample, f'{name}_velocity')
            assert getattr(step, f'{name}_velocity_{side}') == pytest.approx(speed, rel=1e-12)


@pytest.mark.parametrize('quantity', ['force', 'base'])
def test_a_snapshot_has_a_copy_of_the_record(quantity):
    """A rig goes on from JSON to the last bit: in the middle of a sample, at a step, after all."""
    rig = Rig(BENCH.replace(**FRICTION), MOVING, records=[noise(quantity, 1.0)])
    for instant in (0.2345, 0.25, 1.2):
        rig.advance(instant)
        other = Rig.restore(json.loads(json.dumps(rig.snapshot())))
        assert other.snapshot() == rig.snapshot()
        expected = Rig.restore(rig.snapshot())
        for later in (instant, instant + 0.01, 1.5):
            assert other.advance(later) == expected.advance(later)
            assert other.sample() == expected.sample()
    rig.advance(1.5)
    assert other.sample() == rig.sample()


def altered(held, **values):
    return {**held, 'records': [{**held['records'][0], **values}]}


@pytest.mark.parametrize(
    ('values', 'problem'),
    [
        ({'digest': '00'}, 'is damaged: its digest'),
        ({'values': 'A'}, 'cannot be expanded'),
        ({'times': '<'}, 'cannot be expanded'),
        ({'quantity': 'gap'}, 'digest'),
        ({'start': 5.0}, 'records.start is 5.0'),
        ({'start': 'now'}, "records.start is 'now'"),
    ],
)
def test_altered_snapshots(values, problem):
    rig = Rig(BENCH, records=[noise('force', 1.0)])
    with pytest.raises(ValueError, match=problem):
        Rig.restore(altered(rig.snapshot(), **values))


@pytest.mark.parametrize('seed', range(12))
def test_compiled_records_have_the_bits_of_plain_ones(seed):
    """Random rigs of all kinds, with and without friction, elastic to plastic, from 50 Hz on."""
    random = np.random.default_rng(seed)
    omega = random.uniform(5.0, 60.0)
    parameters = RigParameters(
        primary_mass=1.0,
        stiffness=omega**2,
        damping=2.0 * omega * 10.0 ** random.uniform(-3.0, -0.5),
        damper_mass=10.0 ** random.uniform(-3.0, 0.0),
        gap=10.0 ** random.uniform(-3.0, -1.0),
        restitution_1=random.choice([0.0, 0.3, 0.9]),
        restitution_2=random.uniform(),
        friction=random.choice([0.0, 0.01, 0.5]),
        angle=random.choice([0.0, 0.1, 1.5708]),
        one_sided=bool(random.uniform() < 0.2),
        force_amplitudes=random.choice([0.0, 1.0]),
        force_frequencies=random.uniform(3.0, 80.0),
    )
    times = np.arange(0.0, 0.6, 1.0 / random.uniform(50.0, 1000.0))
    sizes = 10.0 ** random.uniform(-1.0, 1.5, size=(2, 1)) * random.normal(size=(2, len(times)))
    records = [
        MeasuredRecord(quantity, times, values, 'r.csv')
        for quantity, values in zip(('force', 'base'), sizes, strict=True)
    ]

    pytest.importorskip('numba')
    plain, compiled = (Rig(parameters, records=records, compiled=way) for way in (False, True))
    one, other = (
        rig.run(0.7, np.linspace(0.0, 0.7, 20), most_events=5000) for rig in (plain, compiled)
    )
    assert one.outcome == other.outcome
    assert plain.snapshot() == compiled.snapshot()
    assert one.events.tobytes() == other.events.tobytes()
    assert one.samples.tobytes() == other.samples.tobytes()
