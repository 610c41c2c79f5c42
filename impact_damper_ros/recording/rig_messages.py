"""
The messages of a rig as bytes, without ROS: the same that the node publishes, bit for bit.

The shapes of joint states and impacts never change, so that each is written out once and then only
filled in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from impact_damper_ros.control import CONTROL_JOINTS, Action, ControlRecord
from impact_damper_ros.rig import Event, Sample
from impact_damper_ros.rig.published import (
    IMPACT_JOINTS,
    JOINTS,
    impact_numbers,
    snapshot_text,
    state_numbers,
)

from .cdr import CdrWriter
from .joint_state_bytes import JointStateBytes

__all__ = [
    'IMPACT_JOINTS',
    'JOINTS',
    'RigMessages',
    'parameter_event',
    'snapshot_message',
]

# Numbers of the types of a parameter (rcl_interfaces/ParameterType), without the arrays.
_BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLE_ARRAY = 1, 2, 3, 4, 8


def _shape(frame_id: str, names: Sequence[str], *counts: int) -> JointStateBytes:
    """Return a JointState with so many positions, velocities and efforts."""
    writer = CdrWriter().time_ns(0).string(frame_id).put('I', len(names))
    for name in names:
        writer.string(name)
    for count in counts:
        writer.sequence('d', (0.0,) * count)
    return JointStateBytes(bytes(writer.content))


class RigMessages:
    """Joint states and impacts of a rig, to be filled in."""

    def __init__(self) -> None:
        self._states = _shape('', JOINTS, 4, 4, 0)
        self._impacts = {stop: _shape(f'stop_{stop}', IMPACT_JOINTS, 2, 2, 2) for stop in (1, 2)}
        self._control = {
            action: _shape(action.name.lower(), CONTROL_JOINTS, 3, 3, 3) for action in Action
        }

    def states(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a sample; see `state_numbers`."""
        return self._states.filled(stamp_ns, *state_numbers(sample, deflection))

    def impact(self, stamp_ns: int, event: Event, deflection: float) -> bytes:
        """Return the message of an impact; see `impact_numbers`."""
        return self._impacts[event.stop].filled(stamp_ns, *impact_numbers(event, deflection))

    def control(self, stamp_ns: int, record: ControlRecord) -> bytes:
        """Return the message of what the gap control did."""
        return self._control[record.action].filled(stamp_ns, *record.numbers)


def snapshot_message(offset_ns: int, time_ns: int, reason: str, state: Mapping[str, Any]) -> bytes:
    """Return the message of a snapshot; see `snapshot_text`."""
    text = snapshot_text(offset_ns, time_ns, reason, state)
    return bytes(CdrWriter().string(text).content)


def parameter_event(
    stamp_ns: int, node: str, values: Mapping[str, Any], *, new: bool = False
) -> bytes:
    """
    Return a rcl_interfaces/ParameterEvent.

    Parameters
    ----------
    stamp_ns : int
        Its stamp.
    node : str
        Full name of the node.
    values : mapping
        The parameters: numbers, texts, bools, and sequences of floats.
    new : bool, optional
        Whether they are declared, as in a list of all parameters; otherwise they changed.
    """
    writer = CdrWriter().time_ns(stamp_ns).string(node)
    for listed in (new, not new, False):
        writer.put('I', len(values) if listed else 0)
        for name, value in values.items() if listed else ():
            _put_parameter(writer, name, value)
    return bytes(writer.content)


def _put_parameter(writer: CdrWriter, name: str, value: Any) -> None:
    kind = (
        _BOOL
        if isinstance(value, bool)
        else _INTEGER
        if isinstance(value, int)
        else _DOUBLE
        if isinstance(value, float)
        else _STRING
        if isinstance(value, str)
        else _DOUBLE_ARRAY
    )
    writer.string(name).put('B', kind)
    writer.put('?', value if kind == _BOOL else False)
    writer.put('q', value if kind == _INTEGER else 0)
    writer.put('d', value if kind == _DOUBLE else 0.0)
    writer.string(value if kind == _STRING else '')
    # Bytes, bools, integers, doubles, texts
    for place in range(5):
        writer.sequence('d', value if kind == _DOUBLE_ARRAY and place == 3 else ())
