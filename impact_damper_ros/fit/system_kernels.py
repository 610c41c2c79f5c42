# SPDX-License-Identifier: Apache-2.0
"""Kernels of the linear system of a step: sums of squares, entries, transposed products."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impact_damper_ros.motion.kernels import kernel

from .node_kernels import PAIR
from .sample_kernels import SAMPLE


@kernel(inline=True)
def column_of(k: int, node: int, own: int, shared: int) -> int:
    """Return the unknown to which a column belongs: of nodes from one on, or a shared one."""
    return shared + 5 * node + k if k < own else k - own


@kernel
def add_squares(
    samples: Any,
    sample_node: Sequence[int],
    rows: Any,
    row_node: Sequence[int],
    others: int,
    squares: Any,
) -> int:
    """Add the squares of the derivatives of residuals, and those of conditions, by unknowns."""
    shared = rows.shape[1] - PAIR
    for i in range(len(samples)):
        for k in range(samples.shape[1]):
            column = column_of(k, sample_node[i], SAMPLE, shared)
            squares[0, column] += samples[i, k] * samples[i, k]
    for i in range(len(rows)):
        for k in range(rows.shape[1]):
            if rows[i, k] != 0.0:
                column = column_of(k, row_node[i] - 1, PAIR, shared)
                squares[0 if i < others else 1, column] += rows[i, k] * rows[i, k]
    return len(rows)


@kernel(inline=True)
def add_entry(band: Any, edge: Any, corner: Any, one: int, other: int, value: float) -> None:
    """Add to an entry of the matrix: of its band, or beside that in one of the last columns."""
    inner = len(band)
    if other >= inner:
        if one >= inner:
            corner[one - inner, other - inner] += value
        else:
            edge[one, other - inner] += value
    elif one < inner:
        band[other, 2 * (band.shape[1] // 3) + one - other] += value


@kernel
def write_system(
    samples: Any,
    sample_node: Sequence[int],
    rows: Any,
    row_node: Sequence[int],
    others: int,
    scale: Any,
    places: Sequence[int],
    sums: Any,
    band: Any,
    edge: Any,
    corner: Any,
) -> int:
    """
    Add the squares of the residuals and the conditions to the matrix of a step.

    Unknowns and then conditions are at `places`. The band is in the form of LAPACK, transposed;
    the samples of a node are summed first.
    """
    shared = rows.shape[1] - PAIR
    width = samples.shape[1]
    i = 0
    while i < len(samples):
        node = sample_node[i]
        for a in range(width):
            for b in range(width):
                sums[a, b] = 0.0
        while i < len(samples) and sample_node[i] == node:
            for a in range(width):
                for b in range(a + 1):
                    sums[a, b] += samples[i, a] * samples[i, b]
            i += 1
        for a in range(width):
            one = column_of(a, node, SAMPLE, shared)
            for b in range(width):
                other = column_of(b, node, SAMPLE, shared)
                value = sums[max(a, b), min(a, b)] / (scale[one] * scale[other])
                add_entry(band, edge, corner, places[one], places[other], value)
    for i in range(len(rows)):
        for a in range(rows.shape[1]):
            if rows[i, a] == 0.0:
                continue
            one = column_of(a, row_node[i] - 1, PAIR, shared)
            value = rows[i, a] / scale[one]
            if i >= others:
                at = places[len(scale) + i - others]
                add_entry(band, edge, corner, at, places[one], value)
                add_entry(band, edge, corner, places[one], at, value)
                continue
            for b in range(rows.shape[1]):
                if rows[i, b] != 0.0:
                    other = column_of(b, row_node[i] - 1, PAIR, shared)
                    product = value * rows[i, b] / scale[other]
                    add_entry(band, edge, corner, places[one], places[other], product)
    return len(rows)


@kernel
def add_transposed(
    samples: Any,
    sample_node: Sequence[int],
    rows: Any,
    row_node: Sequence[int],
    right: Any,
    found: Any,
) -> int:
    """Add the products of the transposed derivatives of residuals with columns, by unknowns."""
    shared = rows.shape[1] - PAIR
    for i in range(len(samples)):
        for k in range(samples.shape[1]):
            column = column_of(k, sample_node[i], SAMPLE, shared)
            for c in range(right.shape[1]):
                found[column, c] += samples[i, k] * right[i, c]
    for i in range(len(right) - len(samples)):
        for k in range(rows.shape[1]):
            if rows[i, k] != 0.0:
                column = column_of(k, row_node[i] - 1, PAIR, shared)
                for c in range(right.shape[1]):
                    found[column, c] += rows[i, k] * right[len(samples) + i, c]
    return len(right)


@kernel
def solve_band(band: Any, pivots: Sequence[int], first: int, right: Any) -> int:
    """
    Solve a system by the factors of its band, as LAPACK has them, transposed.

    The right-hand sides, columns, are zero before a first row, and only the rows from there on are
    solved: LAPACK solves one after the other, which takes several times as long.
    """
    reach = band.shape[1] // 3
    most = right.shape[1]
    last = len(band) - 1
    for j in range(max(first - reach, 0), last):
        other = pivots[j]
        if other != j:
            for c in range(most):
                value = right[j, c]
                right[j, c] = right[other, c]
                right[other, c] = value
        for i in range(j + 1, min(j + reach, last) + 1):
            factor = band[j, 2 * reach + i - j]
            for c in range(most):
                right[i, c] -= factor * right[j, c]
    for done in range(last - first + 1):
        j = last - done
        pivot = band[j, 2 * reach]
        for c in range(most):
            right[j, c] /= pivot
        for i in range(max(first, j - 2 * reach), j):
            factor = band[j, 2 * reach + i - j]
            for c in range(most):
                right[i, c] -= factor * right[j, c]
    return last
