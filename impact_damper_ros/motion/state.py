# SPDX-License-Identifier: Apache-2.0
"""
The rig and its run as records: the constants of a rig, its harmonics, and its state.

A run is a sequence of flights: closed-form motions between two events. Its state is that at the
origin of the present flight, *after* the event that began it, with what is known of the flight's
end. `flight.begin_flight` derives all that is not in `STORED` from that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import lru_cache
from math import cos, inf, sin
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters, slowness

from .kernels import kernel
from .oscillator import Line, Oscillator, oscillators


class Mode(IntEnum):
    """
    How m moves relative to M.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> Rig(RigParameters(gravity=0.0)).mode is Mode.FREE
    True
    """

    #: Without friction, in either direction.
    FREE = 0
    #: Downwards relative to M, against friction.
    SLIDE_DOWN = 1
    #: Upwards relative to M, against friction.
    SLIDE_UP = 2
    #: Held by friction inside the gap.
    STICK = 3
    #: Resting on stop 1.
    REST_1 = 4
    #: Resting on stop 2.
    REST_2 = 5
    #: In the last bounces on stop 1 before rest, which are not resolved.
    CHATTER_1 = 6
    #: In the last bounces on stop 2 before rest, which are not resolved.
    CHATTER_2 = 7


#: The modes as numbers, for the kernels.
FREE, SLIDE_DOWN, SLIDE_UP, STICK, REST_1, REST_2, CHATTER_1, CHATTER_2 = map(int, Mode)


class RigConstants(NamedTuple):
    """
    Constants of a rig, as the kernels need them.

    Attributes
    ----------
    free, joint : Oscillator
        M alone, and M and m as one mass.
    harmonics : int
        Number of harmonics: those of `free` are the first rows of the lines, those of `joint`
        follow.
    mass_ratio, share, damper_mass, restitution_1, restitution_2 : float
        As in `RigParameters`; the share is m/(M + m).
    restitution_slowness, restitution_exponent : float
        Likewise; the slowness is 1/v_c, s/m, 0 for a constant R.
    slope, grip, air : float
        Accelerations g sin(angle), friction g cos(angle) and air_force/m, m/s^2.
    drive_bound : float
        Bound of the relative acceleration at rest, without spring and dashpot, m/s^2.
    half_gap : float
        Distance of each stop from the middle, m.
    one_sided : bool
        Whether stop 2 is absent.
    base_first, base_end : int
        Rows of the harmonics that are lines of the base: from the first one to before the end.
    """

    free: Oscillator
    joint: Oscillator
    harmonics: int
    mass_ratio: float
    share: float
    damper_mass: float
    restitution_1: float
    restitution_2: float
    restitution_slowness: float
    restitution_exponent: float
    slope: float
    grip: float
    air: float
    drive_bound: float
    half_gap: float
    one_sided: bool
    base_first: int
    base_end: int


@lru_cache(maxsize=64)
def _oscillators_of(
    mass: float, damper_mass: float, stiffness: float, damping: float, *force: tuple[float, ...]
) -> tuple[Oscillator, Oscillator, tuple[Line, ...]]:
    both, harmonics = oscillators(
        np.array([mass, mass + damper_mass]),
        np.full(2, stiffness),
        np.full(2, damping),
        *(np.array([values, values]) for values in force),
    )
    free, joint = map(Oscillator._make, both.tolist())
    return free, joint, tuple(map(Line._make, harmonics.reshape(-1).tolist()))


def rig_fields(p: Any, sine: Any, cosine: Any, forces: Any, base: slice) -> dict[str, Any]:
    """
    Return the fields of `RigConstants` but for oscillators, of one rig or of many as arrays.

    `p` has the parameters of `RigParameters`. The other arguments are sine and cosine of the
    angle, the sum of the moduli of the forces, and the rows of the base.
    """
    mass_ratio = p.damper_mass / p.primary_mass
    slope = p.gravity * sine
    grip = p.friction * p.gravity * cosine
    air = p.air_force / p.damper_mass
    most = forces / (p.primary_mass + p.damper_mass)
    return {
        'mass_ratio': mass_ratio,
        'share': mass_ratio / (1.0 + mass_ratio),
        'damper_mass': p.damper_mass,
        'restitution_1': p.restitution_1,
        'restitution_2': p.restitution_2,
        'restitution_slowness': slowness(p.restitution_speed),
        'restitution_exponent': p.restitution_exponent,
        'slope': slope,
        'grip': grip,
        'air': air,
        'drive_bound': (1.0 + mass_ratio) * (most + 2.0 * abs(slope) + air + grip),
        'half_gap': 0.5 * p.gap,
        'one_sided': p.one_sided,
        'base_first': base.start,
        'base_end': base.stop,
    }


@kernel(inline=True)
def incline(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle; the cosine of 90 degrees, which is rounded, is 0."""
    cosine = cos(angle)
    return sin(angle), 0.0 if cosine < 1e-5 else cosine


