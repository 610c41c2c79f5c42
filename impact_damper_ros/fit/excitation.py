# SPDX-License-Identifier: Apache-2.0
"""
The recorded force or motion of the base, which replaces that of the rig.

The closed form of the motion and the exact engine take an excitation as a sum of tones
A sin(W t + p). Tones are found one by one, each at the largest peak of the remaining spectrum, and
then fitted together.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .measured_motion import MeasuredMotion
from .record import noise_of
from .vibration import Array

#: Tones describe a record if their residual is at most this part of its rms, or this multiple of
#: the noise of its sensor, which may be this part of the rms at most.
_LEFT, _LEFT_OF_NOISE, _MOST_NOISE = 0.005, 1.3, 0.05
#: Most tones of an excitation.
_MOST_TONES = 6
_UNITS = {'force': 'N', 'displacement': 'm', 'velocity': 'm/s', 'acceleration': 'm/s^2'}


class ExcitationError(ValueError):
    """A recorded excitation that is no sum of tones; the text has the remedy."""


class Tones(NamedTuple):
    """Amplitudes, circular frequencies, rad/s, and phases at time 0 of tones, and their sum."""

    amplitudes: Array
    frequencies: Array
    phases: Array
    signal: Array


def _enough(values: Array) -> float:
    """Return the largest residual of the tones of a signal, rms."""
    values = values[np.isfinite(values)]
    size = float(np.std(values))
    return max(_LEFT * size, min(_LEFT_OF_NOISE * noise_of(values), _MOST_NOISE * size))


def _sum_of(frequencies: Array, time: Array, values: Array) -> Tones:
    """
    Return the tones of given frequencies that describe values best, with a constant.

    Values that are NaN are not used.
    """
    middle = 0.5 * (time[0] + time[-1])
    angles = np.outer(time - middle, frequencies)
    columns = np.hstack([np.sin(angles), np.cos(angles), np.ones((len(time), 1))])
    there = np.isfinite(values)
    best = np.linalg.lstsq(columns[there], values[there], rcond=None)[0]
    sines, cosines = best[: len(frequencies)], best[len(frequencies) : -1]
    phases = np.mod(np.arctan2(cosines, sines) - frequencies * middle, math.tau)
    return Tones(np.hypot(sines, cosines), frequencies, phases, columns[:, :-1] @ best[:-1])


def tones_of(time: Array, values: Array) -> Tones:
    """
    Return the tones of a signal that is sampled at equal intervals; NaN is a missing sample.

    Raises
    ------
    ExcitationError
        If the signal is no sum of tones.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    rates = math.tau * np.fft.rfftfreq(4 * len(time), step)
    there = np.isfinite(values)

    def centre(rest: Array) -> Array:
        return np.where(there, rest - rest[there].mean(), 0.0)

    found, left, enough = np.zeros(0), centre(values), _enough(values)
    for _ in range(_MOST_TONES):
        spectrum = np.abs(np.fft.rfft(left * np.hanning(len(left)), 4 * len(left)))
        spectrum[:4] = 0.0

        def apart(frequencies: Array) -> Array:
            return centre(values - _sum_of(frequencies, time, values).signal)

        start = np.append(found, rates[int(np.argmax(spectrum))])
        found = least_squares(apart, start, x_scale=rates[1], max_nfev=20).x
        left = apart(found)
        if np.std(left[there]) <= enough:
            return _sum_of(found, time, values)
    raise ExcitationError(
        f'{_MOST_TONES} tones leave {100.0 * np.std(left[there]) / np.std(values[there]):.2g} % '
        'of it, and sweeps, random excitation and blows are not fitted: shake at one frequency or '
        'a few, and cut the record with --from where they begin'
    )


def with_excitation(
    measured: MeasuredMotion, rig: RigParameters
) -> tuple[RigParameters, list[str]]:
    """
    Return a rig under the recorded excitation, and the change in words.

    A described excitation that agrees with the record is kept.

    Raises
    ------
    ExcitationError
        If tones do not describe the record.
    """
    remarks = []
    time = np.asarray(measured.time, float)
    for kind, values in (('force', measured.force), ('base', measured.base)):
        if values is None or np.ptp(values[np.isfinite(values)]) == 0.0:
            continue
        quantity = measured.base_quantity if kind == 'base' else 'force'
        off = float(np.nanstd(values - _described_drive(rig, kind, quantity, time)))
        if off <= _enough(values):
            continue
        try:
            tones = tones_of(time, np.asarray(values, float))
        except ExcitationError as error:
            raise ExcitationError(f'the recorded {kind}: {error}') from None
        changes: dict[str, Any] = {
            f'{kind}_{name}': tuple(getattr(tones, name).tolist())
            for name in ('amplitudes', 'frequencies', 'phases')
        }
        if kind == 'base':
            changes['base_quantity'] = quantity
            if measured.force is None and _force_of(rig) == _force_of(RigParameters()):
                # A file without a force
                changes['force_amplitudes'] = (0.0,)
        rig = rig.replace(sweep_mode='off', multisine_level=0.0, **changes)
        unit = _UNITS[quantity]
        pairs = zip(tones.amplitudes, tones.frequencies, strict=True)
        remarks.append(
            f'the recorded {kind} is used, '
            + ' and '.join(f'{a:.4g} {unit} at {w:.5g} rad/s' for a, w in pairs)
            + f'; that of the rig differs from it by {off:.3g} {unit} (rms)'
        )
    return rig, remarks


def _force_of(rig: RigParameters) -> tuple[tuple[float, ...], ...]:
    return rig.force_amplitudes, rig.force_frequencies, rig.force_phases


def _described_drive(rig: RigParameters, kind: str, quantity: str, time: Array) -> Array:
    """Return the force or the motion of the base that a rig describes."""
    if kind == 'base' and rig.base_quantity != quantity:
        return np.zeros(len(time))
    total = np.zeros(len(time))
    for amplitude, frequency, phase in zip(
        getattr(rig, f'{kind}_amplitudes'),
        getattr(rig, f'{kind}_frequencies'),
        getattr(rig, f'{kind}_phases'),
        strict=True,
    ):
        total += amplitude * np.sin(frequency * time + phase)
    return total
