"""
The certified first event of a flight.

A flight watches a few functions: clearances, the relative speed, the remaining support. The search
goes along a grid first. Between two points a function and its first derivative are known at both
ends and its fourth derivative is bounded, so that it lies within bound step^4/384 of the Hermite
cubic. As long as this excludes an event, the search goes on to the next point. Where it does not,
certified steps take over (`certificate`): the flight advances by the least of the steps of all
watched functions until a step ends on a root. Grazing contacts and double roots are thus found,
and a flight without events is known to have none.

"Just left the stop" is handled here only. A flight that begins on a stop has exactly zero
clearance and a positive rate there, which a certified step accepts. A flight that begins with a
release has neither; its jerk leads it away.
"""

from __future__ import annotations

from math import copysign, cos, floor, inf, sin, sqrt

from .certificate import ROUND_OFF, keeps_sign, least_step, look_ahead, look_past, safe_step
from .flight import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    Flight,
    FlightEnd,
    GridPoint,
    Motion,
    end_at,
    motion_at,
    unfinished,
)
from .kernels import kernel
from .oscillator import Oscillator, derivative_bound
from .roots import (
    GRID_ERROR,
    Relative,
    acceleration_of,
    base_point,
    contact_root,
    falling_root,
    jerk_of,
    next_point,
    polished,
)

# Results of `_in_doubt`
_CLOSING, _CLEAR, _ENDED = range(3)


@kernel
def _turn(
    flight: Flight,
    side: float,
    point: GridPoint,
    start: Relative,
    rate: float,
    t_b: float,
    speed_b: float,
    rate_b: float,
    bound_5: float,
    error: float,
) -> FlightEnd:
    """Return the reversal between two grid points, or the contact that comes before it."""
    t_a = start.tau
    speed_a = side * start.speed
    rate_a = side * rate
    if not (speed_a > error and speed_b < -error):
        return unfinished(NO_EVENT, t_a)
    guess = falling_root(speed_a, rate_a, speed_b, rate_b, t_b - t_a)
    end: FlightEnd = polished(flight, REVERSAL, int(side), t_a + guess, t_a, t_b)
    if end.kind == NO_EVENT:
        return end
    # Backwards from there the speed only grows: it is the first reversal.
    span = end.tau - t_a
    if not keeps_sign(0.0, -end.slope, speed_a, -rate_a, span, bound_5, error):
        return unfinished(NO_EVENT, t_a)
    clearance = flight.clearance_1 if side > 0.0 else flight.clearance_2
    left = clearance - side * end.travel
    if left > GRID_ERROR * (abs(end.x) + abs(flight.x) + abs(end.travel)):
        return end
    if left >= 0.0:
        return unfinished(NO_EVENT, t_a)
    guess = falling_root(clearance - side * start.travel, -speed_a, left, 0.0, span)
    return contact_root(flight, side, point, start, rate, guess, t_a, end.tau)


@kernel
def _in_doubt(
    flight: Flight,
    motion: Motion,
    point_a: GridPoint,
    a: Relative,
    rate_a: float,
    point_b: GridPoint,
    b: Relative,
    error: float,
) -> tuple[int, float, FlightEnd]:
    """Examine a step in which the speeds alone do not show that m approaches a stop."""
    oscillator = flight.oscillator
    step = oscillator.grid.step
    fall = flight.relative_acceleration + flight.acceleration
    side = float(flight.direction)
    if side == 0.0:
        side = 1.0 if a.speed > 0.0 or (a.speed == 0.0 and rate_a > 0.0) else -1.0
    bound_5 = derivative_bound(oscillator, motion.x_5, motion.x_6, oscillator.grid.bound_5)
    rate_b = fall - acceleration_of(oscillator, point_b)
    if keeps_sign(
        side * a.speed, side * rate_a, side * b.speed, side * rate_b, step, bound_5, error
    ):
        return _CLOSING, side, unfinished(NO_EVENT, a.tau)
    if flight.direction != 0:
        speed_b = side * b.speed
        end: FlightEnd = _turn(
            flight, side, point_a, a, rate_a, b.tau, speed_b, side * rate_b, bound_5, error
        )
        return _ENDED, side, end
    error = GRID_ERROR * (abs(b.x) + abs(flight.x) + abs(a.travel) + abs(b.travel))
    bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.grid.bound_4)
    for side in (1.0, -1.0):
        clearance = flight.clearance_1 if side > 0.0 else flight.clearance_2
        if clearance < inf and not keeps_sign(
            clearance - side * a.travel,
            -side * a.speed,
            clearance - side * b.travel,
            -side * b.speed,
            step,
            bound_4,
            error,
        ):
            return _ENDED, side, unfinished(NO_EVENT, a.tau)
    return _CLEAR, 0.0, unfinished(NO_EVENT, a.tau)


