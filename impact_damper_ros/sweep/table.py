# SPDX-License-Identifier: Apache-2.0
"""
The table of a sweep: its columns, its rows, and its file in Parquet or CSV.

Units, descriptions and the inputs of the sweep are in the attributes of the table, which pandas
stores in a Parquet file. A CSV file has units and inputs in comments at its head.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.outputs import whole
from impact_damper_ros.parameters.quoting import quote
from impact_damper_ros.parameters.upgrades import FormatError

from .grid import Grid
from .steady_state import SECTION, Row

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
#: File name extensions of tables.
FORMATS = ('.parquet', '.csv')
#: Sections that differ by less, relative to their size, belong to one motion.
_SAME = 1e-3

#: Types of columns; doubles and integers are lists.
Kind = Literal['double', 'integer', 'bool', 'text', 'doubles', 'integers']
#: Types of pandas; lists are arrays of numpy.
_DTYPES = {'double': 'float64', 'integer': 'Int64', 'bool': 'boolean', 'text': 'string'}


class SweepColumn(NamedTuple):
    """A column: its name, type, SI unit and meaning."""

    name: str
    kind: Kind
    unit: str
    description: str


#: Name, type, unit and meaning of all columns but those of the varied parameters.
_COLUMNS = """\
point | integer | - | Number of the rig in the sweep, from 0.
direction | text | - | up or down: the rig started from the last state of the one before in this
    direction; null: from its initial conditions.
ok | bool | - | Whether the rig could be simulated.
reason | text | - | If not, why not.
kind | text | - | What it settled into: periodic, without impacts, at rest, quasi-periodic,
    chaotic, undecided, or not periodically driven, by the force or by a control whose samples fall
    elsewhere in each cycle.
settled | bool | - | Whether the motion repeats, to the tolerance of the sweep.
settling_cycles | integer | - | Cycles of the force before it was measured.
measured_cycles | integer | - | Cycles of the force over which it was measured.
cycle | double | s | Cycle of the force; of the spring, if there is no force.
cycles | integer | - | Period k in cycles of the force; null if none was found.
impacts | integer | - | Impacts N in a period, those of a chatter up to its cut; null if it does
    not repeat.
stops | text | - | Stops hit in a period, in order; 1~ stands for a whole chatter on stop 1 to
    rest.
x_max | double | m | Largest |X|.
x_max_ratio | double | - | x_max over the amplitude A without impacts; null without one force,
    or with several harmonics.
x_rms | double | m | Root mean square of X.
x_mean | double | m | Mean of X.
transmissibility | double | - | rms X over rms b of a moving base, each about its mean; null for a
    base at rest.
relative_transmissibility | double | - | rms (X - b) over rms b.
acceleration_transmissibility | double | - | rms X'' over rms b'', without the blows of the
    impacts themselves.
transmissibility_without_damper | double | - | rms X over rms b of M alone, in closed form.
relative_transmissibility_without_damper | double | - | rms (X - b) over rms b of M alone.
acceleration_transmissibility_without_damper | double | - | rms X'' over rms b'' of M alone.
impacts_per_cycle | double | - | Impacts per cycle of the force.
lyapunov_exponent | double | 1/s | Largest Lyapunov exponent: of a motion that repeats ln|largest
    multiplier| over its period; else the mean growth of a deviation over the time measured; null
    under gap control, where it is not measured.
lyapunov_uncertainty | double | 1/s | Half of its 95 % interval, from the growths in 20 parts of
    the time measured; of a motion that repeats the difference between two periods.
largest_multiplier | double | - | Modulus of the largest multiplier of a period; null if the motion
    does not repeat, and under gap control.
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


def _columns() -> dict[str, SweepColumn]:
    found = {}
    for line in re.sub(r'\n +', ' ', _COLUMNS).splitlines():
        name, kind, unit, description = line.split(' | ', 3)
        found[name] = SweepColumn(name, cast(Kind, kind), unit.strip('-'), description)
    return found


