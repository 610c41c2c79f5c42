"""The tables of a report: one line per stretch, and the numbers of a stretch."""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Callable, Collection, Sequence
from typing import Any

from impact_damper_ros.compare import Overall, StretchComparison, Verdict
from impact_damper_ros.orbits import PeriodicOrbit
from impact_damper_ros.rig import ALL_SPECS
from impact_damper_ros.rig.quoting import counted

from .formatting import NONE, aligned, difference, instant, number, unit_for, worded
from .glossary import linked
from .html import Column, Html, element, table

#: Class of a verdict in the page's style, and a sign that needs no colour.
_BADGES = {
    Verdict.AGREES: ('good', '✓'),
    Verdict.DIFFERS: ('bad', '✗'),
    Verdict.NOT_SETTLED: ('open', '…'),
    Verdict.PREDICTED_UNSTABLE: ('open', '!'),
    Verdict.NO_PREDICTION: ('none', '–'),
    Verdict.TOO_SHORT: ('none', '–'),
}
#: Changes that are named where a stretch begins, and what stands between two of them.
_MOST_CHANGES = 4
_CHANGES = re.compile(r', (?=[a-z_0-9]+ = )')
#: Impacts of a period that are listed; chatter has many.
_MOST_IMPACTS = 8
#: Share of a run that samples cover if none is missing.
_COVERED = 0.99

_QUANTITIES: tuple[tuple[str, str, str], ...] = (
    ('phases', 'phase', 'cycles'),
    ('x', 'X', 'm'),
    ('primary_velocity_before', 'X′ before', 'm/s'),
    ('primary_velocity_after', 'X′ after', 'm/s'),
    ('damper_velocity_before', 'Z′ before', 'm/s'),
    ('damper_velocity_after', 'Z′ after', 'm/s'),
    ('impulse', 'impulse', 'N s'),
)


def sign_of(verdict: Verdict) -> str:
    """Return the sign that stands for a verdict."""
    return _BADGES[verdict][1]


def _badge(verdict: Verdict, word: str, count: int | None = None) -> Html:
    """Return a verdict and its count as a label with a sign and a colour."""
    kind, sign = _BADGES[verdict]
    times = '' if count is None else f': {count}'
    return element('span', f'{sign} ', word, times, class_=f'badge {kind}')


def linked_badge(verdict: Verdict, count: int | None = None) -> Html:
    """Return a verdict as a label that leads to its explanation."""
    return _badge(verdict, linked(verdict.value), count)


def cause_of(stretch: StretchComparison) -> str:
    """Return why a stretch begins; of many changes, the most important ones."""
    cause = worded(stretch.cause) or stretch.begins.value
    changes = _CHANGES.split(cause)
    if len(changes) <= _MOST_CHANGES:
        return cause
    # Changes from or to none accompany another change, and matter least
    changes.sort(key=lambda change: 'none' in change)
    left = len(changes) - _MOST_CHANGES
    return f'{", ".join(changes[:_MOST_CHANGES])} and {left} more changes'


def motion_of(stretch: StretchComparison) -> str:
    """Return the kind of motion in a few words."""
    count, cycles = stretch.impacts_per_period, stretch.cycles
    if not count or not cycles:
        return stretch.kind.value
    return f'{stretch.kind.value}: {counted(count, "impact")} in {counted(cycles, "cycle")}'


def overview_table(
    stretches: Sequence[StretchComparison], detailed: Collection[int], note: str
) -> Html:
    """Return the table of all stretches."""
    measured = [stretch.measured for stretch in stretches]
    unit = unit_for('m', [m.x_max for m in measured if m is not None])

    def name(stretch: StretchComparison) -> str:
        text = str(stretch.number)
        return element('a', text, href=f'#stretch-{text}') if stretch.number in detailed else text

    def swing(orbit: PeriodicOrbit | None) -> str:
        if orbit is None:
            return NONE
        return number(unit.factor * orbit.x_max, 5) + (
            '' if orbit.stable else f' ({orbit.stability})'
        )

    columns = {
        Column(linked('stretch'), 'text'): map(name, stretches),
        Column('verdict', 'text'): (_badge(s.verdict, s.verdict.value) for s in stretches),
        Column(linked('rig time [s]'), 'span'): (
            f'{instant(s.start)} to {instant(s.end)}' for s in stretches
        ),
        Column('begins with', 'text'): map(cause_of, stretches),
        Column('motion', 'text'): map(motion_of, stretches),
        Column(linked('impacts per cycle')): (
            NONE if m is None else number(m.impacts_per_cycle, 4) for m in measured
        ),
        Column(f'largest |X| [{unit.name}]'): (
            NONE if m is None else number(unit.factor * m.x_max, 5) for m in measured
        ),
        Column(linked(f'predicted [{unit.name}]')): (swing(s.predicted) for s in stretches),
    }
    rows = list(zip(*columns.values(), strict=True))
    note = (
        'Impacts per cycle and largest |X| are those of the steady part, or of the second half of '
        f'a stretch that has none. {note}'
    )
    return table('All stretches', tuple(columns), [('', rows)], note=linked(note))


