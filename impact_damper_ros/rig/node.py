"""Nodes of a grid: the motion of M at instants a fixed step apart, without a sine."""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from .flight import Flight, Motion
from .kernels import elementwise, kernel
from .oscillator import Oscillator, acceleration_at

__all__ = ['Node', 'acceleration_of', 'base_node', 'jerk_of', 'next_node']


class Node(NamedTuple):
    """
    Motion of M at one node.

    Attributes
    ----------
    offset : float
        X from where it would rest under the constant force, m.
    velocity : float
        X', m/s.
    sines, cosines : tuple of float
        Sine and cosine of each harmonic's phase.
    """

    offset: float
    velocity: float
    sines: tuple[float, ...]
    cosines: tuple[float, ...]


@elementwise
def _sines_at(sine: float, cosine: float, frequency: float, tau: float) -> float:
    """Return the sine of each harmonic's phase after a time."""
    return sine * cos(frequency * tau) + cosine * sin(frequency * tau)


@elementwise
def _cosines_at(sine: float, cosine: float, frequency: float, tau: float) -> float:
    """Return the cosine of each harmonic's phase after a time."""
    return cosine * cos(frequency * tau) - sine * sin(frequency * tau)


@elementwise
def _next_sines(sine: float, cosine: float, turn_cosine: float, turn_sine: float) -> float:
    """Return the sine of each harmonic's phase a step later."""
    return sine * turn_cosine + cosine * turn_sine


@elementwise
def _next_cosines(sine: float, cosine: float, turn_cosine: float, turn_sine: float) -> float:
    """Return the cosine of each harmonic's phase a step later."""
    return cosine * turn_cosine - sine * turn_sine


@kernel(inline=True)
def base_node(flight: Flight, tau: float, motion: Motion) -> Node:
    """
    Return the node from which the others are reached.

    Parameters
    ----------
    flight : Flight
        The flight.
    tau : float
        Time since its origin, s.
    motion : Motion
        The motion then.
    """
    sines = flight.sines
    cosines = flight.cosines
    if tau > 0.0:
        frequencies = flight.oscillator.frequencies
        sines = _sines_at(flight.sines, flight.cosines, frequencies, tau)
        cosines = _cosines_at(flight.sines, flight.cosines, frequencies, tau)
    offset = motion.x - flight.constant / flight.oscillator.omega_squared
    return Node(offset, motion.velocity, sines, cosines)


@kernel(inline=True)
def next_node(oscillator: Oscillator, node: Node) -> Node:
    """Return the node a step later."""
    grid = oscillator.grid
    # Negative zero is what adds nothing, which a compiler makes use of.
    pushed = -0.0
    speeded = -0.0
    for j in range(len(node.sines)):
        sine = node.sines[j]
        cosine = node.cosines[j]
        pushed += cosine * grid.x_cosine[j] + sine * grid.x_sine[j]
        speeded += cosine * grid.v_cosine[j] + sine * grid.v_sine[j]
    # What is known first comes first: each node waits for the one before.
    offset = (pushed + node.offset * grid.x_x) + node.velocity * grid.x_v
    velocity = (speeded + node.offset * grid.v_x) + node.velocity * grid.v_v
    sines = _next_sines(node.sines, node.cosines, grid.turn_cosine, grid.turn_sine)
    cosines = _next_cosines(node.sines, node.cosines, grid.turn_cosine, grid.turn_sine)
    return Node(offset, velocity, sines, cosines)


@kernel(inline=True)
def acceleration_of(oscillator: Oscillator, node: Node) -> float:
    """Return X'' at a node."""
    return acceleration_at(oscillator, 0.0, node.sines, node.offset, node.velocity)


@kernel(inline=True)
def jerk_of(oscillator: Oscillator, node: Node, x_2: float) -> float:
    """Return X''' at a node, from X'' there."""
    jerk = -2.0 * oscillator.decay * x_2 - oscillator.omega_squared * node.velocity
    for j in range(len(node.cosines)):
        jerk += oscillator.forces[j] * oscillator.frequencies[j] * node.cosines[j]
    return jerk
