# SPDX-License-Identifier: Apache-2.0
"""
Parameters files: the ROS 2 YAML that ``--params-file`` takes, read without ROS and within limits.

A preset is a file of config/, which is installed as share/impact_damper_ros/config. Aliases let a
few lines of YAML stand for a tree of any size, and deep nesting makes a loader slow or fail; both
are refused.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice
from operator import itemgetter
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from impact_damper_ros.parameters.rig_parameters import (
    ALL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
)

from .parameter_spec import ParameterError
from .quoting import named, shown

_NAME = 'impact_damper_ros'
_PACKAGE = Path(__file__).parents[1]


def _folders() -> Iterator[Path]:
    """Yield the folders in which the presets may be, the most likely first."""
    for package in dict.fromkeys((_PACKAGE, _PACKAGE.resolve())):
        # The source tree: a linked installation has no share directory of its own
        if (package.parent / 'resource' / _NAME).is_file():
            yield package.parent / 'config'
        for above in package.parents:
            yield above / 'share' / _NAME / 'config'


def presets() -> dict[str, Path]:
    """Return the parameters file of each preset, by its name; none if they are not installed."""
    for folder in _folders():
        found = {path.stem: path for path in sorted(folder.glob('*.yaml'))}
        if found:
            return found
    return {}


def preset_file(path: Path) -> Path:
    """Return the parameters file of a preset, or the path as it is; an existing file wins."""
    if os.path.exists(path) and not os.path.isdir(path):  # noqa: PTH110, PTH112 - never raise
        return path
    return presets().get(str(path), path)


MOST_BYTES = 1_000_000
MOST_ENTRIES = 20_000
MOST_LEVELS = 16

#: In C where PyYAML was built with it, which is thirty times as fast.
_Base: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class YamlError(ValueError):
    """A file that cannot be read as YAML; the message names line, cause and remedy."""


class Block(dict[Any, Any]):
    """A mapping with the line of each key, from 1."""

    def __init__(self) -> None:
        """Begin empty."""
        super().__init__()
        self.lines: dict[Any, int] = {}


class _Loader(_Base):  # type: ignore[misc]
    """YAML 1.1 as ROS reads it: ``1e-3`` is a number; a date, and 1:30 in sixties, is a text."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (yaml.YAMLError, YamlError):
            raise
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            kind = node.tag.rsplit(':', 1)[-1]
            raise YamlError(
                f'line {_line(node)}: {shown(node.value)} is no value of the kind {kind}: write '
                'it in another way, or in quotes if it is a text'
            ) from None

    def construct_mapping(self, node: Any) -> Block:
        block = Block()
        for key_node, value_node in node.value:
            key, line = self.construct_object(key_node, deep=True), _line(key_node)
            if isinstance(key, list | dict):
                raise YamlError(
                    f'line {line}: a list or mapping stands in place of a name: write a name'
                )
            if key in block:
                raise YamlError(
                    f'line {line}: {shown(key)} stands there twice, first in line '
                    f'{block.lines[key]}: keep one of them'
                )
            block[key] = self.construct_object(value_node, deep=True)
            block.lines[key] = line
        return block


def _number(construct: Any) -> Any:
    """Return a constructor of numbers that leaves 1:30 a text."""
    return lambda loader, node: node.value if ':' in node.value else construct(loader, node)


for _kind in ('int', 'float'):
    _tag = f'tag:yaml.org,2002:{_kind}'
    _Loader.add_constructor(_tag, _number(_Loader.yaml_constructors[_tag]))
_Loader.add_constructor('tag:yaml.org,2002:map', _Loader.construct_mapping)
_Loader.yaml_implicit_resolvers = {
    first: [entry for entry in entries if not entry[0].endswith((':timestamp', ':merge'))]
    for first, entries in _Base.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'^[-+]?(\d+(_\d+)*\.?\d*|\.\d+)([eE][-+]?\d+)$'),
    list('-+0123456789.'),
)


