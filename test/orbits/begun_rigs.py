"""Rigs that are begun on a periodic motion."""

import math

from impact_damper_ros import InitialConditions, Rig


def begun_on(orbit, *, before=False, **moved):
    """Return a simulator just after a motion's first impact, or before; `moved` is added."""
    rig = orbit.parameters
    side = 'before' if before else 'after'
    start = {
        'initial_primary_position': orbit.x[0],
        'initial_primary_velocity': getattr(orbit, f'primary_velocity_{side}')[0],
        'initial_damper_offset': 0.5 * rig.gap * (1 if orbit.stops[0] == 1 else -1),
        'initial_damper_velocity': getattr(orbit, f'damper_velocity_{side}')[0],
    }
    start |= {name: start[name] + by for name, by in moved.items()}
    angle = rig.force_phases[0] + rig.force_frequencies[0] * orbit.instants[0]
    turned = rig.replace(force_phases=(math.remainder(angle, math.tau),))
    return Rig(turned, InitialConditions(**start))
