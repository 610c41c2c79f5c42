# SPDX-License-Identifier: Apache-2.0
"""
A measured motion of the primary mass M, which every reader returns.

Files come in by `read_table_motion`, messages of a bag or of a live topic by `recorded_motion`.
Both end in `prepare`, which removes rows that are no samples, inserts missing samples, masks
saturated ones, and finds the impacts.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.measured.clock import missing_samples
from impact_damper_ros.measured.formats import read_sheet
from impact_damper_ros.measured.impacts import (
    LEAST_SAMPLES,
    RINGING,
    read_impacts,
    rises,
    sampling_deviation,
    spike_times,
)
from impact_damper_ros.measured.sheet import (
    ACCELERATION,
    BASE,
    DISPLACEMENT,
    FORCE,
    IMPACT,
    TIME,
    VELOCITY,
    Choice,
    ColumnError,
    Quantity,
    Sheet,
    choose,
)
from impact_damper_ros.measured.table import (
    EQUAL_INTERVALS,
    MeasuredTable,
    chosen_columns,
    odd_step,
)
from impact_damper_ros.parameters.base_motion import quantity_of
from impact_damper_ros.parameters.quoting import as_line, plural, quote

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Longest hole that is filled, in samples.
_LONGEST_GAP = 1000
#: Least number of steps of the resolution by which a signal runs into saturation.
_STEEP = 4.0
#: Time before an impact in which the acceleration is that of the sensor already, s.
_BEFORE_IMPACT = 5e-4
#: Least number of nines that stands for a missing sample, any beyond this one, and most of them.
_NINES, _BEYOND, _MOST_STAND_INS = 999.0, 1e20, 5
#: Most rows for which a value is repeated, and share of changes at that interval.
_MOST_HELD, _IN_RHYTHM = 20, 0.98


class MeasuredMotion(NamedTuple):
    """
    The measured motion of a rig as samples, in SI units.

    Examples
    --------
    >>> time = np.arange(0.0, 20.0, 0.01)
    >>> used = np.ones(len(time), bool)
    >>> motion = MeasuredMotion(time, np.cos(10.0 * time), 'displacement', used)
    >>> round(motion.interval, 9), len(motion.between(0.0, 1.0).time)
    (0.01, 101)
    """

    #: Instants, rising, at equal intervals but for the jitter of a clock, s.
    time: Array
    #: Motion of M: any number where it is not used.
    motion: Array
    #: 'displacement', 'velocity' or 'acceleration'.
    quantity: str
    #: False for samples that are saturated or missing.
    used: Mask
    #: Force on M, if it was measured; NaN where rows are missing.
    force: Array | None = None
    #: Motion of the base, and its quantity.
    base: Array | None = None
    base_quantity: str = ''
    #: Impact times, rising, s, or None; and the standard deviation of a time.
    impact_times: Array | None = None
    impact_deviation: float = 0.0
    #: Source and preparation of the data, in words; columns that are used, and that are not.
    source: str = ''
    columns: str = ''

    @property
    def interval(self) -> float:
        """Time between two samples, s."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def between(self, start: float, end: float) -> MeasuredMotion:
        """Return the part between two instants, s."""
        kept = (self.time >= start) & (self.time <= end)
        if kept.sum() < LEAST_SAMPLES:
            raise ValueError(
                f'{self.source}: {plural(int(kept.sum()), "sample")} from {start:g} to {end:g} '
                f's: give a longer part of {self.time[0]:g} to {self.time[-1]:g} s'
            )
        times = self.impact_times
        return self._replace(
            time=self.time[kept],
            motion=self.motion[kept],
            used=self.used[kept],
            force=None if self.force is None else self.force[kept],
            base=None if self.base is None else self.base[kept],
            impact_times=None if times is None else times[(times >= start) & (times <= end)],
        )


class ReadingOptions(NamedTuple):
    """
    Options of a reader.

    Examples
    --------
    >>> options = ReadingOptions(column='x1', unit='mm', first=2.0)
    >>> options.unit, options.last
    ('mm', inf)
    """

    #: Header or number of the column of the motion, and its unit, if the file has none.
    column: str = ''
    unit: str = ''
    time_column: str = ''
    base_column: str = ''
    force_column: str = ''
    #: Size of the motion from which on it is saturated, SI; detected if not given.
    saturation: float | None = None
    #: File of impact times, or of a signal that shows them, and the deviation of a time, s.
    impacts: Path | None = None
    impact_deviation: float | None = None
    #: Topic of a bag, and its joint or axis.
    topic: str = ''
    joint: str = ''
    #: First and last instant of the data that are read, s.
    first: float = -math.inf
    last: float = math.inf