@kernel(inline=True)
def _relative(
    first: Relative,
    rest: float,
    step: float,
    point: GridPoint,
    reached: float,
    travel: float,
    speed: float,
) -> Relative:
    """Return the relative motion at a grid point, `reached` steps after the first one."""
    x = first.x if reached == 0.0 else rest + point.offset
    return Relative(first.tau + step * reached, x, travel, speed)


@kernel(inline=True)
def _rate(
    oscillator: Oscillator, first: float, fall: float, point: GridPoint, reached: float
) -> float:
    """Return the relative acceleration at a grid point, as known already at the first one."""
    return first if reached == 0.0 else fall - acceleration_of(oscillator, point)


@kernel(inline=True)
def search_contact(flight: Flight, tau: float, motion: Motion) -> FlightEnd:
    """Search relative motion along the grid."""
    oscillator = flight.oscillator
    grid = oscillator.grid
    step = grid.step
    rest = flight.constant / oscillator.omega_squared
    # The damper mass alone
    fall = flight.relative_acceleration + flight.acceleration
    launched = flight.relative_velocity + flight.velocity
    # How far the speed may fall below its values at both points
    bound_3 = derivative_bound(oscillator, motion.x_3, motion.x_4, grid.bound_3)
    sag = 0.125 * step * step * bound_3
    leading = float(flight.direction)
    point_a: GridPoint = base_point(flight, tau, motion)
    first = Relative(tau, motion.x, motion.travel, motion.relative_velocity)
    travel_a = first.travel
    speed_a = first.speed
    reached = 0.0
    while reached < grid.points:
        point_b: GridPoint = next_point(oscillator, point_a)
        t_b = tau + step * (reached + 1.0)
        x_b = rest + point_b.offset
        travel_b = t_b * (launched + 0.5 * fall * t_b) - (x_b - flight.x)
        speed_b = launched + fall * t_b - point_b.velocity
        # The stop that m approaches, as long as the speeds are clear
        side = leading if leading != 0.0 else copysign(1.0, speed_a)
        error = GRID_ERROR * (abs(point_b.velocity) + abs(speed_b) + abs(speed_a))
        clear = False
        if not min(side * speed_a, side * speed_b) > sag + error:
            a = _relative(first, rest, step, point_a, reached, travel_a, speed_a)
            rate = _rate(oscillator, motion.relative_2, fall, point_a, reached)
            b = Relative(t_b, x_b, travel_b, speed_b)
            verdict, side, end = _in_doubt(flight, motion, point_a, a, rate, point_b, b, error)
            if verdict == _ENDED:
                return end
            clear = verdict == _CLEAR
        clearance = flight.clearance_1 if side > 0.0 else flight.clearance_2
        left = clearance - side * travel_b
        if left <= 0.0 and not clear:
            guess = falling_root(
                clearance - side * travel_a, -side * speed_a, left, -side * speed_b, step
            )
            low = tau + step * reached
            if guess > 0.5 * step:
                point_a = point_b
                travel_a = travel_b
                speed_a = speed_b
                reached += 1.0
                guess -= step
            a = _relative(first, rest, step, point_a, reached, travel_a, speed_a)
            rate = _rate(oscillator, motion.relative_2, fall, point_a, reached)
            return contact_root(flight, side, point_a, a, rate, guess, low, t_b)
        point_a = point_b
        travel_a = travel_b
        speed_a = speed_b
        reached += 1.0
    return unfinished(NO_EVENT, tau + step * reached)


