"""What is wrong in a log is noticed, what is right is not doubted; more of each by hand."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
verdicts = import_module('verdicts')


@pytest.fixture(autouse=True)
def short_runs(monkeypatch):
    monkeypatch.setattr(verdicts, 'RATES', {50: 1.2, 200: 1.0})
    monkeypatch.setattr(verdicts, '_CHUNKS', 5)


@pytest.mark.parametrize('factor', verdicts.FACTORS)
@pytest.mark.parametrize('name', verdicts.KINDS)
def test_altered_numbers(name, factor):
    assert verdicts.altered_bags(name, 50, factor, 5) == []


def test_messages_missing_or_twice():
    count, unnoticed = verdicts.rearranged_bags('controlled', 50)
    assert (count > 30, unnoticed) == (True, [])


def test_messages_in_another_order():
    assert verdicts.bags_recorded_otherwise('controlled', 50) == []


@pytest.mark.parametrize('number', range(4))
def test_untouched_bags(number):
    assert verdicts.untouched_bag(number)[1] == [0, 0]


def test_random_changes():
    count, doubted, faults = verdicts.soak(1, 12)
    assert (count > 6, doubted, faults) == (True, 0, 0)
