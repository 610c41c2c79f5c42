"""The outcome of a comparison as a value, and as what JSON can hold."""

import json
import math
from dataclasses import replace

import pytest
from bag.alterations import altered_message
from bag.recorded_rig import RecordedRig
from report.example_comparison import example
from rigs import BENCH

from impact_damper_ros.compare import compare_bag


@pytest.fixture(scope='module')
def comparison():
    return example(gap_curve=False)


def test_as_json(comparison):
    """Without curves and NaN, and with the differences of findings."""
    stretch = comparison.stretches[0]
    unknown = replace(stretch.decay, measured=math.nan)
    run = replace(comparison, stretches=(replace(stretch, decay=unknown),))
    plain = json.loads(json.dumps(run.as_dict(), allow_nan=False))
    assert plain['stretches'][0]['decay']['measured'] is None
    assert 'curves' not in plain['stretches'][0]
    differing = comparison.as_dict()['stretches'][1]
    assert differing['differences'][0]['difference'] == 0.5


def test_exit_codes(comparison):
    agrees = replace(comparison, stretches=comparison.stretches[::2])
    assert agrees.exit_code == 0
    assert replace(agrees, faults=('the bag is cut',)).exit_code == 3
    assert comparison.exit_code == 1
    assert replace(comparison, faults=('the bag is cut',)).exit_code == 1


def test_a_difference_is_that_of_its_stretch(tmp_path):
    rig = RecordedRig(BENCH).start().run(300).run(300, ('change', {'gap': 0.02})).run(300)
    number = max(i for i, (topic, *_) in enumerate(rig.messages) if topic == '/joint_states')
    rig.messages[number] = altered_message(rig.messages[number], ('position', 0), 1e-3)
    shares = []
    found = compare_bag(rig.save(tmp_path / 'bag'), progress=shares.append)
    assert shares == pytest.approx([1.505 / 4.5, 1.0])
    assert [len(stretch.differences) for stretch in found.stretches] == [0, 1]
    assert [stretch.log.value for stretch in found.stretches] == ['reproduced', 'differs']
