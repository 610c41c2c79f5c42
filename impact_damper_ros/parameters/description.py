# SPDX-License-Identifier: Apache-2.0
"""
Descriptions of the rig: a line of text for people, and the robot description (URDF) for viewers.

Everything is drawn in proportion to the gap and to the displacement of M.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import yaml

from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters

#: Frequencies this close to 1/(2 pi) or 2 pi times the natural one may be in the wrong unit.
_NEAR = 1.25


def described(rig: RigParameters) -> str:
    """
    Return natural frequency, damping, force and gap of a rig in a line.

    Parameters
    ----------
    rig : RigParameters
        The rig.

    Examples
    --------
    >>> described(RigParameters(force_frequencies=[0.5]))
    'natural frequency 0.159 Hz (1 rad/s), ζ 0.500 %; force 1 N at 0.0796 Hz (0.5 rad/s) = 0.5 of \
it; gap 37 m; level'
    """
    natural = f'natural frequency {_hertz(rig.omega)} ({rig.omega:.4g} rad/s)'
    parts = [f'{natural}, ζ {_digits(100.0 * rig.zeta)} %', *_force(rig), f'gap {rig.gap:.4g} m']
    if rig.one_sided:
        parts[-1] += ', stop 1 only'
    parts.append(f'inclined by {math.degrees(rig.angle):.4g}°' if rig.angle else 'level')
    if rig.friction:
        parts[-1] += f', friction {rig.friction:.4g}'
    return '; '.join(parts)


def frequency_hint(rig: RigParameters, varied: tuple[float, float] | None = None) -> str:
    """
    Return a hint if frequencies of the force look as if they were given in Hz; else nothing.

    If the frequency of the first harmonic is varied, `varied` is its range, rad/s.
    """
    for name, low, high in _bands(rig, varied):
        if low <= rig.omega <= high:
            continue
        one = low == high
        given = f'{name} {"is" if one else "are"} {_range(low, high)} rad/s'
        natural = f'the natural frequency, {rig.omega:.6g} rad/s'
        if _near(rig.omega, math.tau * low, math.tau * high):
            return (
                f'{given}, about 1/(2π) times {natural}: frequencies are in rad/s, '
                f'1 Hz = 6.283 rad/s; if Hz were meant, give '
                f'{_range(math.tau * low, math.tau * high)}'
            )
        if _near(rig.omega, low / math.tau, high / math.tau):
            return (
                f'{given}, about 2π times {natural}; if the resonance was meant, give '
                f'{_range(low / math.tau, high / math.tau)}'
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
    return ' to '.join(f'{frequency / rig.omega:.3g}' for frequency in frequencies) + ' of it'


def _force(rig: RigParameters) -> Iterator[str]:
    """Yield descriptions of the forces."""
    drives = [
        (amplitude, frequency)
        for amplitude, frequency in zip(rig.force_amplitudes, rig.force_frequencies, strict=True)
        if amplitude
    ]
    if rig.sweep_mode != 'off' and rig.force_amplitudes[0]:
        amplitude, _ = drives.pop(0)
        low, high = rig.sweep_low, rig.sweep_high
        yield (
            f'force {abs(amplitude):.4g} N, stepped {rig.sweep_mode.replace("_", " and ")} from '
            f'{_hertz(low)} to {_hertz(high)} = {_share(rig, low, high)}'
        )
    for amplitude, frequency in drives[:1]:
        at = f'at {_hertz(frequency)} ({frequency:.4g} rad/s) = {_share(rig, frequency)}'
        yield f'force {abs(amplitude):.4g} N {at if frequency else "with frequency 0"}'
    if len(drives) > 1:
        count = len(drives) - 1
        yield f'and {count} harmonic{"s" if count > 1 else ""} more'
    if rig.multisine_level:
        low, high = rig.multisine_low, rig.multisine_high
        yield (
            f'multisine {rig.multisine_level:.4g} N rms from {_hertz(low)} to {_hertz(high)} = '
            f'{_share(rig, low, high)}'
        )
    elif not any(rig.force_amplitudes):
        yield 'no force'


def _bands(
    rig: RigParameters, varied: tuple[float, float] | None
) -> Iterator[tuple[str, float, float]]:
    """Yield name, lowest and highest frequency of each force, without zeros."""
    own = rig.force_frequencies[0]
    if rig.sweep_mode != 'off':
        yield 'sweep_low and sweep_high', rig.sweep_low, rig.sweep_high
    elif varied is not None:
        yield 'force_frequencies', *varied
    elif own and rig.force_amplitudes[0]:
        yield 'force_frequencies', own, own
    if rig.multisine_level:
        yield 'multisine_low and multisine_high', rig.multisine_low, rig.multisine_high


#: Largest magnification at resonance that is drawn: a damped rig comes to less, without impacts.
_MAGNIFICATION = 100.0
#: Least length of the damper, in amplitudes of M, so that it is visible.
_DAMPER_PER_SWING = 0.25
#: Longest deck in gaps, however far the control may open the stops.
_MOST_GAPS = 8.0
#: Distance of the eye, in half lengths of the rail.
_DISTANCE = 3.2
#: Cells of the grid along the rail.
_MOST_CELLS = 100

_COLOURS = {
    'base': '0.35 0.36 0.38 1.0',
    'primary': '0.20 0.42 0.69 1.0',
    'damper': '0.85 0.47 0.13 1.0',
    'stop': '0.15 0.15 0.16 1.0',
}


class PictureSize(NamedTuple):
    """
    Lengths of the picture, m.

    Attributes
    ----------
    damper : float
        Length and height of the damper; all widths and heights are in proportion to it.
    deck : float
        Half length of the primary mass's deck, which reaches beyond the stops.
    rail : float
        Half length of the rail, from the position of M without load and from its equilibrium.
    rest : float
        Position of M in its static equilibrium.
    """

    damper: float
    deck: float
    rail: float
    rest: float


def _swing(rig: RigParameters) -> float:
    """Return the amplitude of M without impacts, m; of several harmonics the root sum square."""
    amplitudes, frequencies, _ = rig.harmonics
    squares = 0.0
    for number, (amplitude, frequency) in enumerate(zip(amplitudes, frequencies, strict=True)):
        low = high = frequency
        if not number and rig.sweep_mode != 'off':
            # It may go through the resonance.
            low, high = rig.sweep_low, rig.sweep_high
        r = min(max(rig.omega, low), high) / rig.omega
        reduction = math.hypot((1.0 - r) * (1.0 + r), 2.0 * rig.zeta * r)
        squares += (amplitude / rig.stiffness / max(reduction, 1.0 / _MAGNIFICATION)) ** 2
    return math.sqrt(squares)


def picture_size(rig: RigParameters, gap_max: float = 0.0) -> PictureSize:
    """Return how large a rig is drawn."""
    swing = _swing(rig)
    damper = max(rig.gap, _DAMPER_PER_SWING * swing)
    widest = max(rig.gap, min(gap_max, _MOST_GAPS * rig.gap))
    deck = max(2.0 * damper, 0.5 * widest + damper)
    return PictureSize(damper, deck, deck + swing, rig.static_deflection)


def _number(value: float) -> str:
    return f'{value:.9g}'


def _box(size: PictureSize, material: str, x: float, z: float, *lengths: float) -> str:
    """Return a box; all numbers but `x` and its length are in lengths of the damper."""
    length, width, height = lengths
    unit = size.damper
    sides = ' '.join(map(_number, (length, width * unit, height * unit)))
    return f"""
    <visual>
      <origin xyz="{_number(x)} 0 {_number(z * unit)}"/>
      <geometry><box size="{sides}"/></geometry>
      <material name="{material}"/>
    </visual>"""


def _along_axis(name: str, limit: float, visuals: str) -> str:
    """Return a link and the joint along the axis that it hangs from."""
    reach = _number(limit)
    return f"""
  <joint name="{name}" type="prismatic">
    <parent link="axis"/>
    <child link="{name}"/>
    <axis xyz="1 0 0"/>
    <limit lower="-{reach}" upper="{reach}" effort="1e9" velocity="1e9"/>
  </joint>
  <link name="{name}">{visuals}
  </link>
