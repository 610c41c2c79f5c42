"""Requests to the engine: asked for in one thread, carried out in another."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from impact_damper_ros.rig import ParameterError

__all__ = ['RequestQueue', 'Ticket']


class Ticket:
    """
    A request: done once it has taken effect, or failed with an error.

    Attributes
    ----------
    time_ns : int
        Rig time at which it took effect.
    result : object
        What the action returned.
    error : Exception or None
        Why it had no effect.
    """

    def __init__(self, action: Callable[[], Any]) -> None:
        """Keep the action for the engine's thread."""
        self.time_ns = 0
        self.result: Any = None
        self.error: Exception | None = None
        self._action = action
        self._done = threading.Event()

    def wait(self, timeout: float) -> bool:
        """Wait until the request is done; False if it is not within the time-out."""
        return self._done.wait(timeout)

    def carry_out(self, time_ns: int) -> None:
        """Act; what the rig refuses is no fault of the engine, any other error is."""
        self.time_ns = time_ns
        try:
            self.result = self._action()
        except ParameterError as error:
            self.error = error
        except Exception as error:
            self.error = error
            raise
        finally:
            self._done.set()

    def turn_away(self) -> None:
        """Fail the request, because the engine has ended."""
        self.error = RuntimeError('the rig is shutting down')
        self._done.set()


class RequestQueue:
    """Requests in the order in which they were made."""

    def __init__(self) -> None:
        """Begin empty and open."""
        self._tickets: deque[Ticket] = deque()
        self._closed = threading.Event()

    def submit(self, action: Callable[[], Any]) -> Ticket:
        """Ask for an action, from any thread."""
        ticket = Ticket(action)
        self._tickets.append(ticket)
        if self._closed.is_set():
            self._turn_away()
        return ticket

    @property
    def waiting(self) -> bool:
        """Whether there is anything to carry out."""
        return bool(self._tickets)

    def serve(self, time_ns: int) -> None:
        """Carry out all requests made so far, at an instant of rig time."""
        # Not those that come in meanwhile: a flood of them must not stop the rig.
        for _ in range(len(self._tickets)):
            self._tickets.popleft().carry_out(time_ns)

    def close(self) -> None:
        """Turn away what waits, and whatever comes."""
        self._closed.set()
        self._turn_away()

    def _turn_away(self) -> None:
        while self._tickets:
            try:
                ticket = self._tickets.popleft()
            except IndexError:
                # Two threads turn away; the other one was quicker.
                break
            ticket.turn_away()
