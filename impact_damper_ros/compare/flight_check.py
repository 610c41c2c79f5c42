"""
Check of a log against the equations of motion of the logged rig, and diagnosis of faults.

From each knot (joint state or impact) the closed-form motion of the logged rig predicts the next
one, which must agree up to the rounding of the stamps. A wrong number is thus located exactly, in
any motion, and does not affect the check of what follows.

Intervals in which m turns, or starts or stops resting, are simulated event by event. If a knot
does not follow from the one before, the rig is simulated from the last sound joint state before
the fault to the first one after it. If it reaches that state, a message is wrong, missing or
surplus, and the simulation gives the difference. Otherwise the rig was changed without a log
entry.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.flights import flight_at, machine_of
from impact_damper_ros.orbits.trajectory import Trajectory, follow_trajectory
from impact_damper_ros.rig import Event, EventKind, RigParameters
from impact_damper_ros.rig.state import REST_1, REST_2, STICK, place

from .recorded_stretch import ForceClock, Knots, RecordedImpacts, largest_size
from .result import Array

_Complex = NDArray[np.complex128]


# All intervals at once, in closed form


def _primary_ends(
    clock: ForceClock, begin: Knots, tau: Array, support: Array, *, joint: bool
) -> tuple[Array, Array]:
    """Return X and X' of M, alone or with m, after times `tau`, with a force of m on M."""
    rig = clock.parameters
    mass = rig.primary_mass + (rig.damper_mass if joint else 0.0)
    constant: Array | float = support / rig.stiffness
    if joint:
        constant = rig.damper_mass * rig.gravity * math.sin(rig.angle) / rig.stiffness
    decay = 0.5 * rig.damping / mass
    frequency = math.sqrt(rig.stiffness / mass - decay * decay)
    root = complex(-decay, frequency)
    free: _Complex = np.exp(root * tau)
    impulse = free.imag / frequency
    step = free.real + decay * impulse
    rate = free.real - decay * impulse
    x, velocity = begin.x - constant, begin.velocity
    end = constant + x * step + velocity * impulse
    end_velocity = velocity * rate - rig.stiffness / mass * x * impulse
    angles = clock.angles_at(begin.time)
    amplitudes, frequencies, _ = rig.harmonics
    for j, (force, drive) in enumerate(zip(amplitudes, frequencies, strict=True)):
        if force == 0.0:
            continue
        response, response_rate = _from_rest(root, free, tau, drive)
        turned = force / mass * np.exp(1j * angles[j])
        end = end + (turned * response).imag
        end_velocity = end_velocity + (turned * response_rate).imag
    return end, end_velocity


def _from_rest(
    root: complex, free: _Complex, tau: Array, drive: float
) -> tuple[_Complex, _Complex]:
    """
    Return the response from rest to exp(i W tau), and its rate.

    It is the divided difference of exp over the eigenvalues and i W: nothing cancels at resonance.
    """
    beat = 1j * drive - root
    if abs(beat) * float(tau.max(initial=0.0)) > 0.0:
        first = free * np.expm1(beat * tau) / beat
    else:
        first = free * tau
    other = root.conjugate()
    second = free.conj() * np.expm1((1j * drive - other) * tau) / (1j * drive - other)
    response = (first - second) / (root - other)
    rate = (root * first - other * second) / (root - other)
    return response, rate


def _flown(clock: ForceClock, knots: Knots) -> tuple[list[Array], NDArray[np.bool_]]:
    """Return X, X', Z and Z' at the end of each interval, and which intervals are plain."""
    rig = clock.parameters
    begin, end = knots[:-1], knots[1:]
    tau = end.time - begin.time
    relative = begin.damper_velocity - begin.velocity
    later = end.damper_velocity_before - end.velocity_before
    rest, later_rest = relative == 0.0, later == 0.0
    plain, joint = rest == later_rest, rest & later_rest
    direction, air = np.zeros(len(relative)), begin.air_direction
    if rig.friction * rig.gravity > 0.0:
        plain &= relative * later >= 0.0
        direction = np.sign(relative)
    grip = rig.damper_mass * rig.friction * rig.gravity * math.cos(rig.angle)
    support = grip * direction - rig.air_force * air
    x, velocity = np.empty_like(tau), np.empty_like(tau)
    for together in (False, True):
        rows = joint == together
        if rows.any():
            x[rows], velocity[rows] = _primary_ends(
                clock, begin[rows], tau[rows], support[rows], joint=together
            )
    slope = rig.gravity * math.sin(rig.angle)
    friction = rig.friction * rig.gravity * math.cos(rig.angle)
    push = rig.air_force / rig.damper_mass
    acceleration = slope - friction * direction + push * air
    damper_velocity = begin.damper_velocity + acceleration * tau
    z = begin.z + tau * (begin.damper_velocity + 0.5 * acceleration * tau)
    z = np.where(joint, begin.z + (x - begin.x), z)
    damper_velocity = np.where(joint, velocity, damper_velocity)
    return [x, velocity, z, damper_velocity], plain


