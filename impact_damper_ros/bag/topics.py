# SPDX-License-Identifier: Apache-2.0
"""
The topics that are recorded: message definitions and quality of service.

A bag describes its own messages: the schema of an MCAP file holds the text of the definition with
its dependencies, and each channel the hash of the type (REP 2016). Both are shipped beside this
module, as ROS 2 Jazzy installs them, so that a bag can be written without ROS.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import yaml

from impact_damper_ros.parameters.quoting import quote

_DEFINITIONS = files('impact_damper_ros.bag') / 'definitions'
_SEPARATOR = '=' * 80
_FIELD = re.compile(r'^\s*([A-Za-z]\w*/)?([A-Z]\w*)(?:\[[^\]]*\])?\s+\w+', re.MULTILINE)


@cache
def type_hashes() -> dict[str, str]:
    """Return the REP 2016 hash of each shipped type, by full name (``pkg/msg/Type``)."""
    hashes: dict[str, str] = json.loads((_DEFINITIONS / 'type_hashes.json').read_text('utf-8'))
    return hashes


def type_hash(interface: str) -> str:
    """Return the hash of one type, such as ``RIHS01_...``."""
    try:
        return type_hashes()[interface]
    except KeyError:
        known = ', '.join(type_hashes())
        raise ValueError(
            f'no definition of {quote(interface)} is shipped; known types: {known}'
        ) from None


@cache
def definition(interface: str) -> str:
    """
    Return the definition with its dependencies, as the ``ros2msg`` encoding requires.

    The dependencies follow depth first, in alphabetical order and once each, every one after a
    line of 80 equals signs and a line ``MSG: pkg/Type``: the order in which rosbag2 writes them.
    """
    seen: set[str] = set()

    def expand(name: str) -> str:
        type_hash(name)
        package, *below = f'{name}.msg'.split('/')
        text = _DEFINITIONS.joinpath(package, *below).read_text('utf-8')
        matches = _FIELD.finditer(text)
        for dependency in sorted({f'{m[1] or package + "/"}{m[2]}' for m in matches}):
            if dependency not in seen:
                seen.add(dependency)
                head = f'\n{_SEPARATOR}\nMSG: {dependency}\n'
                text += head + expand('/msg/'.join(dependency.split('/')))
        return text

    return expand(interface)


#: How rosbag2 writes an unlimited duration.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True)
class QosProfile:
    """
    Quality of service of a publisher, in the words of rosbag2's metadata version 9.

    Attributes
    ----------
    reliability : str
        ``'reliable'`` or ``'best_effort'``.
    durability : str
        ``'volatile'`` or ``'transient_local'`` (a latched topic).
    depth : int
        Length of the history kept (``keep_last``).
    """

    reliability: str = 'reliable'
    durability: str = 'volatile'
    depth: int = 10

    def as_mapping(self) -> dict[str, Any]:
        """Return the profile with all the fields that rosbag2 reads, in its order."""
        return {
            'history': 'keep_last',
            'depth': self.depth,
            'reliability': self.reliability,
            'durability': self.durability,
            'deadline': dict(_INFINITE),
            'lifespan': dict(_INFINITE),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(_INFINITE),
            'avoid_ros_namespace_conventions': False,
        }


#: The quality of service of a latched topic: a late subscriber gets the last message.
LATCHED = QosProfile(durability='transient_local', depth=1)


@dataclass(frozen=True)
class Topic:
    """
    A topic to record.

    Attributes
    ----------
    name : str
        Fully qualified: ``'/joint_states'``.
    type : str
        Full name of its type: ``'sensor_msgs/msg/JointState'``.
    qos : QosProfile
        Quality of service of the publisher; `ros2 bag play` offers the same.
    """

    name: str
    type: str
    qos: QosProfile = field(default_factory=QosProfile)

    def channel(self) -> Channel:
        """
        Return the topic as an MCAP file describes it.

        Raises
        ------
        ValueError
            If no definition of the type is shipped with this package.
        """
        return Channel(
            topic=self.name,
            type=self.type,
            schema=definition(self.type).encode(),
            metadata={
                'offered_qos_profiles': dump_yaml([self.qos.as_mapping()]),
                'topic_type_hash': type_hash(self.type),
            },
        )


@dataclass(frozen=True)
class Channel:
    """A topic with everything that a reader needs, also of a bag of another program."""

    #: Names of the topic and of its type.
    topic: str
    type: str
    schema: bytes  # definition of the type with its dependencies
    metadata: Mapping[str, str]  # metadata of the MCAP channel, as rosbag2 writes it
    #: Name in the MCAP registry of well-known encodings.
    schema_encoding: str = 'ros2msg'
    message_encoding: str = 'cdr'

    @property
    def type_hash(self) -> str:
        """The hash of the type (REP 2016); empty if unknown."""
        return self.metadata.get('topic_type_hash', '')

    @cached_property
    def qos_profiles(self) -> list[dict[str, Any]]:
        """The quality of service of each publisher; empty if not stated in the form of rosbag2."""
        try:
            profiles = load_yaml(self.metadata.get('offered_qos_profiles', ''))
        except yaml.YAMLError:
            return []
        if isinstance(profiles, list) and all(isinstance(p, dict) for p in profiles):
            return profiles
        return []


def full_type(name: str) -> str:
    """Return the full name of a type, which some recorders write without ``/msg/``."""
    package, _, rest = name.partition('/')
    return f'{package}/msg/{rest}' if rest and '/' not in rest else name


#: Characters of a YAML text of a bag. One of 500 topics and 5,000 files has some 2 million.
LONGEST_YAML = 8 * 1024 * 1024
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def load_yaml(text: str) -> Any:
    """Load a YAML text of a bag, by libyaml if PyYAML has it (ten times faster)."""
    if len(text) > LONGEST_YAML:
        raise yaml.YAMLError(f'it is {len(text)} characters long; at most {LONGEST_YAML} are read')
    try:
        return yaml.load(text, Loader=_LOADER)
    except yaml.YAMLError:
        raise
    except Exception as error:  # whatever a tag such as !!timestamp makes the constructor raise
        raise yaml.YAMLError(f'{type(error).__name__}: {error}') from error


def dump_yaml(value: object) -> str:
    """Return block-style YAML with the keys in the order given, without a final newline."""
    # No aliases: readers of metadata.yaml need not know them.
    text: str = yaml.dump(
        value, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True, width=2**20
    )
    return text.removesuffix('\n')


class _PlainDumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True
