"""
Which topics of a bag are those of a rig, and whether a snapshot is the picture of one.

A state that no rig can have would otherwise show, much later, as an error of arithmetic.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite, ulp
from typing import Any

from impact_damper_ros.control import CONTROL_JOINTS, ControlledRig
from impact_damper_ros.control.controller import Controller
from impact_damper_ros.rig import PARAMETER_SPECS, Mode
from impact_damper_ros.rig.origin import Origin
from impact_damper_ros.rig.quoting import shown

from .errors import RecordingError
from .messages import CdrError, JointState, Message, ParameterEvent, String, decode
from .rig_messages import IMPACT_JOINTS, JOINTS
from .run_reader import RunReader

__all__ = [
    'JOINT_STATE',
    'PARAMETER_EVENT',
    'STRING',
    'RigTopics',
    'checked_state',
    'find_topics',
    'parsed',
]


#: Characters, and depth, of a snapshot's text. One of 1,024 harmonics has some 100 kB.
_LONGEST = 4 * 1024 * 1024
_DEEPEST = 12
#: Whole numbers are times in ns, or counts.
_LARGEST_INTEGER = 2**63
#: Rig time of a state may differ by this from that of its message, s, by rounding.
_SAME_TIME = 1e-6
_MODES = tuple(int(mode) for mode in Mode)
#: What each field of an origin may be, where it is not any finite number.
_CHOICES: dict[str, tuple[object, ...]] = {
    'mode': _MODES,
    'last_stop': (0, 1, 2),
    'side': (-1, 0, 1),
    'released': (False, True),
}
#: Infinite, which JSON has no number for, where there is no stop.
_MAY_BE_INFINITE = ('clearance_1', 'clearance_2', 'stop_1', 'stop_2', 'target_1', 'target_2')


def _refuse(name: str) -> float:
    raise ValueError(f'{name} is no number of JSON')


def _whole(text: str) -> int:
    if len(text) > 20 or abs(int(text)) > _LARGEST_INTEGER:
        raise ValueError(f'a whole number has {len(text)} digits; none is beyond 2**63')
    return int(text)


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f'{shown(text)} is beyond the range of a double')
    return number


def parsed(text: str) -> dict[str, Any]:
    """Return what the text of a snapshot holds."""
    if len(text) > _LONGEST:
        raise ValueError(f'it is {len(text)} characters long; at most {_LONGEST} are read')
    try:
        held = json.loads(text, parse_constant=_refuse, parse_int=_whole, parse_float=_finite)
    except RecursionError:
        raise ValueError(f'it is nested more than {_DEEPEST} deep') from None
    if _deeper(held, _DEEPEST):
        raise ValueError(f'it is nested more than {_DEEPEST} deep')
    if not isinstance(held, dict):
        raise ValueError(f'it is {shown(held)}, not an object')
    return held


def _deeper(held: object, depth: int) -> bool:
    parts = held.values() if isinstance(held, dict) else held if isinstance(held, list) else ()
    return any(
        not depth or _deeper(part, depth - 1) for part in parts if isinstance(part, dict | list)
    )


def checked_state(state: Mapping[str, Any], time: float) -> None:
    """Check that a rig can be restored from a state."""
    origin = state['origin']
    _check_origin(origin)
    _check_number('time', state['time'])
    _check_number('sweep.start', state['sweep']['start'])
    _check_whole('sweep.step', state['sweep']['step'])
    if abs(state['time'] - time) > _SAME_TIME:
        raise ValueError(
            f'its state is of rig time {state["time"]!r} s, the message of {time!r} s'
        )
    if abs(origin['time_low']) > ulp(max(abs(origin['time']), 1.0)):
        raise ValueError(
            f'origin.time_low is {origin["time_low"]!r} s: no more than the last digit of '
            f'origin.time, {origin["time"]!r} s, is allowed'
        )
    begun = origin['time'] + origin['time_low']
    if begun > state['time'] + _SAME_TIME:
        raise ValueError(f'origin.time is {begun!r} s, after time, {state["time"]!r} s')
    control = state['gap_control']['state']
    try:
        _check_control('gap_control.state', control, Controller().as_dict())
        rig = ControlledRig.restore(dict(state))
        harmonics = len(rig.parameters.harmonics[0])
        if len(origin['angles']) != harmonics:
            raise ValueError(
                f'origin.angles has {len(origin["angles"])} entries, the force has {harmonics} '
                'harmonics: give one each'
            )
        _check_numbers('sample', rig.sample())
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
        raise ValueError(f'{type(error).__name__}: {error}') from error


def _check_number(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError(f'{name} is {shown(value)}: a finite number is allowed')


def _check_whole(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f'{name} is {shown(value)}: a whole number is allowed')


def _check_numbers(name: str, values: object) -> None:
    if not isinstance(values, list | tuple):
        raise ValueError(f'{name} is {shown(values)}: a list of numbers is allowed')
    for value in values:
        _check_number(f'an entry of {name}', value)


def _check_origin(origin: object) -> None:
    if not isinstance(origin, dict):
        raise ValueError(f'origin is {shown(origin)}: an object is allowed')
    for name in Origin._fields:
        value = origin.get(name, Origin._field_defaults.get(name))
        if name == 'angles':
            _check_numbers('origin.angles', value)
        elif name in _CHOICES:
            choices = _CHOICES[name]
            if not any(type(value) is type(choice) and value == choice for choice in choices):
                allowed = ', '.join(map(str, choices))
                raise ValueError(f'origin.{name} is {shown(value)}: {allowed} are allowed')
        elif not (name in _MAY_BE_INFINITE and value in (None, inf, -inf)):
            _check_number(f'origin.{name}', value)


#: How many entries the lists of the control's state have, where not as many as at its start.
_LENGTHS = {'last': (0, 7), 'hit_1': (0, 2), 'hit_2': (0, 2), 'places': (0, 1, 2)}


def _check_control(name: str, held: Mapping[str, Any], pattern: Mapping[str, Any]) -> None:
    """Check that a state is built as that of a control at its start."""
    for key, like in pattern.items():
        value, where = held[key], f'{name}.{key}'
        if isinstance(like, dict):
            _check_control(where, value, like)
        elif key == 'waiting':
            for command in value:
                time, *targets = command
                _check_number(f'{where}: time', time)
                _check_numbers(where, [target for target in targets if target is not None])
        elif isinstance(like, list):
            _check_numbers(where, value)
            if len(value) not in _LENGTHS.get(key, (len(like),)):
                raise ValueError(f'{where} has {len(value)} entries')
        elif isinstance(like, bool):
            if not isinstance(value, bool):
                raise ValueError(f'{where} is {shown(value)}: true or false are allowed')
        elif isinstance(like, int):
            _check_whole(where, value)
        elif not (like is None and value is None):
            _check_number(where, value)


STRING = 'std_msgs/msg/String'
JOINT_STATE = 'sensor_msgs/msg/JointState'
PARAMETER_EVENT = 'rcl_interfaces/msg/ParameterEvent'


@dataclass(frozen=True)
class RigTopics:
    """The topics of one rig, by their full names; those that are not in the bag are empty."""

    node: str
    snapshot: str
    joint_states: str
    impacts: str = ''
    parameter_events: str = ''
    gap_control: str = ''

    @property
    def namespace(self) -> str:
        """Of the node, with a slash at its end."""
        return (self.snapshot or self.joint_states).rpartition('/')[0] + '/'

    @property
    def name(self) -> str:
        """The node in words, for messages."""
        return self.node or f'of unknown name in the namespace {self.namespace}'


def _noted(reader: RunReader, events: str, *, snapshot_needed: bool) -> list[RigTopics]:
    """Return the rig that the recorder's notes tell of."""
    topics, notes = reader.topics, reader.custom
    names = {
        name: notes[name] if notes.get(name) in topics else ''
        for name in ('snapshot', 'joint_states', 'impacts', 'gap_control')
    }
    if not names['joint_states'] or (snapshot_needed and not names['snapshot']):
        return []
    return [RigTopics(notes.get('node', ''), **names, parameter_events=events)]


