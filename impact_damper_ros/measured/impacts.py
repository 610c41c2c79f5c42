# SPDX-License-Identifier: Apache-2.0
"""Instants of impacts: times in a file, spikes of an accelerometer or a sound, a logic signal."""

from __future__ import annotations

import io
import math
import warnings
from pathlib import Path

import numpy as np
from scipy.io import wavfile
from scipy.ndimage import maximum_filter1d

from impact_damper_ros.parameters.quoting import as_line

from .formats import content_of, read_sheet
from .sheet import ACCELERATION, IMPACT, INSTANT, TIME, Array, Choice, TableError, choose
from .table import chosen_columns

#: Fewest samples that are a signal.
LEAST_SAMPLES = 20
#: Times whose steps differ by less than this part are samples, not impacts.
_SAME_STEP = 0.3
#: Time after an impact in which the acceleration is that of the sensor, not of M, s.
RINGING = 5e-3
#: A spike stands out by so many standard deviations of the noise, and by this factor from the
#: spike before it.
_OUTSTANDING, _NEXT_SPIKE = 8.0, 3.0
#: Interval in which a sound is judged by its loudest sample, s; how long its echoes count, s, and
#: the factor by which an impact is louder.
_SOUND_STEP, _ECHO = 5e-4, (0.02, 4.0)
#: Rates that a sound may have, Hz.
_SOUND_RATES = (1000, 10_000_000)
#: Standard deviation of an impact time of unknown accuracy, s.
IMPACT_DEVIATION = 5e-4


def read_impacts(path: Path) -> tuple[Array, float]:
    """Return the impact times of a file, and their standard deviation, s."""
    if path.suffix.lower() in ('.wav', '.wave'):
        time, loudness = _loudness(path)
        return spike_times(time, loudness, *_ECHO), sampling_deviation(time)
    sheet = read_sheet(path)
    only = len(sheet.headings) == 1
    instant = choose(sheet, 'time', TIME if only else INSTANT, needed=not only)
    # A single column holds the times, whatever its name.
    instant = instant or Choice(0, 's', 1.0)
    choices = {'time': instant}
    for key, quantity in (('acceleration', ACCELERATION), ('impact', IMPACT)):
        found = choose(sheet, key, quantity, needed=False, without={instant.place})
        if found is not None:
            choices[key] = found
    table = chosen_columns(sheet, choices)
    for name, instants in (('acceleration', spike_times), ('impact', rises)):
        if name in table.columns:
            table, _ = table.on_a_clock()
            time = table.columns['time'].values
            return instants(time, table.columns[name].values), sampling_deviation(time)
    table.check_finite('time')
    times = np.unique(table.columns['time'].values)
    steps = np.diff(times)
    if len(times) >= LEAST_SAMPLES and np.ptp(steps) < _SAME_STEP * np.median(steps):
        raise TableError(
            f'{sheet.source}: {len(times)} times at equal intervals, which are no impacts: '
            'give their times, or name the signal that shows them accel [g] or impact [V]'
        )
    return times, IMPACT_DEVIATION


def _loudness(path: Path) -> tuple[Array, Array]:
    """Return the largest sound pressure of a .wav file in each half millisecond."""
    source, content = as_line(str(path)), content_of(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            rate, sound = wavfile.read(io.BytesIO(_with_sizes(content)))
        low, high = _SOUND_RATES
        if not low <= rate <= high:
            raise ValueError(f'a rate of {rate} Hz: from {low} to {high} Hz')
        size = max(1, round(rate * _SOUND_STEP))
        count = len(sound) // size
        blocks = sound[: count * size].reshape(count, size, -1)
        # Bytes are above 128 or below it
        rest = 128.0 if sound.dtype == np.uint8 else 0.0
        extremes = (blocks.max(axis=1) - rest, blocks.min(axis=1) - rest)
        channels = np.nan_to_num(np.maximum(*np.abs(extremes)))
        loudest = channels[:, int(np.argmax(channels.max(axis=0, initial=0.0)))]
    # A damaged file may raise any error.
    except Exception as error:
        raise TableError(
            f'{source}: no sound that can be read ({as_line(str(error))}): give a .wav file of '
            'PCM samples'
        ) from None
    if count < LEAST_SAMPLES:
        raise TableError(f'{source}: {len(sound) / rate:.3g} s of sound: record more')
    return np.arange(count) * (size / rate), loudest


def _with_sizes(content: bytes) -> bytes:
    """Return a .wav file with the sizes that a recorder did not write before it was stopped."""
    at, block = 12, 1
    while (kind := content[at : at + 4]) not in (b'data', b''):
        if kind == b'fmt ':
            block = max(1, int.from_bytes(content[at + 20 : at + 22], 'little'))
        at += 8 + int.from_bytes(content[at + 4 : at + 8], 'little')
    # A file that is played while it is written has the largest number
    if content[at + 4 : at + 8] not in (bytes(4), b'\xff' * 4):
        return content
    size = (len(content) - at - 8) // block * block
    sizes = ((at + size).to_bytes(4, 'little'), size.to_bytes(4, 'little'))
    body = content[at + 8 : at + 8 + size]
    return b''.join((b'RIFF', sizes[0], content[8 : at + 4], sizes[1], body))


def sampling_deviation(time: Array) -> float:
    """Return the standard deviation of an instant between two samples, s."""
    return float(np.median(np.diff(time))) / math.sqrt(12.0)


def rises(time: Array, level: Array) -> Array:
    """Return where a logic signal rises, between two samples."""
    low, high = float(np.nanmin(level, initial=np.inf)), float(np.nanmax(level, initial=-np.inf))
    if low >= high:
        return np.empty(0)
    on = level > 0.5 * (low + high)
    rise = np.flatnonzero(on[1:] & ~on[:-1])
    instants: Array = 0.5 * (time[rise] + time[rise + 1])
    return instants


def spike_times(
    time: Array, acceleration: Array, ringing: float = RINGING, factor: float = _NEXT_SPIKE
) -> Array:
    """
    Return the instants at which an acceleration has the spikes of impacts, s.

    Notes
    -----
    An impact is between the first sample of a spike and the one before it. The ringing behind a
    spike is no impact, unless it exceeds the spike by a factor. Digital silence is no measure of
    the noise.
    """
    step = float(np.median(np.diff(time)))
    there = np.isfinite(acceleration)
    if not there.any():
        return np.empty(0)
    # A missing sample is no spike.
    bend = np.abs(np.diff(np.interp(time, time[there], acceleration[there]), 2))
    if not (bend > 0.0).any():
        return np.empty(0)
    noise = 1.4826 * float(np.median(bend[bend > 0.0]))
    window = max(3, round(ringing / step))
    # The bend at k is that of the samples k, k + 1 and k + 2
    peak = np.maximum.reduce([np.append(bend[n:], [0.0] * n) for n in range(3)])
    quiet = np.concatenate([np.zeros(window), bend])
    before = maximum_filter1d(quiet, window, origin=(window - 1) // 2)[window - 1 : -1]
    found: list[int] = []
    for k in np.flatnonzero((bend > _OUTSTANDING * noise) & (factor * before <= peak)).tolist():
        if not found or k + 1 - found[-1] >= 3:
            found.append(k + 1)
    places = np.array(found, int)
    instants: Array = 0.5 * (time[places] + time[places + 1])
    return instants
