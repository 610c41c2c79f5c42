"""What two impacts per cycle can do at best, at resonance: closed forms to measure laws by."""

from __future__ import annotations

import math

from impact_damper_ros.rig import RigParameters

__all__ = ['ideal_amplitude', 'ideal_ratio']


def ideal_amplitude(rig: RigParameters) -> float:
    """
    Return the amplitude of X at resonance with both impacts where |X'| is largest, m.

    Notes
    -----
    m flies for half a cycle each way at a mean speed u in the laboratory, and loses L = friction
    g cos(angle) pi/omega of its speed on the way, whichever way it goes; weight only makes the
    two flights unequal, and to first order leaves their mean. With V the speed of M just before
    the impact, momentum and restitution give u_after = [(1 + R) V + (R - mu) u_before]/(1 + mu),
    and u_before = u_after - L. Two impulses m (u_before + u_after) per cycle at the peaks of X'
    act on the fundamental as a force of amplitude (omega/pi) times their sum, in phase with the
    dashpot's: F = C omega A + (omega/pi) 2 m (u_before + u_after). The speed of M at the passage
    is the mean of before and after: omega A = V - mu (u_before + u_after)/2.

    Without friction this is A0 zeta/(zeta + zeta_eq), zeta_eq = (2/pi) (mu/(1 + mu)) (1 + R)/(1 -
    R), with A0 the amplitude without impacts.
    """
    mu, omega = rig.mass_ratio, rig.omega
    restitution = 0.5 * (rig.restitution_1 + rig.restitution_2)
    loss = rig.friction * rig.gravity * math.cos(rig.angle) * math.pi / omega
    # s = u_before + u_after as a + b V
    share = (restitution - mu) / (1.0 + mu)
    b = 2.0 * (1.0 + restitution) / (1.0 + mu) / (1.0 - share)
    a = -loss * (1.0 + share) / (1.0 - share)
    # F = C (V - mu s/2) + (2 omega m/pi) s
    force = abs(rig.force_amplitudes[0])
    push = 2.0 * omega * rig.damper_mass / math.pi - 0.5 * mu * rig.damping
    speed = (force - push * a) / (rig.damping + push * b)
    return (speed - 0.5 * mu * (a + b * speed)) / omega


def ideal_ratio(rig: RigParameters) -> float:
    """Return that amplitude over the one without impacts."""
    return ideal_amplitude(rig) / rig.response_amplitude