def _named(reader: RunReader, events: str, *, snapshot_needed: bool) -> list[RigTopics]:
    """Return the rigs whose topics have their usual names, in any namespace."""
    topics, found = reader.topics, []
    for topic in sorted(topics):
        space, _, name = topic.rpartition('/')
        if name != 'joint_states' or topics[topic].type != JOINT_STATE:
            continue
        snapshot = f'{space}/snapshot'
        there = snapshot in topics and topics[snapshot].type == STRING
        if not there and snapshot_needed:
            continue
        impacts, control = (
            name if name in topics else '' for name in (f'{space}/impacts', f'{space}/gap_control')
        )
        found.append(RigTopics('', snapshot if there else '', topic, impacts, events, control))
    return found


def _role(message: Message) -> str:
    """Return what a message of a rig is, if it is one."""
    if isinstance(message, JointState):
        if message.name == JOINTS:
            return 'joint_states'
        if message.name == IMPACT_JOINTS and message.frame_id in ('stop_1', 'stop_2'):
            return 'impacts'
        if message.name == CONTROL_JOINTS:
            return 'gap_control'
    elif isinstance(message, String):
        try:
            held = parsed(message.data)
        except ValueError:
            return ''
        if 'stamp_offset_ns' in held:
            return 'snapshot'
    return ''


