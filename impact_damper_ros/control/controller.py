# SPDX-License-Identifier: Apache-2.0
"""The controller: from samples and crossing instants to commands for the stops."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from math import inf, nan, ulp
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.rig import GAP_CONTROL_SPECS, GapControlParameters, RigParameters
from impact_damper_ros.rig.compiled import kernel, packed_rows, unpack
from impact_damper_ros.rig.event import Log
from impact_damper_ros.rig.flight import Lines, Waves
from impact_damper_ros.rig.state import RigConstants, Run, Wave

from .actuator import Actuators, Command, order_stops, settle_stops
from .amplitude_law import AmplitudeLaw, amplitude_law_crosses, clear_amplitude_law
from .law import Search, clear_search, damper_of, search_anew, search_missed, search_sample
from .own_law import MEMORY, OwnLaw, Refusal, compiled_law, own_law_acts
from .predictive_law import predictive_law_crosses
from .sensors import (
    DROPOUT,
    FROZEN,
    SENSOR_FAULTS,
    Measurement,
    Observer,
    clear_observer,
    fault_shift,
    forget_hits,
    is_too_soon,
    mixed_seed,
    note_crossing,
    observe_sample,
    rounded,
    sensor_noise,
)
from .state import as_stored, read_stored
from .timed_law import TimedLaw, clear_timed_law, timed_law_crosses, timed_law_sees

#: Number of each law.
LAW_NUMBERS = {str(name): k for k, name in enumerate(GAP_CONTROL_SPECS['gap_control'].choices)}
#: Number of a law of the user's own.
_OWN = len(LAW_NUMBERS)


class ControlSettings(NamedTuple):
    """
    Parameters of the control, and what it knows of the rig; see `GapControlParameters`.

    Attributes
    ----------
    law : int
        Number of the law, of `LAW_NUMBERS` or that of a user's own; 0 if the control is off.
    independent : bool
        Whether each stop has a place of its own.
    gain, park, lead, timing_gain, horizon, smoothing, threshold, gap_min, gap_max : float
        Parameters of the laws.
    rate, noise_position, noise_velocity, resolution_position, resolution_velocity : float
        Of the sensors.
    sensor_fault, fault_size : int, float
        Their fault, of `SENSOR_FAULTS`, and by how much it changes a position, m.
    seed : int
        Of their noise, mixed.
    delay, speed : float
        Of the actuators; the speed is infinite for stops that move at once.
    start_energy : float
        What an actuator spends on a start of its stop, J.
    pace : float
        Share of the speed that an actuator has; below 1 with a fault.
    blocked_1, blocked_2 : bool
        Whether a fault keeps the actuator of a stop from starting a movement.
    half_gap : float
        Half of the gap to which the stops return, m.
    one_sided : bool
        Whether stop 2 is absent.
    mass_ratio, restitution, rebound, push : float
        Of the `Damper`.
    """

    law: int
    independent: bool
    gain: float
    park: float
    lead: float
    timing_gain: float
    horizon: float
    smoothing: float
    threshold: float
    gap_min: float
    gap_max: float
    rate: float
    noise_position: float
    noise_velocity: float
    resolution_position: float
    resolution_velocity: float
    sensor_fault: int
    fault_size: float
    seed: int
    delay: float
    speed: float
    start_energy: float
    pace: float
    blocked_1: bool
    blocked_2: bool
    half_gap: float
    one_sided: bool
    mass_ratio: float
    restitution: float
    rebound: float
    push: float

    @classmethod
    def of(
        cls, p: GapControlParameters, rig: RigParameters, *, own: bool = False
    ) -> ControlSettings:
        """Return the settings of a control of a rig; a law of the user's `own` is in place."""
        law = _OWN if own and p.active else LAW_NUMBERS[p.gap_control]
        speed, seed = p.actuator_speed or inf, mixed_seed(p.gap_control_seed)
        return cls(
            law=law,
            independent=p.independent,
            speed=speed,
            seed=seed,
            sensor_fault=SENSOR_FAULTS[p.sensor_fault],
            pace=0.1 if p.actuator_fault == 'slow' else 1.0,
            blocked_1=p.actuator_fault in ('stuck', 'stop_2_only'),
            blocked_2=p.actuator_fault in ('stuck', 'stop_1_only'),
            **settings_fields(p, rig),
        )


