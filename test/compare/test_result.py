"""The outcome of a comparison as a value, and as what JSON can hold."""

import json
import math
from dataclasses import replace

import pytest
from report.example_comparison import example


@pytest.fixture(scope='module')
def comparison():
    return example(gap_curve=False)


def test_as_json(comparison):
    plain = json.loads(json.dumps(comparison.as_dict(), allow_nan=False))
    settled, differing, chaotic = plain['stretches']
    assert plain['exit_code'] == 1
    assert settled['begins'] == 'start'
    assert settled['verdict'] == 'agrees'
    assert settled['parameters']['gap'] == 37.0
    assert settled['predicted']['phases'][0] == pytest.approx(0.7579950, abs=1e-6)
    assert settled['measured']['last_period']['stops'] == [1, 2]
    assert 'curves' not in settled
    assert differing['findings'][0]['difference'] == 0.5
    assert chaotic['kind'] == 'chaotic'
    assert chaotic['predicted'] is None


def test_no_nan(comparison):
    stretch = comparison.stretches[0]
    unknown = replace(stretch.decay, measured=math.nan)
    run = replace(comparison, stretches=(replace(stretch, decay=unknown),))
    plain = json.loads(json.dumps(run.as_dict(), allow_nan=False))
    assert plain['stretches'][0]['decay']['measured'] is None


def test_exit_codes(comparison):
    agrees = replace(comparison, stretches=comparison.stretches[::2])
    assert agrees.exit_code == 0
    assert replace(agrees, faults=('the bag is cut',)).exit_code == 3
    assert comparison.exit_code == 1
    assert replace(comparison, faults=('the bag is cut',)).exit_code == 1


def test_what_is_measured_of_a_period(comparison):
    settled, _, chaotic = comparison.stretches
    assert (settled.stops, settled.impacts_per_period) == ((1, 2), 2)
    assert replace(chaotic, measured=None).stops == ()
