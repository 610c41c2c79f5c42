"""The controller: from samples and crossing instants to commands for the stops."""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple, Self, TypeVar

from impact_damper_ros.rig import GapControlParameters

from .actuator import Actuators, Command
from .amplitude_law import AmplitudeLaw
from .law import Damper, Law, Plant, Search
from .sensors import Measurement, Observer
from .timed_law import TimedLaw

#: Joints of the topic `gap_control`.
CONTROL_JOINTS = ('stop_1', 'stop_2', 'primary')


class Action(IntEnum):
    """What a record is about."""

    #: A command started one or both stops.
    COMMAND = 1
    #: A stop reached its target.
    ARRIVED = 2
    #: A stop and m met; the stop stays there.
    TOUCHED = 3
    #: X passed through zero.
    CROSSING = 4


class ControlRecord(NamedTuple):
    """
    One instant of the control.

    Attributes
    ----------
    time : float
        The instant, s.
    action : Action
        What happened.
    target_1, target_2 : float
        Target of each stop, Y in m.
    amplitude : float
        Estimate of the amplitude of X, m.
    velocity_1, velocity_2 : float
        Velocity of each stop in M, m/s; 0 for one that moves at once.
    x_rate : float
        X' of the last sample, m/s.
    energy_1, energy_2 : float
        Energy spent by each actuator so far, J.
    """

    time: float
    action: Action
    target_1: float
    target_2: float
    amplitude: float
    velocity_1: float
    velocity_2: float
    x_rate: float
    energy_1: float
    energy_2: float

    @classmethod
    def of(cls, action: Action, time: float, actuators: Actuators, observer: Observer) -> Self:
        """Return the record of an action, as actuators and observer are after it."""
        target_1, target_2 = actuators.targets
        velocity_1, velocity_2 = actuators.velocities
        energy_1, energy_2 = actuators.energies
        return cls(
            time=time,
            action=action,
            target_1=target_1,
            target_2=target_2,
            amplitude=observer.amplitude,
            velocity_1=velocity_1,
            velocity_2=velocity_2,
            x_rate=observer.last[2] if observer.last else 0.0,
            energy_1=energy_1,
            energy_2=energy_2,
        )

    @property
    def frame_id(self) -> str:
        """Name of the action in the topic `gap_control`."""
        return self.action.name.lower()

    @property
    def numbers(self) -> tuple[tuple[float, float, float], ...]:
        """Positions, velocities and efforts of `CONTROL_JOINTS`, as in the topic."""
        return (
            (self.target_1, self.target_2, self.amplitude),
            (self.velocity_1, self.velocity_2, self.x_rate),
            (self.energy_1, self.energy_2, 0.0),
        )


#: The laws by the name that `gap_control` gives them: the field of `Controller` with their state.
LAWS = {'amplitude': 'timing', 'timed': 'timed'}

_Part = TypeVar('_Part')


