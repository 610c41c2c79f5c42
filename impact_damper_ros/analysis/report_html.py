"""Pieces of the report's page: text that is safe to show, tables, lists."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple
from unicodedata import category

__all__ = ['Column', 'Html', 'listed', 'safe', 'table']


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


class Column(NamedTuple):
    """
    A column of a table.

    Attributes
    ----------
    title : str
        Its head.
    kind : str
        'text', 'number' or 'bars'.
    """

    title: str
    kind: str = 'number'


def _cell(tag: str, content: str, **attributes: str) -> str:
    given = ''.join(f' {name}="{value}"' for name, value in attributes.items() if value)
    return f'<{tag}{given}>{safe(content)}</{tag}>'


def _row(cells: Sequence[str], columns: Sequence[Column], *, marked: bool) -> str:
    head = _cell('th', cells[0], scope='row')
    pairs = zip(columns[1:], cells[1:], strict=True)
    rest = ''.join(_cell('td', cell, **{'class': column.kind}) for column, cell in pairs)
    return f'<tr class="changed">{head}{rest}</tr>' if marked else f'<tr>{head}{rest}</tr>'


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

    Parameters
    ----------
    caption : str
        What it is.
    columns : sequence of Column
        Its columns; the first is the head of the rows.
    groups : sequence of (str, sequence of rows)
        Rows under a head of their own, if that is not empty.
    note : str, optional
        A line below the caption.
    marked : iterable of str, optional
        Rows to highlight, by their first cell.
    """
    kinds = ['' if column.kind == 'number' else 'text' for column in columns]
    heads = [
        _cell('th', column.title, scope='col', **{'class': kind})
        for column, kind in zip(columns, kinds, strict=True)
    ]
    chosen = set(marked)
    bodies = []
    for title, rows in groups:
        lines = [_row(row, columns, marked=row[0] in chosen) for row in rows]
        if title and lines:
            place = {'class': 'group', 'scope': 'rowgroup', 'colspan': str(len(columns))}
            lines.insert(0, f'<tr>{_cell("th", title, **place)}</tr>')
        if lines:
            bodies.append(f'<tbody>{"".join(lines)}</tbody>')
    small = f'<small>{safe(note)}</small>' if note else ''
    hint, focus = '', ''
    if len(columns) > _NARROW_COLUMNS:
        hint = f'<p class="hint">{len(columns)} columns, scrolls sideways →</p>'
        focus = f' tabindex="0" role="group" aria-label="{_TAG.sub("", safe(caption))}"'
    return Html(
        f'{hint}<div class="scroll"{focus}><table><caption>{safe(caption)}{small}</caption>'
        f'<thead><tr>{"".join(heads)}</tr></thead>{"".join(bodies)}</table></div>'
    )


def listed(entries: Iterable[str]) -> Html:
    """Return a list of texts."""
    return Html(f'<ul>{"".join(f"<li>{safe(entry)}</li>" for entry in entries)}</ul>')
