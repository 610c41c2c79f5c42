"""
First root of a smooth function, certified by bounds of its derivatives, in multiprecision.

On a cell where a derivative of order 0, 1 or 2 provably keeps its sign, the number of roots and
their place are known; any other cell is halved.  A root at the start of the search, of known
multiplicity, is not counted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from oracle.precise_motion import Motion, Relative, mp

TINY = mp.mpf(10) ** -95


class Watched:
    """
    A function offset + sign * Y^(shift), positive until the event it watches for.

    Parameters
    ----------
    kind : str
        Name of the event at its root.
    motion : Motion or Relative
        What gives Y and its derivatives.
    sign : int
        Of Y in the function.
    shift : int
        Derivative of Y that is watched.
    offset : mpf
        Constant term.
    order : int
        Multiplicity of the root at the start (0 if the function is positive there).

    """

    def __init__(
        self, kind: str, motion: Motion | Relative, sign: int, shift: int, offset: Any, order: int
    ) -> None:
        self.kind, self.motion, self.sign = kind, motion, sign
        self.shift, self.offset, self.order = shift, offset, order
        self.bound: list[Any] = []

    def limit(self, horizon: Any) -> None:
        """Fix the bounds of the derivatives, valid up to the horizon."""
        self.bound = self.motion.bounds(horizon)[self.shift :]

    def __call__(self, tau: Any) -> list[Any]:
        """Return the function and its derivatives."""
        values = [self.sign * value for value in self.motion.derivatives(tau)[self.shift :]]
        values[0] += self.offset
        return values

    def first_cell(self) -> Any:
        """Return the length after the start that provably holds no root, if a root is there."""
        if self.order == 0:
            return mp.inf
        slope = self(mp.mpf(0))[self.order]
        if not slope > 0:
            raise ArithmeticError(f'{self.kind}: the search starts beyond the event')
        return slope / self.bound[self.order + 1] * mp.mpf('0.9')

    def suspicious(self, nodes: np.ndarray) -> np.ndarray:
        """Return which cells between the nodes cannot be cleared in double precision."""
        values = float(self.offset) + self.sign * self.motion.grid(nodes, self.shift)
        step = float(nodes[1] - nodes[0])
        # Where the terms cancel, as next to resonance, nothing can be cleared here.
        size = float(abs(self.offset) + self.motion.terms(self.shift, mp.mpf(nodes[-1])))
        floor = step * step / 8 * float(self.bound[2]) * 1.001 + 1e-9 * size
        return np.minimum(values[:-1], values[1:]) <= floor


def polish(f: Any, low: Any, high: Any, order: int = 0) -> Any:
    """
    Return the root of f^(order) between two instants where it has opposite signs.

    Newton's method, kept inside the bracket by bisection, until the step is lost in round-off.
    """
    rising = f(high)[order] > 0
    tau = (low + high) / 2
    for _ in range(1000):
        values = f(tau)
        g, slope = values[order], values[order + 1]
        if g == 0:
            return tau
        if (g > 0) == rising:
            high = tau
        else:
            low = tau
        following = tau - g / slope if slope else low
        if not low < following < high:
            following = (low + high) / 2
        if abs(following - tau) <= mp.mpf(10) ** -100 * tau or high - low <= mp.eps * 8 * high:
            return following
        if abs(following - tau) <= mp.mpf(10) ** -55 * tau:
            # One more step of a quadratic iteration is below round-off: skip the bookkeeping.
            values = f(following)
            return following - values[order] / values[order + 1]
        tau = following
    raise ArithmeticError('the polishing of a root did not converge')


def root_in_cell(f: Watched, a: Any, b: Any, order: int, depth: int = 0) -> Any:
    """
    Return the first root of f in (a, b], or None if there provably is none.

    Parameters
    ----------
    f : Watched
        Positive at a, or just after a when it has a root of multiplicity `order` there.
    a, b : mpf
        Ends of the cell.
    order : int
        Multiplicity of the root at a.
    depth : int
        Of the recursion.

    """
    h = b - a
    middle = f(a + h / 2)
    bound = f.bound
    if order == 0 and middle[0] - abs(middle[1]) * h / 2 - bound[2] * h * h / 8 > 0:
        return None
    if order and middle[order] > bound[order + 1] * h / 2:
        return None
    start, end = f(a), f(b)
    if order == 0 and abs(middle[1]) > bound[2] * h / 2:
        return polish(f, a, b) if end[0] <= 0 else None
    if order <= 1 and abs(middle[2]) > bound[3] * h / 2:
        if middle[2] < 0:  # concave: it ends below zero, or stays above
            if end[0] > 0:
                return None
            return polish(f, polish(f, a, b, 1) if start[1] > 0 else a, b)
        if order == 1 or start[1] >= 0:
            return None
        if end[1] <= 0:
            return polish(f, a, b) if end[0] <= 0 else None
        lowest = polish(f, a, b, 1)
        value = f(lowest)[0]
        if abs(value) <= TINY * (1 + abs(f.offset)):
            return lowest
        return polish(f, a, lowest) if value < 0 else None
    if depth > 500:
        raise ArithmeticError(f'{f.kind}: a cell of length {mp.nstr(h, 5)} cannot be resolved')
    root = root_in_cell(f, a, a + h / 2, order, depth + 1)
    return root if root is not None else root_in_cell(f, a + h / 2, b, 0, depth + 1)


def first_event(functions: list[Watched], step: Any, horizon: Any) -> tuple[str, Any] | None:
    """
    Return the name and the instant of the first event before the horizon.

    Parameters
    ----------
    functions : list of Watched
        All that can end the motion.
    step : mpf
        Cell length of the double-precision look, fine compared to every period.
    horizon : mpf
        Where the search ends.

    """
    if not horizon > 0:
        return None
    for f in functions:
        f.limit(horizon)
    # Cells that double in length cover the start, where a function may be tiny.
    cell = min(f.first_cell() for f in functions)
    a = mp.mpf(0)
    b = min(cell, step, horizon)
    while a < horizon and b < step:
        found = _in_cell(functions, a, b)
        if found or b >= horizon:
            return found
        a, b = b, min(2 * b, horizon)
    if a < step:
        b = min(step, horizon)
        found = _in_cell(functions, a, b)
        if found or b >= horizon:
            return found
        a = b
    while a < horizon:
        count = int(min(256, mp.ceil((horizon - a) / step)))
        nodes = [a + k * step for k in range(count + 1)]
        rough = np.array([float(node) for node in nodes])
        flagged = np.logical_or.reduce([f.suspicious(rough) for f in functions])
        for k in np.flatnonzero(flagged):
            found = _in_cell(functions, nodes[k], min(nodes[k + 1], horizon))
            if found:
                return found
        a = nodes[-1]
    return None


def _in_cell(functions: list[Watched], a: Any, b: Any) -> tuple[str, Any] | None:
    roots = [(root_in_cell(f, a, b, 0 if a else f.order), f.kind) for f in functions]
    found = [(root, kind) for root, kind in roots if root is not None and root <= b]
    if not found:
        return None
    root, kind = min(found, key=lambda pair: pair[0])
    return kind, root
