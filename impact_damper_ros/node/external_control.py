# SPDX-License-Identifier: Apache-2.0
"""
A controller outside the node: its measurements, its commands, and the wait of the rig for them.

The engine calls this at each stop of the rig: at each tick of the joint states and at each instant
of a measurement. A command takes effect at the first stop after it came.

In lock-step the rig does not move on from a measurement before the command with its stamp has
come. So a run does not depend on how long controller and middleware take. A measurement is sent
again now and then, as a controller that has only just joined may have missed it. Without an answer
within `lock_step_timeout` of wall time the rig goes on, and does not wait again before the next
command, even if that is too late to be carried out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import inf, nan
from typing import NamedTuple

from impact_damper_ros.bag.rig_topics import RIG_TOPICS, RigMessages
from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.control.sensors import mixed_bits, mixed_seed, uniform_of
from impact_damper_ros.motion.event import Event
from impact_damper_ros.parameters.node_settings import NodeSettings
from impact_damper_ros.rig.order import Order
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.tick_grid import TickGrid

from .commands import CommandInbox, TopicCommand, TopicCommandError
from .rig_motion import RIG_FAILURES

#: Largest difference of the stamp of a command from now, if there is no `command_timeout`.
_MOST_LATE_S = 10.0
_NEVER_S = 1e9
#: Part of the reason why a command on a topic that is not awaited is refused.
NOT_AWAITED = 'only: start with lock_step:='
#: Number of the random numbers of a measurement that are not noise.
_LOSS, _JITTER = 5, 6


def _seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds with all its digits."""
    return f'{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}'


class DelayedMeasurement(NamedTuple):
    """A measurement before its publication: rig time of that in ns, stamp and content."""

    due_ns: int
    stamp_ns: int
    content: bytes


class ControllerStatus(NamedTuple):
    """The commands of the controller so far."""

    accepted: int = 0
    refused: int = 0
    reason: str = ''  # reason of the last refusal
    age_ns: int | None = None  # rig time since the last accepted command; None before the first
    parked: bool = False  # whether the watchdog has parked the stops and ended the force
    limited: int = 0  # number of forces beyond `force_limit`
    missed: int = 0  # measurements after which the rig in lock-step went on without a command
    awaited: str = ''  # the topics from which lock-step waits for a command now