#: The numbers of a rig by name; amplitude, frequency and phase of each harmonic follow.
NUMBERS = (
    *('primary_mass', 'stiffness', 'damping', 'damper_mass', 'gap'),
    *('restitution_1', 'restitution_2', 'angle', 'friction', 'gravity', 'air_force'),
    *('restitution_slowness', 'restitution_exponent'),
)
#: Places of these numbers, and of the first harmonic.
MASS, STIFFNESS, DAMPING, DAMPER_MASS, GAP, RESTITUTION_1, RESTITUTION_2 = range(7)
ANGLE, FRICTION, GRAVITY, AIR_FORCE, SLOWNESS, EXPONENT = range(7, len(NUMBERS))
FIRST_LINE = len(NUMBERS)


@kernel
def set_contacts(constants: Any, rig: Sequence[float]) -> None:
    """Set the fields that `rig_fields` returns, for a rig without base, from `NUMBERS`."""
    ratio = rig[DAMPER_MASS] / rig[MASS]
    sine, cosine = incline(rig[ANGLE])
    most = 0.0
    for j in range(constants.harmonics):
        most += abs(rig[FIRST_LINE + 3 * j])
    constants.mass_ratio = ratio
    constants.share = ratio / (1.0 + ratio)
    constants.damper_mass = rig[DAMPER_MASS]
    constants.restitution_1 = rig[RESTITUTION_1]
    constants.restitution_2 = rig[RESTITUTION_2]
    constants.restitution_slowness = rig[SLOWNESS]
    constants.restitution_exponent = rig[EXPONENT]
    constants.slope = rig[GRAVITY] * sine
    constants.grip = rig[FRICTION] * rig[GRAVITY] * cosine
    constants.air = rig[AIR_FORCE] / rig[DAMPER_MASS]
    most /= rig[MASS] + rig[DAMPER_MASS]
    most += 2.0 * abs(constants.slope) + constants.air + constants.grip
    constants.drive_bound = (1.0 + ratio) * most
    constants.half_gap = 0.5 * rig[GAP]


def constants_of(parameters: RigParameters) -> tuple[RigConstants, list[Line]]:
    """Return a rig's constants and harmonics."""
    base = parameters.base_rows
    amplitudes, frequencies, phases = parameters.harmonics
    free, joint, lines = _oscillators_of(
        parameters.primary_mass,
        parameters.damper_mass,
        parameters.stiffness,
        parameters.damping,
        amplitudes,
        frequencies,
        phases,
    )
    most = sum(map(abs, amplitudes))
    fields = rig_fields(parameters, *incline(parameters.angle), most, base)
    rows = list(lines)
    if base.stop:
        columns = parameters.base_motion.columns(parameters.stiffness, parameters.damping)
        for row, sine, cosine in zip(range(base.start, base.stop), *columns, strict=True):
            rows[row] = rows[row]._replace(base_sine=sine, base_cosine=cosine)
    return RigConstants(free, joint, len(amplitudes), **fields), rows


@dataclass(slots=True)
class Wave:
    """
    State of one harmonic.

    Attributes
    ----------
    angle : float
        Angle turned since it was switched on, without its phase, mod 2 pi, at the origin.
    sine_0, cosine_0 : float
        Sine and cosine of its phase at the origin.
    sine, cosine : float
        Sine and cosine of the phase at the instant of the search.
    """

    angle: float = 0.0
    sine_0: float = 0.0
    cosine_0: float = 0.0
    sine: float = 0.0
    cosine: float = 0.0


