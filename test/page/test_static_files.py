"""The files of the page hold only what its security policy allows."""

import re
from pathlib import Path

import pytest

import impact_damper_ros

STATIC = Path(impact_damper_ros.__file__).parent / 'page' / 'static'
MODULES = sorted(STATIC.rglob('*.js'))


def test_the_page_has_nothing_inline():
    text = (STATIC / 'index.html').read_text(encoding='utf-8')
    assert not re.search(r'\s(style|on\w+)\s*=', text)
    assert '<style' not in text
    assert all('src=' in tag for tag in re.findall(r'<script[^>]*>', text))


def test_everything_is_loaded_from_here():
    for path in (STATIC / 'index.html', STATIC / 'style.css', *MODULES):
        text = path.read_text(encoding='utf-8').replace('http://www.w3.org/2000/svg', '')
        assert not re.search(r'(https?:)?//[a-z0-9-]+\.[a-z]{2,}', text), path.name


@pytest.mark.parametrize('path', MODULES, ids=lambda path: path.name)
def test_no_text_becomes_markup(path):
    text = path.read_text(encoding='utf-8')
    for word in ('innerHTML', 'outerHTML', 'insertAdjacentHTML', 'document.write', 'eval('):
        assert word not in text
    assert not re.search(r"setAttribute\('(style|on\w+)'", text)


def test_every_module_and_word_is_there():
    for path in MODULES:
        text = path.read_text(encoding='utf-8')
        for other in re.findall(r"^import .* from '(\.[\w./]+)'", text, re.M):
            assert (path.parent / other).resolve() in MODULES, other
    page = (STATIC / 'index.html').read_text(encoding='utf-8')
    terms = re.findall(r'<dt id="term-([\w-]+)">', page)
    assert set(re.findall(r'data-term="([\w-]+)"', page)) <= set(terms)
    assert len(set(terms)) == len(terms) > 30