@kernel
def search_release(flight: Flight, tau: float, motion: Motion) -> FlightEnd:
    """Search joint motion along the grid for the support to give way."""
    oscillator = flight.oscillator
    grid = oscillator.grid
    point = base_point(flight, tau, motion)
    drive_5 = 0.0
    for j in range(len(point.sines)):
        frequency = oscillator.harmonics[j].frequency
        square = frequency * frequency
        force = oscillator.harmonics[j].force
        drive_5 += force * (square * square * frequency) * point.cosines[j]
    x_7 = drive_5 - 2.0 * oscillator.decay * motion.x_6 - oscillator.omega_squared * motion.x_5
    bound_6 = derivative_bound(oscillator, motion.x_6, x_7, grid.bound_6)
    t_a = tau
    x_2 = motion.x_2
    x_3 = motion.x_3
    for k in range(grid.points):
        point = next_point(oscillator, point)
        t_b = tau + grid.step * (k + 1)
        x_2_b = acceleration_of(oscillator, point)
        x_3_b = jerk_of(oscillator, point, x_2_b)
        error = GRID_ERROR * (
            oscillator.omega_squared * abs(point.offset)
            + abs(point.velocity * oscillator.decay)
            + abs(x_2_b)
            + abs(flight.constant)
            + abs(flight.slope)
        )
        failing = 0
        for side in (1, -1):
            most = flight.support_high if side > 0 else -flight.support_low
            if most < inf and not keeps_sign(
                most - side * (x_2 - flight.slope),
                -side * x_3,
                most - side * (x_2_b - flight.slope),
                -side * x_3_b,
                grid.step,
                bound_6,
                error,
            ):
                if failing != 0:
                    return unfinished(NO_EVENT, t_a)
                failing = side
        if failing != 0:
            most = flight.support_high if failing > 0 else -flight.support_low
            left_a = most - failing * (x_2 - flight.slope)
            left_b = most - failing * (x_2_b - flight.slope)
            if not (left_a > error and left_b < -error):
                return unfinished(NO_EVENT, t_a)
            guess = falling_root(left_a, -failing * x_3, left_b, -failing * x_3_b, grid.step)
            kind = RELEASE_UP if failing > 0 else RELEASE_DOWN
            end: FlightEnd = polished(flight, kind, failing, t_a + guess, t_a, t_b)
            # Backwards from there the remaining support only grows: it is the first release.
            if end.kind != NO_EVENT and keeps_sign(
                0.0, -end.slope, left_a, failing * x_3, end.tau - t_a, bound_6, error
            ):
                return end
            return unfinished(NO_EVENT, t_a)
        t_a = t_b
        x_2 = x_2_b
        x_3 = x_3_b
    return unfinished(NO_EVENT, t_a)


_EPSILON = 2.220446049250313e-16
#: More steps than any search takes.
ALL_STEPS = 2**62


@kernel
def _leave_support(flight: Flight, motion: Motion) -> float:
    """
    Return how long m certainly moves on after its support has given way; negative if it stays.

    Relative velocity and acceleration are zero then. With jerk j and a bound B of the next
    derivative the speed is positive for u < 3 j/B, the clearance left behind for u < 4 j/B.
    """
    oscillator = flight.oscillator
    horizon = oscillator.horizon
    away = flight.direction
    if away == 0:
        away = -1 if flight.clearance_1 == 0.0 else 1
    jerk = -away * motion.x_3
    terms = (
        oscillator.omega_squared * abs(motion.velocity)
        + 2.0 * oscillator.decay * abs(motion.x_2)
        + oscillator.bound_3
    )
    if jerk < -ROUND_OFF * terms:
        return -1.0
    bound = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
    if jerk <= ROUND_OFF * terms:
        # The sign of the jerk is round-off; within this step m moves by less than round-off.
        jerk = max(jerk, 0.0)
        step = least_step(horizon)
    elif 1.5 * jerk < bound * horizon:
        step = 1.5 * jerk / bound
    else:
        step = horizon
    # Neither the stop ahead nor the target of a following stop may be reached in that step.
    jerk_bound = jerk + bound * horizon
    if flight.arrival < inf:
        step = min(step, safe_step(flight.arrival, 0.0, 0.0, jerk_bound, horizon))
    opening_1 = flight.stop_velocity_1
    opening_2 = -flight.stop_velocity_2
    ahead = flight.direction >= 0 or opening_1 < 0.0
    if ahead and (flight.clearance_1 > 0.0 or opening_1 > 0.0):
        step = min(step, safe_step(flight.clearance_1, opening_1, 0.0, jerk_bound, horizon))
    ahead = flight.direction <= 0 or opening_2 < 0.0
    if ahead and (flight.clearance_2 > 0.0 or opening_2 > 0.0):
        step = min(step, safe_step(flight.clearance_2, opening_2, 0.0, jerk_bound, horizon))
    return step