def _roles(reader: RunReader, topics: list[str]) -> dict[str, list[str]]:
    """Return the topics that may be of a rig by their role, by the first message of each."""
    found: dict[str, list[str]] = {}
    for name in topics:
        if reader.topics[name].type not in (JOINT_STATE, STRING):
            continue
        if not reader.topics[name].message_count:
            continue
        record = next(reader.records([name], by_index=True), None)
        if record is None:
            continue
        try:
            role = _role(decode(record.type, record.content))
        except CdrError:
            continue
        found.setdefault(role, []).append(name)
    return found


def _by_content(reader: RunReader, events: str, *, snapshot_needed: bool) -> list[RigTopics]:
    """Return the rig whose topics were remapped, by what is in them."""
    found = _roles(reader, list(reader.topics))
    wanted = ('snapshot', 'joint_states', 'impacts', 'gap_control')
    names = {role: found[role][0] for role in wanted if len(found.get(role, ())) == 1}
    if 'joint_states' not in names or (snapshot_needed and 'snapshot' not in names):
        return []
    names.setdefault('snapshot', '')
    return [RigTopics('', **names, parameter_events=events)]


def _completed(reader: RunReader, rigs: list[RigTopics]) -> list[RigTopics]:
    """Find topics of the rigs that were remapped while others have their usual names."""
    taken = {name for rig in rigs for name in (rig.snapshot, rig.joint_states)}
    taken |= {name for rig in rigs for name in (rig.impacts, rig.gap_control)}
    if all(rig.snapshot and rig.impacts and rig.gap_control for rig in rigs):
        return rigs
    roles = _roles(reader, [name for name in reader.topics if name not in taken])
    for role in ('snapshot', 'impacts', 'gap_control'):
        left = roles.get(role, [])
        lacking = [rig for rig in rigs if not getattr(rig, role)]
        for rig in lacking:
            near = [name for name in left if name.rpartition('/')[0] + '/' == rig.namespace]
            # Of several rigs, each has its own in its own namespace.
            near = near or (left if len(lacking) == 1 else [])
            if len(near) == 1:
                rigs = [replace(r, **{role: near[0]}) if r == rig else r for r in rigs]
    return rigs


def _named_node(reader: RunReader, rig: RigTopics) -> RigTopics:
    """Find the name of a rig's node: the one in its namespace with parameters of a rig."""
    if rig.node or not rig.parameter_events:
        return rig
    nodes: set[str] = set()
    try:
        for record in reader.records([rig.parameter_events], by_index=True):
            try:
                event = decode(PARAMETER_EVENT, record.content)
            except CdrError:
                continue
            assert isinstance(event, ParameterEvent)
            named = {p.name for p in (*event.new_parameters, *event.changed_parameters)}
            if event.node.rpartition('/')[0] + '/' == rig.namespace and named & _RIG_PARAMETERS:
                nodes.add(event.node)
    except RecordingError:  # met again by whoever reads on
        pass
    return replace(rig, node=nodes.pop()) if len(nodes) == 1 else rig


#: Parameters that nodes of other packages hardly have.
_RIG_PARAMETERS = frozenset(PARAMETER_SPECS) | {'gap_control'}


def _chosen(found: list[RigTopics], node: str) -> list[RigTopics]:
    """Return the rigs of a node, by its name or namespace."""
    chosen = [t for t in found if node in (t.node, t.namespace, t.namespace.rstrip('/'))]
    # A node is in the namespace of its topics.
    return chosen or [
        t for t in found if not t.node and node.rpartition('/')[0] + '/' == t.namespace
    ]


def find_topics(
    reader: RunReader,
    node: str | None = None,
    *,
    purpose: str = 'replay',
    snapshot_needed: bool = True,
) -> RigTopics:
    """
    Find the topics of the rig in a bag.

    The recorder's notes tell them; else their names do, and, where they were remapped, what is in
    their messages.
    """
    topics = reader.topics
    events = next((t.name for t in topics.values() if t.type == PARAMETER_EVENT), '')
    found: list[RigTopics] = []
    for search in (_noted, _named, _by_content):
        found = found or search(reader, events, snapshot_needed=snapshot_needed)
    found = [_named_node(reader, rig) for rig in _completed(reader, found)]
    chosen = found if node is None else _chosen(found, node)
    if len(chosen) == 1:
        return chosen[0]
    if not found:
        held = ', '.join(sorted(topics)) or 'none'
        wanted = 'snapshot and joint_states' if snapshot_needed else 'joint_states'
        cause = f'no rig is recorded in it: no topics {wanted} (topics: {held})'
        remedy = 'give a bag that sim_node has recorded, or record these topics too'
        raise RecordingError(purpose, reader.path, cause, remedy)
    names = ', '.join(t.node or t.namespace for t in found)
    if node is not None and not chosen:
        raise RecordingError(purpose, reader.path, f'it holds no node {node!r}; it has {names}')
    cause = f'it holds several rigs: {names}'
    raise RecordingError(purpose, reader.path, cause, 'choose one with --node')
