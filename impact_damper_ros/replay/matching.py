# SPDX-License-Identifier: Apache-2.0
"""
Recorded against replayed messages, as arrays.

The messages of a topic are compared row by row, to the last bit. Where their numbers differ, the
longest rows of equal messages show which are missing on one side, and which were altered.
"""

from __future__ import annotations

from collections import deque
from difflib import SequenceMatcher
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.control import CONTROL_JOINTS

from .findings import Difference, Findings, SampleGap
from .rows import Messages, Numbers
from .run import TWICE, Disorder

#: Gaps without samples that are remembered, to excuse the impacts missing there.
_REMEMBERED_GAPS = 64
#: Differing joint states of a piece that are looked at one by one.
_LOOKED_AT = 20


def bits(numbers: Numbers) -> NDArray[np.int64]:
    """Return doubles as they are stored, in which 0.0 and -0.0 differ."""
    return np.ascontiguousarray(numbers).view(np.int64)


def _names(joints: tuple[str, ...], effort: str) -> list[tuple[str, str]]:
    """Return name and unit of the numbers of messages."""
    parts = (('position', 'm'), ('velocity', 'm/s'), ('effort', effort))
    return [(f'{part} of {joint}', unit) for part, unit in parts for joint in joints]


_STATES = [
    (name, unit.replace('m', 'rad') if name.endswith('incline') else unit)
    for name, unit in _names(JOINTS, '')
]


class Matcher:
    """
    Pairs the impacts, or the acts of the gap control, of a bag with those of its replay.

    The recorder of a bag that is not stamped with rig time may not have received a missing one.
    """

    def __init__(
        self, key: str, topic: str, findings: Findings, disorder: Disorder, *, stamped: bool
    ) -> None:
        self.topic = topic
        self._disorder = disorder
        self._last = b''
        self._findings, self._stamped = findings, stamped
        self._key = key
        impacts = key == 'impacts'
        joints = IMPACT_JOINTS if impacts else (*CONTROL_JOINTS, 'the act')
        self.fields = [('stamp', 'ns'), ('frame_id', ''), ('act', '')]
        self.fields += _names(joints, 'N s' if impacts else 'J')
        self._what = 'impact' if key == 'impacts' else 'act of the gap control'
        self._recorded = self._expected = np.empty(0, message_row(len(self.fields) - 3))
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
        key = 'impacts' if self._key == 'impacts' else 'control'
        name = name.format(key)
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
                self._altered(recorded[a + i], expected[c + i])
            for row in expected[c + both : d]:
                self._missing(row)
            for i in range(a + both, b):
                if there[i] in ((there[i - 1] if i else self._last), *there[i + 1 : i + 2]):
                    # Copied, as where recordings that overlap are joined
                    self._disorder.note(TWICE, self.topic, [recorded[i]['stamp_ns']])
                else:
                    self._differ_by(recorded[i], self._what, '', _named(recorded[i]), None)
        self._last = there[-1] if there else self._last

    def _altered(self, there: np.void, here: np.void) -> None:
        """Note the first quantity in which two messages differ."""
        pairs = zip(self.fields, _values(there), _values(here), strict=True)
        for field, recorded, replayed in pairs:
            if recorded != replayed or str(recorded) != str(replayed):
                self._differ_by(here, *field, recorded, replayed)
                return

    def _missing(self, row: np.void) -> None:
        stamp_ns = row['stamp_ns']
        if self.first_ns is None or (not self._stamped and stamp_ns < self.first_ns):
            self.before_recorder += 1
        elif not self._stamped or any(g.from_ns <= stamp_ns <= g.to_ns for g in self._gaps):
            self._count('missing_{}', 1)
        else:
            self._differ_by(row, self._what, '', None, _named(row))

    def _differ_by(self, row: np.void, *difference: Any) -> None:
        self.differ(int(row['stamp_ns']), *difference)

    def differ(
        self, stamp_ns: int, quantity: str, unit: str, recorded: object, replayed: object
    ) -> None:
        """Note a difference."""
        findings = self._findings
        time = (stamp_ns - findings.offset_ns) / 1e9
        findings.differ(
            Difference(
                time, stamp_ns, self.topic, quantity, unit, recorded, replayed, findings.after
            )
        )


def _parted(rows: Messages, before_ns: float) -> tuple[Messages, Messages]:
    """Return the messages up to the first that is not before a stamp, and the others."""
    late = np.flatnonzero(rows['stamp_ns'] >= before_ns)
    cut = int(late[0]) if len(late) else len(rows)
    return rows[:cut], rows[cut:]


def _contents(rows: Messages) -> list[bytes]:
    """Return all of each message but the stamp of the recording, which is its first field."""
    held, size, stamp = rows.tobytes(), rows.itemsize, rows.dtype['log_ns'].itemsize
    return [held[i + stamp : i + size] for i in range(0, len(held), size)]


def _named(row: np.void) -> str:
    """Return what an impact or an act is called: by its stop, or by its kind."""
    return str(row['frame'] or row['act'])


def _values(row: np.void) -> list[Any]:
    return [int(row['stamp_ns']), str(row['frame']), str(row['act']), *row['numbers'].tolist()]


def differing_states(states: Messages, numbers: Numbers, *, stamped: bool) -> NDArray[np.bool_]:
    """Return which joint states are not those of the replay, given its numbers."""
    differs: NDArray[np.bool_] = (bits(states['numbers']) != bits(numbers)).any(axis=1)
    differs |= (states['frame'] != '') | (states['act'] != '')
    if stamped:
        differs |= states['stamp_ns'] != states['log_ns']
    return differs


def note_states(
    findings: Findings,
    topic: str,
    states: Messages,
    times: Numbers,
    numbers: Numbers,
    differs: NDArray[np.bool_],
    *,
    stamped: bool,
) -> None:
    """Note the joint states that differ from the replay, each by its most telling quantity."""
    rows = np.flatnonzero(differs)
    if not len(rows):
        return
    found = []
    for i in rows[:_LOOKED_AT]:
        here, there = numbers[i].tolist(), states['numbers'][i].tolist()
        stamp_ns, within_ns = int(states['log_ns'][i]), int(states['stamp_ns'][i])
        wrong: list[tuple[str, str, Any, Any]] = [('stamp', 'ns', within_ns, stamp_ns)]
        wrong += [
            (*name, a, b)
            for name, a, b in zip(_STATES, there, here, strict=False)
            if repr(a) != repr(b)
        ]
        if within_ns == stamp_ns or not stamped:
            texts = ('frame_id', str(states['frame'][i])), ('act', str(states['act'][i]))
            wrong = wrong[1:] or [(name, '', text, '') for name, text in texts if text]
        time = float(times[i])
        found.append(
            max(
                (Difference(time, stamp_ns, topic, *entry, findings.after) for entry in wrong),
                key=lambda difference: difference.ulps,
            )
        )
    for difference in found[:-1]:
        findings.differ(difference)
    findings.differ(found[-1], alike=len(rows) - len(found))
    values = (bits(states['numbers'][rows]) != bits(numbers[rows])).any(axis=1)
    rows = rows[values]
    off = states['numbers'][rows] - numbers[rows]
    findings.divergence.take(times[rows], off[:, 0], off[:, 1])
