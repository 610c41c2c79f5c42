# SPDX-License-Identifier: Apache-2.0
"""The faults of a record that prevent a fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .measured_motion import MeasuredMotion
from .record import noise_of
from .vibration import Array, Vibration

_LEAST_SAMPLES, _LEAST_PER_PERIOD = 50, 8.0
#: Samples in a natural period beyond which times are in no other unit.
_MOST_PER_PERIOD = 2e3
#: A gap in time longer than this part of a natural period ends a record.
_LONGEST_GAP = 0.5
#: The motion over the response to the force alone: beyond this factor a unit is wrong.
_FACTOR = 200.0
_LEAST_SIGNAL = 3.0
#: A mean above this many standard deviations is an offset of the sensor.
_OFFSET = 2.0


def faults_of(measured: MeasuredMotion, rig: RigParameters, also: Sequence[str] = ()) -> list[str]:
    """Return why no rig can be fitted to a record; empty if a fit is possible."""
    time, used = np.asarray(measured.time, float), np.asarray(measured.used, bool)
    motion = np.asarray(measured.motion, float)[used]
    source = measured.source or 'the record'
    if rig.one_sided:
        return [
            'one_sided is true: rigs with one stop are not fitted; the times of bounces on it '
            'give its restitution (examples/published/measured_bounces.py)'
        ]
    if rig.sweep_mode != 'off':
        return [f'sweep_mode is {rig.sweep_mode}: fit the steps of a sweep one by one, with off']
    if len(motion) < _LEAST_SAMPLES:
        return [f'{source} has {len(motion)} samples that count: give {_LEAST_SAMPLES} at least']
    if not np.isfinite(motion).all():
        return [f'{source} has samples that are no finite numbers: mark them as not used']
    steps = np.diff(time)
    if not (steps > 0.0).all():
        at = int(np.flatnonzero(~(steps > 0.0))[0])
        return [f'time does not rise after {time[at]!r} s: sort the samples, and keep one of each']
    period = 2.0 * math.pi / rig.omega
    inside = np.diff(time[used])
    density = period / float(np.median(inside))
    if density < _LEAST_PER_PERIOD:
        milli = _LEAST_PER_PERIOD < 1e3 * density < _MOST_PER_PERIOD
        return [
            f'{source} has {density:.3g} samples in a natural period of {period:.4g} s: '
            + (
                'are its times in ms? Name the unit in their column'
                if milli
                else f'sample at {_LEAST_PER_PERIOD / period:.4g} Hz at least'
            )
        ]
    if inside.max() > _LONGEST_GAP * period:
        at = int(inside.argmax())
        return [
            f'{source} has a gap of {inside[at]:.4g} s from {time[used][at]:.6g} s, and natural '
            f'periods last {period:.4g} s: impacts in it are unknown; fit the parts one by '
            'one, with --to and --from'
        ]
    if abs(motion.mean()) > _OFFSET * np.std(motion) > 0.0 and 'bias' not in also:
        return [
            f'{measured.quantity} is {motion.mean():.4g} (SI) on average and varies by '
            f'{np.std(motion):.3g}: subtract the offset of the sensor, or give --also bias'
        ]
    return _faults_of_signal(measured, rig, motion)


def _faults_of_signal(measured: MeasuredMotion, rig: RigParameters, motion: Array) -> list[str]:
    swing, noise = float(np.std(motion)), noise_of(motion)
    if swing == 0.0:
        return [f'{measured.quantity} is {float(motion[0])!r} at all times: connect the sensor']
    if swing < _LEAST_SIGNAL * noise:
        return [
            f'{measured.quantity} is mostly noise: it varies by {swing:.3g}, and its noise is '
            f'{noise:.3g}; see that the sensor is on M, shake harder, or filter'
        ]
    order = ORDERS[measured.quantity]
    time = np.asarray(measured.time, float)
    vibration = Vibration.of(
        rig, rig.stiffness, max(rig.damping, 1e-3 * rig.stiffness / rig.omega)
    )
    expected = float(np.std(vibration.steady(time, order)))
    if expected > 0.0 and not 1.0 / _FACTOR < swing / expected < _FACTOR:
        return [
            f'{measured.quantity} varies by {swing:.3g} (SI), {swing / expected:.3g} times the '
            f'{expected:.3g} that the force gives the structure alone: check the units of the '
            'record and the force and masses of the rig'
        ]
    return []