@kernel
def _approach(
    oscillator: Oscillator,
    motion: Motion,
    clearance: float,
    closing: float,
    side: int,
    bound_3: float,
    tau: float,
) -> tuple[float, bool]:
    """
    Look ahead for contact with the stop on one side, +1 for stop 1 and -1 for stop 2.

    `closing` is the rate at which m approaches it. As long as m recedes, it cannot hit it; just
    after a release this gives a longer step than the clearance, which is still tiny.
    """
    horizon = oscillator.horizon
    closing_1 = side * motion.relative_2
    ahead, root = look_ahead(clearance, -closing, -closing_1, bound_3, horizon, tau)
    if ahead < horizon and closing < 0.0:
        bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
        receding = safe_step(-closing, -closing_1, side * motion.x_3, bound_4, horizon)
        if receding > ahead:
            return receding, False
    return ahead, root


@kernel(inline=True)
def _first_in_motion(flight: Flight, tau: float, limit: float, most: int) -> FlightEnd:
    """Step through relative motion; see `flight_end`."""
    oscillator = flight.oscillator
    direction = flight.direction
    horizon = oscillator.horizon
    motion: Motion = motion_at(flight, tau)
    velocity_1 = flight.stop_velocity_1
    velocity_2 = flight.stop_velocity_2
    supported = (
        direction != 0
        or (flight.clearance_1 == 0.0 and velocity_1 == 0.0)
        or (flight.clearance_2 == 0.0 and velocity_2 == 0.0)
    )
    still = flight.relative_velocity == 0.0 and flight.relative_acceleration == 0.0
    if tau == 0.0 and supported and still:
        tau = _leave_support(flight, motion)
        if tau < 0.0:
            return unfinished(REVERSAL, 0.0)
        motion = motion_at(flight, tau)
    # The stop that m leaves is watched only if it moves after m.
    watched_1 = direction >= 0 or velocity_1 < 0.0
    watched_2 = direction <= 0 or velocity_2 > 0.0
    quick = flight.arrival == inf and velocity_1 == 0.0 and velocity_2 == 0.0
    while tau <= limit and most > 0:
        most -= 1
        if quick:
            end: FlightEnd = search_contact(flight, tau, motion)
            if end.kind != NO_EVENT:
                return end
            if end.tau > tau:
                tau = end.tau
                motion = motion_at(flight, tau)
                continue
        bound_3 = derivative_bound(oscillator, motion.x_3, motion.x_4, oscillator.bound_3)
        speed = motion.relative_velocity
        rate = motion.relative_2
        step = horizon
        kind = NO_EVENT
        found = False
        if watched_1:
            clearance = flight.clearance_1 + velocity_1 * tau - motion.travel
            closing = speed - velocity_1
            if clearance <= 0.0:
                if closing > 0.0:
                    return unfinished(CONTACT_1, tau)
                clearance = 0.0
            ahead, root = _approach(oscillator, motion, clearance, closing, 1, bound_3, tau)
            if ahead < step:
                step = ahead
                kind = CONTACT_1
                found = root
        if watched_2:
            clearance = flight.clearance_2 - velocity_2 * tau + motion.travel
            closing = velocity_2 - speed
            if clearance <= 0.0:
                if closing > 0.0:
                    return unfinished(CONTACT_2, tau)
                clearance = 0.0
            ahead, root = _approach(oscillator, motion, clearance, closing, -1, bound_3, tau)
            if ahead < step:
                step = ahead
                kind = CONTACT_2
                found = root
        if direction != 0:
            along = direction * speed
            along_1 = direction * rate
            along_2 = -direction * motion.x_3
            if flight.arrival < inf:
                distance = flight.arrival - direction * motion.travel
                if distance <= 0.0:
                    return unfinished(ARRIVAL, tau)
                ahead, root = look_ahead(distance, -along, -along_1, bound_3, horizon, tau)
                if ahead < step:
                    step = ahead
                    kind = ARRIVAL
                    found = root
            if along <= 0.0:
                if along_1 < 0.0 or (along_1 == 0.0 and along_2 <= 0.0):
                    return unfinished(REVERSAL, tau)
                along = 0.0
            bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
            ahead, root = look_past(
                along, along_1, along_2, bound_4, horizon, tau, abs(motion.velocity)
            )
            if ahead < step:
                step = ahead
                kind = REVERSAL
                found = root
        if found:
            return unfinished(kind, tau + step)
        tau += max(step, _EPSILON * tau)
        motion = motion_at(flight, tau)
    return unfinished(NO_EVENT, tau)