_MOTIONS = {'displacement': DISPLACEMENT, 'velocity': VELOCITY, 'acceleration': ACCELERATION}
_MOTION = Quantity(
    tuple(name for q in _MOTIONS.values() for name in q.names),
    tuple(q.units[0] for q in _MOTIONS.values()),
)


#: Options of a reader by default.
NO_OPTIONS = ReadingOptions()


def read_table_motion(path: Path, options: ReadingOptions = NO_OPTIONS) -> MeasuredMotion:
    """Read a measured motion from a file of columns, or raise `TableError`."""
    sheet = read_sheet(path)
    quantity, choices = choices_of(sheet, options)
    table = chosen_columns(sheet, choices)
    table = _on_one_clock(table).between(options.first, options.last)
    table, digit = table.on_a_clock()
    columns = table.columns
    time = columns['time'].values
    times, deviation = None, sampling_deviation(time)
    if options.impacts is not None:
        times, deviation = read_impacts(options.impacts)
    elif 'impact' in columns:
        times = rises(time, columns['impact'].values)
    elif 'spikes' in columns:
        times = spike_times(time, columns['spikes'].values)
    force, base = (columns.get(name) for name in ('force', 'base'))
    there = np.empty(0) if base is None else base.values[np.isfinite(base.values)]
    moving = len(there) > 0 and there.min() < there.max()
    return prepare(
        MeasuredMotion(
            time=time,
            motion=columns['motion'].values,
            quantity=quantity,
            used=np.isfinite(columns['motion'].values),
            force=None if force is None else force.values,
            base=base.values if base is not None and moving else None,
            base_quantity=quantity_of(base.unit) if base is not None and moving else '',
            impact_times=times,
            impact_deviation=deviation,
            source=str(path),
            columns=table.described,
        ),
        options,
        lambda row: f"{sheet.source}, line {table.lines[row]}, column '{columns['time'].title}'",
        what=columns['motion'].title,
        digit=digit,
        factor=columns['motion'].factor,
    )


def choices_of(sheet: Sheet, options: ReadingOptions) -> tuple[str, dict[str, Choice]]:
    """Return the quantity of the motion, and the columns that are read."""
    found: dict[str, Choice] = {}
    taken: set[int] = set()

    def add(key: str, choice: Choice | None) -> None:
        if choice is not None:
            found[key] = choice
            taken.add(choice.place)

    if options.column:
        motion = choose(sheet, 'motion', _MOTION, column=options.column, unit=options.unit)
        add('motion', motion)
    for key, quantity, name in (
        ('force', FORCE, options.force_column),
        ('base', BASE, options.base_column),
        ('impact', IMPACT, ''),
    ):
        add(key, choose(sheet, key, quantity, needed=False, column=name, without=taken))
    if 'motion' not in found:
        moving = [n for n, head in enumerate(sheet.headings) if head.has_word_of(BASE)]
        add('motion', _motion_of(sheet, taken.union(moving)))
    motion, key = found['motion'], quantity_of(found['motion'].unit)
    if key != 'acceleration' and not options.column and options.impacts is None:
        named = ACCELERATION._replace(by_unit=False)
        # Several columns, none of which is that of M, count as none.
        with contextlib.suppress(ColumnError):
            spikes = choose(sheet, 'spikes', named, needed=False, without=taken, strict=False)
            add('spikes', spikes)
    wanted = TIME._replace(bare=bool(options.time_column))
    for of in ('motion', *(key for key in found if key != 'motion')):
        clock = choose(
            sheet, 'time', wanted, column=options.time_column, near=found[of].place, without=taken
        )
        assert clock is not None
        if of == 'motion':
            found['time'] = clock
        elif clock.place != found['time'].place:
            found[f'time of {of}'] = clock
    return key, found


def _motion_of(sheet: Sheet, taken: set[int]) -> Choice:
    """Return the column of M: that with a word of its quantity, or the only one of its unit."""
    for by_unit in (False, True):
        for key, quantity in _MOTIONS.items():
            wanted = quantity._replace(by_unit=by_unit)
            try:
                found = choose(sheet, key, wanted, needed=False, without=taken, strict=False)
            except ColumnError as error:
                raise ColumnError(
                    key, f'{error}; --column gives that of M, by name or number'
                ) from None
            if found is not None:
                return found
    try:
        found = choose(sheet, 'displacement', DISPLACEMENT, without=taken)
    except ColumnError as error:
        remedy = 'or name that of M with --column, and its unit with --unit'
        raise ColumnError(error.key, f'{error}; {remedy}') from None
    assert found is not None
    return found


