"""Functions are verbs or nouns, no bare participles; a public name stands for one thing."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import impact_damper_ros

PACKAGE = Path(impact_damper_ros.__file__).parent
#: Participles that do not end in -ed; `read`, `cut`, `split` and `put` are verbs, too.
IRREGULAR = {
    *('begun', 'bought', 'bound', 'built', 'chosen', 'done', 'drawn', 'driven', 'found', 'given'),
    *('gone', 'heard', 'held', 'hidden', 'kept', 'known', 'left', 'lost', 'made', 'meant', 'met'),
    *('said', 'seen', 'sent', 'shown', 'taken', 'thrown', 'told', 'worn', 'written'),
}
#: The step from the first format, of which a snapshot and a sweep have one each.
TWICE = {'upgraded_from_1'}


def functions(body):
    """Yield the functions and methods of a module, but properties, which may be adjectives."""
    for node in body:
        if isinstance(node, ast.ClassDef):
            yield from functions(node.body)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            if not any('property' in ast.unparse(one) for one in node.decorator_list):
                yield node.name
            yield from functions(node.body)


def is_participle(name):
    word = name.strip('_')
    regular = re.fullmatch('[a-z]{2,}ed', word) and word not in {'need', 'seed', 'speed'}
    return bool(regular) or word in IRREGULAR


def test_no_function_or_module_is_a_bare_participle():
    found = defaultdict(set)
    for path in PACKAGE.rglob('*.py'):
        names = [path.stem, *functions(ast.parse(path.read_text('utf-8')).body)]
        found[path.relative_to(PACKAGE).parts[0]] |= {
            name.strip('_') for name in names if is_participle(name)
        }
    assert {room: names for room, names in found.items() if names} == {}


def test_a_public_name_at_module_level_is_that_of_one_thing():
    places = defaultdict(set)
    for path in PACKAGE.rglob('*.py'):
        for node in ast.parse(path.read_text('utf-8')).body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith('_'):
                places[node.name].add(path.relative_to(PACKAGE))
    twice = {name: found for name, found in places.items() if len(found) > 1}
    left = {name: found for name, found in twice.items() if name not in {*TWICE, 'main'}}
    assert left == {}
