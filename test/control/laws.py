# ruff: noqa: ARG001
"""Laws of one's own, for the tests: good ones and bad ones."""

import math
import sys

from impact_damper_ros.control.law import optimal_gap


def follow(seen, memory):
    """Place both stops by the amplitude at each passage, and count the passages."""
    if seen.crossing == 0:
        return math.nan, math.nan
    memory[0] += 1.0
    memory[1] = math.nan if seen.crossing > 0 else math.inf
    gap = 0.8 * optimal_gap(seen.amplitude, seen.mass_ratio, seen.restitution, seen.gap_max)
    return 0.5 * gap, -0.5 * gap


def push(seen, memory):
    """Close the stop that m flies to where it is, at each falling passage; open it again."""
    memory[2] = max(memory[2], abs(seen.y))
    if seen.crossing < 0 and seen.y_rate > 0.0:
        memory[3] = seen.time
        return seen.y - 0.1, math.nan
    if seen.time > memory[3] + 0.25 * seen.half_cycle:
        return 12.0, -12.0 - 0.001 * seen.crossing
    return math.nan, math.nan


def one_argument(seen):
    return 1.0, -1.0


def fails(seen, memory):
    raise ZeroDivisionError('by nought')


def raises_late(seen, memory):
    memory[0] += 1.0
    if memory[0] > 20.0:
        raise ValueError('enough')
    return 5.0, -5.0


def far(seen, memory):
    return math.inf, -1.0


def wide(seen, memory):
    return 1.0, -600.0


def words(seen, memory):
    return 'up', 'down'


def nothing(seen, memory):
    pass


def forgets(seen, memory):
    memory.clear()
    return 1.0, -1.0


number = 3


def beyond_floats(seen, memory):
    return 10**400, -1


def breaks(seen, memory):
    yield 1.0
    raise RuntimeError('broken')


def exits(seen, memory):
    sys.exit(3)


def talks(seen, memory):
    raise RuntimeError('x' * 10_000)
