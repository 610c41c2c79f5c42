"""
Message definitions and type hashes of the recorded interfaces, without ROS.

A bag describes its own messages: the schema of an MCAP file holds the text of the definition, its
dependencies included, and each channel the hash of the type (REP 2016). Both are shipped beside
this module, as ROS 2 Jazzy installs them, so that a bag can be written where no ROS is installed.
"""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.resources import files

__all__ = ['definition', 'definition_file', 'type_hash', 'type_hashes']

_DEFINITIONS = files('impact_damper_ros.recording') / 'definitions'
_SEPARATOR = '=' * 80
_FIELD = re.compile(r'^\s*([A-Za-z]\w*/)?([A-Z]\w*)(?:\[[^\]]*\])?\s+\w+', re.MULTILINE)


@cache
def type_hashes() -> dict[str, str]:
    """Return the REP 2016 hash of each shipped type, by full name (``pkg/msg/Type``)."""
    hashes: dict[str, str] = json.loads((_DEFINITIONS / 'type_hashes.json').read_text('utf-8'))
    return hashes


def type_hash(interface: str) -> str:
    """
    Return the hash of one type, such as ``RIHS01_...``.

    Raises
    ------
    KeyError
        If no definition of this type is shipped.
    """
    try:
        return type_hashes()[interface]
    except KeyError:
        known = ', '.join(type_hashes())
        raise KeyError(
            f'no definition of {interface!r} is shipped; known types: {known}'
        ) from None


def definition_file(interface: str) -> str:
    """Return the text of the type's own ``.msg`` file."""
    type_hash(interface)
    package, _, name = interface.split('/')
    return (_DEFINITIONS / package / 'msg' / f'{name}.msg').read_text('utf-8')


@cache
def definition(interface: str) -> str:
    """
    Return the definition with all it depends on, as the ``ros2msg`` encoding asks.

    The dependencies follow depth first, in alphabetical order and once each, every one after a
    line of 80 equals signs and a line ``MSG: pkg/Type``: the order in which rosbag2 writes them.
    """
    seen: set[str] = set()

    def expand(name: str) -> str:
        text = definition_file(name)
        package = name.split('/')[0]
        matches = _FIELD.finditer(text)
        for dependency in sorted({f'{m[1] or package + "/"}{m[2]}' for m in matches}):
            if dependency not in seen:
                seen.add(dependency)
                head = f'\n{_SEPARATOR}\nMSG: {dependency}\n'
                text += head + expand('/msg/'.join(dependency.split('/')))
        return text

    return expand(interface)
