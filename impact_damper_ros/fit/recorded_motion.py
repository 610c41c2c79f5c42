# SPDX-License-Identifier: Apache-2.0
"""
A measured motion from messages of ROS 2: of a bag, or of a live topic, without ROS.

`JointState`, `Imu` and `Float64` are read. A rig of this package also tells when its motion began
and where its impacts were: its messages come with those of `snapshot` and `impacts` beside them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordedMessage, RecordingError, RunReader, String
from impact_damper_ros.bag.messages import (
    JOINT_STATE,
    STRING,
    CdrError,
    CdrReader,
    JointState,
    decode,
    header_ns,
)
from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from impact_damper_ros.parameters.quoting import shown
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay.command import Command, parameters_of, read_command

from .measured_motion import MeasuredMotion, ReadingOptions, prepared, read_table_motion

Array = NDArray[np.float64]

IMU, FLOAT = 'sensor_msgs/msg/Imu', 'std_msgs/msg/Float64'
#: Types of messages that are read.
TYPES = (JOINT_STATE, IMU, FLOAT)
#: Standard deviation of an impact time that a rig itself publishes, s: it is exact, but need not
#: bind the fit more than the samples do.
_EXACT = 1e-4
_AXES = ('x', 'y', 'z')


class _Series(NamedTuple):
    """Instants, ns, values and quantity of messages."""

    stamps_ns: NDArray[np.int64]
    values: Array
    quantity: str
    what: str
    base: Array | None = None


def beside(topic: str, name: str) -> str:
    """Return a topic in the namespace of another one."""
    return f'{topic.rpartition("/")[0]}/{name}'


def read_bag_motion(
    path: Path, options: ReadingOptions
) -> tuple[MeasuredMotion, RigParameters | None]:
    """
    Read a measured motion from a bag.

    Parameters
    ----------
    path : Path
        A bag directory or an MCAP file.
    options : ReadingOptions
        With `topic` if several topics may be it, and `joint` (an axis of an Imu).

    Returns
    -------
    data : MeasuredMotion
        The motion.
    rig : RigParameters or None
        The rig that was recorded, if it is one of this package.

    Raises
    ------
    RecordingError
        If the bag cannot be read or has no such topic.
    ValueError
        If its messages are no motion that can be fitted.
    """
    reader = RunReader(path)
    topic, kind = _chosen(reader, options.topic)
    wanted = [(topic, kind)]
    wanted += [(beside(topic, 'snapshot'), STRING), (beside(topic, 'impacts'), JOINT_STATE)]
    messages = list(reader.records(wanted))
    return motion_of_messages(messages, topic, str(path), options), recorded_rig(messages, topic)


def recorded_rig(messages: Sequence[RecordedMessage], topic: str) -> RigParameters | None:
    """Return the rig that the first snapshot beside a topic describes; None without one."""
    commands = _commands(messages, beside(topic, 'snapshot'), topic)
    return RigParameters(**parameters_of(commands[0].state['parameters'])) if commands else None


def _chosen(reader: RunReader, topic: str) -> tuple[str, str]:
    """Return name and type of the topic of a bag."""
    there = [key for key, found in reader.topics.items() if found.message_count]
    usable = sorted(key for key in there if key[1] in TYPES)
    # Of a rig the joint states are meant
    rigs = [key for key in usable if key[0].endswith('joint_states')]
    chosen = [key for key in usable if key[0] == topic] if topic else rigs or usable
    if len(chosen) == 1:
        return chosen[0]
    held = ', '.join(f'{name} of {kind}' for name, kind in sorted(there)) or 'none'
    if chosen:
        names = ', '.join(name for name, _ in chosen)
        cause, remedy = f'{names} may each be the motion', 'name one with --topic'
    else:
        what = f'no topic {topic}' if topic else 'no topic'
        cause = f'{what} of {", ".join(TYPES)} has messages in it; there are: {held}'
        remedy = 'name one with --topic, or record it'
    raise RecordingError('fit', reader.path, cause, remedy)


def motion_of_messages(
    messages: Sequence[RecordedMessage], topic: str, source: str, options: ReadingOptions
) -> MeasuredMotion:
    """
    Return the motion that messages of a topic describe.

    Parameters
    ----------
    messages : sequence of RecordedMessage
        Of the topic, and of `snapshot` and `impacts` beside it, if there are.
    topic : str
        Name of the topic of the motion.
    source : str
        The name of their source, for messages.
    options : ReadingOptions
        See there.

    Notes
    -----
    Of a rig of this package only what is before the next change of its parameters is used, and
    the time is rig time, from which its force counts.
    """
    own = [m for m in messages if m.topic == topic]
    source = f'{source}, {topic}'
    if not own:
        raise ValueError(f'{source}: no message came: see that it is published')
    try:
        series = _READERS[own[0].type](own, options.joint)
    except (CdrError, struct.error) as error:
        raise ValueError(f'{source}: a message cannot be read: {error}') from error
    _check_stamps(series.stamps_ns, source)
    commands = _commands(messages, beside(topic, 'snapshot'), source)
    offset_ns, start_ns, end_ns = int(series.stamps_ns[0]), -np.inf, np.inf
    values, base, times = series.values, series.base, None
    if commands:
        first = commands[0]
        changed = [c.stamp_ns for c in commands[1:] if c.done]
        offset_ns, start_ns = first.offset_ns, first.stamp_ns
        end_ns = min((stamp for stamp in changed if stamp > series.stamps_ns[0]), default=np.inf)
        before = [c for c in commands if c.stamp_ns <= series.stamps_ns[0]]
        if before:
            offset_ns, start_ns = before[-1].offset_ns, -np.inf
        if np.isfinite(end_ns):
            source += ' (up to the first change of its parameters)'
        if series.quantity == 'displacement':
            rig = RigParameters(**parameters_of(first.state['parameters']))
            values = values - rig.static_deflection
        times = _impact_times(messages, beside(topic, 'impacts'), offset_ns)
    kept = (series.stamps_ns >= start_ns) & (series.stamps_ns < end_ns)
    seconds = (series.stamps_ns - offset_ns) / 1e9
    kept &= (seconds >= options.first) & (seconds <= options.last)
    # Of samples that are there twice, or late, the first in time
    _, once = np.unique(series.stamps_ns[kept], return_index=True)
    places = np.flatnonzero(kept)[once]
    if not len(places):
        raise ValueError(
            f'{source}: no message is from before the first change of the rig, and from '
            f'{options.first:g} to {options.last:g} s'
        )
    stamps_ns = series.stamps_ns[places]
    moving = base is not None and bool(np.any(base[places] != base[places[0]]))

    def place(row: int) -> str:
        return f'{source}, message {row + 1}'

    return prepared(
        MeasuredMotion(
            time=(stamps_ns - offset_ns) / 1e9,
            motion=values[places],
            quantity=series.quantity,
            used=np.isfinite(values[places]),
            base=base[places] if base is not None and moving else None,
            base_quantity=series.quantity if moving else '',
            impact_times=times,
            impact_deviation=_EXACT if times is not None else 0.0,
            source=source,
        ),
        options,
        place,
        what=series.what,
    )


def _check_stamps(stamps_ns: NDArray[np.int64], source: str) -> None:
    """Raise ValueError where messages have no stamps of their own."""
    if not stamps_ns.any():
        raise ValueError(
            f'{source}: all {len(stamps_ns)} messages have the stamp 0: set header.stamp where '
            'they are published'
        )
    often, counts = np.unique(stamps_ns, return_counts=True)
    if len(often) <= 0.5 * len(stamps_ns):
        raise ValueError(
            f'{source}: {len(stamps_ns)} messages have {len(often)} different stamps, of which '
            f'{int(often[counts.argmax()])} ns is there {counts.max()} times: give each sample '
            'its own'
        )


def _commands(messages: Sequence[RecordedMessage], topic: str, source: str) -> list[Command]:
    """Return the snapshots of a rig, none if there are none, in the order of their stamps."""
    found = []
    for message in messages:
        if message.topic != topic or message.type != STRING:
            continue
        held = decode(STRING, message.content)
        assert isinstance(held, String)
        if 'stamp_offset_ns' in held.data:
            found.append(read_command(message, Path(source), 'fit'))
    found.sort(key=lambda command: (command.stamp_ns, command.number))
    return [command for command in found if command.run == found[0].run]


def _impact_times(messages: Sequence[RecordedMessage], topic: str, offset_ns: int) -> Array | None:
    stamps = [header_ns(m.content) for m in messages if m.topic == topic and m.type == JOINT_STATE]
    return (np.unique(np.array(stamps, np.int64)) - offset_ns) / 1e9 if stamps else None


def _named(names: Sequence[str], name: str, usual: str, what: str) -> int:
    """Return the place of a name among those of a topic."""
    wanted = name or (usual if usual in names else names[0] if len(names) == 1 else '')
    if wanted in names:
        return names.index(wanted)
    held = ', '.join(map(shown, names)) or 'none'
    given = f'no {what} {shown(name)}' if name else f'several {what}s'
    raise ValueError(f'{given} among {held}: name one with --joint')


def _joint_states(messages: Sequence[RecordedMessage], joint: str) -> _Series:
    states = [decode(JOINT_STATE, message.content) for message in messages]
    # A paused rig repeats its joint states, which are no samples
    used = [s for s in states if isinstance(s, JointState) and s.frame_id != PAUSED_FRAME]
    if not used:
        raise ValueError('the rig was paused all the time: let it run')
    names = used[0].name
    place = _named(names, joint, 'primary', 'joint')
    strange = next((s for s in used if s.name != names), None)
    if strange is not None:
        raise ValueError(
            f'the joints change from {", ".join(names)} to {", ".join(strange.name)} at stamp '
            f'{strange.stamp_ns} ns: two publishers share the topic; record one of them'
        )
    by_position = all(len(s.position) == len(names) for s in used)
    if not by_position and not all(len(s.velocity) == len(names) for s in used):
        raise ValueError('the messages have neither positions nor velocities of all joints')
    values = np.array([(s.position if by_position else s.velocity)[place] for s in used])
    base = None
    if by_position and 'base' in names and 'primary' in names:
        base = np.array([s.position[names.index('base')] for s in used])
    return _Series(
        np.array([s.stamp_ns for s in used], np.int64),
        values,
        'displacement' if by_position else 'velocity',
        f'joint {names[place]}',
        base,
    )


def _imu(messages: Sequence[RecordedMessage], axis: str) -> _Series:
    head = ('time', 'string')
    rest = (*('d',) * 4, *('d',) * 9, *('d',) * 3, *('d',) * 9, *('d',) * 3)
    rows = [CdrReader(message.content).read((*head, *rest)) for message in messages]
    places = np.array([row[-3:] for row in rows], float)
    # Along its axis a rig shakes most
    usual = _AXES[int(np.argmax(places.std(axis=0)))]
    place = _named(_AXES, axis or usual, usual, 'axis')
    stamps = np.array([row[0] for row in rows], np.int64)
    return _Series(stamps, places[:, place], 'acceleration', f'axis {_AXES[place]}')


def _floats(messages: Sequence[RecordedMessage], unit: str) -> _Series:
    """Read numbers that have neither a stamp nor a unit: a displacement in metres as they came."""
    values = np.array([CdrReader(message.content).read('d') for message in messages], float)
    stamps = np.array([message.stamp_ns for message in messages], np.int64)
    quantities = ('displacement', 'velocity', 'acceleration')
    quantity = quantities[_named(quantities, unit, 'displacement', 'quantity')]
    return _Series(stamps, values, quantity, quantity)


_READERS = {JOINT_STATE: _joint_states, IMU: _imu, FLOAT: _floats}


def read_motion(
    path: Path, options: ReadingOptions
) -> tuple[MeasuredMotion, RigParameters | None]:
    """Read a measured motion from a file of columns, or from a bag with the rig that it names."""
    if path.is_dir() or path.suffix in ('.mcap', '.db3', '.zstd'):
        named = {'column', 'time_column', 'base_column', 'force_column'}
        if any(getattr(options, name) for name in named):
            raise ValueError(f'{path}: a bag has no columns: name --topic and --joint')
        return read_bag_motion(path, options)
    return read_table_motion(path, options), None
