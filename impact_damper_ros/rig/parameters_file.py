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
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from .parameter_spec import ParameterError
from .parameters import ALL_SPECS, INITIAL_SPECS, PARAMETER_SPECS, InitialConditions, RigParameters
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

_CONTROL = re.compile('[\0-\x08\x0b\x0c\x0e-\x1f\x7f]')
#: In C where PyYAML was built with it, which is thirty times as fast.
_Base: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class YamlError(ValueError):
    """A file that cannot be read as YAML; the message names line, cause and remedy."""


class Block(dict[Any, Any]):
    """
    A mapping with the lines of its keys.

    Attributes
    ----------
    lines : dict
        Line of each key, from 1.
    """

    def __init__(self) -> None:
        """Begin empty."""
        super().__init__()
        self.lines: dict[Any, int] = {}


class _Loader(_Base):  # type: ignore[misc]
    """YAML 1.1 as ROS reads it, but with numbers such as ``1e-3`` as numbers."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            kind = node.tag.rsplit(':', 1)[-1]
            raise YamlError(
                f'line {_line(node)}: {shown(node.value)} is no value of the kind {kind}: write '
                'it in another way, or in quotes if it is a text'
            ) from None

    def construct_mapping(self, node: Any, deep: bool = False) -> Block:
        block = Block()
        if not isinstance(node, yaml.MappingNode):
            raise YamlError(f'line {_line(node)}: is not a list of "name: value" lines')
        for key_node, value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            block[key] = self.construct_object(value_node, deep=deep)
            block.lines[key] = _line(key_node)
        return block


def _number(construct: Any) -> Any:
    """Return a constructor that leaves 1:30 a text, as ROS does; YAML 1.1 counts in sixties."""

    def constructed(loader: _Loader, node: Any) -> Any:
        return node.value if ':' in node.value else construct(loader, node)

    return constructed


for _kind in ('int', 'float'):
    _tag = f'tag:yaml.org,2002:{_kind}'
    _Loader.add_constructor(_tag, _number(_Loader.yaml_constructors[_tag]))


def _map(loader: _Loader, node: Any) -> Any:
    data = Block()
    yield data
    block = loader.construct_mapping(node)
    data.update(block)
    data.lines.update(block.lines)


_Loader.add_constructor('tag:yaml.org,2002:map', _map)
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'^[-+]?(\d+(_\d+)*\.?\d*|\.\d+)([eE][-+]?\d+)$'),
    list('-+0123456789.'),
)


def _line(node: Any) -> int:
    return int(node.start_mark.line) + 1


def _text(path: Path) -> str:
    """Return the text of a file; a named pipe without a writer is empty."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    with open(descriptor, 'rb') as stream:  # noqa: PTH123 - of a descriptor
        os.set_blocking(descriptor, True)
        data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise YamlError(
            f'is longer than {MOST_BYTES // 10**6} MB, the most that is read: give a file with '
            'the parameters alone'
        )
    try:
        text = data.decode('utf-8')
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise YamlError(f'line {line}: cannot be read as UTF-8 text: save it as such') from None
    if unprintable := _CONTROL.search(text):
        line = text.count('\n', 0, unprintable.start()) + 1
        raise YamlError(
            f'line {line}: is not YAML: holds the control character {shown(unprintable[0])}: '
            'remove it'
        )
    return text


class _Level:
    """A list or mapping that is being read."""

    def __init__(self, event: Any) -> None:
        self.names: dict[str, int] | None = {} if isinstance(event, _MAPPING) else None
        self.key_is_next = True

    def take(self, event: Any) -> None:
        """Take the next entry: in a mapping a key, then its value."""
        if self.names is None:
            return
        if self.key_is_next:
            self._take_key(event, self.names)
        self.key_is_next = not self.key_is_next

    def _take_key(self, event: Any, names: dict[str, int]) -> None:
        line = _line(event)
        if not isinstance(event, yaml.ScalarEvent):
            raise YamlError(
                f'line {line}: a list or mapping stands in place of a name: write a name'
            )
        if event.value == '<<' and event.implicit[0]:
            raise YamlError(
                f'line {line}: "<<" merges other lines in, which ROS does not: write them out'
            )
        if event.value in names:
            raise YamlError(
                f'line {line}: {shown(event.value)} stands there twice, first in line '
                f'{names[event.value]}: keep one of them'
            )
        names[event.value] = line


_MAPPING = yaml.MappingStartEvent


def _check(text: str) -> None:
    """Check size, depth and names of a text before it is loaded."""
    entries = documents = 0
    levels: list[_Level] = []
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise YamlError(f'line {_line(event)}: a second document begins: keep one')
        if isinstance(event, yaml.CollectionEndEvent):
            levels.pop()
        if not isinstance(event, yaml.NodeEvent):
            continue
        if event.anchor is not None:
            sign = '*' if isinstance(event, yaml.AliasEvent) else '&'
            raise YamlError(
                f'line {_line(event)}: {named(sign + event.anchor)} is an anchor or alias, '
                'which ROS does not read: write the value out'
            )
        entries += 1
        if entries > MOST_ENTRIES:
            raise YamlError(
                f'line {_line(event)}: there are more than {MOST_ENTRIES} names and values: give '
                'a file with the parameters alone'
            )
        if levels:
            levels[-1].take(event)
        if isinstance(event, yaml.CollectionStartEvent):
            levels.append(_Level(event))
            if len(levels) > MOST_LEVELS:
                raise YamlError(
                    f'line {_line(event)}: is nested more than {MOST_LEVELS} deep: write fewer '
                    'levels'
                )


def check_yaml(path: Path) -> None:
    """Check size, depth and names of a YAML file, but not its values."""
    text = _text(path)
    with _in_words():
        _check(text)


@contextmanager
def _in_words() -> Iterator[None]:
    """Turn every error of a loader into a `YamlError`."""
    try:
        yield
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f'line {mark.line + 1}: ' if mark is not None else ''
        problem = named(error.problem or error, 200)
        raise YamlError(f'{place}is not YAML: {problem}') from None
    except yaml.YAMLError as error:
        raise YamlError(f'is not YAML: {named(error, 200)}') from None
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError) as error:
        raise YamlError(f'is not YAML that can be read: {named(error)}') from None


def guarded_yaml(path: Path) -> Any:
    """Read a YAML file."""
    return guarded_yaml_text(_text(path))


def guarded_yaml_text(text: str) -> Any:
    """Read a YAML text as `guarded_yaml` reads a file."""
    with _in_words():
        _check(text)
        loader = _Loader(text)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()


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


def _parameter_blocks(tree: Block, path: Path, node: str) -> Block:
    """
    Merge the blocks that apply to the node; later ones take precedence.

    ROS takes them in the order of the file. Without a name of the node, the blocks of any sim_node
    apply, the more specific ones last.
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
    allowed = [*ALL_SPECS, *_ROS_NAMES]
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
