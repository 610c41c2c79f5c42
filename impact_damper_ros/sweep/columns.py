"""
The columns of a sweep's table: name, unit, type and meaning; motions that are the same; CSV.

Lines that begin with # come first: the inputs of the sweep and the units of its columns, as JSON.
What is not known is an empty cell, a list is written as JSON.
"""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters

from .plan import Point, SweepPlan
from .steady_state import SteadyState

__all__ = [
    'FAILED',
    'MEASURES',
    'Column',
    'Row',
    'columns_of',
    'csv_inputs',
    'csv_rows',
    'failed_row',
    'identified',
    'place_of',
    'row_of',
    'write_csv',
]


Kind = Literal['double', 'integer', 'bool', 'text', 'doubles', 'integers']
#: One row: a value, or None, for each column that has one.
Row = dict[str, Any]


class Column(NamedTuple):
    """
    One column.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        Type of its values; 'doubles' and 'integers' are lists.
    unit : str
        SI unit; empty for a pure number or a text.
    description : str
        What it means.
    """

    name: str
    kind: Kind
    unit: str
    description: str

    @property
    def label(self) -> str:
        """Name with unit."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name


_PLACE = (
    Column('point', 'integer', '', 'Number of the rig in the sweep, from 0.'),
    Column(
        'direction',
        'text',
        '',
        'up or down: the rig started from the last state of the one before in this direction; '
        'null: from its initial conditions.',
    ),
)
_VERDICT = (
    Column('ok', 'bool', '', 'Whether the rig could be simulated.'),
    Column('reason', 'text', '', 'If not, why not.'),
    Column(
        'motion',
        'text',
        '',
        'What it settled into: periodic, without impacts, at rest, quasi-periodic, chaotic, '
        'undecided, or not periodically driven, by the force or by a control whose samples fall '
        'elsewhere in each cycle.',
    ),
    Column('settled', 'bool', '', 'Whether the motion repeats, to the tolerance of the sweep.'),
    Column('settling_cycles', 'integer', '', 'Cycles of the force before it was measured.'),
    Column('measured_cycles', 'integer', '', 'Cycles of the force over which it was measured.'),
)
_NUMBERS = (
    Column('cycle', 'double', 's', 'Cycle of the force; of the spring, if there is no force.'),
    Column('period', 'integer', '', 'Period k in cycles of the force; null if none was found.'),
    Column(
        'impacts',
        'integer',
        '',
        'Impacts N in a period, those of a chatter up to its cut; null if it does not repeat.',
    ),
    Column(
        'stops',
        'text',
        '',
        'Stops hit in a period, in order; 1~ stands for a whole chatter on stop 1 to rest.',
    ),
    Column('x_max', 'double', 'm', 'Largest |X|.'),
    Column(
        'x_max_ratio',
        'double',
        '',
        'Largest |X| over the amplitude A without impacts; null without one force.',
    ),
    Column('x_rms', 'double', 'm', 'Root mean square of X.'),
    Column('x_mean', 'double', 'm', 'Mean of X.'),
    Column('impacts_per_cycle', 'double', '', 'Impacts per cycle of the force.'),
    Column(
        'lyapunov_exponent',
        'double',
        '1/s',
        'Largest Lyapunov exponent: of a motion that repeats ln|largest multiplier| over its '
        'period; else the mean growth of a deviation over the time measured. Under gap control '
        'by two neighbouring rigs; null if their controls decide differently too often.',
    ),
    Column(
        'lyapunov_uncertainty',
        'double',
        '1/s',
        'Half of its 95 % interval, from the growths in 20 parts of the time measured; of a '
        'motion that repeats the difference between two periods.',
    ),
    Column(
        'largest_multiplier',
        'double',
        '',
        'Modulus of the largest multiplier of a period; null if the motion does not repeat, or '
        'as the exponent.',
    ),
    Column('stick_share', 'double', '', 'Share of the time that friction holds m in the gap.'),
    Column('rest_share', 'double', '', 'Share of the time that m rests on a stop.'),
    Column(
        'chatter_share',
        'double',
        '',
        'Share of the time in complete chatters: from the first of the impacts on one stop that '
        'follow one another ever faster to the rest in which they end.',
    ),
    Column('events', 'integer', '', 'Events of the whole run.'),
)
_ATTRACTOR = (
    Column(
        'attractor',
        'integer',
        '',
        'Number of the motion among those that the same rig settled into, from 0, the most '
        'frequent first.',
    ),
)
_SECTION = (
    Column('section_x', 'doubles', 'm', 'X at the ends of cycles: of a period, or the last ones.'),
    Column('section_velocity', 'doubles', 'm/s', "X' there."),
    Column('section_offset', 'doubles', 'm', 'Y there.'),
    Column('section_relative_velocity', 'doubles', 'm/s', "Y' there."),
    Column('impact_stop', 'integers', '', 'Stop of each impact in the same cycles.'),
    Column('impact_phase', 'doubles', '', 'Its phase in cycles of the force, from 0 to 1.'),
    Column('impact_speed', 'doubles', 'm/s', 'Speed of approach of m and the stop.'),
)
_CONTROLLED = (
    Column(
        'state',
        'text',
        '',
        'State of rig and control at the end, as ControlledRig.snapshot gives it, in JSON.',
    ),
)
#: Measures that can be drawn and made least or greatest.
MEASURES: dict[str, Column] = {
    column.name: column
    for column in _NUMBERS
    if (column.kind == 'double' and column.name != 'cycle') or column.name in ('period', 'impacts')
}


def columns_of(plan: SweepPlan) -> list[Column]:
    """Return all columns of a sweep's table, in order."""
    varied = [
        Column(
            str(target),
            'bool' if target.spec.kind == 'bool' else 'double',
            target.spec.unit,
            target.spec.description,
        )
        for axis in plan.axes
        for target in axis.targets
    ]
    controlled = _CONTROLLED if plan.control.active else ()
    return [*_PLACE, *varied, *_VERDICT, *_NUMBERS, *_ATTRACTOR, *_SECTION, *controlled]


