# SPDX-License-Identifier: Apache-2.0
"""
A bound on the events of a run.

Elastic stops to which weight or compressed air presses m make impacts ever faster: 1e8 per second
and more. Whoever advances a rig does so within a budget, and stops it at an event beyond that.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import tau
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from impact_damper_ros.motion.event import Event
    from impact_damper_ros.motion.state import Mode
    from impact_damper_ros.parameters.rig_parameters import RigParameters

#: Most events of a run, unless others are given.
MOST_EVENTS = 200_000
#: Events in a period of the fastest of spring and force, on average, up to which a run may go on
#: beyond that: a rig that chatters in each cycle may do so for long.
PER_PERIOD = 100
#: Events that are taken together, so that those of a run can be written while it goes on.
_PORTION = 1_000
REMEDY = 'make the stops less elastic or the gap wider'


class Running(Protocol):
    """A rig, as far as a budget knows it."""

    @property
    def time(self) -> float:
        """Time reached, s."""

    @property
    def parameters(self) -> RigParameters:
        """The present parameters."""

    @property
    def mode(self) -> Mode:
        """The present mode."""

    def advance(self, time: float, most_events: float) -> list[Event]:
        """Let the rig run to a later time, or to as many events."""


class RunawayError(RuntimeError):
    """A rig has events without end at one instant; it cannot go on."""

    def __init__(self, count: int, time: float) -> None:
        super().__init__(
            f'the rig has more than {count} events at once, at {time:.15g} s, and cannot be '
            'followed any further: give a wider gap, a restitution below 1, or a slower start'
        )


class EndlessEventsError(RunawayError):
    """A rig has more events than it may have."""

    def __init__(self, reason: str) -> None:
        RuntimeError.__init__(self, reason)


def fastest_rate(parameters: RigParameters) -> float:
    """Return the circular frequency of the fastest of spring and acting harmonics, rad/s."""
    amplitudes, frequencies, _ = parameters.harmonics
    acting = [w for f, w in zip(amplitudes, frequencies, strict=True) if f != 0.0]
    return max([parameters.omega, *acting])


class EventBudget:
    """
    The most events that a rig may have on a run.

    They are counted anew after each change of the rig, and where that number of them came at less
    than 100 in a period on average.

    Parameters
    ----------
    most_events : int, optional
        Their number.
    remedy : str, optional
        What the message of `EndlessEventsError` ends with.
    """

    def __init__(self, most_events: int = MOST_EVENTS, remedy: str = REMEDY) -> None:
        self._most = most_events
        self._remedy = remedy
        self._rig: RigParameters | None = None
        self._since = 0.0
        self._count = 0

    def restart(self, rig: Running) -> None:
        """Count events from the present time of a rig on."""
        self._rig, self._since, self._count = rig.parameters, rig.time, 0

    def advance(self, rig: Running, time: float) -> list[Event]:
        """
        Let a rig run to a later time; return the events on the way.

        Raises
        ------
        EndlessEventsError
            If it has more events than it may; it has stopped at the last of them.
        """
        return [event for events in self.portions(rig, time) for event in events]

    def portions(self, rig: Running, time: float) -> Iterator[list[Event]]:
        """Yield the events portion by portion, each when the rig has just had it; as `advance`."""
        if rig.parameters is not self._rig and rig.parameters != self._rig:
            self.restart(rig)
        while True:
            most = min(max(1, self._most - self._count), _PORTION)
            events = rig.advance(time, most)
            yield events
            if len(events) < most:
                self._count += len(events)
                return
            self.take(rig, len(events), done=rig.time >= time)

    def take(self, rig: Running, count: int, *, done: bool = False) -> None:
        """
        Count events that a rig has just had; `done` if it has come to where it should.

        Raises
        ------
        EndlessEventsError
            If they are too many.
        """
        self._count += count
        if done or self._count < self._most:
            return
        periods = (rig.time - self._since) * fastest_rate(rig.parameters) / tau
        if self._count > PER_PERIOD * periods:
            mode = rig.mode.name.lower().replace('_', ' ')
            raise EndlessEventsError(
                f'the rig had {self._count} events from {self._since:.9g} s to {rig.time:.9g} s, '
                f'the last in mode {mode}: {self._remedy}'
            )
        self.restart(rig)
