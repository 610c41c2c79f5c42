# SPDX-License-Identifier: Apache-2.0
"""
A measured motion from messages of ROS 2: of a bag, or of a live topic, without ROS.

The columns of a topic are those of `bag.topic_columns`. The messages of a rig of this package come
with those of its topics `snapshot` and `impacts`, which show the start of the motion and the
impacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordedMessage, RecordingError, RunReader, String
from impact_damper_ros.bag.messages import JOINT_STATE, STRING, decode, header_ns
from impact_damper_ros.bag.topic_columns import TYPES, TopicColumns, topic_columns
from impact_damper_ros.parameters.parameter_spec import check_kind
from impact_damper_ros.parameters.quoting import quote
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay.command import Command, parameters_of, read_command

from .measured_motion import (
    NO_OPTIONS,
    MeasuredMotion,
    ReadingOptions,
    prepare,
    read_table_motion,
)

Array = NDArray[np.float64]

#: Standard deviation of an impact time that a rig itself publishes, s: it is exact, but need not
#: bind the fit more than the samples do.
_EXACT = 1e-4


def beside(topic: str, name: str) -> str:
    """Return a topic in the namespace of another one."""
    return f'{topic.rpartition("/")[0]}/{name}'


class TopicMessages(NamedTuple):
    """The messages of a topic and of other topics of its rig, and their source."""

    messages: Sequence[RecordedMessage]
    topic: str
    source: str


def is_bag(path: Path) -> bool:
    """Return whether a path is read as a bag."""
    return path.is_dir() or path.suffix in ('.mcap', '.db3', '.zstd')


def bag_messages(path: Path, options: ReadingOptions) -> TopicMessages:
    """Return the messages of the topic of a bag that has the motion."""
    named = {'column', 'time_column', 'base_column', 'force_column'}
    if any(getattr(options, name) for name in named):
        raise ValueError(f'{path}: a bag has no columns: name --topic and --joint')
    reader = RunReader(path)
    topic, kind = _topic_of(reader, options.topic)
    wanted = [(topic, kind)]
    wanted += [(beside(topic, 'snapshot'), STRING), (beside(topic, 'impacts'), JOINT_STATE)]
    return TopicMessages(list(reader.messages(wanted)), topic, str(path))


def recorded_rig(messages: TopicMessages) -> RigParameters | None:
    """Return the rig of the first snapshot in the namespace of a topic; None without one."""
    every, topic, _ = messages
    commands = _commands(every, beside(topic, 'snapshot'), topic)
    return RigParameters(**parameters_of(commands[0].state['parameters'])) if commands else None


def _topic_of(reader: RunReader, topic: str) -> tuple[str, str]:
    """Return name and type of the topic of a bag."""
    there = [key for key, found in reader.topics.items() if found.message_count]
    usable = sorted(key for key in there if key[1] in TYPES)
    # The joint states of a rig are taken by default.
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


class TopicSeries(NamedTuple):
    """The columns of a topic over rig time, s, that of the motion as X."""

    found: TopicColumns
    seconds: Array
    #: Places of the motion, and of the base if there is one.
    place: int
    base: int | None
    #: Mask of the messages that are used, and times of impacts.
    kept: NDArray[np.bool_]
    times: Array | None
    source: str


def series_of(messages: TopicMessages, options: ReadingOptions) -> TopicSeries:
    """Return the columns of a topic, and a mask of its messages that are used."""
    every, topic, source = messages
    own = [m for m in every if m.topic == topic]
    source = f'{source}, {topic}'
    if not own:
        raise ValueError(f'{source}: no message came: see that it is published')
    try:
        found = topic_columns(own)
        names = [head.name for head, _ in found.columns]
        place = _place_of(names, options.joint, found)
    except ValueError as error:
        raise ValueError(f'{source}: {error}') from error
    stamps, base = found.stamps_ns, None
    if displacement := found.quantity(place) == 'displacement':
        base = names.index('base') if {'base', 'primary'} <= {*names} else None
    commands = _commands(every, beside(topic, 'snapshot'), source)
    offset_ns, start_ns, end_ns, times = int(stamps[0]), -np.inf, np.inf, None
    if commands:
        first = commands[0]
        changed = [c.stamp_ns for c in commands[1:] if c.done]
        offset_ns, start_ns = first.offset_ns, first.stamp_ns
        end_ns = min((stamp for stamp in changed if stamp > stamps[0]), default=np.inf)
        before = [c for c in commands if c.stamp_ns <= stamps[0]]
        if before:
            offset_ns, start_ns = before[-1].offset_ns, -np.inf
        if np.isfinite(end_ns):
            source += ' (up to the first change of its parameters)'
        if displacement:
            rig = RigParameters(**parameters_of(first.state['parameters']))
            head, values = found.columns[place]
            found.columns[place] = head, values - rig.static_deflection
        times = _impact_times(every, beside(topic, 'impacts'), offset_ns)
    seconds = (stamps - offset_ns) / 1e9
    kept = (stamps >= start_ns) & (stamps < end_ns)
    kept &= (seconds >= options.first) & (seconds <= options.last)
    return TopicSeries(found, seconds, place, base, kept, times, source)


def motion_of_messages(messages: TopicMessages, options: ReadingOptions) -> MeasuredMotion:
    """
    Return the motion of the messages of a topic, with the rig that publishes it.

    The motion of a rig of this package is used up to the next change of its parameters, and the
    time is rig time, from which the force counts.
    """
    found, seconds, place, base_place, kept, times, source = series_of(messages, options)
    # The first of repeated or late samples is kept.
    _, once = np.unique(found.stamps_ns[kept], return_index=True)
    places = np.flatnonzero(kept)[once]
    if not len(places):
        raise ValueError(
            f'{source}: no message is from before the first change of the rig, and from '
            f'{options.first:g} to {options.last:g} s'
        )
    head, values = found.columns[place]
    base = None if base_place is None else found.columns[base_place][1][places]
    moving = base is not None and bool(np.ptp(base))
    data = MeasuredMotion(
        time=seconds[places],
        motion=values[places],
        quantity=found.quantity(place),
        used=np.isfinite(values[places]),
        base=base if moving else None,
        base_quantity='displacement' if moving else '',
        impact_times=times,
        impact_deviation=_EXACT if times is not None else 0.0,
        source=source,
    )
    what = f'{found.noun} {head.name}'
    return prepare(data, options, lambda row: f'{source}, message {row + 1}', what)


def _commands(messages: Sequence[RecordedMessage], topic: str, source: str) -> list[Command]:
    """Return the snapshots of a rig, in the order of their stamps."""
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


def _place_of(names: Sequence[str], name: str, found: TopicColumns) -> int:
    """Return the place of a name among those of a topic."""
    if (name or found.usual) in names:
        return names.index(name or found.usual)
    held = ', '.join(map(quote, names)) or 'none'
    given = f'no {found.noun} {quote(name)}' if name else f'several {found.noun}s'
    raise ValueError(f'{given} among {held}: name one with --joint')


def read_motion(path: str | Path, options: ReadingOptions = NO_OPTIONS) -> MeasuredMotion:
    r"""
    Read a measured motion of M from a file of columns or from a bag.

    Parameters
    ----------
    path : str or Path
        A table (CSV, text, universal file, MAT, WAV, ...) or a bag of ROS 2.
    options : ReadingOptions, optional
        Columns or topic, units, and the part to read; by default those of the file.

    Returns
    -------
    MeasuredMotion
        In SI units, for `fit_rig` and `fit_structure`.

    Raises
    ------
    TypeError
        If the path or the options are of another kind.
    ValueError
        If the file is none of these, or several of its columns may be the motion; the message has
        the remedy.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> rows = [f'{k / 200},{2.0 * 0.98**k}' for k in range(400)]
    >>> file = Path(mkdtemp(), 'run.csv')
    >>> _ = file.write_text('\n'.join(['time (s),x (mm)', *rows]))
    >>> motion = read_motion(file)
    >>> motion.quantity, len(motion.time), float(motion.motion[0])
    ('displacement', 400, 0.002)
    """
    check_kind('path', path, (str, Path), 'the path of a table or of a bag')
    check_kind(
        'options', options, ReadingOptions, "ReadingOptions, such as ReadingOptions(column='x')"
    )
    return read_motion_and_rig(Path(path), options)[0]


def read_motion_and_rig(
    path: Path, options: ReadingOptions
) -> tuple[MeasuredMotion, RigParameters | None]:
    """Read a measured motion from a file of columns, or from a bag with the rig that it names."""
    if is_bag(path):
        messages = bag_messages(path, options)
        return motion_of_messages(messages, options), recorded_rig(messages)
    if options.topic or options.joint:
        option = '--topic' if options.topic else '--joint'
        raise ValueError(f'{path}: a file of columns has no topics: leave {option} out')
    return read_table_motion(path, options), None
