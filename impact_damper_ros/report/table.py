# SPDX-License-Identifier: Apache-2.0
"""Tables: columns and rows in groups, as text, Markdown and, by the report's template, HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple


class ColumnHead(NamedTuple):
    """Head of a column, and its kind: 'number', 'text', 'span', 'verdict' or 'bars'."""

    title: str
    kind: str = 'number'


@dataclass(frozen=True)
class Table:
    """Groups of rows, each with a title, which may be empty."""

    columns: Sequence[ColumnHead]
    #: A cell is a text; a column of that kind has verdicts, or lengths of bars in per cent, in
    #: HTML.
    groups: Sequence[tuple[str, Sequence[Sequence[Any]]]]
    caption: str = ''  # what the table shows
    note: str = ''  # how to read the table
    links: Mapping[str, str] = field(default_factory=dict)  # classes of first cells, in HTML

    @classmethod
    def of_rows(
        cls,
        head: Sequence[str],
        rows: Iterable[Sequence[Any]],
        texts: int = 1,
        caption: str = '',
        note: str = '',
    ) -> Table:
        """Return a table of one group, its first columns texts."""
        columns = [
            ColumnHead(title, 'text' if i < texts else 'number') for i, title in enumerate(head)
        ]
        return cls(columns, [('', list(rows))], caption, note)

    @classmethod
    def of_columns(
        cls,
        columns: Mapping[str, Iterable[Any]],
        texts: int = 1,
        caption: str = '',
        note: str = '',
    ) -> Table:
        """Return a table of one group by its columns, the first ones texts."""
        return cls.of_rows([*columns], zip(*columns.values(), strict=True), texts, caption, note)

    def _cell_texts(self, cells: Iterable[Any]) -> list[str]:
        """Return the texts of cells; bars have none."""
        pairs = zip(cells, self.columns, strict=True)
        return [str(getattr(c, 'value', c)) for c, column in pairs if column.kind != 'bars']

    @property
    def _head(self) -> list[str]:
        return self._cell_texts(column.title for column in self.columns)

    def _groups(self) -> Iterator[tuple[str, list[list[str]]]]:
        """Yield the groups that have rows, as texts."""
        for title, rows in self.groups:
            if rows:
                yield title, [self._cell_texts(row) for row in rows]

    def text(self, indent: str = '') -> str:
        """Return the table as text: numbers to the right."""
        groups = list(self._groups())
        lines = [self._head, *(row for _, rows in groups for row in rows)]
        widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
        numbers = [column.kind == 'number' for column in self.columns if column.kind != 'bars']

        def line(cells: Sequence[str]) -> str:
            parts = zip(cells, widths, numbers, strict=True)
            aligned = (c.rjust(width) if right else c.ljust(width) for c, width, right in parts)
            return (indent + '  '.join(aligned)).rstrip()

        found = [line(self._head)]
        for title, rows in groups:
            found += [f'{indent}{title}'] * bool(title) + list(map(line, rows))
        return '\n'.join(found)

    def text_with_note(self, indent: str = '') -> str:
        """Return the table as text, between its caption and its note."""
        note = textwrap.wrap(self.note, 99 - len(indent), break_long_words=False)
        lines = [f'{indent}{self.caption}', self.text(f'{indent}  ')]
        return '\n'.join([*lines, *(f'{indent}  {line}' for line in note)])

    def markdown(self) -> str:
        """Return the table in Markdown, without an end of line after the last row."""
        head, *more = (
            [c.replace('|', '\\|') for c in line] for line in [self._head, *self._rows()]
        )
        lines = [head, ['---'] * len(head), *more]
        return '\n'.join(f'| {" | ".join(line)} |' for line in lines)

    def _rows(self) -> Iterator[list[str]]:
        for title, rows in self._groups():
            if title:
                yield [f'*{title}*', *[''] * (len(self._head) - 1)]
            yield from rows
