# SPDX-License-Identifier: Apache-2.0
"""
Recorded against replayed messages, as arrays.

The messages of a topic are compared row by row, to the last bit. Impacts and acts are paired
first: the longest rows of equal messages show which are missing on one side, and which were
altered. A joint state is replayed at its own instant, so that it has its partner.
"""

from __future__ import annotations

from collections import deque
from difflib import SequenceMatcher
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.control.record import CONTROL_JOINTS

from .findings import Findings, SampleGap, ulps_between
from .rows import Messages, Numbers
from .run import TWICE, Disorder

#: Gaps without samples that are remembered, to excuse the impacts missing there.
_REMEMBERED_GAPS = 64
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
    Pairs the impacts, or the acts of the gap control, of a bag with those of its replay.

    The recorder of a bag that is not stamped with rig time may not have received a missing one.
    """

    def __init__(
        self, key: str, topic: str, findings: Findings, disorder: Disorder, *, stamped: bool
    ) -> None:
        self.topic = topic
        self._key, self._findings, self._stamped = key, findings, stamped
        self._disorder = disorder
        self._last = b''
        numbers = len(QUANTITIES[key]) - 2
        self._recorded = self._expected = np.empty(0, message_row(numbers))
        self._gaps: deque[SampleGap] = deque(maxlen=_REMEMBERED_GAPS)
        #: Stamps of the first and of the last recorded message
        self.first_ns: int | None = None
        self.last_ns = 0
        #: Messages of the replay from before the first one that the recorder received
        self.before_recorder = 0

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
        """Compare what is from before a stamp."""
        recorded, self._recorded = _parted(self._recorded, before_ns)
        expected, self._expected = _parted(self._expected, before_ns)
        there, here = _contents(recorded), _contents(expected)
        if there == here:
            self._count('{}', len(there))
            self._last = there[-1] if there else self._last
            return
        matcher = SequenceMatcher(None, there, here, autojunk=False)
        for kind, a, b, c, d in matcher.get_opcodes():
            both = min(b - a, d - c)
            self._count('{}', both)
            for i in range(both if kind == 'replace' else 0):
                row = expected[c + i]
                self.differ(row['stamp_ns'], *_telling(self._key, recorded[a + i], row))
            for row in expected[c + both : d]:
                self._missing(row)
            for i in range(a + both, b):
                if there[i] in ((there[i - 1] if i else self._last), *there[i + 1 : i + 2]):
                    # Copied, as where recordings that overlap are joined
                    self._disorder.note(TWICE, self.topic, [recorded[i]['stamp_ns']])
                else:
                    self.differ_wholly(recorded[i], recorded=True)
        self._last = there[-1] if there else self._last

    def _missing(self, row: np.void) -> None:
        stamp_ns = row['stamp_ns']
        if self.first_ns is None or (not self._stamped and stamp_ns < self.first_ns):
            self.before_recorder += 1
        elif not self._stamped or any(g.from_ns <= stamp_ns <= g.to_ns for g in self._gaps):
            self._count('missing_{}', 1)
        else:
            self.differ_wholly(row, recorded=False)

    def differ_wholly(self, row: np.void, *, recorded: bool) -> None:
        """Note a message that is only recorded, or only in the replay."""
        what = 'impact' if self._key == 'impacts' else 'act of the gap control'
        # An impact is named by its stop, an act by its kind
        name = str(row['frame'])
        self.differ(row['stamp_ns'], what, '', *((name, None) if recorded else (None, name)))

    def differ(self, stamp_ns: int, *difference: Any) -> None:
        """Note a difference: quantity, unit, recorded and replayed value."""
        self._findings.differ(int(stamp_ns), self.topic, *difference)


def _parted(rows: Messages, before_ns: float) -> tuple[Messages, Messages]:
    """Return the messages up to the first that is not before a stamp, and the others."""
    late = np.flatnonzero(rows['stamp_ns'] >= before_ns)
    cut = int(late[0]) if len(late) else len(rows)
    return rows[:cut], rows[cut:]


def expected_states(states: Messages, numbers: Numbers, *, stamped: bool) -> Messages:
    """Return the joint states that should have been recorded, given the numbers of the replay."""
    found = states.copy()
    found['numbers'], found['frame'] = numbers, ''
    if stamped:
        found['stamp_ns'] = found['log_ns']
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
    off = (states['numbers'] - expected['numbers'])[values]
    times = (expected['stamp_ns'][values] - findings.offset_ns) / 1e9
    findings.divergence.take(times, off[:, 0], off[:, 1])
