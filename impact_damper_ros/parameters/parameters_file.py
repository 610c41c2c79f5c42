# SPDX-License-Identifier: Apache-2.0
"""
Parameters files: the ROS 2 YAML that ``--params-file`` takes, read without ROS by its rules.

A preset is a file of config/, which is installed as share/impact_damper_ros/config.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from impact_damper_ros.parameters.all_parameters import ALL_SPECS, RIG_SPECS, unit_of
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    InitialConditions,
    RigParameters,
)

from .parameter_spec import ParameterError, ParameterTable
from .quoting import as_name, quote, similar_names
from .structure import STRUCTURE_SPECS

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


#: Longest file that is read, bytes: the presets have 3,000.
MOST_BYTES = 1_000_000

#: In C where PyYAML was built with it, which is thirty times as fast.
_Base: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class YamlError(ValueError):
    """A file that cannot be read as YAML; the message names line, cause and remedy."""


class LineMapping(dict[Any, Any]):
    """A mapping with the line of each key, from 1."""

    def __init__(self) -> None:
        """Begin empty."""
        super().__init__()
        self.lines: dict[Any, int] = {}

    def add(self, other: LineMapping) -> None:
        """Add the entries of another mapping, which replace entries of the same name."""
        self.update(other)
        self.lines.update(other.lines)


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
                f'line {_line(node)}: {quote(node.value)} is no value of the kind {kind}: write '
                'it in another way, or in quotes if it is a text'
            ) from None

    def construct_mapping(self, node: Any) -> LineMapping:
        block = LineMapping()
        for key_node, value_node in node.value:
            key, line = self.construct_object(key_node, deep=True), _line(key_node)
            if isinstance(key, list | dict):
                raise YamlError(
                    f'line {line}: a list or mapping stands in place of a name: write a name'
                )
            if key in block:
                raise YamlError(
                    f'line {line}: {quote(key)} stands there twice, first in line '
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


def _load(text: str | bytes) -> list[Any]:
    """Return the documents of a YAML text."""
    try:
        return list(yaml.load_all(text, Loader=_Loader))
    except RecursionError:
        raise YamlError('is nested too deep: write fewer levels') from None
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        lines = before.count('\n') if isinstance(before, str) else before.count(b'\n')
        raise YamlError(
            f'line {lines + 1}: cannot be read as text ({error.reason}): save it as UTF-8'
        ) from None
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None) or getattr(error, 'context_mark', None)
        place = '' if mark is None else f'line {mark.line + 1}: '
        problem = as_name(getattr(error, 'problem', None) or error, 200)
        raise YamlError(f'{place}is not YAML: {problem}') from None


def read_yaml(path: Path) -> list[Any]:
    """Return the documents of a YAML file, which is in UTF-8 or UTF-16."""
    with path.open('rb') as stream:
        data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise YamlError(
            f'is longer than {MOST_BYTES // 10**6} MB, the most that is read: give a file with '
            'the parameters alone'
        )
    return _load(data)


def yaml_value(text: str) -> Any:
    """Return a value that is typed as in a parameters file."""
    values = _load(text)
    if len(values) > 1:
        raise YamlError('has more than one value: give one')
    return values[0] if values else None


# Parameters that ROS itself gives every node
_ROS_NAMES = ('use_sim_time', 'start_type_description_service')
#: Most nodes that are looked for in a file.
_MOST_NODES = 10_000
#: Name of the node of a rig, unless it is remapped.
_RIG = 'sim_node'
_HEAD = 'start the file with "/**:" and, indented below it, "ros__parameters:"'


class ParametersFileError(ValueError):
    """
    A parameters file that cannot be used; the message names file, cause and remedy.

    Examples
    --------
    >>> try:
    ...     load_parameters('rig.yaml')
    ... except ParametersFileError as error:
    ...     print(str(error).partition(':')[0])
    rig.yaml
    """


def _flatten(tree: dict[Any, Any], above: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the names of nodes with what stands below them, nested namespaces joined."""
    for key, value in tree.items():
        name = f'{above.removesuffix("/")}/{key}' if above else str(key)
        nested = isinstance(value, dict) and 'ros__parameters' not in value
        if nested and any(isinstance(below, dict) for below in value.values()):
            yield from _flatten(value, name)
        else:
            yield name, value


