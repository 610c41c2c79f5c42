"""
Every tutorial runs from its first line to its last, and prints what its page shows.

``PYTHONPATH=.:test python -m docs.test_tutorials best_gap`` also puts the pictures that a page
makes beside it.
"""

import re
import shutil
import sys
import tempfile
from pathlib import Path

import pytest
import yaml
from docs.tutorial import PAGES, ROOT, Reader, differences, pictures

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    Rig,
    RigParameters,
    load_parameters,
    settle,
)

PAGE = ROOT / 'impact_damper_ros' / 'page'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_page(page, tmp_path):
    for extra in ('matplotlib', 'mcap_ros2', 'pandas', 'rclpy', 'tornado'):
        pytest.importorskip(extra)
    Reader(page, tmp_path).read()
    for name in pictures(page):
        assert (tmp_path / name).stat().st_size > 1000
        assert page.with_name(name).is_file()


def test_readme(tmp_path):
    """From the first command that needs no ROS on: the set-up before it is a newcomer's."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    copy = tmp_path / 'README.md'
    copy.write_text(text[text.index('## Record and analyse') :], encoding='utf-8')
    Reader(copy, tmp_path).read()


@pytest.mark.parametrize('line', ['mass_ratio = 0.02', 'mass_ratio = 0.1', 'restitution = 0.3'])
def test_best_gap_of_another_structure(line, tmp_path):
    """Numbers at the top of the page are the reader's own; those below then are others, too."""
    page = ROOT / 'docs' / 'design' / 'best_gap.md'
    name = line.partition(' =')[0]
    text = re.sub(rf'^{name} = [0-9.]+', line, page.read_text(encoding='utf-8'), flags=re.M)
    text = re.sub(r'^```(text|bash)\n.*?^```$', '', text, flags=re.M | re.S)
    copy = tmp_path / page.name
    copy.write_text(text, encoding='utf-8')
    reader = Reader(copy, tmp_path)
    reader.read()
    assert reader.names['reached'].x_max < 0.9 * reader.names['without']
    assert line in text


@pytest.mark.parametrize(
    ('changes', 'x_max', 'repeats'),
    [
        ({}, '3.2 mm', True),
        ({'gap': 0.012}, '7.5 mm', False),
        ({'gap': 0.027}, '2.7 mm', True),
        ({'force_amplitudes': 2.4}, '15 mm', False),
        ({'force_amplitudes': 2.4, 'gap': 0.048}, '6.3 mm', True),
    ],
)
def test_numbers_of_the_lecture(changes, x_max, repeats):
    text = (ROOT / 'docs' / 'lecture.md').read_text(encoding='utf-8')
    assert x_max in ' '.join(text.split())
    found = settle(Rig(load_parameters('bench_rig')[0].replace(**changes), compiled=None))
    assert f'{1e3 * found.x_max:.{x_max.count(".")}f} mm' == x_max
    assert bool(found.period) is repeats


def test_links_to_the_page_are_rigs():
    """A link holds a preset, parameters in their range, and settings of the view."""
    presets = yaml.safe_load((PAGE / 'presets.yaml').read_text(encoding='utf-8'))
    view = re.search(r'VIEW = \[(.*)\]', (PAGE / 'static' / 'address.js').read_text())[1]
    text = (ROOT / 'docs' / 'lecture.md').read_text(encoding='utf-8')
    links = re.findall(r'http://127.0.0.1:8088/#([^)\s]+)\)', text)
    assert len(links) > 8
    for link in links:
        given = dict(part.split('=', 1) for part in link.split('&'))
        preset = presets[given.pop('preset')].get('parameters', {})
        own = {name: value for name, value in given.items() if f"'{name}'" not in view}
        values = {**preset, **{name: yaml.safe_load(value) for name, value in own.items()}}
        for record in (RigParameters, GapControlParameters, InitialConditions):
            known = record().as_dict()
            record(**{name: values.pop(name) for name in list(values) if name in known})
        assert not values


@pytest.mark.parametrize(
    ('shown', 'printed', 'same'),
    [
        ('x 1.80 mm', 'x 1.81 mm', True),
        ('x 1.80 mm', 'x 1.82 mm', False),
        ('12 impacts', '13 impacts', False),
        ('x 1e-3, y', 'x  1.9e-3, y', True),
        ('...\nb 2', 'a 1\nb 2\nc 3', True),
        ('b 2', 'a 1\nb 2', False),
        ('a ...\nb', 'a 5 %\nb', True),
        ('a\nb', 'a', False),
    ],
)
def test_what_counts_as_the_same(shown, printed, same):
    assert (not differences(shown, printed)) is same


if __name__ == '__main__':
    for name in sys.argv[1:]:
        page = next(page for page in PAGES if page.stem == name)
        with tempfile.TemporaryDirectory() as place:
            Reader(page, Path(place)).read()
            for picture in pictures(page):
                shutil.copy(Path(place) / picture, page.with_name(picture))
