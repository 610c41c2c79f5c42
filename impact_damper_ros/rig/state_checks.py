"""Checks of a stored state: that it is one that a rig can have."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, ulp
from typing import Any

from .mode import Mode
from .origin import Origin
from .quoting import shown

#: Latest time that a rig can reach, s; there the floats are 2 ms apart.
LATEST = 1e13
#: Rounding: what a state says of its time may differ by this, s.
SAME_TIME = 1e-6
#: Largest number of a motion; the products of larger ones are not finite.
_LARGEST = 1e100
_MODES = tuple(int(mode) for mode in Mode)
#: Values allowed for the fields of an origin that are not plain numbers.
_CHOICES: dict[str, tuple[object, ...]] = {
    'mode': _MODES,
    'last_stop': (0, 1, 2),
    'side': (-1, 0, 1),
    'released': (False, True),
}
#: Infinite where there is no stop; JSON has no number for that.
_MAY_BE_INFINITE = ('clearance_1', 'clearance_2', 'stop_1', 'stop_2', 'target_1', 'target_2')
_NOT_NEGATIVE = ('clearance_1', 'clearance_2', 'chatter_left')


def check_number(name: str, value: object, largest: float = _LARGEST) -> None:
    """Check that a value is a number, not too large."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < inf:
        raise ValueError(f'{name} is {shown(value)}: it must be a finite number')
    if abs(value) > largest:
        raise ValueError(
            f'{name} is {shown(value)}: it must be a number from {-largest:g} to {largest:g}'
        )


def check_numbers(name: str, values: object) -> None:
    """Check that a value is a list of numbers, none too large."""
    if not isinstance(values, list | tuple):
        raise ValueError(f'{name} is {shown(values)}: it must be a list of numbers')
    for value in values:
        check_number(f'an entry of {name}', value)


def check_whole(name: str, value: object, low: int = -(2**63), high: int = 2**63 - 1) -> None:
    """Check that a value is a whole number in a range, by default one of 64 bits."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f'{name} is {shown(value)}: it must be a whole number')
    if not low <= value <= high:
        raise ValueError(f'{name} is {shown(value)}: it must be from {low} to {high}')


def check_origin(origin: Mapping[str, Any], time: float, harmonics: int) -> None:
    """Check the stored origin of the flight of a rig at a time, s, with so many harmonics."""
    for name in Origin._fields:
        value = origin[name] if name in origin else Origin._field_defaults[name]
        if name == 'angles':
            check_numbers('origin.angles', value)
        elif name in _CHOICES:
            choices = _CHOICES[name]
            truth = isinstance(value, bool) == isinstance(choices[0], bool)
            if not (truth and isinstance(value, int) and value in choices):
                allowed = ', '.join(map(str, choices))
                raise ValueError(f'origin.{name} is {shown(value)}: it must be one of {allowed}')
        elif not (name in _MAY_BE_INFINITE and value in (None, inf, -inf)):
            check_number(f'origin.{name}', value)
        if name in _NOT_NEGATIVE and value is not None and value < 0.0:
            raise ValueError(f'origin.{name} is {shown(value)}: it must be from 0 on')
    begun, low = origin['time'], origin['time_low']
    check_number('origin.time', begun, LATEST)
    if abs(low) > ulp(max(abs(begun), 1.0)):
        raise ValueError(
            f'origin.time_low is {low!r} s: no more than the last digit of origin.time, '
            f'{begun!r} s, is allowed'
        )
    if begun + low > time + max(SAME_TIME, 2.0 * ulp(time)):
        raise ValueError(f'origin.time is {begun + low!r} s, after time, {time!r} s')
    if len(origin['angles']) != harmonics:
        raise ValueError(
            f'origin.angles has {len(origin["angles"])} entries, the force has {harmonics} '
            'harmonics: give one each'
        )
