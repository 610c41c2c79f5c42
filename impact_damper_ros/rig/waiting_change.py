# SPDX-License-Identifier: Apache-2.0
"""
Changes of the base, which wait for its next upward zero.

A base that began another motion anywhere else would jump. All other parameters change at once.
Changes are made at whole nanoseconds. Until the next one the base moves by less than the rounding
of a time stamp, and the new motion begins at the position reached.
"""

from __future__ import annotations

from math import ceil, inf
from typing import Any

from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters

from .rig import Rig

_BASE = tuple(name for name in PARAMETER_SPECS if name.startswith('base_'))
#: The motion of the base changes, too, where a sweep moves from the base to the force.
_FORCING = tuple(n for n in PARAMETER_SPECS if n.startswith(('base_', 'sweep_', 'force_')))


def made_at_once(rig: Rig, parameters: RigParameters) -> tuple[RigParameters, int | None]:
    """
    Return the part of a change that is made at once, and when the rest is made.

    Parameters
    ----------
    rig : Rig
        The rig, at a whole number of nanoseconds.
    parameters : RigParameters
        The rig after the whole change.

    Returns
    -------
    RigParameters
        The rig with all that does not wait.
    int or None
        Rig time of the change to `parameters`, ns: that of the next upward zero of the base. None
        if nothing waits, also where the base never passes zero.
    """
    wait = rig.wait_for_change(parameters)
    if not 0.0 < wait < inf:
        return parameters, None
    due = rig.time + wait
    due_ns = ceil(due * 1e9)
    while due_ns / 1e9 < due or due_ns / 1e9 <= rig.time:
        due_ns += 1
    for names in (_BASE, _FORCING):
        now = parameters.replace(**{name: getattr(rig.parameters, name) for name in names})
        if not rig.wait_for_change(now):
            break
    return now, due_ns


def waiting_values(now: RigParameters, parameters: RigParameters) -> dict[str, Any]:
    """Return the values, by name, that a change which has been made in part still waits for."""
    made = now.as_dict()
    return {name: value for name, value in parameters.as_dict().items() if value != made[name]}