def _line(node: Any) -> int:
    return int(node.start_mark.line) + 1


def _check(text: str) -> None:
    """Check size, depth and aliases of a text before it is loaded."""
    entries = depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        entries += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        anchor = getattr(event, 'anchor', None)
        if anchor is not None:
            sign = '*' if isinstance(event, yaml.AliasEvent) else '&'
            fault = (
                f'{named(sign + anchor)} is an anchor or alias, which ROS does not read: '
                'write the value out'
            )
        elif entries > MOST_ENTRIES:
            fault = (
                f'there are more than {MOST_ENTRIES} names and values: give a file with the '
                'parameters alone'
            )
        elif depth > MOST_LEVELS:
            fault = f'is nested more than {MOST_LEVELS} deep: write fewer levels'
        else:
            continue
        raise YamlError(f'line {_line(event)}: {fault}')


def guarded_yaml(path: Path) -> Any:
    """Read a YAML file."""
    with path.open('rb') as stream:
        data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise YamlError(
            f'is longer than {MOST_BYTES // 10**6} MB, the most that is read: give a file with '
            'the parameters alone'
        )
    try:
        return guarded_yaml_text(data.decode('utf-8'))
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise YamlError(f'line {line}: cannot be read as UTF-8 text: save it as such') from None


def guarded_yaml_text(text: str) -> Any:
    """Read a YAML text as `guarded_yaml` reads a file."""
    try:
        _check(text)
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None) or getattr(error, 'context_mark', None)
        place = '' if mark is None else f'line {mark.line + 1}: '
        problem = named(getattr(error, 'problem', None) or error, 200)
        raise YamlError(f'{place}is not YAML: {problem}') from None


# Parameters that ROS itself gives every node
_ROS_NAMES = ('use_sim_time', 'start_type_description_service')


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
    """Return whether an entry applies to a node: /* is one part of its name, /** any number."""
    # As in rclpy. Other characters of a name are letters, digits and _.
    parts = re.split(r'(/\*\*|/\*)', key if key.startswith('/') else f'/{key}')
    wild = {'/*': r'(/\w+)', '/**': r'(/\w+)*'}
    return re.fullmatch(''.join(wild.get(p) or re.escape(p) for p in parts), node) is not None


def _parameter_blocks(tree: Block, node: str) -> Block:
    """
    Merge the blocks that apply to the node; later ones take precedence.

    ROS takes them in the order of the file. Without a name of the node, the blocks of any sim_node
    apply, the more specific ones last.
    """
    blocks: list[tuple[bool, Block]] = []
    for key, value in _flattened(tree):
        last = key.rstrip('/').rsplit('/', 1)[-1]
        if node:
            applies = _is_of(key, node)
        else:
            applies = key in ('/**', '/*', '/**/*', '**') or last in ('sim_node', '**', '*')
        if not applies:
            continue
        if not isinstance(value, dict) or 'ros__parameters' not in value:
            raise ParametersFileError(
                f'{named(key)} has no ros__parameters: below it, write the line '
                '"ros__parameters:" and the parameters below that'
            )
        block = value['ros__parameters'] or Block()
        if not isinstance(block, Block):
            raise ParametersFileError(
                f'ros__parameters of {named(key)} is not a list of "name: value" lines'
            )
        blocks.append((not node and last == 'sim_node', block))
    if not blocks:
        names = [*map(named, islice(tree, 8)), *(['...'] if len(tree) > 8 else [])]
        raise ParametersFileError(
            f'no parameters for {named(node or "sim_node")} among {", ".join(names)}: '
            'start the file with "/**:" and, indented below it, "ros__parameters:"'
        )
    found = Block()
    for _, block in sorted(blocks, key=itemgetter(0)):
        found.update(block)
        found.lines.update(block.lines)
    return found


