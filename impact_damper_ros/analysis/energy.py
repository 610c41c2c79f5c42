"""
Where the energy goes, from the log alone.

Between two recorded knots X and Y are the cubics through the recorded positions and velocities:
the equation of motion does not enter, so that the residual of the balance tests it.
"""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.rig import RigParameters

from .cubic import cubic_rates, turning_points
from .flight_check import Knots
from .force_clock import ForceClock
from .run_curves import Array
from .stretch_measures import EnergyBalance

__all__ = ['energy_balance', 'stored_energy', 'work_between']

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
# Positions on [0, 1] and weights that add up to 1
_PLACES, _SHARES = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
#: Error of the work along a cubic, in (W h)^4 of the work there and back.
_CUBIC = 0.001
#: The same of the friction where m turns or stops, in the speeds there times the interval.
_BROKEN = 0.1
_ROUND_OFF = 1e-12


def stored_energy(
    rig: RigParameters, x: Array, velocity: Array, z: Array, damper_velocity: Array
) -> Array:
    """Return kinetic and potential energy of both masses, J; X from the static equilibrium."""
    slope = rig.gravity * math.sin(rig.angle)
    primary = 0.5 * rig.primary_mass * velocity**2 + 0.5 * rig.stiffness * x**2
    energy: Array = primary + rig.damper_mass * (0.5 * damper_velocity**2 - slope * z)
    return energy


def work_between(
    rig: RigParameters, clock: ForceClock | None, begin: Knots, end: Knots
) -> tuple[float, float, float]:
    """
    Return the work of the force on M, that there and back, and what the dashpot takes, J.

    Parameters
    ----------
    rig : RigParameters
        As logged.
    clock : ForceClock or None
        The force; its work is NaN if it is not known.
    begin, end : Knots
        Beginnings and ends of the intervals, none of them empty.
    """
    step = end.time - begin.time
    v_0 = begin.velocity
    b, a = cubic_rates(step, end.x - begin.x, v_0, end.velocity_before)
    force = dashpot = there_and_back = 0.0
    # Sums and not products of vectors, whose bits depend on the number of threads
    for place, share in zip(_PLACES, _SHARES, strict=True):
        velocity = v_0 + place * (b + place * a)
        if clock is not None:
            work = clock.force(begin.time + place * step) * velocity * step
            force += share * float(np.sum(work))
            there_and_back += share * float(np.sum(np.abs(work)))
        dashpot += share * rig.damping * float(np.sum(velocity**2 * step))
    if clock is None:
        force = there_and_back = math.nan
    return force, there_and_back, dashpot


def _path_length(step: Array, rise: Array, begin: Array, end: Array) -> float:
    """Return the way there and back along cubics with given velocities at their ends."""
    length = np.abs(rise)
    turns, out = turning_points(step, rise, begin, end)
    length[turns] = np.abs(out) + np.abs(rise[turns] - out)
    return float(length.sum())


def energy_balance(clock: ForceClock, knots: Knots, periods: int) -> EnergyBalance | None:
    """
    Balance the energy from the first knot to the last one, both after their impact, if any.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    knots : Knots
        Joint states and impacts in a row.
    periods : int
        Periods between the first and the last one.

    Returns
    -------
    EnergyBalance or None
        None if there are fewer than two knots.
    """
    if len(knots) < 2:
        return None
    rig = clock.parameters
    begin, end = knots[:-1], knots[1:]
    step = end.time - begin.time
    moved = step > 0.0
    begin, end, step = begin[moved], end[moved], step[moved]
    force, there_and_back, dashpot = work_between(rig, clock, begin, end)
    y_0, y_1 = begin.z - begin.x, end.z - end.x
    grip = rig.friction * rig.damper_mass * rig.gravity * math.cos(rig.angle)
    relative = begin.damper_velocity - begin.velocity
    later = end.damper_velocity_before - end.velocity_before
    friction = grip * _path_length(step, y_1 - y_0, relative, later)
    # Where m begins or ends to move relative to M, or turns, Y is no cubic.
    broken = (relative * later <= 0.0) & ((relative != 0.0) | (later != 0.0))
    doubt = grip * float(((np.abs(relative) + np.abs(later)) * step)[broken].sum())
    air = np.where(begin.last_stop == 1.0, -1.0, np.where(begin.last_stop == 2.0, 1.0, 0.0))
    air_work = rig.air_force * float(air @ (y_1 - y_0))
    hits = knots[1:]
    before = stored_energy(rig, hits.x, hits.velocity_before, hits.z, hits.damper_velocity_before)
    after = stored_energy(rig, hits.x, hits.velocity, hits.z, hits.damper_velocity)
    impacts = float((before - after)[hits.stop > 0.0].sum())
    ends = knots[np.array([0, len(knots) - 1])]
    energy = stored_energy(rig, ends.x, ends.velocity, ends.z, ends.damper_velocity)
    stored = float(energy[1] - energy[0])
    fastest = max([rig.omega, *rig.harmonics[1]])
    turned = fastest * float(step.max(initial=0.0))
    scale = there_and_back + dashpot + friction + abs(impacts) + float(np.abs(energy).max())
    return EnergyBalance(
        start=float(knots.time[0]),
        end=float(knots.time[-1]),
        periods=periods,
        force=force,
        air=air_work,
        dashpot=dashpot,
        friction=friction,
        impacts=impacts,
        stored=stored,
        residual=force + air_work - dashpot - friction - impacts - stored,
        tolerance=(_CUBIC * turned**4 + _ROUND_OFF) * scale + _BROKEN * doubt,
    )
