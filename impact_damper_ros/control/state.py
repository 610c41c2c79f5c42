# SPDX-License-Identifier: Apache-2.0
"""
The records of the control: states and settings of sensors, laws, actuators and the controller.

Kernels change the states, which are dataclasses of numbers. A snapshot holds them `as_stored`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import nan, pi
from typing import Any, NamedTuple, TypeVar

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.records import copy_of, unpack
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.rig_parameters import RigParameters

S = TypeVar('S')


def as_stored(state: Any) -> dict[str, Any]:
    """Return a state as a snapshot holds it: None for NaN, which stands for an unknown number."""
    values = {field.name: getattr(state, field.name) for field in fields(state)}
    return {name: None if value != value else value for name, value in values.items()}


def read_stored(cls: type[S], stored: dict[str, Any]) -> S:
    """Read a result of `as_stored`; a TypeError if it has an entry that the class lacks."""
    return cls(**{name: nan if value is None else value for name, value in stored.items()})


class Measurement(NamedTuple):
    """
    One sample of the sensors.

    Attributes
    ----------
    time : float
        Its instant, s.
    x, x_rate : float
        X and its rate, m and m/s.
    y, y_rate : float
        Y, the place of m in M, and its rate.
    stop_1, stop_2 : float
        Positions of the stops from the encoders of the actuators, Y in m.
    """

    time: float
    x: float
    x_rate: float
    y: float
    y_rate: float
    stop_1: float
    stop_2: float

    @property
    def z(self) -> float:
        """Absolute position Z of m, m."""
        return self.x + self.y

    @property
    def z_rate(self) -> float:
        """Rate of Z, m/s."""
        return self.x_rate + self.y_rate


@dataclass(slots=True)
class Estimates:
    """
    Estimates from the samples so far.

    Attributes
    ----------
    amplitude : float
        Smoothed amplitude of X, m; 0 before the first whole half cycle.
    half_cycle : float
        Smoothed time from one passage of X through zero to the next, s; 0 if unknown.
    crossed : float
        Instant of the last passage, s; NaN before the first.
    peak : float
        Largest |X| sampled since then.
    time, x, x_rate, y, y_rate, stop_1, stop_2 : float
        The last sample; NaN before the first.
    hit_time_1, hit_time_2 : float
        Instant of the last impact at each stop since the last passage, s; NaN if there was none.
    hit_speed_1, hit_speed_2 : float
        Approach speed of that impact, m/s.
    """

    amplitude: float = 0.0
    half_cycle: float = 0.0
    crossed: float = nan
    peak: float = 0.0
    time: float = nan
    x: float = nan
    x_rate: float = nan
    y: float = nan
    y_rate: float = nan
    stop_1: float = nan
    stop_2: float = nan
    hit_time_1: float = nan
    hit_speed_1: float = nan
    hit_time_2: float = nan
    hit_speed_2: float = nan


@kernel
def gap_for_amplitude(
    amplitude: float, mass_ratio: float, restitution: float, largest: float
) -> float:
    """Return the gap at which two impacts per cycle are at X = 0; see `Damper.optimal_gap`."""
    loss = (1.0 - restitution) * (1.0 + mass_ratio)
    travel = pi * amplitude * (1.0 + restitution)
    return travel / loss if travel < largest * loss else largest


class Damper(NamedTuple):
    """
    What the laws know of the damper.

    Attributes
    ----------
    mass_ratio : float
        mu = m/M.
    restitution : float
        Mean R of both stops.
    """

    mass_ratio: float
    restitution: float

    @property
    def damper_jump(self) -> float:
        """Jump in Z' by an impact, over the approach speed."""
        return (1.0 + self.restitution) / (1.0 + self.mass_ratio)

    @property
    def primary_jump(self) -> float:
        """Jump in X' by an impact, over the approach speed."""
        return self.mass_ratio * self.damper_jump

    def optimal_gap(self, amplitude: float, largest: float) -> float:
        """
        Return the gap d* at which two impacts per cycle are at X = 0, where |X'| is largest.

        Where no gap does that, as for elastic stops, the largest gap is returned.

        Notes
        -----
        From equal flights between impacts at X = 0 without friction and weight, and momentum and
        restitution at each impact: d* = pi A (1 + R)/((1 - R)(1 + mu)).
        """
        return gap_for_amplitude(amplitude, self.mass_ratio, self.restitution, largest)


