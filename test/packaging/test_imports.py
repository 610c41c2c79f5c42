"""Scripts that no test runs import what there is."""

import ast
from functools import cache
from pathlib import Path

import pytest
from running import SOURCE

#: Where Python finds modules of this project: the folder of a script, and these.
PLACES = (SOURCE, SOURCE / 'test', SOURCE / 'docs', SOURCE / 'benchmarks')
SCRIPTS = sorted(
    path
    for folder in ('docs', 'benchmarks', 'examples')
    for path in (SOURCE / folder).rglob('*.py')
    if '_build' not in path.parts
)


def module_file(name, script):
    """Return the file of a module of this project; None of another one."""
    for place in (script.parent, *PLACES):
        path = place.joinpath(*name.split('.'))
        for file in (path.with_suffix('.py'), path / '__init__.py'):
            if file.is_file():
                return file
    return None


@cache
def defined(file):
    """Return the names at the top of a module, and its submodules."""
    names = {path.stem for path in file.parent.iterdir()} if file.stem == '__init__' else set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name.split('.')[0] for alias in node.names}
    return names


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_script_imports_what_there_is(script):
    missing = []
    for node in ast.walk(ast.parse(script.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            file = module_file(node.module, script)
            if file is None:
                own = any((Path(place) / node.module.split('.')[0]).is_dir() for place in PLACES)
                missing += [node.module] if own and node.module.count('.') else []
            elif '__getattr__' not in (names := defined(file)):
                missing += [
                    f'{node.module}.{a.name}' for a in node.names if a.name not in (*names, '*')
                ]
    assert missing == []
