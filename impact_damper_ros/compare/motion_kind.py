# SPDX-License-Identifier: Apache-2.0
"""
The kind of motion of a stretch: periodic, settling to a period, quasi-periodic or chaotic.

A motion whose impacts repeat to the last digits is periodic. Otherwise the rig is run on from the
end of the stretch until its motion repeats or a bound is reached (`orbits.settle`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from impact_damper_ros.orbits.irregularity import IRREGULAR_SPREAD, REGULAR_SPREAD, Indications
from impact_damper_ros.orbits.recurrence import (
    LONGEST_PERIOD,
    NEAR,
    MotionKind,
    Period,
    Section,
    find_period,
)
from impact_damper_ros.orbits.settled_motion import SettledMotion, settle
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.replay.rows import NO_EVENTS, Events
from impact_damper_ros.rig.rig import Rig

from .result import Array
from .stretches import RecordedStretch

#: A motion is settled if it is nearer to its limit than this, relative to its size.
SETTLED = NEAR
#: Impacts weaker than this share of the strongest belong to a chatter, and are not counted.
NEGLIGIBLE_IMPULSE = 1e-3
#: Round-off of states, relative.
_STATE_ERROR = 1e-12
#: A motion whose periods differ by less is periodic, whatever the rig does later.
_SURE = 1e-6
#: Least number of cycles with impacts for a run from the end, and number that most motions need.
_RUN_ON_FROM, _FEW_CYCLES = 8, 30
#: Cycles of that run per recorded one, their least and largest number, and the most events.
_TIMES_RECORDED, _LEAST, _MOST = 30, 400, 2000
_MOST_EVENTS = 20_000
#: Cycles without an impact after which the impacts have ended, and the longest period looked for.
_QUIET, _LONGEST = 200, 64


@dataclass(frozen=True)
class StretchKind:
    """A kind of motion, and the evidence for it."""

    kind: MotionKind
    evidence: str  # the numbers that show the kind, as a sentence
    measures: Mapping[str, float] = field(default_factory=dict)  # the same numbers by name
    recurrence: Period | None = None  # how the recorded impacts repeat
    impacts: Events = field(default_factory=lambda: NO_EVENTS)  # recorded ones, without weak
    #: The motion to which the rig comes, if the recorded motion is another one.
    later: SettledMotion | None = None
    short: bool = False  # whether a longer recording may show the kind


def counted_impacts(impacts: Events) -> Events:
    """Return the impacts without the weak ones of chatters, by the second half's strongest."""
    strength = impacts['impulse']
    strongest = float(strength[len(impacts) // 2 :].max(initial=0.0))
    return impacts[strength > NEGLIGIBLE_IMPULSE * strongest]


def section_of(impacts: Events, zero: float, cycle: float) -> Section:
    """Return impacts for comparison; phases from a zero of the force, s."""
    phase: Array = (impacts['time'] - zero) / cycle
    after = impacts['primary_velocity_after'], impacts['damper_velocity_after']
    return Section.of_impacts(phase, impacts['stop'], impacts['x'], *after)


def period_of(stretch: RecordedStretch, impacts: Events, cycle: float) -> Period | None:
    """Find the period of impacts, to their digits."""
    zero = 0.0 if stretch.drive is None else stretch.drive.zero
    # Error of the difference of two instants with these digits
    floor = 2.0 * math.ulp(abs(stretch.end)) / cycle + _STATE_ERROR
    return find_period(section_of(impacts, zero, cycle), 0.0, floor)


def rig_at_end(stretch: RecordedStretch) -> Rig:
    """Return the rig at the end of a stretch."""
    # The state does not hold a law of the user's own, which has no effect where no control acts.
    control = {n: v for n, v in stretch.at_end['gap_control'].items() if n != 'law'}
    return Rig.restore({**stretch.at_end, 'gap_control': control}, compiled=None)


def run_on(stretch: RecordedStretch, cycle: float, quiet: float = _QUIET) -> SettledMotion | None:
    """Run the rig on from the end of a stretch; None if that is not possible."""
    most = int(min(max(_TIMES_RECORDED * stretch.duration / cycle, _LEAST), _MOST))
    found = settle(
        rig_at_end(stretch),
        cycles=most,
        watch=3 * most // 4 if math.isfinite(quiet) else most,
        tolerance=_SURE,
        events=_MOST_EVENTS,
        quiet=quiet,
        longest=_LONGEST,
    )
    return found if found.cycles else None


def settled_after(found: SettledMotion) -> int:
    """Return the cycles after which a motion that settles is within `SETTLED` of its limit."""
    assert found.period is not None
    far = np.flatnonzero(found.period.distance > SETTLED)
    alike = len(found.period.distance) - (int(far[-1]) + 1 if len(far) else 0)
    return max(0, found.cycles - (alike + 1) * found.period.cycles)


def _period_text(cycles: int, impacts: int) -> str:
    return f'{plural(cycles, "cycle")} ({plural(impacts, "impact")})'


def _recurring(recurrence: Period, impacts: Events) -> StretchKind:
    """Return the kind of a motion whose recorded impacts repeat, or will."""
    text = _period_text(recurrence.cycles, recurrence.rows)
    level = recurrence.level
    measures = {
        'distance_of_last_periods': level,
        'floor': recurrence.floor,
        'factor_per_period': recurrence.factor,
        'periods': float(len(recurrence.distance)),
    }
    kind = MotionKind.PERIODIC
    if recurrence.remaining <= SETTLED or recurrence.at_floor:
        limit = ', the limit of the digits' if recurrence.at_floor else ''
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


def _leads_to(later: SettledMotion) -> StretchKind | None:
    """Return the kind of a motion that leads to a period, or to no impacts; else None."""
    on = 'does not repeat yet; run on from its end, it'
    if later.kind in (MotionKind.NO_IMPACTS, MotionKind.AT_REST):
        ends = 0.0 if math.isinf(later.quiet) else later.cycles - later.quiet
        text = f'{on} has no more impacts after {math.ceil(ends)} cycles'
        measures = {'quiet_after_cycles': float(math.ceil(ends))}
        return StretchKind(MotionKind.TRANSIENT, text, measures, later=later)
    if later.period is None:
        return None
    settled = settled_after(later)
    text = f'{on} settles after {settled} more cycles to a period of '
    text += _period_text(later.period.cycles, len(later.impacts))
    measures = {'settles_after_cycles': float(settled)}
    return StretchKind(MotionKind.TRANSIENT, text, measures, later=later)


def _doubt(found: Indications | None, later: SettledMotion | None, spent: float) -> str:
    """Return why the kind of a motion is undecided, and the remedy."""
    if found is None and later is not None:
        why = later.reason or 'and has too many events to be run for longer'
        return f'run on from its end, it does not settle within {later.cycles} cycles, {why}'
    if found is None:
        return f'{spent:.0f} cycles with impacts are too few; about {_FEW_CYCLES} may decide'
    if more := found.cycles_to_decide():
        return f'the exponent is not certain; about {more} cycles in all would decide'
    if found.shrinks:
        text = 'the Lyapunov exponent is negative: a long transient, or a long period; about '
        return f'{text}{math.ceil(math.log(SETTLED) / found.exponent)} more cycles would decide'
    if found.grows:
        text = 'neighbouring motions diverge, but the averages indicate a regular motion'
    elif found.neutral:
        text = 'neighbouring motions neither converge nor diverge, but the averages are not steady'
    else:
        text = 'the exponent is too near to zero'
    return f'{text}; about {4 * found.cycles} cycles in all would decide'


def _irregular(later: SettledMotion | None, spent: float) -> StretchKind:
    """Return the kind of a motion that does not settle to a period."""
    found = None if later is None else later.indications
    text, measures = f'does not repeat within {LONGEST_PERIOD} cycles', {}
    kind = MotionKind.UNDECIDED
    if later is not None and found is not None:
        kind = later.kind
        measures = {
            'lyapunov_exponent': found.exponent,
            'lyapunov_error': found.error,
            'measured_cycles': float(found.cycles),
            'average_spread': found.spread,
        }
        digits = 4 if found.error < 1e-3 else 3
        text += (
            f'; run on from its end, it does not settle, and over {found.cycles} cycles its '
            f'Lyapunov exponent is {found.exponent:+.{digits}f} ± {found.error:.{digits}f} per '
            'cycle'
        )
        if not math.isnan(found.spread):
            text += (
                f'; weighted averages over their halves differ by {found.spread:.1g} (below '
                f'{REGULAR_SPREAD:g} regular, above {IRREGULAR_SPREAD:g} chaotic)'
            )
    if kind is not MotionKind.UNDECIDED:
        return StretchKind(kind, text, measures)
    return StretchKind(kind, f'{text}; {_doubt(found, later, spent)}', measures, short=True)


def kind_of(stretch: RecordedStretch, cycle: float) -> StretchKind:
    """Find the kind of a motion with impacts under a periodic force."""
    impacts = counted_impacts(stretch.flights.impacts)
    spent = float(np.ptp(impacts['time'])) / cycle if len(impacts) else 0.0
    recurrence = period_of(stretch, impacts, cycle)
    if recurrence is not None and (recurrence.at_floor or recurrence.level <= _SURE):
        return _recurring(recurrence, impacts)
    later = None
    if recurrence is not None or spent >= _RUN_ON_FROM:
        later = run_on(stretch, cycle)
    if later is None:
        return _irregular(None, spent) if recurrence is None else _recurring(recurrence, impacts)
    if recurrence is not None:
        period, found = later.period, later.indications
        same = period is not None and period.cycles == recurrence.cycles
        slowly = found is not None and found.shrinks and recurrence.shrinks
        if same or slowly:
            return _recurring(recurrence, impacts)
    return _leads_to(later) or _irregular(later, spent)


def kind_by_impacts(stretch: RecordedStretch, cycle: float) -> StretchKind:
    """Find the kind of a motion without a periodic force or under control, by its impacts."""
    impacts = counted_impacts(stretch.flights.impacts)
    recurrence = period_of(stretch, impacts, cycle)
    if recurrence is not None:
        return _recurring(recurrence, impacts)
    text = f'does not repeat within {LONGEST_PERIOD} cycles'
    return StretchKind(MotionKind.UNDECIDED, text)
