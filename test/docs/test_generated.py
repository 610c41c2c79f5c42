"""What the documentation has of the code is what the code says."""

import re
import runpy
import sys
from pathlib import Path

import pytest

import impact_damper_ros

DOCS = Path(impact_damper_ros.__file__).parents[1] / 'docs'


@pytest.mark.skipif(sys.version_info >= (3, 13), reason='argparse words its help otherwise')
def test_generated_parts_are_current(monkeypatch):
    pytest.importorskip('numpydoc')
    monkeypatch.setenv('COLUMNS', '')
    pages = runpy.run_path(str(DOCS / 'generated.py'))['pages']()
    assert len(pages) > 10
    for path, text in pages.items():
        assert path.read_text(encoding='utf-8') == text, f'{path}: run python docs/generated.py'


def test_every_public_name_has_an_entry():
    pages = [path.read_text(encoding='utf-8') for path in DOCS.glob('reference/python/*.md')]
    # Types of rows are named in a sentence.
    names = {*impact_damper_ros.__all__} - {'__version__', 'EVENT_TYPE', 'SAMPLE_TYPE'}
    assert len(names) > 40
    for name in names:
        assert any(f'\n## `{name}`\n' in text for text in pages), name


def test_every_figure_of_the_gallery_is_there():
    page = (DOCS / 'results' / 'gallery' / 'index.md').read_text(encoding='utf-8')
    pictures = {path.name for path in (DOCS / 'results' / 'gallery').glob('*.png')}
    assert pictures == set(re.findall(r'^!\[.*\]\((\S+)\)$', page, re.MULTILINE))
