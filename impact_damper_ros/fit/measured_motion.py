# SPDX-License-Identifier: Apache-2.0
"""
A measured motion of the primary mass M: the one record that every reader returns.

Files come in by `read_motion`, messages of a bag or of a live topic by `recorded_motion`. Both end
in `prepared`, which fills gaps in time, masks samples that are saturated, and finds the impacts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

from impact_damper_ros.measured.table import (
    ACCELERATION,
    BASE,
    DISPLACEMENT,
    FORCE,
    IMPACT,
    INSTANT,
    TIME,
    VELOCITY,
    ColumnError,
    MeasuredTable,
    TableError,
    read_table,
)
from impact_damper_ros.parameters.base_motion import quantity_of
from impact_damper_ros.parameters.quoting import as_line, counted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Fewest samples that are a motion.
LEAST_SAMPLES = 20
#: Intervals may differ by this part of one; a longer one is a gap, of at most so many samples.
_SAME_STEP, _LONGEST_GAP = 0.3, 1000
#: Times with few digits: steps that differ, at least, and how far they are off, in the last digit.
_ROUNDED_STEPS, _OFF_BY = 0.1, 0.6
#: Steps of the resolution by which a signal runs into saturation, at least.
_STEEP = 4.0
#: Around an impact an acceleration is that of the sensor, not of M: before and after it, s.
_RINGING = (5e-4, 5e-3)
#: A spike stands out by so many standard deviations of the noise, and by this factor from the
#: spike before it.
_OUTSTANDING, _NEXT_SPIKE = 8.0, 3.0
#: Interval in which a sound is judged by its loudest sample, s; how long its echoes count, s, and
#: the factor by which an impact is louder.
_SOUND_STEP, _ECHO = 5e-4, (0.02, 4.0)
#: Standard deviation of an impact time of which nothing is known, s.
IMPACT_DEVIATION = 5e-4


class MeasuredMotion(NamedTuple):
    """
    What was measured of a rig, in SI units.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Instants of the samples, s, rising, at equal intervals but for the jitter of a clock.
    motion : ndarray, shape (n,)
        Displacement (m), velocity (m/s) or acceleration (m/s^2) of M; any number where `used` is
        False.
    quantity : {'displacement', 'velocity', 'acceleration'}
        What `motion` is.
    used : ndarray of bool, shape (n,)
        False for samples that are saturated or missing.
    force : ndarray, shape (n,), or None
        Force on M, N, if it was measured; NaN where rows are missing.
    base : ndarray, shape (n,), or None
        Motion of the base, if it was measured; NaN where rows are missing.
    base_quantity : str
        What `base` is; empty without it.
    impact_times : ndarray, shape (k,), or None
        Measured instants of impacts, s, rising; None if none were measured.
    impact_deviation : float
        Standard deviation of an impact time, s.
    source : str
        Where the motion comes from, and what was made of it, for messages.
    """

    time: Array
    motion: Array
    quantity: str
    used: Mask
    force: Array | None = None
    base: Array | None = None
    base_quantity: str = ''
    impact_times: Array | None = None
    impact_deviation: float = 0.0
    source: str = ''

    @property
    def interval(self) -> float:
        """Time between two samples, s."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def between(self, start: float, end: float) -> MeasuredMotion:
        """Return the part between two instants, s."""
        kept = (self.time >= start) & (self.time <= end)
        if kept.sum() < LEAST_SAMPLES:
            raise ValueError(
                f'{self.source}: {counted(int(kept.sum()), "sample")} from {start:g} to {end:g} '
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
    What a reader needs to know beside the data.

    Attributes
    ----------
    column : str
        Header of the column of the motion, if several may be it.
    saturation : float or None
        Size of the motion from which on it is saturated, SI; found by itself if not given.
    impacts : Path or None
        File of impact times, or of an accelerometer whose spikes are impacts.
    impact_deviation : float or None
        Standard deviation of an impact time, s.
    topic, joint : str
        Topic and joint (or axis) of a bag.
    """

    column: str = ''
    saturation: float | None = None
    impacts: Path | None = None
    impact_deviation: float | None = None
    topic: str = ''
    joint: str = ''


_MOTIONS = {'displacement': DISPLACEMENT, 'velocity': VELOCITY, 'acceleration': ACCELERATION}


#: Nothing beside the data.
NO_OPTIONS = ReadingOptions()


def read_table_motion(path: Path, options: ReadingOptions = NO_OPTIONS) -> MeasuredMotion:
    """
    Read a measured motion from a file of columns.

    Parameters
    ----------
    path : Path
        CSV, a phone's .zip, .uff or .lvm; see `measured.table`.
    options : ReadingOptions, optional
        What is not in the file.

    Returns
    -------
    MeasuredMotion
        The displacement of M if it has one, else its velocity, else its acceleration. Beside one
        of the first two an acceleration serves to find the impacts.

    Raises
    ------
    TableError
        If the file cannot be used; the text names column and line.
    """
    optional = {'force': FORCE, 'base': BASE, 'impact': IMPACT}
    if options.column:
        units = tuple(q.units[0] for q in _MOTIONS.values())
        wanted = {'motion': DISPLACEMENT._replace(units=units)}
        table = read_table(path, {'time': TIME, **wanted}, optional, {'motion': options.column})
        key, quantity = 'motion', quantity_of(table.columns['motion'].unit)
    else:
        try:
            table = read_table(path, {'time': TIME}, {**_MOTIONS, **optional})
            key = quantity = next((name for name in _MOTIONS if name in table.columns), '')
            if not key:
                # With the reason, if there is a column of one of the names
                read_table(path, {'displacement': DISPLACEMENT})
        except ColumnError as error:
            remedy = '; or name that of M with --column' if error.key in _MOTIONS else ''
            raise ColumnError(error.key, f'{error}{remedy}') from None
    even = _even(table.columns['time'].values)
    table.columns['time'] = table.columns['time']._replace(values=even)
    table.check_rising('time')
    for name in ('force', 'base', 'impact'):
        if name in table.columns:
            table.check_finite(name)
    time = table.columns['time'].values
    times, deviation = None, _deviation(time)
    if options.impacts is not None:
        times, deviation = read_impacts(options.impacts)
    elif 'impact' in table.columns:
        times = _rises(time, table.columns['impact'].values)
    elif key != 'acceleration' and 'acceleration' in table.columns:
        table.check_finite('acceleration')
        times = spike_times(time, table.columns['acceleration'].values)
    force, base = (table.columns.get(name) for name in ('force', 'base'))
    moving = base is not None and bool(np.any(base.values != base.values[0]))
    return prepared(
        MeasuredMotion(
            time=time,
            motion=table.columns[key].values,
            quantity=quantity,
            used=np.isfinite(table.columns[key].values),
            force=None if force is None else force.values,
            base=base.values if base is not None and moving else None,
            base_quantity=quantity_of(base.unit) if base is not None and moving else '',
            impact_times=times,
            impact_deviation=deviation,
            source=str(path),
        ),
        options,
        lambda row: _place(table, row),
        what=table.columns[key].title,
    )


def _even(time: Array) -> Array:
    """Return instants at equal intervals where the given ones are these, with few digits."""
    steps = np.diff(time)
    sizes = np.unique(np.round(steps, 9))
    if not np.isfinite(time).all() or len(sizes) < 2:
        return time
    # A clock that writes whole milliseconds is off by half of one, at many samples; a sample that
    # is missing or twice there makes two steps different
    digit = float(np.diff(sizes).min())
    many = np.mean(np.abs(steps - np.median(steps)) > 0.5 * digit) > _ROUNDED_STEPS
    places = np.arange(len(time))
    grid = time[0] + np.polyval(np.polyfit(places, time - time[0], 1), places)
    return grid if many and np.abs(grid - time).max() <= _OFF_BY * digit else time


def _place(table: MeasuredTable, row: int) -> str:
    return (
        f'{as_line(str(table.path))}, line {table.lines[row]}, column '
        f"'{table.columns['time'].title}'"
    )


def read_impacts(path: Path) -> tuple[Array, float]:
    """Return the impact times of a file, and their standard deviation, s."""
    if path.suffix.lower() == '.wav':
        time, loudness = _loudness(path)
        return spike_times(time, loudness, *_ECHO), _deviation(time)
    table = read_table(path, {'time': INSTANT}, {'acceleration': ACCELERATION, 'impact': IMPACT})
    time = table.columns['time'].values
    for name, instants in (('acceleration', spike_times), ('impact', _rises)):
        if name in table.columns:
            table.check_rising('time')
            table.check_finite(name)
            return instants(time, table.columns[name].values), _deviation(time)
    table.check_finite('time')
    times = np.unique(time)
    steps = np.diff(times)
    if len(times) >= LEAST_SAMPLES and np.ptp(steps) < _SAME_STEP * np.median(steps):
        raise TableError(
            f'{as_line(str(path))}: {len(times)} times at equal intervals, which are no impacts: '
            'give their times, or name the signal that shows them accel [g] or impact [V]'
        )
    return times, IMPACT_DEVIATION


def _loudness(path: Path) -> tuple[Array, Array]:
    """Return the largest sound pressure of a .wav file in each half millisecond."""
    try:
        rate, sound = wavfile.read(path)
    except (ValueError, EOFError, struct.error) as error:
        raise TableError(
            f'{as_line(str(path))}: no sound that can be read ({as_line(str(error))}): give a '
            '.wav file of PCM samples'
        ) from None
    channels = np.abs(sound.astype(float).reshape(len(sound), -1))
    loudest = channels[:, int(np.argmax(channels.max(axis=0, initial=0.0)))]
    size = max(1, round(rate * _SOUND_STEP))
    blocks = loudest[: len(loudest) // size * size].reshape(-1, size).max(axis=1)
    if len(blocks) < LEAST_SAMPLES:
        raise TableError(f'{as_line(str(path))}: {len(sound) / rate:.3g} s of sound: record more')
    return np.arange(len(blocks)) * (size / rate), blocks


def _deviation(time: Array) -> float:
    """Return the standard deviation of an instant between two samples, s."""
    return float(np.median(np.diff(time))) / math.sqrt(12.0)


def _rises(time: Array, level: Array) -> Array:
    """Return where a logic signal rises, between two samples."""
    low, high = float(level.min()), float(level.max())
    if low == high:
        return np.empty(0)
    on = level > 0.5 * (low + high)
    rise = np.flatnonzero(on[1:] & ~on[:-1])
    instants: Array = 0.5 * (time[rise] + time[rise + 1])
    return instants


def spike_times(
    time: Array, acceleration: Array, ringing: float = _RINGING[1], factor: float = _NEXT_SPIKE
) -> Array:
    """
    Return the instants at which an acceleration has the spikes of impacts, s.

    Notes
    -----
    An impact is between the first sample of a spike and the one before it. What rings on behind a
    spike for some time is none, unless it stands out from that by a factor.
    """
    step = float(np.median(np.diff(time)))
    bend = np.abs(np.diff(acceleration, 2))
    noise = 1.4826 * float(np.median(bend))
    window = max(3, round(ringing / step))
    found: list[int] = []
    for k in np.flatnonzero(bend > _OUTSTANDING * noise):
        peak = bend[k : k + 3].max()
        before = bend[max(0, k - window) : k].max(initial=0.0)
        # The bend at k is that of the samples k, k + 1 and k + 2
        if factor * before <= peak:
            if found and k + 1 - found[-1] < 3:
                continue
            found.append(int(k) + 1)
    places = np.array(found, int)
    instants: Array = 0.5 * (time[places] + time[places + 1])
    return instants


def saturated(motion: Array) -> Mask:
    """
    Return which samples of a signal are cut off by the range of its sensor.

    Notes
    -----
    They have exactly the largest or the least value there is, two or more of them in a row, and
    the signal runs into it by more than a few steps of its resolution. A crest that is read with
    a coarse resolution has equal values, too, but comes up to them by one step.
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
        if steep and float(np.median(steep)) > _STEEP * resolution:
            for begin, end in long:
                cut[begin:end] = True
    return cut


def _filled(data: MeasuredMotion, place: Callable[[int], str]) -> MeasuredMotion:
    """Return a motion with missing samples put in, not to be used."""
    time = data.time
    steps = np.diff(time)
    step = float(np.median(steps))
    digits = 10.0 ** math.floor(math.log10(abs(time[-1]) or 1.0) - 6)
    missing = np.rint(steps / step).astype(int) - 1
    odd = np.abs(steps - step) > _SAME_STEP * step + digits
    for row in np.flatnonzero(odd) + 1:
        gap = steps[row - 1] / step
        if not 0 < missing[row - 1] <= _LONGEST_GAP:
            raise ValueError(
                f'{place(int(row))}: a step of {steps[row - 1]:.4g} s where the others are '
                f'{step:.4g} s: '
                + (
                    'cut the record there, with --from or --to'
                    if gap > 1.0
                    else 'give samples at equal intervals'
                )
            )
    missing[~odd] = 0
    if not missing.any():
        return data
    if missing.sum() > 0.2 * len(time):
        raise ValueError(
            f'{data.source}: {counted(int(missing.sum()), "sample")} are missing among '
            f'{len(time)}: record without gaps'
        )
    # Between rows k and k + 1 are missing[k] more
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
        source=f'{data.source} ({counted(int(missing.sum()), "missing sample")})',
    )