def _on_one_clock(table: MeasuredTable) -> MeasuredTable:
    """Return a table without the clocks of other columns, which must equal that of the motion."""
    columns, described = dict(table.columns), table.described
    for clock in [key for key in columns if key.startswith('time of ')]:
        own, key = columns.pop(clock), clock.removeprefix('time of ')
        if np.array_equal(own.values, columns['time'].values):
            continue
        if np.ptp(columns[key].values):
            raise table.error(
                clock, 0, f'its clock is not that of the motion: export {key} and motion on one'
            )
        # An unconnected channel
        title = f'{key} {quote(columns.pop(key).title)}'
        described = described.replace(f', {title}', '')
        described += f'; not used, since it is constant and has another clock: {title}'
    return table._replace(columns=columns, described=described)


def saturation_of(motion: Array) -> Mask:
    """
    Return which samples of a signal are cut off by the range of its sensor.

    Notes
    -----
    Two or more consecutive samples have exactly the largest or the least value, and the signal
    reaches it by more than a few steps of its resolution. A crest that is read with a coarse
    resolution has equal values, too, but comes up to them by one step.
    """
    cut = np.zeros(len(motion), np.bool_)
    finite = motion[np.isfinite(motion)]
    levels = np.unique(finite)
    if len(levels) < 3:
        return cut
    resolution = float(np.diff(levels).min())
    for extreme in (levels[0], levels[-1]):
        flat = np.concatenate([[False], motion == extreme, [False]])
        edges = np.flatnonzero(np.diff(flat.astype(int)))
        steep: list[float] = []
        long = []
        for begin, end in edges.reshape(-1, 2):
            if end - begin > 1:
                long.append((begin, end))
                steep += [abs(motion[begin - 1] - extreme)] if begin else []
                steep += [abs(motion[end] - extreme)] if end < len(motion) else []
        steep = [rise for rise in steep if math.isfinite(rise)]
        if steep and float(np.median(steep)) > _STEEP * resolution:
            for begin, end in long:
                cut[begin:end] = True
    return cut


def _stand_ins(values: Array, factor: float) -> Mask:
    """Return which samples are -9999 or similar: nines far beyond all others, or 1e30."""
    sizes = np.abs(values) / factor
    found = np.zeros(len(values), np.bool_)
    for _ in range(_MOST_STAND_INS):
        top = float(sizes[~found & np.isfinite(sizes)].max(initial=0.0)) or 1.0
        nines = top >= _NINES and abs(top + 1.0 - 10.0 ** round(math.log10(top))) < 1e-6 * top
        there = sizes == top
        others = sizes[~found & ~there & np.isfinite(sizes)]
        if not (nines or top >= _BEYOND) or others.max(initial=0.0) > 0.5 * top:
            break
        found |= there
    return found


def _repeats_of_values(values: Array) -> int:
    """Return the number of rows per value of a channel that is sampled more slowly."""
    change = np.flatnonzero(np.diff(values) != 0.0) + 1
    for many in range(_MOST_HELD, 1, -1):
        in_rhythm = np.bincount(change % many, minlength=many) if len(change) else [0]
        rows = len(values) / many
        if len(change) >= 0.5 * rows and max(in_rhythm) >= _IN_RHYTHM * len(change):
            return many
    return 1


def _fill_gaps(
    data: MeasuredMotion, missing: NDArray[np.int64], place: Callable[[int], str]
) -> MeasuredMotion:
    """Return a motion with missing samples inserted, which are not used."""
    time = data.time
    wrong = np.flatnonzero((missing < 0) | (missing > _LONGEST_GAP))
    if len(wrong):
        row = int(wrong[0]) + 1
        long = time[row] - time[row - 1] > np.median(np.diff(time))
        remedy = 'cut the record there, with --from or --to' if long else EQUAL_INTERVALS
        raise ValueError(f'{place(row)}: {odd_step(time, row)}: {remedy}')
    if not missing.any():
        return data
    if missing.sum() > 0.2 * len(time):
        raise ValueError(
            f'{data.source}: {plural(int(missing.sum()), "sample")} are missing among '
            f'{len(time)}: record without gaps'
        )
    # missing[k] samples are missing between rows k and k + 1.
    whole = np.arange(len(time)) + np.concatenate([[0], np.cumsum(missing)])
    every = np.arange(whole[-1] + 1)
    used = np.zeros(len(every), np.bool_)
    used[whole] = data.used

    def spread(values: Array | None) -> Array | None:
        if values is None:
            return None
        there = np.full(len(every), np.nan)
        there[whole] = values
        return there

    fill = np.where(np.isfinite(data.motion), data.motion, 0.0)
    return data._replace(
        time=np.interp(every, whole, time),
        motion=np.interp(every, whole, fill),
        used=used,
        force=spread(data.force),
        base=spread(data.base),
        source=f'{data.source} ({plural(int(missing.sum()), "missing sample")})',
    )


