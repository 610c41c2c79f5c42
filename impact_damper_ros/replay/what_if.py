# SPDX-License-Identifier: Apache-2.0
"""
What-if: another rig in place of the recorded one.

The other rig starts as the recorded one did, with the same force and the same changes and resets,
but some parameters are held at other values all the time. What a controller outside the rig
ordered is ordered again, at the same instants. Its run can be recorded, too, and is then a
recording as any other.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.bag import RigRecorder
from impact_damper_ros.bag.snapshots import motion_of
from impact_damper_ros.motion.compiled import has_numba
from impact_damper_ros.motion.event import Event, table_of_events
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import InitialConditions
from impact_damper_ros.rig.order import Order
from impact_damper_ros.rig.rig import Outcome, Rig
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD, RunawayError

from .command import Command, Setting
from .replay import Part, Step
from .rows import NO_EVENTS, NO_SAMPLES, Events, Numbers, Samples, samples_as_rows


class WhatIf:
    """
    A rig with some parameters held, in a recorded run.

    Parameters
    ----------
    start : Command
        Where the run begins.
    held : mapping
        Parameters of the rig and of its gap control, and their values.
    held_initial : mapping, optional
        Initial conditions and their values.
    most_in_period : float, optional
        Most events of the rig within a period, see `Rig.advance`.
    bag : Path, optional
        Directory of a recording of the rig, which must not hold one yet.
    compiled : bool, optional
        Whether the rig runs as compiled code where numba is installed.

    Attributes
    ----------
    rig : Rig
        The rig.
    from_initial : bool
        Whether it started from the initial conditions. Otherwise it took over the recorded state,
        and the held values came as a change at that instant: a gap that is too narrow closes on m
        as it does on a live rig.
    reached : Part
        What `follow` returned last; what there was of it, if it failed.

    Raises
    ------
    ParameterError
        If the values are not admissible.
    ValueError
        If initial conditions are held and the run does not begin with them.
    RecordingError
        If the recording cannot be made.
    """

    def __init__(
        self,
        start: Command,
        held: Mapping[str, Any],
        held_initial: Mapping[str, Any] | None = None,
        most_in_period: float = MOST_IN_PERIOD,
        bag: Path | None = None,
        *,
        compiled: bool = False,
    ) -> None:
        self._most_in_period = most_in_period
        # In one call from sample to sample, unless something may have to be done between them
        self._at_once = bag is None and most_in_period == MOST_IN_PERIOD
        self._held = dict(held)
        self.reached = Part.empty()
        self._held_initial = dict(held_initial or {})
        self._logged = Setting.of(start.state)
        setting = self._logged.replaced(held)
        rig = _from_initial(start, self._logged, setting, self._held_initial)
        self._early: list[Events] = []
        self.from_initial = rig is not None
        if rig is None and self._held_initial:
            raise ValueError(
                f'{", ".join(self._held_initial)} cannot be set: the bag begins in the middle '
                'of the run, at a recorded state; set rig parameters only'
            )
        self.rig = Rig.restore(start.state, start.law) if rig is None else rig
        self.rig.compiled = compiled and has_numba()
        self._recorder: RigRecorder | None = None
        if bag is not None:
            values = {**Setting.at(self.rig).as_dict(), **start.initial.as_dict()}
            values |= self._held_initial
            self._recorder = RigRecorder(
                *(bag, self.rig, values, start.rate, math.inf, start.node), start_ns=start.time_ns
            )
        if rig is None:
            self._early += self._changed(start.time_ns, setting)

    def follow(self, part: Part) -> Part:
        """
        Go on to the end of a part of the recorded run.

        Returns
        -------
        Part
            The motion at the instants of the recorded samples, the events on the way, those of
            the command at the end, and the state of this rig then.

        Raises
        ------
        ParameterError
            If a change or reset of the recorded rig is not admissible here.
        RunawayError
            If the rig has more events than it may.
        RecordingError
            If the recording fails.
        """
        events, self._early = self._early, []
        samples: list[Samples] = []
        command, before = part.command, {}
        orders = deque(part.orders)
        try:
            if self._at_once and not orders:
                self._run(part.samples['time'], samples, events)
            else:
                for time in part.samples['time'].tolist():
                    self._ordered(orders, time, events)
                    self._move(time, events)
                    samples.append(samples_as_rows([self.rig.sample()]))
            self._ordered(orders, math.inf, events)
            if command is not None:
                self._move(command.time, events)
            if part.before:
                before = self.rig.snapshot()
            for time_ns, step in part.steps:
                events += self.carry_out(time_ns, step)
            if command is not None:
                command = command._replace(state=self.rig.snapshot())
        finally:
            rows = np.concatenate([NO_SAMPLES, *samples]), np.concatenate([NO_EVENTS, *events])
            self.reached = Part(*rows, command, part.steps, before, part.orders)
        return self.reached

    def close(self) -> None:
        """End the recording, if there is one, with the tick that is due now."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            recorder.reached(self.rig.time)
            recorder.close()

    def _run(self, instants: Numbers, samples: list[Samples], events: list[Events]) -> None:
        """Go on through instants, s, in one call."""
        here = int(np.searchsorted(instants, self.rig.time, side='right'))
        samples.append(samples_as_rows([self.rig.sample()] * here))
        if here == len(instants):
            return
        result = self.rig.run(float(instants[-1]), instants[here:], most_events=math.inf)
        samples.append(result.samples)
        events.append(result.events)
        if result.outcome is not Outcome.COMPLETE:
            raise RunawayError(result.reason)

    def _ordered(
        self, orders: deque[tuple[float, Order]], until: float, events: list[Events]
    ) -> None:
        """Carry out the orders up to an instant, s, but for those that this rig cannot take."""
        while orders and orders[0][0] <= until:
            time, order = orders.popleft()
            self._move(time, events)
            with suppress(ParameterError):
                events.append(self._noted(self.rig.order(order)))

    def _move(self, time: float, events: list[Events]) -> None:
        """Go on to an instant, s, and record the ticks before it."""
        if time <= self.rig.time:
            return
        if self._at_once:
            self._run(np.array([time]), [], events)
            return
        recorder = self._recorder
        while recorder is not None and recorder.due < time:
            # What is done at the instant of a tick is done before its joint states.
            self._advance(recorder.due, events)
            recorder.reached(self.rig.time)
        self._advance(time, events)

    def _advance(self, time: float, events: list[Events]) -> None:
        if time <= self.rig.time:
            return
        try:
            events.append(self._noted(self.rig.advance(time, self._most_in_period)))
        except RunawayError as error:
            events.append(self._noted(list(error.events)))
            raise

    def _noted(self, events: list[Event]) -> Events:
        """Record what the rig's last call has brought; return it as an array."""
        if self._recorder is not None:
            self._recorder.happened(events)
        return table_of_events(events)

    def _changed(self, time_ns: int, setting: Setting) -> list[Events]:
        """Change the rig, and record that."""
        before, after = Setting.at(self.rig), setting.as_dict()
        if before == setting:
            return []
        events = self.rig.change(*setting)
        if self._recorder is not None:
            known = before.as_dict()
            values = {name: value for name, value in after.items() if value != known[name]}
            self._recorder.changed(time_ns, values, events)
        return [table_of_events(events)]

    def carry_out(self, time_ns: int, step: Step) -> list[Events]:
        """
        Repeat a change or reset of the recorded rig, with the held values.

        Raises
        ------
        ParameterError
            If it is not admissible.
        """
        if isinstance(step, Setting):
            self._logged = step
            return self._changed(time_ns, step.replaced(self._held))
        initial = InitialConditions(**{**step.as_dict(), **self._held_initial})
        held: Setting | None = None
        events: list[Events] = []
        try:
            self.rig.reset(initial)
        except ParameterError:
            # m would be outside a narrower gap, which then closes on it, as at the start.
            held = Setting.at(self.rig)
            events += self._changed(time_ns, held._replace(rig=self._logged.rig))
            self.rig.reset(initial)
        if self._recorder is not None:
            self._recorder.reset(time_ns, initial.as_dict(), ())
        return events + (self._changed(time_ns, held) if held is not None else [])


def _from_initial(
    start: Command,
    logged: Setting,
    setting: Setting,
    held_initial: Mapping[str, Any],
) -> Rig | None:
    """Return a rig at its initial conditions, if the run begins at those of the logged one."""
    if start.time_ns != 0:
        return None
    initial = start.initial
    try:
        fresh = Rig(logged.rig, initial, control=logged.control, law=start.law).snapshot()
        if motion_of(fresh) != motion_of(start.state):
            return None
        held = InitialConditions(**{**initial.as_dict(), **held_initial})
        return Rig(setting.rig, held, control=setting.control, law=start.law)
    except ParameterError:
        if held_initial:
            raise
        return None
