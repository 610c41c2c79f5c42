"""
YAML from files that anybody may have written: bounded in size, depth and entries, without aliases.

A few lines of YAML can stand for a tree of any size (an alias names what stands elsewhere), and a
loader takes long or fails on what is nested deeply. Neither has a place in a parameters file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from .shown import named, shown

__all__ = ['Block', 'YamlError', 'check_yaml', 'guarded_yaml', 'guarded_yaml_text']

MOST_BYTES = 1_000_000
MOST_ENTRIES = 20_000
MOST_LEVELS = 16

_CONTROL = re.compile('[\0-\x08\x0b\x0c\x0e-\x1f\x7f]')
#: In C where PyYAML was built with it, which is thirty times as fast.
_Base: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class YamlError(ValueError):
    """A file that cannot be taken as YAML; the message names line, cause and remedy."""


class Block(dict[Any, Any]):
    """
    A mapping that knows where its keys stand.

    Attributes
    ----------
    lines : dict
        Line of each key, from 1.
    """

    def __init__(self) -> None:
        """Hold nothing."""
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
    """Return what a file holds; a named pipe that nobody writes to is empty."""
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
        """Take what stands in it next: in a mapping a key, then its value."""
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
    """Look through the parts of a text, before anything is made of them."""
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
    """
    Check size, depth and names of a YAML file, and nothing of its values.

    Raises
    ------
    YamlError
        As `guarded_yaml`, but for values.
    OSError
        If it cannot be read.
    """
    text = _text(path)
    with _in_words():
        _check(text)


@contextmanager
def _in_words() -> Iterator[None]:
    """Make one kind of error of all that a loader may end with."""
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
    """
    Read a YAML file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    object
        What it holds; mappings are `Block`.

    Raises
    ------
    YamlError
        If it is not YAML, has aliases, merges or a name twice, or is larger than is sensible.
    OSError
        If it cannot be read.
    """
    return guarded_yaml_text(_text(path))


def guarded_yaml_text(text: str) -> Any:
    """Do the same for a text."""
    with _in_words():
        _check(text)
        loader = _Loader(text)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
