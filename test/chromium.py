"""Chromium without a window: where it is, and how the tests and pictures start it."""

import os
import shutil

import pytest

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--disable-sync',
    '--disable-background-networking',
    '--disable-component-update',
    '--hide-scrollbars',
    '--no-first-run',
)
MISSING = 'no Chromium here; on Debian or Ubuntu: apt install chromium'


def found():
    """Return the path of a Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def needed():
    """Return the path of a Chromium; a test without one is skipped, except where it must run."""
    path = found()
    if path is None:
        if os.environ.get('CI') == 'true':
            pytest.fail(MISSING)
        pytest.skip(MISSING)
    return path


def command(path, profile, *options):
    """Return the command of a browser that has never been used; `profile` is its own directory."""
    return [path, *FLAGS, f'--user-data-dir={profile}', *options]
