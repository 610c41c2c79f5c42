"""The container file and the issue forms agree with the package."""

import json
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import yaml
from running import DEADLINE_S
from setup_file import ROOT, setup_says


def instructions(name, kind):
    """Return the instructions of one kind in a Dockerfile."""
    text = (ROOT / 'docker' / name).read_text(encoding='utf-8').replace('\\\n', ' ')
    return re.findall(rf'^{kind} (.*)$', text, re.MULTILINE)


def test_installation_of_the_slim_image(tmp_path):
    """All but its base: pip installs the copied sources, and the command runs from there."""
    (install,), (command,) = (instructions('Dockerfile.slim', kind) for kind in ('RUN', 'CMD'))
    (asked,) = re.findall(r"'\.\[([a-z,]+)\]'", install)
    assert set(asked.split(',')) <= setup_says('extras_require').keys()
    ignored = (ROOT / '.dockerignore').read_text(encoding='utf-8').split()
    source, runs, place = tmp_path / 'src', tmp_path / 'runs', tmp_path / 'venv'
    patterns = shutil.ignore_patterns(*ignored, '_build', '*.egg-info', '.*_cache')
    shutil.copytree(ROOT, source, ignore=patterns)
    runs.mkdir()
    venv.create(place)
    # Its pip is that of here, which installs for the new environment.
    pip = place / 'bin' / 'pip'
    pip.write_text(f'#!/bin/sh\nexec {sys.executable} -m pip --python {place}/bin/python "$@"\n')
    pip.chmod(0o755)
    # What it needs is here already: nothing is fetched.
    own = Path(sysconfig.get_path('purelib', vars={'base': str(place)}))
    (own / 'here.pth').write_text(sysconfig.get_path('purelib'), encoding='utf-8')
    search = {'PATH': f'{place}/bin:/usr/bin:/bin', 'PIP_NO_INDEX': '1', 'HOME': str(tmp_path)}
    search |= {'PIP_NO_COMPILE': '1'}
    for line, where in ((install, source), (' '.join(json.loads(command)), runs)):
        done = subprocess.run(
            line,
            shell=True,
            cwd=where,
            env=search,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout
    assert len((runs / 'impacts.csv').read_text().splitlines()) > 500
    assert (place / 'bin' / 'rig_page').is_file()
    assert f'{sys.prefix}/' not in (place / 'bin' / 'rig_page').read_text()


def test_issue_forms_have_what_a_form_needs():
    for form in (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('*.yml'):
        stated = yaml.safe_load(form.read_text(encoding='utf-8'))
        assert stated.keys() >= {'name', 'description', 'body'}
        identifiers = [part['id'] for part in stated['body']]
        assert len(set(identifiers)) == len(identifiers)
        assert all(part['attributes']['label'] for part in stated['body'])
