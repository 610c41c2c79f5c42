# SPDX-License-Identifier: Apache-2.0
"""The report of a fit: text, JSON, notes of a parameters file, and the page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from impact_damper_ros.fit.estimate import Estimate
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.rig_fit import RigFit
from impact_damper_ros.fit.structure import StructureFit
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .drawing import page_style
from .fit_figures import UNITS, rig_pictures, structure_pictures
from .formatting import NONE, number, numbers, quantity
from .html_page import on_page, render, write_page
from .picture import Picture
from .table import Table

#: Largest correlation of white residuals, in its standard deviations.
_WHITE = 3.0
_MOST_FLIGHTS = 300


def _digits(estimate: Estimate) -> int:
    """Return the significant digits that a value has, two of them uncertain."""
    value, deviation = abs(estimate.value), estimate.standard_deviation
    if not deviation > 0.0 or not math.isfinite(deviation) or value == 0.0:
        return 4
    return min(
        12,
        max(
            2, 2 + math.floor(math.log10(value) + 1e-9) - math.floor(math.log10(deviation) + 1e-9)
        ),
    )


def _row(name: str, estimate: Estimate) -> tuple[str, ...]:
    digits = _digits(estimate)
    low, high = estimate.interval
    share = abs(estimate.standard_deviation / estimate.value) if estimate.value else math.inf
    return (
        name,
        number(estimate.value, digits),
        number(estimate.standard_deviation, 2),
        f'{number(low, digits)} to {number(high, digits)}',
        estimate.unit,
        f'{number(100.0 * share, 2)} %' if share < 10.0 else NONE,
        number(estimate.start, 4),
    )


def estimate_table(parameters: dict[str, Estimate]) -> Table:
    """Return the parameters with their intervals."""
    head = ('parameter', 'value', '±', '95 % interval', 'unit', 'relative', 'start')
    note = (
        'Value, standard deviation, and the interval that holds the true value in 95 % of all '
        'cases if the model is right.'
    )
    rows = [_row(name, one) for name, one in parameters.items()]
    return Table.of_rows(head, rows, 1, 'Parameters', note)


def interval_words(estimate: Estimate) -> str:
    """Return an interval as a note in a parameters file."""
    digits = _digits(estimate) + 1
    low, high = estimate.interval
    return f'95 %: {low:.{digits}g} to {high:.{digits}g}'


def fit_notes(parameters: dict[str, Estimate]) -> dict[str, str]:
    """Return the interval of each fitted parameter, for a parameters file."""
    return {name: interval_words(one) for name, one in parameters.items()}


def _independent(found: RigFit) -> list[str]:
    """Return the names of the parameters, with one for a restitution that both stops share."""
    return [n for n in found.parameters if n != 'restitution_2' or not _common(found)]


def _common(found: RigFit) -> bool:
    """Return whether the stops share one restitution."""
    both = ('restitution_1', 'restitution_2')
    return all(n in found.parameters for n in both) and found.correlations[both[0]][both[1]] > (
        0.999999
    )


def _counted_reasons(found: RigFit) -> list[str]:
    """Return why flights were not used, the commonest reason first."""
    why = Counter(flight.why_not.split(':')[0] for flight in found.flights if not flight.used)
    return [f'{plural(count, "flight")} not used: {reason}' for reason, count in why.most_common()]


def _whiteness_words(found: RigFit) -> str:
    if math.isnan(found.whiteness):
        return 'those of rounding: the record has no noise' if found.parameters else NONE
    if abs(found.whiteness) < _WHITE:
        return f'white ({found.whiteness:+.1f} standard deviations)'
    return (
        f'not white: neighbours are correlated by {found.whiteness:+.1f} standard deviations, '
        'so that intervals are too narrow'
    )


def _span(data: MeasuredMotion) -> str:
    """Return the time of a record, to a part of a sample."""
    step = float(data.time[-1] - data.time[0]) / len(data.time)
    digits = max(0, 2 - math.floor(math.log10(step))) if step > 0.0 else 9
    begin, end = (round(float(data.time[k]), digits) + 0.0 for k in (0, -1))
    return f'from {begin:.10g} to {end:.10g} s'


def _size(found: RigFit, data: MeasuredMotion) -> str:
    used = sum(flight.used for flight in found.flights)
    return (
        f'{plural(len(data.time), "sample")} of {data.quantity} {_span(data)}, '
        f'{plural(len(found.impacts), "impact")}, {used} of '
        f'{plural(len(found.flights), "flight")} used.'
    )


def rig_fit_text(found: RigFit, data: MeasuredMotion) -> str:
    """Return a fit as text."""
    lines = [data.source, _size(found, data), '']
    if found.parameters:
        lines += [estimate_table(found.parameters).text('  '), '']
        lines.append(
            f'chi squared {number(found.chi_squared, 3)}, fit {number(found.fit_percent, 4)} %, '
            f'noise {number(found.deviation, 3)} {UNITS[data.quantity]}, residuals '
            f'{_whiteness_words(found)}'
        )
    lines += _counted_reasons(found)
    lines += [f'note: {remark}' for remark in found.remarks]
    if found.accepted:
        lines.append('accepted: the model describes the record')
    else:
        lines.append('NOT accepted:')
        lines += [f'  - {reason}' for reason in found.reasons]
    return '\n'.join(lines)


def rig_fit_json(found: RigFit, data: MeasuredMotion) -> dict[str, Any]:
    """Return a fit for JSON."""
    plain: dict[str, Any] = as_plain(found, without=('motion', 'residuals', 'deviation'))
    return plain | {
        'noise': as_plain(found.deviation),
        'quantity': data.quantity,
        'source': data.source,
    }


def correlation_table(found: RigFit) -> Table:
    """Return the correlations of the parameters."""
    names = _independent(found)
    rows = [
        (
            one,
            *(number(found.correlations[one][other], 3) for other in names[: k + 1]),
            *[''] * (len(names) - k - 1),
        )
        for k, one in enumerate(names)
    ]
    note = 'Two parameters whose correlation is near 1 or −1 are hardly distinguished.'
    return Table.of_rows(('', *names), rows, 1, 'Correlations', note)


def check_table(found: RigFit) -> Table | None:
    """Return effects that the model leaves out, and the evidence of the data for them."""
    if not found.checks:
        return None
    columns = {
        'further parameter': [check.name for check in found.checks],
        'value': numbers([check.value for check in found.checks], 3),
        '±': numbers([check.standard_deviation for check in found.checks], 2),
        'unit': [check.unit for check in found.checks],
        'over ±': numbers([abs(check.z) for check in found.checks], 2),
    }
    note = 'Each is 0 in the model; a value far from 0 shows where the model fails.'
    return Table.of_columns(columns, 1, 'What the model leaves out', note)


def flight_table(found: RigFit) -> Table:
    """Return the flights between impacts, unused ones with the reason."""
    shown: Iterable[Any] = found.flights
    left = len(found.flights) - _MOST_FLIGHTS
    note = 'The residual is the root mean square over the noise.'
    if left > 0:
        shown = [f for f in found.flights if not f.used][:_MOST_FLIGHTS]
        note = f'Only flights that are not used; report.json has all {len(found.flights)}. {note}'
    rows = [
        (
            f'{flight.start:.4f}',
            f'{1e3 * (flight.end - flight.start):.1f}',
            str(flight.reversals),
            str(flight.sticks),
            number(flight.residual, 3),
            'yes' if flight.used else flight.why_not,
        )
        for flight in shown
    ]
    head = ('from [s]', 'lasts [ms]', 'reversals', 'sticks', 'residual', 'used')
    table = Table.of_rows(head, rows, texts=0)
    columns = [*table.columns[:-1], table.columns[-1]._replace(kind='text')]
    return Table(columns, table.groups, 'Flights', note)


def write_rig_report(
    found: RigFit, data: MeasuredMotion, start: RigParameters, directory: Path, command: str
) -> Path:
    """Write the page of a fit of a rig, and its numbers as report.json beside it."""
    used = sum(flight.used for flight in found.flights)
    words = _whiteness_words(found).partition(':')[0].partition(' (')[0]
    tiles = [
        ('Impacts', str(len(found.impacts)), f'{used} of {len(found.flights)} flights used'),
        ('Noise', f'{number(found.deviation, 3)} {UNITS[data.quantity]}', 'of a sample'),
        ('Residuals', words, 'whether neighbours are correlated'),
    ]
    tables = [correlation_table(found), check_table(found), flight_table(found)]
    page = _page(
        *(found, data, command, start),
        pictures=lambda: rig_pictures(found, data, _independent(found)),
        kicker='a rig fitted to measured data',
        size=_size(found, data),
        remarks=found.remarks + _counted_reasons(found),
        more=tiles,
        parameters=found.parameters,
        tables=tables if found.parameters else [],
        origin='Between impacts M vibrates freely under its force, and m flies: both in closed '
        'form. The parameters make the record most likely; each flight was computed again by the '
        'exact engine. M is that of the start file.',
    )
    return write_page(directory, page, rig_fit_json(found, data))


def _page(
    found: RigFit | StructureFit,
    data: MeasuredMotion,
    command: str,
    start: RigParameters | None,
    *,
    pictures: Callable[[], Iterable[Picture]],
    parameters: dict[str, Estimate],
    more: Sequence[tuple[str, str, str]] = (),
    **content: Any,
) -> str:
    """Return the page of a fit, with `more` tiles than those of each fit."""
    with page_style():
        shown = [on_page(one, f'p{k}', 'the fit') for k, one in enumerate(pictures())]
    tiles = [
        (
            'Chi squared',
            number(found.chi_squared, 3),
            'residual over noise, squared; 1 is perfect',
        ),
        ('Fit', f'{number(found.fit_percent, 4)} %', '1 − residual/motion, rms'),
        *more,
    ]
    return render(
        'fit.html',
        name=Path(data.source.partition(' (')[0].partition(', ')[0]).name or data.source,
        accepted=found.accepted,
        reasons=found.reasons,
        tiles=tiles,
        parameters=estimate_table(parameters),
        pictures=shown,
        facts=_facts(data, command, start),
        **content,
    )


def _facts(
    data: MeasuredMotion, command: str, start: RigParameters | None
) -> list[tuple[str, str]]:
    facts = [('Data', data.source), ('Command', command)]
    if start is not None:
        facts.append(('Masses', f'M {start.primary_mass:g} kg, m {start.damper_mass:g} kg'))
    if data.impact_times is not None and len(data.impact_times):
        facts.append(
            (
                'Impact times',
                f'{len(data.impact_times)}, with a standard deviation of '
                f'{1e3 * data.impact_deviation:.3g} ms',
            )
        )
    return facts


def structure_parameters(found: StructureFit) -> dict[str, Estimate]:
    """Return the estimates of a structure by name."""
    parameters = {
        'natural_frequency': found.frequency,
        'damping_ratio': found.damping_ratio,
    }
    return parameters if found.mass is None else {**parameters, 'primary_mass': found.mass}


def structure_text(found: StructureFit) -> str:
    """Return the fit of a structure as text."""
    data = found.data
    what = {
        'ring-down': 'ring-down',
        'force': 'response to the force',
        'base': 'response to the base',
    }
    unit = UNITS[data.quantity]
    lines = [
        data.source,
        f'{what[found.kind]}: {plural(int(data.used.sum()), "sample")} of {data.quantity} '
        f'{_span(data)}',
        '',
        estimate_table(structure_parameters(found)).text('  '),
        '',
        f'chi squared {number(found.chi_squared, 3)}, fit {number(found.fit_percent, 4)} %, '
        f'noise {number(found.noise, 3)} {unit}, largest correlation of the residual '
        f'{number(found.whiteness, 2)}',
    ]
    if len(found.parts) > 1:
        ends = [f(found.parts, key=lambda part: part.amplitude) for f in (max, min)]
        words = [
            f'{100.0 * part.damping_ratio:.3g} ± {100.0 * part.damping_deviation:.1g} % at '
            f'{quantity(part.amplitude, unit, 3)}'
            for part in ends
        ]
        lines.append(f'damping ratio over amplitude: {words[0]}, {words[1]}')
    if found.accepted:
        lines.append('accepted: linear, with viscous damping, as far as the data show')
    else:
        lines.append('NOT accepted:')
        lines += [f'  - {reason}' for reason in found.reasons]
    return '\n'.join(lines)


def write_structure_report(found: StructureFit, directory: Path, command: str) -> Path:
    """Write the page of a fit of a structure, and its numbers as report.json beside it."""
    data = found.data
    page = _page(
        *(found, data, command, None),
        pictures=lambda: structure_pictures(found),
        kicker='frequency and damping of a structure',
        size=f'{plural(int(data.used.sum()), "sample")} of {data.quantity} from '
        f'{data.time[0]:.10g} to {data.time[-1]:.10g} s.',
        remarks=[],
        parameters=structure_parameters(found),
        tables=[],
        origin='The most likely frequency and damping of one linear mode with white noise of the '
        'sensor; the intervals are those of the curvature of the likelihood there.',
    )
    return write_page(directory, page, found)
