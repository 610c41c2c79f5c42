# SPDX-License-Identifier: Apache-2.0
"""
Documents of earlier formats, brought to the present one step by step.

A document is what JSON gives: numbers, texts, lists and mappings. Formats count from 1, that of
version 1.0. A later one comes with a function `upgraded_from_N`, which makes a document of format
N + 1 from one of format N, and with a test of it; so that every version reads the documents of all
earlier ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .quoting import quote

Document = dict[str, Any]
Upgrade = Callable[[Document], Document]

#: What format 2 of bags and sweeps adds to the parameters of a rig.
CONSTANT_RESTITUTION: Document = {'restitution_speed': 0.0, 'restitution_exponent': 0.25}


class FormatError(ValueError):
    """A document of a format that this version does not read."""


def newest(upgrades: Sequence[Upgrade]) -> int:
    """Return the format to which all upgrades lead."""
    return 1 + len(upgrades)


def upgrade(document: Document, number: object, upgrades: Sequence[Upgrade]) -> Document:
    """
    Return a document of the newest format from one of format `number`.

    Raises
    ------
    FormatError
        If there is no such format.
    """
    last = newest(upgrades)
    if type(number) is not int or not 1 <= number <= last:
        known = 'format 1' if last == 1 else f'formats 1 to {last}'
        raise FormatError(f'of format {quote(number)}; this version reads {known}')
    for upgrade in upgrades[number - 1 :]:
        document = upgrade(document)
    return document
