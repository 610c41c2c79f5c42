"""What the motion of a stretch is: periodic, on its way there, quasi-periodic, chaotic."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from impact_damper_ros.orbits.event_map import Incident, origin_at, run_course
from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.mode import REST_1, REST_2, make_machine

from .force_clock import ForceClock
from .irregularity import largest_exponent, zero_one_test
from .matched_orbit import NEGLIGIBLE_IMPULSE
from .motion_kind import MotionKind
from .recorded_stretch import RecordedImpacts
from .recurrence import MOST_CYCLES, SETTLED, ImpactTable, Recurrence, find_recurrence

__all__ = [
    'StretchKind',
    'carried_on',
    'counted_impacts',
    'impact_table',
    'kind_of',
    'kind_without_force_phase',
]

#: Cycles for which the rig of the theory carries on from the last recorded impact.
_CARRIED_ON = 400
_MOST_CARRIED_EVENTS = 2500
#: An exponent within so many standard errors, or so small, is none.
_ERRORS, _NO_GROWTH = 3.0, 0.01
#: K of the 0-1 test above which a less certain exponent will do.
_IRREGULAR = 0.8
_LEAST_CYCLES = 100
#: Cycles with impacts from which on it is worth while.
_CARRIED_FROM = 8


@dataclass(frozen=True)
class StretchKind:
    """
    A kind of motion, and why.

    Attributes
    ----------
    kind : MotionKind
        The kind.
    evidence : str
        The numbers on which it rests, as a sentence.
    measures : mapping of str to float
        The same numbers by name.
    recurrence : Recurrence or None
        How the recorded motion repeats.
    impacts : RecordedImpacts
        Those that repeat: recorded ones without the weak ones of chatters; or, of a motion that
        does not repeat yet, those of the rig of the theory, carrying on from its end.
    carried_on : bool
        Whether they are the latter.
    short : bool
        Whether more could be told of a longer stretch.
    """

    kind: MotionKind
    evidence: str
    measures: Mapping[str, float] = field(default_factory=dict)
    recurrence: Recurrence | None = None
    impacts: RecordedImpacts = field(default_factory=RecordedImpacts.none)
    carried_on: bool = False
    short: bool = False


def counted_impacts(impacts: RecordedImpacts) -> RecordedImpacts:
    """Return the impacts without the weak ones of chatters, by the second half's strongest."""
    strength = np.abs(impacts.primary_impulse)
    strongest = float(strength[len(impacts) // 2 :].max(initial=0.0))
    return impacts[strength > NEGLIGIBLE_IMPULSE * strongest]


def impact_table(impacts: RecordedImpacts, zero: float, cycle: float) -> ImpactTable:
    """Return impacts scaled for comparison; phases from a zero of the force, s."""
    return ImpactTable.of(
        impacts.time - zero,
        impacts.stop,
        impacts.x,
        impacts.velocity_after,
        impacts.damper_velocity_after,
        cycle,
    )


def _period_text(recurrence: Recurrence) -> str:
    cycles = '1 cycle' if recurrence.cycles == 1 else f'{recurrence.cycles} cycles'
    hits = '1 impact' if recurrence.impacts == 1 else f'{recurrence.impacts} impacts'
    return f'{cycles} ({hits})'


def _recurring(recurrence: Recurrence, impacts: RecordedImpacts) -> StretchKind:
    """Return the kind of a motion that repeats, or comes to."""
    text = _period_text(recurrence)
    level = recurrence.level
    measures = {
        'distance_of_last_periods': level,
        'floor': recurrence.floor,
        'factor_per_period': recurrence.factor,
        'periods': float(len(recurrence.distance)),
    }
    if recurrence.remaining <= SETTLED or recurrence.at_floor:
        limit = ', the limit of the stamps' if recurrence.at_floor else ''
        evidence = f'repeats after {text}: the last two periods differ by {level:.1e}{limit}'
        return StretchKind(MotionKind.PERIODIC, evidence, measures, recurrence, impacts)
    evidence = (
        f'comes to repeat after {text}: from period to period the difference shrinks by about '
        f'{recurrence.factor:.3g}, to {level:.1e} at the end'
    )
    if not recurrence.shrinks:
        evidence = f'repeats after {text} to within {level:.1e}, without settling'
        return StretchKind(MotionKind.PERIODIC, evidence, measures, recurrence, impacts)
    return StretchKind(MotionKind.TRANSIENT, evidence, measures, recurrence, impacts)


def carried_on(clock: ForceClock, impacts: RecordedImpacts) -> StretchKind | None:
    """Let the rig of the theory go on from the last impact, and see how it comes to repeat."""
    rig = clock.counted_from_zero()
    machine = make_machine(rig)
    last = impacts[-1:]
    begin = float(last.time[0])
    velocity = float(last.velocity_after[0])
    relative = float(last.damper_velocity_after[0]) - velocity
    stop = int(last.stop[0])
    origin = origin_at(
        machine,
        begin - clock.zero,
        float(last.x[0]),
        velocity,
        0.0 if stop == 1 else -2.0 * machine.stop,
        relative,
        0 if relative else (REST_1 if stop == 1 else REST_2),
        stop,
    )
    hits: list[tuple[float, Incident]] = []
    events = 0
    for k in range(_CARRIED_ON):
        course = run_course(machine, origin, clock.cycle, differentiate=False)
        events += 0 if course is None else len(course.incidents)
        if course is None or events > _MOST_CARRIED_EVENTS:
            return None
        origin = course.end
        hits += [
            (k * clock.cycle + i.time, i) for i in course.incidents if i.kind is EventKind.IMPACT
        ]
    if len(hits) < 3:
        return None
    impulse = [h.velocity_after - h.velocity_before for _, h in hits]
    columns = [
        [begin + t for t, _ in hits],
        [float(h.stop) for _, h in hits],
        [h.x for _, h in hits],
        [0.0 for _ in hits],
        [h.velocity_after for _, h in hits],
        [h.velocity_after + h.relative_after for _, h in hits],
        impulse,
        impulse,
    ]
    ahead = counted_impacts(RecordedImpacts(*(np.array(column) for column in columns)))
    recurrence = find_recurrence(impact_table(ahead, clock.zero, clock.cycle))
    if recurrence is None or recurrence.remaining > SETTLED:
        return None
    far = np.flatnonzero(recurrence.distance > SETTLED)
    periods = len(recurrence.distance) - (int(far[-1]) + 1 if len(far) else 0)
    cycles = _CARRIED_ON - recurrence.cycles * periods
    text = (
        f'does not repeat yet; carried on from its last impact by the theory, it settles after '
        f'{cycles} more cycles to a period of {_period_text(recurrence)}'
    )
    measures = {'settles_after_cycles': float(cycles)}
    return StretchKind(MotionKind.TRANSIENT, text, measures, recurrence, ahead, carried_on=True)


def kind_of(clock: ForceClock, impacts: RecordedImpacts) -> StretchKind:
    """
    Find out what a motion with impacts is.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged; its force repeats.
    impacts : RecordedImpacts
        All of them.
    """
    counted = counted_impacts(impacts)
    table = impact_table(counted, clock.zero, clock.cycle)
    spent = float(table.phase[-1] - table.phase[0]) if len(table) else 0.0
    recurrence = find_recurrence(table)
    if recurrence is not None:
        return _recurring(recurrence, counted)
    ahead = carried_on(clock, impacts) if spent >= _CARRIED_FROM else None
    if ahead is not None:
        return ahead
    late = impacts[len(impacts) // 2 :]
    exponent = largest_exponent(clock, late)
    strobe = counted[len(counted) // 2 :]
    most_hit = 1.0 if (strobe.stop == 1.0).sum() * 2 >= len(strobe) else 2.0
    regularity = zero_one_test(strobe.x[strobe.stop == most_hit])
    measures = {'zero_one_test': regularity}
    seen = f'does not repeat within {MOST_CYCLES} cycles'
    if exponent is not None:
        measures |= {'lyapunov_exponent': exponent.value, 'lyapunov_error': exponent.error}
        seen += (
            f'; Lyapunov exponent {exponent.value:+.3f} +- {exponent.error:.3f} per cycle '
            f'along the last {exponent.impacts} impacts'
        )
    if not math.isnan(regularity):
        seen += f'; 0-1 test K = {regularity:.2f} (0 regular, 1 chaotic)'
    if exponent is None or spent < _LEAST_CYCLES:
        text = f'{seen}; {spent:.0f} cycles with impacts are too few to tell more'
        return StretchKind(MotionKind.UNDECIDED, text, measures, short=True)
    doubt = max(_ERRORS * exponent.error, _NO_GROWTH)
    seconded = regularity > _IRREGULAR and exponent.value > max(exponent.error, _NO_GROWTH)
    if exponent.value > doubt or seconded:
        return StretchKind(MotionKind.CHAOTIC, seen, measures)
    if exponent.value > -doubt and not regularity > 0.5:
        return StretchKind(MotionKind.QUASI_PERIODIC, seen, measures)
    if exponent.value < -doubt:
        seen += '; neighbouring motions join it: a long transient, or a long period'
    return StretchKind(MotionKind.UNDECIDED, seen, measures)


def kind_without_force_phase(impacts: RecordedImpacts, cycle: float) -> StretchKind:
    """
    Find out what a motion is where the phase of the force is not known.

    Parameters
    ----------
    impacts : RecordedImpacts
        All of them.
    cycle : float
        Duration of a cycle of the force, s.
    """
    counted = counted_impacts(impacts)
    recurrence = find_recurrence(impact_table(counted, 0.0, cycle))
    if recurrence is not None:
        return _recurring(recurrence, counted)
    late = counted[len(counted) // 2 :]
    regularity = zero_one_test(late.x)
    text = f'does not repeat within {MOST_CYCLES} cycles'
    if not math.isnan(regularity):
        text += f'; 0-1 test K = {regularity:.2f} (0 regular, 1 chaotic)'
    return StretchKind(MotionKind.UNDECIDED, text, {'zero_one_test': regularity})
