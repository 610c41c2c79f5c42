# SPDX-License-Identifier: Apache-2.0
"""Passages of X through zero: the search for the next one of a flight, as for its first event."""

from __future__ import annotations

from math import inf, nan, nextafter

from .certificate import ERROR, falling_root, falls, keeps_sign
from .first_event import root_by_series
from .first_root import bounds_of, first_root
from .flight import PASSAGE, Motion, motion_at, oscillator_of, starting_motion
from .kernels import kernel
from .oscillator import POINTS
from .series import Series, series_at
from .state import Moving, Run, advance_time
from .waves import next_point, turn_back


@kernel
def starting_side(moving: Moving) -> int:
    """Return the sign of X just after the origin: as stored, or if that is 0 from X."""
    run = moving.run
    if run.side != 0:
        return run.side
    motion: Motion = starting_motion(moving)
    leading = motion.x
    if leading == 0.0:
        leading = motion.velocity
    if leading == 0.0:
        leading = motion.x_2
    if leading == 0.0:
        leading = motion.x_3
    if leading == 0.0:
        leading = motion.x_4
    return -1 if leading < 0.0 else 1


@kernel
def passage_by_series(
    moving: Moving,
    t_a: float,
    x_a: float,
    velocity_a: float,
    x_b: float,
    velocity_b: float,
    bound_3: float,
) -> float:
    """Return where X falls to zero on its side in a step, at whose end the waves are, or NaN."""
    constants, lines, run, waves, _ = moving
    oscillator = oscillator_of(constants, run)
    step = oscillator.step
    side = 1.0 * run.crossing_side
    if not (
        side * x_a > ERROR * abs(x_b)
        and side * x_b <= 0.0
        and falls(side * velocity_a, side * velocity_b, step, bound_3)
    ):
        return nan
    guess = falling_root(side * x_a, side * velocity_a, side * x_b, side * velocity_b, step)
    t, x, velocity = t_a + step, x_b, velocity_b
    # The series about the nearer point
    if guess > 0.5 * step:
        guess -= step
    else:
        t, x, velocity = t_a, x_a, velocity_a
        turn_back(lines, run.first, waves)
    resting = run.constant * oscillator.inverse_square
    series: Series = series_at(oscillator, lines, run.first, waves, x - resting, velocity)
    s, u, _, _, _ = root_by_series(
        series,
        side,
        side * x,
        side * velocity * step,
        side * series.x_2,
        guess * oscillator.steps,
        t * oscillator.steps,
    )
    tau = t + (s + u) * step
    return tau if t_a < tau <= t_a + step else nan


@kernel
def search_passage(moving: Moving) -> None:
    """Search the next steps of the grid for a passage of X through zero."""
    constants, lines, run, waves, _ = moving
    if run.crossing_side == 0:
        run.crossing_side = starting_side(moving)
    oscillator = oscillator_of(constants, run)
    step = oscillator.step
    side = 1.0 * run.crossing_side
    start = run.watched
    if start == 0.0:
        motion: Motion = starting_motion(moving)
    else:
        motion = motion_at(moving, start)
    bound_3, bound_4 = bounds_of(oscillator, PASSAGE, motion)
    x_x = oscillator.x_x
    x_v = oscillator.x_v
    v_x = oscillator.v_x
    v_v = oscillator.v_v
    resting = run.constant * oscillator.inverse_square
    x_a = motion.x
    velocity_a = motion.velocity
    for k in range(POINTS):
        t_a = start + step * k
        offset, velocity_b = next_point(
            lines, run.first, waves, x_a - resting, velocity_a, x_x, x_v, v_x, v_v
        )
        x_b = resting + offset
        run.watched = start + step * (k + 1)
        error = ERROR * (abs(x_a) + abs(x_b) + abs(resting) + abs(velocity_b) * step)
        least = side * x_a - error
        if t_a == 0.0 and abs(x_a) <= error and side * velocity_a > 0.0:
            # X leaves zero.
            least = 0.0
        if not keeps_sign(
            least,
            side * velocity_a,
            side * x_b - error,
            side * velocity_b,
            step,
            bound_4,
        ):
            root = passage_by_series(moving, t_a, x_a, velocity_a, x_b, velocity_b, bound_3)
            if root != root:
                if t_a > start:
                    motion = motion_at(moving, t_a)
                end = run.watched
                root = first_root(moving, PASSAGE, t_a, motion, end, step)
            if root < inf:
                run.watched = root
                instant, _ = advance_time(run.time, run.time_low, root)
                # A passage at the origin belongs to this flight and comes after it.
                run.crossing = max(nextafter(run.time, inf), instant)
            # The waves are at another instant now: the search begins again from here.
            return
        x_a = x_b
        velocity_a = velocity_b


@kernel
def pass_zero(run: Run) -> None:
    """Continue the search after a passage of X through zero."""
    run.crossing_side = -run.crossing_side
    run.crossing = inf


_NEAR_ZERO = 1e-9


@kernel
def set_side(moving: Moving, before: int) -> None:
    """Take over the side of X at a new origin from the flight before, where X is zero there."""
    constants, lines, run, waves, _ = moving
    scale = abs(run.velocity) * constants.free.horizon
    for j in range(len(waves)):
        scale += abs(lines[j].force) / constants.free.omega_squared
    run.side = 0 if abs(run.x) > _NEAR_ZERO * scale else before
