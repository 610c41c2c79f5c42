# SPDX-License-Identifier: Apache-2.0
"""
The runs to record on a bench, and how well each distinguishes restitution, friction and gap.

From one impact to the next, momentum and free flight give two equations that are linear in
(M + m)/(m (1 + R)), in the deceleration by friction and in the gap (`orbits.flight_regressors`).
Their normal equations over all flights of a run give the deviations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import incline
from impact_damper_ros.orbits.flight_regressors import flight_regressors
from impact_damper_ros.orbits.settled_motion import settle
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Events

from .runs_from_rest import at_level

#: Errors of a recorded speed, over that of approach, and of a recorded place, over the gap; and
#: the ratio of eigenvalues below which the equations do not distinguish the unknowns.
_SPEED_ERROR, _PLACE_ERROR, _DEGENERATE = 0.01, 0.01, 1e-9


class RunDeviations(NamedTuple):
    """
    Standard deviations after a run; infinite where it does not determine the parameter.

    Attributes
    ----------
    restitution, friction : float
        Deviations of R, and of the coefficient of friction, which acts only where a force presses
        m to M.
    relative_gap : float
        Deviation of the gap, over the gap.
    """

    restitution: float = math.inf
    friction: float = math.inf
    relative_gap: float = math.inf


class PlannedRun(NamedTuple):
    """
    A run to record, and how well it distinguishes restitution, friction and gap.

    The errors of speeds and places of each flight are assumed to be 1 % of the speed of approach
    and of the gap.

    Attributes
    ----------
    settled_only : bool
        Whether the recording begins after the motion has settled, not from rest.
    gap, level : float
        Gap (m) and level, as a factor, of the run.
    flights : int
        Number of flights of m from impact to impact.
    repeats : bool
        Whether the motion settles to a period, so that later flights give no new information.
    standard_deviations : Deviations
        Standard deviations after the run.
    """

    settled_only: bool
    gap: float
    level: float
    flights: int
    repeats: bool
    standard_deviations: RunDeviations


def _deviations(rig: RigParameters, events: Events) -> tuple[int, RunDeviations]:
    """Return the number of flights without a reversal, and the deviations that they leave."""
    places = np.flatnonzero(events['kind'] == EventKind.IMPACT)
    hits, direct = events[places], np.diff(places) == 1
    jump = hits['primary_velocity_after'] - hits['primary_velocity_before']
    slides = np.sign(hits['damper_velocity_after'] - hits['primary_velocity_after'])[:-1]
    stop = np.where(hits['stop'] == 1, 1.0, -1.0)
    rows = flight_regressors(hits['time'], jump, stop, slides)[direct]
    if len(rows) < 2:
        return len(rows), RunDeviations()
    mean = 0.5 * (rig.restitution_1 + rig.restitution_2)
    alpha = (rig.primary_mass + rig.damper_mass) / (rig.damper_mass * (1.0 + mean))
    # Columns and scales of R, friction and gap; friction of a rig that has a normal force only
    normal = rig.gravity * incline(rig.angle)[1]
    columns = {
        'restitution': (rows[..., 0] + rows[..., 1]) * alpha / (1.0 + mean),
        **({'friction': rows[..., 2] * normal} if normal > 0.0 else {}),
        'relative_gap': rows[..., 3] * rig.gap,
    }
    ends = hits[1:][direct]
    approach = np.abs(ends['damper_velocity_before'] - ends['primary_velocity_before'])
    errors = np.array([_SPEED_ERROR * float(approach.mean()), _PLACE_ERROR * rig.gap])
    laws = (np.stack([*columns.values()], axis=-1) / errors[:, None]).reshape(-1, len(columns))
    values, vectors = np.linalg.eigh(laws.T @ laws)
    if values[0] <= _DEGENERATE * values[-1]:
        return len(rows), RunDeviations()
    deviations = np.sqrt((vectors**2 / values).sum(axis=1)).tolist()
    return len(rows), RunDeviations(**dict(zip(columns, deviations, strict=True)))


def planned_run(
    rig: RigParameters, level: float = 1.0, cycles: int = 100, *, settled: bool = False
) -> PlannedRun:
    """
    Return how well a run distinguishes restitution, friction and gap.

    Parameters
    ----------
    rig : RigParameters
        The rig of the run, whose level is changed.
    level : float, optional
        The level of the run, as a factor.
    cycles : int, optional
        Cycles of the excitation that are recorded.
    settled : bool, optional
        Whether the recording begins after the motion has settled, not from rest.
    """
    there = at_level(rig, level)
    moving = Rig(there, compiled=None)
    motion = settle(moving)
    if not settled:
        moving = Rig(there, compiled=None)
    events = moving.run(moving.time + cycles * motion.cycle).events
    flights, deviations = _deviations(there, events)
    repeats = motion.period is not None
    return PlannedRun(settled, rig.gap, level, flights, repeats, deviations)


def planned_runs(rig: RigParameters) -> tuple[PlannedRun, ...]:
    """
    Return the runs of a test plan, the settled motion first.

    Parameters
    ----------
    rig : RigParameters
        The rig, shaken by one harmonic of a force or of its base.
    """
    if not rig.periodic_force:
        raise ValueError(
            'the rig is not shaken by one lasting sine: give force_amplitudes or base_amplitudes '
            'one value, and leave multisine and sweep off'
        )
    return (
        planned_run(rig, settled=True),
        planned_run(rig),
        planned_run(rig, 2.0),
        planned_run(rig.replace(gap=0.8 * rig.gap)),
        planned_run(rig.replace(gap=1.1 * rig.gap)),
    )
