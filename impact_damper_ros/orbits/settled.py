"""Motion that the simulator settles into, as starts for the periodic solvers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from impact_damper_ros.rig import (
    INITIAL_SPECS,
    Event,
    EventKind,
    InitialConditions,
    RigParameters,
    Simulator,
)

__all__ = ['repeated_impacts', 'settled_impacts', 'starting_points', 'windows']


# Far more events than the motions sought have; a rig that chatters all the time is left early.
_EVENTS_PER_CYCLE = 60


def starting_points(parameters: RigParameters) -> Iterator[InitialConditions]:
    """
    Yield initial conditions from which a rig may settle into different motions.

    Parameters
    ----------
    parameters : RigParameters
        The rig.

    Yields
    ------
    InitialConditions
        At rest; displaced; moving fast; with m next to a stop. Scaled by the response without
        impacts and the gap.
    """
    static = abs(parameters.force_amplitudes[0]) / parameters.stiffness
    amplitude = min(parameters.response_amplitude, 5.0 * static)
    speed = amplitude * parameters.force_frequencies[0]
    half = 0.5 * parameters.gap
    limit = INITIAL_SPECS['initial_primary_velocity'].high
    assert limit is not None
    for x, velocity, offset in (
        (1.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (-0.5, 1.0, 0.9),
        (0.3, -2.0, -0.9),
        (2.0, 1.0, 0.3),
    ):
        yield InitialConditions(
            initial_primary_position=min(limit, x * amplitude),
            initial_primary_velocity=max(-limit, min(limit, velocity * speed)),
            initial_damper_offset=(
                half - min(half, abs(offset) * amplitude)
                if parameters.one_sided
                else offset * half
            ),
            initial_damper_velocity=0.0,
        )


def settled_impacts(
    parameters: RigParameters,
    initial: InitialConditions,
    cycles: int,
    watched: int,
    most_events: float = _EVENTS_PER_CYCLE,
) -> list[Event]:
    """Simulate and return the last impacts."""
    rig = Simulator(parameters, initial)
    cycle = math.tau / parameters.force_frequencies[0]
    kept: list[Event] = []
    total = 0
    for k in range(1, cycles + 1):
        events = rig.advance(k * cycle)
        total += len(events)
        if total > most_events * (k + 20):
            return []
        if k > cycles - watched:
            kept += [event for event in events if event.kind is EventKind.IMPACT]
    return kept


def windows(
    impacts: Sequence[Event], stops: tuple[int, ...], period: float
) -> Iterator[tuple[list[float], list[float]]]:
    """Yield stretches of a run in which the stops are hit in an asked order within a period."""
    n = len(stops)
    for i in range(len(impacts) - n + 1):
        chosen = impacts[i : i + n]
        if tuple(event.stop for event in chosen) != stops:
            continue
        if chosen[-1].time - chosen[0].time < period:
            yield [event.x for event in chosen], [event.time for event in chosen]


def repeated_impacts(
    impacts: Sequence[Event], cycle: float, most_cycles: int = 8, tolerance: float = 1e-10
) -> tuple[list[Event], int] | None:
    """
    Recognise a periodic motion at the end of a run.

    Parameters
    ----------
    impacts : sequence of Event
        Impacts in a row.
    cycle : float
        Period of the force, s.
    most_cycles : int, optional
        Longest period looked for, in cycles of the force.
    tolerance : float, optional
        How closely two periods must agree, relative to the cycle and the largest |X| at an
        impact.

    Returns
    -------
    period : list of Event
        Impacts of one of the last two periods, beginning on stop 1 after stop 2, if there is such
        a place.
    cycles : int
        The period in cycles of the force. None stands for both if the run does not repeat.
    """
    if not impacts:
        return None
    size = max(abs(event.x) for event in impacts)
    for cycles in range(1, most_cycles + 1):
        period = cycles * cycle
        n = sum(event.time > impacts[-1].time - period + 0.5e-6 * cycle for event in impacts)
        if n == 0 or len(impacts) < 3 * n:
            continue
        last = impacts[-2 * n :]
        if all(
            now.stop == then.stop
            and abs(now.time - then.time - period) < tolerance * cycle
            and abs(now.x - then.x) < tolerance * size
            for now, then in zip(last, impacts[-3 * n : -n], strict=True)
        ):
            for i in range(n, 0, -1):
                if last[i].stop == 1 and last[i - 1].stop == 2:
                    return list(last[i : i + n]), cycles
            return list(last[n:]), cycles
    return None