def overall_table(
    stretches: Sequence[StretchComparison], overall: Overall | None, note: str
) -> Html:
    """Return swing, impacts and energy of whole stretches and of the run; empty if not known."""
    known = {str(s.number): s.overall for s in stretches if s.overall is not None}
    if overall is None or not known:
        return Html()
    entries = {**known, 'all': overall} if len(known) > 1 else known
    length = unit_for('m', [e.x_max for e in entries.values()])
    work = [(e.force_work, e.impact_energy, e.dashpot_energy) for e in entries.values()]
    energy = unit_for('J', work)
    columns: dict[Column, Callable[[Overall], str]] = {
        Column('length [s]'): lambda e: instant(e.duration),
        Column(f'largest |X| [{length.name}]'): lambda e: number(length.factor * e.x_max, 5),
        Column(linked(f'rms of X [{length.name}]')): lambda e: number(length.factor * e.x_rms, 5),
        Column('impacts'): lambda e: str(e.impacts),
        Column(linked('on stop 1')): lambda e: str(e.impacts_on_stop_1),
        Column('on stop 2'): lambda e: str(e.impacts_on_stop_2),
        Column(f'work of the force [{energy.name}]'): lambda e: number(
            energy.factor * e.force_work, 5
        ),
        Column(f'taken from M by impacts [{energy.name}]'): lambda e: number(
            energy.factor * e.impact_energy, 5
        ),
        Column(f'by the dashpot [{energy.name}]'): lambda e: number(
            energy.factor * e.dashpot_energy, 5
        ),
    }
    rows = [(name, *(text(e) for text in columns.values())) for name, e in entries.items()]
    text = 'Over whole stretches, transients included; between the samples, X follows cubics '
    text += f'through positions and velocities, accurate to about {number(overall.accuracy, 1)}. '
    if overall.covered < _COVERED * overall.duration:
        text += f'Samples are missing: rms and work cover {instant(overall.covered)} s of '
        text += f'{instant(overall.duration)} s. '
    heads = (Column(linked('stretch'), 'text'), *columns)
    groups = [('', rows[: len(known)]), ('', rows[len(known) :])]
    return table('Swing, impacts and energy', heads, groups, note=linked(text + note))


def _pair(
    name: str, unit: str, measured: float, predicted: float, apart: float | None = None
) -> tuple[str, str, str, str, str]:
    """Return a row with a measured and a predicted value."""
    handy = unit_for(unit, measured, predicted) if unit not in ('', 'cycles') else None
    factor = 1.0 if handy is None else handy.factor
    one, other = aligned((factor * measured, factor * predicted), 7)
    far = measured - predicted if apart is None else apart
    last = worded(unit if handy is None else handy.name)
    return linked(name), one, other, difference(factor * far), last


def comparison_table(stretch: StretchComparison) -> Html:
    """Return the table of measured and predicted values; empty if nothing was measured."""
    measured, orbit = stretch.measured, stretch.predicted
    if measured is None:
        return Html()
    x_max = ratio = per_cycle = impulse = math.nan
    if orbit is not None:
        x_max, ratio = orbit.x_max, orbit.amplitude_ratio
        per_cycle, impulse = orbit.impacts / orbit.cycles, _mean(stretch.predicted_impulse)
    whole = [
        _pair('largest |X|', 'm', measured.x_max, x_max),
        _pair('Xmax / A', '', measured.amplitude_ratio, ratio),
        _pair('rms of X', 'm', measured.x_rms, math.nan),
        _pair('impacts per cycle', '', measured.impacts_per_cycle, per_cycle),
        _pair('mean impulse', 'N s', measured.mean_impulse, impulse),
    ]
    if stretch.decay is not None:
        decay = stretch.decay
        whole.append(_pair('decay per period', '', decay.measured, decay.predicted))
    part = f'{instant(measured.start)} s to {instant(measured.end)} s'
    groups = [(f'Motion, measured from {part}', whole)]
    last = measured.last_period
    count = 0 if last is None else len(last.stops)
    for i in range(min(count, _MOST_IMPACTS)):
        rows = []
        for field, name, unit in _QUANTITIES:
            one = _entry(getattr(last, field), i)
            source = stretch.predicted_impulse if field == 'impulse' else getattr(orbit, field, ())
            other = _entry(source, i)
            apart = None
            if field == 'phases' and orbit is not None:
                # The same instant may be counted from another cycle of the force.
                apart = math.remainder(one - other, orbit.cycles)
            rows.append(_pair(name, unit, one, other, apart))
        assert last is not None
        groups.append((linked(f'Impact {i + 1}, on stop {last.stops[i]}'), rows))
    note = ''
    if count > _MOST_IMPACTS:
        note = f'The first {_MOST_IMPACTS} of {count} impacts of the period.'
    columns = (
        Column('quantity', 'text'),
        Column('measured'),
        Column(linked('predicted')),
        Column('difference'),
        Column('unit', 'text'),
    )
    return table('Measured and predicted', columns, groups, note=note)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan


