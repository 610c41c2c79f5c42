"""
Impacts: restitution and momentum, and the end of a chatter.

Bapat (1995), equations (10)-(11); for complete chatter Budd and Dux (1994), Phil. Trans. R. Soc.
Lond. A 347, and Nordmark and Piiroinen (2009), Nonlinear Dynamics 58.
"""

from __future__ import annotations

from math import inf, sqrt

from .kernels import kernel

__all__ = [
    'CHATTER_TOLERANCE',
    'bounce_duration',
    'chatter_duration',
    'impulse',
    'may_chatter',
    'rebound',
]

#: A chatter is completed in closed form once the relative acceleration that drives it can change
#: by at most this fraction until its end. The accumulation instant then is in error by at most
#: this fraction of the time left, which is itself this small in units of acceleration per jerk:
#: the square, 1e-12, of the time scale of the motion.
CHATTER_TOLERANCE = 1e-6


@kernel(inline=True)
def rebound(
    velocity: float, relative_velocity: float, restitution: float, mass_ratio: float
) -> tuple[float, float]:
    """
    Return the velocities after an impact from those before it.

    Parameters
    ----------
    velocity, relative_velocity : float
        Velocity of M, and of m relative to M, just before the impact.
    restitution : float
        Coefficient of restitution R, 0 to 1.
    mass_ratio : float
        Mass ratio m/M.

    Returns
    -------
    velocity, relative_velocity : float
        The same just after it: momentum is kept, the relative velocity reversed by R.
    """
    share = mass_ratio / (1.0 + mass_ratio)
    return (
        velocity + share * (1.0 + restitution) * relative_velocity,
        -restitution * relative_velocity,
    )


@kernel(inline=True)
def impulse(
    damper_mass: float, mass_ratio: float, restitution: float, relative_velocity: float
) -> float:
    """Return the impulse of an impact, N s, from the relative velocity just before it."""
    return damper_mass * (1.0 + restitution) / (1.0 + mass_ratio) * abs(relative_velocity)


@kernel
def bounce_duration(speed: float, press: float, grip: float) -> float:
    """
    Return how long m stays off a stop that it leaves slowly.

    Parameters
    ----------
    speed : float
        Speed of m away from the stop just after an impact; positive.
    press : float
        Relative acceleration towards the stop without friction.
    grip : float
        What friction adds to it while m leaves and takes from it while m returns; not negative.

    Returns
    -------
    float
        speed (1/up + 1/sqrt(up down)) with the constant accelerations up = press + grip and
        down = press - grip; infinite if m does not come back.
    """
    down = press - grip
    if down <= 0.0:
        return inf
    up = press + grip
    return speed * (1.0 / up + 1.0 / sqrt(up * down))


@kernel(inline=True)
def may_chatter(speed: float, push: float, jerk_bound: float, shortest: float) -> bool:
    """
    Return whether a chatter may be complete, or a bounce too short to be told, for all one knows.

    Parameters
    ----------
    speed : float
        Speed of m away from a stop just after an impact; positive.
    push : float
        Bound of the relative acceleration, friction included.
    jerk_bound : float
        A bound of the relative jerk is not less than this.
    shortest : float
        Time off the stop that is too short.

    Notes
    -----
    A bounce takes 2 speed/push at least.
    """
    twice = 2.0 * speed
    return jerk_bound * twice <= CHATTER_TOLERANCE * push * push or twice <= shortest * push


@kernel
def chatter_duration(
    speed: float, press: float, grip: float, restitution: float, jerk_bound: float
) -> float:
    """
    Return the time until a chatter on one stop accumulates.

    Parameters
    ----------
    speed, press, grip : float
        As for `bounce_duration`.
    restitution : float
        Coefficient of restitution at the stop.
    jerk_bound : float
        Bound of the modulus of the relative jerk.

    Returns
    -------
    float
        Sum of the durations of all further flights, or infinity if it is not yet certain to
        `CHATTER_TOLERANCE` that the chatter is complete.

    Notes
    -----
    Each flight begins with restitution sqrt(down/up) times the speed of the one before.
    """
    bounce = bounce_duration(speed, press, grip)
    if bounce == inf:
        return inf
    down = press - grip
    ratio = restitution * sqrt(down / (press + grip))
    if ratio >= 1.0:
        return inf
    duration = bounce / (1.0 - ratio)
    if jerk_bound * duration > CHATTER_TOLERANCE * down:
        return inf
    return duration
