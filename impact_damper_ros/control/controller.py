# SPDX-License-Identifier: Apache-2.0
"""The controller: from samples and passages of X through zero to commands for the stops."""

from __future__ import annotations

from math import inf, nan, ulp
from typing import Any

import numpy as np

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.records import pack_rows
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .actuator import order_stops, settle_stops
from .amplitude_law import amplitude_law_crosses, clear_amplitude_law
from .law import clear_search, search_anew, search_missed, search_sample
from .own_law import OwnLaw, compiled_law, own_law_acts
from .sensors import (
    DROPOUT,
    FROZEN,
    SENSOR_FAULTS,
    clear_estimates,
    fault_shift,
    forget_hits,
    is_too_soon,
    mixed_seed,
    note_passage,
    observe_sample,
    quantised_value,
    sensor_noise,
)
from .state import (
    LAW_NUMBERS,
    MEMORY,
    OWN_LAW,
    PARTS,
    ROWS_AT_FIRST,
    Actuators,
    Control,
    ControllerState,
    ControlSettings,
    Estimates,
    Measurement,
    Refusal,
    WaitingCommand,
    settings_fields,
)
from .timed_law import clear_timed_law, timed_law_crosses, timed_law_sees


def settings_of(
    p: GapControlParameters, parameters: RigParameters, *, own: bool = False
) -> ControlSettings:
    """Return the settings of a control of a rig; a law of the user's `own` is in place."""
    law = OWN_LAW if own and p.active else LAW_NUMBERS[p.gap_control]
    speed, seed = p.actuator_speed or inf, mixed_seed(p.gap_control_seed)
    return ControlSettings(
        law=law,
        independent=p.independent,
        speed=speed,
        seed=seed,
        sensor_fault=SENSOR_FAULTS[p.sensor_fault],
        pace=0.1 if p.actuator_fault == 'slow' else 1.0,
        blocked_1=p.actuator_fault in ('stuck', 'stop_2_only'),
        blocked_2=p.actuator_fault in ('stuck', 'stop_1_only'),
        **settings_fields(p, parameters),
    )


def control_of(
    p: GapControlParameters, parameters: RigParameters, law: OwnLaw | None = None
) -> Control:
    """Return the control of a rig at the start, with the stops at the gap."""
    control = Control(
        controller=ControllerState(),
        commands=[WaitingCommand() for _ in range(ROWS_AT_FIRST)],
        settings=settings_of(p, parameters, own=law is not None),
        refusal=Refusal(),
        memory=[0.0] * MEMORY,
        law=law,
        **{name: part() for name, part in PARTS.items()},
    )
    settle_stops(control)
    return control


def packed_control(control: Control) -> Control:
    """Return a copy for compiled kernels: arrays with one row each, that of this control."""

    def one(part: Any) -> Any:
        return pack_rows([part], type(part))

    return control._replace(
        settings=one(control.settings),
        commands=pack_rows(control.commands, WaitingCommand)[np.newaxis],
        memory=np.array([control.memory], float),
        law=compiled_law(control.law),
        **{name: one(part) for name, part in control.states().items()},
    )


def with_new_settings(before: Control, settings: ControlSettings, time: float) -> Control:
    """Return the control that continues with other parameters."""
    old, control = before.settings, before._replace(settings=settings)
    if settings.law == 0:
        if old.law != 0:
            rest_stops(control, time)
        if control.controller.returning:
            begin_sampling(control, time)
        else:
            forget_all(control)
        return control
    observed = has_law(before) and has_law(control)
    if not observed:
        forget_all(control)
    if not observed or settings.gap_control_rate != old.gap_control_rate:
        begin_sampling(control, time)
    if (settings.law, settings.independent) != (old.law, old.independent):
        relearn_laws(control)
    return control


def begin_sampling(control: Control, time: float) -> None:
    """Begin to sample at the first sampling instant after the present time."""
    rate = control.settings.gap_control_rate
    index = max(0, int(time * rate))
    # At late times the spacing of floats is that of many samples.
    step = max(1, int(ulp(time) * rate))
    while index / rate <= time:
        index += step
    control.controller.sample_index = index


