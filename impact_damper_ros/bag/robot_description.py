# SPDX-License-Identifier: Apache-2.0
"""
The robot description (URDF) of a rig, which node and bags have as a topic, for viewers.

Everything is drawn in proportion to the gap and to the displacement of M.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters

#: Largest magnification at resonance that is drawn; that of a damped rig is lower.
_MAGNIFICATION = 100.0
#: Least length of the damper, in amplitudes of M, so that it is visible.
_DAMPER_PER_SWING = 0.25
#: Longest deck in gaps, however far the control may open the stops.
_MOST_GAPS = 8.0

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
            # The sweep may pass the resonance.
            low, high = rig.sweep_low, rig.sweep_high
        r = min(max(rig.omega, low), high) / rig.omega
        reduction = math.hypot((1.0 - r) * (1.0 + r), 2.0 * rig.zeta * r)
        squares += (amplitude / rig.stiffness / max(reduction, 1.0 / _MAGNIFICATION)) ** 2
    return math.sqrt(squares)


def picture_size(rig: RigParameters, gap_max: float = 0.0) -> PictureSize:
    """Return the lengths with which a rig is drawn."""
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

    Its joints are those of the topic joint_states: the incline, and absolute positions along its
    axis, so that each joint hangs from the axis. The primary is at 0 while its spring is unloaded
    and its base at 0; a mark there moves with the base. The joint of a stop is at the middle of
    the damper when they touch, so that the block of the stop begins half a damper further out. The
    deck is long enough for `gap_max`, the largest gap of the control, up to eight times the gap.
    """
    return _urdf(picture_size(rig, gap_max), rig.one_sided)


@lru_cache(maxsize=4)
def _urdf(size: PictureSize, one_sided: bool) -> str:
    """Return a URDF: most changes of a rig leave its size."""
    unit = size.damper
    rail = 2.0 * size.rail + abs(size.rest)
    block = 0.4 * unit
    stop = 0.5 * (unit + block)
    stop_1 = _box(size, 'stop', stop, 0.0, block, 1.2, 1.0)
    stop_2 = '' if one_sided else _box(size, 'stop', -stop, 0.0, block, 1.2, 1.0)
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
