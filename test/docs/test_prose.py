"""
The documents stay short, begin with what their reader can do after them, and avoid some phrases.

``PYTHONPATH=test python -m docs.test_prose`` prints the number of words of each page.
"""

import ast
import re

import pytest
from docs.tutorial import ROOT

DOCS = ROOT / 'docs'
#: What is made of code: the Python library, the gallery, tables, help, samples, the glossary.
MADE = [
    *DOCS.glob('reference/python/*.md'),
    DOCS / 'results' / 'gallery' / 'index.md',
    DOCS / 'reference' / 'glossary.md',
]
BLOCKS = re.compile(
    r'^\| parameter \| unit (?:[^\n]*\n\|)+[^\n]*\n'
    r'|^## `\w+`\n\n```text\n.*?^```\n'
    r'|^### Quality of service, rates, frames\n.*?(?=^### Services)'
    r'|^<!-- \w+ -->.*?<!-- end -->',
    re.MULTILINE | re.DOTALL,
)
PAGES = [page for page in sorted(DOCS.rglob('*.md')) if page not in MADE]


def words_of(page):
    """Return how many words of a page are written by hand, code and tables included."""
    text = BLOCKS.sub('', page.read_text(encoding='utf-8'))
    # A bar of a table or a sign of a formula is no word.
    return sum(any(map(str.isalnum, word)) for word in text.split())


#: Most words of all pages.
MOST_WORDS = 36_000
CONTRIBUTING = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
WORDS = CONTRIBUTING[CONTRIBUTING.index('### Words') : CONTRIBUTING.index('## Tests')]
#: Phrases that are not to be used; 20 stands for any number.
PHRASES = re.findall(r'^\| (?!not|---)(.+?) \|', WORDS, re.MULTILINE)
_ANY = '|'.join(map(re.escape, PHRASES)).replace('20', r'\d[\d,.]*').replace(r'\ ', r'\s+')
PATTERN = re.compile(rf'(?<!\w)(?:{_ANY})(?!\w)', re.IGNORECASE)
#: Between the parts of a string
BREAK = re.compile(r"""['"]\s*\n\s*f?['"]""")


def prose_of(path):
    """Return what a file says: a document, the texts of a page, or the strings of a module."""
    text = path.read_text(encoding='utf-8')
    if path.suffix != '.py':
        return text.replace(WORDS, '')
    if not PATTERN.search(BREAK.sub('', text)):
        return ''
    return '\n'.join(
        node.value
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


STATIC = ROOT / 'impact_damper_ros' / 'page' / 'static'
PROSE = [
    *sorted(ROOT.glob('*.md')),
    *sorted((ROOT / 'benchmarks').glob('*.md')),
    *sorted(DOCS.rglob('*.md')),
    *sorted((ROOT / 'impact_damper_ros').rglob('*.py')),
    *sorted((ROOT / 'examples').rglob('*.py')),
    *sorted(STATIC.rglob('*.[jh]*')),
]


@pytest.mark.parametrize('path', PROSE, ids=lambda path: str(path.relative_to(ROOT)))
def test_phrases(path):
    found = [match[0] for match in PATTERN.finditer(prose_of(path))]
    assert not found, 'see Words in CONTRIBUTING.md'


def test_phrases_are_found():
    assert len(PHRASES) > 10
    for text in (
        'some 400 cycles',
        'Some 3.5 m',
        "those of one's own",
        'so that, i.e. here',
        'in\nturn',
    ):
        assert PATTERN.search(text), text
    for text in ('somewhat', 'in turns', 'some rigs', 'the folder'):
        assert not PATTERN.search(text), text


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_a_page_begins_with_what_its_reader_can_do(page):
    first = page.read_text(encoding='utf-8').split('\n\n')[1]
    assert first.startswith('After this page you ')


def test_the_documents_are_short():
    assert sum(map(words_of, PAGES)) <= MOST_WORDS


if __name__ == '__main__':
    counts = {page.relative_to(DOCS): words_of(page) for page in PAGES}
    for name, count in counts.items():
        print(f'{count:7,}  {name}')
    print(f'{sum(counts.values()):7,}')
