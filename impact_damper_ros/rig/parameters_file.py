"""Parameters files: the same ROS 2 YAML that ``--params-file`` takes, read without ROS."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from .guarded_yaml import Block, YamlError, guarded_yaml
from .parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    ParameterError,
    RigParameters,
)
from .presets import preset_file, presets
from .shown import named

__all__ = ['ParametersFileError', 'load_parameters']

# Other parameters that may stand in the same file: of the node, which ROS itself adds to, and of
# the gap control. Both are layers above; tests compare the names with theirs.
_OTHER_NAMES = (
    'state_rate',
    'real_time_factor',
    'publish_clock',
    'real_time_priority',
    'predict_motion',
    'record',
    'bag_directory',
    'max_bag_size',
    'max_bag_duration',
    'use_sim_time',
    'start_type_description_service',
    'gap_control',
    'gap_control_stops',
    'gap_control_gain',
    'gap_control_park',
    'gap_control_lead',
    'gap_control_timing_gain',
    'gap_control_smoothing',
    'gap_control_threshold',
    'gap_min',
    'gap_max',
    'gap_control_rate',
    'gap_control_noise_position',
    'gap_control_noise_velocity',
    'gap_control_seed',
    'actuator_delay',
    'actuator_speed',
    'actuator_mass',
)


class ParametersFileError(ValueError):
    """A parameters file that cannot be used; the message names file, cause and remedy."""


def _flattened(tree: dict[Any, Any], above: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the names of nodes with what stands below them, nested namespaces joined."""
    for key, value in tree.items():
        name = f'{above.removesuffix("/")}/{key}' if above else str(key)
        nested = isinstance(value, dict) and 'ros__parameters' not in value
        if nested and any(isinstance(below, dict) for below in value.values()):
            yield from _flattened(value, name)
        else:
            yield name, value


def _is_of(key: str, node: str) -> bool:
    """Return whether ROS gives an entry to a node: /* is any one part of its name, /** any."""
    # As rclpy has it. Its other signs are letters, digits and _.
    parts = re.split(r'(/\*\*|/\*)', key if key.startswith('/') else f'/{key}')
    wild = {'/*': r'(/\w+)', '/**': r'(/\w+)*'}
    return re.fullmatch(''.join(wild.get(p) or re.escape(p) for p in parts), node) is not None


def _parameter_blocks(tree: Block, path: Path, node: str) -> Block:
    """
    Merge the blocks that apply to the node, in the order in which they count.

    ROS takes them as they stand in the file. Without a name of the node, any sim_node will do, and
    the more specific blocks come last.
    """
    found = Block()
    blocks: list[tuple[int, str, dict[str, Any]]] = []
    for key, value in _flattened(tree):
        last = key.rstrip('/').rsplit('/', 1)[-1]
        if node:
            applies = _is_of(key, node)
        else:
            applies = key in ('/**', '/*', '/**/*', '**') or last in ('sim_node', '**', '*')
        if applies:
            if not isinstance(value, dict) or 'ros__parameters' not in value:
                raise ParametersFileError(
                    f'{path}: {named(key)} has no ros__parameters: below it, write the line '
                    '"ros__parameters:" and the parameters below that'
                )
            place = 0 if node else int(last == 'sim_node')
            blocks.append((place, key, value['ros__parameters'] or {}))
    if not blocks:
        raise ParametersFileError(
            f'{path}: no parameters for {named(node or "sim_node")} among {_names(tree)}: '
            'start the file with "/**:" and, indented below it, "ros__parameters:"'
        )
    for _, key, block in sorted(blocks, key=lambda entry: entry[0]):
        if not isinstance(block, dict):
            raise ParametersFileError(
                f'{path}: ros__parameters of {named(key)} is not a list of "name: value" lines'
            )
        found.update(block)
        found.lines.update(getattr(block, 'lines', {}))
    return found


def _names(tree: Block) -> str:
    """Return the first names of a file."""
    names = [named(key) for key, _ in zip(tree, range(8), strict=False)]
    return ', '.join([*names, *(['...'] if len(tree) > 8 else [])]) or 'nothing'


def load_parameters(
    path: str | PathLike[str], known: tuple[str, ...] = (), node: str = ''
) -> tuple[RigParameters, InitialConditions, dict[str, Any]]:
    """
    Read a rig from a ROS 2 parameters file.

    Parameters
    ----------
    path : str or path
        YAML file with ``/**: ros__parameters:`` or the same for ``sim_node``; or the name of a
        preset, such as ``bench_rig``, if there is no such file.
    known : tuple of str, optional
        Names of other parameters that are allowed, besides those of node and gap control.
    node : str, optional
        Full name of a node, such as ``/rig1/sim_node``: the entries of the file that ROS gives to
        it are read, and no others. Without it, those of any `sim_node`.

    Returns
    -------
    parameters : RigParameters
        The rig; parameters that the file does not give have their defaults.
    initial : InitialConditions
        Where it starts.
    other : dict
        The parameters that do not describe the rig, such as `state_rate`, unchecked.

    Raises
    ------
    ParametersFileError
        If the file cannot be read, is not such a file, or names an unknown parameter.
    ParameterError
        If a value is not admissible.
    """
    path = preset_file(Path(fspath(path)))
    try:
        tree = guarded_yaml(path)
    except OSError as error:
        remedy = 'give the path of a ROS 2 parameters file'
        if isinstance(error, FileNotFoundError):
            remedy += f', or a preset: {", ".join(presets())}'
        raise ParametersFileError(
            f'{path}: cannot be read ({error.strerror or error}): {remedy}'
        ) from error
    except YamlError as error:
        raise ParametersFileError(f'{path}: {error}') from None
    if not isinstance(tree, Block) or not tree:
        raise ParametersFileError(
            f'{path}: holds no parameters: start the file with "/**:" and, indented below it, '
            '"ros__parameters:"'
        )
    values = _parameter_blocks(tree, path, node)
    allowed = [*PARAMETER_SPECS, *INITIAL_SPECS, *_OTHER_NAMES, *known]
    for name in values:
        base = str(name).split('.')[0]
        if base not in allowed and base != 'qos_overrides':
            close = difflib.get_close_matches(str(name)[:80], allowed, 1)
            hint = f'did you mean {close[0]}?' if close else 'remove it'
            raise ParametersFileError(
                f'{path}: line {values.lines[name]}: unknown parameter {named(name)}: {hint}'
            )
    try:
        parameters = RigParameters(**{k: v for k, v in values.items() if k in PARAMETER_SPECS})
        initial = InitialConditions(**{k: v for k, v in values.items() if k in INITIAL_SPECS})
        initial.check_within(parameters)
    except ParameterError as error:
        line = values.lines.get(error.name)
        place = f'line {line}: ' if line else ''
        raise ParameterError(error.name, f'{path}: {place}{error}') from None
    other = {
        k: v for k, v in values.items() if k not in PARAMETER_SPECS and k not in INITIAL_SPECS
    }
    return parameters, initial, other