_STAMP_S = 0.5e-9
_MARGIN = 4.0
_ROUND_OFF = 1e-11
_TIME_EPSILON = 4.5e-16


@dataclass(frozen=True)
class Intervals:
    """The intervals from each of n knots to the next."""

    #: Recorded less expected X, X', Z, Z' just before the next knot, m and m/s, shape (n - 1, 4).
    residuals: Array
    #: Largest residuals of the four that the rounding of stamps and numbers explains.
    tolerances: Array
    #: Whether the closed form applies: no reversal, start or end of rest in the interval.
    plain: NDArray[np.bool_]
    sound: NDArray[np.bool_]  # whether it applies and agrees


def _tolerances(parameters: RigParameters, knots: Knots) -> Array:
    length = largest_size(knots.x, knots.z)
    speed = largest_size(knots.velocity, knots.damper_velocity)
    force = sum(abs(amplitude) for amplitude in parameters.harmonics[0])
    length += force / parameters.stiffness
    # Subtracted from the positions, whose last digits it takes
    length += 1e-4 * abs(parameters.static_deflection)
    own = parameters.gravity + parameters.air_force / parameters.damper_mass
    push = force + parameters.stiffness * length + parameters.damping * speed
    acceleration = (push + parameters.damper_mass * own) / parameters.primary_mass
    stamp = 2.0 * _STAMP_S + _TIME_EPSILON * float(np.abs(knots.time).max(initial=0.0))
    return _MARGIN * np.array(
        [
            stamp * speed + _ROUND_OFF * length,
            stamp * acceleration + _ROUND_OFF * speed,
            stamp * speed + _ROUND_OFF * length,
            stamp * max(own, acceleration) + _ROUND_OFF * speed,
        ]
    )


def check_intervals(clock: ForceClock, knots: Knots) -> Intervals:
    """Compare each recorded knot with the motion from the knot before it."""
    # Wrong numbers may be as large as numbers are.
    with np.errstate(over='ignore', invalid='ignore'):
        ends, plain = _flown(clock, knots)
        later = knots[1:]
        recorded = (later.x, later.velocity_before, later.z, later.damper_velocity_before)
        residuals = np.column_stack([a - b for a, b in zip(recorded, ends, strict=True)])
    tolerances = _tolerances(clock.parameters, knots)
    # NaN is not sound.
    within = (np.abs(residuals) <= tolerances).all(axis=1)
    return Intervals(residuals, tolerances, plain, plain & within)


# One interval, event by event


#: A stamp is rounded to the nanosecond; an impact may come so much later.
_ROUNDED_S = 2e-9
_WEAK = 1e-3
#: Products of larger numbers, which only a wrong log holds, are not finite.
_LARGEST = 1e100
_RELATIVE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0]]
)


