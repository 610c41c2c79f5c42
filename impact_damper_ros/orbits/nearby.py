"""The periodic motion next to a state of a run."""

from __future__ import annotations

import math

from impact_damper_ros.rig import Event, RigParameters

from .orbit import PeriodicOrbit
from .shooting import section_on, shoot

__all__ = ['orbit_near']


def orbit_near(
    parameters: RigParameters, impact: Event, phase: float, cycles: int
) -> PeriodicOrbit | None:
    """
    Shoot for a periodic motion from the state just after an impact.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    impact : Event
        The impact.
    phase : float
        Its instant in cycles of the force since its zero angle.
    cycles : int
        Period looked for, in cycles of the force.

    Returns
    -------
    PeriodicOrbit or None
        The motion that Newton's method leads to; None if it does not converge.
    """
    guess = PeriodicOrbit(
        parameters=parameters,
        stops=(impact.stop,),
        cycles=cycles,
        phases=(phase % cycles,),
        x=(impact.x,),
        primary_velocity_before=(impact.primary_velocity_before,),
        primary_velocity_after=(impact.primary_velocity_after,),
        damper_velocity_before=(impact.damper_velocity_before,),
        damper_velocity_after=(impact.damper_velocity_after,),
        x_max=math.nan,
        multipliers=(),
        stable=False,
        viable=False,
        reason='a guess',
        residual=math.inf,
        residual_history=(),
    )
    section = section_on(guess)
    shot = None if section is None else shoot(parameters, section, cycles)
    return None if shot is None else shot[0]
