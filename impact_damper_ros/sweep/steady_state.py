"""What a rig settles into, and what that motion amounts to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.compare.run_curves import cubic_swing
from impact_damper_ros.control.controlled_run import ControlledRun
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
from impact_damper_ros.orbits.settling import Settling, SettlingRig, section_of
from impact_damper_ros.rig import EventKind, Mode
from impact_damper_ros.rig.long_run import EVENT_TYPE, Events, LongRun, RunResult

__all__ = [
    'SteadyState',
    'StretchSwing',
    'TimeShares',
    'chatter_time',
    'steady_state',
    'stretch_swing',
]


#: Events in the midst of which m may chatter.
_PASSED_OVER = (EventKind.REVERSAL, EventKind.CROSSING, EventKind.STOP_ARRIVED)


def chatter_time(events: Events, start: float, end: float) -> float:
    """Add up the time that m spends in complete chatters."""
    total = 0.0
    faster: list[float] = []
    struck = 0
    telling = events[~np.isin(events['kind'], _PASSED_OVER)]
    rows = (telling[name].tolist() for name in ('time', 'kind', 'stop'))
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


Array = NDArray[np.float64]


class StretchSwing(NamedTuple):
    """
    Displacement of M over a stretch.

    Attributes
    ----------
    largest : float
        Largest |X|, m.
    mean, rms : float
        Mean and root mean square of X, m.
    """

    largest: float
    mean: float
    rms: float


def stretch_swing(stretch: RunResult) -> StretchSwing:
    """
    Measure how M swings from the first sample to the last.

    Between two neighbours, samples or events, X is the cubic through both with their velocities,
    so that the error falls with the fourth power of the sampling interval; see `Swing`.
    """
    samples = stretch.samples
    within = stretch.events['time'] > samples['time'][0]
    events = stretch.events[within & (stretch.events['time'] <= samples['time'][-1])]
    time = np.concatenate([events['time'], samples['time']])
    # At the same instant a sample shows what the event has left
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
    return StretchSwing(largest, swing.total / whole, math.sqrt(swing.squares / whole))


#: Samples in a cycle of the fastest of force and spring, for the largest |X|: of a motion that
#: repeats (it is then exact to 1e-9) and of one that does not (2e-7).
_LOOKS, _FEWER_LOOKS = 256, 64
_MOST_FINER = 64.0
#: A motion that repeats but whose deviations grow by more than this in a period will not stay.
_GROWS = 1.001


@dataclass(frozen=True)
class TimeShares:
    """
    Shares of the time, 0 to 1.

    Attributes
    ----------
    stick : float
        m is held by friction inside the gap.
    rest : float
        m rests on a stop.
    chatter : float
        m is in a complete chatter; see `chatter_time`.
    """

    stick: float
    rest: float
    chatter: float


@dataclass(frozen=True)
class SteadyState:
    """
    A motion, measured over whole cycles of the force.

    Attributes
    ----------
    kind : MotionKind
        What it is; `UNDECIDED` if it does not repeat, and neither chaos nor quasi-periodic motion
        is certain by the thresholds of `irregularity`.
    settling_cycles, measured_cycles : int
        Cycles run before it was measured, and cycles over which it was.
    cycle : float
        Cycle of the force, or of the spring if there is none, s.
    period : int
        Period in cycles of the force; 0 if it does not repeat.
    stops : tuple of str
        Stops hit in a period; a whole chatter to rest is one entry, such as '1~'.
    impacts : int
        Impacts in a period, those of a chatter up to its cut; 0 if it does not repeat.
    x_max, x_mean, x_rms : float
        Largest |X|, mean and root mean square of X, m.
    impacts_per_cycle : float
        Impacts per cycle of the force.
    exponent : Exponent
        Largest Lyapunov exponent; NaN if neighbours decide differently under gap control.
    multiplier : float
        Modulus of the largest multiplier of a period; NaN if it does not repeat, or if neighbours
        decide differently under gap control.
    shares : TimeShares
        Shares of the time that m sticks, rests and chatters.
    section : ndarray, shape (n, 4)
        X, X', Y and Y' at the ends of cycles: of one period, or of the last cycles.
    hits : ndarray, shape (m, 3)
        Impacts in the same cycles: stop, phase in cycles of the force, speed of approach, m/s.
    events : int
        Events of the whole run.
    """

    kind: MotionKind
    settling_cycles: int
    measured_cycles: int
    cycle: float
    period: int
    stops: tuple[str, ...]
    impacts: int
    x_max: float
    x_mean: float
    x_rms: float
    impacts_per_cycle: float
    exponent: Exponent
    multiplier: float
    shares: TimeShares
    section: Array
    hits: Array
    events: int


def _sequence(events: Events) -> tuple[str, ...]:
    """Return the stops hit, from the place that reads first; a chatter to rest is one entry."""
    words: list[str] = []
    for kind, stop in zip(events['kind'].tolist(), events['stop'].tolist(), strict=True):
        if kind == EventKind.IMPACT:
            words.append(str(stop))
        elif kind == EventKind.REST:
            while words and words[-1] == str(stop):
                words.pop()
            words.append(f'{stop}~')
    # A chatter that is under way at the end of the period
    while len(words) > 1 and words[-1] + '~' in words and words[-1] == words[0][0]:
        words.pop()
    return min((tuple(words[i:] + words[:i]) for i in range(len(words))), default=())


def _periodic_exponent(along: Deviations, span: float) -> tuple[Exponent, float]:
    """Return exponent and largest multiplier of the second of two periods, and of the first."""
    products = monodromy_of(along, np.array([along.start + span, along.end]))
    moduli = [abs(multipliers_of(product)[0]) for product in products]
    rates = [math.log(modulus) / span if modulus else -math.inf for modulus in moduli]
    spread = abs(rates[1] - rates[0]) if all(map(math.isfinite, rates)) else 0.0
    return Exponent(rates[1], spread), moduli[1]


def _unstable(found: SteadyState) -> bool:
    """Return whether a motion that repeats will leave, beyond doubt."""
    doubt = found.exponent.uncertainty * found.period * found.cycle
    return found.multiplier > _GROWS * math.exp(doubt)


def _kind(
    rig: SettlingRig, period: int, impacts: int, exponent: Exponent, spread: float
) -> MotionKind:
    """Say what a motion is; exponent and spread are those of the cycles watched."""
    if period and impacts:
        return MotionKind.PERIODIC
    if period:
        return MotionKind.NO_IMPACTS if rig.forced else MotionKind.AT_REST
    if not (rig.repeating and rig.in_step):
        return MotionKind.NOT_PERIODICALLY_DRIVEN
    cycle, watch = rig.cycle, rig.settling.watch
    error = cycle * exponent.standard_error
    return Indications(cycle * exponent.value, error, watch, spread).kind()


def _shares(stretch: RunResult, around: Events, start: float, end: float) -> TimeShares:
    spent = stretch.time_in_mode / (end - start)
    return TimeShares(
        stick=float(spent[Mode.STICK]),
        rest=float(spent[Mode.REST_1] + spent[Mode.REST_2]),
        chatter=chatter_time(around, start, end) / (end - start),
    )


def _measured(rig: SettlingRig, before: Events, period: int) -> SteadyState:
    """Measure a motion of a known period in cycles, or of none, that had some events before."""
    begun, cycle = rig.cycles, rig.cycle
    finer = max([rig.omega, *rig.machine.free.frequencies]) * cycle / math.tau
    looks = math.ceil((_LOOKS if period else _FEWER_LOOKS) * min(max(finer, 1.0), _MOST_FINER))
    cycles = 2 * period or rig.settling.watch
    start, (mode, last_stop) = rig.time_after(begun), rig.state()
    snapshot = rig.snapshot() if rig.controlled else {}
    stretch = rig.run(cycles, looks)
    end = rig.time_after(rig.cycles)
    # A chatter under way at either end is known by the events before and after
    around = np.concatenate([before, stretch.events, rig.run(1).events])
    swing = stretch_swing(stretch)

    kept = period or min(rig.settling.section, cycles)
    since = rig.time_after(begun + cycles - kept)
    impacts = stretch.impacts()
    hits = impacts[impacts['time'] > since]
    multiplier = math.nan
    if rig.controlled and period:
        exponent, multiplier = period_exponent(snapshot, period * cycle, rig.scales)
    elif rig.controlled:
        exponent = parting_exponent(snapshot, cycle, cycles, rig.scales)
    else:
        along = deviations(rig.machine, rig.angles, stretch.events, mode, last_stop, start, end)
        if period:
            exponent, multiplier = _periodic_exponent(along, period * cycle)
        else:
            exponent = growth_exponent(along, rig.omega)
    stops: tuple[str, ...] = ()
    if period:
        stops = _sequence(stretch.events[stretch.events['time'] > since])
    else:
        hits = hits[-2 * rig.settling.section :]
    spread = math.nan
    if not period:
        quiet = quiet_phase((impacts['time'] - rig.time_after(0)) / cycle)
        spread = average_spread(section_of(stretch.samples[int(quiet * looks) : -1 : looks]))
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
        shares=_shares(stretch, around, start, end),
        section=section_of(stretch.samples[looks::looks][-kept:]),
        hits=np.stack([hits['stop'], phases, np.abs(approach)], axis=-1),
        events=rig.events,
    )


def steady_state(run: LongRun | ControlledRun, settling: Settling) -> SteadyState:
    """
    Let a rig settle, and measure the motion.

    Notes
    -----
    Every 50 cycles the states at the last ends of cycles are compared. The motion is periodic if
    they came back after at most 16 cycles, twice and at least ten times in a row. One that comes
    back but is unstable by its multipliers is run on until it leaves. Under gap control the
    stops must come back too, and deviations are those of two rigs; see `neighbours`.
    """
    rig = SettlingRig(run, settling)
    before = np.empty(0, EVENT_TYPE)
    while rig.cycles < settling.cycles:
        before = rig.settle()
        period = rig.period()
        if period:
            found = _measured(rig, before, period)
            if not _unstable(found):
                return found
            rig.forget()
    return _measured(rig, before, 0)