@dataclass(slots=True)
class Run:
    """
    State of a run.

    Attributes
    ----------
    time, time_low : float
        Instant of the origin, s, as an unevaluated sum: a long run loses no digits.
    mode : int
        The mode that begins.
    x, velocity, relative_velocity : float
        X, X' and Y'.
    clearance_1, clearance_2 : float
        Distance of m from each stop, m; infinite for a stop that is not there.
    stop_1, stop_2 : float
        Position Y of each stop, m.
    last_stop : int
        Stop hit last, 0 before the first impact; the air force points away from it.
    released : bool
        The support has just given way: the relative acceleration is exactly zero.
    chatter_left : float
        Time until a chatter accumulates, s; 0 in other modes.
    target_1, target_2 : float
        Position Y to which each stop moves, as far as m lets it, m.
    speed_1, speed_2 : float
        Speed at which it does so, m/s; infinite for a stop that moves at once.
    stop_velocity_1, stop_velocity_2 : float
        Velocity of each stop that moves by itself, m/s. A stop at rest away from its target
        touches m, and follows it inwards.
    side : int
        Sign of X just after the origin, +1 or -1, where X is zero to round-off; else 0.
    force : float
        Active force on M, constant until the next command, N.
    now : float
        The present time, s.
    recorded_force : float
        Force of a measured record on M, constant until its next step, N.
    carried : bool
        Whether the base has moved by a measured record: X and X' are relative to it.
    base_acceleration : float
        Acceleration of that motion, constant until its next step, m/s^2.
    base_from, base_place, base_speed : float
        Instant of its last step, s, and its displacement and velocity then, m and m/s.
    searched : float
        Time since the origin up to which there is no event, s.

    joint : bool
        Whether both masses move as one.
    look : float
        Time since the origin at which the search tests whether joint motion lasts without end, s.
    first : int
        First row of the harmonics of the oscillator that moves.
    constant, acceleration, relative_acceleration : float
        Constant acceleration of M, and X'' and Y'' at the origin, m/s^2.
    direction : int
        +1 where m moves down relative to M, -1 up, 0 either.
    arrival : float
        Displacement of m at which the stop that follows it is at its target, m; else infinite.
    support_low, support_high : float
        Range of X'' in which m needs no more than its support, m/s^2.
    deadline, deadline_kind : float, int
        What ends the flight at the latest, s since the origin.

    kind, tau : int, float
        What ends the flight, and when since the origin, s; `NO_EVENT` before it is known.
    due : float
        Instant of that event, s; infinite before it is known.
    end_x, end_velocity, end_travel, end_relative_velocity : float
        X, X', Y - Y(origin) and Y' then.
    crossing_side : int
        Sign of X before its next passage through zero; 0 before the first look.
    watched : float
        Time since the origin that has been searched for passages, s.
    crossing : float
        Instant of the next passage, s; infinite before it is known.

    watch : bool
        Whether to report passages of X through zero.
    counted : float
        Time since the origin that is in the account of the modes, s.
    happened, most : int
        Transitions since the advance began, and the most of them.
    counted_from, in_period, most_in_period : float, int, int
        Since when events of a period of the fastest of spring and force are counted, s; how many
        there were, and the most of them.
    room, written : int
        Rows of the table of events, 0 for none, and how many of them are written.
    steps : int
        Steps of the search that are left before a pause.
    sampled : int
        Samples that have been taken in this run.
    sweep_due : float
        Instant of the next step of the stepped sine, s.
    force_step, base_step : int
        Which value of the measured force, and of the measured base, acts.
    """

    time: float = 0.0
    time_low: float = 0.0
    mode: int = STICK
    x: float = 0.0
    velocity: float = 0.0
    relative_velocity: float = 0.0
    clearance_1: float = 0.0
    clearance_2: float = 0.0
    stop_1: float = 0.0
    stop_2: float = 0.0
    last_stop: int = 0
    released: bool = False
    chatter_left: float = 0.0
    target_1: float = 0.0
    target_2: float = 0.0
    speed_1: float = inf
    speed_2: float = inf
    stop_velocity_1: float = 0.0
    stop_velocity_2: float = 0.0
    side: int = 0
    force: float = 0.0
    now: float = 0.0
    recorded_force: float = 0.0
    carried: bool = False
    base_acceleration: float = 0.0
    base_from: float = 0.0
    base_place: float = 0.0
    base_speed: float = 0.0
    searched: float = 0.0
    joint: bool = False
    look: float = 0.0
    first: int = 0
    constant: float = 0.0
    acceleration: float = 0.0
    relative_acceleration: float = 0.0
    direction: int = 0
    arrival: float = inf
    support_low: float = 0.0
    support_high: float = 0.0
    deadline: float = inf
    deadline_kind: int = 0
    kind: int = 0
    tau: float = 0.0
    due: float = inf
    end_x: float = 0.0
    end_velocity: float = 0.0
    end_travel: float = 0.0
    end_relative_velocity: float = 0.0
    crossing_side: int = 0
    watched: float = 0.0
    crossing: float = inf
    watch: bool = False
    counted: float = 0.0
    happened: int = 0
    most: int = 0
    counted_from: float = -inf
    in_period: int = 0
    most_in_period: int = 0
    room: int = 0
    written: int = 0
    steps: int = 0
    sampled: int = 0
    sweep_due: float = inf
    force_step: int = 0
    base_step: int = 0


