"""
Modes of the hybrid motion, and the flight of each.

Friction, air force and supports are constant within a mode, so that a mode is one closed-form
flight: Bapat (1995), equations (1)-(2), for sliding; joint motion of both masses for sticking in
the gap and for rest on a stop.
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, inf, sin
from typing import NamedTuple

from .flight import CONTACT_1, CONTACT_2, NO_EVENT, STOP_ARRIVED_1, STOP_ARRIVED_2, Flight
from .forcing import sines_and_cosines_of
from .kernels import kernel
from .origin import Origin
from .oscillator import Oscillator, acceleration_at, make_oscillator
from .parameters import RigParameters

FREE = 0
SLIDE_DOWN = 1
SLIDE_UP = 2
STICK = 3
REST_1 = 4
REST_2 = 5
CHATTER_1 = 6
CHATTER_2 = 7


class Mode(IntEnum):
    """How m moves relative to M."""

    #: Without friction, in either direction.
    FREE = FREE
    #: Downwards relative to M, against friction.
    SLIDE_DOWN = SLIDE_DOWN
    #: Upwards relative to M, against friction.
    SLIDE_UP = SLIDE_UP
    #: Held by friction inside the gap.
    STICK = STICK
    #: Resting on stop 1.
    REST_1 = REST_1
    #: Resting on stop 2.
    REST_2 = REST_2
    #: In the last bounces on stop 1 before rest, which are not resolved.
    CHATTER_1 = CHATTER_1
    #: In the last bounces on stop 2 before rest, which are not resolved.
    CHATTER_2 = CHATTER_2


class RigConstants(NamedTuple):
    """
    Constants of a rig, as the kernels need them.

    Attributes
    ----------
    free, joint : Oscillator
        M alone, and M and m as one mass.
    mass_ratio, restitution_1, restitution_2 : float
        As in `RigParameters`.
    slope, grip, air : float
        Accelerations g sin(angle), friction g cos(angle) and air_force/m, m/s^2.
    push : float
        Bound of the relative acceleration at rest, without spring and dashpot, m/s^2.
    stop : float
        Distance of each stop from the middle, half the gap, m.
    one_sided : bool
        Whether stop 2 is absent.
    phases : tuple of float
        Phases of the harmonics, rad.
    """

    free: Oscillator
    joint: Oscillator
    mass_ratio: float
    restitution_1: float
    restitution_2: float
    slope: float
    grip: float
    air: float
    push: float
    stop: float
    one_sided: bool
    phases: tuple[float, ...]


def rig_constants(parameters: RigParameters, frequency: float | None = None) -> RigConstants:
    """Return the kernels' constants of a rig."""
    amplitudes, frequencies, phases = parameters.harmonics
    if frequency is not None:
        frequencies = (frequency, *frequencies[1:])
    drive = (amplitudes, frequencies)
    spring = (parameters.stiffness, parameters.damping)
    together = parameters.primary_mass + parameters.damper_mass
    # At 90 degrees, as 1.5708 or as pi/2 rounded, there is no normal force.
    cosine = cos(parameters.angle)
    if cosine < 1e-5:
        cosine = 0.0
    mass_ratio = parameters.mass_ratio
    slope = parameters.gravity * sin(parameters.angle)
    grip = parameters.friction * parameters.gravity * cosine
    air = parameters.air_force / parameters.damper_mass
    forces = sum(map(abs, amplitudes)) / together
    return RigConstants(
        free=make_oscillator(parameters.primary_mass, *spring, *drive),
        joint=make_oscillator(together, *spring, *drive),
        mass_ratio=mass_ratio,
        restitution_1=parameters.restitution_1,
        restitution_2=parameters.restitution_2,
        slope=slope,
        grip=grip,
        air=air,
        push=(1.0 + mass_ratio) * (forces + 2.0 * abs(slope) + air + grip),
        stop=0.5 * parameters.gap,
        one_sided=parameters.one_sided,
        phases=phases,
    )


@kernel(inline=True)
def air_acceleration(rig: RigConstants, origin: Origin) -> float:
    """Return the acceleration of m by the air force, away from the stop hit last."""
    if origin.last_stop == 1:
        return -rig.air
    if origin.last_stop == 2:
        return rig.air
    return 0.0


@kernel(inline=True)
def support_need(
    rig: RigConstants, origin: Origin, sines: tuple[float, ...], velocity: float
) -> float:
    """Return n = X'' - g sin(angle) - p/m, the acceleration m needs from friction and stops."""
    share = rig.mass_ratio / (1.0 + rig.mass_ratio)
    together = acceleration_at(rig.joint, share * rig.slope, sines, origin.x, velocity)
    return together - rig.slope - air_acceleration(rig, origin)


@kernel
def mode_at_rest(rig: RigConstants, origin: Origin, sines: tuple[float, ...]) -> int:
    """
    Return the mode that follows when m has no velocity relative to M.

    m rests on stop 1 while n <= grip, on stop 2 while n >= -grip, sticks in the gap while
    |n| <= grip, and otherwise leaves in the direction in which its support fails. A stop that
    moves is no support.
    """
    need = support_need(rig, origin, sines, origin.velocity)
    grip = rig.grip
    if origin.clearance_1 == 0.0 and origin.stop_velocity_1 == 0.0 and need <= grip:
        return REST_1
    if origin.clearance_2 == 0.0 and origin.stop_velocity_2 == 0.0 and need >= -grip:
        return REST_2
    if grip == 0.0:
        return FREE
    if need > grip:
        return SLIDE_UP
    if need < -grip:
        return SLIDE_DOWN
    return STICK


