# SPDX-License-Identifier: Apache-2.0
"""
Recorded against replayed messages, as arrays.

The messages of a topic are compared row by row, to the last bit. Impacts and acts are joined by
their stamps. A joint state is replayed at its recorded instant, so that each has a partner.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.control.act import CONTROL_JOINTS

from .findings import ACT, IMPACT, Findings, SampleGap
from .rows import Messages, Numbers
from .run import REPEATED

#: Bytes of a stamp, with which the content of a message begins.
_STAMP = 8


def _quantities(joints: tuple[str, ...], effort: str) -> list[tuple[str, str]]:
    """Return name and unit of each field of messages, after the place in the recording."""
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
    """Return the bytes of messages, one row for each: 0.0 and -0.0 differ in them."""
    return np.ascontiguousarray(rows).view(np.int64).reshape(len(rows), rows.itemsize // 8)


def _contents(rows: Messages) -> list[bytes]:
    """Return the bytes of each message behind its first field, its place in the recording."""
    held, size, place = rows.tobytes(), rows.itemsize, rows.dtype['place'].itemsize
    return [held[i + place : i + size] for i in range(0, len(held), size)]


def _values(row: np.void) -> list[Any]:
    return [int(row['stamp_ns']), str(row['frame']), *row['numbers'].tolist()]


def _relative(recorded: Any, replayed: Any) -> float:
    """Return a relative difference; infinity where these are no numbers of the same sign."""
    if isinstance(replayed, float) and isinstance(recorded, float) and recorded * replayed > 0.0:
        return abs(recorded - replayed) / max(abs(recorded), abs(replayed))
    return math.inf


def _largest_difference(
    key: str, recorded: np.void, replayed: np.void
) -> tuple[str, str, Any, Any]:
    """Return quantity, unit and values where two messages differ most, relative."""
    there, here = _values(recorded), _values(replayed)
    wrong = [a != b for a, b in zip(there[:2], here[:2], strict=True)]
    # Numbers are compared by their bits: 0.0 and -0.0 differ, and so may two NaN.
    wrong += (recorded['numbers'].view(np.int64) != replayed['numbers'].view(np.int64)).tolist()
    rows = zip(QUANTITIES[key], there, here, wrong, strict=True)
    found = [(*quantity, a, b) for quantity, a, b, differs in rows if differs]
    return max(found, key=lambda entry: _relative(*entry[2:]))


class Matcher:
    """
    Joins the impacts, or the acts of the gap control, of a bag with those of its replay.

    Messages are joined by their stamps. Messages on one side only, and altered ones, are noted. A
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
        self._expected = _split_at(self._expected, before_ns)[1]

    def excuse(self, gap: SampleGap) -> None:
        """Note a gap in which messages are missing."""
        self._gaps.append(gap)

    def _count(self, name: str, count: int) -> None:
        name = name.format(self._key)
        setattr(self._findings, name, getattr(self._findings, name) + count)

    def settle(self, before_ns: float) -> None:
        """Join the messages from before a stamp."""
        recorded, self._recorded = _split_at(self._recorded, before_ns)
        expected, self._expected = _split_at(self._expected, before_ns)
        there, here = _contents(recorded), _contents(expected)
        if there == here:
            self._count('{}', len(there))
        else:
            self._join(recorded, there, expected, here)
        self._gaps = [gap for gap in self._gaps if gap.to_stamp_ns >= before_ns]

    def end(self, last_ns: int) -> None:
        """Join all; messages of the replay after the last stamp may be missing."""
        self.settle(last_ns + 1)
        self.forget(math.inf)
        self.settle(math.inf)

    def _join(
        self, recorded: Messages, there: list[bytes], expected: Messages, here: list[bytes]
    ) -> None:
        """Note the differences of recorded and replayed messages, given also their contents."""
        only_there, only_here = _without_partners(there, here)
        # A message is altered if it has a partner of the same instant, or an equal one of another.
        at_once, (only_there, only_here) = _partners(
            recorded['stamp_ns'].tolist(), expected['stamp_ns'].tolist(), only_there, only_here
        )
        moved, (only_there, only_here) = _partners(
            [c[_STAMP:] for c in there], [c[_STAMP:] for c in here], only_there, only_here
        )
        self._count('{}', len(here) - len(only_here))
        for i, j in sorted([*at_once, *moved], key=lambda pair: pair[1]):
            quantity = _largest_difference(self._key, recorded[i], expected[j])
            self.differ(expected[j]['stamp_ns'], *quantity)
        for j in only_here:
            self._missing(expected[j])
        copies = Counter(there)
        for i in only_there:
            if copies[there[i]] > 1:
                # A message may be there twice, as where recordings that overlap are joined.
                self._wrong[REPEATED, self.topic] += 1
            else:
                self.differ_wholly(recorded[i], recorded=True)

    def _missing(self, row: np.void) -> None:
        stamp_ns = row['stamp_ns']
        if not self._own and (self.first_ns is None or stamp_ns < self.first_ns):
            # A recorder may join each topic at another time.
            return
        if not self._own or any(g.from_stamp_ns <= stamp_ns <= g.to_stamp_ns for g in self._gaps):
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


