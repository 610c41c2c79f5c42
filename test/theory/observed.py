"""Rigs that move as the theory says."""

from impact_damper_ros import Event, EventKind
from impact_damper_ros.theory.prediction import ObservedMotion


def motion_on(orbit):
    """Return what a rig does that moves as the theory says."""
    impact = Event(
        orbit.instants[-1],
        EventKind.IMPACT,
        orbit.stops[-1],
        orbit.x[-1],
        0.5 * orbit.parameters.gap * (1 if orbit.stops[-1] == 1 else -1),
        orbit.primary_velocity_before[-1],
        orbit.primary_velocity_after[-1],
        orbit.damper_velocity_before[-1],
        orbit.damper_velocity_after[-1],
        0.0,
    )
    return ObservedMotion(orbit, impact, orbit.instants[-1] / orbit.cycle)
