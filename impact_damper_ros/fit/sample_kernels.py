# SPDX-License-Identifier: Apache-2.0
"""
Kernels of the samples of a fit: a time derivative of X between nodes, and what it depends on.

M is a linear oscillator whatever m does: X is its free vibration from the state at the node
before, its steady response, and the deflection by the constant push of m.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, exp, sin
from typing import Any

from impact_damper_ros.motion.kernels import kernel

from .node_kernels import AT, PLACE_M, SPEED_M

#: Columns of a vibration: constants a, b and w^2, then phasors of the steady X, X' and of the
#: derivative that is asked for at time 0, for each harmonic.
DECAY_RATE, DAMPED, SQUARE, PHASORS = range(4)
#: Columns of a row of derivatives of a sample: instant, X and X' of its node, then shared ones.
SAMPLE = 3


@kernel(inline=True)
def times_root(wave: Any, order: int, re: float, im: float) -> tuple[float, float]:
    """Return the product of a number with a power of the eigenvalue -a + ib."""
    for _ in range(order):
        re, im = (
            -wave[DECAY_RATE] * re - wave[DAMPED] * im,
            wave[DAMPED] * re - wave[DECAY_RATE] * im,
        )
    return re, im


@kernel
def steady_sum(wave: Any, first: int, turned: Any) -> float:
    """Return the sum of the harmonics of a steady response, by their phasors that have turned."""
    total = 0.0
    for k in range((len(wave) - PHASORS) // 6):
        at = PHASORS + 6 * k + first
        total += wave[at] * turned[2 * k + 1] + wave[at + 1] * turned[2 * k]
    return total


@kernel
def start_wave(wave: Any, order: int, state: Any, push: float, turned: Any) -> tuple[float, float]:
    """Return the free vibration after a node, as a phasor of a derivative of X."""
    offset = state[PLACE_M] - push / wave[SQUARE] - steady_sum(wave, 0, turned)
    rate = state[SPEED_M] - steady_sum(wave, 2, turned)
    slope = -(rate + wave[DECAY_RATE] * offset) / wave[DAMPED]
    return times_root(wave, order, offset, slope)


@kernel
def write_samples(
    times: Any,
    turning: Any,
    order: int,
    states: Any,
    pushes: Any,
    sticks: Sequence[bool],
    frequencies: Any,
    waves: Any,
    nodes: Any,
    signal: Any,
    accelerations: Any,
    by_push: Any,
    columns: Any,
    steps: Any,
    space: Any,
    rates: Any,
) -> int:
    """
    Write a derivative of X at times, the nodes before them, and its own derivatives.

    `waves` are the vibrations of M and of M with m, then those of other K, C or delay, which
    differ by `steps`, and whose derivatives are for `columns`; the first column is for the pushes,
    which change by `by_push`. Without rows of `rates` there are no derivatives.
    """
    last = len(states) - 1
    node = -1
    derive = len(rates) > 0
    wave = waves[0, 0]
    re = im = x_re = x_im = v_re = v_im = constant = 0.0
    for i in range(len(times)):
        moved = node < 0
        node = max(node, 0)
        while node < last and states[node + 1, AT] <= times[i]:
            node += 1
            moved = True
        kind = 1 if sticks[node] else 0
        if moved:
            wave = waves[0, kind]
            for k in range(len(frequencies)):
                phase = frequencies[k] * states[node, AT]
                space[0, 2 * k] = cos(phase)
                space[0, 2 * k + 1] = sin(phase)
            re, im = start_wave(wave, order, states[node], pushes[node], space[0])
            constant = pushes[node] / wave[SQUARE] if order == 0 else 0.0
            if derive:
                x_re, x_im = times_root(wave, order, 1.0, -wave[DECAY_RATE] / wave[DAMPED])
                v_re, v_im = times_root(wave, order, 0.0, -1.0 / wave[DAMPED])
                for p in range(1, len(waves)):
                    other = waves[p, kind]
                    o_re, o_im = start_wave(other, order, states[node], pushes[node], space[0])
                    space[p, 0] = (o_re - re) / steps[p]
                    space[p, 1] = (o_im - im) / steps[p]
                    space[p, 2] = (wave[DECAY_RATE] - other[DECAY_RATE]) / steps[p]
                    space[p, 3] = (other[DAMPED] - wave[DAMPED]) / steps[p]
                    space[p, 4] = 0.0
                    if order == 0:
                        space[p, 4] = (pushes[node] / other[SQUARE] - constant) / steps[p]
        since = times[i] - states[node, AT]
        size = exp(-wave[DECAY_RATE] * since)
        cosine = size * cos(wave[DAMPED] * since)
        sine = size * sin(wave[DAMPED] * since)
        nodes[i] = node
        signal[i] = re * cosine - im * sine + steady_sum(wave, 4, turning[i]) + constant
        if not derive:
            continue
        by_x = x_re * cosine - x_im * sine
        by_v = v_re * cosine - v_im * sine
        rates[i, 0] = -(by_x * states[node, SPEED_M] + by_v * accelerations[node])
        rates[i, 1] = by_x
        rates[i, 2] = by_v
        if columns[0] >= 0:
            shift = (1.0 - by_x if order == 0 else -by_x) / wave[SQUARE]
            rates[i, SAMPLE + columns[0]] = shift * by_push[node]
        for p in range(1, len(waves)):
            part_re = space[p, 0] + since * (re * space[p, 2] - im * space[p, 3])
            part_im = space[p, 1] + since * (re * space[p, 3] + im * space[p, 2])
            change = part_re * cosine - part_im * sine + space[p, 4]
            steady = steady_sum(waves[p, kind], 4, turning[i]) - steady_sum(wave, 4, turning[i])
            rates[i, SAMPLE + columns[p]] = change + steady / steps[p]
    return len(times)
