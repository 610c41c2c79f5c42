"""
The table of a sweep: its columns, its rows, and its file in Parquet or CSV.

Units, descriptions and the inputs of the sweep are in the metadata of a Parquet file, and in
comments at the head of a CSV file. The format is not Zarr: a row is a rig, with texts, missing
values and lists of different lengths beside its numbers, and the table is one file.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator
from itertools import dropwhile, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.outputs import whole
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.quoting import shown

from .plan import SweepPlan
from .steady_state import SteadyState

if TYPE_CHECKING:
    from .journal import Journal


Array = NDArray[np.float64]
#: One row: a value, or None, for each column that has one.
Row = dict[str, Any]
#: File name extensions of tables.
FORMATS = ('.parquet', '.csv')
#: Number that stands for the attractor of a rig that could not be simulated.
FAILED = -1

_INPUTS = b'impact_damper_ros.sweep'
#: Key under which pandas stores the attributes of a table.
_PANDAS = b'PANDAS_ATTRS'
_ROWS_AT_ONCE = 16384
#: Sections that differ by less, relative to their size, are the same motion.
_SAME = 1e-3


#: Types of columns; doubles and integers are lists.
Kind = Literal['double', 'integer', 'bool', 'text', 'doubles', 'integers']


class Column(NamedTuple):
    """A column: its name, type, SI unit and meaning."""

    name: str
    kind: Kind
    unit: str
    description: str

    @property
    def label(self) -> str:
        """Name with unit."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name


#: Name, type, unit and meaning of all columns but those of the varied parameters.
_COLUMNS = """\
point | integer | - | Number of the rig in the sweep, from 0.
direction | text | - | up or down: the rig started from the last state of the one before in this
    direction; null: from its initial conditions.
ok | bool | - | Whether the rig could be simulated.
reason | text | - | If not, why not.
motion | text | - | What it settled into: periodic, without impacts, at rest, quasi-periodic,
    chaotic, undecided, or not periodically driven, by the force or by a control whose samples fall
    elsewhere in each cycle.
settled | bool | - | Whether the motion repeats, to the tolerance of the sweep.
settling_cycles | integer | - | Cycles of the force before it was measured.
measured_cycles | integer | - | Cycles of the force over which it was measured.
cycle | double | s | Cycle of the force; of the spring, if there is no force.
period | integer | - | Period k in cycles of the force; null if none was found.
impacts | integer | - | Impacts N in a period, those of a chatter up to its cut; null if it does
    not repeat.
stops | text | - | Stops hit in a period, in order; 1~ stands for a whole chatter on stop 1 to
    rest.
x_max | double | m | Largest |X|.
x_max_ratio | double | - | Largest |X| over the amplitude A without impacts; null without one
    force.
x_rms | double | m | Root mean square of X.
x_mean | double | m | Mean of X.
impacts_per_cycle | double | - | Impacts per cycle of the force.
lyapunov_exponent | double | 1/s | Largest Lyapunov exponent: of a motion that repeats ln|largest
    multiplier| over its period; else the mean growth of a deviation over the time measured. Under
    gap control by two neighbouring rigs; null if their controls decide differently too often.
lyapunov_uncertainty | double | 1/s | Half of its 95 % interval, from the growths in 20 parts of
    the time measured; of a motion that repeats the difference between two periods.
largest_multiplier | double | - | Modulus of the largest multiplier of a period; null if the motion
    does not repeat, or as the exponent.
stick_share | double | - | Share of the time that friction holds m in the gap.
rest_share | double | - | Share of the time that m rests on a stop.
chatter_share | double | - | Share of the time in complete chatters: from the first of the impacts
    on one stop that follow one another ever faster to the rest in which they end.
events | integer | - | Events of the whole run.
attractor | integer | - | Number of the motion among those that the same rig settled into, from 0,
    the most frequent first.
section_x | doubles | m | X at the ends of cycles: of a period, or the last ones.
section_velocity | doubles | m/s | X' there.
section_offset | doubles | m | Y there.
section_relative_velocity | doubles | m/s | Y' there.
impact_stop | integers | - | Stop of each impact in the same cycles.
impact_phase | doubles | - | Its phase in cycles of the force, from 0 to 1.
impact_speed | doubles | m/s | Speed of approach of m and the stop.
state | text | - | State of rig and control at the end, as Rig.snapshot gives it, in
    JSON.
"""


