"""Functions are verbs or nouns, no bare participles; a name stands for one thing, a word too."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest
from package_trees import trees

CONTRIBUTING = (Path(__file__).parents[2] / 'CONTRIBUTING.md').read_text(encoding='utf-8')
NAMES = CONTRIBUTING[CONTRIBUTING.index('### Names') : CONTRIBUTING.index('### Words')]
#: Words of names, and the places of those that stand in some places only.
WORDS = {
    word: places
    for word, places in re.findall(r'^\| (\w+) \|.*\| ?([^|]*?) ?\|$', NAMES, re.MULTILINE)
    if word != 'word'
}
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
    for path, tree in trees().items():
        names = [path.stem, *functions(tree.body)]
        found[path.parts[0]] |= {name.strip('_') for name in names if is_participle(name)}
    assert {room: names for room, names in found.items() if names} == {}


def test_a_public_name_at_module_level_is_that_of_one_thing():
    places = defaultdict(set)
    for path, tree in trees().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith('_'):
                places[node.name].add(path)
    twice = {name: found for name, found in places.items() if len(found) > 1}
    left = {name: found for name, found in twice.items() if name not in {*TWICE, 'main'}}
    assert left == {}


def words_of(name):
    """Return the words of a name: of `next_act`, `ControlAct`, `NO_ACTS`; a plural is its word."""
    words = re.findall('[A-Z]+(?![a-z])|[A-Z]?[a-z]+', name)
    return {word.lower().removesuffix('s') for word in words} | {word.lower() for word in words}


def all_names(tree):
    """Yield the names that a module gives: functions, classes, arguments, variables, fields."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr


@cache
def names_by_word():
    """Return the names of the package, each with the files that give it, by the words in them."""
    found = defaultdict(lambda: defaultdict(set))
    for path, tree in trees().items():
        for name in {path.stem, *all_names(tree)}:
            for word in words_of(name):
                found[word][name].add(path)
    return found


@pytest.mark.parametrize('word', [word for word, places in WORDS.items() if places])
def test_a_word_of_names_stands_in_its_places(word):
    places = re.findall('`(.*?)`', WORDS[word])
    folders = {place.strip('/') for place in places if place.endswith('/')}
    assert {
        name: files
        for name, files in names_by_word()[word].items()
        if name not in places and {file.parts[0] for file in files} - folders
    } == {}


def test_words_of_names_are_found():
    assert {'act', 'passage', 'record', 'course', 'push'} <= WORDS.keys()
    assert WORDS['course'] == '`fit/`'
    assert {'act', 'no'} <= words_of('NO_ACTS')
    assert {'control', 'act'} == words_of('ControlAct')