def prepared(
    data: MeasuredMotion,
    options: ReadingOptions,
    place: Callable[[int], str],
    what: str = '',
) -> MeasuredMotion:
    """
    Return a motion as the fit takes it: gaps filled, saturated samples masked, impacts found.

    Parameters
    ----------
    data : MeasuredMotion
        As it was read.
    options : ReadingOptions
        What was given beside it.
    place : callable
        Returns where a row is, for messages.
    what : str, optional
        Name of the motion in its source, for messages.
    """
    name = f'{as_line(data.source)}: {what or "the motion"}'
    there = data.motion[data.used]
    if len(there) < LEAST_SAMPLES:
        raise ValueError(f'{name} has {len(there)} samples: give at least {LEAST_SAMPLES}')
    if np.ptp(there) <= 1e-12 * np.abs(there).max():
        raise ValueError(
            f'{name} is {there[0]:.6g} throughout: name the column that moves with --column'
        )
    cut = saturated(data.motion)
    if options.saturation is not None:
        cut |= np.abs(np.nan_to_num(data.motion)) >= options.saturation
    source = data.source
    if cut.any():
        source += f' ({counted(int(cut.sum()), "saturated sample")} not used)'
    if data.quantity == 'acceleration' and cut.any():
        # What comes out of saturation may be late
        cut[1:] |= cut[:-1].copy()
    data = data._replace(used=data.used & ~cut, source=source)
    times, deviation = data.impact_times, data.impact_deviation
    if times is None and data.quantity == 'acceleration':
        found = spike_times(data.time, np.where(np.isfinite(data.motion), data.motion, 0.0))
        times = found if len(found) else None
        deviation = float(np.median(np.diff(data.time))) / math.sqrt(12.0)
    data = _filled(data, place)
    if times is not None:
        low, high = data.time[0], data.time[-1]
        within = np.sort(times[(times >= low) & (times <= high)])
        if len(times) and not len(within):
            raise ValueError(
                f'{name}: none of {counted(len(times), "impact time")} from {times.min():.6g} to '
                f'{times.max():.6g} s is within {low:.6g} to {high:.6g} s: give both the same '
                'clock'
            )
        times = within
    if data.quantity == 'acceleration' and times is not None and len(times):
        after = np.searchsorted(times, data.time + _RINGING[0], side='right')
        last = np.where(after > 0, times[np.maximum(after - 1, 0)], -np.inf)
        step = float(np.median(np.diff(data.time)))
        data = data._replace(used=data.used & (data.time - last > _RINGING[1] + step))
    motion = np.where(np.isfinite(data.motion), data.motion, 0.0)
    if options.impact_deviation is not None:
        deviation = options.impact_deviation
    return data._replace(motion=motion, impact_times=times, impact_deviation=deviation)