def _columns() -> dict[str, Column]:
    found = {}
    for line in re.sub(r'\n +', ' ', _COLUMNS).splitlines():
        name, kind, unit, description = line.split(' | ', 3)
        found[name] = Column(name, cast(Kind, kind), unit.strip('-'), description)
    return found


_BY_NAME = _columns()
_PLACE = ('point', 'direction')
_SECTION = ('section_x', 'section_velocity', 'section_offset', 'section_relative_velocity')
_MEASURES = """
    period impacts x_max x_max_ratio x_rms x_mean impacts_per_cycle
    lyapunov_exponent lyapunov_uncertainty largest_multiplier stick_share rest_share chatter_share
"""
#: Columns that can be drawn and minimised or maximised.
MEASURES: dict[str, Column] = {name: _BY_NAME[name] for name in _MEASURES.split()}


def check_measure(measure: str) -> None:
    """Raise ValueError if there is no such measure."""
    if measure not in MEASURES:
        raise ValueError(f'measure is {shown(measure)}: give one of {", ".join(MEASURES)}')


def columns_of(plan: SweepPlan) -> list[Column]:
    """Return all columns of the table of a sweep, in order."""
    varied = [
        Column(
            str(parameter),
            'bool' if parameter.spec.kind == 'bool' else 'double',
            parameter.spec.unit,
            parameter.spec.description,
        )
        for axis in plan.axes
        for parameter in axis.parameters
    ]
    left_out = () if plan.control.active else ('state',)
    place = [_BY_NAME[name] for name in _PLACE]
    found = [c for name, c in _BY_NAME.items() if name not in (*_PLACE, *left_out)]
    return [*place, *varied, *found]


def row_of(state: SteadyState, parameters: RigParameters) -> Row:
    """Return the columns that describe the motion of a rig."""

    def known(value: float) -> float | None:
        return None if math.isnan(value) else value

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
        'x_max_ratio': known(ratio),
        'x_rms': state.x_rms,
        'x_mean': state.x_mean,
        'impacts_per_cycle': state.impacts_per_cycle,
        'lyapunov_exponent': known(state.exponent.value),
        'lyapunov_uncertainty': known(state.exponent.uncertainty),
        'largest_multiplier': known(state.multiplier),
        'stick_share': state.shares.stick,
        'rest_share': state.shares.rest,
        'chatter_share': state.shares.chatter,
        'events': state.events,
        **dict(zip(_SECTION, state.section.T.tolist(), strict=True)),
        'impact_stop': [int(stop) for stop in state.hits[:, 0]],
        'impact_phase': state.hits[:, 1].tolist(),
        'impact_speed': state.hits[:, 2].tolist(),
    }


def failed_row(reason: str) -> Row:
    """Return the columns of a rig that could not be simulated."""
    return {'ok': False, 'reason': reason}


def _relative_section(row: Row) -> Array:
    """Return the section of a motion that repeats, relative to its size; shape (4, k)."""
    section = np.array([row[name] for name in _SECTION], dtype=float)
    size = row['x_max'] + float(np.ptp(section[2])) or 1.0
    section /= size * np.array([[1.0], [math.tau / row['cycle']]] * 2).reshape(4, 1)
    if row['impacts'] == 0:
        # Without impacts m may be anywhere in the gap
        section[2] = 0.0
    return section


def _is_same(one: Array, other: Array) -> bool:
    """Return whether two sections are the same, from whichever cycle they begin."""
    return any(
        float(np.abs(np.roll(one, shift, axis=1) - other).max()) < _SAME
        for shift in range(one.shape[1])
    )


def attractor_numbers(rows: Iterable[tuple[Hashable, Row]]) -> NDArray[np.int64]:
    """
    Return the number of each row's motion among those of the same rig, from a rig and its row.

    Two motions are the same if kind, period and stops are, and their sections agree; all motions
    of one kind that do not repeat are the same. The most frequent one is 0; `FAILED` means none.
    """
    known: dict[Hashable, list[tuple[int, Array]]] = {}
    met: Counter[Hashable] = Counter()
    found: list[tuple[Hashable, int]] = []
    for rig, row in rows:
        number = FAILED
        if row['ok']:
            section = _relative_section(row) if row['settled'] else np.zeros((4, 1))
            motions = known.setdefault((rig, row['motion'], row['period'], row['stops']), [])
            number = next((n for n, other in motions if _is_same(other, section)), FAILED)
            if number == FAILED:
                number = met[rig]
                met[rig] += 1
                motions.append((number, section))
        found.append((rig, number))
    frequency = Counter(found)
    ranks = {(rig, FAILED): FAILED for rig, _ in found}
    for rig, count in met.items():
        order = sorted(range(count), key=lambda number: (-frequency[rig, number], number))
        ranks.update({(rig, number): rank for rank, number in enumerate(order)})
    return np.array([ranks[one] for one in found], dtype=np.int64)


