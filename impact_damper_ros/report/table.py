# SPDX-License-Identifier: Apache-2.0
"""Tables: columns and rows in groups, as text, Markdown and, by the report's template, HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple


class Column(NamedTuple):
    """Head of a column, and its kind: 'number', 'text', 'span', 'verdict' or 'bars'."""

    title: str
    kind: str = 'number'


@dataclass(frozen=True)
class Table:
    """Groups of rows, each with a title, which may be empty."""

    columns: Sequence[Column]
    #: A cell is a text; in HTML a verdict or the length of a bar in per cent, where the kind of
    #: its column says so.
    groups: Sequence[tuple[str, Sequence[Sequence[Any]]]]
    caption: str = ''  # what it shows
    note: str = ''  # how to read it
    links: Mapping[str, str] = field(default_factory=dict)  # of first cells, in HTML

    @classmethod
    def of_rows(cls, head: Sequence[str], rows: Iterable[Sequence[Any]], texts: int = 1) -> Table:
        """Return a table of one group, its first columns texts."""
        kinds = ['text' if i < texts else 'number' for i in range(len(head))]
        columns = [Column(*pair) for pair in zip(head, kinds, strict=True)]
        return cls(columns, [('', list(rows))])

    @property
    def _lines(self) -> list[list[str]]:
        rows = [row for _, rows in self.groups for row in rows]
        return [[column.title for column in self.columns], *(list(map(str, r)) for r in rows)]

    def text(self, indent: str = '') -> str:
        """Return it as text: numbers to the right."""
        widths = [max(map(len, cells)) for cells in zip(*self._lines, strict=True)]

        def line(cells: Sequence[str]) -> str:
            parts = zip(cells, widths, self.columns, strict=True)
            aligned = (
                cell.rjust(width) if column.kind == 'number' else cell.ljust(width)
                for cell, width, column in parts
            )
            return (indent + '  '.join(aligned)).rstrip()

        return '\n'.join(map(line, self._lines))

    def markdown(self) -> str:
        """Return it in Markdown, without an end of line after the last row."""
        head, *rows = ([cell.replace('|', '\\|') for cell in line] for line in self._lines)
        lines = [head, ['---'] * len(head), *rows]
        return '\n'.join(f'| {" | ".join(line)} |' for line in lines)
