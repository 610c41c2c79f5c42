# SPDX-License-Identifier: Apache-2.0
"""A rig in a line of text, and a hint if a frequency looks as if it were in Hz."""

from __future__ import annotations

import math
from collections.abc import Iterator

from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

#: Frequencies this close to 1/(2 pi) or 2 pi times the natural one may be in the wrong unit.
_NEAR = 1.08


def describe_rig(rig: RigParameters) -> str:
    """
    Return natural frequency, damping, force and gap of a rig in a line.

    Parameters
    ----------
    rig : RigParameters
        The rig.

    Examples
    --------
    >>> describe_rig(RigParameters(force_frequencies=[0.5]))
    'natural frequency 0.159 Hz (1 rad/s), ζ 0.500 %; force 1 N at 0.0796 Hz (0.5 rad/s), 0.5 \
times the natural one; gap 37 m; horizontal'
    """
    natural = f'natural frequency {_hertz(rig.omega)} ({rig.omega:.4g} rad/s)'
    parts = [f'{natural}, ζ {_digits(100.0 * rig.zeta)} %', *_force(rig), f'gap {rig.gap:.4g} m']
    if rig.one_sided:
        parts[-1] += ', stop 1 only'
    parts.append(f'inclined by {math.degrees(rig.angle):.4g}°' if rig.angle else 'horizontal')
    if rig.friction:
        parts[-1] += f', friction {rig.friction:.4g}'
    return '; '.join(parts)


def frequency_hint(rig: RigParameters, before: RigParameters | None = None) -> str:
    """
    Return a hint if a frequency looks as if it were in Hz, or is missing; else nothing.

    After a change, of the rig `before`, only what its frequencies did not call for yet.
    """
    hint = _hint(rig, rig.omega)
    return '' if before is not None and hint == _hint(before, rig.omega) else hint


def _hint(rig: RigParameters, omega: float) -> str:
    """Return the hint on the frequencies of a rig, beside a natural one."""
    for name, low, high in _bands(rig):
        if low <= omega <= high:
            continue
        one = low == high
        given = f'{name} {"is" if one else "are"} {_range(low, high)} rad/s'
        natural = f'the natural frequency, {omega:.6g} rad/s'
        if _near(omega, math.tau * low, math.tau * high):
            return (
                f'{given}, about 1/(2π) times {natural}: frequencies are in rad/s, '
                f'1 Hz = 6.283 rad/s; if Hz were meant, give '
                f'{_range(math.tau * low, math.tau * high)}'
            )
        if _near(omega, low / math.tau, high / math.tau):
            return (
                f'{given}, about 2π times {natural}; if the resonance was meant, give '
                f'{_range(low / math.tau, high / math.tau)}'
            )
    force = rig.force_amplitudes, rig.force_frequencies, rig.force_phases
    for number, (amplitude, frequency, phase) in enumerate(zip(*force, strict=True), 1):
        if amplitude and not frequency and not phase:
            return (
                f'harmonic {number} of the force has the amplitude {amplitude:.6g} N, but '
                'frequency and phase 0, so that it is no force: give force_frequencies as many '
                'values'
            )
    return ''


def _near(value: float, low: float, high: float) -> bool:
    return low / _NEAR <= value <= high * _NEAR


def _range(low: float, high: float) -> str:
    return f'{low:.6g}' if low == high else f'{low:.6g} to {high:.6g}'


def _digits(value: float) -> str:
    """Return three digits, zeros at the end too."""
    return f'{value:#.3g}'.rstrip('.')


def _hertz(frequency: float) -> str:
    """Return a circular frequency in Hz."""
    return f'{_digits(frequency / math.tau)} Hz'


def _share(rig: RigParameters, *frequencies: float) -> str:
    ratios = ' to '.join(f'{frequency / rig.omega:.3g}' for frequency in frequencies)
    return f'{ratios} times the natural one'


def _force(rig: RigParameters) -> Iterator[str]:
    """Yield descriptions of the forces."""
    drives = [
        (amplitude, frequency)
        for amplitude, frequency in zip(rig.force_amplitudes, rig.force_frequencies, strict=True)
        if amplitude
    ]
    if rig.sweep_mode != 'off' and drives:
        amplitude, _ = drives.pop(0)
        yield f'force {abs(amplitude):.4g} N, {_sweep_text(rig)}'
    for amplitude, frequency in drives[:1]:
        at = f'at {_hertz(frequency)} ({frequency:.4g} rad/s), {_share(rig, frequency)}'
        yield f'force {abs(amplitude):.4g} N {at if frequency else "with frequency 0"}'
    if len(drives) > 1:
        count = len(drives) - 1
        yield f'and {count} harmonic{"s" if count > 1 else ""} more'
    if rig.multisine_level:
        low, high = rig.multisine_low, rig.multisine_high
        yield (
            f'multisine {rig.multisine_level:.4g} N rms from {_hertz(low)} to {_hertz(high)}, '
            f'{_share(rig, low, high)}'
        )
    yield from _base(rig)
    if not any(rig.harmonics[0]):
        yield 'no force'


def _sweep_text(rig: RigParameters) -> str:
    low, high = rig.sweep_low, rig.sweep_high
    rate = f', {rig.sweep_rate:.4g} octaves a minute' if rig.sweep_rate else ''
    notched = ', notched' if any(factor != 1.0 for factor in rig.sweep_notch_factors) else ''
    return (
        f'stepped {rig.sweep_mode.replace("_", " and ")} from {_hertz(low)} to {_hertz(high)}, '
        f'{_share(rig, low, high)}{rate}{notched}'
    )


def _base(rig: RigParameters) -> Iterator[str]:
    """Yield descriptions of the motion of the base."""
    lines = [
        (abs(a), w) for a, w in zip(rig.base_amplitudes, rig.base_frequencies, strict=True) if a
    ]
    for amplitude, frequency in lines[:1]:
        size = {
            'displacement': f'{1e3 * amplitude:.4g} mm',
            'velocity': f'{amplitude:.4g} m/s',
            'acceleration': f'{amplitude:.4g} m/s^2 = {amplitude / STANDARD_GRAVITY:.4g} g',
        }[rig.base_quantity]
        at = f'at {_hertz(frequency)} ({frequency:.4g} rad/s), {_share(rig, frequency)}'
        if rig.sweep_mode != 'off' and not any(rig.force_amplitudes):
            at = _sweep_text(rig)
        yield f'base moved by {size} {at}'
    if len(lines) > 1:
        yield f'and {len(lines) - 1} line{"s" if len(lines) > 2 else ""} more of the base'


def _bands(rig: RigParameters) -> Iterator[tuple[str, float, float]]:
    """Yield name, lowest and highest frequency of each force, without zeros."""
    own = rig.first_harmonic[1]
    if rig.sweep_mode != 'off':
        yield 'sweep_low and sweep_high', rig.sweep_low, rig.sweep_high
    elif own and rig.first_harmonic[0]:
        yield f'{rig.swept}_frequencies', own, own
    if rig.multisine_level:
        yield 'multisine_low and multisine_high', rig.multisine_low, rig.multisine_high