def _samples(data: MeasuredMotion, factor: float) -> tuple[MeasuredMotion, int]:
    """Return a motion without rows and values that are no samples, and the rows per sample."""
    notes = ''
    if (unreal := _stand_ins(data.motion, factor)).any():
        numbers = ' and '.join(f'{x:g}' for x in np.unique(data.motion[unreal] / factor)[:3])
        notes += f' ({plural(int(unreal.sum()), "sample")} of {numbers} taken for missing)'
    motion = np.where(unreal, np.nan, data.motion)
    many = _repeats_of_values(motion)
    rows = np.arange(len(motion))
    if many > 1:
        change = np.flatnonzero(np.diff(motion) != 0.0) + 1
        rows = np.arange(int(np.bincount(change % many).argmax()), len(motion), many)
        notes += f' (one of {many} rows, which have the same value)'
    force, base = (None if c is None else c[rows] for c in (data.force, data.base))
    there = np.isfinite(motion[rows])
    for column in (force, base):
        if column is not None:
            there &= np.isfinite(column)
    return data._replace(
        time=data.time[rows],
        motion=motion[rows],
        used=there & data.used[rows],
        force=force,
        base=base,
        source=data.source + notes,
    ), many


def prepare(
    data: MeasuredMotion,
    options: ReadingOptions,
    place: Callable[[int], str],
    what: str = '',
    digit: float = 0.0,
    factor: float = 1.0,
) -> MeasuredMotion:
    """
    Return a motion for a fit: gaps filled, saturated samples masked, impacts found.

    `place` names a row, and `what` the motion, in messages; `digit` is the last digit of the
    times, s, and `factor` that of the unit in which the motion was written.
    """
    name = f'{as_line(data.source)}: {what or "the motion"}'
    data, many = _samples(data, factor)
    there = data.motion[np.isfinite(data.motion)]
    if len(there) < LEAST_SAMPLES:
        raise ValueError(f'{name} has {len(there)} samples: give at least {LEAST_SAMPLES}')
    if np.ptp(there) <= 1e-12 * np.abs(there).max():
        raise ValueError(
            f'{name} is {there[0]:.6g} throughout: name the column that moves with --column'
        )
    cut = saturation_of(data.motion)
    if options.saturation is not None:
        cut |= np.abs(np.nan_to_num(data.motion)) >= options.saturation
    source = data.source
    if cut.any():
        source += f' ({plural(int(cut.sum()), "saturated sample")} not used)'
    if data.quantity == 'acceleration' and cut.any():
        # The first samples after saturation may be late.
        cut[1:] |= cut[:-1].copy()
    data = data._replace(used=data.used & ~cut, source=source)
    times, deviation = data.impact_times, data.impact_deviation
    if times is None and data.quantity == 'acceleration':
        found = spike_times(data.time, data.motion)
        times = found if len(found) else None
        deviation = sampling_deviation(data.time)
    missing = missing_samples(data.time, digit)
    data = _fill_gaps(data, missing, lambda row: place(row * many))
    if times is not None:
        low, high = data.time[0], data.time[-1]
        within = np.sort(times[(times >= low) & (times <= high)])
        if len(times) and not len(within):
            raise ValueError(
                f'{name}: none of {plural(len(times), "impact time")} from {times.min():.6g} to '
                f'{times.max():.6g} s is within {low:.6g} to {high:.6g} s: give both the same '
                'clock'
            )
        times = within
    if data.quantity == 'acceleration' and times is not None and len(times):
        after = np.searchsorted(times, data.time + _BEFORE_IMPACT, side='right')
        last = np.where(after > 0, times[np.maximum(after - 1, 0)], -np.inf)
        step = float(np.median(np.diff(data.time)))
        data = data._replace(used=data.used & (data.time - last > RINGING + step))
    motion = np.where(np.isfinite(data.motion), data.motion, 0.0)
    if options.impact_deviation is not None:
        deviation = options.impact_deviation
    return data._replace(motion=motion, impact_times=times, impact_deviation=deviation)
