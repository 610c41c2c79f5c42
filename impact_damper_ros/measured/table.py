# SPDX-License-Identifier: Apache-2.0
"""
Tables of measured data: the requested columns of a file, in SI units.

A column is known by its unit and by a word of its header, as `quantity` has them: a column in mg
is an acceleration, and one of that unit with the word shaker is that of the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import quote

from .clock import last_digit, missing_samples, rounded_interval
from .formats import read_sheet
from .sheet import Array, Choice, Quantity, Sheet, TableError, choose

#: Remedy for steps that differ.
EQUAL_INTERVALS = 'give samples at equal intervals'


class MeasuredColumn(NamedTuple):
    """A column of a table in SI units, NaN where a number is missing."""

    values: Array
    unit: str
    #: Header as in the file, and the factor of its unit.
    title: str
    factor: float


class MeasuredTable(NamedTuple):
    """The columns of a file that were looked for, by their keys."""

    source: str
    columns: dict[str, MeasuredColumn]
    #: Line of each row in the file, from 1.
    lines: NDArray[np.int64]
    #: Which columns are used, and which are not.
    described: str = ''

    def error(self, key: str, row: int, problem: str) -> TableError:
        """Return the error of a row of a column."""
        return TableError(
            f'{self.source}, line {self.lines[row]}, column '
            f'{quote(self.columns[key].title)}: {problem}'
        )

    def check_finite(self, key: str) -> None:
        """Raise `TableError` where a column has no number."""
        wrong = np.flatnonzero(~np.isfinite(self.columns[key].values))
        if len(wrong):
            raise self.error(key, int(wrong[0]), 'no number: fill the gap, or leave the row out')

    def check_rising(self, key: str, *, steps: bool = False) -> None:
        """Raise `TableError` where a column does not rise from row to row, or has no step up."""
        self.check_finite(key)
        values = self.columns[key].values
        falls = np.diff(values)
        wrong = np.flatnonzero(falls < 0.0 if steps else falls <= 0.0)
        if not len(wrong):
            return
        row = int(wrong[0]) + 1
        fall, usual = -falls[row - 1], float(np.median(np.abs(falls)))
        there = f'{self.as_given(key, row)} after {self.as_given(key, row - 1)}'
        if not fall:
            remedy = 'the column must rise: leave out rows that repeat, or export more digits'
        elif key != 'time':
            remedy = 'the column must rise: put the rows in order'
        elif (wrap := self._wrap(key, fall + usual)) is not None:
            remedy = f'a counter begins anew: add {wrap} to the times from there on'
        elif len(wrong) == 1 and fall > 5.0 * usual:
            remedy = 'the times go back: a second run begins there; cut the file in two'
        else:
            remedy = 'the times go back: export the samples in the order of their times'
        raise self.error(key, row, f'{there}: {remedy}')

    def _wrap(self, key: str, fall: float) -> int | None:
        """Return the count at which a counter has begun anew, if a fall is one."""
        counts = fall / self.columns[key].factor
        wraps = (2**16, 2**24, 2**31, 2**32)
        return next((w for w in wraps if abs(counts - w) <= 1e-4 * w), None)

    def check_positive(self, key: str, *, zero: bool = False) -> None:
        """Raise `TableError` where a column has anything else than positive numbers, or zero."""
        values = self.columns[key].values
        wrong = np.flatnonzero(~(values >= 0.0 if zero else values > 0.0))
        if len(wrong):
            row = int(wrong[0])
            sign = 'a number of at least 0' if zero else 'a positive number'
            raise self.error(key, row, f'{self.as_given(key, row)}: give {sign}')

    def as_given(self, key: str, row: int) -> str:
        """Return the number in a row of a column, in the unit of the file."""
        column = self.columns[key]
        return f'{column.values[row] / column.factor:.12g}'

    def on_a_clock(self) -> tuple[MeasuredTable, float]:
        """
        Return the table with rising times, and the size of their last digit, s.

        Rounded times at equal intervals become exact; then their last digit is that of floats.
        """
        column = self.columns['time']
        digit = last_digit(column.values, column.factor)
        if (even := rounded_interval(column.values, digit)) is not None:
            column = column._replace(values=even)
            return self._replace(columns={**self.columns, 'time': column}), 0.0
        self.check_rising('time')
        return self, digit

    def between(self, first: float, last: float) -> MeasuredTable:
        """Return the rows whose times are within a range, all if it has no bounds."""
        times = self.columns['time'].values
        within = (times >= first) & (times <= last)
        if within.all() or (first == -np.inf and last == np.inf):
            return self
        if not within.any():
            raise TableError(
                f'{self.source}: no samples from {first:g} to {last:g} s: give a part of '
                f'{np.nanmin(times):g} to {np.nanmax(times):g} s'
            )
        columns = {k: c._replace(values=c.values[within]) for k, c in self.columns.items()}
        return self._replace(columns=columns, lines=self.lines[within])


def odd_step(times: Array, row: int) -> str:
    """Return the step to an instant, and the usual step, in words."""
    usual = float(np.median(np.diff(times)))
    return f'a step of {times[row] - times[row - 1]:.4g} s where the others are {usual:.4g} s'


def read_measured_table(
    path: Path, needed: Mapping[str, Quantity], optional: Mapping[str, Quantity] | None = None
) -> MeasuredTable:
    """Read the columns of a file that are needed, and those that may be there."""
    sheet = read_sheet(path)
    found: dict[str, Choice] = {}
    every = {**needed, **(optional or {})}
    # The column of time is that next to the other columns.
    for key in sorted(every, key=lambda key: key == 'time'):
        near = min((choice.place for choice in found.values()), default=None)
        choice = choose(sheet, key, every[key], needed=key in needed, near=near)
        if choice is not None:
            found[key] = choice
    return chosen_columns(sheet, found)


def chosen_columns(sheet: Sheet, choices: Mapping[str, Choice]) -> MeasuredTable:
    """Return the columns of a sheet that are chosen, in SI units."""
    numbers, lines = sheet.read([choice.place for choice in choices.values()])
    if len(lines) < 2:
        raise TableError(f'{sheet.source}: {len(lines)} rows: give at least 2')
    columns = {
        key: MeasuredColumn(
            values * choice.factor, choice.unit, sheet.headings[choice.place].title, choice.factor
        )
        for (key, choice), values in zip(choices.items(), numbers, strict=True)
    }
    places = {key: choice.place for key, choice in choices.items()}
    return MeasuredTable(sheet.source, columns, lines, sheet.columns_text(places))


def check_whole(table: MeasuredTable, digit: float) -> None:
    """Raise `TableError` where samples are missing."""
    times = table.columns['time'].values
    missing = missing_samples(times, digit)
    if len(holes := np.flatnonzero(missing)):
        row = int(holes[0]) + 1
        hole = missing[row - 1] > 0
        remedy = 'fill the gap, or cut the record there' if hole else EQUAL_INTERVALS
        raise table.error('time', row, f'{odd_step(times, row)}: {remedy}')
