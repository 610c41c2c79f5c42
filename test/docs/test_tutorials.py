"""
Every tutorial runs from its first line to its last, and prints what its page shows.

``PYTHONPATH=.:test python -m docs.test_tutorials best_gap`` also puts the pictures that a page
makes beside it.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import pytest
import yaml
from docs.tutorial import ROOT, Reader, agrees, differences, pictures

from impact_damper_ros.rig import GapControlParameters, RigParameters

TUTORIALS = ROOT / 'docs' / 'tutorials'
PAGES = [*sorted(TUTORIALS.glob('*.md')), ROOT / 'docs' / 'start' / 'first_ten_minutes.md']


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_page(page, tmp_path):
    for extra in ('matplotlib', 'mcap_ros2', 'pandas', 'rclpy', 'tornado'):
        pytest.importorskip(extra)
    Reader(page, tmp_path).read()
    for name in pictures(page):
        assert (tmp_path / name).stat().st_size > 1000
        assert page.with_name(name).is_file()


if __name__ == '__main__':
    for name in sys.argv[1:]:
        page = next(page for page in PAGES if page.stem == name)
        with tempfile.TemporaryDirectory() as place:
            Reader(page, Path(place)).read()
            for picture in pictures(page):
                shutil.copy(Path(place) / picture, page.with_name(picture))
