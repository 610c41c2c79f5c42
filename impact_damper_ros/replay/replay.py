# SPDX-License-Identifier: Apache-2.0
"""
The replay of a run from its log: the same rig, computed again.

The rig is restored from the first snapshot, and repeats what the snapshots hold at the same
instants. The motion does not depend on how it is divided, so that every number must be as
recorded, to the last bit. The replayed samples and events are handed on piece by piece for
measures of the motion.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from math import inf
from typing import Any, NamedTuple, Self, cast

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.bag.rig_topics import JOINTS
from impact_damper_ros.bag.snapshots import mathematics, without_search
from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.motion.event import table_of_events
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.plain import differences
from impact_damper_ros.parameters.rig_parameters import InitialConditions
from impact_damper_ros.rig.observed_run import TimedOrder
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Outcome
from impact_damper_ros.rig.runaway import RunawayError
from impact_damper_ros.rig.snapshot import ARITHMETIC

from .command import Command, Deed, Setting, restore_rig
from .findings import Findings, SampleGap
from .matching import Matcher, NearMatcher, differing_states, expected_states, note_states
from .rows import (
    NO_EVENTS,
    NO_SAMPLES,
    Advance,
    Events,
    Ints,
    Messages,
    Numbers,
    Samples,
    orders_of,
    published_acts,
    published_impacts,
    published_states,
    samples_as_rows,
)
from .run import RecordedRun, Rows
from .run_samples import RunSamples
from .shadowing import Shadowing, near

#: Longest gap, and most missing samples in it: a longer one is a wrong stamp. After the last
#: sample the rig runs on for this number of samples.
_LONGEST_GAP_NS, _MOST_MISSING = 6 * 3600 * 10**9, 10
#: Longest gap after the snapshot that a recorder gets when it joins.
_LONGEST_WAIT_NS = 10 * 86_400 * 10**9
#: Errors of a rig with an impossible recorded state or law.
_FAILURES = (ArithmeticError, LookupError, RunawayError, TypeError, ValueError)
_REMEDY = 'replay the bag with the version of impact_damper_ros that recorded it'

#: A change to parameters, or a reset to initial conditions.
Step = Setting | InitialConditions


def _repeat(rig: Rig, entry: Deed) -> tuple[Step | None, Events]:
    """Repeat what was done to a rig; return what that was, if anything, and its events."""
    if isinstance(entry, int):
        return None, NO_EVENTS
    if isinstance(entry, InitialConditions):
        rig.reset(entry)
        return entry, NO_EVENTS
    present = Setting.at(rig)
    setting = present.replace_values(entry)
    if setting == present:
        return None, NO_EVENTS
    return setting, table_of_events(rig.change(*setting))


class RunPart(NamedTuple):
    """
    A piece of a run, as replayed: first samples and events, then what was done at its end.

    Attributes
    ----------
    samples : ndarray of SAMPLE_TYPE
        The motion at the instants of the joint states.
    events : ndarray of EVENT_TYPE
        All events, in order; events that a command caused belong to the part that the command
        ends.
    command : Command or None
        What was done at the end, if anything.
    steps : list of (int, Step)
        The changes and resets of `command` that were carried out, each with its rig time, ns.
    before : dict
        State of the rig at the end, before the command.
    orders : list of TimedOrder
        Orders of a controller outside the rig within the part.
    """

    samples: Samples
    events: Events
    command: Command | None = None
    steps: list[tuple[int, Step]] = []  # noqa: RUF012 - never changed
    before: Mapping[str, Any] = {}
    orders: list[TimedOrder] = []  # noqa: RUF012 - never changed

    @classmethod
    def empty(cls) -> Self:
        """Return a part without anything."""
        return cls(NO_SAMPLES, NO_EVENTS)


class Replay:
    """
    The replay of a run; iterate over it, or `run` it.

    Where snapshots are missing, the replay goes on from the next one.

    Parameters
    ----------
    recorded : RecordedRun
        The run.

    Attributes
    ----------
    recorded : RecordedRun
        As given.
    findings : Findings
        The findings so far.
    rig : Rig
        The rig at the present instant.
    initial : InitialConditions
        Where a reset would put the rig.
    period : float
        Rig time from one joint state to the next, s.

    Raises
    ------
    RecordingError
        If the first snapshot cannot be restored.
    """

    def __init__(self, recorded: RecordedRun) -> None:
        start = recorded.start
        self.recorded, self.start = recorded, start
        self._own = recorded.reader.own
        self.rig = self._restore(start)
        self.initial = start.initial
        self.findings = findings = Findings(offset_ns=start.offset_ns)
        if start.arithmetic != ARITHMETIC:
            findings.other_bits = (
                f'it was recorded with arithmetic {start.arithmetic}, this version has '
                f'{ARITHMETIC} ({_REMEDY})'
            )
        elif start.mathematics != mathematics():
            findings.other_bits = (
                'it was recorded where the mathematical functions (C library, processor) round '
                'differently'
            )
        self._time_ns = start.time_ns
        self._command: Command | None = None
        self._before: list[tuple[int, Numbers]] = []
        #: Orders of a controller outside the rig that are still to come.
        self._orders: deque[TimedOrder] = deque()
        #: Number of the next orders in the rows that were carried out before a snapshot already
        self._ahead = 0
        #: Rig time from one sample to the next, s and ns
        self.period = 1.0 / start.rate
        self._period_ns = 1e9 / start.rate
        self._left_out = 0
        topics, near = recorded.topics, bool(findings.other_bits)
        self._compiled = recorded.is_long and not near
        kinds: dict[str, type[Matcher]] = {
            'impacts': Matcher,
            'gap_control': NearMatcher if near else Matcher,
        }
        impacts, acts = self._matchers = [
            kind(key, getattr(topics, key), findings, recorded.wrong, own=self._own)
            for key, kind in kinds.items()
        ]
        self._shadowing = Shadowing(self, impacts, cast('NearMatcher', acts)) if near else None

    def run(self, progress: Callable[[float], object] = float) -> Findings:
        """
        Replay the whole run.

        Parameters
        ----------
        progress : callable, optional
            Called now and then with the rig time reached, s.

        Returns
        -------
        Findings
            The findings.
        """
        for _ in self:
            progress(self._time_ns / 1e9)
        return self.findings

    def __iter__(self) -> Iterator[RunPart]:
        """Replay, part by part."""
        for item in self.recorded.walk():
            if isinstance(item, Rows):
                yield self._take_rows(item)
            elif self._command is None:
                self._begin(item)
            else:
                yield from self._take_command(item)
        yield self._finish()

    # The rows

    def _take_rows(self, rows: Rows) -> RunPart:
        impacts, acts = self._matchers
        acts.take(rows.acts)
        if self._shadowing is not None:
            self._shadowing.expect(rows.impacts)
            self.findings.recorded_impacts += len(rows.impacts)
        else:
            impacts.take(rows.impacts)
        findings, states = self.findings, rows.states
        coming = orders_of(rows.acts, findings.offset_ns)
        self._orders += coming[self._ahead :]
        self._ahead = max(0, self._ahead - len(coming))
        states = states[self._usable(states['stamp_ns'] - findings.offset_ns)]
        times_ns = states['stamp_ns'] - findings.offset_ns
        if not len(states):
            return RunPart(NO_SAMPLES, NO_EVENTS)
        instants = times_ns / 1e9
        orders = self._orders_until(instants[-1])
        if self._shadowing is not None:
            done = self._shadowing.follow(states, instants, float(instants[-1]), orders)
        else:
            done = self._advanced_through(states, times_ns, orders)
        for time_ns, before in self._before:
            # A sample at the instant of a change may be from before the change.
            for i in np.flatnonzero(done.differs & (times_ns == time_ns)):
                done.differs[i] = not self._is_same(states['numbers'][i], before)
        return self._note_rows(done, states, times_ns)._replace(orders=orders)

    def _is_same(self, recorded: Numbers, replayed: Numbers) -> bool:
        """Return whether joint states agree, to the last bit or within round-off."""
        if self._shadowing is not None:
            return bool((np.abs(recorded - replayed) <= self._shadowing.state_floors()).all())
        return recorded.tobytes() == replayed.tobytes()

    def _orders_until(self, until: float) -> list[TimedOrder]:
        """Take the orders up to an instant out of the queue."""
        found = []
        while self._orders and self._orders[0].time <= until:
            found.append(self._orders.popleft())
        return found

    def _gone_to(self, until: float, orders: list[TimedOrder]) -> Events:
        """Let the rig run on beyond the last joint states; return its events."""
        if self._shadowing is not None:
            nothing = np.empty(0, message_row(2 * len(JOINTS)))
            return self._shadowing.follow(nothing, np.empty(0), until, orders).events
        done = self.run_on(self.rig, (), until, deque(orders))
        self.note_refusals(done)
        self._expect(done.events, done.acts)
        return done.events

    def _note_rows(self, done: Advance, states: Messages, times_ns: Ints) -> RunPart:
        """Note the differences of joint states, and the gaps between them."""
        findings, first = self.findings, self.findings.end_ns is None
        findings.samples += len(states)
        topic = self.recorded.topics.joint_states
        note_states(findings, topic, states, done.expected, done.differs)
        if first:
            findings.start_ns = int(times_ns[0])
        self._look_for_gaps(times_ns)
        self._time_ns = findings.end_ns = int(times_ns[-1])
        self._before.clear()
        events = done.events
        if first and not self._own:
            # A recorder that joins late gets the latched snapshot, and no earlier message.
            firsts = [m.first_ns for m in self._matchers if m.first_ns is not None]
            begun_ns = min([findings.offset_ns + int(times_ns[0]), *firsts])
            events = events[events['time'] >= (begun_ns - findings.offset_ns) / 1e9]
            for matcher in self._matchers:
                matcher.forget(begun_ns)
        for matcher in self._matchers:
            matcher.settle(findings.offset_ns + self._time_ns)
        return RunPart(done.samples, events)

    def _usable(self, times_ns: Ints) -> NDArray[np.bool_]:
        """Return which rig times are possible after the present one."""
        longest = max(_LONGEST_GAP_NS, _MOST_MISSING * self._period_ns)
        first = self.findings.end_ns is None and not self._own
        usable = np.ones(len(times_ns), dtype=np.bool_)
        steps = np.diff(times_ns, prepend=self._time_ns)
        if not len(steps) or (steps.min() >= 0 and steps.max() <= longest):
            return usable
        last = self._time_ns
        for i, time_ns in enumerate(times_ns.tolist()):
            limit = _LONGEST_WAIT_NS if first and not i else longest
            usable[i] = 0 <= time_ns - last <= limit
            last = time_ns if usable[i] else last
        self._left_out += int((~usable).sum())
        return usable

    def run_on(
        self, rig: Rig, instants: Numbers | tuple[()], until: float, orders: deque[TimedOrder]
    ) -> RunSamples:
        """Let a rig run on through instants to a later one, with the orders on the way."""
        try:
            return RunSamples(rig, instants, compiled=self._compiled).go(until, orders)
        except _FAILURES as error:
            raise self._cannot_go_on(rig, str(error)) from error

    def to_event(self, rig: Rig, time: float) -> Events:
        """Let a rig run on to an instant, or to the next event."""
        try:
            result = rig.run(time, most_events=1)
        except _FAILURES as error:
            raise self._cannot_go_on(rig, str(error)) from error
        if result.outcome is Outcome.RUNAWAY:
            raise self._cannot_go_on(rig, result.reason)
        return result.events

    def note_refusals(self, run: RunSamples) -> None:
        """Note the orders that the rig could not carry out."""
        for time, error in run.refusals:
            self.findings.fault(
                f'the order at rig time {time:.9g} s cannot be carried out: {error}'
            )

    def _cannot_go_on(self, rig: Rig, reason: str) -> RecordingError:
        cause = f'the rig cannot be run on from rig time {rig.time:.9g} s: {reason}'
        return RecordingError('replay', self.recorded.reader.path, cause, _REMEDY)

    def _advanced_through(
        self, states: Messages, times_ns: Ints, orders: list[TimedOrder]
    ) -> Advance:
        """Let the rig run on to joint states, and compare them."""
        instants = times_ns / 1e9
        found = self.run_on(self.rig, instants, float(instants[-1]), deque(orders))
        self.note_refusals(found)
        self._expect(found.events, found.acts)
        numbers = published_states(found.samples, self.rig.parameters)
        expected = expected_states(states, numbers)
        differs = differing_states(states, expected)
        return Advance(found.samples, found.events, expected, differs)

    def _expect(self, events: Events, new_acts: list[ControlAct]) -> None:
        if self._shadowing is not None:
            self._shadowing.take_consequences(events, new_acts)
            return
        offset_ns = self.findings.offset_ns
        impacts, acts = self._matchers
        impacts.expect(published_impacts(events, self.rig.parameters, offset_ns))
        if new_acts:
            acts.expect(published_acts(new_acts, offset_ns))

    # Gaps without samples

    def _look_for_gaps(self, times_ns: Ints) -> None:
        last_ns = self.findings.end_ns
        times_ns = times_ns if last_ns is None else np.concatenate([[last_ns], times_ns])
        steps = np.diff(times_ns)
        for i in np.flatnonzero(steps > 1.5 * self._period_ns):
            begin, step = int(times_ns[i]), int(steps[i])
            stamp_ns = self.findings.offset_ns + begin
            missing = round(step / self._period_ns) - 1
            gap = SampleGap(begin / 1e9, stamp_ns, stamp_ns + step, missing)
            self.findings.miss(gap)
            for matcher in self._matchers:
                matcher.excuse(gap)

    # Commands

    def _begin(self, start: Command) -> None:
        """Take the first snapshot, from which the rig was restored."""
        self._command = start
        self.findings.snapshots += 1
        # Entries that this rig does not use must be as a rig writes them, too.
        replayed = without_search(self.rig.snapshot())
        if self._shadowing is None or not near(start.state, replayed):
            for name, there, here in differences(start.state, replayed):
                self._differ(self.recorded.topics.snapshot, name, there, here)
        control = start.state['gap_control']
        if control['parameters']['gap_control'] != 'off' or control['state']['returning']:
            return
        # The stops that no control moves are at the gap.
        half, origin = 0.5 * start.state['parameters']['gap'], start.state['origin']
        for name, expected in (('target_1', half), ('target_2', -half)):
            if origin[name] != expected and not start.state['parameters']['one_sided']:
                topic = self.recorded.topics.snapshot
                self._differ(topic, f'origin.{name}', origin[name], expected)

    def _take_command(self, command: Command) -> Iterator[RunPart]:
        findings, last, topic = self.findings, self._command, self.recorded.topics.snapshot
        assert last is not None
        if command.time_ns < self._time_ns:
            self._differ(topic, 'time_ns', command.time_ns, self._time_ns)
            return
        self._command = command
        findings.snapshots += 1
        orders = self._orders_until(command.time)
        events = self._gone_to(command.time, orders)
        if preceding := self._orders_before(command):
            events = np.concatenate([events, self._gone_to(command.time, preceding)])
            orders += preceding
        self._time_ns = command.time_ns
        lost = command.number != last.number + 1
        if lost and self._own:
            self._differ(topic, 'number', command.number, last.number + 1)
        for name in ('arithmetic', 'mathematics', 'node', 'topics', 'rate'):
            recorded, expected = getattr(command, name), getattr(last, name)
            if recorded != expected:
                self._differ(topic, name, recorded, expected)
        before = self.rig.snapshot()
        steps, more = self._carry_out(command)
        self._judge(command, lost=lost)
        if command.reason == 'slip':
            findings.slips += 1
        elif command.offset_ns != last.offset_ns or command.reason == 'resume':
            findings.pauses += 1
        if command.offset_ns < last.offset_ns:
            # The stamps go back: later messages may have the stamps of earlier ones.
            for matcher in self._matchers:
                matcher.settle(inf)
        if findings.end_ns is None and not self._own:
            events = NO_EVENTS
        everything = np.concatenate([events, *more])
        yield RunPart(NO_SAMPLES, everything, command, steps, before, orders)

    def _orders_before(self, command: Command) -> list[TimedOrder]:
        """Take the orders with the stamp of a snapshot that precede it, as its state shows."""
        coming = [*command.orders[self._ahead :]]
        likely = max(0, command.recorded_before - self._ahead)
        counts = sorted(range(len(coming) + 1), key=lambda count: count != likely)
        fitting = (n for n in counts if coming and self._leads_to(command, coming[:n]))
        count = next(fitting, likely)
        self._ahead += count
        return coming[:count]

    def _leads_to(self, command: Command, orders: list[TimedOrder]) -> bool:
        """Return whether some orders, and then a command, bring the rig to its snapshot."""
        rig, mark = self.rig, self.rig.mark()
        try:
            for order in orders:
                rig.order(order.order)
            for entry in command.done:
                _repeat(rig, entry)
            replayed = without_search(rig.snapshot())
        except _FAILURES:
            return False
        finally:
            rig.go_back(mark)
        if self._shadowing is not None:
            return near(command.state, replayed)
        return not differences(command.state, replayed)

    def _carry_out(self, command: Command) -> tuple[list[tuple[int, Step]], list[Events]]:
        """Repeat what was done; return the changes and resets, and the events that they caused."""
        findings, rig, described = self.findings, self.rig, []
        steps: list[tuple[int, Step]] = []
        found = []
        for entry in command.done:
            numbers = published_states(samples_as_rows([rig.sample()]), rig.parameters)
            self._before.append((command.time_ns, numbers[0]))
            try:
                if isinstance(entry, Mapping):
                    described += [f'{name} = {value!r}' for name, value in entry.items()]
                    initial = self.initial.as_dict()
                    initial |= {n: v for n, v in entry.items() if n in initial}
                    self.initial = InitialConditions(**initial)
                step, events = _repeat(rig, entry)
                if isinstance(entry, int):
                    findings.offset_ns = entry
                elif isinstance(step, InitialConditions):
                    self.initial = step
                    findings.resets += 1
                    described.append('reset')
                elif step is not None:
                    found.append(events)
                    self._expect(events, rig.acts)
                    findings.changes += 1
                if step is not None:
                    steps.append((command.time_ns, step))
            except (ParameterError, TypeError, ValueError) as error:
                findings.fault(
                    f'the change at rig time {command.time:.9g} s cannot be applied to the rig: '
                    f'{error}'
                )
        if described:
            findings.after = f'{", ".join(described)} at {command.time:.9g} s'
        return steps, found

    def _judge(self, command: Command, *, lost: bool) -> None:
        """Compare a snapshot with the rig."""
        findings, topic = self.findings, self.recorded.topics.snapshot
        if command.offset_ns != findings.offset_ns:
            if self._own:
                name = 'stamp_offset_ns'
                self._differ(topic, name, command.offset_ns, findings.offset_ns)
            findings.offset_ns = command.offset_ns
        recorded, replayed = command.state, without_search(self.rig.snapshot())
        wrong = [
            (f'initial.{name}', there, here)
            for name, there, here in differences(command.initial.as_dict(), self.initial.as_dict())
        ] + differences(recorded, replayed)
        if self._shadowing is not None:
            initial = command.initial.as_dict()
            if not near(recorded, replayed) or initial != self.initial.as_dict():
                self._differ(topic, *wrong[0])
            self.rig, self.initial = self._restore(command), command.initial
            self._shadowing.restart(command.stamp_ns)
            return
        if not wrong:
            return
        if lost:
            self.rig, self.initial = self._restore(command), command.initial
        if lost and not self._own:
            findings.fault(
                f'snapshots from before rig time {command.time:.9g} s are missing: what was done '
                'to the rig is not known, and the replay goes on from this snapshot'
            )
        else:
            self._differ(topic, *wrong[0])

    def _restore(self, command: Command) -> Rig:
        return restore_rig(command, self.recorded.reader.path)

    def _differ(self, topic: str, quantity: str, recorded: object, replayed: object) -> None:
        stamp_ns = self.findings.offset_ns + self._time_ns
        self.findings.differ(stamp_ns, topic, quantity, '', recorded, replayed)

    # The end

    def _finish(self) -> RunPart:
        """Compare the messages after the last sample, and report the faults of the bag."""
        findings, recorded = self.findings, self.recorded
        end_ns = findings.offset_ns + self._time_ns
        last_ns = max(matcher.last_ns for matcher in self._matchers)
        events = NO_EVENTS
        before = self.rig.snapshot()
        if end_ns < last_ns <= end_ns + _MOST_MISSING * self._period_ns:
            # A cut bag may end with the impacts of a tick whose sample is lost.
            until = (last_ns + 3 - findings.offset_ns) / 1e9
            events = self._gone_to(until, self._orders_until(until))
        else:
            last_ns = end_ns
        for matcher in self._matchers:
            # In a tick that is cut off, each topic may end elsewhere.
            matcher.end(max(matcher.last_ns, end_ns))
        self._judge_losses(end_ns, last_ns)
        if self._left_out:
            findings.fault(f'joint states left out because of impossible stamps: {self._left_out}')
        for fault in recorded.faults():
            findings.fault(fault)
        for remark in recorded.remarks():
            findings.remark(remark)
        if recorded.early and not self._own:
            findings.remark(f'messages from before the first snapshot, left out: {recorded.early}')
        if findings.other_bits:
            findings.remark(self._on_other_bits())
        findings.unchecked = self._topics_not_compared()
        return RunPart(NO_SAMPLES, events, before=before)

    def _topics_not_compared(self) -> tuple[str, ...]:
        """Return the topics that are not compared with the replay."""
        topics = self.recorded.topics
        checked = {topics.joint_states, topics.impacts, topics.gap_control, topics.snapshot}
        return tuple(sorted({name for name, _ in self.recorded.reader.topics} - checked))

    def _on_other_bits(self) -> str:
        findings = self.findings
        text = f'{findings.other_bits}: compared with the replay within round-off, from impact to '
        text += 'impact'
        if findings.undecided:
            text += f'; round-off may change the events of {findings.undecided} of these flights'
        return text

    def _judge_losses(self, end_ns: int, last_ns: int) -> None:
        """Report missing messages: the node records all that it does not note as dropped."""
        findings, recorded, period_ns = self.findings, self.recorded, self._period_ns
        if not self._own or findings.start_ns is None:
            return
        # Before the first sample, and after the last one if impacts follow
        head_ns = findings.start_ns - self.start.time_ns
        lost = findings.missing_samples + int(max(0, last_ns - end_ns) // period_ns)
        lost += round(head_ns / period_ns) - 1 if head_ns > 1.5 * period_ns else 0
        if not lost:
            return
        noted = recorded.reader.dropped
        text = f'{lost:,} joint states are missing'
        if findings.gaps:
            text += f', the first after {findings.gaps[0].after:.9g} s'
        if lost <= noted:
            findings.remark(f'{text}; the recorder notes {noted:,} dropped messages')
        else:
            findings.fault(
                f'the bag is not complete: {text}; the recorder notes {noted:,} dropped messages'
            )
