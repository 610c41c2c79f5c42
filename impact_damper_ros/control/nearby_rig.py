# SPDX-License-Identifier: Apache-2.0
"""
Rigs near a controlled one: its state as numbers, compared with that of another and displaced.

The future of a controlled rig depends on the motion, the stops and all that the controller holds.
Its numbers can be a little different in another rig. The rest (modes, decisions, what has been
seen at all) is the same or not, and two rigs are neighbours only if it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from impact_damper_ros.rig.event_budget import MOST_EVENTS, EndlessEventsError
from impact_damper_ros.rig.flight import move_to
from impact_damper_ros.rig.state import Wave

from .controller import PARTS
from .rig import Outcome, Rig
from .state import LENGTH, SPEED, TIME, Kinds

Array = npt.NDArray[np.float64]
#: Where a leaf of the state is: keys and indices.
_Path = tuple[str | int, ...]

#: What each number of the state is.
_KINDS: Kinds = {
    'x': LENGTH,
    'velocity': SPEED,
    'relative_velocity': SPEED,
    'clearance_1': LENGTH,
    'clearance_2': LENGTH,
    'stop_1': LENGTH,
    'stop_2': LENGTH,
    'target_1': LENGTH,
    'target_2': LENGTH,
    'stop_velocity_1': SPEED,
    'stop_velocity_2': SPEED,
    'chatter_left': TIME,
    **{name: kind for part in PARTS.values() for name, kind in part.KINDS.items()},
}
#: What is the same for all rigs of an instant, or nothing depends on.
_LEFT_OUT = (
    *('time', 'time_low', 'angles', 'side', 'force', 'energies'),
    *('searched', 'crossing_side', 'watched', 'crossing'),
)


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
        return np.array([self._of(place) for place in state.places])

    def _of(self, path: _Path) -> float:
        kind: str | tuple[str, ...] = ''
        for key in path:
            kind = kind[key] if isinstance(key, int) and isinstance(kind, tuple) else kind
            kind = _KINDS.get(key, kind) if isinstance(key, str) else kind
        if kind == LENGTH:
            return self.length
        return self.length * self.rate if kind == SPEED else 1.0 / self.rate


class RigState(NamedTuple):
    """
    The state of a rig under control at one instant.

    Attributes
    ----------
    numbers : ndarray, shape (n,)
        Its numbers, m, m/s and s.
    places : tuple
        Where in the state each of them is.
    rest : tuple
        All the rest of it.
    parts : dict
        The whole of it: origin of the motion, and state of the control, as in a snapshot.
    """

    numbers: Array
    places: tuple[_Path, ...]
    rest: tuple[tuple[_Path, Any], ...]
    parts: dict[str, Any]

    @property
    def mode(self) -> int:
        """The mode of the motion."""
        return int(dict(self.rest)['origin', 'mode'])

    def alike(self, other: RigState) -> bool:
        """Return whether another state differs in its numbers alone."""
        return self.places == other.places and self.rest == other.rest


def _leaves(node: Any, path: _Path = ()) -> Iterator[tuple[_Path, Any]]:
    """Yield every leaf of a state with where it is."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key not in _LEFT_OUT:
                yield from _leaves(value, (*path, key))
    elif isinstance(node, list | tuple):
        for index, value in enumerate(node):
            yield from _leaves(value, (*path, index))
    else:
        yield path, node


def _changed(node: Any, path: _Path, value: float) -> Any:
    """Return a state with another number at a place."""
    key, *rest = path
    if isinstance(node, dict):
        return {**node, key: _changed(node[key], tuple(rest), value) if rest else value}
    assert isinstance(key, int)
    entry = _changed(node[key], tuple(rest), value) if rest else value
    return [*node[:key], entry, *node[key + 1 :]]


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
        control, here = self._control, self.state()
        waves = [Wave(wave.angle, wave.sine_0, wave.cosine_0) for wave in self._waves]
        move_to(self._rig, self._lines, here.run, waves, self.time)
        origin = here._replace(angles=tuple(wave.angle for wave in waves)).as_dict()['origin']
        # What is known of the flight from there on begins anew.
        origin |= {'searched': 0.0, 'crossing_side': 0, 'watched': 0.0, 'crossing': None}
        parts = {'origin': origin, 'state': control.as_dict()}
        seen = parts
        if not control.timed.closed:
            # Left from the last stop that was closed
            timed = {k: v for k, v in parts['state']['timed'].items() if k != 'until'}
            seen = {**parts, 'state': {**parts['state'], 'timed': timed}}
        leaves = list(_leaves(seen))
        numbers = [(path, value) for path, value in leaves if isinstance(value, float)]
        return RigState(
            np.array([value for _, value in numbers]),
            tuple(path for path, _ in numbers),
            tuple((path, value) for path, value in leaves if not isinstance(value, float)),
            parts,
        )

    def at(self, state: RigState, numbers: Array) -> Self | None:
        """Return a rig with other numbers; None if m would pass a stop or slide backwards."""
        parts = state.parts
        for path, value in zip(state.places, numbers.tolist(), strict=True):
            parts = _changed(parts, path, value)
        origin, here = parts['origin'], dict(zip(state.places, state.numbers, strict=True))
        room = [origin['clearance_1'], origin['clearance_2'], origin['chatter_left']]
        turned = origin['relative_velocity'] * here['origin', 'relative_velocity'] < 0.0
        if min(r for r in room if r is not None) < 0.0 or (turned and self.parameters.friction):
            return None
        snapshot = self.snapshot()
        control = {**snapshot['gap_control'], 'state': parts['state']}
        changed = {**snapshot, 'origin': parts['origin'], 'gap_control': control}
        return self.restore(changed, compiled=self.compiled)