def place_of(plan: SweepPlan, point: Point) -> Row:
    """Return the columns that say which rig it is."""
    return {
        'point': point.index,
        'direction': point.direction or None,
        **{str(target): value for target, value in plan.settings(point)},
    }


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def row_of(state: SteadyState, parameters: RigParameters) -> Row:
    """Return the columns that say what a rig does."""
    amplitude = parameters.response_amplitude if parameters.periodic_force else math.inf
    ratio = state.x_max / amplitude if math.isfinite(amplitude) else math.nan
    return {
        'ok': True,
        'reason': None,
        'motion': state.kind.value,
        'settled': state.period > 0,
        'settling_cycles': state.settling_cycles,
        'measured_cycles': state.measured_cycles,
        'cycle': state.cycle,
        'period': state.period or None,
        'impacts': state.impacts if state.period else None,
        'stops': ','.join(state.stops) if state.period else None,
        'x_max': state.x_max,
        'x_max_ratio': _known(ratio),
        'x_rms': state.x_rms,
        'x_mean': state.x_mean,
        'impacts_per_cycle': state.impacts_per_cycle,
        'lyapunov_exponent': _known(state.exponent.value),
        'lyapunov_uncertainty': _known(state.exponent.uncertainty),
        'largest_multiplier': _known(state.multiplier),
        'stick_share': state.shares.stick,
        'rest_share': state.shares.rest,
        'chatter_share': state.shares.chatter,
        'events': state.events,
        **_lists(
            ('section_x', 'section_velocity', 'section_offset', 'section_relative_velocity'),
            state.section.T.tolist(),
        ),
        'impact_stop': [int(stop) for stop in state.hits[:, 0]],
        'impact_phase': state.hits[:, 1].tolist(),
        'impact_speed': state.hits[:, 2].tolist(),
    }


def _lists(names: Sequence[str], values: Sequence[list[float]]) -> Row:
    return dict(zip(names, values, strict=True))


def failed_row(reason: str) -> Row:
    """Return the columns of a rig that could not be simulated."""
    return {'ok': False, 'reason': reason}


#: Sections that differ by less, relative to their size, are the same motion.
_SAME = 1e-3
#: Stands for the attractor of a rig that could not be simulated.
FAILED = -1
_SECTION_NAMES = ('section_x', 'section_velocity', 'section_offset', 'section_relative_velocity')


class _Known(NamedTuple):
    """A motion that has been met: its number, and its section."""

    number: int
    section: NDArray[np.float64]


def _kind(row: Row) -> Hashable:
    """Return what two rows of one attractor share exactly; irregular motions are all one."""
    return row['motion'], row['period'], row['stops']


