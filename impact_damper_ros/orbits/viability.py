# SPDX-License-Identifier: Apache-2.0
"""
Viability: whether the rig can perform a solution of the boundary-value problem.

Its equations hold at the nodes only. Here the flights between them are checked in closed form:
by the first event of the simulator and, to quantify a violation, by the exact extremes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    rest,
)
from impact_damper_ros.motion.state import FREE, STICK

from .flights import Flight, extremes
from .response import Array
from .segments import Node, Segments

#: How much earlier than assumed, as a share of the period, an impact counts as another one.
TIME_TOLERANCE = 1e-7


def _after_impact(node: Node, flight: Flight, before: Array) -> str:
    """Return why m does not leave a stop as assumed; empty if it does."""
    _, velocity, _, incoming = (float(value) for value in before)
    mode = flight.struck(velocity, incoming).run.mode
    if mode == node.mode or mode == FREE:
        return ''
    if node.mode >= STICK:
        return f'does not stay on stop {node.stop} after the impact'
    if mode >= STICK:
        return (
            f'stays on stop {node.stop} after the impact, its speed {abs(incoming):.4g} m/s there'
        )
    return f'leaves stop {node.stop} against the friction assumed'


def _after_reversal(node: Node, flight: Flight) -> str:
    """Return why m does not go on as assumed where it has stopped; empty if it does."""
    there = flight.copy()
    # Within the gap, however short the bounce
    there.run.clearance_1 = there.run.clearance_2 = math.inf
    rest(there.moving)
    if there.run.mode == node.mode:
        return ''
    if node.kind is EventKind.STICK:
        return 'does not stick where it has stopped'
    return 'does not turn back where it has stopped'


_EXPECTED = {
    EventKind.REVERSAL: (REVERSAL,),
    EventKind.STICK: (REVERSAL,),
    EventKind.RELEASE: (RELEASE_UP, RELEASE_DOWN),
}


def _in_flight(
    flight: Flight, since: float, duration: float, end: Node, to: int, tolerance: float
) -> str:
    """
    Return what happens in a flight before the node at its end; empty if nothing does.

    It begins some time after the impact before it, s, and the next impact is on stop `to`.
    """
    start = flight.run.last_stop
    kind, tau = flight.first_event(duration + tolerance)
    expected = _EXPECTED.get(end.kind, (CONTACT_1 if end.stop == 1 else CONTACT_2,))
    if kind == NO_EVENT or tau > duration + tolerance:
        return ''
    if kind in expected and tau >= duration - tolerance:
        return ''
    route = f'between the impacts on stop {start} and stop {to}'
    when = f'{since + tau:.6g} s after the former'
    if kind in (RELEASE_UP, RELEASE_DOWN):
        return f'm leaves its support {route}, {when}'
    if kind == REVERSAL:
        away = flight.run.clearance_1 if start == 1 else -flight.run.clearance_2
        return (
            f'm turns back {route}, {when} and {abs(flight.motion(tau).travel - away):.4g} m from '
            f'stop {start}: friction changes sign there'
        )
    low, high = extremes(flight, duration, relative=True)
    hit = 1 if kind == CONTACT_1 else 2
    beyond = high - flight.run.clearance_1 if hit == 1 else -low - flight.run.clearance_2
    beyond = max(beyond, 0.0)
    return f'm would pass stop {hit} by {beyond:.4g} m {route}, first {when}: another impact'


def why_not_viable(
    segments: Segments, flights: Sequence[Flight], durations: Sequence[float], before: Array
) -> str:
    """
    Return why the rig cannot perform a motion; empty if it can.

    Given are the flights after all nodes, how long they last, s, and the states before the nodes.
    """
    tolerance = TIME_TOLERANCE * segments.period
    nodes = segments.nodes
    if min(durations) <= 0.0:
        return 'events would come in another order'
    faults = []
    for j, (node, flight) in enumerate(zip(nodes, flights, strict=True)):
        fault = ''
        if node.kind is EventKind.IMPACT:
            incoming = float(before[j, 3])
            if incoming * (1.0 if node.stop == 1 else -1.0) <= 0.0:
                faults.append(
                    f'm would reach stop {node.stop} from beyond it, with a relative velocity of '
                    f'{incoming:.4g} m/s (it must be '
                    f'{"positive" if node.stop == 1 else "negative"})'
                )
                continue
            fault = _after_impact(node, flight, before[j])
        elif node.kind is not EventKind.RELEASE:
            fault = _after_reversal(node, flight)
        if fault:
            faults.append(f'm {fault}')
            continue
        later = nodes[j + 1 :] + nodes[: j + 1]
        to = next(n.stop for n in later if n.kind is EventKind.IMPACT)
        since, k = 0.0, j
        while nodes[k].kind is not EventKind.IMPACT:
            k -= 1
            since += durations[k]
        faults.append(_in_flight(flight, since, durations[j], later[0], to, tolerance))
    return '; '.join(fault for fault in faults if fault)
