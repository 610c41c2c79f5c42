"""What the node says as it starts: the rig, its topics, where it records, and namesakes."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from impact_damper_ros.nodes.outlets import Outlets
from impact_damper_ros.nodes.rig_parameters import NodeParameters
from impact_damper_ros.rig.description import described, frequency_hint

__all__ = ['Namesakes', 'start_message']


def start_message(parameters: NodeParameters, outlets: Outlets, node: str, recording: str) -> str:
    """
    Return what runs, in a few lines.

    Parameters
    ----------
    parameters : NodeParameters
        As declared.
    outlets : Outlets
        The topics.
    node : str
        Fully qualified name of the node.
    recording : str
        Directory of the recording; empty if there is none.
    """
    control = parameters.control.gap_control if parameters.control.active else 'off'
    states = f'{outlets.joint_states.topic} at {parameters.state_rate:g} Hz'
    topics = [states, outlets.impacts.topic, outlets.gap_control.topic, outlets.snapshot.topic]
    topics.append(outlets.diagnostics)
    if outlets.clock is not None:
        topics.append(outlets.clock.topic)
    runs = Path(os.path.abspath(parameters.bag_directory))  # noqa: PTH100 - need not exist
    lines = [
        f'{node} runs {_pace(parameters.real_time_factor)}',
        f'rig        {described(parameters.rig)}',
        f'control    {control}',
        f'topics     {", ".join(topics)}',
        f'services   {node}/reset, {node}/pause',
        f'recording  to {recording}'
        if recording
        else f'recording  off; into {runs} with: ros2 param set {node} record true',
    ]
    if hint := frequency_hint(parameters.rig):
        lines.append(f'note       {hint}')
    return '\n  '.join(lines)


def _pace(factor: float) -> str:
    if factor == 0.0:
        return 'as fast as possible'
    return 'in real time' if factor == 1.0 else f'at {factor:g} times real time'


class Namesakes:
    """
    Other nodes of the same name, which answer in the place of this one.

    Parameters
    ----------
    node : str
        Fully qualified name of this node.
    names : callable
        Returns name and namespace of every node on the network, this one included.
    warn : callable
        Takes a warning.
    """

    #: Looks after which a namesake is the newcomer, and says so itself.
    LOOKS = 30

    def __init__(
        self,
        node: str,
        names: Callable[[], list[tuple[str, str]]],
        warn: Callable[[str], object],
    ) -> None:
        """Know of none."""
        self._node = node
        self._names = names
        self._warn = warn
        self._left = self.LOOKS

    @property
    def done(self) -> bool:
        """Whether there is nothing more to look for."""
        return self._left == 0

    def look(self) -> None:
        """Warn once if there is one."""
        if self.done:
            return
        self._left -= 1
        count = sum(f'{space.rstrip("/")}/{name}' == self._node for name, space in self._names())
        if count > 1:
            self._left = 0
            self._warn(
                f'there are {count} nodes with the name {self._node}: their messages are mixed on '
                'the same topics, and which one answers is left to chance; stop the others, or '
                'start this one with --ros-args -r __ns:=/rig1'
            )