Lines = Sequence[Line]
Waves = Sequence[Wave]


class Moving(NamedTuple):
    """
    A rig that moves: what all kernels of the motion need.

    Attributes
    ----------
    constants : RigConstants
        Its constants.
    lines : sequence of Line
        Constants of the harmonics, those of M alone first.
    run : Run
        Its state.
    waves : sequence of Wave
        State of each harmonic.
    log : sequence of EventRow
        The table into which events are written.
    """

    constants: RigConstants
    lines: Lines
    run: Run
    waves: Waves
    log: Sequence[Any]


def starting_fields(initial: InitialConditions, half_gap: Any, one_sided: bool) -> dict[str, Any]:
    """Return the fields of `Run` in which a start differs from the default, of one rig or many."""
    offset = initial.initial_damper_offset
    velocity = initial.initial_primary_velocity
    return {
        'x': initial.initial_primary_position,
        'velocity': velocity,
        'relative_velocity': initial.initial_damper_velocity - velocity,
        'clearance_1': half_gap - offset,
        'clearance_2': inf if one_sided else half_gap + offset,
        'stop_1': half_gap,
        'stop_2': -half_gap,
        'target_1': half_gap,
        'target_2': -half_gap,
    }


#: Fields of `Run` that a snapshot keeps of a rig on which a measured record acts.
RECORDED = (
    *('recorded_force', 'carried', 'base_acceleration'),
    *('base_from', 'base_place', 'base_speed'),
)
#: Fields of `Run` that a snapshot keeps: the state at the origin, and how far it is searched.
STORED = (
    *[field.name for field in fields(Run)][:21],
    *('searched', 'crossing_side', 'watched', 'crossing'),
)
#: Their types.
STORED_TYPES: dict[str, Any] = {n: t for n, t in get_type_hints(Run).items() if n in STORED}
RECORDED_TYPES: dict[str, Any] = {n: t for n, t in get_type_hints(Run).items() if n in RECORDED}


@kernel(inline=True)
def advance_time(time: float, time_low: float, tau: float) -> tuple[float, float]:
    """Add a duration to an instant held as an unevaluated sum."""
    total = time + tau
    back = total - time
    low = time_low + ((time - (total - back)) + (tau - back))
    rounded = total + low
    return rounded, low - (rounded - total)


@kernel(inline=True)
def offset_of(clearance_1: float, clearance_2: float, stop_1: float, stop_2: float) -> float:
    """Return Y from the clearances and positions of the stops, by the nearer one, m."""
    return stop_1 - clearance_1 if clearance_1 <= clearance_2 else stop_2 + clearance_2


@kernel(inline=True)
def carried_to(run: Run, time: float) -> tuple[float, float]:
    """Return where a measured record has carried the base by an instant, and its velocity."""
    since = time - run.base_from
    speed = run.base_speed + run.base_acceleration * since
    return run.base_place + 0.5 * (run.base_speed + speed) * since, speed


@kernel(inline=True)
def place(run: Run) -> float:
    """Return Y at the origin, m."""
    return offset_of(run.clearance_1, run.clearance_2, run.stop_1, run.stop_2)


@kernel(inline=True)
def on_stop_1(run: Run) -> bool:
    """Return whether m touches stop 1 and that stop does not move."""
    return run.clearance_1 == 0.0 and run.stop_velocity_1 == 0.0


@kernel(inline=True)
def on_stop_2(run: Run) -> bool:
    """Return whether m touches stop 2 and that stop does not move."""
    return run.clearance_2 == 0.0 and run.stop_velocity_2 == 0.0


@kernel(inline=True)
def stop_under(mode: int) -> int:
    """Return the stop on which m rests or ends its chatter; 0 for none."""
    if mode in (REST_1, CHATTER_1):
        return 1
    return 2 if mode in (REST_2, CHATTER_2) else 0
