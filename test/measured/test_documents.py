"""The tables of the page on measured files; run as a program, this file writes them."""

import re
from pathlib import Path

import pytest

from impact_damper_ros.measured import formats, sheet, units

PAGE = Path(__file__).parents[2] / 'docs' / 'design' / 'measured_files.md'
QUANTITIES = ('TIME', 'DISPLACEMENT', 'VELOCITY', 'ACCELERATION', 'FORCE', 'BASE', 'IMPACT')
TABLES = {
    'formats': ('file', 'what is read', [(f'`{k}`', v) for k, v in formats.SHOWN.items()]),
    'units': ('SI unit', 'units that are read', [*units.SHOWN.items()]),
    'words': (
        'column',
        'one of these words is in its header',
        [
            (name.lower(), ', '.join(getattr(sheet, name).names))
            for name in (*QUANTITIES, 'FREQUENCY', 'LEVEL')
        ],
    ),
}


def filled(text):
    """Return a page with its tables."""
    for name, (left, right, rows) in TABLES.items():
        lines = [f'| {one} | {two} |' for one, two in ((left, right), ('---', '---'), *rows)]
        table = '\n'.join([f'<!-- {name} -->', *lines, '<!-- end -->'])
        text = re.sub(rf'<!-- {name} -->.*?<!-- end -->', lambda _, t=table: t, text, flags=re.S)
    return text


def test_the_page_has_the_tables():
    text = PAGE.read_text(encoding='utf-8')
    assert text == filled(text), f'run {__file__}'


@pytest.mark.parametrize('si', units.SHOWN)
def test_each_unit_that_is_listed_is_read(si):
    for group in re.split(r', (?![^(]*\))', units.SHOWN[si]):
        first, _, others = group.partition(' (')
        for unit in (first, *others.removesuffix(')').split(', ')):
            if unit:
                assert units.si_unit_of(unit)[0] == si


if __name__ == '__main__':
    PAGE.write_text(filled(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
