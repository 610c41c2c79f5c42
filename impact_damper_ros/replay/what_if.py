# SPDX-License-Identifier: Apache-2.0
"""
What-if: another rig in place of the recorded one.

The other rig starts as the recorded one did, with the same force and the same changes and resets,
but some parameters have other values all the time. The orders of a controller outside the rig are
repeated at the same instants. The run of the other rig can be recorded, too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.bag import RigRecorder
from impact_damper_ros.bag.snapshots import without_search
from impact_damper_ros.motion.event import table_of_events
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import InitialConditions
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD

from .command import Command, Setting
from .replay import RunPart, Step
from .rows import NO_EVENTS, Events
from .run_samples import RunSamples


class WhatIf:
    """
    A rig with some parameters overridden, in a recorded run.

    Parameters
    ----------
    start : Command
        Where the run begins.
    overrides : mapping
        Parameters of the rig and of its gap control, and their values.
    initial_overrides : mapping, optional
        Initial conditions and their values.
    most_in_period : float, optional
        Most events of the rig within a period, see `Rig.advance`.
    bag : Path, optional
        Directory of a recording of the rig, which must not hold one yet.
    compiled : bool, optional
        Whether the rig runs as compiled code where that is possible, see `RunSamples`.

    Attributes
    ----------
    rig : Rig
        The rig.
    from_initial : bool
        Whether it started from the initial conditions. Otherwise it took over the recorded state,
        and the other values came as a change at that instant: a gap that is too narrow closes on m
        as it does on a live rig.
    reached : RunPart
        The last result of `follow`; if that failed, the part up to there.
    refusals : list of (float, ParameterError)
        Orders of the recorded controller that this rig could not carry out: instant, s, and error.

    Raises
    ------
    ParameterError
        If the values are not admissible.
    ValueError
        If initial conditions are overridden and the run does not begin with them.
    RecordingError
        If the recording cannot be made.
    """

    def __init__(
        self,
        start: Command,
        overrides: Mapping[str, Any],
        initial_overrides: Mapping[str, Any] | None = None,
        most_in_period: float = MOST_IN_PERIOD,
        bag: Path | None = None,
        *,
        compiled: bool = False,
    ) -> None:
        self._most_in_period = most_in_period
        self.refusals: list[tuple[float, ParameterError]] = []
        self._overrides = dict(overrides)
        self.reached = RunPart.empty()
        self._initial_overrides = dict(initial_overrides or {})
        self._logged = Setting.of(start.state)
        setting = self._logged.replace_values(overrides)
        rig = _from_initial(start, self._logged, setting, self._initial_overrides)
        self._early: list[Events] = []
        self.from_initial = rig is not None
        if rig is None and self._initial_overrides:
            raise ValueError(
                f'{", ".join(self._initial_overrides)} cannot be set: the bag begins in the '
                'middle of the run, at a recorded state; set rig parameters only'
            )
        self.rig = Rig.restore(start.state, start.law) if rig is None else rig
        self._compiled = compiled
        self._recorder: RigRecorder | None = None
        if bag is not None:
            values = {**Setting.at(self.rig).as_dict(), **start.initial.as_dict()}
            values |= self._initial_overrides
            self._recorder = RigRecorder(
                *(bag, self.rig, values, start.rate, math.inf, start.node), start_ns=start.time_ns
            )
        if rig is None:
            self._early += self._change(start.time_ns, setting)

    def follow(self, part: RunPart) -> RunPart:
        """
        Go on to the end of a part of the recorded run.

        Returns
        -------
        RunPart
            The motion at the instants of the recorded samples, the events on the way and at the
            command, and the state of this rig at the end.

        Raises
        ------
        ParameterError
            If a change or reset of the recorded rig is not admissible here.
        RunawayError
            If the rig has more events than allowed.
        RecordingError
            If the recording fails.
        """
        run = RunSamples(self.rig, part.samples['time'], compiled=self._compiled)
        early, self._early = self._early, []
        command, before = part.command, {}
        caused: list[Events] = []
        try:
            ends = [command.time] if command is not None else part.samples['time'][-1:].tolist()
            recorders = [] if self._recorder is None else [self._recorder]
            for end in ends:
                for recorder in recorders:
                    # A command may come at the end.
                    recorder.hold = end
                run.go(end, deque(part.orders), recorders, self._most_in_period)
            if part.before:
                before = self.rig.snapshot()
            for time_ns, step in part.steps:
                caused += self.carry_out(time_ns, step)
            if command is not None:
                command = command._replace(state=self.rig.snapshot())
        finally:
            self.refusals += run.refusals
            events = np.concatenate([NO_EVENTS, *early, run.events, *caused])
            self.reached = RunPart(run.samples, events, command, part.steps, before, part.orders)
        return self.reached

    def close(self) -> None:
        """End the recording, if there is one."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            recorder.close()

    def _change(self, time_ns: int, setting: Setting) -> list[Events]:
        """Change the rig, and record the change."""
        before, after = Setting.at(self.rig), setting.as_dict()
        if before == setting:
            return []
        events = self.rig.change(*setting)
        if self._recorder is not None:
            known = before.as_dict()
            values = {name: value for name, value in after.items() if value != known[name]}
            self._recorder.take_change(time_ns, values, events)
        return [table_of_events(events)]

    def carry_out(self, time_ns: int, step: Step) -> list[Events]:
        """
        Repeat a change or reset of the recorded rig, with the overrides.

        Raises
        ------
        ParameterError
            If the step is not admissible.
        """
        if isinstance(step, Setting):
            self._logged = step
            return self._change(time_ns, step.replace_values(self._overrides))
        initial = InitialConditions(**{**step.as_dict(), **self._initial_overrides})
        kept: Setting | None = None
        events: list[Events] = []
        try:
            self.rig.reset(initial)
        except ParameterError:
            # m would be outside a narrower gap, which then closes on it, as at the start.
            kept = Setting.at(self.rig)
            events += self._change(time_ns, kept._replace(rig=self._logged.rig))
            self.rig.reset(initial)
        if self._recorder is not None:
            self._recorder.reset(time_ns, initial.as_dict(), ())
        return events + (self._change(time_ns, kept) if kept is not None else [])


def _from_initial(
    start: Command,
    logged: Setting,
    setting: Setting,
    initial_overrides: Mapping[str, Any],
) -> Rig | None:
    """Return a rig at its initial conditions, if the run begins at those of the logged one."""
    if start.time_ns != 0:
        return None
    initial = start.initial
    try:
        fresh = Rig(logged.rig, initial, control=logged.control, law=start.law).snapshot()
        if without_search(fresh) != without_search(start.state):
            return None
        changed = InitialConditions(**{**initial.as_dict(), **initial_overrides})
        return Rig(setting.rig, changed, control=setting.control, law=start.law)
    except ParameterError:
        if initial_overrides:
            raise
        return None
