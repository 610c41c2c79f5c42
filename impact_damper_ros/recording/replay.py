"""
Replaying a run from its log: every recorded sample and impact is computed anew and compared.

The rig is restored from the first snapshot, and what was done to it is done again at the same
instants. The simulator's motion does not depend on how it is cut into pieces, so that everything
must come out as recorded, to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from impact_damper_ros.control import ControlRecord
from impact_damper_ros.rig import Event, EventKind, Sample
from impact_damper_ros.rig.snapshot import ARITHMETIC

from .cdr import CdrError
from .errors import RecordingError
from .impact_ledger import ControlLedger, ImpactLedger
from .replay_findings import Difference, Findings, SampleGap
from .replayed_rig import Batch, ReplayedRig, Step
from .run_history import Change, RunHistory, Snapshot, StateRecord
from .sample_check import SampleCheck, SampleSpacing

__all__ = ['Replay', 'Tick']

#: A stretch without samples longer than this is taken for a wrong stamp.
_LONGEST_GAP_NS = 6 * 3600 * 10**9
_REMEDY = 'replay the bag with the version of impact_damper_ros that recorded it'


class Tick(NamedTuple):
    """
    A recorded sample, and what happened since the one before.

    Attributes
    ----------
    time_ns : int
        Its rig time.
    x, primary_velocity : float
        As recorded, m and m/s.
    sample : Sample
        As replayed.
    events : list of Event
        Of the replay, since the sample before.
    steps : list of (int, Step)
        What was done to the rig since the last sample, with its rig time.
    """

    time_ns: int
    x: float
    primary_velocity: float
    sample: Sample
    events: list[Event]
    steps: list[tuple[int, Step]]


class Replay:
    """
    The replay of a run; iterate over `ticks` to carry it out.

    Parameters
    ----------
    history : RunHistory
        The run.

    Attributes
    ----------
    history : RunHistory
        As given.
    findings : Findings
        What was found, so far.
    replayed : ReplayedRig
        The rig, where it now stands.

    Raises
    ------
    RecordingError
        If the first snapshot cannot be restored.
    """

    def __init__(self, history: RunHistory) -> None:
        self.history = history
        self.findings = Findings(offset_ns=history.start.offset_ns)
        try:
            self.replayed = ReplayedRig(history.start)
        except ValueError as error:
            cause = f'its first snapshot cannot be restored: {error}'
            raise RecordingError('replay', history.reader.path, cause, _REMEDY) from error
        if history.start.arithmetic != ARITHMETIC:
            self.findings.remarks.append(
                f'recorded with arithmetic {history.start.arithmetic}, this version has '
                f'{ARITHMETIC}: differences of round-off, and what grows from them, are due to '
                f'that; {_REMEDY}'
            )
        self._time_ns = history.start.time_ns
        self._pending: list[Change] = []
        self._steps: list[tuple[int, Step]] = []
        self._events: list[Event] = []
        self._before: list[Sample] = []
        self._left_out = 0
        topics = history.topics
        self._check = SampleCheck(topics.joint_states, self.findings)
        self._spacing = SampleSpacing(self.findings)
        stamped = history.stamped
        self._ledger = ImpactLedger(topics.impacts, self.findings, stamped=stamped)
        self._control = ControlLedger(topics.gap_control, self.findings, stamped=stamped)
        self._ledgers = {topics.impacts: self._ledger, topics.gap_control: self._control}

    def ticks(self) -> Iterator[Tick]:
        """Replay, sample by sample; those that cannot be read are told in the findings."""
        for item in self.history.items():
            if isinstance(item, StateRecord):
                try:
                    if (ledger := self._ledgers.get(item.topic)) is not None:
                        ledger.take(item.content)
                    elif self._reach(item.stamp_ns):
                        yield self._look(item)
                except CdrError as error:
                    self._note_unreadable(item, error)
            elif isinstance(item, Change):
                self._take_change(item)
            else:
                self._take_snapshot(item)
        self._finish()

    # Samples and impacts

    def _reach(self, stamp_ns: int) -> bool:
        """Go on to the stamp of a sample; false if that cannot be."""
        time_ns = stamp_ns - self.findings.offset_ns
        self._flush(time_ns)
        ahead_ns = time_ns - self._time_ns
        if ahead_ns < 0 or (ahead_ns > _LONGEST_GAP_NS and self.findings.end_ns is not None):
            self._left_out += 1
            return False
        self._time_ns = time_ns
        return True

    def _look(self, record: StateRecord) -> Tick:
        """Compare a sample."""
        stamp_ns, content, time_ns = record.stamp_ns, record.content, self._time_ns
        positions, velocities, *_ = self._check.numbers(content)
        if self.findings.end_ns is None:
            for ledger in self._ledgers.values():
                ledger.begin(stamp_ns)
        self._excuse(self._spacing.look(time_ns, stamp_ns))
        self._advance()
        sample = self.replayed.rig.sample()
        if self._before and self._before[0].time != sample.time:
            self._before = []
        self._check.compare(stamp_ns, content, sample, self._before)
        for ledger in self._ledgers.values():
            ledger.settle()
        events, self._events = self._events, []
        steps, self._steps = self._steps, []
        return Tick(time_ns, positions[0], velocities[0], sample, events, steps)

    def _advance(self) -> None:
        # Once to each instant, as the node does: a change may leave an event due at once, which
        # the rig would take at a second time.
        rig, time = self.replayed.rig, self._time_ns / 1e9
        if time > rig.time:
            self._take_events(rig.advance(time), rig.records)

    def _excuse(self, gaps: list[SampleGap]) -> None:
        for gap in gaps:
            for ledger in self._ledgers.values():
                ledger.excuse(gap)

    def _take_events(
        self, events: list[Event], records: list[ControlRecord], offset_ns: int | None = None
    ) -> None:
        """Take what happened; their stamps may have another offset than the present one."""
        # A latched snapshot may be hours older than the recording.
        if self.history.stamped or self.findings.end_ns is not None:
            self._events += events
        topics = self.history.topics
        if offset_ns is None:
            offset_ns = self.findings.offset_ns
        for event in events if topics.impacts else ():
            if event.kind is EventKind.IMPACT:
                self._ledger.expect(offset_ns + round(event.time * 1e9), event)
        for record in records if topics.gap_control else ():
            self._control.expect_record(offset_ns + round(record.time * 1e9), record)

    def _note_unreadable(self, record: StateRecord, error: CdrError) -> None:
        topics = self.history.topics
        topic = record.topic
        if not self.findings.samples and topic == topics.joint_states:
            cause = f'the first message of {topic} is not of a rig: {error}'
            raise RecordingError('replay', self.history.reader.path, cause)
        self._differ(record.stamp_ns, topic, 'message', str(error), 'a readable one')

    # What was done to the rig

    def _take_change(self, change: Change) -> None:
        rate = change.values.get('state_rate')
        if isinstance(rate, float) and rate > 0.0:
            self._spacing.period_ns = 1e9 / rate
        if change.dump:
            self.replayed.take_dump(change.values)
            return
        self._pending.append(change)

    def _flush(self, time_ns: int, resumed_ns: int | None = None) -> None:
        """
        Carry out changes of earlier instants than `time_ns`, which no snapshot followed.

        A change made just after a resumption is stamped with its new offset, `resumed_ns`.
        """
        while self._pending:
            stamp_ns, _, exact, _ = self._pending[0]
            at_ns = stamp_ns - self.findings.offset_ns
            resumed = resumed_ns is not None and stamp_ns - resumed_ns == time_ns
            if not exact or at_ns >= time_ns or resumed:
                return
            batch = [c for c in self._pending if c.exact and c.stamp_ns == stamp_ns]
            later = [c for c in self._pending if not (c.exact and c.stamp_ns == stamp_ns)]
            self._time_ns = max(self._time_ns, at_ns)
            self._carry_out(batch, None)
            self._pending = later

    def _take_snapshot(self, snapshot: Snapshot) -> None:
        findings = self.findings
        self._flush(snapshot.time_ns, snapshot.offset_ns)
        if snapshot.time_ns < self._time_ns:
            topic, disorder = self.history.topics.snapshot, self.history.disorder
            disorder.note(disorder.late, topic, snapshot.stamp_ns)
            return
        findings.snapshots += 1
        self._time_ns = snapshot.time_ns
        self._carry_out(self._pending, snapshot)
        if snapshot.reason == 'slip':
            findings.slips += 1
        elif snapshot.offset_ns != findings.offset_ns or snapshot.reason == 'resume':
            findings.pauses += 1
        findings.offset_ns = snapshot.offset_ns

    def _carry_out(self, changes: list[Change], snapshot: Snapshot | None) -> None:
        """Do what was done to the rig at one instant."""
        self._advance()
        if not self.history.stamped:
            # A sample of this instant may come from before the change, or from after it.
            now = self.replayed.rig.sample()
            self._before = [*(s for s in self._before if s.time == now.time), now]
        known = self.replayed.initial is not None
        self._pending = []
        try:
            batch = self.replayed.carry_out(changes, snapshot)
        except (ValueError, TypeError, KeyError) as error:
            self.findings.fault(
                f'what changed at rig time {self._time_ns * 1e-9:.9g} s cannot be done to the '
                f'rig: {error}'
            )
            return
        if snapshot is not None:
            self._pending = list(changes[batch.used :])
        if batch.steps:
            self.findings.after = self._described(batch, changes)
        self._steps += [(self._time_ns, step) for step in batch.steps]
        self.findings.resets += batch.resets
        self.findings.changes += len(batch.steps) - batch.resets
        for change, events, records in batch.effects:
            # It may have come just after a resumption, and be stamped with its new offset.
            offset_ns = None
            if change is not None and change.exact:
                offset_ns = change.stamp_ns - self._time_ns
            self._take_events(events, records, offset_ns)
        if snapshot is not None:
            self._judge(batch, snapshot, known)

    def _described(self, batch: Batch, changes: list[Change]) -> str:
        values = [pair for change in changes[: batch.used] for pair in change.values.items()]
        parts = [f'{name} = {value!r}' for name, value in [*values, *batch.unlogged.items()]]
        parts += ['reset'] * batch.resets
        return f'{", ".join(parts) or "a change"} at {self._time_ns * 1e-9:.9g} s'

    def _judge(self, batch: Batch, snapshot: Snapshot, known: bool) -> None:
        topics = self.history.topics
        if topics.parameter_events and self.history.stamped:
            for name, value in batch.unlogged.items():
                self._differ(snapshot.stamp_ns, topics.parameter_events, name, None, value)
        if batch.adopted and not known:
            self.findings.remark(
                f'the initial conditions of the reset at {self._time_ns * 1e-9:.9g} s were taken '
                'from its snapshot: no parameter event tells them'
            )
            return
        if not batch.agrees and not self.history.stamped and not self.findings.difference_count:
            self.replayed.adopt(snapshot)
            self.findings.fault(
                f'what was done at rig time {self._time_ns * 1e-9:.9g} s cannot be retraced: not '
                'all of its parameter events were recorded; its snapshot was taken over'
            )
            return
        for name, recorded, replayed in batch.differences[:1]:
            self._differ(snapshot.stamp_ns, topics.snapshot, name, recorded, replayed)

    def _differ(
        self, stamp_ns: int, topic: str, quantity: str, recorded: object, replayed: object
    ) -> None:
        time, after = self._time_ns / 1e9, self.findings.after
        self.findings.differ(
            Difference(time, stamp_ns, topic, quantity, '', recorded, replayed, after)
        )

    # The end

    def _finish(self) -> None:
        """Compare what came after the last sample, and say what is wrong with the bag."""
        findings, history = self.findings, self.history
        self._excuse(self._spacing.close())
        end_ns = findings.offset_ns + self._time_ns
        for ledger in self._ledgers.values():
            if end_ns < ledger.last_ns <= end_ns + _LONGEST_GAP_NS:
                # A cut bag may end with the impacts of a tick whose sample is lost.
                self._time_ns = max(self._time_ns, ledger.last_ns - findings.offset_ns + 1)
        self._advance()
        for ledger in self._ledgers.values():
            # Of a tick that is cut off, each topic may have come to another end.
            ledger.drop_after(max(ledger.last_ns, end_ns))
            ledger.settle(final=True)
        if self._left_out:
            findings.fault(f'joint states left out because of impossible stamps: {self._left_out}')
        for fault in history.faults():
            findings.fault(fault)
        if history.early:
            findings.remark(f'messages from before the first snapshot, left out: {history.early}')