def _entry(values: Sequence[float], index: int) -> float:
    return float(values[index]) if index < len(values) else math.nan


def energy_table(stretch: StretchComparison) -> Html:
    """Return where the energy of a period came from and went; empty if that is not known."""
    energy = stretch.energy
    if energy is None:
        return Html()
    periods = max(1, energy.periods)
    span = 'period' if stretch.cycles else 'cycle'
    given = [('work of the force', energy.force), ('compressed air', energy.air)]
    taken = [
        ('dashpot', energy.dashpot),
        ('friction', energy.friction),
        ('impacts', energy.impacts),
        ('change of stored energy', energy.stored),
        ('unexplained', energy.residual),
    ]
    values = [value / periods for _, value in given + taken]
    unit = unit_for('J', values)
    total = sum(value for _, value in given) / periods
    most = max((abs(v) for v in values if math.isfinite(v)), default=0.0) or 1.0
    shares = [100.0 * value / total if total > 0.0 else math.nan for value in values]
    rows: list[tuple[str, ...]] = []
    for (name, _), value, amount, share in zip(
        given + taken,
        values,
        aligned([unit.factor * value for value in values], 5),
        aligned(shares, 5),
        strict=True,
    ):
        kind = 'bar taken' if len(rows) >= len(given) else 'bar'
        length = 100.0 * abs(value) / most if math.isfinite(value) else 0.0
        bar = element('span', class_=kind, style=f'width:{length:.1f}%')
        rows.append((linked(name), amount, share, bar))
    columns = (
        Column('', 'text'),
        Column(linked(f'{unit.name} per {span}')),
        Column('% of input'),
        Column('', 'bars'),
    )
    tolerance = number(unit.factor * energy.tolerance / periods, 2)
    note = f'Mean of {energy.periods} {span}s from {instant(energy.start)} to '
    note += f'{instant(energy.end)} s, from the log alone; interpolation between the samples '
    note += f'accounts for up to {tolerance} {unit.name}.'
    groups = [('Input', rows[: len(given)]), ('Output', rows[len(given) :])]
    return table('Energy balance', columns, groups, note=linked(note))


def multiplier_table(stretch: StretchComparison) -> Html:
    """Return the stability multipliers of the predicted motion; empty without a prediction."""
    orbit = stretch.predicted
    if orbit is None or not orbit.multipliers:
        return Html()
    rows = [
        (str(i), number(abs(m), 6), number(math.degrees(cmath.phase(m)), 5))
        for i, m in enumerate(orbit.multipliers, 1)
    ]
    columns = (Column('', 'text'), Column('modulus'), Column('angle [°]'))
    stable = 'all within the unit circle' if orbit.stable else 'not all within the unit circle'
    note = f'In each period deviations are multiplied by these: {stable}.'
    caption = linked('Multipliers of the predicted motion')
    return table(caption, columns, [('', rows)], note=linked(note))


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, int | float):
        return number(float(value), 9)
    if isinstance(value, list | tuple):
        return f'[{", ".join(_value(entry) for entry in value)}]'
    return str(value)


def parameter_table(stretch: StretchComparison, before: StretchComparison | None) -> Html:
    """Return the parameters of a stretch; those that differ from the one before are marked."""
    values = {**stretch.parameters.as_dict(), **stretch.control}
    earlier = {} if before is None else {**before.parameters.as_dict(), **before.control}
    changed = [name for name, value in values.items() if earlier.get(name, value) != value]
    rows = []
    for name, value in values.items():
        cells = [name, _value(value), worded(ALL_SPECS[name].unit) if name in ALL_SPECS else '']
        if changed:
            cells.append(_value(earlier[name]) if name in changed else '')
        rows.append(tuple(cells))
    columns = [Column('parameter', 'text'), Column('value'), Column('unit', 'text')]
    note = 'As logged.'
    if changed:
        columns.append(Column('before'))
        note += ' Highlighted: changed since the previous stretch.'
    return table('Parameters', columns, [('', rows)], note=note, marked=changed)
