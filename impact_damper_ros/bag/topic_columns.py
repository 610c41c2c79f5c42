# SPDX-License-Identifier: Apache-2.0
"""
The columns of a topic, as `measured/` has those of a file: `JointState`, `Imu` and `Float64`.

Stamps are not among them: a float of seconds since 1970 has no digits of nanoseconds.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.measured.sheet import Array, Heading, heading
from impact_damper_ros.parameters.base_motion import quantity_of

from .messages import JOINT_STATE, CdrError, CdrReader, JointState, decode
from .rig_topics import PAUSED_FRAME
from .run_reader import RecordedMessage

IMU, FLOAT = 'sensor_msgs/msg/Imu', 'std_msgs/msg/Float64'
#: Types of messages that are read.
TYPES = (JOINT_STATE, IMU, FLOAT)


class TopicColumns(NamedTuple):
    """Columns of a topic, their kind, and the column that is used if none is named."""

    stamps_ns: NDArray[np.int64]
    columns: list[tuple[Heading, Array]]
    noun: str
    usual: str

    def quantity(self, place: int) -> str:
        """Return the quantity of a column: displacement, velocity or acceleration."""
        unit = self.columns[place][0].si
        assert unit is not None
        return quantity_of(unit[0])


def topic_columns(messages: Sequence[RecordedMessage]) -> TopicColumns:
    """Return the columns of messages of one type; raise ValueError if they have none."""
    try:
        found = _READERS[messages[0].type](messages)
    except (CdrError, struct.error) as error:
        raise ValueError(f'a message cannot be read: {error}') from error
    often, counts = np.unique(found.stamps_ns, return_counts=True)
    if not often.any():
        raise ValueError(
            f'all {len(messages)} messages have the stamp 0: set header.stamp where they are '
            'published'
        )
    if len(often) <= 0.5 * len(messages):
        raise ValueError(
            f'{len(messages)} messages have {len(often)} different stamps, of which '
            f'{often[counts.argmax()]} ns is there {counts.max()} times: give each its own'
        )
    return found


def _joint_states(messages: Sequence[RecordedMessage]) -> TopicColumns:
    states = [decode(JOINT_STATE, message.content) for message in messages]
    # A paused rig repeats its joint states, which are no samples
    used = [s for s in states if isinstance(s, JointState) and s.frame_id != PAUSED_FRAME]
    if not used:
        raise ValueError('the rig was paused all the time: let it run')
    names = used[0].name
    strange = next((s for s in used if s.name != names), None)
    if strange is not None:
        raise ValueError(
            f'the joints change from {", ".join(names)} to {", ".join(strange.name)} at stamp '
            f'{strange.stamp_ns} ns: two publishers share the topic; record one of them'
        )
    by_position = all(len(s.position) == len(names) for s in used)
    if not by_position and not all(len(s.velocity) == len(names) for s in used):
        raise ValueError('the messages have neither positions nor velocities of all joints')
    values = np.array([s.position if by_position else s.velocity for s in used])
    headings = [heading(name, 'm' if by_position else 'm/s') for name in names]
    usual = 'primary' if 'primary' in names else names[0] if len(names) == 1 else ''
    stamps = np.array([s.stamp_ns for s in used], np.int64)
    return TopicColumns(stamps, [*zip(headings, values.T, strict=True)], 'joint', usual)


def _imu(messages: Sequence[RecordedMessage]) -> TopicColumns:
    rest = ('d',) * (4 + 9 + 3 + 9 + 3)
    rows = [CdrReader(message.content).read(('time', 'string', *rest)) for message in messages]
    values = np.array([row[-3:] for row in rows], float)
    stamps = np.array([row[0] for row in rows], np.int64)
    columns = [(heading(axis, 'm/s^2'), values[:, n]) for n, axis in enumerate('xyz')]
    # A rig shakes most along its axis.
    return TopicColumns(stamps, columns, 'axis', 'xyz'[int(np.argmax(values.std(axis=0)))])


def _floats(messages: Sequence[RecordedMessage]) -> TopicColumns:
    """Read numbers without stamp and unit: metres, or another unit of SI."""
    values = np.array([CdrReader(message.content).read('d') for message in messages], float)
    units = {'displacement': 'm', 'velocity': 'm/s', 'acceleration': 'm/s^2'}
    stamps = np.array([message.stamp_ns for message in messages], np.int64)
    columns = [(heading(name, unit), values) for name, unit in units.items()]
    return TopicColumns(stamps, columns, 'quantity', 'displacement')


_READERS = {JOINT_STATE: _joint_states, IMU: _imu, FLOAT: _floats}