def damper_of(parameters: RigParameters) -> Damper:
    """Return the damper of a rig."""
    mean = 0.5 * (parameters.restitution_1 + parameters.restitution_2)
    return Damper(parameters.damper_mass / parameters.primary_mass, mean)


@dataclass(slots=True)
class Search:
    """
    State of the search for m.

    A gap that suits the amplitude is many times as wide as that amplitude. m crosses it only in
    the rhythm of its impacts; at rest, or held by friction, it would never reach a stop. A stop
    that has not been hit for some half cycles is therefore moved in to where m turns round.

    Attributes
    ----------
    missed_1, missed_2 : int
        Half cycles since the last impact on stop 1 and on stop 2.
    reach_1, reach_2 : float
        How far outwards m was sampled on each side since it could last have hit there, m.
    """

    missed_1: int = 0
    missed_2: int = 0
    reach_1: float = 0.0
    reach_2: float = 0.0


@dataclass(slots=True)
class WaitingCommand:
    """
    A command that waits: when it is due, s, and the targets, Y in m; NaN for none.

    The speed is a limit below that of the actuators, m/s; NaN for none.
    """

    time: float = nan
    stop_1: float = nan
    stop_2: float = nan
    speed: float = nan


@dataclass(slots=True)
class Actuators:
    """
    State of both actuators.

    Attributes
    ----------
    first, waiting : int
        Row of the next command, and number of commands to be carried out.
    target_1, target_2 : float
        Target of the last command to each stop that was carried out, Y in m.
    commanded_1, commanded_2 : float
        Target of the last command to each stop, Y in m.
    velocity_1, velocity_2 : float
        Velocity of each stop in M, m/s.
    energy_1, energy_2 : float
        Energy spent by each so far, J.
    """

    first: int = 0
    waiting: int = 0
    target_1: float = 0.0
    target_2: float = 0.0
    commanded_1: float = 0.0
    commanded_2: float = 0.0
    velocity_1: float = 0.0
    velocity_2: float = 0.0
    energy_1: float = 0.0
    energy_2: float = 0.0


@dataclass(slots=True)
class AmplitudeLaw:
    """
    State of the amplitude law: the places of independent stops.

    Attributes
    ----------
    place_1, place_2 : float
        Distance of stop 1 and of stop 2 from the middle, outwards, m; NaN before the first.
    amplitude : float
        Amplitude at the last passage, m.
    """

    place_1: float = nan
    place_2: float = nan
    amplitude: float = 0.0


@dataclass(slots=True)
class TimedLaw:
    """
    State of the law.

    Attributes
    ----------
    parked : float
        Distance of the parked stops from the middle, m; 0 before they are parked.
    aimed : bool
        Whether a stop has been ordered for the coming passage.
    closed : int
        The stop that is closed, or 0.
    until : float
        Instant at which the closed stop is to meet m, s.
    """

    parked: float = 0.0
    aimed: bool = False
    closed: int = 0
    until: float = 0.0


#: Numbers that a law may keep.
MEMORY = 16


@dataclass(slots=True)
class Refusal:
    """
    Invalid positions of stops that a law returned.

    Attributes
    ----------
    time : float
        Instant of the call, s; NaN if there was none.
    stop_1, stop_2 : float
        The result.
    """

    time: float = nan
    stop_1: float = nan
    stop_2: float = nan


