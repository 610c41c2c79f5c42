"""
The rig under gap control: the simulator with sensors, controller and actuators; and rigs near it.

With the control off it is the simulator, bit for bit. Samples lie on the grid k/rate, crossings
and the starts of stops at their own exact instants, so that the motion does not depend on how a
run is cut into pieces here either.

What the future of a controlled rig depends on is the motion, the stops, and all that the
controller holds: its last sample, what it has estimated and learnt, the commands that wait. Some
of that are numbers, which can be a little different in another rig; the rest (modes, decisions,
what has been seen at all) is the same or it is not, and two rigs are neighbours only if it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from impact_damper_ros.rig import (
    Event,
    EventKind,
    GapControlParameters,
    InitialConditions,
    Mode,
    RigParameters,
    Sample,
    Simulator,
)
from impact_damper_ros.rig.simulator import Snapshot

from .controller import Action, Controller, ControlRecord
from .law import damper_of
from .sensors import measured

__all__ = ['ControlledRig', 'NearbyRig', 'RigState', 'Scales', 'completed']


_ACTIONS = {EventKind.STOP_ARRIVED: Action.ARRIVED, EventKind.STOP_TOUCHED: Action.TOUCHED}


def completed(snapshot: dict[str, Any]) -> dict[str, Any]:
    """Return a snapshot with the state of the control, off if it has none: an older one."""
    if 'gap_control' in snapshot:
        return snapshot
    return {**snapshot, 'gap_control': ControlledRig.restore(snapshot).snapshot()['gap_control']}


class ControlledRig:
    """
    A rig and its gap control; used as a `Simulator`.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts.
    time : float, optional
        Time at the start, s.
    control : GapControlParameters, optional
        The control; off, if not given.

    Raises
    ------
    ParameterError
        If m would not start between the stops.

    Examples
    --------
    >>> from impact_damper_ros.rig import RigParameters
    >>> rig = ControlledRig(
    ...     RigParameters(gravity=0.0),
    ...     control=GapControlParameters(gap_control='timed', gap_control_rate=5.0),
    ... )
    >>> events = rig.advance(900.0)
    >>> round(rig.amplitude, 1), rig.parameters.response_amplitude
    (2.7, 100.0)
    """

    #: What runs the rig itself.
    _simulator: type[Simulator] = Simulator

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
        control: GapControlParameters | None = None,
    ) -> None:
        """Start the rig."""
        self._rig = self._simulator(parameters, initial, time)
        self._control = control or GapControlParameters()
        self._records: list[ControlRecord] = []
        self._start()

    def _start(self) -> None:
        self._controller = Controller()
        self._controller.actuators.settle(self._half_gap)
        if self._control.active:
            self._controller.begin(self._control, self._rig.time)
        self._describe()

    def _describe(self) -> None:
        self._damper = damper_of(self._rig.parameters)

    @property
    def _half_gap(self) -> float:
        return 0.5 * self._rig.parameters.gap

    @property
    def time(self) -> float:
        """Time reached, s."""
        return self._rig.time

    @property
    def parameters(self) -> RigParameters:
        """The rig's present parameters."""
        return self._rig.parameters

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the control."""
        return self._control

    @property
    def mode(self) -> Mode:
        """Present mode, after any event at the present time."""
        return self._rig.mode

    @property
    def stops(self) -> tuple[float, float]:
        """Present positions Y of stop 1 and stop 2, m."""
        return self._rig.stops

    @property
    def amplitude(self) -> float:
        """The controller's estimate of the amplitude of X, m."""
        return self._controller.observer.amplitude

    @property
    def energies(self) -> tuple[float, float]:
        """Energy spent by the actuator of each stop since the start or the last reset, J."""
        energies = self._controller.actuators.energies
        return energies[0], energies[1]

    @property
    def records(self) -> list[ControlRecord]:
        """What the control did during the last call of `advance`, `change` or `reset`."""
        return self._records

    @property
    def plain(self) -> Snapshot | None:
        """State of the rig while no control watches or moves it; None if one does."""
        controller = self._controller
        if self._control.active or controller.returning or controller.actuators.due is not None:
            return None
        return self._rig.state()

    def gone_on(self, rig: Simulator) -> None:
        """Take over where another simulator has brought the `plain` rig."""
        self._rig, self._records = rig, []

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        return self._rig.sample()

    def preview(
        self, times: Sequence[float], interrupted: Callable[[], bool] | None = None
    ) -> list[Sample]:
        """Return the motion at later instants, as `Simulator.preview` does; none under control."""
        return [] if self.plain is None else self._rig.preview(times, interrupted)

    def mark(self) -> tuple[dict[str, Any], Controller]:
        """Return what `go_back` takes rig and control back to, as `Simulator.mark` does."""
        controller = self._controller
        if self._control.active or not controller.idles:
            controller = controller.copied()
        return self._rig.mark(), controller

    def go_back(self, mark: tuple[dict[str, Any], Controller]) -> None:
        """Undo all that `advance` did since a mark; each may be used once."""
        state, self._controller = mark
        self._rig.go_back(state)
        self._records = []

    def advance(
        self,
        time: float,
        most_events: float = inf,
        interrupted: Callable[[], bool] | None = None,
    ) -> list[Event]:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s; not before the present one.
        most_events : float, optional
            After about so many events the rig stops, at an event, if more are due before that
            time; it may go on from there.
        interrupted : callable, optional
            Called now and then; once it returns true, the rig stops, as of `Simulator.advance`.

        Returns
        -------
        list of Event
            All events after the present time up to and including the new one; under control also
            the passages of X through zero, and what the stops do.

        Raises
        ------
        ValueError
            If the time is before the present one or not finite.
        RunawayError
            If the rig has events without end at one instant; `go_back` leads out of it.
        """
        self._records = []
        rig = self._rig
        if not rig.time <= time < inf:
            return rig.advance(time)
        events: list[Event] = []
        while True:
            controller, active = self._controller, self._control.active
            command, sample = controller.actuators.due, inf
            if active or controller.returning:
                sample = controller.sample_index / self._control.gap_control_rate
            # A command may have become due in the past, where the delay has been shortened.
            until = max(rig.time, min(inf if command is None else command, sample, time))
            run = rig.advance_to_crossing if active else rig.advance
            new = run(until, most_events - len(events), interrupted)
            events += self._noted(new)
            if new and new[-1].kind is EventKind.CROSSING:
                self._cross(new[-1])
            elif rig.time < until:
                return events
            elif command is not None and command <= until:
                events += self._carry_out()
            elif sample <= until:
                self._look()
            else:
                return events
            if interrupted is not None and rig.time < time and interrupted():
                return events

    def _cross(self, event: Event) -> None:
        controller = self._controller
        if controller.observer.holds_off(event.time):
            return
        rising = event.primary_velocity_after > 0.0
        # Indices of their own, so that no noise is used twice
        sample = measured(self._rig.sample(), -1 - controller.trigger_index, self._control)
        controller.cross(sample, rising, self._half_gap, self._damper, self._control)
        self._record(Action.CROSSING, event.time)

    def _look(self) -> None:
        """Sample, and act on it."""
        controller, control, rig = self._controller, self._control, self._rig
        if control.active:
            sample = measured(rig.sample(), controller.sample_index, control)
            controller.see(sample, self._damper, control)
        if controller.returning:
            controller.send_back(rig.time, rig.stops, self._half_gap, control)
        controller.sample_index += 1
        if not (control.active or controller.returning):
            self._controller = self._controller.idle()

    def _carry_out(self) -> list[Event]:
        """Carry out the command that is due."""
        rig, control = self._rig, self._control
        targets = self._controller.actuators.start(rig.stops, control)
        if rig.parameters.one_sided:
            targets = targets[0], None
        self._record(Action.COMMAND, rig.time)
        return self._noted(rig.move_stops(*targets, speed=control.actuator_speed or inf))

    def _noted(self, events: list[Event]) -> list[Event]:
        """Take note of stops that have come to a stand."""
        for event in events:
            action = _ACTIONS.get(event.kind)
            if action is not None:
                # Not the event's own Y, that of m: an encoder knows exactly where a stop arrives.
                targets = self._controller.actuators.targets
                arrived = action is Action.ARRIVED
                place = targets[event.stop - 1] if arrived else event.y
                self._controller.actuators.stopped(event.stop, place)
                self._record(action, event.time)
        return events

    def _record(self, action: Action, time: float) -> None:
        controller = self._controller
        record = ControlRecord.of(action, time, controller.actuators, controller.observer)
        # Stops that arrive together are told of once.
        if self._records[-1:] != [record]:
            self._records.append(record)

    def change(
        self, parameters: RigParameters, control: GapControlParameters | None = None
    ) -> list[Event]:
        """
        Let new parameters take effect at the present time, exactly.

        Parameters
        ----------
        parameters : RigParameters
            The new rig.
        control : GapControlParameters, optional
            The new control; as it was, if not given.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.

        Notes
        -----
        Another `gap` puts both stops there at once, as without control, and ends what they were
        about; a law that is on moves them on from there. The control switched off sends them back
        to the gap, by the actuators. Another law begins anew, with the amplitude known so far.
        """
        self._records = []
        before, old = self._rig.parameters, self._control
        events = self._rig.change(parameters)
        self._describe()
        if (parameters.gap, parameters.one_sided) != (before.gap, before.one_sided):
            self._controller.actuators.settle(self._half_gap)
            self._controller.relearn()
            self._controller.returning = False
            if old.active:
                self._record(Action.COMMAND, self._rig.time)
            else:
                self._controller = self._controller.idle()
        if control is not None and control != old:
            self._control = control
            self._controller = self._controller.switched(
                old, control, self._rig.time, self._half_gap
            )
        return events

    def reset(self, initial: InitialConditions | None = None) -> None:
        """
        Put the rig back to its initial conditions; the force starts anew, time goes on.

        Raises
        ------
        ParameterError
            If m would not start between the stops; the rig then runs on as before.
        """
        self._rig.reset(initial)
        self._records = []
        self._start()

    def snapshot(self) -> dict[str, Any]:
        """
        Return what the future of rig and control depends on.

        Returns
        -------
        dict
            The simulator's snapshot, and under `gap_control` that of the control; it goes through
            JSON without loss.
        """
        control = {
            'parameters': self._control.as_dict(),
            'state': self._controller.as_dict(),
        }
        return {**self._rig.snapshot(), 'gap_control': control}

    @classmethod
    def restore(cls, snapshot: dict[str, Any]) -> Self:
        """
        Continue from a snapshot, bit for bit; one of a plain `Simulator` has no control.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        rig = cls.__new__(cls)
        rig._rig = cls._simulator.restore(
            {k: v for k, v in snapshot.items() if k != 'gap_control'}
        )
        rig._records = []
        stored = snapshot.get('gap_control')
        if stored is None:
            rig._control = GapControlParameters()
            rig._start()
            return rig
        try:
            rig._control = GapControlParameters(**stored['parameters'])
            rig._controller = Controller.from_dict(stored['state'])
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f'snapshot is not complete: gap_control: {error}') from error
        rig._describe()
        return rig


