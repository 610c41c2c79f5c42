# SPDX-License-Identifier: Apache-2.0
"""
Rigs near a controlled one: its state as numbers, compared with that of another and displaced.

The future of a controlled rig depends on the motion, the stops and all that the controller holds.
Its numbers can be a little different in another rig. The rest (modes, decisions, what has been
seen at all) is the same or not, and two rigs are neighbours only if it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import fields
from functools import cache
from math import inf, isfinite
from typing import Any, NamedTuple, Self, get_type_hints

import numpy as np
import numpy.typing as npt

from impact_damper_ros.rig.event_budget import MOST_EVENTS, EndlessEventsError
from impact_damper_ros.rig.flight import move_to
from impact_damper_ros.rig.state import STORED, Run, Wave

from .controller import PARTS, Control
from .rig import Outcome, Rig

Array = npt.NDArray[np.float64]
#: Whole numbers that say nothing of the future, or the same as other numbers of the state.
_LEFT_OUT = ('side', 'crossing_side', 'first', 'waiting', 'recorded', 'room')


class Scales(NamedTuple):
    """
    What makes the numbers of a state comparable.

    Attributes
    ----------
    length : float
        Size of the motion, m.
    rate : float
        Circular frequency, rad/s.
    """

    length: float
    rate: float

    def of(self, state: RigState) -> Array:
        """Return the scale of each number of a state."""
        sizes = {'length': self.length, 'speed': self.length * self.rate, 'time': 1.0 / self.rate}
        return np.array([sizes[kind] for kind in state.kinds])


class RigState(NamedTuple):
    """
    The state of a rig under control at one instant.

    Attributes
    ----------
    numbers : ndarray, shape (n,)
        Its numbers, m, m/s and s.
    kinds : tuple of str
        What each of them is: length, speed or time.
    places : tuple of (int, str)
        Where in the state each of them is: the part, 0 for the motion, and the name there.
    rest : tuple
        All the rest of it.
    run, control : Run, Control
        The whole of it.
    angles : tuple of float
        Angle that each harmonic has turned, rad.
    """

    numbers: Array
    kinds: tuple[str, ...]
    places: tuple[tuple[int, str], ...]
    rest: tuple[Any, ...]
    run: Run
    control: Control
    angles: tuple[float, ...]

    def alike(self, other: RigState) -> bool:
        """Return whether another state differs in its numbers alone."""
        return self.places == other.places and self.rest == other.rest


def _parts(run: Run, control: Control) -> list[Any]:
    """Return the parts of a state, the motion first."""
    states = [getattr(control, name) for name in PARTS]
    return [run, *states, *control.waiting, control.controller]


@cache
def _kinds(cls: Any) -> list[tuple[str, str]]:
    """Return name and kind of what counts in a part; what is no number has none."""
    hints = get_type_hints(cls, include_extras=True)
    names = STORED if cls is Run else [field.name for field in fields(cls)]
    kinds = [(name, *getattr(hints[name], '__metadata__', ('',))) for name in names]
    return [(n, k) for n, k in kinds if k or (hints[n] is not float and n not in _LEFT_OUT)]


def _values(parts: list[Any]) -> Iterator[tuple[tuple[int, str], str, Any]]:
    """Yield place, kind and value of all that counts in a state."""
    for index, part in enumerate(parts):
        for name, kind in _kinds(part.__class__):
            # Left from the last stop that was closed
            if name != 'until' or part.closed:
                yield (index, name), kind, getattr(part, name)


class NearbyRig(Rig):
    """A `Rig` whose state can be compared with that of another, and displaced."""

    def go_to(self, time: float) -> list[tuple[int, int]]:
        """
        Go on to a later time; return kinds and stops of the events, in which neighbours agree.

        Raises
        ------
        EndlessEventsError
            If there are too many of them.
        """
        result = self.run(time, most_events=MOST_EVENTS)
        if result.outcome is not Outcome.COMPLETE:
            raise EndlessEventsError(result.reason)
        return list(zip(result.events['kind'], result.events['stop'], strict=True))

    def go_between_samples(self) -> None:
        """Go on to the middle between two samples, away from what round-off decides."""
        rate, index = self.control.gap_control_rate, self._control.controller.sample_index
        if (index - 0.5) / rate <= self.time:
            index += 1
        self.go_to((index - 0.5) / rate)

    def numbers(self) -> RigState:
        """Return the state at the present time."""
        control, run = self._control.copied(), self.state().run
        waves = [Wave(wave.angle, wave.sine_0, wave.cosine_0) for wave in self._waves]
        move_to(self._rig, self._lines, run, waves, self.time)
        values = list(_values(_parts(run, control)))
        numbers = [entry for entry in values if entry[1] and isfinite(entry[2])]
        places, kinds, found = zip(*numbers, strict=True)
        known = set(places)
        rest = [(at, None if kind else v) for at, kind, v in values if at not in known]
        angles = tuple(wave.angle for wave in waves)
        return RigState(np.array(found), kinds, places, tuple(rest), run, control, angles)

    def at(self, state: RigState, numbers: Array) -> Self | None:
        """Return a rig with other numbers; None if m would pass a stop or slide backwards."""
        run, control = copy(state.run), state.control.copied()
        parts = _parts(run, control)
        for (index, name), value in zip(state.places, numbers.tolist(), strict=True):
            setattr(parts[index], name, value)
        turned = run.relative_velocity * state.run.relative_velocity < 0.0
        if min(run.clearance_1, run.clearance_2, run.chatter_left) < 0.0 or (
            turned and self.parameters.friction
        ):
            return None
        # What is known of the flight from here on begins anew.
        run.searched, run.crossing_side, run.watched, run.crossing = 0.0, 0, 0.0, inf
        there = self.state()._replace(run=run, angles=state.angles)
        rig = self.resume(there, self.snapshot()['gap_control'], compiled=self.compiled)
        rig._control = control
        return rig