#: Number of each law.
LAW_NUMBERS = {str(name): k for k, name in enumerate(GAP_CONTROL_SPECS['gap_control'].choices)}


#: Number of a law of the user's own.
OWN_LAW = len(LAW_NUMBERS)


class ControlSettings(NamedTuple):
    """
    Parameters of the control as in `GapControlParameters`, and what it knows of the rig.

    Attributes
    ----------
    law : int
        Number of the law, of `LAW_NUMBERS` or that of a user's own; 0 if the control is off.
    independent : bool
        Whether each stop has a place of its own.
    sensor_fault : int
        Number of the fault, by the order of `SENSOR_FAULTS`.
    seed : int
        Mixed seed of the noise of the sensors.
    speed : float
        Speed of the actuators, m/s; infinite for stops that move at once.
    pace : float
        Share of that speed which an actuator reaches; below 1 with a fault.
    blocked_1, blocked_2 : bool
        Whether a fault keeps the actuator of a stop from starting a movement.
    half_gap : float
        Half of the gap to which the stops return, m.
    one_sided : bool
        Whether stop 2 is absent.
    mass_ratio, restitution, damper_jump, primary_jump : float
        As in `Damper`.
    """

    law: int
    independent: bool
    gap_control_gain: float
    gap_control_park: float
    gap_control_lead: float
    gap_control_timing_gain: float
    gap_control_smoothing: float
    gap_control_threshold: float
    gap_min: float
    gap_max: float
    gap_control_rate: float
    gap_control_noise_position: float
    gap_control_noise_velocity: float
    gap_control_resolution_position: float
    gap_control_resolution_velocity: float
    sensor_fault: int
    sensor_fault_size: float
    seed: int
    actuator_delay: float
    speed: float
    actuator_mass: float
    pace: float
    blocked_1: bool
    blocked_2: bool
    half_gap: float
    one_sided: bool
    mass_ratio: float
    restitution: float
    damper_jump: float
    primary_jump: float


#: Fields that are parameters themselves.
_AS_GIVEN = tuple(
    name
    for name in ControlSettings._fields
    if name in GAP_CONTROL_SPECS and name != 'sensor_fault'
)


def settings_fields(p: Any, parameters: Any) -> dict[str, Any]:
    """Return the other fields of `ControlSettings`, of one control and rig, or many as arrays."""
    damper = damper_of(parameters)
    return {
        **{name: getattr(p, name) for name in _AS_GIVEN},
        'half_gap': 0.5 * parameters.gap,
        'one_sided': parameters.one_sided,
        'mass_ratio': damper.mass_ratio,
        'restitution': damper.restitution,
        'damper_jump': damper.damper_jump,
        'primary_jump': damper.primary_jump,
    }


@dataclass(slots=True)
class ControllerState:
    """
    State of the controller itself.

    Attributes
    ----------
    sample_index : int
        Index of the next sample; sample k is taken at k over the rate.
    trigger_index : int
        Index of the next passage of X through zero.
    roused : bool
        Whether the amplitude is beyond the threshold, so that the law moves the stops.
    returning : bool
        Whether the stops are on their way back to the gap.
    recorded, room : int
        Rows of the table of acts that are written, and all of them; 0 for no table.
    """

    sample_index: int = 0
    trigger_index: int = 0
    roused: bool = False
    returning: bool = False
    recorded: int = 0
    room: int = 0


#: Rows for commands that wait, at first.
ROWS_AT_FIRST = 8


#: Parts of the state with an entry of their own in a snapshot, in that order.
PARTS: dict[str, type[Any]] = {
    'estimates': Estimates,
    'search': Search,
    'amplitude_law': AmplitudeLaw,
    'timed_law': TimedLaw,
    'actuators': Actuators,
}


#: Fields of `ControllerState` that a snapshot holds.
_OWN_FIELDS = ('sample_index', 'trigger_index', 'roused', 'returning')


