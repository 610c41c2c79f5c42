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


def luminance(colour):
    """Return the relative luminance of a colour, as WCAG 2 defines it."""
    parts = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_words_in_pictures_are_read_in_both_colours():
    """They are in a canvas, where axe-core does not see them."""
    style = (STATIC / 'style.css').read_text(encoding='utf-8')
    blocks = re.findall(r':root \{(.*?)\n\}', style, re.S)[:2]
    for block, scheme in zip(blocks, ('light', 'dark'), strict=True):
        assert f'color-scheme: {scheme}' in block
        colours = dict(re.findall(r'--([\w-]+): (#[0-9a-f]{6})', block))
        words = {'quiet', 'link', 'good'}
        for path in MODULES:
            words |= set(re.findall(r'colour: colours\.(\w+)', path.read_text(encoding='utf-8')))
        assert {'primary', 'force', 'special'} <= words
        for name in words:
            for ground in ('page', 'panel'):
                assert contrast(colours[name], colours[ground]) >= 4.5, (scheme, name)
        # The letter on m
        assert contrast('#000000', colours['damper']) >= 4.5


def test_every_module_and_word_is_there():
    for path in MODULES:
        text = path.read_text(encoding='utf-8')
        for other in re.findall(r"^import .* from '(\.[\w./]+)'", text, re.M):
            assert (path.parent / other).resolve() in MODULES, other
    page = (STATIC / 'index.html').read_text(encoding='utf-8')
    terms = re.findall(r'<dt id="term-([\w-]+)">', page)
    assert set(re.findall(r'data-term="([\w-]+)"', page)) <= set(terms)
    assert len(set(terms)) == len(terms) > 30
