"""`set_rig` on a running node, over DDS."""

import math
import re
import signal
from contextlib import nullcontext

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
from node.rig_client import LIVELY, SimProcess
from running import DEADLINE_S, Running

from impact_damper_ros.cli import set_rig, sim_node
from impact_damper_ros.cli.command_line import CommandError
from impact_damper_ros.parameters.all_parameters import ALL_SPECS

#: A rig whose joint states nobody looks at
SLOW = {**LIVELY, 'state_rate': 10.0}


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    process = SimProcess(tmp_path_factory.mktemp('node'), ('__ns:=/bench',), **SLOW)
    yield process
    process.kill()


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Wait for a node as long as its start takes on a machine with much else to do."""
    monkeypatch.setattr(set_rig, 'PATIENCE_S', DEADLINE_S)


def rows_of(said):
    """Return the columns of each line below the head by the first one."""
    head, *lines = said.splitlines()
    assert re.split(r'  +', head) == ['parameter', 'value', 'unit', 'range', 'usual range']
    return {line.split()[0]: re.split(r'  +', line)[1:] for line in lines}


@pytest.mark.usefixtures('node')
def test_all_parameters_with_units_and_ranges(capsys):
    assert set_rig.main([]) == 0
    rows = rows_of(capsys.readouterr().out)
    assert list(rows) == list(ALL_SPECS)
    assert rows['gap'] == ['0.01', 'm', '1e-09 to 1e+09', '0.0001 to 100']
    assert rows['force_amplitudes'] == ['[10]', 'N', '-1e+12 to 1e+12', '-1e+04 to 1e+04']
    assert rows['gap_control'] == ['off', 'off, amplitude, timed, external']
    assert rows['record'] == ['false', 'true, false']


@pytest.mark.usefixtures('node')
def test_parameters_are_set_together(capsys):
    words = ['gap=8 mm', 'force_amplitudes=[8, 1.5]', 'gap_control=timed', 'friction=1e-2']
    assert set_rig.main([*words, '--node', '/bench/sim_node']) == 0
    rows = rows_of(capsys.readouterr().out)
    assert list(rows) == ['gap', 'force_amplitudes', 'gap_control', 'friction']
    assert [row[0] for row in rows.values()] == ['0.008', '[8, 1.5]', 'timed', '0.01']


@pytest.mark.usefixtures('node')
def test_the_unit_of_the_base_is_that_of_its_quantity(capsys):
    # The last one leaves the base at rest again
    for value, row in (
        ('0.5 mm', ['[0.0005]', 'm']),
        ('2 m/s^2', ['[2]', 'm/s^2']),
        ('0 m', ['[0]', 'm']),
    ):
        assert set_rig.main([f'base_amplitudes={value}', 'base_frequencies=30']) == 0
        assert rows_of(capsys.readouterr().out)['base_amplitudes'][:2] == row


@pytest.mark.usefixtures('node')
def test_a_structure_as_people_know_it(capsys):
    """Natural frequency, damping and mass ratio are set by what they mean for this rig."""
    with set_rig.ros_node('set_rig') as joined:
        before = set_rig.RigParameterClient(joined, '/bench/sim_node').values()
    words = ['natural_frequency=6', 'damping_ratio = 3 %', 'mass_ratio=4%']
    assert set_rig.main(words) == 0
    rows = rows_of(capsys.readouterr().out)
    mass, omega = before['primary_mass'], 12.0 * math.pi
    assert list(rows) == ['stiffness', 'damping', 'damper_mass']
    assert [float(row[0]) for row in rows.values()] == pytest.approx(
        [mass * omega**2, 0.06 * mass * omega, 0.04 * mass], rel=1e-4
    )
    assert set_rig.main([f'{name}={before[name]}' for name in rows]) == 0


@pytest.mark.parametrize('name', ['bad name!', 'a//b', '/1'])
def test_a_name_that_no_node_can_have(name, capsys):
    assert set_rig.main(['--node', name, 'gap=0.008']) == 2
    assert f'--node {name}: no node has such a name' in capsys.readouterr().err.replace("'", '')


REFUSED = {
    'gap:=12mm': 'gap:=12mm: write gap=12mm',
    'damping_ratio=1.2': 'damping_ratio is 1.2',
    'mass_ratio=0.2': 'mass_ratio 0.2 means',
    'gab=3': 'gab=3: there is no parameter gab to set: did you mean gap?',
    'xyzzy=3': 'set_rig lists all parameters',
    'gap': 'gap: give NAME=VALUE',
    # Of every ROS node, not of the rig
    'use_sim_time=true': 'there is no parameter use_sim_time to set',
    'gap=-1': 'gap is -1.0 m: give a number from',
    # The node's own words
    'damping=1e3': 'underdamped',
    'state_rate=100': 'state_rate is fixed while the node runs',
}


@pytest.mark.usefixtures('node')
def test_what_cannot_be_set_changes_nothing(monkeypatch, capsys):
    """All of it by one participant of the network."""
    with set_rig.ros_node('set_rig') as joined:
        rig = set_rig.RigParameterClient(joined, '/bench/sim_node')
        monkeypatch.setattr(set_rig, 'ros_node', lambda _: nullcontext(joined))
        monkeypatch.setattr(set_rig, 'RigParameterClient', lambda *_: rig)
        for setting, reason in REFUSED.items():
            assert set_rig.main(['angle=0.3', 'damper_mass=0.3', setting]) == 2
            assert reason in capsys.readouterr().err
        assert rig.values()['angle'] == 0.0


@pytest.mark.usefixtures('node')
def test_a_frequency_in_hertz_is_noted(capsys):
    assert set_rig.main(['force_frequencies=5', 'damping=0.5']) == 0
    assert 'note: force_frequencies is 5 rad/s, about 1/(2π)' in capsys.readouterr().err
    # Once, not at each change of something else
    assert set_rig.main(['friction=0.03']) == 0
    assert 'note' not in capsys.readouterr().err
    assert set_rig.main(['force_frequencies=5 Hz']) == 0
    assert 'note' not in capsys.readouterr().err


@pytest.mark.usefixtures('node')
def test_diagnostics_are_watched(tmp_path):
    """Until Ctrl-C, as a process; after a change that is made first."""
    words = ['-m', 'impact_damper_ros.cli.set_rig', 'gap=0.012', '--watch']
    with Running(tmp_path, *words, errors=True) as process:

        def watched():
            printed = process.output
            return 'predicted motion' in printed and printed.count('rig   ') > 1

        process.until(watched)
        assert process.stop() == 130
    wait = 'set_rig: waiting for the first report of /bench/sim_node; Ctrl-C ends it'
    assert wait in process.errors
    lines = process.output.splitlines()
    assert lines[0].startswith('parameter  value')
    assert lines[1].startswith('gap        0.012')
    assert any(re.fullmatch(r'bench/sim_node: recording +OK +off', line) for line in lines)


def test_a_rig_that_stands_still_may_have_made_the_change(node, monkeypatch):
    with set_rig.ros_node('set_rig') as joined:
        rig = set_rig.RigParameterClient(joined, '/bench/sim_node')
        assert rig.values()['gap'] > 0.0
        monkeypatch.setattr(set_rig, 'PATIENCE_S', 0.5)
        node.send(signal.SIGSTOP)
        try:
            with pytest.raises(CommandError, match='does not answer: the change may or may not'):
                rig.set({'gap': 0.02})
        finally:
            node.send(signal.SIGCONT)


def test_no_rig_and_several(node, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(set_rig, 'PATIENCE_S', 1.0)
    assert set_rig.main(['--node', '/nobody']) == 1
    assert '/nobody does not answer: does it run?' in capsys.readouterr().err
    for name in ('DISCOVERY_S', 'PATIENCE_S'):
        monkeypatch.setattr(set_rig, name, DEADLINE_S)
    other = SimProcess(tmp_path / 'other', ('__ns:=/other',), **SLOW)
    try:
        assert set_rig.main(['gap=0.01']) == 2
    finally:
        other.kill()
    expected = 'several rigs run, /bench/sim_node, /other/sim_node: name one with --node'
    assert expected in capsys.readouterr().err
    node.kill()
    for name in ('DISCOVERY_S', 'PATIENCE_S'):
        monkeypatch.setattr(set_rig, name, 1.0)
    assert set_rig.main([]) == 1
    assert 'no rig runs on this ROS network' in capsys.readouterr().err


@pytest.mark.parametrize('command', [set_rig, sim_node])
def test_without_ros(command, monkeypatch, capsys):
    monkeypatch.setattr(command, 'find_spec', lambda _: None)
    assert command.main([]) == 2
    assert 'rclpy is missing' in capsys.readouterr().err
