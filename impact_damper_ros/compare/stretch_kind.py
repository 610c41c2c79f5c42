"""The kind of motion of a stretch: without impacts, periodic, quasi-periodic, chaotic."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from impact_damper_ros.orbits.irregularity import (
    IRREGULAR_SPREAD,
    REGULAR_SPREAD,
    Indications,
    average_spread,
    zero_one_test,
)
from impact_damper_ros.orbits.recognition import (
    LONGEST_PERIOD,
    SETTLED,
    MotionKind,
    Recurrence,
    find_recurrence,
)

from .carried_rig import CarriedMotion, carry_on
from .irregularity import MOST_IMPACTS, largest_exponent
from .matched_orbit import counted_impacts, impact_table
from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates

__all__ = [
    'Oscillation',
    'StretchKind',
    'carried_on',
    'kind_of',
    'kind_without_force_phase',
    'oscillation',
]


@dataclass(frozen=True)
class Oscillation:
    """
    The steady vibration that theory has without impacts, and how far the run is from it.

    Attributes
    ----------
    x_max : float
        Largest |X| of it, m.
    joined : bool
        Whether m moves with M.
    distance : float
        Amplitude of the free vibration that is left, relative to it.
    """

    x_max: float
    joined: bool
    distance: float

    @property
    def settled(self) -> bool:
        """Whether next to nothing is left of the free vibration."""
        return self.distance <= SETTLED


def oscillation(clock: ForceClock, states: RecordedStates) -> Oscillation | None:
    """Hold the last joint state against the steady vibration."""
    rig = clock.parameters
    still = states.damper_velocity == states.velocity
    joined = bool(still.all())
    if not joined and rig.friction * rig.gravity > 0.0:
        return None
    mass = rig.primary_mass + (rig.damper_mass if joined else 0.0)
    constant = 0.0
    if joined:
        constant = rig.damper_mass * rig.gravity * math.sin(rig.angle) / rig.stiffness
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
    swing = float(np.abs(response).sum())
    # Of several harmonics the sum is a bound; of one it is the amplitude.
    x_max = swing + abs(constant)
    return Oscillation(x_max, joined, left / x_max if x_max > 0.0 else math.inf)


#: Cycles with impacts from which on the rig of the theory is carried on.
_CARRIED_FROM = 8
#: From so many earlier impacts the theory is carried on as well, where chaos comes first.
_OTHER_WAYS = 3
#: Cycles that are enough for most motions.
_FEW_CYCLES = 30
#: Two periods that differ by less are a period whatever the theory leads to.
_SURE = 1e-6
#: K of the 0-1 test of a recording that is not quasi-periodic.
_NOT_REGULAR = 0.5


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
        evidence = f'repeats after {text} to within {level:.1e}, which no longer shrinks'
        return StretchKind(MotionKind.PERIODIC, evidence, measures, recurrence, impacts)
    return StretchKind(MotionKind.TRANSIENT, evidence, measures, recurrence, impacts)


def _ahead(carried: CarriedMotion) -> StretchKind | None:
    """Return the kind of a motion that the theory leads on to a period, or to no impacts."""
    on = 'does not repeat yet; carried on from its last impact by the theory, it'
    if carried.quiet_after is not None:
        text = f'{on} has no more impacts after {carried.quiet_after} more cycles'
        measures = {'quiet_after_cycles': float(carried.quiet_after)}
        return StretchKind(MotionKind.TRANSIENT, text, measures)
    recurrence = carried.recurrence
    settled = float(carried.settled_after or 0)
    if not carried.period:
        # Too slow to have settled, but on its way
        found = carried.indications
        if found is None or recurrence is None or not (found.shrinks and recurrence.shrinks):
            return None
        left = max(0.0, math.log(SETTLED / recurrence.level) / found.exponent)
        settled = float(math.ceil(carried.cycles + left))
    measures = {'settles_after_cycles': settled}
    text = f'{on} settles after {"" if carried.period else "about "}{settled:.0f} more cycles to '
    if recurrence is None or (carried.period and recurrence.cycles != carried.period):
        text += f'a period of {carried.period} cycles'
        if carried.period > LONGEST_PERIOD:
            text += f', longer than the {LONGEST_PERIOD} that are predicted'
        return StretchKind(MotionKind.TRANSIENT, text, measures)
    text += f'a period of {_period_text(recurrence)}'
    return StretchKind(
        MotionKind.TRANSIENT, text, measures, recurrence, carried.impacts, carried_on=True
    )


def _settling(clock: ForceClock, impacts: RecordedImpacts, carried: CarriedMotion) -> StretchKind:
    """
    Return the kind of a motion that settles after chaos.

    The stamps do not determine it that far ahead. From each of the last impacts the theory goes
    on another way; only if all of them come to the same period is it said that the motion does.
    """
    spent = _cycles_of(clock, impacts)
    others = [carry_on(clock, impacts[:-back], spent) for back in range(1, _OTHER_WAYS + 1)]
    periods = [way.period if way is not None else 0 for way in others]
    cycles = [float(carried.settled_after or 0)]
    cycles += [float(way.settled_after or 0) for way in others if way is not None and way.period]
    ahead = _ahead(carried)
    assert ahead is not None
    if all(period == carried.period for period in periods):
        text = f'{ahead.evidence}; first it is chaotic, but from the {_OTHER_WAYS} impacts before '
        text += f'it settles to that period, too, after {min(cycles):.0f} to {max(cycles):.0f}'
        return replace(ahead, evidence=text)
    known = ', '.join(str(p) for p in sorted({carried.period, *periods} - {0}))
    text = (
        f'does not repeat yet; carried on from each of its last {_OTHER_WAYS + 1} impacts by the '
        f'theory, it is chaotic, and settles from {len(cycles)} of them, after {min(cycles):.0f} '
        f'cycles or more, to periods of {known} cycles: the recording does not determine to '
        'which, nor when'
    )
    return StretchKind(MotionKind.UNDECIDED, text, ahead.measures, short=True)


def carried_on(clock: ForceClock, impacts: RecordedImpacts) -> StretchKind | None:
    """Let the rig of the theory go on from the last impact, and see how it comes to repeat."""
    carried = carry_on(clock, impacts, _cycles_of(clock, impacts))
    if carried is None or carried.growth > carried.UNFORESEEABLE:
        return None
    ahead = _ahead(carried)
    return ahead if ahead is not None and ahead.recurrence is not None else None


def _cycles_of(clock: ForceClock, impacts: RecordedImpacts) -> float:
    """Return the cycles of the force from the first to the last impact."""
    return float(impacts.time[-1] - impacts.time[0]) / clock.cycle if len(impacts) else 0.0


def _recorded(
    clock: ForceClock, impacts: RecordedImpacts
) -> tuple[Indications | None, float, str]:
    """Return what the second half of the impacts indicates, K of the 0-1 test, and the words."""
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
        seen += f'{min(len(late), MOST_IMPACTS)} recorded impacts'
    if not math.isnan(regularity):
        seen += f'; their 0-1 test K = {regularity:.2f} (0 regular, 1 chaotic)'
    return found, regularity, seen


def _exponent_text(found: Indications) -> str:
    digits = 4 if found.error < 1e-3 else 3
    return f'{found.exponent:+.{digits}f} ± {found.error:.{digits}f}'


def _carried_text(found: Indications) -> str:
    text = (
        f'carried on from the last impact by the theory, it does not settle, and over '
        f'{found.cycles} cycles there the exponent is {_exponent_text(found)}'
    )
    if not math.isnan(found.spread):
        text += (
            f'; weighted averages over the halves of these differ by {found.spread:.1g} (below '
            f'{REGULAR_SPREAD:g} regular, above {IRREGULAR_SPREAD:g} chaotic)'
        )
    return text


def _contradiction(kind: MotionKind, recorded: Indications | None, regularity: float) -> str:
    """Return what of the recording speaks against a kind, if anything does."""
    if recorded is None:
        return ''
    if kind is MotionKind.CHAOTIC:
        if recorded.shrinks:
            return 'along the recording neighbouring motions join'
        if recorded.spread < REGULAR_SPREAD:
            return f'the recorded impacts look regular: averages differ by {recorded.spread:.1g}'
    if kind is MotionKind.QUASI_PERIODIC:
        if recorded.grows:
            return 'along the recording neighbouring motions part'
        if regularity > _NOT_REGULAR:
            return 'the 0-1 test of the recorded impacts is not that of a regular motion'
    return ''


def _doubt(found: Indications | None, carried: CarriedMotion | None, spent: float) -> str:
    """Return why a motion is undecided, and what would decide."""
    if found is None and carried is not None:
        return (
            f'carried on from the last impact by the theory, it does not settle within '
            f'{carried.cycles} cycles, and so many impacts leave no time for more'
        )
    if found is None:
        return f'{spent:.0f} cycles with impacts are too few; some {_FEW_CYCLES} may decide'
    if more := found.cycles_to_decide():
        return f'the exponent is not certain; about {more} cycles in all would decide'
    if found.shrinks:
        text = 'neighbouring motions join it: a long transient, or a long period; '
        return (
            f'{text}some {math.ceil(math.log(SETTLED) / found.exponent)} cycles more would decide'
        )
    if found.grows:
        text = 'neighbouring motions part, but the averages are those of a regular motion'
    elif found.neutral:
        text = 'neighbouring motions keep their distance, but the averages are not steady'
    else:
        text = 'the exponent is too near to zero'
    return f'{text}; some {4 * found.cycles} cycles in all would decide'


def kind_of(clock: ForceClock, impacts: RecordedImpacts, *, sound: bool = True) -> StretchKind:
    """Find out what a motion with impacts is."""
    counted = counted_impacts(impacts)
    table = impact_table(counted, clock.zero, clock.cycle)
    spent = float(table.phase[-1] - table.phase[0]) if len(table) else 0.0
    recurrence = find_recurrence(table)
    if recurrence is not None and (recurrence.at_floor or recurrence.level <= _SURE or not sound):
        return _recurring(recurrence, counted)
    carried = None
    if len(impacts) and sound and (recurrence is not None or spent >= _CARRIED_FROM):
        carried = carry_on(clock, impacts, spent)
    if recurrence is not None and (carried is None or _confirmed(recurrence, carried)):
        return _recurring(recurrence, counted)
    if carried is not None and carried.growth > carried.UNFORESEEABLE:
        return _settling(clock, impacts, carried)
    ahead = None if carried is None else _ahead(carried)
    if ahead is not None:
        return ahead
    recorded, regularity, seen = _recorded(clock, impacts)
    found = recorded if carried is None else carried.indications
    measures = {'zero_one_test': regularity}
    if recorded is not None:
        measures['recorded_exponent'] = recorded.exponent
        measures['recorded_error'] = recorded.error
    if found is not None:
        measures['lyapunov_exponent'], measures['lyapunov_error'] = found.exponent, found.error
        measures['measured_cycles'] = float(found.cycles)
        measures['average_spread'] = found.spread
    measures['carried_cycles'] = float(carried.cycles) if carried is not None else 0.0
    seen = f'does not repeat within {LONGEST_PERIOD} cycles{seen}'
    if carried is not None and found is not None:
        seen += f'; {_carried_text(found)}'
    kind = MotionKind.UNDECIDED if found is None else found.kind()
    doubt = _contradiction(kind, recorded, regularity)
    if kind is MotionKind.UNDECIDED:
        doubt = _doubt(found, carried, spent)
    if doubt:
        return StretchKind(MotionKind.UNDECIDED, f'{seen}; {doubt}', measures, short=True)
    return StretchKind(kind, seen, measures)


def _confirmed(recurrence: Recurrence, carried: CarriedMotion) -> bool:
    """Return whether the theory leads on to the period that a motion seems to come to."""
    ahead = carried.recurrence
    if carried.period:
        return carried.period == recurrence.cycles
    slowly = carried.indications is not None and carried.indications.shrinks
    return slowly and ahead is not None and ahead.cycles == recurrence.cycles


def kind_without_force_phase(impacts: RecordedImpacts, cycle: float) -> StretchKind:
    """Find out what a motion is where the phase of the force is not known."""
    counted = counted_impacts(impacts)
    recurrence = find_recurrence(impact_table(counted, 0.0, cycle))
    if recurrence is not None:
        return _recurring(recurrence, counted)
    late = counted[len(counted) // 2 :]
    regularity = zero_one_test(late.x)
    text = f'does not repeat within {LONGEST_PERIOD} cycles'
    if not math.isnan(regularity):
        text += f'; 0-1 test K = {regularity:.2f} (0 regular, 1 chaotic)'
    return StretchKind(MotionKind.UNDECIDED, text, {'zero_one_test': regularity})
