"""Measured records and random lines on a live rig over DDS; recorded and replayed."""

import numpy as np
from running import SOURCE

from impact_damper_ros import Rig
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.parameters.parameters_file import load_parameters

CONFIG = SOURCE / 'config'
RECORDS = {quantity: CONFIG / f'{quantity}_record.csv' for quantity in ('base', 'force')}


def test_records_and_random_lines_act_from_the_start_and_from_a_reset(start, tmp_path):
    """On a rig of --rig-out, as in `simulate_rig`; copies of the records are in each snapshot."""
    file, states, again = (tmp_path / name for name in ('rig.yaml', 'states.csv', 'again.csv'))
    words = ['bench_rig', '--set', 'force_amplitudes=0', '--duration', '0.3', '--quiet']
    words += ['--base-psd', str(CONFIG / 'random_base.csv'), '--psd-lines', '20']
    words += [word for name, path in RECORDS.items() for word in (f'--{name}-record', str(path))]
    assert simulate_rig([*words, '--rig-out', str(file), '--states', str(states)]) == 0
    assert len(load_parameters(file)[0].base_amplitudes) == 21
    names = {f'{quantity}_record': str(path) for quantity, path in RECORDS.items()}
    rig = start(parameters_file=file, record=True, **names)
    rig.await_states(80)
    assert rig.parameters.set(gap=0.02) == ''
    for name in names:
        assert 'fixed while the node runs' in rig.parameters.set(**{name: 'none'})
    snapshot = rig.reset()
    held = snapshot['state']
    rig.await_states(100)
    rig.stop()
    # Anew from the reset on, and the base from rest
    assert [(r['quantity'], r['name'], r['start']) for r in held['records']] == [
        (quantity, f'{quantity}_record.csv', held['time'])
        for quantity in [r['quantity'] for r in held['records']]
    ]
    assert held['recorded']['base_speed'] == 0.0
    # The snapshot is enough to go on.
    restored = {record.quantity: record for record in Rig.restore(held).measured_records}
    assert restored.keys() == RECORDS.keys()
    for quantity, path in RECORDS.items():
        table = np.loadtxt(path, delimiter=',', skiprows=2)
        scale = 9.80665 if quantity == 'base' else 1.0
        assert restored[quantity].values.tolist() == (table[:, 1] * scale).tolist()
    assert replay_run([str(rig.bag()), '--states', str(again)]) == 0
    expected, found = (np.loadtxt(path, delimiter=',', skiprows=1) for path in (states, again))
    for since in (0.0, held['time']):
        then = (found[:, 0] >= since) & (found[:, 0] < since + 1.0)
        assert np.abs(found[then, 1] - found[then, 9]).max() > 1e-4
    until = found[:, 0] <= 0.3
    here = np.isin(expected[:, 0], found[until, 0])
    assert here.sum() > 30
    assert found[until, 1].tolist() == expected[here, 1].tolist()
