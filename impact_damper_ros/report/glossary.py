"""The terms of a report that need an explanation, linked from where they stand."""

from __future__ import annotations

import re
from configparser import ConfigParser
from importlib.resources import files
from typing import NamedTuple

from .formatting import worded
from .html import Html, element, joined


class Term(NamedTuple):
    """A term of the field: the end of its id in the page, and a pattern of words linked to it."""

    key: str
    name: str
    sentence: str
    words: str


def _read_terms() -> tuple[Term, ...]:
    file = ConfigParser(interpolation=None)
    file.read_string(
        (files('impact_damper_ros.report') / 'template' / 'glossary.ini').read_text('utf-8')
    )
    return tuple(
        Term(
            entry.get('key', name.lower().replace(' ', '-').replace('é', 'e')),
            name,
            entry['means'].replace('\n', ' '),
            entry.get('words', re.escape(name.lower())),
        )
        for name, entry in file.items()
        if name != file.default_section
    )


TERMS = _read_terms()

_BY_KEY = {term.key: term for term in TERMS}
_PATTERN = re.compile(
    '|'.join(
        f'(?P<{term.key.replace("-", "_")}>(?<![\\w-])(?:{term.words})(?![\\w-]))'
        for term in sorted(TERMS, key=lambda term: -len(term.words))
    ),
    re.IGNORECASE,
)


def linked(text: str) -> Html:
    """Return a text with the first use of each of its terms linked to the glossary."""
    if isinstance(text, Html):
        return text
    text = worded(text)
    parts: list[str] = []
    seen: set[str] = set()
    done = 0
    for match in _PATTERN.finditer(text):
        key = (match.lastgroup or '').replace('_', '-')
        if key in seen:
            continue
        seen.add(key)
        parts.append(text[done : match.start()])
        title = worded(_BY_KEY[key].sentence)
        parts.append(element('a', match[0], class_='term', href=f'#term-{key}', title=title))
        done = match.end()
    return joined(*parts, text[done:])


def glossary_html() -> Html:
    """Return the glossary, folded; a link to a term unfolds it."""
    rows = (
        joined(
            element('dt', term.name, id=f'term-{term.key}'),
            element('dd', worded(term.sentence)),
        )
        for term in sorted(TERMS, key=lambda term: term.name.lower())
    )
    return element(
        'section',
        element('h2', 'Glossary', id='glossary'),
        element(
            'details',
            element('summary', 'What the underlined words mean'),
            element('dl', *rows),
            class_='glossary',
        ),
        aria_labelledby='glossary',
    )