class ExternalControl:
    """Measurements for a controller, and its commands; for the engine's thread."""

    def __init__(self, rig: Rig, inbox: CommandInbox, settings: NodeSettings) -> None:
        #: May be replaced at any time
        self.settings = settings
        self._rig = rig
        self._inbox = inbox
        self._accepted = self._limited = 0
        # Rig time of the last orders to the stops, and of the last force; None before the first
        self._ordered_ns: int | None = None
        self._pushed_ns: int | None = None
        self._last_ns: int | None = None
        self._parked = False
        rate = RIG_TOPICS['measurements'].rate_of(settings)
        self._grid = TickGrid(rate) if rate else None
        self._encoder = RigMessages()
        # Number of the next measurement; delayed measurements, and the last one, for a frozen
        # sensor
        self._index = 0
        self._on_the_way: deque[DelayedMeasurement] = deque()
        self._seen: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        # In lock-step: the topics from which a command is awaited
        self._topics = {'off': set(), 'both': {'stop_commands', 'force_command'}}.get(
            settings.lock_step, {settings.lock_step}
        )
        # Stamps of the measurement that awaits a command, of the last one that was published, and
        # of the last one that was answered; and the commands that have come
        self._awaited_ns: int | None = None
        self._published_ns: int | None = None
        self._answered_ns: int | None = None
        self._answers: dict[str, TopicCommand] = {}
        self._given_up = False
        self._missed = 0
        # Commands refused before the awaited one, and commands that answer the measurement before
        self._refused_before = 0
        self._repeated = 0

    @property
    def waits(self) -> bool:
        """Whether a command is awaited at this instant."""
        return self._awaited_ns is not None

    def next_ns(self) -> int | None:
        """Return the rig time, ns, at which a measurement is next taken or published."""
        if self._grid is None:
            return None
        sample_ns = self._grid.instant(self._index)
        return min(sample_ns, self._on_the_way[0].due_ns) if self._on_the_way else sample_ns

    def measurements(self, time_ns: int, offset_ns: int) -> Iterator[DelayedMeasurement]:
        """
        Take the measurement that is due at an instant; yield the measurements to publish then.

        The rig may have to wait after each. All random numbers are functions of the seed of the
        sensors and the number of the measurement.
        """
        if self._grid is None:
            return
        # After a start the first one may be past.
        while (sample_ns := self._grid.instant(self._index)) <= time_ns:
            if sample_ns == time_ns:
                self._measure(time_ns, offset_ns)
            self._index += 1
        while self._on_the_way and self._on_the_way[0].due_ns <= time_ns:
            sent = self._on_the_way.popleft()
            self._published_ns = sent.stamp_ns
            if self._in_step:
                self._awaited_ns, self._answers = sent.stamp_ns, {}
                self._refused_before, self._repeated = self._inbox.refused, 0
            yield sent

    def _measure(self, time_ns: int, offset_ns: int) -> None:
        control, settings = self._rig.control, self.settings
        late_s, jitter_s = settings.measurement_latency, settings.measurement_jitter
        if settings.measurement_loss or jitter_s:
            key = mixed_bits(mixed_seed(control.gap_control_seed) ^ self._index)
            late_s += jitter_s * uniform_of(mixed_bits(key + _JITTER))
            if uniform_of(mixed_bits(key + _LOSS)) <= settings.measurement_loss:
                return
        if control.sensor_fault == 'dropout':
            return
        if control.sensor_fault != 'frozen' or self._seen is None:
            seen, stop_rates = self._rig.measure(self._index)
            self._seen = (
                (seen.x, seen.y, seen.stop_1, seen.stop_2),
                (seen.x_rate, seen.y_rate, *stop_rates),
            )
        stamp_ns = offset_ns + time_ns
        content = self._encoder.measurement(stamp_ns, *self._seen)
        due_ns = time_ns + round(late_s * 1e9)
        if self._on_the_way:
            # No measurement overtakes the one before.
            due_ns = max(due_ns, self._on_the_way[-1].due_ns)
        self._on_the_way.append(DelayedMeasurement(due_ns, stamp_ns, content))

    def wait(self, seconds: float) -> None:
        """Wait for a command."""
        self._inbox.wait(seconds)

    def give_up(self) -> str:
        """Stop waiting until the next command comes; return what came instead, in words."""
        answered_ns = self._answered_ns
        self._answered_ns, self._awaited_ns = self._awaited_ns, None
        self._given_up = True
        self._missed += 1
        if refused := self._inbox.refused - self._refused_before:
            which = 'that was refused' if refused == 1 else 'that were refused, the last one'
            return f' but {refused} {which} ({self._inbox.reason})'
        if self._repeated and answered_ns is not None:
            answer = 'answers' if self._repeated == 1 else 'answer'
            which = f'that {answer} the measurement before, of {_seconds(answered_ns)} s'
            return f' but {self._repeated} {which}'
        return ''

    @property
    def _in_step(self) -> bool:
        """Whether the rig waits for a command to each measurement, and takes no other command."""
        return bool(self._topics) and self._external and not self._given_up

    @property
    def _external(self) -> bool:
        return self._rig.control.gap_control == 'external'

    def status(self, time_ns: int) -> ControllerStatus:
        """Return the commands so far, for other threads."""
        last_ns, inbox = self._last_ns, self._inbox
        age_ns = None if last_ns is None else time_ns - last_ns
        awaited = self._topics - self._answers.keys() if self.waits else ()
        return ControllerStatus(
            self._accepted,
            inbox.refused,
            inbox.reason,
            age_ns,
            self._parked,
            self._limited,
            self._missed,
            ', '.join(sorted(awaited)),
        )

    def refuse_all(self, reason: str) -> None:
        """Refuse the commands that have come."""
        for command in self._inbox.take():
            self._inbox.refuse(command.topic, reason)

    def obey(self, time_ns: int, stamp_ns: int) -> Iterator[tuple[list[Event], list[ControlAct]]]:
        """Carry out the commands that have come; yield events and acts of each."""
        if not self._external:
            self._awaited_ns = None
        for command in self._commands(stamp_ns):
            try:
                done = self._carry_out(self._limited_order(command.order))
            except RIG_FAILURES as error:
                self._inbox.refuse(command.topic, error)
                continue
            self._note(command.order, time_ns)
            yield done
        if (order := self._overdue(time_ns)) is not None:
            self._parked = True
            yield self._carry_out(order)

    def _commands(self, now_ns: int) -> list[TopicCommand]:
        """Return the commands that are due now."""
        found, in_step = [], self._in_step
        for command in self._inbox.take():
            try:
                if not in_step:
                    # The rig waits for a slow controller, too, from the next measurement on.
                    self._given_up &= command.key not in self._topics
                    self._check_stamp(command.stamp_ns, now_ns)
                    found.append(command)
                elif command.stamp_ns == self._awaited_ns and command.key in self._topics:
                    self._answers[command.key] = command
                else:
                    self._check_repeated(command)
            except TopicCommandError as error:
                self._inbox.refuse(command.topic, error)
        if self._awaited_ns is not None and self._topics <= self._answers.keys():
            # Commands have one order, however they came.
            found = [self._answers[key] for key in sorted(self._answers)]
            self._answered_ns, self._awaited_ns = self._awaited_ns, None
        return found

    def _check_repeated(self, command: TopicCommand) -> None:
        """Raise a TopicCommandError unless a command answers a repeated measurement."""
        if command.key not in self._topics:
            raise TopicCommandError(
                f'lock-step waits for {", ".join(self._topics)} {NOT_AWAITED}{command.key}, or '
                'lock_step:=both for commands on both topics'
            )
        if command.stamp_ns == self._answered_ns:
            self._repeated += 1
        else:
            last = 'of which there is none yet'
            if self._published_ns is not None:
                last = f'{_seconds(self._published_ns)} s'
            raise TopicCommandError(
                f'its stamp is {_seconds(command.stamp_ns)} s, and lock-step takes only that of '
                f'the last measurement, {last}'
            )

    def _carry_out(self, order: Order) -> tuple[list[Event], list[ControlAct]]:
        # An empty command is an answer, too.
        if not (order.stops or order.force == order.force):
            return [], []
        mark = self._rig.mark()
        try:
            return self._rig.order(order), self._rig.acts
        except RIG_FAILURES:
            self._rig.go_back(mark)
            raise

    def _check_stamp(self, stamp_ns: int, now_ns: int) -> None:
        if not stamp_ns:
            return
        late_s = (now_ns - stamp_ns) * 1e-9
        if late_s > (self.settings.command_timeout or _MOST_LATE_S):
            raise TopicCommandError(f'late: its stamp is {late_s:.3f} s before that of the rig')
        if late_s < -_MOST_LATE_S:
            raise TopicCommandError(
                f'its stamp is {-late_s:.3f} s after that of the rig: give that of the '
                'measurement, or 0'
            )

    def _limited_order(self, order: Order) -> Order:
        limit = self.settings.force_limit or inf
        if order.force == order.force and abs(order.force) > limit:
            self._limited += 1
            return order._replace(force=max(-limit, min(limit, order.force)))
        return order

    def _note(self, order: Order, time_ns: int) -> None:
        self._accepted += 1
        self._last_ns = time_ns
        self._parked = self._given_up = False
        if order.stops:
            self._ordered_ns = time_ns
        if order.force == order.force:
            self._pushed_ns = time_ns

    def _overdue(self, time_ns: int) -> Order | None:
        """Return the order that parks the stops and ends the force if commands stay away."""
        rig = self._rig
        if not self._external:
            self._ordered_ns = self._pushed_ns = None
            self._parked = False
            return None
        oldest_ns = time_ns - round((self.settings.command_timeout or _NEVER_S) * 1e9)
        stop_1 = stop_2 = force = nan
        if self._ordered_ns is not None and self._ordered_ns < oldest_ns:
            self._ordered_ns = None
            stop_1 = 0.5 * min(rig.parameters.gap, rig.control.gap_max)
            stop_2 = nan if rig.parameters.one_sided else -stop_1
        if self._pushed_ns is not None and self._pushed_ns < oldest_ns:
            self._pushed_ns = None
            force = 0.0
        if stop_1 != stop_1 and force != force:
            return None
        return Order(stop_1, stop_2, force=force)