def _section(row: Row) -> NDArray[np.float64]:
    """Return the section of a motion that repeats, relative to its size; shape (4, k)."""
    section = np.array([row[name] for name in _SECTION_NAMES], dtype=float)
    size = row['x_max'] + float(np.ptp(section[2])) or 1.0
    section /= size * np.array([[1.0], [math.tau / row['cycle']]] * 2).reshape(4, 1)
    if row['impacts'] == 0:
        # Nothing tells m where in the gap to be
        section[2] = 0.0
    return section


def _same(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether two sections are the same, from whichever cycle they begin."""
    return any(
        float(np.abs(np.roll(one, shift, axis=1) - other).max()) < _SAME
        for shift in range(one.shape[1])
    )


def identified(rows: Iterable[tuple[Hashable, Row]]) -> NDArray[np.int64]:
    """Return numbers for the motions that each rig settles into."""
    known: dict[tuple[Hashable, Hashable], list[_Known]] = {}
    rigs: list[Hashable] = []
    numbers: list[int] = []
    met: dict[Hashable, int] = {}
    for rig, row in rows:
        rigs.append(rig)
        if not row['ok']:
            numbers.append(FAILED)
            continue
        section = _section(row) if row['settled'] else np.zeros((4, 1))
        motions = known.setdefault((rig, _kind(row)), [])
        found = next((one.number for one in motions if _same(one.section, section)), FAILED)
        if found == FAILED:
            found = met.get(rig, 0)
            met[rig] = found + 1
            motions.append(_Known(found, section))
        numbers.append(found)
    frequency = Counter(zip(rigs, numbers, strict=True))
    ranks: dict[tuple[Hashable, int], int] = {}
    for rig, count in met.items():
        order = sorted(range(count), key=lambda number: (-frequency[rig, number], number))
        ranks.update({(rig, number): rank for rank, number in enumerate(order)})
    return np.array(
        [
            ranks[rig, number] if number != FAILED else FAILED
            for rig, number in zip(rigs, numbers, strict=True)
        ],
        dtype=np.int64,
    )


_TITLE = '# Steady states of an impact damper. In pandas: read_csv(file, comment="#")'
_INPUTS = '# impact_damper_ros.sweep: '
_UNITS = '# units: '
_LISTS = ('doubles', 'integers')


def write_csv(
    stream: IO[str], inputs: dict[str, Any], columns: Sequence[Column], rows: Iterable[Row]
) -> None:
    """Write a table."""
    units = {column.name: column.unit for column in columns if column.unit}
    stream.write(f'{_TITLE}\n{_INPUTS}{json.dumps(inputs)}\n{_UNITS}{json.dumps(units)}\n')
    table = csv.writer(stream, lineterminator='\n')
    table.writerow([column.name for column in columns])
    table.writerows([_cell(row.get(column.name)) for column in columns] for row in rows)


def _cell(value: Any) -> str:
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value) if isinstance(value, list) else str(value)


def csv_inputs(path: Path) -> dict[str, Any]:
    """Return the inputs that a table was made from."""
    with path.open(encoding='utf-8', newline='') as stream:
        for line in stream:
            if line.startswith(_INPUTS):
                inputs: dict[str, Any] = json.loads(line.removeprefix(_INPUTS))
                return inputs
            if not line.startswith('#'):
                break
    raise ValueError(f'{path} is no table of a sweep')


def csv_rows(path: Path, columns: Sequence[Column]) -> list[list[Any]]:
    """Return the values of a table, column by column."""
    with path.open(encoding='utf-8', newline='') as stream:
        csv.field_size_limit(1 << 30)  # the state of rig and control is a long text
        table = csv.reader(line for line in stream if not line.startswith('#'))
        if next(table, None) != [column.name for column in columns]:
            raise ValueError(f'{path} has not the columns of its sweep')
        return [
            [_value(column, cell) for cell in cells]
            for column, cells in zip(columns, zip(*table, strict=True), strict=True)
        ]


def _value(column: Column, cell: str) -> Any:
    if column.kind == 'text':
        return cell or None
    if not cell:
        return None
    if column.kind == 'bool':
        return cell == 'true'
    if column.kind in _LISTS:
        return json.loads(cell)
    return int(cell) if column.kind == 'integer' else float(cell)
