# SPDX-License-Identifier: Apache-2.0
"""
A controller outside the node: what it is shown and commands, and how long the rig waits for it.

The engine calls this wherever the rig stops: at each tick of the joint states and at each instant
of a measurement. Commands are in effect at the first of these after they came.

In lock-step the rig does not move on from a measurement before the command with its stamp has
come. So a run does not depend on how long controller and middleware take. A measurement is sent
again now and then, as a controller that has only just joined may have missed it. If none answers
within `lock_step_timeout` of wall time, the rig goes on, and does not wait again before the next
command.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, nan
from typing import NamedTuple

from impact_damper_ros.control import ControlRecord, Order, Rig
from impact_damper_ros.rig import Event, NodeSettings, ParameterError

from .commands import Command, CommandError, CommandInbox
from .measurements import Measurements, Sent

#: How much later or earlier than now a command may be stamped, if there is no `command_timeout`.
_MOST_LATE_S = 10.0
_NEVER_S = 1e9


class ControllerStatus(NamedTuple):
    """What came from the controller so far."""

    accepted: int = 0
    refused: int = 0
    reason: str = ''  # of the last refusal
    age_ns: int | None = None  # rig time since the last one accepted; None before the first
    parked: bool = False  # whether the watchdog has parked the stops and ended the force
    limited: int = 0  # forces beyond `force_limit`
    missed: int = 0  # measurements after which the rig in lock-step went on without a command


class ExternalControl:
    """
    The side of a rig that its controller sees; for the engine's thread.

    Parameters
    ----------
    rig : Rig
        The rig.
    inbox : CommandInbox
        Where the commands come from.
    settings : NodeSettings
        The settings of the node; may be replaced at any time.
    """

    def __init__(self, rig: Rig, inbox: CommandInbox, settings: NodeSettings) -> None:
        self.settings = settings
        self._rig = rig
        self._inbox = inbox
        self._accepted = self._limited = 0
        # Rig time of the last orders to the stops, and of the last force; None before the first
        self._ordered_ns: int | None = None
        self._pushed_ns: int | None = None
        self._last_ns: int | None = None
        self._parked = False
        self._measurements = Measurements(settings.measurement_rate)
        # In lock-step: the topics from which a command is awaited
        self._topics = {
            'off': set(),
            'both': {'stop_commands', 'force_command'},
        }.get(settings.lock_step, {settings.lock_step})
        # The stamp of the measurement for which it is, and the commands that have come for it
        self._awaited_ns: int | None = None
        self._answers: dict[str, Command] = {}
        self._answered_ns = -1
        self._given_up = False
        self._missed = 0

    @property
    def waits(self) -> bool:
        """Whether a command is awaited at this instant."""
        return self._awaited_ns is not None

    def next_ns(self) -> int | None:
        """Return the rig time at which the rig has to stop for its controller, ns."""
        return self._measurements.next_ns()

    def measurements(self, time_ns: int, offset_ns: int) -> Iterator[Sent]:
        """Yield what is to be published now; after each the rig may have to wait."""
        for sent in self._measurements.take(self._rig, self.settings, time_ns, offset_ns):
            if self._topics and not self._given_up and self._external:
                self._awaited_ns, self._answers = sent.stamp_ns, {}
            yield sent

    def wait(self, seconds: float) -> None:
        """Wait for a command."""
        self._inbox.wait(seconds)

    def give_up(self) -> None:
        """Await no command before the next one has come."""
        self._awaited_ns, self._given_up = None, True
        self._missed += 1

    @property
    def _external(self) -> bool:
        return self._rig.control.gap_control == 'external'

    def status(self, time_ns: int) -> ControllerStatus:
        """Return what came so far, for other threads."""
        last_ns, inbox = self._last_ns, self._inbox
        age_ns = None if last_ns is None else time_ns - last_ns
        return ControllerStatus(
            self._accepted,
            inbox.refused,
            inbox.reason,
            age_ns,
            self._parked,
            self._limited,
            self._missed,
        )

    def refuse_all(self, reason: str) -> None:
        """Refuse the commands that have come."""
        for command in self._inbox.take():
            self._inbox.refuse(command.topic, reason)

    def obey(
        self, time_ns: int, stamp_ns: int
    ) -> Iterator[tuple[list[Event], list[ControlRecord]]]:
        """Carry out the commands that have come; yield events and acts of each."""
        if not self._external:
            self._awaited_ns = None
        for command in self._commands(stamp_ns):
            try:
                done = self._carry_out(self._limited_order(command.order))
            except ParameterError as error:
                self._inbox.refuse(command.topic, error)
                continue
            self._note(command.order, time_ns)
            yield done
        if (order := self._overdue(time_ns)) is not None:
            self._parked = True
            yield self._carry_out(order)

    def _commands(self, now_ns: int) -> list[Command]:
        """Return the commands that are due now."""
        found = []
        for command in self._inbox.take():
            try:
                if self._awaited_ns is None:
                    self._check_stamp(command.stamp_ns, now_ns)
                    found.append(command)
                elif command.stamp_ns == self._awaited_ns:
                    self._answers[command.key] = command
                # A measurement that was sent again may be answered again.
                elif command.stamp_ns != self._answered_ns:
                    raise CommandError(
                        f'its stamp is {command.stamp_ns * 1e-9:.9f} s, and lock-step waits for '
                        f'that of the last measurement, {self._awaited_ns * 1e-9:.9f} s'
                    )
            except CommandError as error:
                self._inbox.refuse(command.topic, error)
        if self._awaited_ns is not None and self._topics <= self._answers.keys():
            # In one order, however they came
            found = [self._answers[key] for key in sorted(self._answers)]
            self._answered_ns, self._awaited_ns = self._awaited_ns, None
        return found

    def _carry_out(self, order: Order) -> tuple[list[Event], list[ControlRecord]]:
        # A controller may answer that nothing is to be done.
        if not (order.stops or order.force == order.force):
            return [], []
        events = self._rig.order(order)
        return events, self._rig.records

    def _check_stamp(self, stamp_ns: int, now_ns: int) -> None:
        if not stamp_ns:
            return
        late_s = (now_ns - stamp_ns) * 1e-9
        if late_s > (self.settings.command_timeout or _MOST_LATE_S):
            raise CommandError(f'late: its stamp is {late_s:.3f} s before that of the rig')
        if late_s < -_MOST_LATE_S:
            raise CommandError(
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
        """Return what parks the stops and ends the force if no command comes any more."""
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
