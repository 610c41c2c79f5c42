"""
The documents stay short, and begin with what their reader can do after them.

``PYTHONPATH=test python -m docs.test_prose`` prints the number of words of each page.
"""

import re

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
    return len(BLOCKS.sub('', page.read_text(encoding='utf-8')).split())


if __name__ == '__main__':
    counts = {page.relative_to(DOCS): words_of(page) for page in PAGES}
    for name, count in counts.items():
        print(f'{count:7,}  {name}')
    print(f'{sum(counts.values()):7,}')
