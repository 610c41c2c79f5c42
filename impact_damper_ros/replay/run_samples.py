# SPDX-License-Identifier: Apache-2.0
"""A run of a rig that is sampled at instants, with the orders of a controller outside it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from math import inf

import numpy as np

from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.motion.event import Event, table_of_events
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.rig.observed_run import Observer, TimedOrder, run
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Outcome
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD, RunawayError

from .rows import NO_EVENTS, NO_SAMPLES, Events, Numbers, Samples, samples_as_rows


class RunSamples(Observer):
    """
    Samples of a rig at instants, s, with its events and acts of control so far.

    The instants are ascending; at an instant that the rig has passed already it is sampled at
    once. With `compiled`, what is one call of the rig runs as compiled code, if there is any.
    """

    def __init__(
        self, rig: Rig, instants: Numbers | Sequence[float] = (), *, compiled: bool = False
    ) -> None:
        self._rig = rig
        self._compiled = compiled and rig.own_law is None and has_numba()
        self._instants = np.asarray(instants, float)
        self._samples: list[Samples] = []
        self._events: list[Events] = []
        self.acts: list[ControlAct] = []
        #: Orders that the rig could not carry out: the instant, s, and the error
        self.refusals: list[tuple[float, ParameterError]] = []

    @property
    def samples(self) -> Samples:
        """The samples so far."""
        return np.concatenate([NO_SAMPLES, *self._samples])

    @property
    def events(self) -> Events:
        """The events so far."""
        return np.concatenate([NO_EVENTS, *self._events])

    def go(
        self,
        until: float,
        orders: deque[TimedOrder],
        observers: Sequence[Observer] = (),
        most_in_period: float = MOST_IN_PERIOD,
    ) -> RunSamples:
        """
        Run on to an instant, s, with the orders up to it, which are taken out of the queue.

        Without orders, observers and a limit of events this is one call of the rig.

        Raises
        ------
        RunawayError
            If the rig has more events than allowed.
        """
        until, due = max(until, self._rig.time), []
        while orders and orders[0].time <= until:
            due.append(orders.popleft())
        due = [order._replace(time=max(order.time, self._rig.time)) for order in due]
        # Compiled code takes longer to begin, at each order, than plain code from one to the next.
        self._rig.compiled = self._compiled and not due
        if due or observers or most_in_period != MOST_IN_PERIOD:
            run(self._rig, until, [self, *observers], due, most_in_period, begun=True)
            return self
        # An event that a change makes due at once is handled by the next call with a later time.
        here = int(np.searchsorted(self._instants, self._rig.time, side='right'))
        self._samples.append(samples_as_rows([self._rig.sample()] * here))
        if until > self._rig.time:
            result = self._rig.run(until, self._instants[here:], most_events=inf)
            self._samples.append(result.samples)
            self._events.append(result.events)
            self.acts += self._rig.acts
            if result.outcome is not Outcome.COMPLETE:
                raise RunawayError(result.reason)
        return self

    def instants(self) -> Iterator[float]:
        """Yield the instants."""
        yield from self._instants.tolist()

    def take_events(self, events: Sequence[Event]) -> None:
        """Keep events, and the acts of the control."""
        self._events.append(table_of_events(events))
        self.acts += self._rig.acts

    def take_refusal(self, order: TimedOrder, error: ParameterError) -> None:
        """Keep an order that was not carried out, with the error."""
        self.refusals.append((order.time, error))

    def take_samples(self, samples: Samples) -> None:
        """Keep samples."""
        self._samples.append(samples)
