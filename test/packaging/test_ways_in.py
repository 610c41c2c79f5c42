"""The issue forms are what their host reads, and ask for what the package says of itself."""

import platform
import subprocess
import sys
from pathlib import Path

import numpy
import yaml

from impact_damper_ros import __version__
from impact_damper_ros.bag.snapshots import mathematics
from impact_damper_ros.parameters.upgrades import newest
from impact_damper_ros.rig.snapshot import ARITHMETIC, UPGRADES
from impact_damper_ros.sweep.grid import UPGRADES as SWEEP_UPGRADES

ROOT = Path(__file__).parents[2]


def test_issue_forms_have_what_a_form_needs():
    for form in (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('*.yml'):
        stated = yaml.safe_load(form.read_text(encoding='utf-8'))
        assert stated.keys() >= {'name', 'description', 'body'}
        identifiers = [part['id'] for part in stated['body']]
        assert len(set(identifiers)) == len(identifiers)
        assert all(part['attributes']['label'] for part in stated['body'])


def test_what_a_report_of_a_bug_needs():
    """The form asks for what the package prints of itself."""
    (form,) = (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('bug.yml')
    assert '`python -m impact_damper_ros --version`' in form.read_text(encoding='utf-8')
    words = [sys.executable, '-W', 'error', '-m', 'impact_damper_ros']
    asked, helped = (
        subprocess.run([*words, option], capture_output=True, text=True, check=True)
        for option in ('--version', '--help')
    )
    assert (asked.stderr, helped.stderr) == ('', '')
    lines = asked.stdout.splitlines()
    assert lines[0].startswith(f'impact_damper_ros {__version__} in ')
    assert lines[1].startswith(f'Python {platform.python_version()} ')
    assert f'numpy: {numpy.__version__}' in lines
    assert any(line.startswith('ROS 2: ') for line in lines)
    assert lines[-1] == (
        f'formats: bags {newest(UPGRADES)}, sweeps {newest(SWEEP_UPGRADES)}; arithmetic '
        f'{ARITHMETIC}; mathematical functions {mathematics()}'
    )
    assert '--version' in helped.stdout
