"""Results as JSON, and in what two of them differ."""

import json
import math

import numpy as np
import pytest

from impact_damper_ros import Outcome, Sample
from impact_damper_ros.parameters.plain import as_plain, differences, json_text


@pytest.mark.parametrize(
    ('value', 'plain'),
    [
        ((math.nan, math.inf, -0.5), [None, None, -0.5]),
        ({1: 1.0 - 2.0j, 'left': 3}, {'1': [1.0, -2.0]}),
        (np.array([[1.5, math.nan]]), [[1.5, None]]),
        (np.zeros(1, [('x', 'f8'), ('left', 'i8')]), [{'x': 0.0}]),
        (Outcome.COMPLETE, Outcome.COMPLETE.value),
        (Sample(*range(len(Sample._fields))), {n: i for i, n in enumerate(Sample._fields)}),
    ],
)
def test_results_in_types_of_json(value, plain):
    assert as_plain(value, without=('left',)) == plain
    assert json.loads(json_text(plain)) == plain


def test_differences_are_those_of_the_text():
    there = {'a': {'b': 1, 'c': -0.0}, 'd': (1.0, 2.0), 'e': math.nan, 'f': True}
    here = {'g': 0.5, 'a': {'b': 1.0, 'c': 0.0}, 'd': [1.0, 2.0], 'e': math.nan, 'f': 1}
    assert differences(there, there) == []
    assert [(name, str(one), str(other)) for name, one, other in differences(there, here)] == [
        *(('g', 'None', '0.5'), ('a.b', '1', '1.0'), ('a.c', '-0.0', '0.0')),
        ('f', 'True', '1'),
    ]
