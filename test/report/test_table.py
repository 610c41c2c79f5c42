"""Tables as text and Markdown, and numbers for readers."""

import math

import pytest

from impact_damper_ros.compare import Verdict
from impact_damper_ros.report.formatting import instant, number, quantity, unit_for
from impact_damper_ros.report.table import ColumnHead, Table

TABLE = Table.of_rows(('name', 'X [m]'), [('first', '0.5'), ('second one', '-12.25')])


def test_a_table_as_text_and_markdown():
    assert TABLE.text('  ').splitlines() == [
        '  name         X [m]',
        '  first          0.5',
        '  second one  -12.25',
    ]
    assert TABLE.markdown() == (
        '| name | X [m] |\n| --- | --- |\n| first | 0.5 |\n| second one | -12.25 |'
    )
    grouped = Table([ColumnHead('a', 'text')], [('one', [('x',)]), ('two', [('y',)])])
    assert grouped.text() == 'a\none\nx\ntwo\ny'


@pytest.mark.parametrize(
    ('shown', 'expected'),
    [
        (number(0.00012345678), '0.000123457'),
        (number(-1.5e-7, 3), '−1.5e−07'),
        (number(math.nan), '–'),
        (number(None), '–'),
        (number(math.inf), '∞'),
        (number(-0.0), '0'),
        (quantity(0.0032498, 'm', 3), '3.25 mm'),
        (quantity(2e-5, 'N s', 2), '20 µN s'),
        (instant(12.0), '12'),
        (instant(0.12345), '0.123'),
        (instant(-1e-5), '0'),
        (unit_for('m', [0.003, math.nan]), (1e3, 'mm')),
        (unit_for('m', []), (1.0, 'm')),
    ],
)
def test_numbers_for_readers(shown, expected):
    assert shown == expected


def test_groups_and_bars_as_text_and_markdown():
    """Groups have their titles; bars are for pages, and verdicts are words."""
    columns = [
        ColumnHead('', 'text'),
        ColumnHead('J'),
        ColumnHead('', 'bars'),
        ColumnHead('verdict', 'verdict'),
    ]
    groups = [
        ('Input', [('force', '9.5', '100', Verdict.AGREES)]),
        ('Output', []),
        ('', [('x', '1', '3', 'a|b')]),
    ]
    table = Table(columns, groups, 'Energy', 'Mean of 3.')
    assert table.text() == '         J  verdict\nInput\nforce  9.5  agrees\nx        1  a|b'
    assert table.text_with_note().splitlines()[0::5] == ['Energy', '  Mean of 3.']
    assert table.markdown().splitlines() == [
        '|  | J | verdict |',
        '| --- | --- | --- |',
        '| *Input* |  |  |',
        '| force | 9.5 | agrees |',
        '| x | 1 | a\\|b |',
    ]