def settings_fields(p: Any, rig: Any) -> dict[str, Any]:
    """Return the other fields of `ControlSettings`, of one control and rig, or many as arrays."""
    damper = damper_of(rig)
    return {
        'gain': p.gap_control_gain,
        'park': p.gap_control_park,
        'lead': p.gap_control_lead,
        'timing_gain': p.gap_control_timing_gain,
        'horizon': p.gap_control_horizon,
        'smoothing': p.gap_control_smoothing,
        'threshold': p.gap_control_threshold,
        'gap_min': p.gap_min,
        'gap_max': p.gap_max,
        'rate': p.gap_control_rate,
        'noise_position': p.gap_control_noise_position,
        'noise_velocity': p.gap_control_noise_velocity,
        'resolution_position': p.gap_control_resolution_position,
        'resolution_velocity': p.gap_control_resolution_velocity,
        'fault_size': p.sensor_fault_size,
        'delay': p.actuator_delay,
        'start_energy': 0.5 * p.actuator_mass * p.actuator_speed**2,
        'half_gap': 0.5 * rig.gap,
        'one_sided': rig.one_sided,
        'mass_ratio': damper.mass_ratio,
        'restitution': damper.restitution,
        'rebound': damper.rebound,
        'push': damper.push,
    }


@dataclass(slots=True)
class Controller:
    """
    State of the controller itself.

    Attributes
    ----------
    sample_index : int
        Index of the next sample; sample k is taken at k over the rate.
    trigger_index : int
        Index of the next trigger of the crossing detector.
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


@kernel
def clear_controller(controller: Controller) -> None:
    """Reset the state to that at the start."""
    controller.sample_index = 0
    controller.trigger_index = 0
    controller.roused = False
    controller.returning = False


#: Rows for commands that wait, at first.
_ROWS = 8


class Control(NamedTuple):
    """
    The whole control: states that kernels change, and what they know.

    Attributes
    ----------
    controller : Controller
        State of the controller itself.
    observer : Observer
        Estimates from the samples.
    search : Search
        Where m is to be found.
    actuators : Actuators
        State of the actuators.
    commands : sequence of Command
        Commands that wait; see `actuator`.
    settings : ControlSettings
        The parameters.
    timing : AmplitudeLaw
        State of the amplitude law.
    timed : TimedLaw
        State of the timed law.
    refusal : Refusal
        What a law of the user's own returned last, if that was no place.
    memory : list of float
        Numbers that this law keeps.
    law : OwnLaw or None
        The law itself.
    start, trial : Run
        The present state, and one ahead, for the predictive law; with their waves.
    """

    controller: Controller
    observer: Observer
    search: Search
    actuators: Actuators
    commands: Any
    settings: ControlSettings
    timing: AmplitudeLaw
    timed: TimedLaw
    refusal: Refusal
    memory: Any
    law: Any
    start: Run
    start_waves: Waves
    trial: Run
    trial_waves: Waves

    @classmethod
    def of(cls, p: GapControlParameters, rig: RigParameters, law: OwnLaw | None = None) -> Control:
        """Return the control of a rig at the start, with the stops at the gap."""
        control = cls(
            controller=Controller(),
            commands=[Command() for _ in range(_ROWS)],
            settings=ControlSettings.of(p, rig, own=law is not None),
            refusal=Refusal(),
            memory=[0.0] * MEMORY,
            law=law,
            start=Run(),
            start_waves=[],
            trial=Run(),
            trial_waves=[],
            **{name: part() for name, part in PARTS.items()},
        )
        settle_stops(control)
        return control

    @property
    def waiting(self) -> list[Command]:
        """Commands that wait, in order."""
        rows, first = self.commands, self.actuators.first
        return [rows[(first + k) % len(rows)] for k in range(self.actuators.waiting)]

    def _with_waiting(self, rows: list[Command]) -> Control:
        """Return the same control with other commands, and as much room again."""
        empty = max(_ROWS, len(rows))
        self.actuators.first, self.actuators.waiting = 0, len(rows)
        return self._replace(commands=rows + [Command() for _ in range(empty)])

    def enlarged(self) -> Control:
        """Return the same control with more room for commands."""
        return self._with_waiting(self.waiting)

    def for_harmonics(self, count: int) -> Control:
        """Return the same control for a rig with so many harmonics."""
        return self._replace(
            start_waves=[Wave() for _ in range(count)], trial_waves=[Wave() for _ in range(count)]
        )

    def packed(self) -> Control:
        """Return a copy for compiled kernels: arrays with one row each, that of this control."""

        def one(part: Any) -> Any:
            return packed_rows([part], type(part))

        return self._replace(
            settings=one(self.settings),
            commands=packed_rows(self.commands, Command)[np.newaxis],
            memory=np.array([self.memory], float),
            law=compiled_law(self.law),
            start=one(self.start),
            start_waves=packed_rows(self.start_waves, Wave)[np.newaxis],
            trial=one(self.trial),
            trial_waves=packed_rows(self.trial_waves, Wave)[np.newaxis],
            **{name: one(part) for name, part in self.states().items()},
        )

    def unpacked(self, rows: Any) -> Control:
        """Return this control in the state of one that was `packed`."""
        for name, part in self.states().items():
            unpack(getattr(rows, name)[0], part)
        commands = [Command(*row) for row in rows.commands[0].tolist()]
        return self._replace(commands=commands, memory=rows.memory[0].tolist())

    def states(self) -> dict[str, Any]:
        """Return the states that kernels change."""
        return {name: getattr(self, name) for name in ('controller', *PARTS, 'refusal')}

    def copied(self) -> Control:
        """Return another control in the same state."""
        parts = {name: copy(part) for name, part in self.states().items()}
        return self._replace(
            commands=[copy(row) for row in self.commands], memory=self.memory.copy(), **parts
        ).for_harmonics(len(self.start_waves))

    def as_dict(self) -> dict[str, Any]:
        """Return the state as numbers, lists and dictionaries; JSON keeps it exactly."""
        stored: dict[str, Any] = {n: getattr(self.controller, n) for n in _OWN_FIELDS}
        stored |= {name: as_stored(getattr(self, name)) for name in PARTS}
        del stored['actuators']['first']
        stored['actuators']['waiting'] = list(map(as_stored, self.waiting))
        return stored

    def restored(self, stored: dict[str, Any]) -> Control:
        """Return a control in the state of an `as_dict`."""
        own = {name: stored[name] for name in _OWN_FIELDS}
        parts: dict[str, Any] = {n: read_stored(PARTS[n], stored[n]) for n in PARTS}
        rows = [read_stored(Command, row) for row in stored['actuators']['waiting']]
        return self._replace(controller=Controller(**own), **parts)._with_waiting(rows)

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

    def switched(self, settings: ControlSettings, time: float) -> Control:
        """Return the control that continues with other parameters."""
        old, control = self.settings, self._replace(settings=settings)
        if settings.law == 0:
            if old.law != 0:
                rest_stops(control, time)
            if control.controller.returning:
                control.begin(time)
            else:
                forget_all(control)
            return control
        observed = has_law(self) and has_law(control)
        if not observed:
            forget_all(control)
        if not observed or settings.rate != old.rate:
            control.begin(time)
        if (settings.law, settings.independent) != (old.law, old.independent):
            relearn_laws(control)
        return control

    def begin(self, time: float) -> None:
        """Begin to sample at the first sampling instant after the present time."""
        rate = self.settings.rate
        index = max(0, int(time * rate))
        # Late on, the spacing of floats is that of many samples.
        step = max(1, int(ulp(time) * rate))
        while index / rate <= time:
            index += step
        self.controller.sample_index = index


#: Fields of `Controller` that a snapshot holds.
_OWN_FIELDS = ('sample_index', 'trigger_index', 'roused', 'returning')
#: Parts of the state with an entry of their own in a snapshot, in that order.
PARTS: dict[str, type[Any]] = {
    'observer': Observer,
    'search': Search,
    'timing': AmplitudeLaw,
    'timed': TimedLaw,
    'actuators': Actuators,
}

_AMPLITUDE, _TIMED = LAW_NUMBERS['amplitude'], LAW_NUMBERS['timed']
_PREDICTIVE, _EXTERNAL = LAW_NUMBERS['predictive'], LAW_NUMBERS['external']


@kernel(inline=True)
def has_law(control: Control) -> bool:
    """Return whether a law acts on samples and passages of X."""
    return control.settings.law not in (0, _EXTERNAL)


@kernel(inline=True)
def is_blind(control: Control) -> bool:
    """Return whether the sensors give nothing."""
    return control.settings.sensor_fault == DROPOUT


@kernel(inline=True)
def law_sees(control: Control, seen: Measurement) -> None:
    """Let the law act on a sample of the grid."""
    if control.settings.law == _TIMED:
        next_grid = (control.controller.sample_index + 1) / control.settings.rate
        timed_law_sees(control, seen, next_grid)
    elif control.settings.law == _OWN:
        own_law_acts(control, seen, 0)


@kernel
def law_crosses(
    control: Control,
    seen: Measurement,
    rising: bool,
    rig: RigConstants,
    lines: Lines,
    run: Run,
    waves: Waves,
    log: Log,
) -> None:
    """Let the law act on a passage of X through zero, with the sample taken there."""
    if control.settings.law == _AMPLITUDE:
        amplitude_law_crosses(control, seen)
    elif control.settings.law == _TIMED:
        timed_law_crosses(control, seen)
    elif control.settings.law == _PREDICTIVE:
        predictive_law_crosses(control, seen, rig, lines, run, waves, log)
    elif control.settings.law == _OWN:
        own_law_acts(control, seen, 1 if rising else -1)


@kernel
def relearn_laws(control: Control) -> None:
    """Reset the states of the laws, not those of the actuators."""
    clear_search(control.search)
    clear_amplitude_law(control.timing)
    clear_timed_law(control.timed)
    for k in range(len(control.memory)):
        control.memory[k] = 0.0
    control.controller.roused = False


@kernel
def forget_all(control: Control) -> None:
    """Reset all but the actuators."""
    relearn_laws(control)
    clear_observer(control.observer)
    clear_controller(control.controller)


@kernel(inline=True)
def measured(
    settings: ControlSettings,
    observer: Observer,
    index: int,
    time: float,
    x: float,
    x_rate: float,
    y: float,
    y_rate: float,
    stop_1: float,
    stop_2: float,
) -> Measurement:
    """Return the sample of an index with what sensors add; places of m and stops are Y."""
    position = settings.noise_position
    velocity = settings.noise_velocity
    if position > 0.0 or velocity > 0.0:
        seed = settings.seed
        noise_x, noise_y, noise_x_rate, noise_y_rate = sensor_noise(
            seed, index, position, velocity
        )
        x += noise_x
        y += noise_y
        x_rate += noise_x_rate
        y_rate += noise_y_rate
    if settings.sensor_fault != 0:
        if settings.sensor_fault == FROZEN and observer.time == observer.time:
            x, x_rate, y, y_rate = observer.x, observer.x_rate, observer.y, observer.y_rate
        shift = fault_shift(settings.sensor_fault, settings.seed, index)
        x += settings.fault_size * shift
        y += settings.fault_size * shift
    x = rounded(x, settings.resolution_position)
    y = rounded(y, settings.resolution_position)
    x_rate = rounded(x_rate, settings.resolution_velocity)
    y_rate = rounded(y_rate, settings.resolution_velocity)
    return Measurement(time, x, x_rate, y, y_rate, stop_1, stop_2)


@kernel(inline=True)
def next_sample(control: Control) -> float:
    """Return when the next sample is due, s; infinity if none is taken."""
    controller: Controller = control.controller
    if not (has_law(control) or controller.returning):
        return inf
    return controller.sample_index / control.settings.rate


@kernel(inline=True)
def _take_in(control: Control, seen: Measurement) -> None:
    p = control.settings
    observe_sample(control.observer, seen, p.rebound, p.noise_velocity)
    search_sample(control.search, seen)


@kernel(inline=True)
def take_sample(control: Control, seen: Measurement) -> None:
    """Take a sample of the grid, and act on it."""
    _take_in(control, seen)
    if control.controller.roused:
        law_sees(control, seen)


@kernel(inline=True)
def end_sample(control: Control) -> None:
    """Go on to the next sample of the grid."""
    controller: Controller = control.controller
    controller.sample_index += 1
    if control.settings.law == 0 and not controller.returning:
        forget_all(control)


@kernel
def holds_off(control: Control, time: float) -> bool:
    """Return whether a trigger does not count: too soon after the last one, or not seen."""
    return is_blind(control) or is_too_soon(control.observer, time)


@kernel
def take_crossing(
    control: Control,
    seen: Measurement,
    rising: bool,
    rig: RigConstants,
    lines: Lines,
    run: Run,
    waves: Waves,
    log: Log,
) -> None:
    """
    Take a trigger of the crossing detector, with its sample, and act on it.

    The predictive law is given the rig and its run.
    """
    controller: Controller = control.controller
    observer: Observer = control.observer
    controller.trigger_index += 1
    _take_in(control, seen)
    whole = note_crossing(observer, seen.time, control.settings.smoothing)
    search_missed(control.search, observer)
    if whole and observer.amplitude > control.settings.threshold:
        controller.roused = True
        controller.returning = False
        law_crosses(control, seen, rising, rig, lines, run, waves, log)
    elif whole and controller.roused:
        rest_stops(control, seen.time)
    search_anew(control.search, rising)
    forget_hits(observer)


@kernel
def rest_stops(control: Control, time: float) -> None:
    """Send both stops back to the gap."""
    relearn_laws(control)
    actuators: Actuators = control.actuators
    half_gap = control.settings.half_gap
    if actuators.commanded_1 != half_gap or actuators.commanded_2 != -half_gap:
        order_stops(control, time, half_gap, -half_gap, nan)
        control.controller.returning = True


@kernel
def note_return(control: Control, stop_1: float, stop_2: float) -> None:
    """Note whether the stops are back at the gap, by their places."""
    actuators: Actuators = control.actuators
    half_gap = control.settings.half_gap
    away = stop_1 != half_gap or stop_2 != -half_gap
    control.controller.returning = actuators.waiting > 0 or away


@kernel
def trigger_number(control: Control) -> int:
    """Return the index of a crossing's sample: of its own, so that no noise is used twice."""
    return -1 - control.controller.trigger_index