def _entries(path: Path) -> list[tuple[str, Any]]:
    """Return the names of nodes in all documents of a file, with what stands below each."""
    try:
        trees = [tree for tree in read_yaml(path) if isinstance(tree, dict)]
        found = [entry for tree in trees for entry in islice(_flatten(tree), _MOST_NODES)]
    except RecursionError:
        raise YamlError('is nested too deep: write fewer levels') from None
    if not found:
        raise ParametersFileError(f'holds no parameters: {_HEAD}')
    return found


def _is_of(key: str, node: str) -> bool:
    """Return whether an entry applies to a node: /* is one part of its name, /** any number."""
    # As in rclpy. Other characters of a name are letters, digits and _.
    parts = re.split(r'(/\*\*|/\*)', key if key.startswith('/') else f'/{key}')
    wild = {'/*': r'(/\w+)', '/**': r'(/\w+)*'}
    return re.fullmatch(''.join(wild.get(p) or re.escape(p) for p in parts), node) is not None


def _rig_of(key: str) -> str | None:
    """Return the name of a `sim_node` to which an entry applies; None if there is none."""
    *above, last = key.strip('/').split('/')
    if last not in ('sim_node', '*', '**'):
        return None
    parts = ['rig' if part == '*' else part for part in above if part != '**']
    return '/'.join(['', *parts, _RIG])


def _rig_among(keys: Collection[str]) -> str:
    """Return the name of the one rig that a file describes."""
    found = {rig: {k for k in keys if _is_of(k, rig)} for rig in map(_rig_of, keys) if rig}
    if not found:
        raise ParametersFileError(f'{_missing("sim_node", keys)}, or name one with --node')
    rig = max(found, key=lambda name: len(found[name]))
    others = [name for name, of_it in found.items() if not of_it <= found[rig]]
    if others:
        names = [*map(as_name, [rig, *others][:8]), *(['...'] if len(others) > 7 else [])]
        raise ParametersFileError(
            f'describes several rigs, {", ".join(names)}: name one with --node'
        )
    return rig


def _missing(node: str, keys: Collection[str]) -> str:
    names = [*map(as_name, islice(keys, 8)), *(['...'] if len(keys) > 8 else [])]
    remedy = f'give one of these names, or {_HEAD}' if any(map(_rig_of, keys)) else _HEAD
    return f'no parameters for {as_name(node)} among {", ".join(names)}: {remedy}'


def _block(key: str, value: Any) -> LineMapping:
    """Return the parameters of an entry."""
    if not isinstance(value, dict):
        raise ParametersFileError(f'{as_name(key)} stands in no block of parameters: {_HEAD}')
    if 'ros__parameters' not in value:
        raise ParametersFileError(
            f'{as_name(key)} has no ros__parameters: below it, write the line '
            '"ros__parameters:" and the parameters below that'
        )
    block = value['ros__parameters'] or LineMapping()
    if not isinstance(block, LineMapping):
        raise ParametersFileError(
            f'ros__parameters of {as_name(key)} is not a list of "name: value" lines'
        )
    return block


def _merge(entries: Iterable[tuple[str, Any]], node: str) -> LineMapping:
    """
    Return the parameters that entries give a node, as ROS does: of several the last one counts.

    A repeated name adds its entries to those at its first place.
    """
    blocks: dict[str, LineMapping] = {}
    for key, value in entries:
        if _is_of(key, node):
            blocks.setdefault(key, LineMapping()).add(_block(key, value))
    found = LineMapping()
    for block in blocks.values():
        found.add(block)
    return found


def _values(path: Path, node: str) -> LineMapping:
    """Return the values of known parameters that a file sets for a node."""
    entries = _entries(path)
    keys = dict.fromkeys(key for key, _ in entries)
    node = f'/{node.strip("/")}' if node else _rig_among(keys)
    if not any(_is_of(key, node) for key in keys):
        raise ParametersFileError(_missing(node, keys))
    values = _merge(entries, node)
    allowed = [*ALL_SPECS, *STRUCTURE_SPECS, *_ROS_NAMES]
    for name in values:
        if str(name).split('.')[0] not in [*allowed, 'qos_overrides']:
            close = similar_names(name, allowed)
            hint = f'did you mean {close}?' if close else 'remove it'
            raise ParametersFileError(
                f'line {values.lines[name]}: unknown parameter {as_name(name)}: {hint}'
            )
    return values