def _values(path: Path, node: str) -> Block:
    """Return the values of known parameters that a file sets for a node."""
    tree = guarded_yaml(path)
    if not isinstance(tree, Block) or not tree:
        raise ParametersFileError(
            'holds no parameters: start the file with "/**:" and, indented below it, '
            '"ros__parameters:"'
        )
    values = _parameter_blocks(tree, node)
    allowed = [*ALL_SPECS, *_ROS_NAMES]
    for name in values:
        if str(name).split('.')[0] not in [*allowed, 'qos_overrides']:
            close = difflib.get_close_matches(str(name)[:80], allowed, 1)
            hint = f'did you mean {close[0]}?' if close else 'remove it'
            raise ParametersFileError(
                f'line {values.lines[name]}: unknown parameter {named(name)}: {hint}'
            )
    return values


def values_given(arguments: Sequence[str], node: str) -> dict[str, list[Any]]:
    """
    Return the values that a command line gives each parameter of a node, in the order given.

    Those in parameters files named there are among them.

    Parameters
    ----------
    arguments : sequence of str
        With the options ``-p``, ``--param`` and ``--params-file`` after ``--ros-args``; what
        cannot be read is left out.
    node : str
        Full name of the node, such as ``/rig1/sim_node``.
    """
    found: dict[str, list[Any]] = {}
    words, of_ros = iter(arguments), False
    for word in words:
        if word in ('--ros-args', '--'):
            of_ros = word == '--ros-args'
        elif of_ros and word in ('-p', '--param'):
            left, _, text = next(words, '').partition(':=')
            owner, _, name = left.rpartition(':')
            if not owner or _is_of(owner, node):
                with suppress(ValueError):
                    value = guarded_yaml_text(text)
                    found.setdefault(name, []).append(value)
        elif of_ros and word == '--params-file':
            with suppress(ValueError, OSError):
                tree = guarded_yaml(Path(next(words, '')))
                if isinstance(tree, Block):
                    for name, value in _parameter_blocks(tree, node).items():
                        found.setdefault(str(name), []).append(value)
    return found


def load_parameters(
    path: str | PathLike[str], node: str = ''
) -> tuple[RigParameters, InitialConditions, dict[str, Any]]:
    """
    Read a rig from a ROS 2 parameters file.

    Parameters
    ----------
    path : str or path
        YAML file with ``/**: ros__parameters:`` or the same for ``sim_node``; or the name of a
        preset, such as ``bench_rig``, if there is no such file.
    node : str, optional
        Full name of a node, such as ``/rig1/sim_node``: only the entries that ROS applies to it
        are read. Without it, those of any `sim_node`.

    Returns
    -------
    parameters : RigParameters
        The rig; parameters that the file does not give have their defaults.
    initial : InitialConditions
        Where it starts.
    other : dict
        All other parameters, such as `state_rate`, unchecked.

    Raises
    ------
    ParametersFileError
        If the file cannot be read, is not such a file, or names an unknown parameter.
    ParameterError
        If a value is not admissible.
    """
    path = preset_file(Path(path))
    try:
        values = _values(path, node)
    except OSError as error:
        remedy = 'give the path of a ROS 2 parameters file'
        if isinstance(error, FileNotFoundError):
            remedy += f', or a preset: {", ".join(presets())}'
        raise ParametersFileError(
            f'{path}: cannot be read ({error.strerror or error}): {remedy}'
        ) from error
    except (ParametersFileError, YamlError) as error:
        raise ParametersFileError(f'{path}: {error}') from None
    try:
        parameters = RigParameters(**{k: v for k, v in values.items() if k in PARAMETER_SPECS})
        initial = InitialConditions(**{k: v for k, v in values.items() if k in INITIAL_SPECS})
        initial.check_within(parameters)
    except ParameterError as error:
        line = values.lines.get(error.name)
        place = f'line {line}: ' if line else ''
        raise ParameterError(error.name, f'{path}: {place}{error}') from None
    own = PARAMETER_SPECS.keys() | INITIAL_SPECS.keys()
    return parameters, initial, {k: v for k, v in values.items() if k not in own}
