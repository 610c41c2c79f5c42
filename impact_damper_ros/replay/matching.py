"""
Recorded against replayed messages, as arrays.

The messages of a topic are compared row by row, to the last bit. Where their numbers differ, the
longest rows of equal messages show which are missing on one side, and which were altered.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from difflib import SequenceMatcher
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.control import CONTROL_JOINTS

from .findings import Difference, Findings, SampleGap
from .rows import Numbers, Table
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
        self._last: tuple[Any, ...] = ()
        self._findings, self._stamped = findings, stamped
        self._key = key
        impacts = key == 'impacts'
        joints = IMPACT_JOINTS if impacts else (*CONTROL_JOINTS, 'the act')
        self.fields = [('stamp', 'ns'), ('frame_id', ''), ('act', '')]
        self.fields += _names(joints, 'N s' if impacts else 'J')
        self._what = 'impact' if key == 'impacts' else 'act of the gap control'
        self._recorded: list[Table] = []
        self._expected: list[Table] = []
        self._gaps: deque[SampleGap] = deque(maxlen=_REMEMBERED_GAPS)
        #: Stamps of the first and of the last recorded message
        self.first_ns: int | None = None
        self.last_ns = 0
        #: Messages of the replay from before the first one that the recorder received
        self.before_recorder = 0

    def take(self, recorded: Table) -> None:
        """Take recorded messages."""
        if recorded.size:
            self._recorded.append(recorded)
            self.last_ns = int(recorded.stamp_ns[-1])
            if self.first_ns is None:
                self.first_ns = int(recorded.stamp_ns[0])
            self._count('recorded_{}', recorded.size)

    def expect(self, replayed: Table) -> None:
        """Take messages of the replay."""
        if replayed.size and self.topic:
            self._expected.append(replayed)

    def forget(self, before_ns: float) -> None:
        """Forget the messages of the replay from before a stamp."""
        self._taken(self._expected, before_ns)

    def excuse(self, gap: SampleGap) -> None:
        """Take note of a gap in which messages are missing."""
        self._gaps.append(gap)

    def _count(self, name: str, count: int) -> None:
        key = 'impacts' if self._key == 'impacts' else 'control'
        name = name.format(key)
        setattr(self._findings, name, getattr(self._findings, name) + count)

    def _taken(self, tables: list[Table], before_ns: float) -> Table | None:
        """Take the messages up to the first that is not before a stamp."""
        if not tables:
            return None
        table = Table.joined(tables)
        late = np.flatnonzero(table.stamp_ns >= before_ns)
        cut = int(late[0]) if len(late) else table.size
        tables[:] = [table[cut:]] if cut < table.size else []
        return table[:cut] if cut else None

    def settle(self, before_ns: float) -> None:
        """Compare what is from before a stamp."""
        recorded = self._taken(self._recorded, before_ns)
        expected = self._taken(self._expected, before_ns)
        if recorded is None and expected is None:
            return
        if recorded is not None and expected is not None and self._same(recorded, expected):
            self._count('{}', recorded.size)
            self._last = _rows(recorded[-1:])[0]
            return
        there, here = ([] if t is None else _rows(t) for t in (recorded, expected))
        matcher = SequenceMatcher(None, there, here, autojunk=False)
        for kind, a, b, c, d in matcher.get_opcodes():
            both = min(b - a, d - c)
            self._count('{}', both)
            for i in range(both if kind == 'replace' else 0):
                self._altered(there[a + i], here[c + i])
            for row in here[c + both : d]:
                self._missing(row)
            for i in range(a + both, b):
                row = there[i]
                if row in ((there[i - 1] if i else self._last), *there[i + 1 : i + 2]):
                    # Copied, as where recordings that overlap are joined
                    self._disorder.note(TWICE, self.topic, [row[0]])
                else:
                    self.differ(row[0], self._what, '', row[1] or row[2], None)
        self._last = there[-1] if there else self._last

    @staticmethod
    def _same(recorded: Table, expected: Table) -> bool:
        return (
            recorded.size == expected.size
            and np.array_equal(recorded.stamp_ns, expected.stamp_ns)
            and np.array_equal(recorded.frame, expected.frame)
            and np.array_equal(recorded.act, expected.act)
            and np.array_equal(bits(recorded.numbers), bits(expected.numbers))
        )

    def _altered(self, there: tuple[Any, ...], here: tuple[Any, ...]) -> None:
        """Note the first quantity in which two messages differ."""
        pairs = zip(self.fields, _values(there), _values(here), strict=True)
        for (name, unit), recorded, replayed in pairs:
            if recorded != replayed or str(recorded) != str(replayed):
                self.differ(here[0], name, unit, recorded, replayed)
                return

    def _missing(self, row: tuple[Any, ...]) -> None:
        if self.first_ns is None or (not self._stamped and row[0] < self.first_ns):
            self.before_recorder += 1
        elif not self._stamped or any(g.from_ns <= row[0] <= g.to_ns for g in self._gaps):
            self._count('missing_{}', 1)
        else:
            self.differ(row[0], self._what, '', None, row[1] or row[2])

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


def _rows(table: Table) -> list[tuple[Any, ...]]:
    """Return stamp, frame, act and numbers, as bytes, of each message."""
    columns = [column.tolist() for column in (table.stamp_ns, table.frame, table.act)]
    numbers = [row.tobytes() for row in np.ascontiguousarray(table.numbers)]
    return [*zip(*columns, numbers, strict=True)]


def _values(row: tuple[Any, ...]) -> Iterator[Any]:
    yield from row[:-1]
    yield from np.frombuffer(row[-1]).tolist()


def differing_states(states: Table, numbers: Numbers, *, stamped: bool) -> NDArray[np.bool_]:
    """Return which joint states are not those of the replay, given its numbers."""
    differs: NDArray[np.bool_] = (bits(states.numbers) != bits(numbers)).any(axis=1)
    differs |= (states.frame != '') | (states.act != '')
    if stamped:
        differs |= states.stamp_ns != states.log_ns
    return differs


def note_states(
    findings: Findings,
    topic: str,
    states: Table,
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
        here, there = numbers[i].tolist(), states.numbers[i].tolist()
        wrong: list[tuple[str, str, Any, Any]] = [
            ('stamp', 'ns', int(states.stamp_ns[i]), int(states.log_ns[i]))
        ]
        wrong += [
            (*name, a, b)
            for name, a, b in zip(_STATES, there, here, strict=False)
            if repr(a) != repr(b)
        ]
        if states.stamp_ns[i] == states.log_ns[i] or not stamped:
            texts = ('frame_id', str(states.frame[i])), ('act', str(states.act[i]))
            wrong = wrong[1:] or [(name, '', text, '') for name, text in texts if text]
        stamp_ns, time = int(states.log_ns[i]), float(times[i])
        found.append(
            max(
                (Difference(time, stamp_ns, topic, *entry, findings.after) for entry in wrong),
                key=lambda difference: difference.ulps,
            )
        )
    for difference in found[:-1]:
        findings.differ(difference)
    findings.differ(found[-1], alike=len(rows) - len(found))
    values = (bits(states.numbers[rows]) != bits(numbers[rows])).any(axis=1)
    rows = rows[values]
    off = states.numbers[rows] - numbers[rows]
    findings.divergence.take(times[rows], off[:, 0], off[:, 1])