"""


def robot_description(rig: RigParameters, gap_max: float = 0.0) -> str:
    """
    Return the URDF of a rig.

    Its joints are those of the topic joint_states: the incline, and absolute positions along
    its axis, so each hangs from the axis and none from another. The primary is at 0 while its
    spring is unloaded and its base at 0; a mark there moves with the base. A stop's joint
    stands where the middle of the damper is when they touch, so the stops' blocks begin half a
    damper further out. The deck is long enough for `gap_max`, the largest gap of the control,
    up to eight times the gap.
    """
    size = picture_size(rig, gap_max)
    unit = size.damper
    rail = 2.0 * size.rail + abs(size.rest)
    block = 0.4 * unit
    stop = 0.5 * (unit + block)
    stop_1 = _box(size, 'stop', stop, 0.0, block, 1.2, 1.0)
    stop_2 = '' if rig.one_sided else _box(size, 'stop', -stop, 0.0, block, 1.2, 1.0)
    colours = ''.join(
        f'  <material name="{name}"><color rgba="{rgba}"/></material>\n'
        for name, rgba in _COLOURS.items()
    )
    limit = 1000.0 * unit + abs(size.rest)
    angles = PARAMETER_SPECS['angle']
    return f"""<?xml version="1.0"?>
<robot name="impact_damper">
{colours}
  <link name="base_link"/>

  <!-- x points down the incline: a positive turn about y lowers it. -->
  <joint name="incline" type="revolute">
    <parent link="base_link"/>
    <child link="axis"/>
    <axis xyz="0 1 0"/>
    <limit lower="{angles.low!r}" upper="{angles.high!r}" effort="1e9" velocity="1e9"/>
  </joint>
  <link name="axis">{_box(size, 'base', 0.5 * size.rest, -1.25, rail, 1.6, 0.2)}
  </link>
