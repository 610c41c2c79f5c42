# SPDX-License-Identifier: Apache-2.0
"""The message of the node at its start, and that on arguments that it cannot read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.description import describe_rig, frequency_hint
from impact_damper_ros.parameters.parameters_file import fault_of_file
from impact_damper_ros.parameters.quoting import as_name, printable, quote

from .parameters import NodeParameters


def argument_fault(error: Exception, arguments: Sequence[str]) -> str:
    """Return the fault of arguments that rcl cannot parse, and the remedy."""
    for option, word in pairwise(arguments):
        if option == '--params-file' and (fault := fault_of_file(Path(word))):
            return fault
        if option in ('-p', '--param') and ':=' not in word:
            name, _, value = word.partition('=')
            return f'{option} {quote(word)}: write {option} {as_name(name)}:={as_name(value)}'
        if option in ('-p', '--param') and not all(word.split(':=', 1)):
            return f'{option} {quote(word)}: write {option} NAME:=VALUE, as in -p gap:=12mm'
        if option in ('-r', '--remap') and word.startswith('__ns:=') and word[6:7] != '/':
            return f'{option} {quote(word)}: write {option} __ns:=/{as_name(word[6:])}'
    text = str(error).split(', at /')[0].removeprefix('failed to initialize rcl: ')
    if 'Sequence should be of same type' in text:
        text += ' (write [1.0, 0.5], not [1, 0.5])'
    return text


def unknown_argument(word: str) -> str:
    """Return the fault of an argument that neither the node nor ROS knows, and the remedy."""
    return (
        f'unknown argument {quote(word)}; parameters and their files follow --ros-args, each '
        'behind -p or --params-file, as in: sim_node --ros-args --params-file rig.yaml '
        '-p gap:=12mm'
    )


def given_text(given: Mapping[str, Any], applied: Sequence[str]) -> str:
    """Return the number of given parameters and their sources, in words."""
    count = sum(name in ALL_SPECS for name in given)
    places = ', '.join(map(printable, applied))
    return f'{count} of {len(ALL_SPECS)} are given, by {places}' if count else 'all by default'


def start_message(
    parameters: NodeParameters, node: str, recording: str, given: str = 'all by default'
) -> str:
    """Return a summary of the node in a few lines."""
    measured = [(name, getattr(parameters, name)) for name in ('force_record', 'base_record')]
    lines = [
        f'{node} runs {_pace(parameters.real_time_factor)}',
        f'rig        {describe_rig(parameters.rig)}',
        *(f'measured   {name} {printable(path)}' for name, path in measured if path != 'none'),
        f'parameters {given}',
        f'recording  {f"to {recording}" if recording else "off"}',
    ]
    if parameters.lock_step != 'off' and parameters.control.gap_control != 'external':
        lines.append(
            f'note       lock_step has no effect: gap_control is {parameters.control.gap_control}'
            ', set it to external'
        )
    if hint := frequency_hint(parameters.rig):
        lines.append(f'note       {hint}')
    return '\n  '.join(lines)


def _pace(factor: float) -> str:
    if factor == 0.0:
        return 'as fast as possible'
    return 'in real time' if factor == 1.0 else f'at {factor:g} times real time'