class _SimulatedRig:
    """Simulates the logged rig between knots; its stops are in their places."""

    def __init__(self, clock: ForceClock) -> None:
        self.rig = clock.counted_from_zero()
        self._clock = clock
        self._machine = machine_of(self.rig)
        self._half = self._machine.constants.half_gap

    def _resting_place(self, y: float) -> int:
        """Return the stop that m is at, 0 for none, by Y in m."""
        if math.isclose(y, self._half, rel_tol=1e-9):
            return 1
        return 2 if math.isclose(y, -self._half, rel_tol=1e-9) and not self.rig.one_sided else 0

    def trajectory(self, knots: Knots, first: int, duration: float) -> Trajectory | None:
        """Return the motion from just after a knot on."""
        x, z = float(knots.x[first]), float(knots.z[first])
        velocity = float(knots.velocity[first])
        relative = float(knots.damper_velocity[first]) - velocity
        if not max(abs(x), abs(z), abs(velocity), abs(relative)) < _LARGEST:
            return None
        stop = int(knots.stop[first]) or self._resting_place(z - x)
        beyond = z - x - self._half
        if knots.stop[first]:
            beyond = 0.0 if stop == 1 else -2.0 * self._half
        resting = {0: STICK, 1: REST_1, 2: REST_2}[stop] if relative == 0.0 else 0
        flight = flight_at(
            self._machine,
            float(knots.time[first]) - self._clock.zero,
            x,
            velocity,
            beyond,
            relative,
            resting,
            int(knots.last_stop[first]),
        )
        try:
            return follow_trajectory(flight, duration)
        except ArithmeticError:
            # With a wrong number of the log the rig may be impossible.
            return None

    def out_of_reach(self, knots: Knots, first: int, last: int) -> bool:
        """Return whether a stop that follows m is not yet in its place."""
        y = np.abs(knots.z[[first, last]] - knots.x[[first, last]])
        beyond = y > self._half * (1.0 + 1e-9)
        return not self.rig.one_sided and bool((beyond & (knots.touched[[first, last]] > 0)).any())

    def next_knot(self, knots: Knots, first: int) -> Array | None:
        """Return X, X', Z and Z' just before the next knot; None if other impacts come first."""
        last = first + 1
        duration = float(knots.time[last] - knots.time[first])
        at_impact = knots.stop[last] > 0.0
        trajectory = self.trajectory(knots, first, duration + (_ROUNDED_S if at_impact else 0.0))
        if trajectory is None:
            return None
        hits = [i for i in trajectory.events if i.kind is EventKind.IMPACT]
        speed = max(abs(float(knots.velocity[first])), abs(float(knots.damper_velocity[first])))
        # The weak impacts that end a chatter are not in the log.
        strong = [
            hit
            for hit in hits
            if abs(hit.damper_velocity_before - hit.primary_velocity_before) > _WEAK * speed
        ]
        if not at_impact:
            return None if strong else _state_of(trajectory)
        there = [hit for hit in hits if hit.time >= duration - _ROUNDED_S]
        if any(hit.time < duration - _ROUNDED_S for hit in strong) or not there:
            return None
        hit = there[0]
        if hit.stop != int(knots.stop[last]):
            return None
        z = hit.x + (self._half if hit.stop == 1 else -self._half)
        return np.array([hit.x, hit.primary_velocity_before, z, hit.damper_velocity_before])


def _state_of(trajectory: Trajectory) -> Array:
    """Return X, X', Z and Z' at the end."""
    end = trajectory.end.run
    state: Array = _RELATIVE @ np.array([end.x, end.velocity, place(end), end.relative_velocity])
    return state


def _before(knots: Knots, knot: int) -> Array:
    """Return X, X', Z and Z' just before a knot."""
    columns = (knots.x, knots.velocity_before, knots.z, knots.damper_velocity_before)
    return np.array([column[knot] for column in columns])


def _reaches(trajectory: Trajectory, knots: Knots, last: int, tolerances: Array) -> bool:
    """Return whether a simulated motion ends at a joint state, within round-off."""
    missed = _before(knots, last) - _state_of(trajectory)
    scale = np.array(
        [
            max(abs(float(knots.x[last])), abs(float(knots.z[last]))),
            max(abs(float(knots.velocity[last])), abs(float(knots.damper_velocity[last]))),
        ]
    )
    grown = np.abs(trajectory.matrix) @ (1e-14 * np.tile(scale, 2))
    return bool((grown < tolerances).all()) and bool((np.abs(missed) <= tolerances).all())


# Faults


#: Intervals that are followed event by event in a stretch, and troubles that are looked into.
_MOST_FOLLOWED = 4000
_MOST_TROUBLES = 200
_MOST_UNEXPLAINED = 25
_LONGEST_TROUBLE = 100_000
_LATEST_S = 1.1e-9
_QUANTITIES = (('X', 'm'), ("X'", 'm/s'), ('Z', 'm'), ("Z'", 'm/s'))


@dataclass(frozen=True)
class Fault:
    """A number or a message of a log that is not as expected."""

    #: 'impact' for a value of an impact, 'missing' or 'surplus' for an impact, 'motion' where one
    #: knot does not follow from the one before.
    kind: str
    quantity: str
    unit: str
    stop: int  # of the impact, or 0
    time: float  # expected instant, or that of the first knot that does not follow, rig time, s
    recorded: float = math.nan  # NaN for a message
    expected: float = math.nan
    tolerance: float = math.nan


@dataclass(frozen=True)
class Repair:
    """The impacts that should be in a log from just after `start` to `end`, s."""

    start: float
    end: float
    impacts: RecordedImpacts