class Control(NamedTuple):
    """
    The whole control: the states that kernels change, and the settings.

    Attributes
    ----------
    controller : ControllerState
        State of the controller itself.
    estimates : Estimates
        Estimates from the samples.
    search : Search
        State of the search for m.
    actuators : Actuators
        State of the actuators.
    commands : sequence of WaitingCommand
        Commands that wait; see `actuator`.
    settings : ControlSettings
        The parameters.
    amplitude_law : AmplitudeLaw
        State of the amplitude law.
    timed_law : TimedLaw
        State of the timed law.
    refusal : Refusal
        The last result of a law of the user's own, if that was invalid.
    memory : list of float
        Numbers that a law of the user's own keeps.
    law : OwnLaw or None
        The law of the user's own.
    """

    controller: ControllerState
    estimates: Estimates
    search: Search
    actuators: Actuators
    commands: Any
    settings: ControlSettings
    amplitude_law: AmplitudeLaw
    timed_law: TimedLaw
    refusal: Refusal
    memory: Any
    law: Any

    @property
    def waiting(self) -> list[WaitingCommand]:
        """Commands that wait, in order."""
        rows, first = self.commands, self.actuators.first
        return [rows[(first + k) % len(rows)] for k in range(self.actuators.waiting)]

    def _with_waiting(self, rows: list[WaitingCommand]) -> Control:
        """Return the same control with other commands, and as much room again."""
        empty = max(ROWS_AT_FIRST, len(rows))
        self.actuators.first, self.actuators.waiting = 0, len(rows)
        return self._replace(commands=rows + [WaitingCommand() for _ in range(empty)])

    def with_more_room(self) -> Control:
        """Return the same control with more room for commands."""
        return self._with_waiting(self.waiting)

    def unpack(self, rows: Any) -> Control:
        """Return this control in the state of records that `pack` made."""
        for name, part in self.states().items():
            unpack(getattr(rows, name)[0], part)
        commands = [WaitingCommand(*row) for row in rows.commands[0].tolist()]
        return self._replace(commands=commands, memory=rows.memory[0].tolist())

    def states(self) -> dict[str, Any]:
        """Return the states that kernels change."""
        return {name: getattr(self, name) for name in ('controller', *PARTS, 'refusal')}

    def copy(self) -> Control:
        """Return the same control in a state of its own; rows without a command are shared."""
        rows, first = list(self.commands), self.actuators.first
        for k in range(first, first + self.actuators.waiting):
            rows[k % len(rows)] = copy_of(rows[k % len(rows)])
        states = {name: copy_of(state) for name, state in self.states().items()}
        return self._replace(commands=rows, memory=self.memory.copy(), **states)

    def as_dict(self) -> dict[str, Any]:
        """Return the state as numbers, lists and dictionaries; JSON keeps it exactly."""
        stored: dict[str, Any] = {n: getattr(self.controller, n) for n in _OWN_FIELDS}
        stored |= {name: as_stored(getattr(self, name)) for name in PARTS}
        del stored['actuators']['first']
        stored['actuators']['waiting'] = list(map(as_stored, self.waiting))
        return stored

    def restore(self, stored: dict[str, Any]) -> Control:
        """Return a control in the state of an `as_dict`."""
        own = {name: stored[name] for name in _OWN_FIELDS}
        parts: dict[str, Any] = {n: read_stored(PARTS[n], stored[n]) for n in PARTS}
        rows = [read_stored(WaitingCommand, row) for row in stored['actuators']['waiting']]
        return self._replace(controller=ControllerState(**own), **parts)._with_waiting(rows)

    @property
    def active(self) -> bool:
        """Whether a law moves the stops."""
        return self.settings.law != 0

    @property
    def idles(self) -> bool:
        """Whether the actuators have nothing to do."""
        actuators = self.actuators
        still = actuators.velocity_1 == 0.0 and actuators.velocity_2 == 0.0
        return still and not (self.controller.returning or actuators.waiting)
