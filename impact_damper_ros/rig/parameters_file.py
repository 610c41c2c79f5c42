"""Parameters files: the same ROS 2 YAML that ``--params-file`` takes, read without ROS."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import yaml

from .parameters import INITIAL_SPECS, PARAMETER_SPECS, InitialConditions, RigParameters

__all__ = ['ParametersFileError', 'load_parameters']

_NODE_NAMES = ('/**', 'sim_node')
# Other parameters that may stand in the same file: of the node, and of the gap control, which is
# a layer above (`control.GAP_CONTROL_SPECS`; a test compares the names).
_OTHER_NAMES = (
    'state_rate',
    'real_time_factor',
    'publish_clock',
    'record',
    'bag_directory',
    'use_sim_time',
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


class _Loader(yaml.SafeLoader):
    """YAML 1.1 as ROS reads it, but with numbers such as ``1e-3`` as numbers."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'^[-+]?(\d+(_\d+)*\.?\d*|\.\d+)([eE][-+]?\d+)$'),
    list('-+0123456789.'),
)


def _flattened(tree: dict[Any, Any], above: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the names of nodes with what stands below them, nested namespaces joined."""
    for key, value in tree.items():
        name = f'{above}/{key}' if above else str(key)
        nested = isinstance(value, dict) and 'ros__parameters' not in value
        if nested and any(isinstance(below, dict) for below in value.values()):
            yield from _flattened(value, name)
        else:
            yield name, value


def _parameter_blocks(tree: dict[Any, Any], path: Path) -> dict[str, Any]:
    """Merge the blocks that apply to the node, the more specific ones last."""
    found: dict[str, Any] = {}
    blocks: list[tuple[int, str, dict[str, Any]]] = []
    for key, value in _flattened(tree):
        last = key.rstrip('/').rsplit('/', 1)[-1]
        if key in ('/**', '/*', '/**/*', '**') or last in ('sim_node', '**', '*'):
            if not isinstance(value, dict) or 'ros__parameters' not in value:
                raise ParametersFileError(
                    f'{path}: {key} has no ros__parameters: below it, write the line '
                    '"ros__parameters:" and the parameters below that'
                )
            blocks.append((last == 'sim_node', key, value['ros__parameters'] or {}))
    if not blocks:
        raise ParametersFileError(
            f'{path}: no parameters for sim_node among {", ".join(map(str, tree)) or "nothing"}: '
            'start the file with "/**:" and, indented below it, "ros__parameters:"'
        )
    for _, key, block in sorted(blocks, key=lambda entry: entry[0]):
        if not isinstance(block, dict):
            raise ParametersFileError(
                f'{path}: ros__parameters of {key} is not a list of "name: value" lines'
            )
        found.update(block)
    return found


def load_parameters(
    path: str | PathLike[str], known: tuple[str, ...] = ()
) -> tuple[RigParameters, InitialConditions, dict[str, Any]]:
    """
    Read a rig from a ROS 2 parameters file.

    Parameters
    ----------
    path : str or path
        YAML file with ``/**: ros__parameters:`` or the same for ``sim_node``.
    known : tuple of str, optional
        Names of other parameters that are allowed, besides those of node and gap control.

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
    path = Path(fspath(path))
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ParametersFileError(
            f'{path}: cannot be read ({reason}): give the path of a ROS 2 parameters file'
        ) from error
    try:
        tree = yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        raise ParametersFileError(f'{path}: is not YAML: {error}') from error
    if not isinstance(tree, dict) or not tree:
        raise ParametersFileError(
            f'{path}: holds no parameters: start the file with "/**:" and, indented below it, '
            '"ros__parameters:"'
        )
    values = _parameter_blocks(tree, path)
    allowed = [*PARAMETER_SPECS, *INITIAL_SPECS, *_OTHER_NAMES, *known]
    for name in values:
        base = str(name).split('.')[0]
        if base not in allowed and base != 'qos_overrides':
            close = difflib.get_close_matches(str(name), allowed, 1)
            hint = f'did you mean {close[0]}?' if close else 'remove it'
            raise ParametersFileError(f'{path}: unknown parameter {name}: {hint}')
    parameters = RigParameters(**{k: v for k, v in values.items() if k in PARAMETER_SPECS})
    initial = InitialConditions(**{k: v for k, v in values.items() if k in INITIAL_SPECS})
    initial.check_within(parameters)
    other = {
        k: v for k, v in values.items() if k not in PARAMETER_SPECS and k not in INITIAL_SPECS
    }
    return parameters, initial, other
