"""
The replay of a run from its log: every recorded sample and impact is computed again and compared.

The rig is restored from the first snapshot, and all changes and resets are repeated at the same
instants. The motion does not depend on how it is divided, so that every message must be
as recorded, to the last bit.

Where nothing is done to the rig, many messages are replayed at once. This only shows whether all
of them are reproduced; if not, they are replayed one by one to find the differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordedMessage, RecordingError
from impact_damper_ros.bag.messages import CdrError, JointStateColumns
from impact_damper_ros.bag.rig_topics import (
    IMPACT_JOINTS,
    JOINTS,
    impact_numbers,
    state_numbers,
)
from impact_damper_ros.control import ControlRecord, Outcome, Rig
from impact_damper_ros.rig import Event, EventKind, RigParameters, RunawayError, Sample
from impact_damper_ros.rig.compiled import has_numba
from impact_damper_ros.rig.event import events_of_table
from impact_damper_ros.rig.event_budget import MOST_EVENTS, EventBudget
from impact_damper_ros.rig.snapshot import ARITHMETIC

from .checks import ControlMatcher, ImpactMatcher, SampleCheck, SampleSpacing
from .findings import Difference, Findings, SampleGap
from .recorded_run import RecordedChange, RecordedRun
from .recorded_snapshot import RecordedSnapshot
from .replayed_rig import Batch, ReplayedRig, Step

_Ints = NDArray[np.int64]


class BatchReplay:
    """Replays batches of messages."""

    def __init__(self, *, compiled: bool) -> None:
        self._compiled = compiled
        self._states = JointStateColumns((JOINTS,), (len(JOINTS), len(JOINTS), 0))
        self._impacts = JointStateColumns((IMPACT_JOINTS,), (2, 2, 2))

    def reproduces(
        self,
        rig: Rig,
        offset_ns: int,
        states: Sequence[RecordedMessage],
        impacts: Sequence[RecordedMessage] | None,
    ) -> bool:
        """Let a rig run on; return whether it reproduces messages to the last bit, or go back."""
        stamps_ns = np.array([record.stamp_ns for record in states], dtype=np.int64)
        instants = (stamps_ns - offset_ns) / 1e9
        if not (np.diff(stamps_ns) > 0).all() or instants[0] <= rig.time:
            return False
        before = rig.mark()
        rig.compiled = self._compiled
        most = max(MOST_EVENTS, 10 * (len(states) + len(impacts or ())))
        stretch = rig.run(float(instants[-1]), instants, most_events=most)
        rest, angle = rig.parameters.static_deflection, rig.parameters.angle
        same = stretch.outcome is Outcome.COMPLETE
        if same:
            columns: list[Any] = [stretch.samples[name] for name in Sample._fields]
            parts = state_numbers(Sample(*columns), rest, angle)
            numbers = np.column_stack(np.broadcast_arrays(*(c for part in parts for c in part)))
            same = _all_equal(self._states, states, ('',), stamps_ns, numbers)
        if same and impacts is not None:
            events = events_of_table(stretch.impacts())
            same = self._same_impacts(events, impacts, offset_ns, rest)
        if not same:
            rig.go_back(before)
        return same

    def _same_impacts(
        self,
        events: Sequence[Event],
        impacts: Sequence[RecordedMessage],
        offset_ns: int,
        rest: float,
    ) -> bool:
        """Return whether the impacts are those recorded."""
        if len(events) != len(impacts):
            return False
        if not events:
            return True
        stamps_ns = np.array([offset_ns + round(e.time * 1e9) for e in events], dtype=np.int64)
        if stamps_ns.tolist() != [record.stamp_ns for record in impacts]:
            return False
        numbers = np.array([sum(impact_numbers(event, rest), ()) for event in events])
        frames = tuple(f'stop_{event.stop}' for event in events)
        return _all_equal(self._impacts, impacts, frames, stamps_ns, numbers)


def _all_equal(
    columns: JointStateColumns,
    recorded: Sequence[RecordedMessage],
    frames: Sequence[str],
    stamps_ns: _Ints,
    numbers: NDArray[np.float64],
) -> bool:
    """Return whether messages hold these stamps, numbers and frames (one for all, or each)."""
    table = columns.read([record.content for record in recorded])
    if table.unreadable or not np.array_equal(table.stamps_ns, stamps_ns):
        return False
    found = [columns.frames[number] for number in table.frames]
    if found != list(frames) * (len(found) // len(frames)):
        return False
    # As integers, in which 0.0 and -0.0 differ
    return np.array_equal(table.numbers.view(np.int64), numbers.view(np.int64))


#: A longer time without samples, and without so many of them, counts as a wrong stamp.
_LONGEST_GAP_NS, _MOST_MISSING = 6 * 3600 * 10**9, 10
#: The same after the snapshot that a recorder gets when it joins.
_LONGEST_WAIT_NS = 10 * 86_400 * 10**9
#: Joint states that are checked against `state_rate`, and their tolerance, ns.
_LOOKED_AT, _OFF_GRID_NS = 100, 2
#: Fewer messages than that are replayed one by one.
_LEAST_BATCH = 64
#: Joint states from which on compiled code is worth its loading time.
_COMPILED_FROM = 100_000
_REMEDY = 'replay the bag with the version of impact_damper_ros that recorded it'


class Tick(NamedTuple):
    """
    A recorded sample, with the events since the one before.

    Attributes
    ----------
    time_ns : int
        Its rig time.
    x, primary_velocity : float
        X and X' as recorded, m and m/s.
    sample : Sample
        As replayed.
    events : list of Event
        Of the replay, since the sample before.
    steps : list of (int, Step)
        Changes and resets since the last sample, each with its rig time.
    begun : float
        Rig time, s, of the first recorded message. The motion before only leads there from the
        snapshot that a recorder gets when it joins.
    """

    time_ns: int
    x: float
    primary_velocity: float
    sample: Sample
    events: list[Event]
    steps: list[tuple[int, Step]]
    begun: float = -inf


class Replay:
    """
    The replay of a run; iterate over `ticks` to carry it out.

    Parameters
    ----------
    recorded : RecordedRun
        The run.
    adopt : bool, optional
        Whether to go on from each snapshot that differs from the replay, so that a difference
        ends at the next change.

    Attributes
    ----------
    recorded : RecordedRun
        As given.
    findings : Findings
        The findings so far.
    replayed : ReplayedRig
        The rig at the present instant.

    Raises
    ------
    RecordingError
        If the first snapshot cannot be restored.
    """

    def __init__(self, recorded: RecordedRun, *, adopt: bool = False) -> None:
        self.recorded = recorded
        self._adopts = adopt
        # Whether the parameter events of this node are recorded
        self._has_events = False
        self.findings = Findings(offset_ns=recorded.start.offset_ns)
        try:
            self.replayed = ReplayedRig(recorded.start)
        except ValueError as error:
            cause = f'its first snapshot cannot be restored: {error}'
            raise RecordingError('replay', recorded.reader.path, cause, _REMEDY) from error
        if recorded.start.arithmetic != ARITHMETIC:
            self.findings.remarks.append(
                f'recorded with arithmetic {recorded.start.arithmetic}, this version has '
                f'{ARITHMETIC}: differences of round-off, and what grows from them, are due to '
                f'that; {_REMEDY}'
            )
        self._time_ns = recorded.start.time_ns
        self._pending: list[RecordedChange] = []
        self._steps: list[tuple[int, Step]] = []
        self._events: list[Event] = []
        # Joint states of an instant before each of its changes, with the instant
        self._before: list[tuple[float, tuple[tuple[float, ...], ...]]] = []
        self._left_out = 0
        self._begun = -inf
        # Joint states per second as listed, and how many are known to lie on that grid
        self._rate, self._on_grid = 0.0, 0
        topics = recorded.topics
        count = recorded.reader.topics[topics.joint_states].message_count
        self._batches = BatchReplay(compiled=count >= _COMPILED_FROM and has_numba())
        self._check = SampleCheck(topics.joint_states, self.findings)
        # A rig that does not move as recorded may have impacts without end.
        recorded_count = sum(topic.message_count for topic in recorded.reader.topics.values())
        self._budget = EventBudget(2 * (MOST_EVENTS + recorded_count))
        self._spacing = SampleSpacing(self.findings)
        stamped, disorder = recorded.stamped, recorded.disorder
        self._impacts = ImpactMatcher(topics.impacts, self.findings, disorder, stamped=stamped)
        self._control = ControlMatcher(
            topics.gap_control, self.findings, disorder, stamped=stamped
        )
        self._matchers = {topics.impacts: self._impacts, topics.gap_control: self._control}
        self._check_stops(recorded.start)

    def ticks(self) -> Iterator[Tick]:
        """Replay, sample by sample; the findings name those that cannot be read."""
        for item in self.recorded.walk():
            if isinstance(item, list):
                for record in item:
                    tick = self._take(record)
                    if tick is not None:
                        yield tick
            else:
                self._act(item)
        self._finish()

    def run(self, progress: Callable[[float], object] = float) -> Findings:
        """
        Replay as `ticks` does, but many samples at once where possible.

        Parameters
        ----------
        progress : callable, optional
            Called now and then with the rig time reached, s.

        Returns
        -------
        Findings
            The findings.
        """
        for item in self.recorded.walk():
            if isinstance(item, list):
                self._take_many(item)
            else:
                self._act(item)
            progress(self._time_ns / 1e9)
        self._finish()
        return self.findings

    def _take(self, record: RecordedMessage) -> Tick | None:
        try:
            if (matcher := self._matchers.get(record.topic)) is not None:
                matcher.take(record.content)
            elif self._reach(record.stamp_ns):
                return self._look(record)
        except CdrError as error:
            self._note_unreadable(record, error)
        return None

    def _act(self, item: RecordedChange | RecordedSnapshot) -> None:
        if isinstance(item, RecordedChange):
            self._take_change(item)
        else:
            self._take_snapshot(item)

    def _take_many(self, records: list[RecordedMessage]) -> None:
        """Take messages of the rig, all at once if they are reproduced bit for bit."""
        topic, place = self.recorded.topics.joint_states, 0
        # One by one where something is to be decided first
        while place < len(records) and (
            self.findings.end_ns is None
            or (self._rate and self.recorded.stamped and self._on_grid < _LOOKED_AT)
            or self._steps
            or not self._impacts.even
            or records[place].stamp_ns - self.findings.offset_ns <= self._time_ns
        ):
            self._take(records[place])
            place += 1
        states = (i + 1 for i in range(place, len(records)) if records[i].topic == topic)
        end = max(states, default=0)
        if end - place >= _LEAST_BATCH and self._all_as_replayed(records[place:end]):
            place = end
        for record in records[place:]:
            self._take(record)

    def _all_as_replayed(self, records: list[RecordedMessage]) -> bool:
        findings, topics = self.findings, self.recorded.topics
        rig = self.replayed.rig
        if rig.acts or self._pending:
            return False
        parts = {
            name: [record for record in records if record.topic == name]
            for name in (topics.joint_states, topics.impacts)
        }
        if sum(map(len, parts.values())) < len(records):
            return False
        states, impacts = parts[topics.joint_states], parts[topics.impacts]
        offset_ns = findings.offset_ns
        times_ns = [record.stamp_ns - offset_ns for record in states]
        if not self._spacing.even(times_ns):
            return False
        hits = impacts if topics.impacts else None
        if not self._batches.reproduces(rig, offset_ns, states, hits):
            return False
        self._time_ns = findings.end_ns = times_ns[-1]
        self._before = []
        findings.samples += len(times_ns)
        self._impacts.paired([record.content for record in impacts])
        return True

    def _check_stops(self, snapshot: RecordedSnapshot) -> None:
        """Note a snapshot in which the stops that no control moves are not at the gap."""
        control = snapshot.state['gap_control']
        if control['parameters']['gap_control'] != 'off' or control['state']['returning']:
            return
        half = 0.5 * snapshot.state['parameters']['gap']
        origin = snapshot.state['origin']
        for name, recorded, expected in (
            ('target_1', origin['target_1'], half),
            ('target_2', origin['target_2'], -half),
        ):
            if recorded != expected and not snapshot.state['parameters']['one_sided']:
                topic = self.recorded.topics.snapshot
                self._differ(snapshot.stamp_ns, topic, f'origin.{name}', recorded, expected)

    # Samples and impacts

    def _reach(self, stamp_ns: int) -> bool:
        """Go on to the stamp of a sample; false if the stamp is impossible."""
        time_ns = stamp_ns - self.findings.offset_ns
        self._flush(time_ns)
        ahead_ns = time_ns - self._time_ns
        first = self.findings.end_ns is None and not self.recorded.stamped
        if not 0 <= ahead_ns <= (_LONGEST_WAIT_NS if first else self._longest_gap_ns):
            self._left_out += 1
            return False
        self._time_ns = time_ns
        return True

    @property
    def _longest_gap_ns(self) -> float:
        return max(_LONGEST_GAP_NS, _MOST_MISSING * self._spacing.period_ns)

    def _look(self, record: RecordedMessage) -> Tick:
        """Compare a sample."""
        stamp_ns, content, time_ns = record.stamp_ns, record.content, self._time_ns
        positions, velocities, *_ = self._check.numbers(content)
        self._check_rate(record.stamp_ns)
        self._advance()
        if self.findings.end_ns is None:
            # A recorder that joins late gets the latched snapshot, and no message from between it
            # and the first sample.
            first_ns = min(matcher.begin(stamp_ns) for matcher in self._matchers.values())
            if not self.recorded.stamped:
                self._begun = (first_ns - self.findings.offset_ns) / 1e9
                self._events = [e for e in self._events if e.time >= self._begun]
        self._excuse(self._spacing.take(time_ns, stamp_ns))
        sample, numbers = self._sampled()
        self._before = [before for before in self._before if before[0] == sample.time]
        others = [before[1] for before in self._before]
        self._check.compare(stamp_ns, content, sample.time, numbers, others)
        for matcher in self._matchers.values():
            matcher.settle()
        events, self._events = self._events, []
        steps, self._steps = self._steps, []
        x = sample.x + (positions[0] - numbers[0][0])
        return Tick(time_ns, x, velocities[0], sample, events, steps, self._begun)

    def _check_rate(self, stamp_ns: int) -> None:
        """Check the first joint states against the rate among the parameters."""
        if not self._rate or not self.recorded.stamped or self._on_grid >= _LOOKED_AT:
            return
        self._on_grid += 1
        tick = round(self._time_ns * self._rate / 1e9)
        # Stamps are whole nanoseconds.
        wrong = self._rate > 1e9
        if wrong or abs(round(tick * 1e9 / self._rate) - self._time_ns) > _OFF_GRID_NS:
            topic = self.recorded.topics.parameter_events
            self._differ(stamp_ns, topic, 'state_rate', self._rate, None)
            self._on_grid = _LOOKED_AT

    def _sampled(self) -> tuple[Sample, tuple[tuple[float, ...], ...]]:
        """Return the present motion, and the numbers of its joint states as published."""
        sample, parameters = self.replayed.rig.sample(), self.replayed.rig.parameters
        deflection, angle = parameters.static_deflection, parameters.angle
        return sample, state_numbers(sample, deflection, angle)

    def _advance(self) -> None:
        # Once to each instant, as the node does: an event that a change leaves due at once would
        # happen at a second call.
        rig, time = self.replayed.rig, self._time_ns / 1e9
        if time > rig.time:
            try:
                for events in self._budget.portions(rig, time):
                    self._take_events(events, rig.records, rig.parameters)
            except (ArithmeticError, LookupError, RunawayError, TypeError, ValueError) as error:
                cause = f'the rig cannot be run on to rig time {time:.9g} s: {error}'
                path = self.recorded.reader.path
                raise RecordingError('replay', path, cause, _REMEDY) from error

    def _excuse(self, gaps: list[SampleGap]) -> None:
        for gap in gaps:
            for matcher in self._matchers.values():
                matcher.excuse(gap)

    def _take_events(
        self,
        events: list[Event],
        records: list[ControlRecord],
        parameters: RigParameters,
        offset_ns: int | None = None,
    ) -> None:
        """Take events and acts of the rig, whose stamps may have another offset."""
        self._events += events
        topics = self.recorded.topics
        if offset_ns is None:
            offset_ns = self.findings.offset_ns
        for event in events if topics.impacts else ():
            if event.kind is EventKind.IMPACT:
                stamp_ns = offset_ns + round(event.time * 1e9)
                numbers = impact_numbers(event, parameters.static_deflection)
                self._impacts.expect(stamp_ns, event.time, event.stop, numbers)
        for record in records if topics.gap_control else ():
            self._control.expect_record(offset_ns + round(record.time * 1e9), record)

    def _note_unreadable(self, record: RecordedMessage, error: CdrError) -> None:
        topics = self.recorded.topics
        topic = record.topic
        if not self.findings.samples and topic == topics.joint_states:
            cause = f'the first message of {topic} is not of a rig: {error}'
            raise RecordingError('replay', self.recorded.reader.path, cause)
        self._differ(record.stamp_ns, topic, 'message', str(error), 'a readable one')

    # Changes and resets

    def _take_change(self, change: RecordedChange) -> None:
        self._has_events = True
        rate = change.values.get('state_rate')
        if isinstance(rate, float) and rate > 0.0:
            self._spacing.period_ns = 1e9 / rate
            self._rate, self._on_grid = rate, 0
        if change.dump:
            found = self.replayed.take_dump(change.values)
            if change.values.get('record') is False:
                found.append(('record', False, True))
            self._contradict(change.stamp_ns, found)
            return
        self._pending.append(change)

    def _flush(self, time_ns: int, resumed_ns: int | None = None) -> None:
        """
        Carry out the changes before `time_ns`, which no snapshot followed.

        A change just after a resumption is stamped with the new offset, `resumed_ns`.
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

    def _take_snapshot(self, snapshot: RecordedSnapshot) -> None:
        findings = self.findings
        self._flush(snapshot.time_ns, snapshot.offset_ns)
        if snapshot.time_ns < self._time_ns:
            topic, disorder = self.recorded.topics.snapshot, self.recorded.disorder
            disorder.note(disorder.late, topic, snapshot.stamp_ns)
            return
        findings.snapshots += 1
        self._time_ns = snapshot.time_ns
        start = self.recorded.start
        if snapshot.arithmetic != start.arithmetic:
            topic = self.recorded.topics.snapshot
            self._differ(
                snapshot.stamp_ns, topic, 'arithmetic', snapshot.arithmetic, start.arithmetic
            )
        self._carry_out(self._pending, snapshot)
        if snapshot.reason == 'slip':
            findings.slips += 1
        elif snapshot.offset_ns != findings.offset_ns or snapshot.reason == 'resume':
            findings.pauses += 1
        findings.offset_ns = snapshot.offset_ns

    def _carry_out(self, changes: list[RecordedChange], snapshot: RecordedSnapshot | None) -> None:
        """Repeat the changes and resets of one instant."""
        self._advance()
        if not self.recorded.stamped:
            # A sample of this instant may come from before the change, or from after it.
            now, numbers = self._sampled()
            before = [entry for entry in self._before if entry[0] == now.time]
            self._before = [*before, (now.time, numbers)]
        known = self.replayed.initial is not None
        self._pending = []
        try:
            batch = self.replayed.carry_out(changes, snapshot)
        except (ValueError, TypeError, KeyError) as error:
            self.findings.fault(
                f'the change at rig time {self._time_ns * 1e-9:.9g} s cannot be applied to the '
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
        for change, events, records, parameters in batch.effects:
            # A change just after a resumption is stamped with the new offset.
            offset_ns = None
            if change is not None and change.exact:
                offset_ns = change.stamp_ns - self._time_ns
            self._take_events(events, records, parameters, offset_ns)
        if snapshot is not None:
            self._judge(batch, snapshot, known)

    def _described(self, batch: Batch, changes: list[RecordedChange]) -> str:
        values = [pair for change in changes[: batch.used] for pair in change.values.items()]
        parts = [f'{name} = {value!r}' for name, value in [*values, *batch.unlogged.items()]]
        parts += ['reset'] * batch.resets
        return f'{", ".join(parts) or "a change"} at {self._time_ns * 1e-9:.9g} s'

    def _contradict(self, stamp_ns: int, found: Sequence[tuple[str, Any, Any]]) -> None:
        """Note parameter events of the node's own bag that contradict its snapshots."""
        # Other bags may lack events, or have them in another order.
        if self.recorded.stamped:
            for name, recorded, replayed in found:
                self._differ(
                    stamp_ns, self.recorded.topics.parameter_events, name, recorded, replayed
                )

    def _judge(self, batch: Batch, snapshot: RecordedSnapshot, known: bool) -> None:
        topics = self.recorded.topics
        if self._has_events:
            unlogged = [(name, None, value) for name, value in batch.unlogged.items()]
            self._contradict(snapshot.stamp_ns, unlogged)
        self._contradict(snapshot.stamp_ns, batch.contradicted)
        if batch.adopted and not known:
            self.findings.remark(
                f'the initial conditions of the reset at {self._time_ns * 1e-9:.9g} s were taken '
                'from its snapshot: no parameter event gives them'
            )
            return
        if not batch.agrees and not self.recorded.stamped and not self.findings.difference_count:
            self.replayed.adopt(snapshot)
            self.findings.fault(
                f'the changes at rig time {self._time_ns * 1e-9:.9g} s cannot be retraced: not '
                'all of their parameter events were recorded; the snapshot was adopted'
            )
            return
        for name, recorded, replayed in batch.differences[:1]:
            self._differ(snapshot.stamp_ns, topics.snapshot, name, recorded, replayed)
        if self._adopts and not batch.agrees and not batch.adopted:
            for matcher in self._matchers.values():
                matcher.settle(final=True)
            self.replayed.adopt(snapshot)

    def _differ(
        self, stamp_ns: int, topic: str, quantity: str, recorded: object, replayed: object
    ) -> None:
        time, after = self._time_ns / 1e9, self.findings.after
        self.findings.differ(
            Difference(time, stamp_ns, topic, quantity, '', recorded, replayed, after)
        )

    # The end

    def _finish(self) -> None:
        """Compare the messages after the last sample, and report the faults of the bag."""
        findings, recorded = self.findings, self.recorded
        self._excuse(self._spacing.close())
        end_ns = findings.offset_ns + self._time_ns
        for matcher in self._matchers.values():
            if end_ns < matcher.last_ns <= end_ns + self._longest_gap_ns:
                # A cut bag may end with the impacts of a tick whose sample is lost.
                self._time_ns = max(self._time_ns, matcher.last_ns - findings.offset_ns + 1)
        self._advance()
        for matcher in self._matchers.values():
            # In a tick that is cut off, each topic may end elsewhere.
            matcher.drop_after(max(matcher.last_ns, end_ns))
            matcher.settle(final=True)
        self._judge_losses(end_ns)
        if self._left_out:
            findings.fault(f'joint states left out because of impossible stamps: {self._left_out}')
        for fault in recorded.faults():
            findings.fault(fault)
        for remark in recorded.remarks():
            findings.remark(remark)
        if recorded.early:
            findings.remark(f'messages from before the first snapshot, left out: {recorded.early}')

    def _judge_losses(self, end_ns: int) -> None:
        """Report missing messages: the node records all that it does not note as dropped."""
        findings, recorded = self.findings, self.recorded
        for topic, matcher in self._matchers.items():
            if matcher.before_recorder:
                findings.remark(
                    f'{matcher.before_recorder} messages of {topic} precede the first one that '
                    'the recorder received'
                )
        period_ns = self._spacing.period_ns
        if not recorded.stamped or not period_ns or findings.start_ns is None:
            return
        # Before the first sample, and after the last one if impacts follow
        head_ns = findings.start_ns - recorded.start.time_ns
        tail_ns = max(matcher.last_ns for matcher in self._matchers.values()) - end_ns
        lost = findings.missing_samples + int(max(0, tail_ns) // period_ns)
        lost += round(head_ns / period_ns) - 1 if head_ns > 1.5 * period_ns else 0
        if not lost:
            return
        noted = recorded.reader.dropped
        text = f'{lost:,} joint states are missing'
        if findings.gaps:
            text += f', the first after {findings.gaps[0].time:.9g} s'
        if lost <= noted:
            findings.remark(f'{text}; the recorder notes {noted:,} dropped messages')
        else:
            findings.fault(
                f'the bag is not whole: {text}, of which the recorder notes {noted:,} as dropped'
            )
