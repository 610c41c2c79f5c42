# SPDX-License-Identifier: Apache-2.0
"""The tables of a comparison: one line per stretch, and the numbers of a stretch."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

from impact_damper_ros.compare import Overall, StretchComparison
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.solved_orbits import transmissibility
from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.parameters.all_parameters import unit_of
from impact_damper_ros.parameters.quoting import plural, setting
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .formatting import NONE, Unit, instant, number, numbers, quantity, unit_for
from .ring_down_figure import percent_of_loss
from .swept_response_figure import base_amplitude, level_of
from .table import ColumnHead, Table
from .transmissibility_text import TRANSMISSIBILITY_NAMES

#: Changes that are named where a stretch begins; impacts of a period that are listed.
_MOST_CHANGES, _MOST_IMPACTS = 4, 8
#: Rows of a ring-down.
_RING_DOWN_ROWS = 12
#: Most steps of a sweep that are listed.
_MOST_STEPS = 64

_AT_IMPACTS: tuple[tuple[str, str, str], ...] = (
    ('phases', 'phase', 'cycles'),
    ('x', 'X', 'm'),
    ('primary_velocity_before', 'X′ before', 'm/s'),
    ('primary_velocity_after', 'X′ after', 'm/s'),
    ('damper_velocity_before', 'Z′ before', 'm/s'),
    ('damper_velocity_after', 'Z′ after', 'm/s'),
    ('impulse', 'impulse', 'N s'),
)


def cause_of(stretch: StretchComparison) -> str:
    """Return why a stretch begins; of many changes, the most important ones."""
    changes = (stretch.cause or stretch.begins.value).split('), ')
    if len(changes) <= _MOST_CHANGES:
        return '), '.join(changes)
    # Changes from or to none accompany another change, and matter least
    changes.sort(key=lambda change: 'none' in change)
    first = [change.rstrip(')') + ')' for change in changes[:_MOST_CHANGES]]
    return f'{", ".join(first)} and {len(changes) - _MOST_CHANGES} more changes'


def motion_words(stretch: StretchComparison) -> str:
    """Return the kind of motion in a few words."""
    count, cycles = stretch.impacts_per_period, stretch.cycles
    if not count or not cycles:
        return stretch.kind.value
    return f'{stretch.kind.value}, {plural(count, "impact")} in {plural(cycles, "cycle")}'


def overview_table(
    stretches: Sequence[StretchComparison], detailed: Collection[int], note: str
) -> Table:
    """Return the table of all stretches."""
    measured = [stretch.measured for stretch in stretches]
    unit = unit_for('m', [m.x_max for m in measured if m is not None])

    def swing(orbit: PeriodicOrbit | None) -> str:
        if orbit is None:
            return NONE
        size = number(unit.factor * orbit.x_max, 5)
        return size if orbit.stable else f'{size} ({orbit.stability})'

    rows = [
        (
            str(s.number),
            s.verdict,
            f'{instant(s.start)} to {instant(s.end)}',
            cause_of(s),
            motion_words(s),
            NONE if m is None else number(m.impacts_per_cycle, 4),
            NONE if m is None else number(unit.factor * m.x_max, 5),
            swing(s.predicted),
        )
        for s, m in zip(stretches, measured, strict=True)
    ]
    columns = [
        ColumnHead('stretch', 'text'),
        ColumnHead('verdict', 'verdict'),
        ColumnHead('rig time [s]', 'span'),
        ColumnHead('begins with', 'text'),
        ColumnHead('motion', 'text'),
        ColumnHead('impacts per cycle'),
        ColumnHead(f'largest |X| [{unit.name}]'),
        ColumnHead(f'predicted [{unit.name}]'),
    ]
    note = (
        'Impacts per cycle and largest |X| are those of the steady part, or of the second half of '
        f'a stretch that has none. {note}'
    )
    links = {str(n): f'#stretch-{n}' for n in detailed}
    return Table(columns, [('', rows)], 'All stretches', note, links)


def _work_of(rigs: Iterable[RigParameters]) -> str:
    """Return the name of the work of force and base on rigs."""
    groups = {name for rig in rigs for name in _moving(rig)}
    if groups == {'base'}:
        return 'work of the base'
    return 'work of force and base' if 'base' in groups else 'work of the force'


def _moving(rig: RigParameters) -> Iterator[str]:
    """Yield force and base, if they act on a rig."""
    if any(rig.force_amplitudes) or rig.multisine_level:
        yield 'force'
    if rig.base_motion.moves:
        yield 'base'


def overall_table(
    stretches: Sequence[StretchComparison], overall: Overall | None, note: str
) -> Table | None:
    """Return |X|, impacts and energy of whole stretches and of the run; None if unknown."""
    known = {str(s.number): s.overall for s in stretches if s.overall is not None}
    if overall is None or not known:
        return None
    entries = {**known, 'all': overall} if len(known) > 1 else known
    length = unit_for('m', [e.x_max for e in entries.values()])
    work = [(e.force_work, e.impact_energy, e.dashpot_energy) for e in entries.values()]
    energy = unit_for('J', work)

    def size(name: str) -> Callable[[Overall], str]:
        return lambda e: number(length.factor * getattr(e, name), 5)

    def joules(name: str) -> Callable[[Overall], str]:
        return lambda e: number(energy.factor * getattr(e, name), 5)

    columns: dict[str, Callable[[Overall], str]] = {
        'length [s]': lambda e: instant(e.duration),
        f'largest |X| [{length.name}]': size('x_max'),
        f'rms of X [{length.name}]': size('x_rms'),
        'impacts': lambda e: str(e.impacts),
        'on stop 1': lambda e: str(e.impacts_on_stop_1),
        'on stop 2': lambda e: str(e.impacts_on_stop_2),
        f'{_work_of(s.parameters for s in stretches)} [{energy.name}]': joules('force_work'),
        f'taken from M by impacts [{energy.name}]': joules('impact_energy'),
        f'lost in impacts [{energy.name}]': joules('impact_loss'),
        f'taken by the dashpot [{energy.name}]': joules('dashpot_energy'),
    }
    rows = [(name, *(text(e) for text in columns.values())) for name, e in entries.items()]
    note = f'Over whole stretches, transients included. {note}'
    return Table.of_rows(('stretch', *columns), rows, 1, 'Largest |X|, impacts and energy', note)


def _pair(name: str, unit: str, measured: float, predicted: float) -> tuple[str, ...]:
    """Return a row with a measured and a predicted value."""
    factor, handy = 1.0, unit
    if unit not in ('', 'cycles'):
        factor, handy = unit_for(unit, measured, predicted)
    values = (number(factor * value, 7) for value in (measured, predicted))
    return name, *values, number(factor * (measured - predicted), 2), handy


def comparison_table(stretch: StretchComparison) -> Table | None:
    """Return the measured and predicted numbers of a motion; None if nothing was measured."""
    measured, orbit = stretch.measured, stretch.predicted
    if measured is None:
        return None
    x_max = ratio = per_cycle = impulse = math.nan
    if orbit is not None:
        x_max, ratio = orbit.x_max, orbit.x_max_ratio
        per_cycle = orbit.impacts / orbit.cycles
        impulse = sum(stretch.predicted_impulse) / max(len(stretch.predicted_impulse), 1)
    whole = [
        _pair('largest |X|', 'm', measured.x_max, x_max),
        _pair('Xmax / A', '', measured.x_max_ratio, ratio),
        _pair('rms of X', 'm', measured.x_rms, math.nan),
        _pair('impacts per cycle', '', measured.impacts_per_cycle, per_cycle),
        _pair('mean impulse', 'N s', measured.mean_impulse, impulse),
    ]
    rig = stretch.parameters
    note = ''
    if rig.base_motion.moves and rig.sweep_mode == 'off':
        taken = Transmissibility() if orbit is None else transmissibility(orbit)
        rows = zip(TRANSMISSIBILITY_NAMES, measured.transmissibility, taken, strict=True)
        whole += [_pair(name, '', *pair) for name, *pair in rows]
        alone = map(number, Transmissibility.without_damper(rig))
        note = f'Without the damper the transmissibilities are {", ".join(alone)}. '
    if stretch.decay is not None:
        decay = stretch.decay
        whole.append(_pair('decay per period', '', decay.measured, decay.predicted))
        if decay.periods:
            note += f'The decay is that of {plural(decay.periods, "period")}. '
        note += f'At the end the motion is {number(decay.distance, 2)} of its size from the '
        note += f'predicted one; the digits resolve {number(decay.floor, 1)}.'
    names = 'measured', 'predicted', 'difference'
    columns = [ColumnHead('quantity', 'text'), *map(ColumnHead, names), ColumnHead('unit', 'text')]
    span = f'{instant(measured.start)} s to {instant(measured.end)} s'
    groups = [(f'Motion, measured from {span}', whole)]
    return Table(columns, groups, 'Measured and predicted', note)


def ring_down_table(stretch: StretchComparison) -> Table | None:
    """Return the losses of the cycles of a ring-down, by amplitude; None for another stretch."""
    found = stretch.ring_down
    if found is None:
        return None
    curve = {name: values[::-1] for name, values in found.curve(_RING_DOWN_ROWS).items()}
    unit, loss = unit_for('m', found.amplitude), curve['median']
    columns = {
        f'amplitude [{unit.name}]': numbers(unit.factor * curve['amplitude'], 4),
        '[g]': numbers(curve['acceleration'], 3),
        'cycles': numbers(curve['cycles'], 6),
        'loss Ψ': numbers(loss, 4),
        'loss factor': numbers(loss / math.tau, 4),
        'ζ [%]': numbers(map(percent_of_loss, loss), 4),
    }
    note = (
        f'{plural(len(found.loss), "cycle")} from '
        f'{quantity(found.amplitude, "m", 4)} down; each row is the median of the cycles of about '
        'that amplitude. Ψ = 1 − E₊/E from E = M V²/2 at the upward passages of X through its '
        f'middle, loss factor Ψ/2π. The dashpot alone loses {number(found.dashpot_loss, 4)}'
    )
    if found.bound < 1.0:
        note += f', two impacts per cycle at X = 0 would lose {number(found.bound, 4)}'
    return Table.of_columns(columns, 0, 'Ring-down', f'{note}.')


def response_table(stretch: StretchComparison) -> Table | None:
    """Return the response of M at the steps of a sweep; None if there is none."""
    found, rig = stretch.response, stretch.parameters
    if found is None:
        return None
    level, unit = level_of(rig, found.level)
    length = unit_for('m', float(found.x.max()))
    step = math.ceil(len(found.time) / _MOST_STEPS)
    columns = {
        'way': ['up' if upwards else 'down' for upwards in found.upwards],
        '[Hz]': numbers(found.frequency / math.tau, 4),
        f'level [{unit}]': numbers(level, 3),
        f'|X| [{length.name}]': numbers(length.factor * found.x, 4),
        f'without damper [{length.name}]': numbers(length.factor * found.x_without, 4),
    }
    if rig.swept == 'base':
        columns |= {
            f'|X − b| [{length.name}]': numbers(length.factor * found.relative, 4),
            '|X|/|b|': numbers(found.x / base_amplitude(rig, found), 4),
        }
    columns |= {
        '|X″| [g]': numbers(found.acceleration / STANDARD_GRAVITY, 3),
        'impacts per cycle': numbers(found.impacts, 3),
    }
    note = 'The largest values at each frequency, late in its time; without damper the settled |X|'
    if step > 1:
        note += f'; one in {step} of {len(found.time)} steps'
    shown = {name: cells[::step] for name, cells in columns.items()}
    return Table.of_columns(shown, 1, 'Response over frequency', f'{note}.')


def impact_table(stretch: StretchComparison) -> Table | None:
    """Return the impacts of the last period, measured and predicted; None if it has no period."""
    orbit = stretch.predicted
    last = None if stretch.measured is None else stretch.measured.last_period
    if last is None or not last.stops:
        return None
    columns, heads = [], [ColumnHead('', 'text')]
    for field, name, unit in _AT_IMPACTS:
        there = getattr(last, field)
        here = stretch.predicted_impulse if field == 'impulse' else getattr(orbit, field, ())
        handy = unit_for(unit, there, here) if unit != 'cycles' else Unit(1.0, unit)
        heads.append(ColumnHead(f'{name} [{handy.name}]'))
        columns.append((field, handy.factor, there, here))
    groups = []
    for i, stop in enumerate(last.stops[:_MOST_IMPACTS]):
        rows: list[list[str]] = [['measured'], ['predicted'], ['difference']]
        for field, factor, there, here in columns:
            one, other = _entry(there, i), _entry(here, i)
            apart = one - other
            if field == 'phases' and orbit is not None:
                # Both may count the same instant from different cycles of the force.
                apart = math.remainder(apart, orbit.cycles)
            digits = (9, 9, 2) if field == 'phases' else (7, 7, 2)
            for row, value, count in zip(rows, (one, other, apart), digits, strict=True):
                row.append(number(factor * value, count))
        shown = rows if orbit is not None else rows[:1]
        groups.append((f'Impact {i + 1}, on stop {stop}', shown))
    note = ''
    if len(last.stops) > _MOST_IMPACTS:
        note = f'The first {_MOST_IMPACTS} of {len(last.stops)} impacts of the period.'
    return Table(heads, groups, 'Impacts of the last period', note)


def _entry(values: Sequence[float], index: int) -> float:
    return float(values[index]) if index < len(values) else math.nan


def energy_table(stretch: StretchComparison) -> Table | None:
    """Return the balance of energy of a period; None if unknown."""
    energy = stretch.energy
    if energy is None:
        return None
    periods = max(1, energy.periods)
    span = 'period' if stretch.cycles else 'cycle'
    given = [(_work_of([stretch.parameters]), energy.force), ('compressed air', energy.air)]
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
    rows = [
        (
            name,
            number(unit.factor * value, 5),
            number(100.0 * value / total if total > 0.0 else math.nan, 4),
            f'{100.0 * abs(value) / most if math.isfinite(value) else 0.0:.1f}',
        )
        for (name, _), value in zip(given + taken, values, strict=True)
    ]
    columns = [
        ColumnHead('', 'text'),
        ColumnHead(f'{unit.name} per {span}'),
        ColumnHead('% of input'),
        ColumnHead('', 'bars'),
    ]
    explained = number(unit.factor * energy.tolerance / periods, 2)
    note = f'Mean of {energy.periods} {span}s from {instant(energy.start)} to '
    note += f'{instant(energy.end)} s; up to {explained} {unit.name} may remain unexplained.'
    groups = [('Input', rows[: len(given)]), ('Output', rows[len(given) :])]
    return Table(columns, groups, 'Energy balance', note)


def multiplier_table(stretch: StretchComparison) -> Table | None:
    """Return the stability multipliers of the predicted motion; None without a prediction."""
    orbit = stretch.predicted
    if orbit is None or not orbit.multipliers:
        return None
    rows = [
        (str(i), number(abs(m), 6), number(math.degrees(cmath.phase(m)), 5))
        for i, m in enumerate(orbit.multipliers, 1)
    ]
    stable = 'all within the unit circle' if orbit.stable else 'not all within the unit circle'
    note = f'In each period deviations are multiplied by these: {stable}.'
    head = ('', 'modulus', 'angle [°]')
    return Table.of_rows(head, rows, 1, 'Multipliers of the predicted motion', note)


def parameter_table(stretch: StretchComparison, before: StretchComparison | None) -> Table | None:
    """Return all parameters of the first stretch, and of later ones those that have changed."""

    def values_of(one: StretchComparison) -> dict[str, str]:
        entries = {**one.parameters.as_dict(), **one.control}
        return {name: setting(value) for name, value in entries.items()}

    values = values_of(stretch)
    units = {name: unit_of(name, values) for name in values}
    columns = [ColumnHead('parameter', 'text'), ColumnHead('value'), ColumnHead('unit', 'text')]
    if before is None:
        rows = [(name, value, units[name]) for name, value in values.items()]
        return Table(columns, [('', rows)], 'Parameters', 'As logged.')
    earlier = values_of(before)
    changed = [name for name, value in values.items() if earlier.get(name) != value]
    if not changed:
        return None
    lines = [(n, values[n], units[n], earlier.get(n, NONE)) for n in changed]
    note = f'All others are those of stretch {before.number}.'
    return Table([*columns, ColumnHead('before')], [('', lines)], 'Changed parameters', note)


#: The tables of a stretch, in order.
STRETCH_TABLES = (
    *(impact_table, ring_down_table, response_table),
    *(comparison_table, multiplier_table, energy_table),
)
