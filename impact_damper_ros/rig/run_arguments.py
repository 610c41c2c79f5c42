# SPDX-License-Identifier: Apache-2.0
"""Arguments of a run: the time to reach, instants, a number of events, places of stops."""

from __future__ import annotations

from math import ceil, inf
from typing import Any

import numpy as np
import numpy.typing as npt

from impact_damper_ros.parameters.parameter_spec import ParameterError, as_float
from impact_damper_ros.parameters.quoting import quote
from impact_damper_ros.rig.snapshot import LATEST

#: More events than any run has.
MOST = 2**62
_FARTHEST = 1e9
_SLOWEST = 1e-9


def most_of(most_events: float, name: str = 'most_events') -> int:
    """Round a number of events up; raise a ValueError if it is negative or NaN."""
    number = as_float(most_events)
    if not number >= 0.0:
        raise ValueError(
            f'{name} is {quote(most_events)}: give a number from 0 on, infinity for no limit'
        )
    return MOST if number >= MOST else ceil(number)


def later_time(time: float, now: float) -> float:
    """Return a time (s) as a float; raise a ValueError if a rig cannot run to it."""
    end = as_float(time)
    if not now <= end < inf:
        raise ValueError(
            f'cannot advance to {quote(time)} s: give a finite time not before {now!r} s'
        )
    if end > LATEST:
        raise ValueError(f'cannot advance to {end!r} s: give a time up to {LATEST:g} s')
    return end


def times_between(since: float, end: float, instants: Any) -> npt.NDArray[np.float64]:
    """Return instants as an array; raise a ValueError if they are not in order or range."""
    try:
        when = np.array(instants, dtype=float).reshape(-1)
    except (OverflowError, TypeError, ValueError) as error:
        raise ValueError(f'instants are {quote(instants)}: give a list of times, s') from error
    in_order = bool(np.all(when[1:] >= when[:-1]))
    if len(when) and not (in_order and when[0] >= since and when[-1] <= end):
        raise ValueError(
            f'instants must ascend from {since!r} s to {end!r} s: sort them, and leave out those '
            'before and after'
        )
    return when


def check_target(one_sided: bool, stop: int, target: float, speed: float) -> None:
    """Check the target and speed of a stop."""
    name = f'stop_{stop}'
    if stop == 2 and one_sided:
        raise ParameterError(
            name,
            f'{name} is {target!r} m but the rig is one-sided: give None, or one_sided: false',
        )
    if not -_FARTHEST <= as_float(target) <= _FARTHEST:
        raise ParameterError(
            name,
            f'{name} is {quote(target)} m: give the place Y where it is to go, a number from '
            f'{-_FARTHEST:g} to {_FARTHEST:g} m',
        )
    if not speed >= _SLOWEST:
        raise ParameterError(
            'speed',
            f'speed is {speed!r} m/s: give a number from {_SLOWEST:g} m/s, or inf for at once',
        )