def _rows(plan: SweepPlan, journal: Journal) -> Iterator[Row]:
    """Yield all rows of a sweep, complete."""
    points = [plan.point(row) for row in range(plan.size)]
    several = len(plan.follow.directions) > 1 or any(axis.initial for axis in plan.axes)
    attractors = np.zeros(plan.size, dtype=np.int64)
    if several:
        # The same rig has several rows, by direction or initial conditions
        kept = [i for i, axis in enumerate(plan.axes) if not axis.initial]
        attractors = attractor_numbers(
            (tuple(point.values[i] for i in kept), journal.row(point.row)) for point in points
        )
    for point, number in zip(points, attractors.tolist(), strict=True):
        row = journal.row(point.row)
        yield {
            'point': point.row,
            'direction': point.direction or None,
            **{str(parameter): value for parameter, value in plan.settings(point.values)},
            **row,
            'attractor': number if row['ok'] else None,
        }


def write_table(plan: SweepPlan, journal: Journal, path: Path) -> None:
    """
    Write the table of a sweep, completely or not at all.

    Parameters
    ----------
    plan : SweepPlan
        The sweep.
    journal : Journal
        Its journal, with the rows of all rigs.
    path : Path
        The file; CSV if its name ends in .csv, else Parquet.

    Raises
    ------
    OSError
        If it cannot be written; an older file is left as it was.
    """
    path = Path(path)
    with whole(path) as draft:
        (_write_csv if _is_csv(path) else _write_parquet)(plan, _rows(plan, journal), draft)


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == '.csv'


_CSV_TITLE = '# Steady states of an impact damper. In pandas: read_csv(file, comment="#")'
_CSV_INPUTS = '# impact_damper_ros.sweep: '
_CSV_UNITS = '# units: '


def _cell(value: Any) -> str:
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value) if isinstance(value, list) else str(value)


def _write_csv(plan: SweepPlan, rows: Iterable[Row], path: Path) -> None:
    names = [column.name for column in columns_of(plan)]
    units = {column.name: column.unit for column in columns_of(plan) if column.unit}
    with path.open('w', encoding='utf-8', newline='') as stream:
        stream.write(f'{_CSV_TITLE}\n{_CSV_INPUTS}{json.dumps(plan.inputs())}\n')
        stream.write(f'{_CSV_UNITS}{json.dumps(units)}\n')
        table = csv.writer(stream, lineterminator='\n')
        table.writerow(names)
        table.writerows([_cell(row.get(name)) for name in names] for row in rows)


def _value(text: str, kind: Kind) -> Any:
    """Return what a cell of a CSV table holds; None if it is empty."""
    if not text:
        return None
    if kind == 'bool' and text not in ('true', 'false'):
        raise ValueError(f'{text!r} is neither true nor false')
    readers: dict[Kind, Callable[[str], Any]] = {
        'double': float,
        'integer': int,
        'bool': 'true'.__eq__,
        'text': str,
        'doubles': json.loads,
        'integers': json.loads,
    }
    return readers[kind](text)


def _read_csv(plan: SweepPlan, path: Path) -> dict[str, list[Any]]:
    """Read a table, column by column, without pyarrow."""
    columns = columns_of(plan)
    with path.open(encoding='utf-8', newline='') as stream:
        # The state of rig and control is a longer text than the csv module expects
        csv.field_size_limit(max(csv.field_size_limit(), 1 << 24))
        rows = csv.reader(dropwhile(lambda line: line.startswith('#'), stream))
        if next(rows, None) != [column.name for column in columns]:
            raise MetadataError(f'{path} does not have the columns of its sweep')
        cells = list(rows)
    if any(len(row) != len(columns) for row in cells):
        raise ValueError('a row is cut short')
    return {
        column.name: [_value(row[place], column.kind) for row in cells]
        for place, column in enumerate(columns)
    }


