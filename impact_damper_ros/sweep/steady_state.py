"""The steady state of a rig: run until the motion repeats, or to a limit, and measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.compare.measured_motion import cubic_swing
from impact_damper_ros.control import Rig, RunResult
from impact_damper_ros.control.rig import Events
from impact_damper_ros.orbits.irregularity import Indications, average_spread, quiet_phase
from impact_damper_ros.orbits.lyapunov import (
    Deviations,
    Exponent,
    deviations,
    growth_exponent,
    monodromy_of,
    parting_exponent,
    period_exponent,
)
from impact_damper_ros.orbits.multipliers import multipliers_of
from impact_damper_ros.orbits.recognition import MotionKind
from impact_damper_ros.orbits.settling import (
    CYCLES_BETWEEN_LOOKS,
    Settling,
    SettlingRig,
    relative_states,
)
from impact_damper_ros.rig import EVENT_TYPE, EventKind, Mode, ParameterError
from impact_damper_ros.rig.snapshot import LATEST

Array = NDArray[np.float64]

#: Events that may fall within a chatter without ending it.
_WITHIN_CHATTER = (EventKind.REVERSAL, EventKind.CROSSING, EventKind.STOP_ARRIVED)


def _chatter_time(events: Events, start: float, end: float) -> float:
    """Add up the time that m spends in complete chatters."""
    total = 0.0
    faster: list[float] = []
    struck = 0
    considered = events[~np.isin(events['kind'], _WITHIN_CHATTER)]
    rows = (considered[name].tolist() for name in ('time', 'kind', 'stop'))
    for time, kind, stop in zip(*rows, strict=True):
        if kind == EventKind.IMPACT:
            if stop != struck:
                faster = []
            elif len(faster) > 1 and time - faster[-1] >= faster[-1] - faster[-2]:
                faster = faster[-1:]
            faster.append(time)
            struck = stop
            continue
        if kind == EventKind.REST and faster:
            total += max(0.0, min(time, end) - max(faster[0], start))
        faster = []
    return float(np.clip(total, 0.0, end - start))


class _Swing(NamedTuple):
    """Largest |X|, mean and root mean square of X over some cycles, m."""

    largest: float
    mean: float
    rms: float


def _swing(result: RunResult) -> _Swing:
    """
    Measure X from the first sample to the last, as a cubic between samples and events.

    The cubic takes both positions and velocities, so that the error falls with the fourth power
    of the sampling interval.
    """
    samples = result.samples
    within = result.events['time'] > samples['time'][0]
    events = result.events[within & (result.events['time'] <= samples['time'][-1])]
    time = np.concatenate([events['time'], samples['time']])
    # A sample at the instant of an event holds the state after it
    order = np.argsort(time, kind='stable')
    time = time[order]
    x = np.concatenate([events['x'], samples['x']])[order]
    after = samples['primary_velocity']
    arriving = np.concatenate([events['primary_velocity_before'], after])[order]
    leaving = np.concatenate([events['primary_velocity_after'], after])[order]

    span = np.diff(time)
    kept = span > 0.0
    span = span[kept]
    swing = cubic_swing(
        span,
        x[:-1][kept],
        x[1:][kept],
        leaving[:-1][kept] * span,
        arriving[1:][kept] * span,
    )
    largest = max(float(np.abs(x).max()), swing.largest)
    whole = float(time[-1] - time[0])
    return _Swing(largest, swing.total / whole, math.sqrt(swing.squares / whole))


#: Samples per cycle of the faster of force and spring: the largest |X| of a motion that repeats is
#: then exact to 1e-9, and of one that does not to 2e-7.
_SAMPLES, _FEWER_SAMPLES = 256, 64
#: The spring is sampled as finely as the force up to this multiple of its frequency.
_MOST_FINER = 64.0
#: A motion that repeats is unstable if deviations grow by more than this factor in a period.
_GROWS = 1.001


@dataclass(frozen=True)
class TimeShares:
    """Shares of the time, 0 to 1, in chatter, sticking and at rest."""

    stick: float  # it is held by friction inside the gap
    rest: float  # it rests on a stop
    chatter: float  # it is in a chatter that ends in rest, from its first impact on


@dataclass(frozen=True)
class SteadyState:
    """A motion, measured over a whole number of force cycles."""

    #: Kind of motion; `UNDECIDED` if it does not repeat and the thresholds of
    #: `orbits.irregularity` confirm neither chaos nor quasi-periodic motion.
    kind: MotionKind
    #: Cycles before the measurement, and cycles measured.
    settling_cycles: int
    measured_cycles: int
    cycle: float  # cycle of the force, or of the spring if there is none, s
    period: int  # period in cycles of the force; 0 if it does not repeat
    #: Stops hit in a period; a chatter that ends in rest is one entry, such as '1~'.
    stops: tuple[str, ...]
    #: Impacts in a period, those of a chatter up to its cut-off; 0 if it does not repeat.
    impacts: int
    #: Largest |X|, mean and root mean square of X, m.
    x_max: float
    x_mean: float
    x_rms: float
    impacts_per_cycle: float
    #: Largest Lyapunov exponent; NaN if the controls of two nearby rigs decide differently.
    exponent: Exponent
    #: Modulus of the largest multiplier of a period; NaN if it does not repeat, or as above.
    multiplier: float
    shares: TimeShares
    #: X, X', Y and Y' at the ends of cycles: of one period, or of the last cycles, shape (n, 4).
    section: Array
    #: Impacts in these cycles, shape (m, 3): stop, phase in cycles of the force, speed of
    #: approach, m/s.
    hits: Array
    events: int  # events of the whole run


def _sequence(events: Events) -> tuple[str, ...]:
    """Return the stops hit, as the least rotation; a chatter to rest is one entry."""
    words: list[str] = []
    for kind, stop in zip(events['kind'].tolist(), events['stop'].tolist(), strict=True):
        if kind == EventKind.IMPACT:
            words.append(str(stop))
        elif kind == EventKind.REST:
            while words and words[-1] == str(stop):
                words.pop()
            words.append(f'{stop}~')
    # The period may end during a chatter
    while len(words) > 1 and words[-1] + '~' in words and words[-1] == words[0][0]:
        words.pop()
    return min((tuple(words[i:] + words[:i]) for i in range(len(words))), default=())


def _periodic_exponent(along: Deviations, span: float) -> tuple[Exponent, float]:
    """Return exponent and largest multiplier of a period; the one before gives the uncertainty."""
    products = monodromy_of(along, np.array([along.start + span, along.end]))
    moduli = [abs(multipliers_of(product)[0]) for product in products]
    rates = [math.log(modulus) / span if modulus else -math.inf for modulus in moduli]
    spread = abs(rates[1] - rates[0]) if all(map(math.isfinite, rates)) else 0.0
    return Exponent(rates[1], spread), moduli[1]


def _unstable(found: SteadyState) -> bool:
    """Return whether a motion that repeats is unstable by more than the uncertainty."""
    doubt = found.exponent.uncertainty * found.period * found.cycle
    return found.multiplier > _GROWS * math.exp(doubt)


def _kind(
    rig: SettlingRig, period: int, impacts: int, exponent: Exponent, spread: float
) -> MotionKind:
    """Classify a motion; exponent and spread are those of the cycles watched."""
    if period and impacts:
        return MotionKind.PERIODIC
    if period:
        return MotionKind.NO_IMPACTS if rig.forced else MotionKind.AT_REST
    if not (rig.repeating and rig.in_step):
        return MotionKind.NOT_PERIODICALLY_DRIVEN
    cycle, watch = rig.cycle, rig.settling.watch
    error = cycle * exponent.standard_error
    return Indications(cycle * exponent.value, error, watch, spread).kind()


def _shares(result: RunResult, around: Events, start: float, end: float) -> TimeShares:
    spent = result.time_in_mode / (end - start)
    return TimeShares(
        stick=float(spent[Mode.STICK]),
        rest=float(spent[Mode.REST_1] + spent[Mode.REST_2]),
        chatter=_chatter_time(around, start, end) / (end - start),
    )


def _measured(rig: SettlingRig, before: Events, period: int) -> SteadyState:
    """Measure a motion; its period is 0 if it does not repeat, `before` are the events so far."""
    begun, cycle = rig.cycles, rig.cycle
    finer = max([rig.omega, *(line.frequency for line in rig.machine.lines)]) * cycle / math.tau
    looks = math.ceil((_SAMPLES if period else _FEWER_SAMPLES) * min(max(finer, 1.0), _MOST_FINER))
    cycles = 2 * period or rig.settling.watch
    start, (mode, last_stop) = rig.time_after(begun), rig.state()
    snapshot = rig.snapshot() if rig.controlled else {}
    result = rig.run(cycles, looks)
    end = rig.time_after(rig.cycles)
    # The events before and after complete a chatter that is cut at either end
    around = np.concatenate([before, result.events, rig.run(1).events])
    swing = _swing(result)

    kept = period or min(rig.settling.section, cycles)
    since = rig.time_after(begun + cycles - kept)
    impacts = result.impacts()
    hits = impacts[impacts['time'] > since]
    multiplier = math.nan
    if rig.controlled and 'law' in snapshot['gap_control']:
        # What the memory of a law of the user's own holds is not known
        exponent = Exponent(math.nan, math.nan)
    elif rig.controlled and period:
        exponent, multiplier = period_exponent(snapshot, period * cycle, rig.scales)
    elif rig.controlled:
        exponent = parting_exponent(snapshot, cycle, cycles, rig.scales)
    else:
        along = deviations(rig.machine, rig.angles, result.events, mode, last_stop, start, end)
        if period:
            exponent, multiplier = _periodic_exponent(along, period * cycle)
        else:
            exponent = growth_exponent(along, rig.omega)
    stops: tuple[str, ...] = ()
    if period:
        stops = _sequence(result.events[result.events['time'] > since])
    else:
        hits = hits[-2 * rig.settling.section :]
    spread = math.nan
    if not period:
        quiet = quiet_phase((impacts['time'] - rig.time_after(0)) / cycle)
        spread = average_spread(relative_states(result.samples[int(quiet * looks) : -1 : looks]))
    phases = (hits['time'] - rig.time_after(0)) / cycle % 1.0
    approach = hits['damper_velocity_before'] - hits['primary_velocity_before']
    return SteadyState(
        kind=_kind(rig, period, len(hits), exponent, spread),
        settling_cycles=begun,
        measured_cycles=cycles,
        cycle=cycle,
        period=period,
        stops=stops,
        impacts=len(hits) if period else 0,
        x_max=swing.largest,
        x_mean=swing.mean,
        x_rms=swing.rms,
        impacts_per_cycle=len(impacts) / cycles,
        exponent=exponent,
        multiplier=multiplier,
        shares=_shares(result, around, start, end),
        section=relative_states(result.samples[looks::looks][-kept:]),
        hits=np.stack([hits['stop'], phases, np.abs(approach)], axis=-1),
        events=rig.events,
    )


def steady_state(run: Rig, settling: Settling) -> SteadyState:
    """
    Run a rig until its motion repeats or the time is up, and measure the motion.

    The rig is at the beginning of a cycle of its force. Every 50 cycles the states at the ends of
    the last cycles are compared. The motion is periodic if they recur after 1 to 16 cycles, for
    two periods and at least ten cycles. A motion that recurs but is unstable by its multipliers is
    run on until it departs; one that is undecided is compared once more after it was watched.
    Under gap control the stops must recur too, and the multipliers are those of two nearby rigs;
    see `orbits.lyapunov`. Raises `EndlessEventsError` if the rig has more events than `settling`
    allows.
    """
    rig = SettlingRig(run, settling)
    if rig.time_after(settling.cycles + settling.watch) > 0.5 * LATEST:
        raise ParameterError(
            'force_frequencies',
            f'the force has a cycle of {rig.cycle:g} s, and so many cycles take longer than a rig '
            'can run: give a higher frequency in force_frequencies, or fewer cycles',
        )
    before = np.empty(0, EVENT_TYPE)
    while rig.cycles < settling.cycles:
        before = rig.settle(min(CYCLES_BETWEEN_LOOKS, settling.cycles - rig.cycles))
        period = rig.period()
        if period:
            found = _measured(rig, before, period)
            if not _unstable(found):
                return found
            rig.forget()
    watched = _measured(rig, before, 0)
    if watched.kind is MotionKind.UNDECIDED:
        # It may have settled while it was watched
        rig.forget()
        before = rig.settle(CYCLES_BETWEEN_LOOKS)
        if period := rig.period():
            found = _measured(rig, before, period)
            return watched if _unstable(found) else found
    return watched
