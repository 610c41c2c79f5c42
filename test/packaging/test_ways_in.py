"""Container files, pixi.toml and the issue forms agree with the package."""

import json
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import yaml
from setup_file import COMMANDS, ROOT, requirements, setup_says


def test_pixi_has_what_the_package_needs():
    pixi = tomllib.loads((ROOT / 'pixi.toml').read_text(encoding='utf-8'))
    extras = setup_says('extras_require')
    wanted = requirements(*(extras[name] for name in ('ros', 'page', 'sweep')))
    assert wanted <= pixi['dependencies'].keys()
    for task in pixi['tasks'].values():
        assert task.split()[0] in COMMANDS


def instructions(name, kind):
    """Return the instructions of one kind in a Dockerfile."""
    text = (ROOT / 'docker' / name).read_text(encoding='utf-8').replace('\\\n', ' ')
    return re.findall(rf'^{kind} (.*)$', text, re.MULTILINE)


def test_image_runs_the_node():
    """`ros2 run` in a workspace."""
    (command,) = instructions('Dockerfile', 'CMD')
    assert json.loads(command)[:4] == ['ros2', 'run', 'impact_damper_ros', 'sim_node']


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
    venv.create(place, with_pip=True)
    # What it needs is here already: nothing is fetched.
    own = Path(sysconfig.get_path('purelib', vars={'base': str(place)}))
    (own / 'here.pth').write_text(sysconfig.get_path('purelib'), encoding='utf-8')
    search = {'PATH': f'{place}/bin:/usr/bin:/bin', 'PIP_NO_INDEX': '1', 'HOME': str(tmp_path)}
    for line, where in ((install, source), (' '.join(json.loads(command)), runs)):
        done = subprocess.run(
            line,
            shell=True,
            cwd=where,
            env=search,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, done.stdout
    assert len((runs / 'impacts.csv').read_text().splitlines()) > 500
    assert (place / 'bin' / 'rig_page').is_file()
    assert f'{sys.prefix}/' not in (place / 'bin' / 'rig_page').read_text()


def test_devcontainer_makes_a_target():
    settings = json.loads((ROOT / '.devcontainer/devcontainer.json').read_text(encoding='utf-8'))
    target = settings['postCreateCommand'].removeprefix('make ')
    assert re.search(rf'^{target}:', (ROOT / 'Makefile').read_text(encoding='utf-8'), re.M)


def test_issue_forms_have_what_a_form_needs():
    for form in (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('*.yml'):
        stated = yaml.safe_load(form.read_text(encoding='utf-8'))
        assert stated.keys() >= {'name', 'description', 'body'}
        identifiers = [part['id'] for part in stated['body']]
        assert len(set(identifiers)) == len(identifiers)
        assert all(part['attributes']['label'] for part in stated['body'])
