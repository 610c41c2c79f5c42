"""
The kind of motion of a stretch: without impacts, periodic, quasi-periodic, chaotic.

A recording may end before its motion has settled. The logged rig is then run ahead by the exact
simulator from its last impact, for many times as many cycles, until the motion repeats, the
impacts end, or a bound is reached.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from impact_damper_ros.control import Rig
from impact_damper_ros.control.rig import Events
from impact_damper_ros.orbits.flights import Flight, Machine, flight_at_impact, machine_of
from impact_damper_ros.orbits.irregularity import (
    IRREGULAR_SPREAD,
    REGULAR_SPREAD,
    Indications,
    average_spread,
    zero_one_test,
)
from impact_damper_ros.orbits.lyapunov import growth_exponent
from impact_damper_ros.orbits.multipliers import event_matrices, state_rates
from impact_damper_ros.orbits.recurrence import (
    LONGEST_PERIOD,
    NEAR,
    MotionKind,
    Period,
    Section,
    find_period,
)
from impact_damper_ros.orbits.settled_motion import SettledMotion, settle
from impact_damper_ros.orbits.trajectory import follow_trajectory
from impact_damper_ros.rig import EventKind, RigParameters
from impact_damper_ros.rig.forcing import SteppedSine
from impact_damper_ros.rig.quoting import counted
from impact_damper_ros.rig.snapshot import LATEST, Snapshot

from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates, largest_size

#: A recorded motion nearer to its limit than this, relative to its size, is called settled.
SETTLED = NEAR

# Without impacts


#: Change of Y, as a share of the positions, with which m keeps its place in M.
_KEPT = 1e-9


@dataclass(frozen=True)
class Oscillation:
    """The predicted steady vibration without impacts."""

    x_max: float  # largest |X| of it, m
    joined: bool  # whether m moves with M
    distance: float  # amplitude of the free vibration left in the recorded motion, over x_max
    stop: int  # that m hits in the end, as it does not keep its place; 0 for none
    until: float  # time from the end of the recording to that impact, about, s

    @property
    def settled(self) -> bool:
        """Whether the free vibration has died away, and m will hit no stop."""
        return self.distance <= SETTLED and not self.stop


def _drift(
    rig: RigParameters, offset: float, velocity: float, acceleration: float, swing: float
) -> tuple[int, float]:
    """
    Return the first stop that m hits in free flight, and when, s; 0 for none.

    M vibrates by `swing` about its mean position, from which the `offset` of m counts.
    """
    found = 0, LATEST
    for stop, side in ((1, 1.0), (2, -1.0))[: 1 if rig.one_sided else 2]:
        room = max(0.0, 0.5 * rig.gap - swing - side * offset)
        speed, push = side * velocity, side * acceleration
        # room = speed t + push t^2 / 2, its first root in the form that does not cancel
        root = speed * speed + 2.0 * push * room
        if root < 0.0 or (speed <= 0.0 and push <= 0.0):
            continue
        root = math.sqrt(root)
        time = 2.0 * room / (speed + root) if speed > 0.0 else (root - speed) / push
        if time < found[1]:
            found = stop, time
    return found


def oscillation(
    clock: ForceClock, states: RecordedStates, last_stop: int = 0
) -> Oscillation | None:
    """
    Compare the last joint state with steady vibration; None if m slides with friction.

    `last_stop` is the stop hit last, 0 for none.
    """
    rig = clock.parameters
    y = states.z - states.x
    still = states.damper_velocity == states.velocity
    # Between two joint states m may slide.
    size = largest_size(states.z, states.x) + 1e-4 * abs(rig.static_deflection)
    joined = bool(still.all()) and float(np.ptp(y)) <= _KEPT * size
    if not joined and rig.friction * rig.gravity > 0.0:
        return None
    mass = rig.primary_mass + (rig.damper_mass if joined else 0.0)
    air = rig.air_force * {0: 0.0, 1: -1.0, 2: 1.0}[last_stop]
    slope = rig.gravity * math.sin(rig.angle)
    constant = (rig.damper_mass * slope if joined else -air) / rig.stiffness
    time = states.time[-1:]
    angles = clock.angles_at(time)[:, 0]
    frequencies = np.array(rig.force_frequencies)
    stiffness = rig.stiffness - mass * frequencies**2 + 1j * rig.damping * frequencies
    amplitudes = np.array(rig.force_amplitudes)
    active = amplitudes != 0.0
    if (stiffness[active] == 0.0).any():
        return None
    response = amplitudes[active] / stiffness[active]
    turning = response * np.exp(1j * angles[active])
    x = constant + float(turning.imag.sum())
    velocity = float((1j * frequencies[active] * turning).imag.sum())
    omega = math.sqrt(rig.stiffness / mass)
    left = math.hypot(float(states.x[-1]) - x, (float(states.velocity[-1]) - velocity) / omega)
    # Of several harmonics the sum is a bound; of one it is the amplitude.
    swing = float(np.abs(response).sum())
    x_max = swing + abs(constant)
    distance = left / x_max if x_max > 0.0 else math.inf
    stop, until = 0, math.inf
    if not joined:
        offset, drift = float(states.z[-1]) - constant, float(states.damper_velocity[-1])
        stop, until = _drift(rig, offset, drift, slope + air / rig.damper_mass, swing)
    return Oscillation(x_max, joined, distance, stop, until)


# Impacts that repeat


#: Impacts weaker than this share of the strongest are those of a chatter, and not counted.
NEGLIGIBLE_IMPULSE = 1e-3


def counted_impacts(impacts: RecordedImpacts) -> RecordedImpacts:
    """Return the impacts without the weak ones of chatters, by the second half's strongest."""
    strength = np.abs(impacts.primary_impulse)
    strongest = float(strength[len(impacts) // 2 :].max(initial=0.0))
    return impacts[strength > NEGLIGIBLE_IMPULSE * strongest]


#: What the rounding of stamps makes of a difference of two of them, s, and round-off of states.
_STAMP_S, _ROUND_OFF = 1.5e-9, 1e-12


def impact_section(impacts: RecordedImpacts, zero: float, cycle: float) -> Section:
    """Return impacts for comparison; phases from a zero of the force, s."""
    return Section.of_impacts(
        (impacts.time - zero) / cycle,
        impacts.stop,
        impacts.x,
        impacts.velocity_after,
        impacts.damper_velocity_after,
    )


def period_of(impacts: RecordedImpacts, zero: float, cycle: float) -> Period | None:
    """Find the period of impacts, as far as the rounding of their stamps shows it."""
    floor = _STAMP_S / cycle + _ROUND_OFF
    return find_period(impact_section(impacts, zero, cycle), 0.0, floor)


@dataclass(frozen=True)
class StretchKind:
    """A kind of motion, and the evidence for it."""

    kind: MotionKind
    evidence: str  # the numbers that show it, as a sentence
    measures: Mapping[str, float] = field(default_factory=dict)  # the same numbers by name
    recurrence: Period | None = None  # how the motion repeats
    #: Those that repeat: recorded ones without the weak ones of chatters or, if `ahead`, of
    #: the rig that is run ahead from the end of a motion that does not repeat yet.
    impacts: RecordedImpacts = field(default_factory=RecordedImpacts.none)
    ahead: bool = False
    short: bool = False  # whether a longer recording may decide


# The rig run ahead from its last impact


#: Cycles for each recorded one, and the least and the most of them. More are run if more were
#: recorded, up to the last number.
_TIMES_RECORDED, _LEAST, _MOST, _MOST_OF_ALL = 30, 400, 2000, 5000
#: Events are what costs time: some 0.15 ms each in plain Python.
_MOST_EVENTS, _MOST_EVENTS_OF_ALL = 8000, 20_000
_BETWEEN_LOOKS = 100
#: Cycles without an impact after which the impacts have ended.
_QUIET = 200
#: The first part of the cycles, not measured as a transient, and the least that are measured.
_LEFT_OUT, _LEAST_MEASURED = 4, 100
#: Impacts that are searched for a period, and the longest period of the states looked for.
_SEARCHED, _LONGEST = 1500, 64
#: Two periods of a settled motion agree to this.
_REPEATED = 1e-6


#: Growth above which the stamps, exact to 1e-9, do not determine the motion that is reached; it
#: has shrunk by e to the seventh since the chaos ended.
_UNFORESEEABLE = 12.0


@dataclass(frozen=True)
class LaterMotion:
    """The motion of the rig when it is run ahead from the last recorded impact."""

    cycles: int  # of the force that it was run
    impacts: RecordedImpacts  # without the weak ones of chatters, on the clock of the recording
    recurrence: Period | None  # how they repeat, or will
    settled_after: int | None  # cycles after which it repeats to within `SETTLED`
    period: int  # in cycles of the force, once settled; 0 if it is not, or without impacts
    quiet_after: int | None  # cycles after which there are no more impacts
    indications: Indications | None  # for and against chaos; None if there are too few cycles
    growth: float = 0.0  # logarithm of the growth of a deviation until the motion had settled

    @property
    def unforeseeable(self) -> bool:
        """Whether the recording does not determine the motion that is reached."""
        return self.growth > _UNFORESEEABLE


def _after_impact(
    machine: Machine, clock: ForceClock, impacts: RecordedImpacts, row: int
) -> Flight:
    """Return the flight from just after an impact."""
    return flight_at_impact(
        machine,
        float(impacts.time[row] - clock.zero),
        int(impacts.stop[row]),
        float(impacts.x[row]),
        float(impacts.velocity_after[row]),
        float(impacts.damper_velocity_after[row]),
    )


def _as_recorded(events: Events, rig: RigParameters, begin: float) -> RecordedImpacts:
    """Return the impacts of a run from an instant of the clock, s, as they would be recorded."""
    hits = events[events['kind'] == EventKind.IMPACT]
    after, damper_after = hits['primary_velocity_after'], hits['damper_velocity_after']
    half = np.where(hits['stop'] == 1, 0.5, -0.5) * rig.gap
    return RecordedImpacts(
        time=begin + hits['time'],
        stop=hits['stop'].astype(float),
        x=hits['x'],
        z=hits['x'] + half,
        velocity_after=after,
        damper_velocity_after=damper_after,
        primary_impulse=rig.primary_mass * (after - hits['primary_velocity_before']),
        damper_impulse=rig.damper_mass * (damper_after - hits['damper_velocity_before']),
    )


def _settled_after(recurrence: Period, impacts: RecordedImpacts, begin: float) -> float:
    """Return the time from which on a motion that has settled repeats to within `SETTLED`."""
    far = np.flatnonzero(recurrence.distance > SETTLED)
    periods = len(recurrence.distance) - (int(far[-1]) + 1 if len(far) else 0)
    first = max(0, len(impacts) - recurrence.rows * (periods + 1))
    return float(impacts.time[first]) - begin


def later_motion(
    clock: ForceClock, impacts: RecordedImpacts, recorded: float
) -> LaterMotion | None:
    """Run the logged rig ahead from its last impact, longer if more cycles were recorded."""
    if not len(impacts):
        return None
    parameters, begin = clock.counted_from_zero(), float(impacts.time[-1])
    flight = _after_impact(machine_of(parameters), clock, impacts, len(impacts) - 1)
    angles = tuple(wave.angle for wave in flight.waves)
    most = int(min(max(_TIMES_RECORDED * recorded, _LEAST), _MOST))
    most = max(most, int(min(recorded, _MOST_OF_ALL)))
    found = settle(
        # Plain Python: compiling would take longer than the run.
        Rig.resume(Snapshot(parameters, flight.run, angles, (), SteppedSine(0.0))),
        cycles=most,
        watch=most,
        tolerance=_REPEATED,
        events=min(max(_MOST_EVENTS, 2 * len(impacts)), _MOST_EVENTS_OF_ALL),
        between=_BETWEEN_LOOKS,
        quiet=_QUIET,
        longest=_LONGEST,
    )
    if found.cycles < 3:
        return None
    hits = found.events['time'][found.events['kind'] == EventKind.IMPACT]
    ahead = counted_impacts(_as_recorded(found.events, parameters, begin))
    if found.kind is MotionKind.NO_IMPACTS:
        quiet = math.ceil(float(hits[-1]) / clock.cycle) if len(hits) else 0
        return LaterMotion(found.cycles, ahead, None, None, 0, quiet, None)
    recurrence = period_of(ahead[-_SEARCHED:], clock.zero, clock.cycle)
    period = 0 if found.period is None else found.period.cycles
    if not period:
        indications = _indications(found)
        return LaterMotion(found.cycles, ahead, recurrence, None, 0, None, indications)
    settled = found.cycles - 3 * period
    if recurrence is not None and recurrence.cycles == period:
        settled = math.ceil(_settled_after(recurrence, ahead, begin) / clock.cycle)
    growth = 0.0
    if settled > 0:
        until = settled * clock.cycle
        along = found.deviations(found.start, found.start + until)
        growth = growth_exponent(along, parameters.omega).value * until
    return LaterMotion(found.cycles, ahead, recurrence, settled, period, None, None, growth)


def _indications(found: SettledMotion) -> Indications | None:
    """Return the evidence of the later cycles of a run; None if they are too few."""
    first = found.cycles // _LEFT_OUT
    count = found.cycles - first
    if count < _LEAST_MEASURED:
        return None
    along = found.deviations(found.start + first * found.cycle, found.end)
    exponent = growth_exponent(along, found.parameters.omega)
    spread = average_spread(found.section[first:])
    rates = found.cycle * exponent.value, found.cycle * exponent.standard_error
    return Indications(*rates, count, spread)


# The exponent along the recorded motion


#: Impacts on which the exponent is measured, at most, and the parts for its error.
_MOST_IMPACTS, _PARTS = 1500, 8
# A stamp is rounded to the nanosecond; the flight ends as much before the impact.
_GUARD_S = 2e-9


def largest_exponent(clock: ForceClock, impacts: RecordedImpacts) -> Indications | None:
    """
    Measure the rate at which motions next to the recorded one diverge from it or converge to it.

    Between two recorded impacts the theory of the logged rig carries a deviation in closed form,
    through reversals too; at every impact the recorded velocities give the saltation matrix. The
    exponent is per cycle of the force, without a spread; None if the impacts are too few.
    """
    impacts = impacts[-_MOST_IMPACTS:]
    if len(impacts) < 2 * _PARTS:
        return None
    rig = clock.counted_from_zero()
    machine = machine_of(rig)
    constants = machine.constants
    first = impacts.stop == 1
    air = np.where(first, -constants.air, constants.air)
    after = (impacts.velocity_after, impacts.damper_velocity_after)
    before = (impacts.velocity_before(rig), impacts.damper_velocity_before(rig))
    drive = clock.force(impacts.time) / rig.primary_mass
    rates_before, rates_after = (
        state_rates(constants, drive, impacts.x, *speeds, np.sign(speeds[1] - speeds[0]), push)
        for speeds, push in ((before, np.append(air[0], air[:-1])), (after, air))
    )
    everywhere = np.ones(len(impacts), dtype=bool)
    hits = event_matrices(
        constants.mass_ratio,
        everywhere,
        np.where(first, constants.restitution_1, constants.restitution_2),
        rates_before,
        rates_after,
        everywhere,
    )
    scale = np.array([1.0, rig.omega, 1.0, rig.omega])
    deviation = np.array([1.0, 0.6, -0.8, 0.4]) / scale
    growth = np.zeros(len(impacts))
    for i in range(1, len(impacts)):
        flight = _after_impact(machine, clock, impacts, i - 1)
        duration = float(impacts.time[i] - impacts.time[i - 1])
        trajectory = follow_trajectory(flight, max(duration - _GUARD_S, 0.0))
        if trajectory is None or before[0][i] == before[1][i]:
            continue
        deviation = hits[i] @ (trajectory.matrix @ deviation)
        size = float(np.linalg.norm(deviation * scale))
        if size == 0.0:
            return Indications(-math.inf, 0.0, 0)
        growth[i] = math.log(size)
        deviation /= size
    phase = clock.phase(impacts.time)
    span = float(phase[-1] - phase[0])
    if span < _PARTS:
        return None
    part = np.minimum(((phase - phase[0]) * (_PARTS / span)).astype(np.int64), _PARTS - 1)
    rate = np.bincount(part, growth, _PARTS) * (_PARTS / span)
    error = float(rate.std(ddof=1)) / math.sqrt(_PARTS)
    return Indications(float(growth.sum()) / span, error, int(span))


# The kind of a motion with impacts


#: Cycles with impacts from which on the rig is run ahead.
_RUN_AHEAD_FROM = 8
#: Number of earlier impacts from which it is also run ahead if it is chaotic at first.
_OTHER_WAYS = 3
#: Cycles that are enough for most motions.
_FEW_CYCLES = 30
#: Periods that differ by less are periodic whatever the rig does later.
_SURE = 1e-6
#: K of the 0-1 test of a recording that is not quasi-periodic.
_NOT_REGULAR = 0.5


def _period_text(recurrence: Period) -> str:
    return f'{counted(recurrence.cycles, "cycle")} ({counted(recurrence.rows, "impact")})'


def _recurring(recurrence: Period, impacts: RecordedImpacts) -> StretchKind:
    """Return the kind of a motion whose recorded impacts repeat, or will."""
    text = _period_text(recurrence)
    level = recurrence.level
    measures = {
        'distance_of_last_periods': level,
        'floor': recurrence.floor,
        'factor_per_period': recurrence.factor,
        'periods': float(len(recurrence.distance)),
    }
    kind = MotionKind.PERIODIC
    if recurrence.remaining <= SETTLED or recurrence.at_floor:
        limit = ', the limit of the stamps' if recurrence.at_floor else ''
        evidence = f'repeats after {text}: the last two periods differ by {level:.1e}{limit}'
    elif not recurrence.shrinks:
        evidence = f'repeats after {text} to within {level:.1e}, which does not shrink any more'
    else:
        kind = MotionKind.TRANSIENT
        evidence = (
            f'approaches a period of {text}: the difference of successive periods shrinks by a '
            f'factor of about {recurrence.factor:.3g}, to {level:.1e} at the end'
        )
    return StretchKind(kind, evidence, measures, recurrence, impacts)


def _leads_to(ahead: LaterMotion) -> StretchKind | None:
    """Return the kind of a motion that leads to a period, or to no impacts; else None."""
    on = 'does not repeat yet; run ahead from its last impact, it'
    if ahead.quiet_after is not None:
        quiet = ahead.cycles - ahead.quiet_after
        text = f'{on} has no impacts in {quiet} cycles after {ahead.quiet_after} more'
        measures = {'quiet_after_cycles': float(ahead.quiet_after)}
        return StretchKind(MotionKind.TRANSIENT, text, measures)
    recurrence = ahead.recurrence
    settled = float(ahead.settled_after or 0)
    if not ahead.period:
        # Too slow to have settled, but on its way
        found = ahead.indications
        if found is None or recurrence is None or not (found.shrinks and recurrence.shrinks):
            return None
        left = max(0.0, math.log(SETTLED / recurrence.level) / found.exponent)
        settled = float(math.ceil(ahead.cycles + left))
    measures = {'settles_after_cycles': settled}
    text = f'{on} settles after {"" if ahead.period else "about "}{settled:.0f} more cycles to '
    if recurrence is None or (ahead.period and recurrence.cycles != ahead.period):
        text += f'a period of {ahead.period} cycles'
        if ahead.period > LONGEST_PERIOD:
            text += f', longer than the {LONGEST_PERIOD} that are predicted'
        return StretchKind(MotionKind.TRANSIENT, text, measures)
    text += f'a period of {_period_text(recurrence)}'
    return StretchKind(MotionKind.TRANSIENT, text, measures, recurrence, ahead.impacts, ahead=True)


def _settling(clock: ForceClock, impacts: RecordedImpacts, ahead: LaterMotion) -> StretchKind:
    """
    Return the kind of a motion that settles after chaos.

    The stamps do not determine the motion that far ahead. The rig is therefore run ahead from each
    of the last impacts; the motion counts as settling only if all runs reach the same period.
    """
    spent = _cycles_of(clock, impacts)
    others = [later_motion(clock, impacts[:-back], spent) for back in range(1, _OTHER_WAYS + 1)]
    periods = [way.period if way is not None else 0 for way in others]
    cycles = [float(ahead.settled_after or 0)]
    cycles += [float(way.settled_after or 0) for way in others if way is not None and way.period]
    leads = _leads_to(ahead)
    assert leads is not None
    if all(period == ahead.period for period in periods):
        text = f'{leads.evidence}; it is chaotic at first, but from the {_OTHER_WAYS} impacts '
        text += f'before it settles to that period, too, after {min(cycles):.0f} to '
        text += f'{max(cycles):.0f} cycles'
        return replace(leads, evidence=text)
    known = ', '.join(str(p) for p in sorted({ahead.period, *periods} - {0}))
    text = (
        f'does not repeat yet; run ahead from each of its last {_OTHER_WAYS + 1} impacts, it '
        f'is chaotic, and settles from {len(cycles)} of them, after {min(cycles):.0f} cycles or '
        f'more, to periods of {known} cycles: the recording does not determine to which, nor when'
    )
    return StretchKind(MotionKind.UNDECIDED, text, leads.measures, short=True)


def kind_ahead(clock: ForceClock, impacts: RecordedImpacts) -> StretchKind | None:
    """Return the periodic motion to which the rig comes when it is run ahead."""
    ahead = later_motion(clock, impacts, _cycles_of(clock, impacts))
    if ahead is None or ahead.unforeseeable:
        return None
    leads = _leads_to(ahead)
    return leads if leads is not None and leads.recurrence is not None else None


def _cycles_of(clock: ForceClock, impacts: RecordedImpacts) -> float:
    """Return the cycles of the force from the first to the last impact."""
    return float(impacts.time[-1] - impacts.time[0]) / clock.cycle if len(impacts) else 0.0


def _recorded(
    clock: ForceClock, impacts: RecordedImpacts
) -> tuple[Indications | None, float, str]:
    """Return the evidence of the second half of the impacts, K of the 0-1 test, and the words."""
    late = impacts[len(impacts) // 2 :]
    counted = counted_impacts(impacts)
    strobe = counted[len(counted) // 2 :]
    most_hit = 1.0 if (strobe.stop == 1.0).sum() * 2 >= len(strobe) else 2.0
    strobe = strobe[strobe.stop == most_hit]
    regularity = zero_one_test(strobe.x)
    exponent = largest_exponent(clock, late)
    seen, found = '', None
    if exponent is not None:
        angle = math.tau * clock.phase(strobe.time)
        states = np.column_stack(
            [strobe.x, strobe.velocity_after, strobe.damper_velocity_after]
        ) / np.array([1.0, clock.parameters.omega, clock.parameters.omega])
        spread = average_spread(np.column_stack([states, np.cos(angle), np.sin(angle)]))
        found = replace(exponent, spread=spread)
        seen += f'; Lyapunov exponent {_exponent_text(found)} per cycle along the last '
        seen += f'{min(len(late), _MOST_IMPACTS)} recorded impacts'
    if not math.isnan(regularity):
        seen += f'; their 0-1 test K = {regularity:.2f} (0 regular, 1 chaotic)'
    return found, regularity, seen


def _exponent_text(found: Indications) -> str:
    digits = 4 if found.error < 1e-3 else 3
    return f'{found.exponent:+.{digits}f} ± {found.error:.{digits}f}'


def _ahead_text(found: Indications) -> str:
    text = (
        f'run ahead from the last impact, it does not settle, and over {found.cycles} cycles '
        f'the exponent is {_exponent_text(found)}'
    )
    if not math.isnan(found.spread):
        text += (
            f'; weighted averages over their halves differ by {found.spread:.1g} (below '
            f'{REGULAR_SPREAD:g} regular, above {IRREGULAR_SPREAD:g} chaotic)'
        )
    return text


def _contradiction(kind: MotionKind, recorded: Indications | None, regularity: float) -> str:
    """Return the evidence of the recording against a kind, if there is any."""
    if recorded is None:
        return ''
    if kind is MotionKind.CHAOTIC:
        if recorded.shrinks:
            return 'along the recording neighbouring motions converge'
        if recorded.spread < REGULAR_SPREAD:
            return f'the recorded impacts look regular: averages differ by {recorded.spread:.1g}'
    if kind is MotionKind.QUASI_PERIODIC:
        if recorded.grows:
            return 'along the recording neighbouring motions diverge'
        if regularity > _NOT_REGULAR:
            return 'the 0-1 test of the recorded impacts does not indicate a regular motion'
    return ''


def _doubt(found: Indications | None, ahead: LaterMotion | None, spent: float) -> str:
    """Return why a motion is undecided, and what would decide."""
    if found is None and ahead is not None:
        return (
            f'run ahead from the last impact, it does not settle within {ahead.cycles} '
            'cycles, and has too many impacts to be run for longer'
        )
    if found is None:
        return f'{spent:.0f} cycles with impacts are too few; about {_FEW_CYCLES} may decide'
    if more := found.cycles_to_decide():
        return f'the exponent is not certain; about {more} cycles in all would decide'
    if found.shrinks:
        text = 'neighbouring motions converge to it: a long transient, or a long period; '
        return (
            f'{text}about {math.ceil(math.log(SETTLED) / found.exponent)} more cycles would decide'
        )
    if found.grows:
        text = 'neighbouring motions diverge, but the averages indicate a regular motion'
    elif found.neutral:
        text = 'neighbouring motions neither converge nor diverge, but the averages are not steady'
    else:
        text = 'the exponent is too near to zero'
    return f'{text}; about {4 * found.cycles} cycles in all would decide'


def kind_of(clock: ForceClock, impacts: RecordedImpacts) -> StretchKind:
    """Find the kind of a motion with impacts; it may be run ahead from its last impact."""
    counted = counted_impacts(impacts)
    spent = float(np.ptp(counted.time)) / clock.cycle if len(counted) else 0.0
    recurrence = period_of(counted, clock.zero, clock.cycle)
    if recurrence is not None and (recurrence.at_floor or recurrence.level <= _SURE):
        return _recurring(recurrence, counted)
    ahead = None
    if len(impacts) and (recurrence is not None or spent >= _RUN_AHEAD_FROM):
        ahead = later_motion(clock, impacts, spent)
    if recurrence is not None and (ahead is None or _confirmed(recurrence, ahead)):
        return _recurring(recurrence, counted)
    if ahead is not None and ahead.unforeseeable:
        return _settling(clock, impacts, ahead)
    leads = None if ahead is None else _leads_to(ahead)
    if leads is not None:
        return leads
    recorded, regularity, seen = _recorded(clock, impacts)
    found = recorded if ahead is None else ahead.indications
    measures = {'zero_one_test': regularity}
    if recorded is not None:
        measures['recorded_exponent'] = recorded.exponent
        measures['recorded_error'] = recorded.error
    if found is not None:
        measures['lyapunov_exponent'], measures['lyapunov_error'] = found.exponent, found.error
        measures['measured_cycles'] = float(found.cycles)
        measures['average_spread'] = found.spread
    measures['carried_cycles'] = float(ahead.cycles) if ahead is not None else 0.0
    seen = f'does not repeat within {LONGEST_PERIOD} cycles{seen}'
    if ahead is not None and found is not None:
        seen += f'; {_ahead_text(found)}'
    kind = MotionKind.UNDECIDED if found is None else found.kind()
    doubt = _contradiction(kind, recorded, regularity)
    if kind is MotionKind.UNDECIDED:
        doubt = _doubt(found, ahead, spent)
    if doubt:
        return StretchKind(MotionKind.UNDECIDED, f'{seen}; {doubt}', measures, short=True)
    return StretchKind(kind, seen, measures)


def _confirmed(recurrence: Period, ahead: LaterMotion) -> bool:
    """Return whether the rig, run ahead, reaches the period of its recorded impacts."""
    if ahead.period:
        return ahead.period == recurrence.cycles
    slowly = ahead.indications is not None and ahead.indications.shrinks
    later = ahead.recurrence
    return slowly and later is not None and later.cycles == recurrence.cycles


def kind_without_force_phase(impacts: RecordedImpacts, cycle: float) -> StretchKind:
    """Find the kind of a motion if the phase of the force is not known."""
    counted = counted_impacts(impacts)
    recurrence = period_of(counted, 0.0, cycle)
    if recurrence is not None:
        return _recurring(recurrence, counted)
    late = counted[len(counted) // 2 :]
    regularity = zero_one_test(late.x)
    text = f'does not repeat within {LONGEST_PERIOD} cycles'
    if not math.isnan(regularity):
        text += f'; 0-1 test K = {regularity:.2f} (0 regular, 1 chaotic)'
    return StretchKind(MotionKind.UNDECIDED, text, {'zero_one_test': regularity})