@dataclass(slots=True)
class Controller:
    """
    State of the controller and its actuators; JSON keeps its `as_dict` exactly.

    Attributes
    ----------
    sample_index : int
        Index of the next sample; sample k is taken at k over the rate.
    trigger_index : int
        Index of the next trigger of the crossing detector.
    observer : Observer
        Estimates from the samples.
    search : Search
        Where m is to be found.
    timing : AmplitudeLaw
        State of the amplitude law.
    timed : TimedLaw
        State of the timed law.
    actuators : Actuators
        State of the actuators.
    roused : bool
        Whether the amplitude is beyond the threshold, so that the law moves the stops.
    returning : bool
        Whether the stops are on their way back to the gap.
    """

    sample_index: int = 0
    trigger_index: int = 0
    observer: Observer = field(default_factory=Observer)
    search: Search = field(default_factory=Search)
    timing: AmplitudeLaw = field(default_factory=AmplitudeLaw)
    timed: TimedLaw = field(default_factory=TimedLaw)
    actuators: Actuators = field(default_factory=Actuators)
    roused: bool = False
    returning: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the state as numbers, lists and dictionaries."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Controller:
        """Read a result of `as_dict`."""
        # A copy: the stored lists may be read again
        stored = deepcopy(stored)
        values = {}
        for name, part in cls().parts().items():
            values[name] = type(part)(**stored.pop(name))
        actuators: Actuators = values['actuators']
        actuators.waiting = [Command(*command) for command in actuators.waiting]
        controller = cls(**values)
        for name in ('sample_index', 'trigger_index', 'roused', 'returning'):
            setattr(controller, name, stored[name])
        return controller

    def parts(self) -> dict[str, Any]:
        """Return the parts that have a state of their own."""
        entries = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: value for name, value in entries.items() if is_dataclass(value)}

    @property
    def idles(self) -> bool:
        """Whether the actuators have nothing to do."""
        actuators = self.actuators
        return not (self.returning or actuators.waiting or any(actuators.velocities))

    def copied(self) -> Controller:
        """Return another controller in the same state."""
        return replace(self, **{name: _copied(part) for name, part in self.parts().items()})

    def idle(self) -> Controller:
        """Return a new controller with the actuators of this one."""
        return Controller(actuators=self.actuators)

    def switched(
        self, old: GapControlParameters, new: GapControlParameters, time: float, half_gap: float
    ) -> Controller:
        """Return the controller that continues with other parameters."""
        if not new.active:
            if old.active:
                self.rest(time, half_gap, new)
            if not self.returning:
                return self.idle()
            self.begin(new, time)
            return self
        controller = self if old.active else self.idle()
        if not old.active or new.gap_control_rate != old.gap_control_rate:
            controller.begin(new, time)
        laws = (old.gap_control, old.gap_control_stops), (new.gap_control, new.gap_control_stops)
        if laws[0] != laws[1]:
            controller.relearn()
        return controller

    def begin(self, p: GapControlParameters, time: float) -> None:
        """Begin to sample at the first sampling instant after the present time."""
        index = max(0, int(time * p.gap_control_rate))
        while index / p.gap_control_rate <= time:
            index += 1
        self.sample_index = index

    def relearn(self) -> None:
        """Reset the states of the laws, not those of the actuators."""
        self.search = Search()
        for name in LAWS.values():
            setattr(self, name, type(getattr(self, name))())
        self.roused = False

    def rest(self, time: float, half_gap: float, p: GapControlParameters) -> None:
        """Send both stops back to the gap."""
        self.relearn()
        if self.actuators.commanded != [half_gap, -half_gap]:
            self.actuators.order(time, half_gap, -half_gap, p)
            self.returning = True

    def send_back(
        self, time: float, stops: tuple[float, float], half_gap: float, p: GapControlParameters
    ) -> None:
        """Send stops that met m on their way back to the gap again, at a sampling instant."""
        actuators = self.actuators
        if actuators.waiting or actuators.velocities != [0.0, 0.0]:
            return
        goal = half_gap, -half_gap
        left = [b if a != b else None for a, b in zip(stops, goal, strict=True)]
        self.returning = left != [None, None]
        if self.returning:
            actuators.order(time, left[0], left[1], p)

    def see(self, sample: Measurement, damper: Damper, p: GapControlParameters) -> None:
        """Take a sample, and act on it."""
        self._take_in(sample, damper, p)
        if self.roused:
            self._law(p).see(sample, self._plant(damper, p))

    def _law(self, p: GapControlParameters) -> Law:
        """Return the law that moves the stops."""
        law: Law = getattr(self, LAWS[p.gap_control])
        return law

    def _plant(self, damper: Damper, p: GapControlParameters) -> Plant:
        next_sample = (self.sample_index + 1) / p.gap_control_rate
        return Plant(self.observer, self.search, self.actuators, damper, p, next_sample)

    def _take_in(self, sample: Measurement, damper: Damper, p: GapControlParameters) -> None:
        self.observer.see(sample, damper.rebound, p.gap_control_noise_velocity)
        self.search.see(sample)

    def cross(
        self,
        sample: Measurement,
        rising: bool,
        half_gap: float,
        damper: Damper,
        p: GapControlParameters,
    ) -> None:
        """Take a trigger of the crossing detector, with its sample, and act on it."""
        self.trigger_index += 1
        observer, time = self.observer, sample.time
        self._take_in(sample, damper, p)
        whole = observer.cross(time, p.gap_control_smoothing)
        self.search.cross(observer)
        if whole:
            if observer.amplitude <= p.gap_control_threshold:
                if self.roused:
                    self.rest(time, half_gap, p)
            else:
                self.roused, self.returning = True, False
                self._law(p).cross(sample, self._plant(damper, p))
        self.search.begin(rising)
        observer.forget_hits()


def _copied(part: _Part) -> _Part:
    """Return a copy of a part of the controller, with lists of its own."""
    new = copy(part)
    for entry in fields(part):  # type: ignore[arg-type]
        value = getattr(part, entry.name)
        if isinstance(value, list):
            setattr(new, entry.name, value.copy())
    return new
