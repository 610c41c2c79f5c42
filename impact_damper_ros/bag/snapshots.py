# SPDX-License-Identifier: Apache-2.0
"""
Snapshots of a rig, as its node publishes them: its state, and what was done to the rig.

A snapshot has all that a bit-for-bit continuation needs, and in `done` what was done since the one
before, in order, each as a name and its value:

- ``['change', {parameter: value, ...}]``: parameters that took other values together,
- ``['reset', {parameter: value, ...}]``: a reset to these initial conditions,
- ``['stamp_offset_ns', stamp]``: the stamps moved on or back; this is the stamp of rig time 0
  from here on.

A reader carries out these entries, and need not compare snapshots. `run` is a random number that
all snapshots of one run have in common: another one is of a rig that was started anew.
"""

from __future__ import annotations

import json
import secrets
import zlib
from collections.abc import Mapping
from functools import cache
from math import atan2, cos, expm1, log, sin
from struct import pack
from typing import Any

#: Least and greatest rate of joint states, Hz; their stamps are whole nanoseconds.
RATES = 1e-12, 1e9
#: Arguments of the functions whose bits `mathematics` takes.
_ARGUMENTS = tuple(0.37 * k + 1e-3 * k * k for k in range(1, 1000))


@cache
def mathematics() -> int:
    """
    Return a number that stands for the last bits of the mathematical functions of this machine.

    Other C libraries and processors round these functions differently, so that a rig has other
    last bits.
    """
    numbers = [f(s * a) for a in _ARGUMENTS for f, s in ((sin, 1.0), (cos, 1.0), (expm1, -0.02))]
    # Functions of the noise of the sensors and of their estimates
    numbers += [value for a in _ARGUMENTS for value in (log(a), atan2(a - 100.0, 7.0))]
    return zlib.crc32(pack(f'<{len(numbers)}d', *numbers))


#: State of the search of a flight that has not begun.
_UNSEARCHED = {'searched': 0.0, 'crossing_side': 0, 'watched': 0.0, 'crossing': None}


def without_search(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state as if its flight were not searched yet, which changes no motion."""
    return {**state, 'origin': {**state['origin'], **_UNSEARCHED}} if state else {}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {n: list(value) if isinstance(value, tuple) else value for n, value in values.items()}


class Snapshots:
    """
    Writes the snapshots of one run of a rig, given the full names of its node and topics.

    `initial` is where a reset puts the rig, `rate` the joint states per second of rig time,
    `offset_ns` the stamp of rig time 0.
    """

    #: Keys of the topics that a snapshot names.
    TOPICS = ('joint_states', 'impacts', 'gap_control', 'snapshot', 'parameter_events')

    def __init__(
        self,
        node: str,
        topics: Mapping[str, str],
        initial: Mapping[str, Any],
        rate: float,
        offset_ns: int = 0,
    ) -> None:
        #: Identity of the run: 32 hexadecimal digits
        self.run = secrets.token_hex(16)
        self._node = node
        self._topics = {key: topics[key] for key in self.TOPICS if key in topics}
        self._initial = dict(initial)
        self._rate = rate
        self._offset_ns = offset_ns
        self._done: list[list[Any]] = []
        self._number = 0

    def change(self, before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
        """Note parameters that have other values now; return whether there are any."""
        known = {**self._initial, **before}
        values = {n: value for n, value in after.items() if value != known.get(n)}
        self._initial |= {n: value for n, value in values.items() if n in self._initial}
        if values:
            self._done.append(['change', _plain(values)])
        return bool(values)

    def reset(self, initial: Mapping[str, Any]) -> None:
        """Note a reset."""
        self._initial = dict(initial)
        self._done.append(['reset', _plain(initial)])

    def move_stamps(self, offset_ns: int) -> None:
        """Note the present stamp of rig time 0, if that has changed."""
        if offset_ns != self._offset_ns:
            self._offset_ns = offset_ns
            self._done.append(['stamp_offset_ns', offset_ns])

    def text(self, time_ns: int, reason: str, state: Mapping[str, Any]) -> str:
        """Return the text of the next snapshot; `reason` is that of its publication."""
        done, self._done = self._done, []
        self._number += 1
        return json.dumps(
            {
                'run': self.run,
                'number': self._number,
                'node': self._node,
                'topics': self._topics,
                'rate': self._rate,
                'stamp_offset_ns': self._offset_ns,
                'time_ns': time_ns,
                'reason': reason,
                'mathematics': mathematics(),
                'done': done,
                'initial': _plain(self._initial),
                'state': without_search(state),
            }
        )
