"""Container files, pixi.toml and the issue forms agree with the package."""

import ast
import json
import re
import tomllib
from pathlib import Path

import yaml

from impact_damper_ros import entry_points

ROOT = Path(__file__).parents[2]


def keyword(name):
    """Return an argument of `setup()`."""
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    call = next(node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.keywords)
    return ast.literal_eval(next(k.value for k in call.keywords if k.arg == name))


def names(requirements):
    return {re.split(r'[<>=]', requirement)[0].lower() for requirement in requirements}


def test_pixi_has_what_the_package_needs():
    pixi = tomllib.loads((ROOT / 'pixi.toml').read_text(encoding='utf-8'))
    extras = keyword('extras_require')
    wanted = names(extras['ros']) | names(extras['page']) | names(extras['sweep'])
    assert wanted <= pixi['dependencies'].keys()
    for task in pixi['tasks'].values():
        assert task.split()[0] in entry_points.__all__


def test_images_install_extras_that_exist():
    extras = keyword('extras_require')
    slim = (ROOT / 'docker' / 'Dockerfile.slim').read_text(encoding='utf-8')
    (asked,) = re.findall(r"'\.\[([a-z,]+)\]'", slim)
    assert set(asked.split(',')) <= extras.keys()
    for name in ('Dockerfile', 'Dockerfile.slim'):
        text = (ROOT / 'docker' / name).read_text(encoding='utf-8')
        assert 'Not tried' in text
        (command,) = re.findall(r'^CMD (\[.*?\])$', text.replace('\\\n', ' '), re.M | re.S)
        assert set(json.loads(command)) & set(entry_points.__all__)


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
