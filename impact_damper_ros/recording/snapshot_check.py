"""
Whether the text of a snapshot is that of a rig: its form is checked before a rig is made of it.

A state that no rig can have would otherwise show, much later, as an error of arithmetic.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import inf, isfinite, ulp
from typing import Any

from impact_damper_ros.control import ControlledRig
from impact_damper_ros.control.controller import Controller
from impact_damper_ros.rig import Mode
from impact_damper_ros.rig.origin import Origin
from impact_damper_ros.rig.shown import shown

__all__ = ['checked_state', 'parsed']

#: Characters, and depth, of a snapshot's text. One of 1,024 harmonics has some 100 kB.
_LONGEST = 4 * 1024 * 1024
_DEEPEST = 12
#: Whole numbers are times in ns, or counts.
_LARGEST_INTEGER = 2**63
#: Rig time of a state may differ by this from that of its message, s, by rounding.
_SAME_TIME = 1e-6
_MODES = tuple(int(mode) for mode in Mode)
#: What each field of an origin may be, where it is not any finite number.
_CHOICES: dict[str, tuple[object, ...]] = {
    'mode': _MODES,
    'last_stop': (0, 1, 2),
    'side': (-1, 0, 1),
    'released': (False, True),
}
#: Infinite, which JSON has no number for, where there is no stop.
_MAY_BE_INFINITE = ('clearance_1', 'clearance_2', 'stop_1', 'stop_2', 'target_1', 'target_2')


def _refuse(name: str) -> float:
    raise ValueError(f'{name} is no number of JSON')


def _whole(text: str) -> int:
    if len(text) > 20 or abs(int(text)) > _LARGEST_INTEGER:
        raise ValueError(f'a whole number has {len(text)} digits; none is beyond 2**63')
    return int(text)


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f'{shown(text)} is beyond the range of a double')
    return number


def parsed(text: str) -> dict[str, Any]:
    """
    Return what the text of a snapshot holds.

    Raises
    ------
    ValueError
        If it is no JSON object, too long or nested too deep, or has numbers that no rig has.
    """
    if len(text) > _LONGEST:
        raise ValueError(f'it is {len(text)} characters long; at most {_LONGEST} are read')
    try:
        held = json.loads(text, parse_constant=_refuse, parse_int=_whole, parse_float=_finite)
    except RecursionError:
        raise ValueError(f'it is nested more than {_DEEPEST} deep') from None
    if _deeper(held, _DEEPEST):
        raise ValueError(f'it is nested more than {_DEEPEST} deep')
    if not isinstance(held, dict):
        raise ValueError(f'it is {shown(held)}, not an object')
    return held


def _deeper(held: object, depth: int) -> bool:
    parts = held.values() if isinstance(held, dict) else held if isinstance(held, list) else ()
    return any(
        not depth or _deeper(part, depth - 1) for part in parts if isinstance(part, dict | list)
    )


def checked_state(state: Mapping[str, Any], time: float) -> None:
    """
    Check that a rig can be restored from a state.

    Parameters
    ----------
    state : mapping
        The state, in the present format and with its gap control.
    time : float
        Rig time of the message, s.

    Raises
    ------
    ValueError
        If not; the text names the value and what is allowed.
    """
    origin = state['origin']
    _check_origin(origin)
    _check_number('time', state['time'])
    _check_number('sweep.start', state['sweep']['start'])
    _check_whole('sweep.step', state['sweep']['step'])
    if abs(state['time'] - time) > _SAME_TIME:
        raise ValueError(
            f'its state is of rig time {state["time"]!r} s, the message of {time!r} s'
        )
    if abs(origin['time_low']) > ulp(max(abs(origin['time']), 1.0)):
        raise ValueError(
            f'origin.time_low is {origin["time_low"]!r} s: no more than the last digit of '
            f'origin.time, {origin["time"]!r} s, is allowed'
        )
    begun = origin['time'] + origin['time_low']
    if begun > state['time'] + _SAME_TIME:
        raise ValueError(f'origin.time is {begun!r} s, after time, {state["time"]!r} s')
    control = state['gap_control']['state']
    try:
        _check_control('gap_control.state', control, Controller().as_dict())
        rig = ControlledRig.restore(dict(state))
        harmonics = len(rig.parameters.harmonics[0])
        if len(origin['angles']) != harmonics:
            raise ValueError(
                f'origin.angles has {len(origin["angles"])} entries, the force has {harmonics} '
                'harmonics: give one each'
            )
        _check_numbers('sample', rig.sample())
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
        raise ValueError(f'{type(error).__name__}: {error}') from error


def _check_number(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError(f'{name} is {shown(value)}: a finite number is allowed')


def _check_whole(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f'{name} is {shown(value)}: a whole number is allowed')


def _check_numbers(name: str, values: object) -> None:
    if not isinstance(values, list | tuple):
        raise ValueError(f'{name} is {shown(values)}: a list of numbers is allowed')
    for value in values:
        _check_number(f'an entry of {name}', value)


def _check_origin(origin: object) -> None:
    if not isinstance(origin, dict):
        raise ValueError(f'origin is {shown(origin)}: an object is allowed')
    for name in Origin._fields:
        value = origin.get(name, Origin._field_defaults.get(name))
        if name == 'angles':
            _check_numbers('origin.angles', value)
        elif name in _CHOICES:
            choices = _CHOICES[name]
            if not any(type(value) is type(choice) and value == choice for choice in choices):
                allowed = ', '.join(map(str, choices))
                raise ValueError(f'origin.{name} is {shown(value)}: {allowed} are allowed')
        elif not (name in _MAY_BE_INFINITE and value in (None, inf, -inf)):
            _check_number(f'origin.{name}', value)


#: How many entries the lists of the control's state have, where not as many as at its start.
_LENGTHS = {'last': (0, 7), 'hit_1': (0, 2), 'hit_2': (0, 2), 'places': (0, 1, 2)}


def _check_control(name: str, held: Mapping[str, Any], pattern: Mapping[str, Any]) -> None:
    """Check that a state is built as that of a control at its start."""
    for key, like in pattern.items():
        value, where = held[key], f'{name}.{key}'
        if isinstance(like, dict):
            _check_control(where, value, like)
        elif key == 'waiting':
            for command in value:
                time, *targets = command
                _check_number(f'{where}: time', time)
                _check_numbers(where, [target for target in targets if target is not None])
        elif isinstance(like, list):
            _check_numbers(where, value)
            if len(value) not in _LENGTHS.get(key, (len(like),)):
                raise ValueError(f'{where} has {len(value)} entries')
        elif isinstance(like, bool):
            if not isinstance(value, bool):
                raise ValueError(f'{where} is {shown(value)}: true or false are allowed')
        elif isinstance(like, int):
            _check_whole(where, value)
        elif not (like is None and value is None):
            _check_number(where, value)
