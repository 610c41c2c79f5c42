"""
Figures as inline SVG of the report's page.

The SVG of matplotlib is a document of its own. Several of them in one page would share their ids,
and their colours would not follow a dark scheme; here a figure becomes a part of the page.
"""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from .drawing import COLORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SVG = '{http://www.w3.org/2000/svg}'
_LINK = '{http://www.w3.org/1999/xlink}href'
_VARIABLE = {color: f'var(--{name})' for name, color in COLORS.items()}
_COLOR = re.compile('|'.join(COLORS.values()))
_NUMBER = re.compile(r'-?\d+\.\d+')
_REFERENCE = re.compile(r'url\(#([^)]+)\)')
_NO_ROTATION = re.compile(r'rotate\(-?0(\.0)? [^)]*\)')
# The page's own font is used. Older matplotlib writes `font: 9px 'A', ...`, newer `font-family:`.
_FONT = re.compile(r"font-family:[^;]*|font:\s*(?P<size>[\d.]+px)\s*'[^;]*")
_NUMERIC = ('d', 'x', 'y', 'width', 'height', 'transform', 'viewBox')


def _rounded(match: re.Match[str]) -> str:
    """Return a number with two decimals at most, without trailing zeros."""
    text = f'{float(match[0]):.2f}'.rstrip('0').rstrip('.')
    return '0' if text in ('-0', '') else text


def _without_document(root: ElementTree.Element) -> None:
    """Remove what belongs to a file of its own, and the names of namespaces."""
    for parent in root.iter():
        for child in list(parent):
            if child.tag in (f'{_SVG}metadata', f'{_SVG}style'):
                parent.remove(child)
    for element in root.iter():
        element.tag = element.tag.rpartition('}')[2]
        if _LINK in element.attrib:
            element.set('href', element.attrib.pop(_LINK).replace('\n', ''))
        element.text = (element.text or '').strip() or None
        element.tail = None
    for name in ('width', 'height', 'version'):
        root.attrib.pop(name, None)


def _own_ids(root: ElementTree.Element, key: str) -> None:
    """Keep the ids that something refers to, and make them the figure's own."""
    wanted: set[str] = set()
    for element in root.iter():
        link = element.get('href', '')
        if link.startswith('#'):
            wanted.add(link[1:])
        for value in element.attrib.values():
            wanted.update(_REFERENCE.findall(value))
    names: dict[str, str] = {}
    for element in root.iter():
        name = element.attrib.pop('id', None)
        if name in wanted and name not in names:
            names[name] = f'{key}-{len(names)}'
            element.set('id', names[name])
    for element in root.iter():
        for attribute, value in element.attrib.items():
            if attribute == 'href' and value.startswith('#'):
                element.set(attribute, f'#{names[value[1:]]}')
            elif 'url(#' in value:
                element.set(attribute, _REFERENCE.sub(lambda m: f'url(#{names[m[1]]})', value))


def _short(hundredths: int) -> str:
    """Return the shortest form of a number."""
    sign, size = '-' if hundredths < 0 else '', abs(hundredths)
    tail = f'.{size % 100:02d}'.rstrip('0').rstrip('.')
    return f'{sign}{size // 100 or ("" if tail else 0)}{tail}'


def _short_path(path: str) -> str:
    """Return a path of lines with its points counted from one another."""
    if not set('MLz') >= {c for c in path if c.isalpha()}:
        return path
    words: list[str] = []
    x = y = 0
    tokens = iter(path.split())
    for command in tokens:
        if command == 'z':
            words.append('z')
            continue
        to_x, to_y = (round(100.0 * float(next(tokens))) for _ in range(2))
        if command == 'M':
            words.append(f'M{_short(to_x)} {_short(to_y)}l')
        else:
            step = f'{_short(to_x - x)} {_short(to_y - y)}'.replace(' -', '-')
            words.append(step if words[-1][-1] == 'l' or step[0] == '-' else f' {step}')
        x, y = to_x, to_y
    return ''.join(words).replace('lz', 'z').replace('lM', 'M').removesuffix('l')


def _set(element: ElementTree.Element, name: str, value: str) -> None:
    if value:
        element.set(name, value)
    else:
        element.attrib.pop(name, None)


def _slim(root: ElementTree.Element) -> None:
    """Shorten numbers and styles."""
    for element in root.iter():
        for name in _NUMERIC:
            if name in element.attrib:
                value = _NO_ROTATION.sub('', element.attrib[name])
                value = ' '.join(_NUMBER.sub(_rounded, value).split())
                _set(element, name, _short_path(value) if name == 'd' else value)
        style = element.get('style')
        if style is not None:
            style = _FONT.sub(lambda m: f'font-size: {m["size"]}' if m['size'] else '', style)
            style = _COLOR.sub(lambda m: _VARIABLE[m[0]], style)
            parts = [part.strip().replace(': ', ':') for part in style.split(';')]
            _set(element, 'style', ';'.join(part for part in parts if part))
    for group in root.iter('g'):
        styles = {child.get('style') for child in group if child.tag == 'use'}
        alike = len(styles) == 1 and all(child.tag == 'use' for child in group)
        if alike and len(group) > 1 and 'style' not in group.attrib:
            _set(group, 'style', styles.pop() or '')
            for mark in group:
                mark.attrib.pop('style', None)


def _prune(parent: ElementTree.Element) -> None:
    """Remove elements that draw nothing, and groups without attributes."""
    kept: list[ElementTree.Element] = []
    for child in parent:
        _prune(child)
        invisible = child.tag == 'path' and child.get('style') == 'fill:none'
        empty = child.tag in ('defs', 'g') and not len(child)
        if child.tag == 'g' and not child.attrib:
            kept.extend(child)
        elif not invisible and not empty:
            kept.append(child)
    parent[:] = kept


def inline_svg(figure: Figure, key: str, label: str) -> str:
    """Return a figure as an element of an HTML page."""
    content = io.BytesIO()
    nothing = dict.fromkeys(('Date', 'Creator', 'Format', 'Type'))
    figure.savefig(content, format='svg', metadata=nothing, dpi=144)
    root = ElementTree.fromstring(content.getvalue())
    _without_document(root)
    _own_ids(root, key)
    _slim(root)
    _prune(root)
    root.attrib.update({'class': 'plot', 'role': 'img', 'aria-label': label})
    return ElementTree.tostring(root, encoding='unicode')