#: Horizons after which joint motion is looked at as a whole, and later than any motion lasts, s.
_LOOK = 64.0
_FOR_EVER = 1e300
#: Part of a bound by which the support must exceed it.
_MARGIN = 1e-6


@kernel
def _holds_for_ever(flight: Flight, tau: float, motion: Motion) -> bool:
    """
    Return whether joint motion certainly goes on for ever after a time.

    X'' is the sum of the steady vibration, whose amplitude is known, and of a free one, which
    never grows.
    """
    oscillator = flight.oscillator
    omega_squared = oscillator.omega_squared
    free = motion.x_2
    rate = motion.x_3
    most = 0.0
    for j in range(len(flight.sines)):
        harmonic = oscillator.harmonics[j]
        frequency = harmonic.frequency
        square = frequency * frequency
        stiff = omega_squared - square
        dashpot = 2.0 * oscillator.decay * frequency
        gain = stiff * stiff + dashpot * dashpot
        if gain == 0.0:
            return False
        turned = frequency * tau
        sine = flight.sines[j] * cos(turned) + flight.cosines[j] * sin(turned)
        cosine = flight.cosines[j] * cos(turned) - flight.sines[j] * sin(turned)
        push = square * harmonic.force / gain
        free += push * (stiff * sine - dashpot * cosine)
        rate += push * frequency * (stiff * cosine + dashpot * sine)
        most += abs(push) * sqrt(gain)
    most += sqrt(free * free + rate * rate / omega_squared)
    most += _MARGIN * (most + abs(flight.slope))
    return most - flight.slope < flight.support_high and -most - flight.slope > flight.support_low


@kernel
def _first_in_joint(flight: Flight, tau: float, limit: float, most: int) -> FlightEnd:
    """Step through joint motion until the support gives way; see `flight_end`."""
    oscillator = flight.oscillator
    horizon = oscillator.horizon
    look = (floor(tau / (_LOOK * horizon)) + 1.0) * (_LOOK * horizon)
    while tau <= limit and most > 0:
        most -= 1
        motion: Motion = motion_at(flight, tau)
        if tau >= look:
            # m may stick for days, and whoever takes over the rig then searches anew.
            if _holds_for_ever(flight, tau, motion):
                return unfinished(NO_EVENT, _FOR_EVER)
            look = 2.0 * tau
        end: FlightEnd = search_release(flight, tau, motion)
        if end.kind != NO_EVENT:
            return end
        if end.tau > tau:
            tau = end.tau
            continue
        bound_5 = derivative_bound(oscillator, motion.x_5, motion.x_6, oscillator.bound_5)
        need = motion.x_2 - flight.slope
        terms = oscillator.omega_squared * abs(motion.x) + abs(motion.x_2) + abs(flight.slope)
        step = horizon
        kind = NO_EVENT
        found = False
        if flight.support_high < inf:
            left = flight.support_high - need
            if left <= 0.0:
                if motion.x_3 > 0.0:
                    return unfinished(RELEASE_UP, tau)
                left = 0.0
            ahead, root = look_past(left, -motion.x_3, -motion.x_4, bound_5, horizon, tau, terms)
            if ahead < step:
                step = ahead
                kind = RELEASE_UP
                found = root
        if flight.support_low > -inf:
            left = need - flight.support_low
            if left <= 0.0:
                if motion.x_3 < 0.0:
                    return unfinished(RELEASE_DOWN, tau)
                left = 0.0
            ahead, root = look_past(left, motion.x_3, motion.x_4, bound_5, horizon, tau, terms)
            if ahead < step:
                step = ahead
                kind = RELEASE_DOWN
                found = root
        if found:
            return unfinished(kind, tau + step)
        tau += max(step, _EPSILON * tau)
    return unfinished(NO_EVENT, tau)


