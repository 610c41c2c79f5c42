# ruff: noqa: ARG001
"""Laws of one's own, for the tests: good ones and bad ones."""

import math
import sys

from impact_damper_ros.control.state import gap_for_amplitude


def follow(seen, memory):
    """Place both stops by the amplitude at each passage, and count the passages."""
    if seen.crossing == 0:
        return math.nan, math.nan
    memory[0] += 1.0
    memory[1] = math.nan if seen.crossing > 0 else math.inf
    gap = 0.8 * gap_for_amplitude(seen.amplitude, seen.mass_ratio, seen.restitution, seen.gap_max)
    # Where m has not hit a stop for some passages, it may be at rest, and M takes a stop as far
    # as its amplitude.
    hit = not (math.isnan(seen.hit_time_1) and math.isnan(seen.hit_time_2))
    memory[4] = 0.0 if hit else memory[4] + 1.0
    half = 0.5 * gap if memory[4] < 3.0 else min(0.5 * gap, 0.9 * seen.amplitude)
    return half, -half


def push(seen, memory):
    """Close the stop that m flies to where it is, at each falling passage; open it again."""
    memory[2] = max(memory[2], abs(seen.y))
    if seen.crossing < 0 and seen.y_rate > 0.0 and seen.y > 0.0:
        memory[3] = seen.time
        return max(seen.y - 0.1, 0.0), math.nan
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


def crossed(seen, memory):
    return -5.0, 5.0


def too_close(seen, memory):
    return 5.0, 4.9995


def passes_the_other(seen, memory):
    memory[0] += 1.0
    return (5.0, math.nan) if memory[0] < 9.0 else (math.nan, 6.0)


def closest(seen, memory):
    """Keep the smallest gap about m, to round-off."""
    place = min(max(seen.y, -7.1), 7.1)
    return place + 0.5 * seen.gap_min, place - 0.5 * seen.gap_min


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
