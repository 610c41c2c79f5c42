# SPDX-License-Identifier: Apache-2.0
"""
Rows: messages of a topic, and samples and events of a rig, as structured arrays.

Replayed samples and events become numbers of messages; recorded numbers become samples and events,
in the two types of rows that the rig writes. Messages are `message_row`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.control.act import Action, ControlAct
from impact_damper_ros.motion.event import EVENT_TYPE, SAMPLE_TYPE, EventKind, Sample
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.observed_run import TimedOrder
from impact_damper_ros.rig.order import Order

Samples = NDArray[np.void]
Events = NDArray[np.void]
Messages = NDArray[np.void]
Ints = NDArray[np.int64]
Numbers = NDArray[np.float64]


NO_SAMPLES: Samples = np.empty(0, SAMPLE_TYPE)
NO_EVENTS: Events = np.empty(0, EVENT_TYPE)


class Advance(NamedTuple):
    """The motion of a rig through the instants of joint states, and the states that differ."""

    samples: Samples
    events: Events
    expected: Messages  # joint states by the replay
    differs: NDArray[np.bool_]  # whether each recorded joint state differs


def samples_as_rows(samples: Sequence[Sample]) -> Samples:
    """Return samples as an array."""
    return np.array([tuple(sample) for sample in samples], SAMPLE_TYPE)


def impacts_of(events: Events) -> Events:
    """Return the impacts among some events."""
    found: Events = events.take(np.flatnonzero(events['kind'] == EventKind.IMPACT))
    return found


def published_states(samples: Samples, rig: RigParameters) -> Numbers:
    """Return positions and velocities of the joint states, one row for each sample."""
    from impact_damper_ros.bag.rig_topics import state_numbers

    columns: list[Any] = [samples[name] for name in Sample._fields]
    parts = state_numbers(Sample(*columns), rig.static_deflection, rig.angle)
    wide = np.broadcast_arrays(*(column for part in parts for column in part))
    return np.column_stack(wide) if len(samples) else np.empty((0, 14))


def _messages(times: Numbers, offset_ns: int, numbers: Numbers) -> Messages:
    """Return messages of instants, s, without frames and acts."""
    found = np.zeros(len(times), message_row(numbers.shape[1]))
    found['stamp_ns'] = offset_ns + np.rint(times * 1e9).astype(np.int64)
    found['numbers'] = numbers
    return found


def published_impacts(events: Events, rig: RigParameters, offset_ns: int) -> Messages:
    """Return the messages of the impacts among some events."""
    from impact_damper_ros.bag.rig_topics import impact_numbers

    hits: Any = impacts_of(events)
    sign: Any = np.where(hits['stop'] == 1, 1.0, -1.0)
    after = hits['primary_velocity_after'], hits['damper_velocity_after']
    parts = impact_numbers(
        hits['x'], hits['y'], after, sign * hits['impulse'], rig.static_deflection
    )
    found = _messages(hits['time'], offset_ns, np.column_stack(sum(parts, ())))
    found['frame'] = np.where(hits['stop'] == 1, 'stop_1', 'stop_2')
    return found


def published_acts(acts: Sequence[ControlAct], offset_ns: int) -> Messages:
    """Return the messages of acts of the gap control."""
    times = np.array([one.time for one in acts])
    numbers = np.array([sum(one.numbers, ()) for one in acts]).reshape(-1, 9)
    found = _messages(times, offset_ns, numbers)
    found['frame'] = [one.act for one in acts]
    return found


def orders_of(acts: Messages, offset_ns: int) -> list[TimedOrder]:
    """Return the orders of a controller outside the rig among some acts."""
    orders = acts[acts['frame'] == Action.ORDER.name.lower()]
    times = (orders['stamp_ns'] - offset_ns) / 1e9
    # Targets, speeds and the force among three positions, three velocities and three efforts
    chosen = orders['numbers'][:, [0, 1, 3, 4, 8]]
    pairs = zip(times.tolist(), chosen.tolist(), strict=True)
    return [TimedOrder(time, Order(*row)) for time, row in pairs]


def recorded_samples(states: Messages, rig: RigParameters, times: Numbers) -> Samples:
    """Return recorded joint states as samples at instants, s."""
    found = np.empty(len(states), SAMPLE_TYPE)
    x, z, stop_1, stop_2, _, base, _, *rates = states['numbers'].T
    velocity, damper, rate_1, rate_2, _, base_rate, _ = rates
    rest = rig.static_deflection
    masses, stops = (x - rest, velocity, z - rest, damper), (stop_1 - rest, stop_2 - rest)
    columns = (times, *masses, *stops, rate_1, rate_2, base, base_rate)
    for name, column in zip(Sample._fields, columns, strict=True):
        found[name] = column
    return found


def recorded_impacts(impacts: Messages, rig: RigParameters, times: Numbers) -> Events:
    """Return recorded impacts as events at instants, s; velocities before by the impulses."""
    found = np.zeros(len(impacts), EVENT_TYPE)
    x, z, after, damper_after, impulse, damper_impulse = impacts['numbers'].T
    found['time'], found['x'], found['y'] = times, x - rig.static_deflection, z - x
    found['primary_velocity_after'], found['damper_velocity_after'] = after, damper_after
    found['primary_velocity_before'] = after - impulse / rig.primary_mass
    found['damper_velocity_before'] = damper_after - damper_impulse / rig.damper_mass
    found['impulse'] = np.abs(impulse)
    found['kind'] = EventKind.IMPACT
    found['stop'] = np.where(impacts['frame'] == 'stop_1', 1, 2)
    return found
