"""Changes of the base of a running rig: they wait for its next upward zero."""

import math
import re

import pytest
from running import until
from sensor_msgs.msg import JointState

from impact_damper_ros import RigParameters
from impact_damper_ros.cli.set_rig import main as set_rig
from node.rig_client import RigParametersClient, stamp_ns
from node.test_absurd_rigs import HAMMERING
from node.test_engine import Bench, done

#: b = -B sin(W t + 0.4) of an acceleration: it first rises through zero at 0.873 s.
SHAKEN = RigParameters(
    primary_mass=2.0,
    stiffness=1974.0,
    damping=1.26,
    damper_mass=0.1,
    gap=0.024,
    friction=0.02,
    force_amplitudes=0.0,
    base_amplitudes=0.6,
    base_frequencies=3.14,
    base_phases=0.4,
)
ZERO_NS = math.ceil((math.pi - 0.4) / 3.14 * 1e9)


def deeds(bench):
    """Return what was done to the rig, with its rig time, ns."""
    return [
        (s['time_ns'], *deed)
        for s in bench.snapshots()
        for deed in s['done']
        if deed[0] != 'stamp_offset_ns'
    ]


def run(bench, *requests, seconds=4.0):
    """Carry out requests at the start of a run, one after the other; return their answers."""
    tickets = [request() for request in requests]
    bench.run_to(seconds)
    assert bench.engine.failure is None
    return [done(ticket) for ticket in tickets]


def test_a_change_of_the_base_waits_and_all_else_does_not():
    with Bench(SHAKEN) as bench:
        louder = SHAKEN.replace(base_amplitudes=0.9, gap=0.02)
        stiffer = louder.replace(stiffness=2000.0, damping=2.0)
        newest = stiffer.replace(base_amplitudes=0.8)
        answers = run(
            bench, *(lambda rig=rig: bench.change(rig=rig) for rig in (louder, stiffer, newest))
        )
    for answer in answers:
        assert answer.time_ns == 0
        assert answer.result == (
            'base_amplitudes: in 0.8731 s, at rig time 0.87311868 s, when the base next passes '
            'zero upwards'
        )
    assert deeds(bench) == [
        (0, 'change', {'gap': 0.02}),
        (0, 'change', {'stiffness': 2000.0, 'damping': 2.0}),
        (ZERO_NS, 'change', {'base_amplitudes': [0.8]}),
    ]
    # b is continuous: the first joint states after it lie on the new motion that begins there.
    for message in bench.samples():
        time = stamp_ns(message.header.stamp) / 1e9
        base = -0.6 / 3.14**2 * math.sin(3.14 * time + 0.4)
        if time > ZERO_NS / 1e9:
            base = -0.8 / 3.14**2 * math.sin(3.14 * time + 0.4)
        assert message.position[5] == pytest.approx(base, abs=1e-10)


def test_a_change_back_ends_the_waiting():
    with Bench(SHAKEN) as bench:
        first, second = run(
            bench,
            lambda: bench.change(rig=SHAKEN.replace(base_frequencies=5.0)),
            lambda: bench.change(rig=SHAKEN),
        )
    assert first.result.startswith('base_frequencies: in 0.8731 s')
    assert second.result == ''
    assert deeds(bench) == []


def test_a_reset_makes_what_waits_as_the_base_begins_anew():
    with Bench(SHAKEN) as bench:
        run(
            bench,
            lambda: bench.change(rig=SHAKEN.replace(base_amplitudes=0.9)),
            lambda: bench.ask('reset'),
        )
    (change, reset) = deeds(bench)
    assert change == (0, 'change', {'base_amplitudes': [0.9]})
    assert reset[:2] == (0, 'reset')
    assert bench.engine.parameters.rig.base_amplitudes == (0.9,)


def test_a_change_waits_through_a_pause():
    with Bench(SHAKEN) as bench:
        bench.ask('pause', True)
        ticket = bench.change(rig=SHAKEN.replace(base_amplitudes=0.9))
        bench.engine.start()
        assert done(ticket).result.startswith('base_amplitudes: in 0.8731 s')
        until(lambda: len(bench.paused()) > 2)
        assert deeds(bench) == []
        done(bench.ask('pause', False))
        until(lambda: bench.engine.stamp_ns() > 2 * ZERO_NS)
        bench.engine.stop()
    assert deeds(bench) == [(ZERO_NS, 'change', {'base_amplitudes': [0.9]})]