def _schema(plan: SweepPlan) -> Any:
    import pyarrow as pa

    types = {
        'double': pa.float64(),
        'integer': pa.int64(),
        'bool': pa.bool_(),
        'text': pa.string(),
        'doubles': pa.list_(pa.float64()),
        'integers': pa.list_(pa.int8()),
    }
    columns, inputs = columns_of(plan), plan.inputs()
    attributes = {
        'title': 'Steady states of an impact damper',
        'units': {column.name: column.unit for column in columns},
        'descriptions': {column.name: column.description for column in columns},
        'inputs': inputs,
    }
    return pa.schema(
        [
            pa.field(
                column.name,
                types[column.kind],
                metadata={'unit': column.unit, 'description': column.description},
            )
            for column in columns
        ],
        metadata={_INPUTS: json.dumps(inputs), _PANDAS: json.dumps(attributes)},
    )


def _write_parquet(plan: SweepPlan, rows: Iterable[Row], path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, left = _schema(plan), iter(rows)
    with (
        path.open('wb') as stream,
        pq.ParquetWriter(stream, schema, compression='zstd') as writer,
    ):
        while some := list(islice(left, _ROWS_AT_ONCE)):
            writer.write_table(pa.Table.from_pylist(some, schema=schema))


def _read_parquet(path: Path) -> dict[str, list[Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        columns: dict[str, list[Any]] = pq.read_table(path).to_pydict()
    except pa.ArrowInvalid as error:
        raise ValueError(error) from error
    return columns


def check_format(path: Path) -> None:
    """Raise `ImportError` if a table is to be Parquet and pyarrow, which writes it, is missing."""
    if _is_csv(path):
        return
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise ImportError(
            f'pyarrow, which writes Parquet, cannot be imported ({error}): install it with "pip '
            f'install pyarrow", or give the table a name that ends in .csv, such as '
            f'{path.with_suffix(".csv")}'
        ) from error


class MetadataError(ValueError):
    """A file that is not the table of a sweep."""


def _csv_inputs(path: Path) -> dict[str, Any]:
    with path.open(encoding='utf-8', newline='') as stream:
        for line in stream:
            if line.startswith(_CSV_INPUTS):
                inputs: dict[str, Any] = json.loads(line.removeprefix(_CSV_INPUTS))
                return inputs
            if not line.startswith('#'):
                break
    raise KeyError(_CSV_INPUTS)


def _parquet_inputs(path: Path) -> dict[str, Any]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        inputs: dict[str, Any] = json.loads((pq.read_schema(path).metadata or {})[_INPUTS])
    except pa.ArrowInvalid as error:
        raise ValueError(error) from error
    return inputs


def stored_inputs(path: Path) -> dict[str, Any]:
    """Return the inputs that a table was made from, or raise a `MetadataError`."""
    try:
        return _csv_inputs(path) if _is_csv(path) else _parquet_inputs(path)
    except (KeyError, ValueError) as error:
        raise MetadataError(f'{path} is not the table of a sweep') from error


class SweepTable:
    """
    The table of a sweep, read from its file.

    Parameters
    ----------
    path : Path
        The file, Parquet or CSV.

    Attributes
    ----------
    plan : SweepPlan
        The sweep.

    Raises
    ------
    MetadataError
        If the file is not the table of a sweep.
    OSError
        If it cannot be read.
    ImportError
        If it is Parquet, and pyarrow is missing.
    """

    def __init__(self, path: Path) -> None:
        path = Path(path)
        check_format(path)
        self.plan = SweepPlan.from_inputs(stored_inputs(path))
        try:
            self._columns = _read_csv(self.plan, path) if _is_csv(path) else _read_parquet(path)
        except MetadataError:
            raise
        except ValueError as error:
            raise MetadataError(f'{path} is not complete: {error}') from error
        if len(self) != self.plan.size:
            raise MetadataError(f'{path} is not complete: {len(self)} of {self.plan.size} rows')

    def __len__(self) -> int:
        return len(self._columns['point'])

    def numbers(self, name: str) -> Array:
        """Return a column of numbers; NaN where there is none."""
        return np.array(self._columns[name], dtype=np.float64)

    def texts(self, name: str) -> list[str | None]:
        """Return a column of texts."""
        return self._columns[name]

    def flags(self, name: str) -> NDArray[np.bool_]:
        """Return a column of true and false; false where there is none."""
        return np.array([value is True for value in self._columns[name]])

    def lists(self, name: str) -> list[list[float]]:
        """Return a column of lists; empty where there is none."""
        return [value or [] for value in self._columns[name]]