_BY_NAME = _columns()
_PLACE = ('point', 'direction')
_MEASURES = """
    cycles impacts x_max x_max_ratio x_rms x_mean transmissibility relative_transmissibility
    acceleration_transmissibility impacts_per_cycle
    lyapunov_exponent lyapunov_uncertainty largest_multiplier stick_share rest_share chatter_share
"""
#: Columns that can be drawn and minimised or maximised.
MEASURES: dict[str, SweepColumn] = {name: _BY_NAME[name] for name in _MEASURES.split()}


def check_measure(measure: str) -> None:
    """Raise ValueError if there is no such measure."""
    if measure not in MEASURES:
        raise ValueError(f'measure is {quote(measure)}: give one of {", ".join(MEASURES)}')


class Columns(NamedTuple):
    """The table of a sweep without pandas, which takes as long to load as many rigs run."""

    grid: Grid
    #: The values of each column by its name, None where there is none
    values: dict[str, list[Any]]

    @classmethod
    def of(cls, table: pd.DataFrame | Columns) -> Columns:
        """Return a whole table, its rows in order; or raise ValueError."""
        if isinstance(table, Columns):
            return table
        table = complete_table(table)
        known = table.astype(object).where(table.notna(), None)
        values = {str(name): known[name].tolist() for name in known}
        return cls(Grid.from_inputs(table.attrs['inputs']), values)

    @classmethod
    def of_rows(cls, grid: Grid, rows: Iterable[Row]) -> Columns:
        """Return the table from the columns of its rigs, in order."""
        known = list(rows)
        values = {
            name: [_present(kind, row.get(name)) for row in known]
            for name, kind, *_ in columns_of(grid)
        } | grid.columns()
        if len(grid.directions) == 1 and not any(axis.initial for axis in grid.axes):
            # A rig has one row.
            values['attractor'] = [0 if ok else None for ok in values['ok']]
            return cls(grid, values)
        names = [str(one) for axis in grid.axes if not axis.initial for one in axis.varied]
        same = defaultdict[Any, list[int]](list)
        for k in range(len(known)):
            same[tuple(values[name][k] for name in names)].append(k)
        for places in same.values():
            numbers = attractor_numbers([known[k] for k in places])
            for k, number in zip(places, numbers, strict=True):
                values['attractor'][k] = number
        return cls(grid, values)

    def frame(self) -> pd.DataFrame:
        """Return the table of pandas."""
        import pandas as pd

        kinds = {one.name: one.kind for one in columns_of(self.grid)}
        series = {name: _series(kind, self.values[name]) for name, kind in kinds.items()}
        return _describe(pd.DataFrame(series), self.grid)


