"""Pieces of the report's page: text that is safe to show, lists and tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple
from unicodedata import category

#: Columns of a table that a phone has room for.
_NARROW_COLUMNS = 5
_TAG = re.compile('<[^>]*>')


class Html(str):
    """Text that is HTML already, and well-formed as XML; all other text is escaped."""

    __slots__ = ()


def _may_stand(character: str) -> bool:
    return character.isprintable() or category(character) == 'Zs' or character in '\n\t'


def safe(text: str) -> Html:
    """
    Return text as HTML.

    What comes from a recording may hold anything. Control characters, such as turn the direction
    of writing, and lone surrogates are shown as a replacement character.
    """
    if isinstance(text, Html):
        return text
    return Html(escape(''.join(c if _may_stand(c) else '\N{REPLACEMENT CHARACTER}' for c in text)))


def element(tag: str, *content: str, **attributes: str) -> Html:
    """Return an element of texts that are made `safe`; an attribute that is empty is left out."""
    given = ''.join(
        f' {name.rstrip("_").replace("_", "-")}="{safe(value)}"'
        for name, value in attributes.items()
        if value
    )
    return Html(f'<{tag}{given}>{"".join(map(safe, content))}</{tag}>')


def joined(*parts: str) -> Html:
    """Return texts, each made `safe`, joined."""
    return Html(''.join(map(safe, parts)))


def listed(entries: Iterable[str]) -> Html:
    """Return a list of texts."""
    return element('ul', *(element('li', entry) for entry in entries))


class Column(NamedTuple):
    """Head of a column of a table, and its kind: 'text', 'number', 'span' or 'bars'."""

    title: str
    kind: str = 'number'


def _row(cells: Sequence[str], columns: Sequence[Column], *, marked: bool) -> Html:
    head = element('th', cells[0], scope='row')
    pairs = zip(columns[1:], cells[1:], strict=True)
    rest = (element('td', cell, class_=column.kind) for column, cell in pairs)
    return element('tr', head, *rest, class_='changed' if marked else '')


def table(
    caption: str,
    columns: Sequence[Column],
    groups: Sequence[tuple[str, Sequence[Sequence[str]]]],
    *,
    note: str = '',
    marked: Iterable[str] = (),
) -> Html:
    """
    Return a table that scrolls by itself where the page is too narrow.

    The rows come in groups with titles, which may be empty. Rows whose first cell is among the
    `marked` ones are highlighted.
    """
    chosen = set(marked)
    bodies = []
    for title, rows in groups:
        lines = [_row(row, columns, marked=row[0] in chosen) for row in rows]
        if title and lines:
            span = str(len(columns))
            head = element('th', title, class_='group', scope='rowgroup', colspan=span)
            lines.insert(0, element('tr', head))
        if lines:
            bodies.append(element('tbody', *lines))
    heads = (
        element('th', title, scope='col', class_='' if kind == 'number' else 'text')
        for title, kind in columns
    )
    small = element('small', note) if note else ''
    whole = element(
        'table',
        element('caption', caption, small),
        element('thead', element('tr', *heads)),
        *bodies,
    )
    if len(columns) <= _NARROW_COLUMNS:
        return element('div', whole, class_='scroll')
    hint = element('p', f'{len(columns)} columns, scrolls sideways →', class_='hint')
    label = Html(_TAG.sub('', safe(caption)))
    scroll = {'class_': 'scroll', 'tabindex': '0', 'role': 'group', 'aria_label': label}
    return joined(hint, element('div', whole, **scroll))
