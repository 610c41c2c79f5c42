"""
A grid: steps of fixed length through a vibration, for the quick search of events.

From one node to the next X, X' and the drive go by constants, without a sine.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import NamedTuple

from .response import Harmonic, driven_response, free_response

__all__ = ['Grid', 'drive_bound', 'make_grid']

#: Length of a step, as a phase of the fastest of spring and harmonics, rad.
_STEP = 1.2
#: Nodes reached from one base. The bounds grow with their number, round-off with its square root.
_NODES = 5


class Grid(NamedTuple):
    """
    Constants of one step.

    Attributes
    ----------
    step, inverse : float
        Time from node to node, s, and its inverse.
    nodes : int
        Number of nodes for which the bounds hold.
    x_x, v_x, x_v, v_v : float
        X and X' after a step from unit X, and from unit X', without drive.
    x_cosine, x_sine, v_cosine, v_sine : tuple of float
        X and X' after a step from rest under each harmonic, for unit cosine and for unit sine of
        its phase at the start.
    turn_cosine, turn_sine : tuple of float
        Cosine and sine of the angle that each harmonic turns.
    bound_3, bound_4, bound_5, bound_6 : float
        As the oscillator's bounds, over all nodes.
    spring, dashpot : float
        Constants w^2 step^2 and 2 a step of the equation of motion with the time in steps.
    pushes, turns : tuple of float
        Amplitude f step^2 and angle turned in a step W step of each harmonic.
    """

    step: float
    inverse: float
    nodes: int
    x_x: float
    v_x: float
    x_v: float
    v_v: float
    x_cosine: tuple[float, ...]
    x_sine: tuple[float, ...]
    v_cosine: tuple[float, ...]
    v_sine: tuple[float, ...]
    turn_cosine: tuple[float, ...]
    turn_sine: tuple[float, ...]
    bound_3: float
    bound_4: float
    bound_5: float
    bound_6: float
    spring: float
    dashpot: float
    pushes: tuple[float, ...]
    turns: tuple[float, ...]


def drive_bound(
    omega: float,
    decay: float,
    drive: Sequence[tuple[float, float]],
    order: int,
    horizon: float,
) -> float:
    """
    Bound what the drive adds to a derivative of X beyond its free vibration.

    Parameters
    ----------
    omega, decay : float
        Natural circular frequency w and decay a.
    drive : sequence of (float, float)
        Amplitude, m/s^2, and circular frequency, rad/s, of each harmonic.
    order : int
        Which derivative.
    horizon : float
        For how long, s.
    """
    total = 0.0
    for force, frequency in drive:
        push = abs(force) * frequency**order
        if push == 0.0:
            continue
        # Response from rest, by Duhamel's integral with |impulse response| <= min(1/w, t) ...
        from_rest = push * horizon * min(1.0 / omega, horizon / 2.0)
        # ... or the steady response and the free vibration that starts it from rest.
        gain = sqrt((omega**2 - frequency**2) ** 2 + (2.0 * decay * frequency) ** 2)
        steady = inf
        if gain > 0.0:
            steady = push / gain * (1.0 + sqrt(1.0 + frequency**2 / omega**2))
        total += min(from_rest, steady)
    return total


def make_grid(
    omega: float,
    decay: float,
    drive: Sequence[tuple[float, float]],
    harmonics: Sequence[Harmonic],
    fastest: float,
) -> Grid:
    """
    Return the grid of an oscillator.

    Parameters
    ----------
    omega, decay : float
        Natural circular frequency w and decay a.
    drive : sequence of (float, float)
        Amplitude, m/s^2, and circular frequency, rad/s, of each harmonic.
    harmonics : sequence of Harmonic
        Constants of the responses to them.
    fastest : float
        The fastest of all circular frequencies that act, rad/s.
    """
    step = _STEP / fastest
    frequency = sqrt((omega - decay) * (omega + decay))
    inverse = 1.0 / frequency
    free = free_response(decay, frequency, inverse, step)
    responses = [
        driven_response(decay, frequency, inverse, omega**2, circular, *harmonic, free, step)
        for (_, circular), harmonic in zip(drive, harmonics, strict=True)
    ]
    scaled = [(force, r) for (force, _), r in zip(drive, responses, strict=True)]
    bounds = [drive_bound(omega, decay, drive, order, _NODES * step) for order in (3, 4, 5, 6)]
    return Grid(
        step=step,
        inverse=1.0 / step,
        nodes=_NODES,
        x_x=free.step,
        v_x=-(omega * omega) * free.impulse,
        x_v=free.impulse,
        v_v=free.rate,
        x_cosine=tuple(force * r.sine for force, r in scaled),
        x_sine=tuple(force * r.cosine for force, r in scaled),
        v_cosine=tuple(force * r.rate_sine for force, r in scaled),
        v_sine=tuple(force * r.rate_cosine for force, r in scaled),
        turn_cosine=tuple(r.turned_cosine for r in responses),
        turn_sine=tuple(r.turned_sine for r in responses),
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
        bound_6=bounds[3],
        spring=(omega * step) * (omega * step),
        dashpot=2.0 * decay * step,
        pushes=tuple(force * step * step for force, _ in drive),
        turns=tuple(circular * step for _, circular in drive),
    )
