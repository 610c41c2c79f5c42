"""
The last bits of a motion, held against those that are kept for the present number of arithmetic.

Bits that were meant to move get a new `ARITHMETIC`, a line beside it that says what moved them,
and `PYTHONPATH=test python -m rig.test_arithmetic`, which keeps the new ones. That command also
adds those of a machine whose mathematical functions round otherwise; it replaces none of the same
number.
"""

import hashlib
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from bag.recorded_rig import CONTROL, ordered_run, random_excitation, requested_run
from rigs import BENCH, FRICTION, HORIZONTAL, UNFORCED, VERTICAL

from impact_damper_ros import Rig
from impact_damper_ros.bag.snapshots import mathematics
from impact_damper_ros.measured.record import read_record
from impact_damper_ros.rig.snapshot import ARITHMETIC

KEPT = Path(__file__).with_name('arithmetic.json')
CONFIG = Path(__file__).parents[2] / 'config'
TWO = HORIZONTAL.replace(
    force_amplitudes=(1.0, 0.3), force_frequencies=(1.0, 1.618), force_phases=(0.0, 1.0)
)


def free(parameters, duration, **options):
    """Return the bytes of events and samples of a rig that is let run."""
    instants = np.linspace(0.0, duration, 50)
    ran = Rig(parameters, **options).run(duration, instants)
    assert ran.event_count > 20
    return ran.events.tobytes() + ran.samples.tobytes()


def recorded(quantity):
    path = CONFIG / f'{quantity}_record.csv'
    return free(UNFORCED.replace(gap=0.004), 12.0, records=[read_record(path, quantity)])


def published(rig):
    """Return the bytes of the messages of a rig that have computed numbers."""
    return b''.join(
        content
        for topic, content, _ in rig.messages
        if topic in ('/joint_states', '/impacts', '/gap_control')
    )


RUNS = {
    'one harmonic': lambda: free(HORIZONTAL, 400.0),
    'two harmonics': lambda: free(TWO, 200.0),
    'friction': lambda: free(FRICTION, 300.0),
    'one stop': lambda: free(VERTICAL, 100.0),
    'chatter': lambda: free(
        BENCH.replace(angle=math.pi / 2, gap=0.05, force_amplitudes=(2.0,)), 20.0
    ),
    'chaos': lambda: free(BENCH.replace(gap=0.034), 40.0),
    'record of the base': lambda: recorded('base'),
    'record of the force': lambda: recorded('force'),
    'requests': lambda: published(requested_run(1)),
    'excitation': lambda: published(requested_run(2, random_excitation)),
    'control': lambda: published(requested_run(3, control=CONTROL)),
    'orders': lambda: published(ordered_run(4)),
}


def digest(name):
    return hashlib.sha256(RUNS[name]()).hexdigest()[:16]


@pytest.mark.parametrize('name', RUNS)
def test_bits_move_only_with_the_number(name):
    kept = json.loads(KEPT.read_text())
    assert kept['arithmetic'] == ARITHMETIC
    if (bits := kept['bits'].get(str(mathematics()))) is None:
        pytest.skip(f'mathematical functions {mathematics()} are not among {[*kept["bits"]]}')
    assert digest(name) == bits[name]


def test_the_last_bit_of_a_result_is_noticed():
    rig = FRICTION.replace(gap=math.nextafter(FRICTION.gap, 0.0))
    assert free(rig, 300.0) != RUNS['friction']()


def keep():
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {'arithmetic': 0}
    if kept['arithmetic'] != ARITHMETIC:
        kept = {'arithmetic': ARITHMETIC, 'bits': {}}
    here = str(mathematics())
    if here in kept['bits']:
        sys.exit(f'the bits of arithmetic {ARITHMETIC} are kept for mathematical functions {here}')
    kept['bits'][here] = {name: digest(name) for name in RUNS}
    KEPT.write_text(json.dumps(kept, indent=1) + '\n')


if __name__ == '__main__':
    keep()