@kernel
def _end_on_stop(flight: Flight, kind: int, tau: float) -> FlightEnd:
    """Return the end of a flight by a contact at a root that certified steps have found."""
    motion: Motion = motion_at(flight, tau)
    side = 1.0 if kind == CONTACT_1 else -1.0
    clearance = flight.clearance_1 if kind == CONTACT_1 else flight.clearance_2
    opening = side * (flight.stop_velocity_1 if kind == CONTACT_1 else flight.stop_velocity_2)
    closing = side * motion.relative_velocity - opening
    # Late in a flight m moves by more than its round-off in the last digit of the time.
    change = 0.0
    if closing > 0.0:
        change = (clearance + opening * tau - side * motion.travel) / closing
        most = 4.0 * _EPSILON * tau
        change = min(max(change, -most), most)
    return FlightEnd(
        kind,
        tau,
        motion.x + change * motion.velocity,
        motion.velocity + change * motion.x_2,
        motion.travel + change * motion.relative_velocity,
        motion.relative_velocity + change * motion.relative_2,
        -closing,
        True,
    )


@kernel(inline=True)
def flight_end(flight: Flight, searched: float, limit: float, most: int = ALL_STEPS) -> FlightEnd:
    """
    Find the end of a flight: its first event, and the motion there.

    Parameters
    ----------
    flight, searched, limit : Flight, float, float
        As for `first_event`.
    most : int, optional
        Most steps to search. The times searched do not depend on it.

    Returns
    -------
    FlightEnd
        The event, or with kind `NO_EVENT` the time searched; not beyond the limit if all steps
        were used.
    """
    if searched > limit:
        return unfinished(NO_EVENT, searched)
    until = min(limit, flight.deadline)
    if flight.joint:
        end = _first_in_joint(flight, searched, until, most)
    else:
        end = _first_in_motion(flight, searched, until, most)
    if end.tau > flight.deadline:
        end = unfinished(flight.deadline_kind, flight.deadline)
    if end.kind in (CONTACT_1, CONTACT_2) and not (end.finished or flight.joint):
        end = _end_on_stop(flight, end.kind, end.tau)
    elif end.kind != NO_EVENT and not end.finished:
        end = end_at(flight, end.kind, end.tau)
    return end


@kernel
def chatter_end(flight: Flight, left: float) -> FlightEnd:
    """Return the end of the flight in which a chatter accumulates after the given time."""
    kind = NO_EVENT
    if flight.deadline <= left:
        kind = flight.deadline_kind
        left = flight.deadline
    return end_at(flight, kind, left)


@kernel
def first_event(flight: Flight, searched: float, limit: float) -> tuple[int, float]:
    """
    Find the first event of a flight after a time that it is known to pass.

    Parameters
    ----------
    flight : Flight
        The flight, with what it watches.
    searched : float
        Time since the flight's origin up to which there is no event: 0, or what an earlier call
        returned with `NO_EVENT`. The times searched do not depend on the limits.
    limit : float
        Stop searching once the search is beyond this time.

    Returns
    -------
    kind : int
        `CONTACT_1`, `CONTACT_2`, `REVERSAL`, `ARRIVAL`, `RELEASE_UP`, `RELEASE_DOWN`,
        `STOP_ARRIVED_1` or `STOP_ARRIVED_2`; or `NO_EVENT`, if there is none up to the returned
        time. It may be beyond the limit.
    tau : float
        The event's time since the origin, or the time searched.
    """
    end: FlightEnd = flight_end(flight, searched, limit)
    return end.kind, end.tau
