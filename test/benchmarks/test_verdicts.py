"""A small part of benchmarks/verdicts.py: wrong numbers are noticed, right ones not doubted."""

import random
import sys
from importlib import import_module
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
verdicts = import_module('verdicts')


@pytest.mark.parametrize('factor', verdicts.FACTORS)
@pytest.mark.parametrize('name', sorted(verdicts.KINDS))
def test_altered_numbers_are_noticed(name, factor):
    missed, fields = verdicts.altered_bags(name, 50, factor, 3, False)
    assert not missed, fields


@pytest.mark.parametrize('name', ['settled', 'stepped sine'])
def test_altered_numbers_that_cannot_be_replayed(name):
    """Gross ones do not widen their own tolerance."""
    messages_of = ('/impacts', '/joint_states')
    draw = random.Random(5)

    def one_place(messages, _):
        topic = draw.choice(messages_of)
        index = draw.choice([i for i, m in enumerate(messages) if m.topic == topic])
        return index, draw.choice([p for p in verdicts.places(messages[index]) if len(p) == 2])

    original, verdicts.one_place = verdicts.one_place, one_place
    try:
        missed, fields = verdicts.altered_bags(name, 200, 1e300, 4, name == 'settled')
    finally:
        verdicts.one_place = original
    assert not missed, fields


def test_rearranged_bags_are_noticed():
    """A schema with other fields was once nobody's concern, and a bag in JSON taken for CDR."""
    count, unnoticed = verdicts.rearranged_bags('settled', 50)
    assert count > 40
    assert unnoticed == []


@pytest.mark.parametrize('number', range(4))
def test_untouched_bags_are_not_doubted(number):
    assert verdicts.untouched_bag(number)[1:] == (0, 0)


@pytest.mark.parametrize('number', [0, 3])
def test_no_stretch_of_a_soak_is_doubted(number):
    stretches, doubted, faults, replayed = verdicts.soak(number, 20)
    assert stretches > 10
    assert (doubted, faults, replayed) == (0, 0, 0)
