"""What is wrong with a log, by itself and against the rig that it names, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby

from .fault_search import Fault, FaultSearch
from .impact_check import (
    contact_findings,
    gap_findings,
    impulse_findings,
    restitution_findings,
    stop_findings,
)
from .parameter_fit import ParameterFit, fit_one_parameter
from .recorded_stretch import RecordedImpacts, RecordedStretch
from .stretch_measures import Finding

__all__ = ['log_findings', 'repaired_impacts']

#: Share of the intervals that disobey the equations of motion if a parameter is wrong.
_MOST_DISOBEY = 0.1
#: Topics that name the parameters.
_OF_PARAMETERS = ('/parameter_events', '/snapshot')
#: Faults told one by one, and share of the impacts that may be repaired.
_TOLD = 3
_FEW = 0.01
_REPAIRED = 0.05


def _fit_finding(fit: ParameterFit, time: float) -> Finding:
    unit = f' {fit.unit}' if fit.unit else ''
    alike = f' (or another {" or ".join(fit.alike)} instead)' if fit.alike else ''
    return Finding(
        quantity=fit.name,
        unit=fit.unit,
        time=time,
        measured=fit.fitted,
        expected=fit.logged,
        tolerance=abs(fit.fitted - fit.logged) * fit.left,
        text=(
            f'the recorded motion obeys the equations of motion with {fit.name} = '
            f'{fit.fitted:.9g}{unit}{alike}; logged is {fit.logged:.9g}{unit}'
        ),
    )


def _late(seconds: float) -> str:
    """Return a delay in words."""
    size, unit = abs(seconds), 's'
    for factor, name in ((1e9, 'ns'), (1e6, 'us'), (1e3, 'ms')):
        if size * factor < 999.5:
            size, unit = size * factor, name
            break
    return f'{size:.6g} {unit} {"late" if seconds > 0.0 else "early"}'


def _fault_text(fault: Fault) -> str:
    hit = f'the impact on stop {fault.stop} at {fault.time:.9f} s'
    if fault.kind == 'missing':
        return f'{hit} is missing in the log'
    if fault.kind == 'surplus':
        return f'{hit} is in the log, but did not happen'
    difference = fault.recorded - fault.expected
    if fault.kind == 'motion' and math.isnan(difference):
        return (
            f'what is recorded up to {fault.time:.9g} s does not follow from what is before: '
            'impacts, reversals or rest should have come otherwise'
        )
    if fault.kind == 'motion':
        return (
            f'the motion recorded up to {fault.time:.9g} s does not follow from the one before: '
            f'{fault.quantity} is {fault.recorded:.9g} {fault.unit}, off by {difference:+.6g} '
            f'{fault.unit}'
        )
    if fault.quantity == 'instant':
        return f'{hit} is stamped {_late(difference)}'
    return (
        f'{fault.quantity} of {hit} is {fault.recorded:.9g} {fault.unit}, off by '
        f'{difference:+.6g} {fault.unit}'
    )


def _fault_findings(faults: Sequence[Fault]) -> Iterator[Finding]:
    """Yield the faults: few ones one by one, of many the first and how many there are."""

    def sort(fault: Fault) -> tuple[str, str]:
        return fault.kind, fault.quantity

    for (kind, quantity), group in groupby(sorted(faults, key=sort), key=sort):
        alike = sorted(group, key=lambda fault: fault.time)
        for fault in alike if len(alike) <= _TOLD else alike[:1]:
            text = _fault_text(fault)
            if len(alike) > _TOLD:
                text += f'; {len(alike)} of this kind'
                sizes = [abs(f.recorded - f.expected) for f in alike]
                if not math.isnan(max(sizes)):
                    text += f', off by up to {max(sizes):.6g} {fault.unit}'
            name = {'missing': 'missing impact', 'surplus': 'surplus impact'}.get(kind)
            yield Finding(
                quantity=name or (f'{quantity} at impact' if kind == 'impact' else quantity),
                unit=fault.unit,
                time=fault.time,
                measured=fault.recorded,
                expected=fault.expected,
                tolerance=fault.tolerance,
                text=text,
            )


def log_findings(
    stretch: RecordedStretch,
    search: FaultSearch | None,
    *,
    controlled: bool,
    replayed: Sequence[Finding] | None = None,
) -> list[Finding]:
    """
    Return what is wrong with the log of a stretch, the earliest first.

    Parameters
    ----------
    stretch : RecordedStretch
        The stretch.
    search : FaultSearch or None
        What its flights told; None if the force is not known.
    controlled : bool
        Whether a control moves the stops.
    replayed : sequence of Finding, optional
        What a bit-for-bit replay found, which decides whether anything is wrong. The motion itself
        then says what, where it can.
    """
    if replayed is not None and not replayed:
        return []
    found = _motion_findings(stretch, search, controlled=controlled)
    if found and replayed:
        # A log that contradicts itself says what is wrong with it.
        own = [finding for finding in replayed if finding.quantity.endswith(_OF_PARAMETERS)]
        return [*own, *sorted(found, key=lambda finding: finding.time)]
    return sorted(found or list(replayed or ()), key=lambda finding: finding.time)


def _motion_findings(
    stretch: RecordedStretch, search: FaultSearch | None, *, controlled: bool
) -> list[Finding]:
    rig = stretch.parameters
    found = list(impulse_findings(stretch.impacts))
    fit = None
    driven = rig.multisine_level == 0.0
    if search is not None and driven and search.unsound > _MOST_DISOBEY * search.intervals:
        assert stretch.clock is not None
        start = float(stretch.states.time[0]) if len(stretch.states) else stretch.start
        fit = fit_one_parameter(
            stretch.clock, stretch.states, stretch.impacts, stretch.stop_before(start)
        )
    if fit is not None:
        found.append(_fit_finding(fit, stretch.start))
    else:
        found += restitution_findings(rig, stretch.impacts)
    if not controlled:
        found += gap_findings(rig, stretch.states, stretch.impacts)
    if search is not None and not found:
        faults = [f for f in search.faults if f.kind != 'missing' or not stretch.excuses(f.time)]
        found += _fault_findings(faults)
        if search.in_closed_form and search.unsound > max(_TOLD, _FEW * search.intervals):
            found.append(_disobeyed(stretch, search))
    if not found:
        found += restitution_findings(rig, stretch.impacts, single=True)
        found += stop_findings(rig, stretch.control, stretch.states)
        found += contact_findings(rig, stretch.states, stretch.impacts, moving=controlled)
    return found


def _disobeyed(stretch: RecordedStretch, search: FaultSearch) -> Finding:
    text = (
        f'{search.unsound} of {search.intervals} recorded values do not follow from the ones '
        'before by the equations of motion'
    )
    share = search.unsound / search.intervals
    return Finding('equations of motion', '', stretch.start, share, 0.0, _FEW, text)


def repaired_impacts(stretch: RecordedStretch, search: FaultSearch | None) -> RecordedImpacts:
    """Return the impacts, with the few wrong ones as they should be."""
    impacts = stretch.impacts
    if search is None or not search.repairs or len(search.repairs) > _REPAIRED * len(impacts):
        return impacts
    parts, begin = [], 0
    for repair in search.repairs:
        first, last = impacts.time.searchsorted([repair.start, repair.end], side='right')
        parts += [impacts[begin:first], repair.impacts]
        begin = int(last)
    return RecordedImpacts.joined([*parts, impacts[begin:]])