def fault_of_file(path: Path) -> str:
    """Return what is wrong with the blocks of a parameters file; an empty text if nothing is."""
    try:
        for key, value in _entries(path):
            _block(key, value)
    except OSError:
        return ''
    except (ParametersFileError, YamlError) as error:
        return f'{path}: {error}'
    return ''


def values_given(
    arguments: Sequence[str], node: str
) -> tuple[dict[str, Any], list[str], list[str]]:
    """
    Return the values that a command line and the files named there give a node.

    Parameters
    ----------
    arguments : sequence of str
        With the options ``-p``, ``--param`` and ``--params-file`` after ``--ros-args``.
    node : str
        Full name of the node, such as ``/rig1/sim_node``.

    Returns
    -------
    values : dict
        The values by name, without those of a file that is a pipe: it can be read once only.
    idle : list of str
        For each file without parameters for the node, the names that it has.
    applied : list of str
        What applies to the node: files with their entries, and the command line.

    Raises
    ------
    ParametersFileError
        If a file cannot be read, or there are files and none has parameters for the node.
    """
    entries: list[tuple[str, Any]] = []
    files, idle, applied = 0, [], dict[str, None]()
    words, of_ros = iter(arguments), False
    for word in words:
        if word in ('--ros-args', '--'):
            of_ros = word == '--ros-args'
        elif of_ros and word in ('-p', '--param'):
            left, _, text = next(words, '').partition(':=')
            owner, _, name = left.rpartition(':')
            with suppress(ValueError):
                given = LineMapping()
                given[name] = yaml_value(text)
                entries.append((owner or '/**', {'ros__parameters': given}))
                if _is_of(entries[-1][0], node):
                    applied['the command line'] = None
        elif of_ros and word == '--params-file':
            path = Path(next(words, ''))
            files += 1
            if not path.is_file():
                continue
            try:
                of_file = _entries(path)
                if not any(_is_of(key, node) for key, _ in of_file):
                    idle.append(f'{path}: {_missing(node, dict.fromkeys(k for k, _ in of_file))}')
                own = dict.fromkeys(key for key, _ in of_file if _is_of(key, node))
                applied |= {f'{path} ({key})': None for key in own}
                entries += of_file
            except ParametersFileError as error:
                idle.append(f'{path}: {error}')
            except YamlError as error:
                raise ParametersFileError(f'{path}: {error}') from None
    if files and len(idle) == files:
        raise ParametersFileError(idle[0])
    return _merge(entries, node), idle, list(applied)


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
        are read. Without it, the entries of the one `sim_node` that the file describes are read.

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
        If the file cannot be read, is not such a file, describes several rigs, or names an
        unknown parameter.
    ParameterError
        If a value is not admissible.

    Examples
    --------
    >>> rig, initial, other = load_parameters('bench_rig')
    >>> rig.gap, initial.initial_damper_offset, other['gap_control']
    (0.024, 0.0, 'off')
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
        rig = {k: v for k, v in values.items() if k in RIG_SPECS}
        parameters = RigParameters.of_structure(**rig)
        initial = InitialConditions(**{k: v for k, v in values.items() if k in INITIAL_SPECS})
        initial.check_within(parameters)
    except ParameterError as error:
        line = values.lines.get(error.name)
        place = f'line {line}: ' if line else ''
        raise ParameterError(error.name, f'{path}: {place}{error}') from None
    own = RIG_SPECS.keys() | INITIAL_SPECS.keys()
    return parameters, initial, {k: v for k, v in values.items() if k not in own}


def rig_yaml(
    rig: RigParameters,
    title: str,
    *others: ParameterTable,
    notes: Mapping[str, str] | None = None,
) -> str:
    """
    Return a rig, with its start and its control if given, as a parameters file.

    The unit of a value stands behind it, with the remark of `notes`.
    """
    lines = [*(f'# {line}' for line in title.splitlines()), '/**:', '  ros__parameters:']
    values = {k: v for table in (rig, *others) for k, v in table.as_dict().items()}
    for name, value in values.items():
        if isinstance(value, tuple):
            text = repr(list(value))
        else:
            text = repr(value) if isinstance(value, float) else str(value).lower()
        remarks = '; '.join(filter(None, [unit_of(name, values), (notes or {}).get(name, '')]))
        lines.append(f'    {name}: {text}{f"  # {remarks}" if remarks else ""}')
    return '\n'.join(lines) + '\n'
