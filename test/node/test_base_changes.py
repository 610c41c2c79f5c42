"""Changes of the base of a running rig: they wait for its next upward zero."""

import math
import re

import pytest
from rigs import BENCH
from running import until

from impact_damper_ros.cli.set_rig import main as set_rig
from node.bench import Bench, done
from node.rig_client import stamp_ns
from node.test_absurd_rigs import HAMMERING

#: b = -B sin(W t + 0.4) of an acceleration: it first rises through zero at 0.873 s.
SHAKEN = BENCH.replace(
    force_amplitudes=0.0, base_amplitudes=0.6, base_frequencies=3.14, base_phases=0.4
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
        rigs = louder, stiffer, newest
        answers = run(bench, *(lambda rig=rig: bench.change(rig=rig) for rig in rigs))
    assert {(answer.time_ns, answer.result) for answer in answers} == {
        (
            0,
            'base_amplitudes: in 0.8731 s, at rig time 0.87311868 s, when the base next passes '
            'zero upwards',
        )
    }
    assert deeds(bench) == [
        (0, 'change', {'gap': 0.02}),
        (0, 'change', {'stiffness': 2000.0, 'damping': 2.0}),
        (ZERO_NS, 'change', {'base_amplitudes': [0.8]}),
    ]
    # b is continuous: the first joint states after it lie on the new motion that begins there.
    for message in bench.samples():
        time = stamp_ns(message.header.stamp) / 1e9
        level = 0.6 if time <= ZERO_NS / 1e9 else 0.8
        base = -level / 3.14**2 * math.sin(3.14 * time + 0.4)
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
        louder = SHAKEN.replace(base_amplitudes=0.9)
        run(bench, lambda: bench.change(rig=louder), lambda: bench.ask('reset'))
    change, reset = deeds(bench)
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
        bench.pause(False)
        bench.pass_by(2 * ZERO_NS / 1e9)
    assert deeds(bench) == [(ZERO_NS, 'change', {'base_amplitudes': [0.9]})]


def test_a_base_begins_at_once_and_ends_at_an_upward_zero():
    off = SHAKEN.replace(base_amplitudes=0.0)
    with Bench(off) as bench:
        begun = bench.change(rig=SHAKEN)
        bench.engine.start()
        assert done(begun).result == ''
        bench.pass_by(0.3 * ZERO_NS / 1e9)
        ended = done(bench.change(rig=off))
        until(lambda: deeds(bench)[1:])
    # From zero phase of b on
    on, end = deeds(bench)
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
    with Bench(hammering).started() as bench:
        initial = bench.engine.parameters.initial
        bench.reset(initial.replace(initial_damper_offset=HAMMERING['initial_damper_offset']))
        until(lambda: bench.status.held)
        change = done(bench.change(rig=SHAKEN.replace(base_amplitudes=0.9)))
        assert (change.error, change.result, bench.status.held) == (None, '', '')
    assert deeds(bench)[-1][2]['base_amplitudes'] == [0.9]


def test_the_answer_says_from_when_on(start, capsys):
    """By the parameter services, and by set_rig; the recording is reproduced bit for bit."""
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in SHAKEN.as_dict().items()
        if name.startswith('base_') or name in ('stiffness', 'primary_mass', 'gap')
    }
    rig = start(**values, force_amplitudes=[0.0], record=True, real_time_factor=2.0)
    rig.await_states()
    rig.change(gap=0.02)
    answer = rig.parameters.request(base_amplitudes=[0.9])
    assert answer.successful
    words = re.fullmatch(
        r'base_amplitudes: in (.*) s, at rig time (.*) s, when the .*', answer.reason
    )
    wait, time = map(float, words.groups())
    assert 0.0 < wait < 1.001 * math.tau / 3.14
    turns = (time * 3.14 + 0.4 - math.pi) / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-7)
    assert list(rig.parameters.get('base_amplitudes')) == [0.9]
    assert set_rig(['base_frequencies=0.6 Hz', '--node', rig.name]) == 0
    assert 'when the base next passes zero upwards' in capsys.readouterr().err
    rig.await_states(200)
    sweep = {'mode': 'up', 'low': 6.0, 'high': 60.0, 'step': 0.6, 'spacing': 'logarithmic'}
    sweep |= {'rate': 60.0, 'notch_frequencies': [20.0, 30.0], 'notch_factors': [1.0, 0.3]}
    swept = {f'sweep_{name}': value for name, value in sweep.items()}
    assert rig.parameters.request(**swept).successful
    assert rig.parameters.set_atomically(sweep_notch_factors=[1.0, 0.5, 1.0]) == (
        'sweep_notch_frequencies has 2 entries and sweep_notch_factors 3: give both together, '
        'with the same length'
    )
    rig.await_states(600)
    rig.stop()
    assert rig.bag()