def test_a_base_begins_at_once_and_ends_at_an_upward_zero():
    off = SHAKEN.replace(base_amplitudes=0.0)
    with Bench(off) as bench:
        begun = bench.change(rig=SHAKEN)
        bench.engine.start()
        assert done(begun).result == ''
        until(lambda: bench.engine.stamp_ns() > 0.3 * ZERO_NS)
        ended = done(bench.change(rig=off))
        until(lambda: deeds(bench)[1:])
        bench.engine.stop()
    # From zero phase of b on
    (on, end) = deeds(bench)
    assert on == (0, 'change', {'base_amplitudes': [0.6]})
    assert end[1:] == ('change', {'base_amplitudes': [0.0]})
    turns = end[0] / 1e9 * 3.14 / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-8)
    assert end[0] > ended.time_ns


def test_a_rig_that_is_held_takes_a_change_at_once():
    """Its time does not go on to any zero."""
    hammering = SHAKEN.replace(
        gap=0.01, **{n: v for n, v in HAMMERING.items() if not n.startswith('initial')}
    )
    calm = SHAKEN.replace(base_amplitudes=0.9)
    with Bench(hammering) as bench:
        initial = bench.engine.parameters.initial
        done_at_start = bench.change(
            initial=initial.replace(initial_damper_offset=0.005 - 1.25e-13)
        )
        bench.ask('reset')
        bench.engine.start()
        done(done_at_start)
        until(lambda: bench.engine.status().held)
        ticket = done(bench.change(rig=calm))
        assert (ticket.error, ticket.result) == (None, '')
        assert bench.engine.status().held == ''
        bench.engine.stop()
    assert deeds(bench)[-1][2]['base_amplitudes'] == [0.9]


def test_the_answer_says_from_when_on(client, launch, namespace, capsys, tmp_path):
    """By the parameter services, and by set_rig; the recording is reproduced bit for bit."""
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in SHAKEN.as_dict().items()
        if name.startswith('base_') or name in ('stiffness', 'primary_mass', 'gap')
    }
    node = f'{namespace}/sim_node'
    process = launch(
        f'__ns:={namespace}', **values, force_amplitudes=[0.0], record=True, real_time_factor=2.0
    )
    states = client.listen(JointState, f'{namespace}/joint_states')
    until(lambda: states, lambda: process.output)
    parameters = RigParametersClient(client, node)
    assert parameters.set_base(gap=0.02) == (True, '')
    done_, words = parameters.set_base(base_amplitudes=[0.9])
    assert done_
    wait, time = map(
        float,
        re.fullmatch(
            r'base_amplitudes: in (.*) s, at rig time (.*) s, when the .*', words
        ).groups(),
    )
    assert 0.0 < wait < 1.001 * math.tau / 3.14
    turns = (time * 3.14 + 0.4 - math.pi) / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-7)
    assert list(parameters.get('base_amplitudes')) == [0.9]
    assert set_rig(['base_frequencies=0.6 Hz', '--node', node]) == 0
    assert 'when the base next passes zero upwards' in capsys.readouterr().err
    count = len(states)
    until(lambda: len(states) > count + 500)
    swept = {
        'sweep_mode': 'up',
        'sweep_low': 6.0,
        'sweep_high': 60.0,
        'sweep_step': 0.6,
        'sweep_spacing': 'logarithmic',
        'sweep_rate': 60.0,
        'sweep_notch_frequencies': [20.0, 30.0],
        'sweep_notch_factors': [1.0, 0.3],
    }
    assert parameters.set_base(**swept)[0]
    assert parameters.set_base(sweep_notch_factors=[1.0, 0.5, 1.0]) == (
        False,
        'sweep_notch_frequencies has 2 entries and sweep_notch_factors 3: give both together, '
        'with the same length',
    )
    count = len(states)
    until(lambda: len(states) > count + 1500)
    assert process.stop() == 0, process.output
    assert list(tmp_path.rglob('metadata.yaml'))  # held against the rig by `every_bag_is_replayed`