Array = npt.NDArray[np.float64]
#: Where a leaf of the state is: keys and indices.
_Path = tuple[str | int, ...]

_LENGTH, _SPEED, _TIME = 'length', 'speed', 'time'
#: What each number of the state is; of a list by its index, where its entries differ.
_KINDS: dict[str, str | tuple[str, ...]] = {
    # Of the flight
    'x': _LENGTH,
    'velocity': _SPEED,
    'relative_velocity': _SPEED,
    'clearance_1': _LENGTH,
    'clearance_2': _LENGTH,
    'stop_1': _LENGTH,
    'stop_2': _LENGTH,
    'target_1': _LENGTH,
    'target_2': _LENGTH,
    'stop_velocity_1': _SPEED,
    'stop_velocity_2': _SPEED,
    'chatter_left': _TIME,
    # Of the controller
    'amplitude': _LENGTH,
    'half_cycle': _TIME,
    'crossed': _TIME,
    'peak': _LENGTH,
    'last': (_TIME, _LENGTH, _SPEED, _LENGTH, _SPEED, _LENGTH, _LENGTH),
    'hit_1': (_TIME, _SPEED),
    'hit_2': (_TIME, _SPEED),
    'reach': _LENGTH,
    'places': _LENGTH,
    'parked': _LENGTH,
    'until': _TIME,
    'waiting': (_TIME, _LENGTH, _LENGTH),
    'targets': _LENGTH,
    'commanded': _LENGTH,
    'velocities': _SPEED,
}
#: What is the same for all rigs of an instant, or nothing depends on.
_LEFT_OUT = ('time', 'time_low', 'angles', 'side', 'energies')


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
        if kind == _LENGTH:
            return self.length
        return self.length * self.rate if kind == _SPEED else 1.0 / self.rate


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
    """

    numbers: Array
    places: tuple[_Path, ...]
    rest: tuple[tuple[_Path, Any], ...]

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


class NearbyRig(ControlledRig):
    """A `ControlledRig` whose state can be compared with that of another, and displaced."""

    def _parts(self) -> dict[str, Any]:
        return {
            'origin': self._rig.state_here().as_dict()['origin'],
            'state': self._controller.as_dict(),
        }

    def go_between_samples(self) -> None:
        """Go on to the middle between two samples, away from what round-off decides."""
        rate, index = self.control.gap_control_rate, self._controller.sample_index
        if (index - 0.5) / rate <= self.time:
            index += 1
        self.advance((index - 0.5) / rate)

    def state(self) -> RigState:
        """Return the state at the present time."""
        parts = self._parts()
        if not self._controller.timed.closed:
            # Left from the last stop that was closed
            del parts['state']['timed']['until']
        leaves = list(_leaves(parts))
        numbers = [(path, value) for path, value in leaves if isinstance(value, float)]
        return RigState(
            np.array([value for _, value in numbers]),
            tuple(path for path, _ in numbers),
            tuple((path, value) for path, value in leaves if not isinstance(value, float)),
        )

    def at(self, state: RigState, numbers: Array) -> Self | None:
        """
        Return a rig that is alike but for its numbers.

        Parameters
        ----------
        state : RigState
            The present state.
        numbers : ndarray
            The numbers of the other one.

        Returns
        -------
        NearbyRig or None
            None if m would be beyond a stop, or would slide against its mode.
        """
        parts: dict[str, Any] = self._parts()
        for path, value in zip(state.places, numbers.tolist(), strict=True):
            parts = _changed(parts, path, value)
        origin, here = parts['origin'], dict(zip(state.places, state.numbers, strict=True))
        room = [origin['clearance_1'], origin['clearance_2'], origin['chatter_left']]
        turned = origin['relative_velocity'] * here['origin', 'relative_velocity'] < 0.0
        if min(r for r in room if r is not None) < 0.0 or (turned and self.parameters.friction):
            return None
        snapshot = self.snapshot()
        control = {**snapshot['gap_control'], 'state': parts['state']}
        return self.restore({**snapshot, 'origin': parts['origin'], 'gap_control': control})