\
{_along_axis('base', limit, _box(size, 'base', 0.0, -1.0, 0.05 * unit, 1.6, 0.35))}\
{_along_axis('primary', limit, _box(size, 'primary', 0.0, -0.575, 2.0 * size.deck, 1.2, 0.15))}\
{_along_axis('damper', limit, _box(size, 'damper', 0.0, 0.0, unit, 0.8, 1.0))}\
{_along_axis('stop_1', limit, stop_1)}\
{_along_axis('stop_2', limit, stop_2)}\
</robot>
"""


def rviz_setup(text: str, rig: RigParameters, gap_max: float = 0.0) -> str:
    """Return a set-up of RViz with its view fitted to a rig."""
    size = picture_size(rig, gap_max)
    setup: dict[str, Any] = yaml.safe_load(text)
    manager = setup['Visualization Manager']
    shown: Mapping[str, Any] = {display['Name']: display for display in manager['Displays']}
    # Where M is without load is in the view as well, unless it is far away.
    aside = math.copysign(min(abs(size.rest), size.rail), size.rest)
    half = size.rail + 0.5 * abs(aside)
    cell = max(size.damper, 2.0 * half / _MOST_CELLS)
    shown['Grid']['Cell Size'] = cell
    shown['Grid']['Plane Cell Count'] = 2 * math.ceil(1.5 * half / cell)
    shown['Grid']['Offset']['Z'] = -1.65 * size.damper
    shown['Frames']['Marker Scale'] = 2.0 * size.damper
    middle = size.rest - 0.5 * aside
    distance = _DISTANCE * half
    manager['Views']['Current'] |= {
        'Distance': distance,
        'Near Clip Distance': 0.003 * distance,
        'Focal Shape Size': 0.2 * distance,
        'Focal Point': {
            'X': middle * math.cos(rig.angle),
            'Y': 0.0,
            'Z': -middle * math.sin(rig.angle),
        },
    }
    return str(yaml.safe_dump(setup, sort_keys=False))