#: Tolerance of the stamp of a message, ns, in addition to that of the motion.
STAMP_NS = 2
#: Time within which a message may be stamped earlier or later than its partner, ns.
_NEIGHBOURS_NS = 1000


class NearMatcher(Matcher):
    """Joins acts of the gap control with those of a replay that has other last bits."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._allowed = np.empty(0, self._expected.dtype)
        self._unsure_ns = math.inf

    def expect_near(self, replayed: Messages, allowed: Messages) -> None:
        """Take messages of the replay, and the tolerance of each number and stamp."""
        if self._unsure_ns == math.inf:
            self._expected = np.concatenate([self._expected, replayed])
            self._allowed = np.concatenate([self._allowed, allowed])

    def lose(self, from_ns: int) -> None:
        """Note that the acts from a stamp on may differ by round-off."""
        self._unsure_ns = min(self._unsure_ns, from_ns)

    def recover(self, stamp_ns: int) -> None:
        """Note that the state of the control is known again, at a stamp."""
        if self._unsure_ns < math.inf:
            unsure = self._recorded['stamp_ns'] >= self._unsure_ns
            if count := int(unsure.sum()):
                time = (self._unsure_ns - self._findings.offset_ns) / 1e9
                text = f'{count} acts of the gap control from {time:.9g} s on are not checked'
                self._findings.fault(f'{text}: round-off may change them')
            self._recorded, self._unsure_ns = self._recorded[~unsure], math.inf
        self.settle(stamp_ns)

    def forget(self, before_ns: float) -> None:
        """Forget the messages of the replay from before a stamp."""
        late = self._expected['stamp_ns'] >= before_ns
        self._expected, self._allowed = self._expected[late], self._allowed[late]

    def settle(self, before_ns: float) -> None:
        """Join the messages from before a stamp; partners may be on both sides of it."""
        before_ns = min(before_ns, self._unsure_ns) - _NEIGHBOURS_NS
        self._join_near(before_ns, before_ns - _NEIGHBOURS_NS)
        self._gaps = [gap for gap in self._gaps if gap.to_stamp_ns >= before_ns - _NEIGHBOURS_NS]

    def end(self, last_ns: int) -> None:
        """Join all; messages of the replay from the last stamp on may be missing."""
        self.recover(last_ns)
        self._join_near(math.inf, last_ns)

    def _join_near(self, before_ns: float, missing_ns: float) -> None:
        """Join messages recorded before a stamp; report those missing before another stamp."""
        recorded, self._recorded = _split_at(self._recorded, before_ns)
        stamps = self._expected['stamp_ns']
        free = np.ones(len(stamps), np.bool_)
        for row in recorded:
            self._find_partner(row, free)
        for j in np.flatnonzero(free & (stamps < missing_ns)):
            self._missing(self._expected[j])
            free[j] = False
        self._expected, self._allowed = self._expected[free], self._allowed[free]

    def _find_partner(self, row: np.void, free: NDArray[np.bool_]) -> None:
        """Join a recorded message with one of the replay that has no partner yet."""
        expected, allowed = self._expected, self._allowed
        lag = np.abs(expected['stamp_ns'] - row['stamp_ns'])
        near = free & (lag <= STAMP_NS + allowed['stamp_ns']) & (expected['frame'] == row['frame'])
        if not near.any():
            self.differ_wholly(row, recorded=True)
            return
        off = np.abs(expected['numbers'][near] - row['numbers'])
        # An entry that an order leaves out is NaN on both sides.
        off[np.isnan(expected['numbers'][near]) & np.isnan(row['numbers'])] = 0.0
        excess = off - allowed['numbers'][near]
        place = int(np.argmin(np.where(excess <= 0.0, 0.0, np.inf).sum(axis=1)))
        j = int(np.flatnonzero(near)[place])
        free[j] = False
        self._count('{}', 1)
        wrong = np.flatnonzero(~(excess[place] <= 0.0))
        if len(wrong):
            numbers = (float(r['numbers'][wrong[0]]) for r in (row, expected[j]))
            self.differ(row['stamp_ns'], *QUANTITIES[self._key][2 + wrong[0]], *numbers)


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


def _split_at(rows: Messages, before_ns: float) -> tuple[Messages, Messages]:
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
    """Note the joint states that differ from the replay, each by its largest difference."""
    states, expected = states[differs], expected[differs]
    if not len(states):
        return
    for there, here in zip(states, expected, strict=True):
        found = _largest_difference('joint_states', there, here)
        findings.differ(int(here['stamp_ns']), topic, *found)
    count = states['numbers'].shape[1]
    values = (_words(states) != _words(expected))[:, -count:].any(axis=1)
    off = np.subtract(states['numbers'], expected['numbers'])[values]
    times = (expected['stamp_ns'][values] - findings.offset_ns) / 1e9
    findings.divergence.take(times, off[:, 0], off[:, 1])