def complete_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table of a whole sweep, its rows in order; or raise ValueError."""
    if 'inputs' not in table.attrs:
        raise ValueError(
            'the table has no inputs in its attributes (attrs): give it as sweep or read_table '
            'returns it'
        )
    size = Grid.from_inputs(table.attrs['inputs']).size
    if sorted(table.point) != list(range(size)):
        raise ValueError(
            f'the table has {len(table)} rows of a sweep of {size} rigs: give the whole table'
        )
    return table.sort_values('point').reset_index(drop=True)


def columns_of(grid: Grid) -> list[SweepColumn]:
    """Return all columns of the table of a sweep, in order."""
    varied = [
        SweepColumn(
            str(one),
            'bool' if one.spec.kind == 'bool' else 'double',
            one.si_unit(grid.setup.parameters),
            one.spec.description,
        )
        for axis in grid.axes
        for one in axis.varied
    ]
    left_out = () if grid.setup.control.active else ('state',)
    place = [_BY_NAME[name] for name in _PLACE]
    found = [c for name, c in _BY_NAME.items() if name not in (*_PLACE, *left_out)]
    return [*place, *varied, *found]


def _relative_section(row: Row) -> Array:
    """Return the section of a motion that repeats, relative to its size; shape (4, k)."""
    section = np.array([row[name] for name in SECTION], dtype=float)
    size = row['x_max'] + float(np.ptp(section[2])) or 1.0
    section /= size * np.array([[1.0], [math.tau / row['cycle']]] * 2)
    if row['impacts'] == 0:
        # Without impacts m may be anywhere in the gap.
        section[2] = 0.0
    return section


def _is_same(one: Array, other: Array) -> bool:
    """Return whether two sections are equal, whichever cycles they begin with."""
    return any(
        float(np.abs(np.roll(one, shift, axis=1) - other).max()) < _SAME
        for shift in range(one.shape[1])
    )


def attractor_numbers(rows: Iterable[Row]) -> list[int | None]:
    """
    Return the number of each row's motion among those of one rig.

    Two motions are one if kind, period and stops are equal, and their sections agree; all motions
    of one kind that do not repeat count as one. The most frequent motion is 0.
    """
    known: list[tuple[tuple[Any, ...], Array]] = []
    found: list[int | None] = []
    for row in rows:
        if not row['ok']:
            found.append(None)
            continue
        kind = (row['kind'], *((row['cycles'], row['stops']) if row['settled'] else ()))
        section = _relative_section(row) if row['settled'] else np.zeros((4, 1))
        same = (n for n, (k, other) in enumerate(known) if k == kind and _is_same(other, section))
        number = next(same, len(known))
        if number == len(known):
            known.append((kind, section))
        found.append(number)
    met = Counter(number for number in found if number is not None)
    ranks = {number: rank for rank, (number, _) in enumerate(met.most_common())}
    return [None if number is None else ranks[number] for number in found]


def _describe(table: pd.DataFrame, grid: Grid) -> pd.DataFrame:
    """Return a table with its units, descriptions and inputs."""
    columns = columns_of(grid)
    table.attrs = {
        'title': 'Steady states of an impact damper',
        'units': {one.name: one.unit for one in columns},
        'descriptions': {one.name: one.description for one in columns},
        'inputs': grid.inputs(),
    }
    return table


def _present(kind: Kind, value: Any) -> Any:
    """Return a value, or None for a number that is NaN."""
    return None if kind == 'double' and value is not None and math.isnan(value) else value


def _array(kind: Kind, values: ArrayLike | None) -> Array | None:
    return None if values is None else np.array(values, 'i1' if kind == 'integers' else 'f8')


def _series(kind: Kind, values: Iterable[Any]) -> Any:
    """Return the values of a column of the table."""
    import pandas as pd

    if kind in _DTYPES:
        return pd.array(list(values), dtype=_DTYPES[kind])
    return pd.Series([_array(kind, one) for one in values], dtype=object)


#: Readers of the values of a CSV file.
_READ: dict[str, Callable[[str], Any]] = {
    'double': float,
    'integer': int,
    'bool': 'True'.__eq__,
    'text': str,
    **dict.fromkeys(('doubles', 'integers'), json.loads),
}


_CSV_TITLE = '# Steady states of an impact damper. In pandas: read_csv(file, comment="#")'
_CSV_INPUTS = '# impact_damper_ros.sweep: '
_CSV_UNITS = '# units: '
_LONGEST_TEXT = 2**31 - 1


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == '.csv'


#: Texts of the values of a CSV file, as pandas writes them; those of lists are in JSON.
_TEXTS: dict[str, Callable[[Any], str]] = {
    'double': lambda value: repr(float(value)),
    'integer': lambda value: str(int(value)),
    'bool': lambda value: str(bool(value)),
    'text': str,
    'doubles': lambda values: json.dumps(np.asarray(values, 'f8').tolist()),
    'integers': lambda values: json.dumps(np.asarray(values, 'i1').tolist()),
}


def write_table(columns: Columns, path: Path) -> None:
    """Write the table of a sweep, completely or not at all."""
    with whole(path) as draft:
        if not _is_csv(path):
            columns.frame().to_parquet(draft, index=False, compression='zstd')
            return
        known = columns_of(columns.grid)
        units = {one.name: one.unit for one in known if one.unit}
        texts = [
            ['' if value is None else _TEXTS[kind](value) for value in columns.values[name]]
            for name, kind, *_ in known
        ]
        with draft.open('w', encoding='utf-8', newline='') as stream:
            stream.write(f'{_CSV_TITLE}\n{_CSV_INPUTS}{json.dumps(columns.grid.inputs())}\n')
            stream.write(f'{_CSV_UNITS}{json.dumps(units)}\n')
            lines = csv.writer(stream, lineterminator='\n')
            lines.writerow([one.name for one in known])
            lines.writerows(zip(*texts, strict=True))


class MetadataError(ValueError):
    """A file that is not the table of this sweep, or no table of a sweep."""


def read_table(path: str | Path) -> pd.DataFrame:
    """
    Read the table of a sweep.

    Parameters
    ----------
    path : path
        The file, Parquet or CSV.

    Returns
    -------
    pandas.DataFrame
        The table as `sweep` has returned it.

    Raises
    ------
    MetadataError
        If the file is not the table of a sweep, or not complete.
    OSError
        If the file cannot be read.
    ImportError
        Without pandas, or without pyarrow for Parquet (extra ``sweep``).
    """
    check_format(path, frame=True)
    return read_columns(Path(path)).frame()


def read_columns(path: Path) -> Columns:
    """Read the table of a sweep, without pandas if it is CSV; the errors are those of above."""
    try:
        if _is_csv(path):
            return _read_csv(path)
        import pandas as pd

        return Columns.of(pd.read_parquet(path))
    except FormatError as error:
        remedy = 'use the version of impact_damper_ros that made it, or a later one'
        raise MetadataError(f'{path} is a sweep {error}; {remedy}') from None
    except (LookupError, TypeError, ValueError, csv.Error) as error:
        raise MetadataError(f'{path} is not the table of a sweep, or not complete') from error


def _read_csv(path: Path) -> Columns:
    """Read a table that `write_table` has written."""
    # Lists are as long as the section
    csv.field_size_limit(_LONGEST_TEXT)
    with path.open(encoding='utf-8', newline='') as stream:
        title, head, _ = (next(stream, '') for _ in range(3))
        if title.rstrip() != _CSV_TITLE:
            raise ValueError('another file')
        grid = Grid.from_inputs(json.loads(head.removeprefix(_CSV_INPUTS)))
        lines = csv.reader(stream)
        names, rows = next(lines, []), list(lines)
    kinds = {one.name: one.kind for one in columns_of(grid)}
    if names != list(kinds) or len(rows) != grid.size:
        raise ValueError('not complete')
    values = {
        name: [_READ[kind](text) if text else None for text in texts]
        for (name, kind), texts in zip(kinds.items(), zip(*rows, strict=True), strict=True)
    }
    # A motion without stops has an empty text, which CSV does not distinguish from a missing one.
    pairs = zip(values['stops'], values['impacts'], strict=True)
    values['stops'] = ['' if impacts == 0 else stops for stops, impacts in pairs]
    return Columns(grid, values)


def check_format(path: Path | str | None, *, frame: bool = False) -> None:
    """Raise ImportError if a table, or its file, needs what is not installed."""
    parquet = path is not None and not _is_csv(Path(path))
    for name in ['pandas'] * (frame or parquet) + ['pyarrow'] * parquet:
        # Imported later, beside the rigs that run
        if not find_spec(name):
            what = 'makes figures and tables of Python' if frame else 'writes Parquet'
            raise ImportError(
                f'{name}, which {what}, is not installed: install it with '
                f'"pip install {name}", or the package with its extra [sweep]'
                + (', or give the table a name that ends in .csv' if parquet and not frame else '')
            )
