# SPDX-License-Identifier: Apache-2.0
"""
Recorded against replayed messages, as arrays.

The messages of a topic are compared row by row, to the last bit. Impacts and acts are joined by
their stamps. A joint state is replayed at its own instant, so that it has its partner.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.control.record import CONTROL_JOINTS

from .findings import ACT, IMPACT, Findings, SampleGap, ulps_between
from .rows import Messages, Numbers
from .run import REPEATED

#: Bytes of a stamp, with which the content of a message begins.
_STAMP = 8
#: Differing joint states of a piece that are looked at one by one.
_LOOKED_AT = 20


def _quantities(joints: tuple[str, ...], effort: str) -> list[tuple[str, str]]:
    """Return name and unit of each field of messages, after the stamp of the recording."""
    parts = [('position', 'm'), ('velocity', 'm/s')] + ([('effort', effort)] if effort else [])
    numbers = [(f'{part} of {joint}', unit) for part, unit in parts for joint in joints]
    numbers = [(n, u.replace('m', 'rad') if n.endswith('incline') else u) for n, u in numbers]
    return [('stamp', 'ns'), ('frame_id', ''), *numbers]


#: Quantities of the messages by topic.
QUANTITIES = {
    'joint_states': _quantities(JOINTS, ''),
    'impacts': _quantities(IMPACT_JOINTS, 'N s'),
    'gap_control': _quantities(CONTROL_JOINTS, 'J'),
}


def _words(rows: Messages) -> NDArray[np.int64]:
    """Return messages as they are stored, in which 0.0 and -0.0 differ; one row for each."""
    return np.ascontiguousarray(rows).view(np.int64).reshape(len(rows), rows.itemsize // 8)


def _contents(rows: Messages) -> list[bytes]:
    """Return all of each message but the stamp of the recording, which is its first field."""
    held, size, stamp = rows.tobytes(), rows.itemsize, rows.dtype['log_ns'].itemsize
    return [held[i + stamp : i + size] for i in range(0, len(held), size)]


def _values(row: np.void) -> list[Any]:
    return [int(row['stamp_ns']), str(row['frame']), *row['numbers'].tolist()]


def _telling(key: str, recorded: np.void, replayed: np.void) -> tuple[str, str, Any, Any]:
    """Return quantity, unit and values of that in which two messages differ most."""
    there, here = _values(recorded), _values(replayed)
    wrong = [a != b for a, b in zip(there[:2], here[:2], strict=True)]
    # By their bits: 0.0 and -0.0 differ, and so may two NaN.
    wrong += (recorded['numbers'].view(np.int64) != replayed['numbers'].view(np.int64)).tolist()
    rows = zip(QUANTITIES[key], there, here, wrong, strict=True)
    found = [(*quantity, a, b) for quantity, a, b, differs in rows if differs]
    return max(found, key=lambda entry: ulps_between(*entry[2:]))


class Matcher:
    """
    Joins the impacts, or the acts of the gap control, of a bag with those of its replay.

    They are joined by their stamps; what is on one side only, and what is altered, is noted. A
    message that is in the replay only is a difference in a bag that the node recorded itself, but
    not where samples are missing, too. Another recorder may not have received it.
    """

    def __init__(
        self,
        key: str,
        topic: str,
        findings: Findings,
        wrong: Counter[tuple[str, str]],
        *,
        own: bool,
    ) -> None:
        self.topic = topic
        self._key, self._findings, self._own = key, findings, own
        self._wrong = wrong
        numbers = len(QUANTITIES[key]) - 2
        self._recorded = self._expected = np.empty(0, message_row(numbers))
        self._gaps: list[SampleGap] = []
        #: Stamps of the first and of the last recorded message
        self.first_ns: int | None = None
        self.last_ns = 0

    def take(self, recorded: Messages) -> None:
        """Take recorded messages."""
        if len(recorded):
            self._recorded = np.concatenate([self._recorded, recorded])
            self.last_ns = int(recorded['stamp_ns'][-1])
            if self.first_ns is None:
                self.first_ns = int(recorded['stamp_ns'][0])
            self._count('recorded_{}', len(recorded))

    def expect(self, replayed: Messages) -> None:
        """Take messages of the replay."""
        if len(replayed) and self.topic:
            self._expected = np.concatenate([self._expected, replayed])

    def forget(self, before_ns: float) -> None:
        """Forget the messages of the replay from before a stamp."""
        self._expected = _parted(self._expected, before_ns)[1]

    def excuse(self, gap: SampleGap) -> None:
        """Take note of a gap in which messages are missing."""
        self._gaps.append(gap)

    def _count(self, name: str, count: int) -> None:
        name = name.format('impacts' if self._key == 'impacts' else 'control')
        setattr(self._findings, name, getattr(self._findings, name) + count)

    def settle(self, before_ns: float) -> None:
        """Join what is from before a stamp."""
        recorded, self._recorded = _parted(self._recorded, before_ns)
        expected, self._expected = _parted(self._expected, before_ns)
        there, here = _contents(recorded), _contents(expected)
        if there == here:
            self._count('{}', len(there))
        else:
            self._join(recorded, there, expected, here)
        self._gaps = [gap for gap in self._gaps if gap.to_ns >= before_ns]

    def _join(
        self, recorded: Messages, there: list[bytes], expected: Messages, here: list[bytes]
    ) -> None:
        """Note what is different in recorded and replayed messages, given also their contents."""
        only_there, only_here = _without_partners(there, here)
        # Altered are messages of the same instant, and equal messages of another one.
        at_once, (only_there, only_here) = _partners(
            recorded['stamp_ns'].tolist(), expected['stamp_ns'].tolist(), only_there, only_here
        )
        moved, (only_there, only_here) = _partners(
            [c[_STAMP:] for c in there], [c[_STAMP:] for c in here], only_there, only_here
        )
        self._count('{}', len(here) - len(only_here))
        for i, j in sorted([*at_once, *moved], key=lambda pair: pair[1]):
            quantity = _telling(self._key, recorded[i], expected[j])
            self.differ(expected[j]['stamp_ns'], *quantity)
        for j in only_here:
            self._missing(expected[j])
        copies = Counter(there)
        for i in only_there:
            if copies[there[i]] > 1:
                # As where recordings that overlap are joined
                self._wrong[REPEATED, self.topic] += 1
            else:
                self.differ_wholly(recorded[i], recorded=True)

    def _missing(self, row: np.void) -> None:
        stamp_ns = row['stamp_ns']
        if not self._own and (self.first_ns is None or stamp_ns < self.first_ns):
            # A recorder may join each topic at another time.
            return
        if not self._own or any(g.from_ns <= stamp_ns <= g.to_ns for g in self._gaps):
            self._count('missing_{}', 1)
        else:
            self.differ_wholly(row, recorded=False)

    def differ_wholly(self, row: np.void, *, recorded: bool) -> None:
        """Note a message that is only recorded, or only in the replay."""
        what = IMPACT if self._key == 'impacts' else ACT
        # An impact is named by its stop, an act by its kind
        name = str(row['frame'])
        self.differ(row['stamp_ns'], what, '', *((name, None) if recorded else (None, name)))

    def differ(self, stamp_ns: int, *difference: Any) -> None:
        """Note a difference: quantity, unit, recorded and replayed value."""
        self._findings.differ(int(stamp_ns), self.topic, *difference)


def _without_partners(there: list[bytes], here: list[bytes]) -> tuple[list[int], list[int]]:
    """Return which entries of each of two lists are not in the other one."""
    _, left = _partners(there, here, range(len(there)), range(len(here)))
    return left


def _partners(
    there: Sequence[Any], here: Sequence[Any], some: Iterable[int], others: Iterable[int]
) -> tuple[list[tuple[int, int]], tuple[list[int], list[int]]]:
    """Pair equal entries, given by their places, in order; return pairs, and the places left."""
    places = defaultdict[Any, deque[int]](deque)
    for j in others:
        places[here[j]].append(j)
    pairs, left = [], []
    for i in some:
        if waiting := places.get(there[i]):
            pairs.append((i, waiting.popleft()))
        else:
            left.append(i)
    return pairs, (left, sorted(j for waiting in places.values() for j in waiting))


def _parted(rows: Messages, before_ns: float) -> tuple[Messages, Messages]:
    """Return the messages up to the first that is not before a stamp, and the others."""
    late = np.flatnonzero(rows['stamp_ns'] >= before_ns)
    cut = int(late[0]) if len(late) else len(rows)
    return rows[:cut], rows[cut:]


def expected_states(states: Messages, numbers: Numbers) -> Messages:
    """Return the joint states that should have been recorded, given the numbers of the replay."""
    found = states.copy()
    found['numbers'], found['frame'] = numbers, ''
    return found


def differing_states(states: Messages, expected: Messages) -> NDArray[np.bool_]:
    """Return which joint states are not those of the replay."""
    differs: NDArray[np.bool_] = (_words(states) != _words(expected)).any(axis=1)
    return differs


def note_states(
    findings: Findings,
    topic: str,
    states: Messages,
    expected: Messages,
    differs: NDArray[np.bool_],
) -> None:
    """Note the joint states that differ from the replay, each by its most telling quantity."""
    states, expected = states[differs], expected[differs]
    if not len(states):
        return
    for i in range(min(len(states), _LOOKED_AT)):
        more = len(states) - _LOOKED_AT if i == _LOOKED_AT - 1 else 0
        found = _telling('joint_states', states[i], expected[i])
        findings.differ(int(expected['stamp_ns'][i]), topic, *found, alike=more)
    count = states['numbers'].shape[1]
    values = (_words(states) != _words(expected))[:, -count:].any(axis=1)
    off = np.subtract(states['numbers'], expected['numbers'])[values]
    times = (expected['stamp_ns'][values] - findings.offset_ns) / 1e9
    findings.divergence.take(times, off[:, 0], off[:, 1])