class FaultSearch:
    """
    Checks a stretch, part by part.

    With `in_closed_form`, intervals are not followed event by event, since a control moves the
    stops or the force is a multisine; then unsound intervals are only counted.
    """

    def __init__(self, clock: ForceClock, *, in_closed_form: bool = False) -> None:
        self.faults: list[Fault] = []
        self.repairs: list[Repair] = []
        # Intervals seen; checked in closed form; followed event by event; not sound at first sight
        self.intervals = self.plain = self.followed = self.unsound = 0
        # Troubles after which the rig is not where the simulated one is
        self.unexplained = 0
        self.in_closed_form = in_closed_form
        self._clock = clock
        self._rig = _SimulatedRig(clock)
        self._held: Knots | None = None
        self._troubles = 0

    def take(self, knots: Knots, *, final: bool = False) -> None:
        """Check the next knots."""
        if self._held is not None:
            knots = Knots.joined([self._held, knots])
        self._held = None
        if len(knots) < 2:
            self._held = knots
            return
        found = check_intervals(self._clock, knots)
        end = len(knots) - 1
        unsound = found.plain & ~found.sound
        if not self.in_closed_form:
            wrong = self._wrong_intervals(knots, found)
            for first, last in _troubles(wrong, knots.stop == 0.0):
                if last == end and not final and end - first < _LONGEST_TROUBLE:
                    # The fault may extend into the next part.
                    end = first
                    break
                self._look_into(knots, first, last, wrong, found)
        else:
            self._single_out(knots, found)
        self.intervals += end
        self.plain += int(found.plain[:end].sum())
        self.unsound += int(unsound[:end].sum())
        self._held = knots[end:]

    def _single_out(self, knots: Knots, found: Intervals) -> None:
        """Find joint states that do not fit, while those around them fit together."""
        doubtful = ~found.sound
        unsound = found.plain & doubtful
        between = (doubtful[:-1] & doubtful[1:]) & (unsound[:-1] | unsound[1:])
        places = np.flatnonzero(between & (knots.stop[1:-1] == 0.0)) + 1
        if not len(places) or len(places) > _MOST_FOLLOWED:
            return
        around = np.column_stack([places - 1, places + 1]).ravel()
        fits = check_intervals(self._clock, knots[around]).sound[::2]
        for knot in places[fits]:
            if self.unexplained < _MOST_UNEXPLAINED:
                first = int(knot) - 1
                self._unexplained(knots, first if found.plain[first] else first + 1, found)

    def _wrong_intervals(self, knots: Knots, found: Intervals) -> NDArray[np.bool_]:
        """Return the intervals that miss their next knot even if simulated event by event."""
        wrong = found.plain & ~found.sound
        doubtful = np.flatnonzero(~found.sound)
        if wrong.sum() > _MOST_FOLLOWED:
            return wrong
        for index in doubtful:
            first = int(index)
            if self._rig.out_of_reach(knots, first, first + 1):
                # A reversal in between cannot be found out.
                wrong[first] = False
                continue
            if self.followed >= _MOST_FOLLOWED:
                continue
            self.followed += not found.plain[first]
            expected = self._rig.next_knot(knots, first)
            if expected is None:
                wrong[first] = True
                continue
            off = np.abs(_before(knots, first + 1) - expected)
            wrong[first] = not bool((off <= _MARGIN * found.tolerances).all())
        return wrong

    def _look_into(
        self, knots: Knots, first: int, last: int, wrong: NDArray[np.bool_], found: Intervals
    ) -> None:
        """Simulate the rig from one joint state to another; the knots between are in doubt."""
        if self._troubles >= _MOST_TROUBLES or self.unexplained >= _MOST_UNEXPLAINED:
            return
        self._troubles += 1
        duration = float(knots.time[last] - knots.time[first])
        trajectory = None
        if self._rig.rig.one_sided or not self._rig.out_of_reach(knots, first, last):
            trajectory = self._rig.trajectory(knots, first, duration)
        if trajectory is not None and _reaches(
            trajectory, knots, last, _MARGIN * found.tolerances
        ):
            self._compare(trajectory, knots, first, last, found)
        else:
            self._unexplained(knots, first + int(np.argmax(wrong[first:last])), found)

    def _compare(
        self, trajectory: Trajectory, knots: Knots, first: int, last: int, found: Intervals
    ) -> None:
        """Compare the recorded impacts between two knots with the simulated ones."""
        start = float(knots.time[first])
        hits = [i for i in trajectory.events if i.kind is EventKind.IMPACT]
        rows = [k for k in range(first + 1, last + 1) if knots.stop[k] > 0.0]
        faults: list[Fault] = []
        for row, hit in _pairs(knots, rows, hits, start):
            if row is not None and hit is not None:
                faults += self._differences(knots, row, hit, start, found)
            elif hit is not None:
                faults.append(_message('missing', hit.stop, start + hit.time))
            elif row is not None:
                faults.append(_message('surplus', int(knots.stop[row]), float(knots.time[row])))
        if not faults:
            # A joint state between them is wrong.
            self._unexplained(knots, first, found)
            return
        self.faults += faults
        self.repairs.append(Repair(start, float(knots.time[last]), self._expected(hits, start)))

    def _differences(
        self, knots: Knots, row: int, hit: Event, start: float, found: Intervals
    ) -> Iterator[Fault]:
        tol_x, tol_v, _, tol_w = (_MARGIN * float(t) for t in found.tolerances)
        mass = self._rig.rig.primary_mass
        before = float(knots.velocity[row] - knots.velocity_before[row])
        impulse = mass * (hit.primary_velocity_after - hit.primary_velocity_before)
        stamp = _LATEST_S + _TIME_EPSILON * abs(start)
        damper = float(knots.damper_velocity[row])
        for quantity, unit, recorded, expected, tolerance in (
            ('instant', 's', float(knots.time[row]), start + hit.time, stamp),
            ('X', 'm', float(knots.x[row]), hit.x, tol_x),
            ("X' after", 'm/s', float(knots.velocity[row]), hit.primary_velocity_after, tol_v),
            ("Z' after", 'm/s', damper, hit.damper_velocity_after, tol_w),
            ('impulse', 'N s', mass * before, impulse, mass * tol_v),
        ):
            if not abs(recorded - expected) <= tolerance:
                time = start + hit.time
                yield Fault(
                    'impact', quantity, unit, hit.stop, time, recorded, expected, tolerance
                )

    def _expected(self, hits: Sequence[Event], start: float) -> RecordedImpacts:
        if not hits:
            return RecordedImpacts.none()
        rig = self._rig.rig
        half = 0.5 * rig.gap
        impulses = [
            rig.primary_mass * (h.primary_velocity_after - h.primary_velocity_before) for h in hits
        ]
        columns = [
            [start + h.time for h in hits],
            [float(h.stop) for h in hits],
            [h.x for h in hits],
            [h.x + (half if h.stop == 1 else -half) for h in hits],
            [h.primary_velocity_after for h in hits],
            [h.damper_velocity_after for h in hits],
            impulses,
            [-impulse for impulse in impulses],
        ]
        return RecordedImpacts(*(np.array(column) for column in columns))

    def _unexplained(self, knots: Knots, index: int, found: Intervals) -> None:
        """Add the largest residual at the end of an interval as a fault."""
        self.unexplained += 1
        time = float(knots.time[index + 1])
        if not found.plain[index]:
            self.faults.append(_message('motion', 0, time))
            return
        residuals = found.residuals[index]
        shares = np.nan_to_num(np.abs(residuals) / found.tolerances, nan=np.inf)
        worst = int(np.argmax(shares))
        recorded = float(_before(knots, index + 1)[worst])
        expected = recorded - float(residuals[worst])
        tolerance = float(found.tolerances[worst])
        self.faults.append(
            Fault('motion', *_QUANTITIES[worst], 0, time, recorded, expected, tolerance)
        )