@kernel
def clear_controller(controller: ControllerState) -> None:
    """Reset the state to that at the start."""
    controller.sample_index = 0
    controller.trigger_index = 0
    controller.roused = False
    controller.returning = False


_AMPLITUDE, _TIMED = LAW_NUMBERS['amplitude'], LAW_NUMBERS['timed']
_EXTERNAL = LAW_NUMBERS['external']


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
        next_grid = (control.controller.sample_index + 1) / control.settings.gap_control_rate
        timed_law_sees(control, seen, next_grid)
    elif control.settings.law == OWN_LAW:
        own_law_acts(control, seen, 0)


@kernel
def law_crosses(control: Control, seen: Measurement, rising: bool) -> None:
    """Let the law act on a passage of X through zero, with the sample taken there."""
    if control.settings.law == _AMPLITUDE:
        amplitude_law_crosses(control, seen)
    elif control.settings.law == _TIMED:
        timed_law_crosses(control, seen)
    elif control.settings.law == OWN_LAW:
        own_law_acts(control, seen, 1 if rising else -1)


@kernel
def relearn_laws(control: Control) -> None:
    """Reset the states of the laws, not those of the actuators."""
    clear_search(control.search)
    clear_amplitude_law(control.amplitude_law)
    clear_timed_law(control.timed_law)
    for k in range(len(control.memory)):
        control.memory[k] = 0.0
    control.controller.roused = False


@kernel
def forget_all(control: Control) -> None:
    """Reset all but the actuators."""
    relearn_laws(control)
    clear_estimates(control.estimates)
    clear_controller(control.controller)


@kernel(inline=True)
def sensor_sample(
    settings: ControlSettings,
    estimates: Estimates,
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
    position = settings.gap_control_noise_position
    velocity = settings.gap_control_noise_velocity
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
        if settings.sensor_fault == FROZEN and estimates.time == estimates.time:
            x, x_rate, y, y_rate = estimates.x, estimates.x_rate, estimates.y, estimates.y_rate
        shift = fault_shift(settings.sensor_fault, settings.seed, index)
        x += settings.sensor_fault_size * shift
        y += settings.sensor_fault_size * shift
    x = quantised_value(x, settings.gap_control_resolution_position)
    y = quantised_value(y, settings.gap_control_resolution_position)
    x_rate = quantised_value(x_rate, settings.gap_control_resolution_velocity)
    y_rate = quantised_value(y_rate, settings.gap_control_resolution_velocity)
    return Measurement(time, x, x_rate, y, y_rate, stop_1, stop_2)


@kernel(inline=True)
def next_sample(control: Control) -> float:
    """Return when the next sample is due, s; infinity if none is taken."""
    controller: ControllerState = control.controller
    if not (has_law(control) or controller.returning):
        return inf
    return controller.sample_index / control.settings.gap_control_rate


@kernel(inline=True)
def _take_in(control: Control, seen: Measurement) -> None:
    p = control.settings
    observe_sample(control.estimates, seen, p.damper_jump, p.gap_control_noise_velocity)
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
    controller: ControllerState = control.controller
    controller.sample_index += 1
    if control.settings.law == 0 and not controller.returning:
        forget_all(control)


@kernel
def is_ignored(control: Control, time: float) -> bool:
    """Return whether a passage does not count: too soon after the last one, or not detected."""
    return is_blind(control) or is_too_soon(control.estimates, time)


@kernel
def take_passage(control: Control, seen: Measurement, rising: bool) -> None:
    """Take a passage of X through zero, with the sample of that instant, and act on it."""
    controller: ControllerState = control.controller
    estimates: Estimates = control.estimates
    controller.trigger_index += 1
    _take_in(control, seen)
    whole = note_passage(estimates, seen.time, control.settings.gap_control_smoothing)
    search_missed(control.search, estimates)
    if whole and estimates.amplitude > control.settings.gap_control_threshold:
        controller.roused = True
        controller.returning = False
        law_crosses(control, seen, rising)
    elif whole and controller.roused:
        rest_stops(control, seen.time)
    search_anew(control.search, rising)
    forget_hits(estimates)


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
def passage_index(control: Control) -> int:
    """Return the index of the sample at a passage: below 0, so that no noise is used twice."""
    return -1 - control.controller.trigger_index
