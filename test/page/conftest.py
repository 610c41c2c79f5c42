"""The page without installation, built once for all tests."""

import sys

import pytest
from running import SOURCE


@pytest.fixture(scope='session')
def site(tmp_path_factory):
    """Build it; return its folder."""
    if not (SOURCE / 'docs' / 'in_browser').is_dir():
        pytest.skip('the documentation is not here')
    sys.path.append(str(SOURCE / 'docs'))
    from in_browser.build import build

    place = tmp_path_factory.mktemp('site') / 'try'
    build(place)
    return place