def _message(kind: str, stop: int, time: float) -> Fault:
    return Fault(kind, 'impact', '', stop, time)


def _troubles(wrong: NDArray[np.bool_], samples: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield the joint states, or ends, around each group of wrong intervals."""
    places = np.flatnonzero(samples)
    end = len(wrong)
    reached = 0
    for index in np.flatnonzero(wrong):
        if index < reached:
            continue
        before = int(np.searchsorted(places, index, side='right')) - 1
        first = int(places[before]) if before >= 0 else 0
        last = int(index) + 1
        while True:
            after = int(np.searchsorted(places, last))
            last = int(places[after]) if after < len(places) else end
            # A single joint state on the wrong side of a shifted impact is not sound.
            if last >= end or not wrong[last]:
                break
            last += 1
        yield max(first, reached), last
        reached = last


def _pairs(
    knots: Knots, rows: Sequence[int], hits: Sequence[Event], start: float
) -> Iterator[tuple[int | None, Event | None]]:
    """Yield pairs of recorded and expected impacts; None for a missing counterpart."""
    if [int(knots.stop[row]) for row in rows] == [hit.stop for hit in hits]:
        yield from zip(rows, hits, strict=True)
        return
    left, due = list(rows), list(hits)
    while left and due:
        row, hit = left[0], due[0]
        same = int(knots.stop[row]) == hit.stop
        late = float(knots.time[row]) - (start + hit.time)
        if same and (len(left) == len(due) or abs(late) <= _LATEST_S):
            yield left.pop(0), due.pop(0)
        elif len(left) > len(due):
            yield left.pop(0), None
        else:
            yield None, due.pop(0)
    yield from ((row, None) for row in left)
    yield from ((None, hit) for hit in due)