@kernel
def _stop_deadline(origin: Origin) -> tuple[int, float]:
    """
    Return the event of a moving stop whose time is known beforehand, and that time.

    The stop arrives at its target, or at m if m does not move relative to M; at m if both happen
    at once.
    """
    velocity_1 = origin.stop_velocity_1
    velocity_2 = origin.stop_velocity_2
    kind = NO_EVENT
    first = inf
    if origin.mode >= STICK:
        if velocity_1 < 0.0:
            kind = CONTACT_1
            first = origin.clearance_1 / -velocity_1
        if velocity_2 > 0.0 and origin.clearance_2 / velocity_2 < first:
            kind = CONTACT_2
            first = origin.clearance_2 / velocity_2
    if velocity_1 != 0.0:
        arrival = max(0.0, (origin.target_1 - origin.stop_1) / velocity_1)
        if arrival < first:
            kind = STOP_ARRIVED_1
            first = arrival
    if velocity_2 != 0.0:
        arrival = max(0.0, (origin.target_2 - origin.stop_2) / velocity_2)
        if arrival < first:
            kind = STOP_ARRIVED_2
            first = arrival
    return kind, first


@kernel(inline=True)
def _joint_flight(
    rig: RigConstants, origin: Origin, deadline_kind: int, deadline: float
) -> Flight:
    """Build a flight of both masses as one; see `launch`."""
    sines, cosines = sines_and_cosines_of(rig.phases, origin.angles)
    standing_1 = origin.clearance_1 == 0.0 and origin.stop_velocity_1 == 0.0
    standing_2 = origin.clearance_2 == 0.0 and origin.stop_velocity_2 == 0.0
    share = rig.mass_ratio / (1.0 + rig.mass_ratio)
    constant = share * rig.slope
    return Flight(
        rig.joint,
        constant,
        sines,
        cosines,
        origin.x,
        origin.velocity,
        acceleration_at(rig.joint, constant, sines, origin.x, origin.velocity),
        0.0,
        0.0,
        origin.clearance_1,
        origin.clearance_2,
        True,
        0,
        inf,
        rig.slope + air_acceleration(rig, origin),
        # Between two stops that both touch it, m cannot move at all.
        -inf if origin.mode == REST_1 or standing_1 else -rig.grip,
        inf if origin.mode == REST_2 or standing_2 else rig.grip,
        origin.stop_velocity_1,
        origin.stop_velocity_2,
        deadline,
        deadline_kind,
    )


@kernel(inline=True)
def moving_flight(
    rig: RigConstants, origin: Origin, deadline_kind: int = NO_EVENT, deadline: float = inf
) -> Flight:
    """Build a flight in which m moves relative to M."""
    sines, cosines = sines_and_cosines_of(rig.phases, origin.angles)
    mode = origin.mode
    standing_1 = origin.clearance_1 == 0.0 and origin.stop_velocity_1 == 0.0
    standing_2 = origin.clearance_2 == 0.0 and origin.stop_velocity_2 == 0.0
    air = air_acceleration(rig, origin)
    direction = 0
    if mode == SLIDE_DOWN:
        direction = 1
    elif mode == SLIDE_UP:
        direction = -1
    constant = rig.mass_ratio * (direction * rig.grip - air)
    acceleration = acceleration_at(rig.free, constant, sines, origin.x, origin.velocity)
    relative = (rig.slope - direction * rig.grip + air) - acceleration
    if origin.released:
        relative = 0.0
    elif origin.relative_velocity == 0.0 and (
        direction * relative < 0.0
        or (mode == FREE and standing_1 and relative > 0.0)
        or (mode == FREE and standing_2 and relative < 0.0)
    ):
        # `mode_at_rest` found m to leave the other way: the forces balance to round-off.
        relative = 0.0
    # A stop held back by m follows it inwards until it is at its target.
    arrival = inf
    inwards = origin.relative_velocity
    if inwards == 0.0:
        inwards = relative
    if standing_1 and origin.stop_1 > origin.target_1 and inwards <= 0.0:
        arrival = origin.stop_1 - origin.target_1
        direction = -1
    elif standing_2 and origin.stop_2 < origin.target_2 and inwards >= 0.0:
        arrival = origin.target_2 - origin.stop_2
        direction = 1
    return Flight(
        rig.free,
        constant,
        sines,
        cosines,
        origin.x,
        origin.velocity,
        acceleration,
        origin.relative_velocity,
        relative,
        origin.clearance_1,
        origin.clearance_2,
        False,
        direction,
        arrival,
        0.0,
        -inf,
        inf,
        origin.stop_velocity_1,
        origin.stop_velocity_2,
        deadline,
        deadline_kind,
    )


@kernel(inline=True)
def launch(rig: RigConstants, origin: Origin) -> Flight:
    """Build the flight that begins at an origin."""
    deadline_kind = NO_EVENT
    deadline = inf
    if origin.stop_velocity_1 != 0.0 or origin.stop_velocity_2 != 0.0:
        deadline_kind, deadline = _stop_deadline(origin)
    if origin.mode >= STICK:
        return _joint_flight(rig, origin, deadline_kind, deadline)
    return moving_flight(rig, origin, deadline_kind, deadline)
