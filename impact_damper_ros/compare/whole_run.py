# SPDX-License-Identifier: Apache-2.0
"""A run as a whole: what it amounts to, X over it, and its end close up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from impact_damper_ros.motion.event import SAMPLE_TYPE
from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.replay.replay import Part
from impact_damper_ros.replay.rows import NO_EVENTS, NO_SAMPLES, Events, Samples

from .measures import motion_curve
from .result import Array, LoggedStretch, Overall
from .stretches import RecordedStretch, Stretches


class WholeRun:
    """
    What a run amounts to, whose parts are taken one after the other.

    Parameters
    ----------
    state : mapping
        State of the rig at the start of the run.
    span : float, optional
        Length of the end that is kept close up, s.

    Attributes
    ----------
    stretches : list of LoggedStretch
        The stretches of constant parameters, without their motion.
    """

    def __init__(self, state: Mapping[str, Any], span: float = 0.0) -> None:
        self._stretches = Stretches(state)
        self._span = span
        self._overall: list[Overall] = []
        self._envelopes: list[Array] = []
        self._ends: list[tuple[Samples, Events]] = []
        self.stretches: list[LoggedStretch] = []

    def take(self, part: Part) -> None:
        """Take the next part of the run."""
        for stretch in self._stretches.take(part):
            self._keep(stretch)

    def finish(self) -> None:
        """Take note that the run has ended."""
        for stretch in self._stretches.finish():
            self._keep(stretch)

    def _keep(self, stretch: RecordedStretch) -> None:
        self.stretches.append(stretch.logged)
        self._overall.append(stretch.overall)
        self._envelopes.append(stretch.envelope)
        if not self._span:
            return
        start = stretch.end - self._span
        curve = motion_curve(stretch, max(stretch.start, start), cycle_of(stretch.parameters))
        samples = np.zeros(0 if curve is None else len(curve.time), SAMPLE_TYPE)
        if curve is not None:
            samples['time'], samples['x'], samples['z'] = curve.time, curve.x, curve.x + curve.y
            samples['stop_1'], samples['stop_2'] = curve.x + curve.stop_1, curve.x + curve.stop_2
        impacts = stretch.flights.impacts
        self._ends.append((samples, impacts[impacts['time'] >= start]))
        while len(self._ends) > 1 and self.stretches[-len(self._ends) + 1].start <= start:
            self._ends.pop(0)

    @property
    def overall(self) -> Overall | None:
        """Largest |X|, impacts and energy over the run; None if it holds no motion."""
        return Overall.joined(self._overall) if self._overall else None

    @property
    def envelope(self) -> Array:
        """The range of X in consecutive pieces of the run: time, least and greatest X."""
        return np.hstack([np.empty((3, 0)), *self._envelopes])

    @property
    def end(self) -> tuple[Samples, Events]:
        """Motion and impacts at the end of the run."""
        samples = np.concatenate([NO_SAMPLES, *(samples for samples, _ in self._ends)])
        impacts = np.concatenate([NO_EVENTS, *(impacts for _, impacts in self._ends)])
        start = float(samples['time'].max(initial=-math.inf)) - self._span
        return samples[samples['time'] >= start], impacts[impacts['time'] >= start]
