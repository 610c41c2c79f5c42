"""Scores against closed forms, against runs with a fixed gap, and against what was recorded."""

import json
import math
import re

import numpy as np
import pytest
from bag.recorded_rig import RecordedRig
from compare.recorded import replayed
from rigs import BENCH, LIVELY, OFF_RESONANCE

from impact_damper_ros import GapControlParameters, InitialConditions, Order, Rig
from impact_damper_ros.cli.compare_run import main
from impact_damper_ros.compare.score import amplitudes, score_run
from impact_damper_ros.replay import RecordedRun
from impact_damper_ros.report.score_report import score_table

TIMED = GapControlParameters(
    gap_control='timed', gap_min=0.002, gap_max=0.05, actuator_speed=2.0, actuator_delay=0.002
)
LOUDER = {'force_amplitudes': (1.8,)}


def scored(bag, gap=None, **options):
    return score_run(RecordedRun(bag, purpose='score'), gap=gap, **options)


def recorded(tmp_path, parameters, *, seconds=12, control=None, initial=None, name='bag'):
    """Return a bag of two stretches, the second under a larger force."""
    rig = RecordedRig(parameters, initial, control=control, offset=0).start()
    rig.run(200 * seconds).run(200 * seconds, ('change', LOUDER))
    return rig.save(tmp_path / name)


@pytest.fixture(scope='module')
def timed(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp('timed'), BENCH, control=TIMED)


@pytest.fixture(scope='module')
def score(timed):
    return scored(timed, 0.05)


def test_m_alone_and_its_settling_time(tmp_path):
    """From rest at resonance: X = A (e^(-zeta w t) - 1) cos w t but for terms of zeta."""
    wide = BENCH.replace(
        gap=5.0, friction=0.0, damper_mass=1e-6, force_frequencies=(BENCH.omega,), damping=4.0
    )
    found = scored(recorded(tmp_path, wide))
    rate = wide.damping / (2.0 * wide.primary_mass)
    times = np.linspace(0.0, 12.0, 120_001)
    expected = wide.response_amplitude * (1.0 - np.exp(-rate * times)) * np.cos(wide.omega * times)
    first = found.stretches[0]
    assert first.run.x_rms == pytest.approx(math.sqrt(np.mean(expected**2)), rel=1e-3)
    for name in ('x_max', 'x_rms', 'force_work', 'dashpot_energy'):
        assert getattr(first.alone, name) == pytest.approx(getattr(first.run, name), rel=1e-5)
    # At 95 % of the final amplitude; the second step is one of half the size
    cycle = math.tau / wide.omega
    assert first.settling_time == pytest.approx(math.log(20.0) / rate, abs=1.5 * cycle)
    later = math.log(20.0 / 3.0) / rate
    assert found.stretches[1].settling_time == pytest.approx(later, abs=1.5 * cycle)
    assert first.run.total_impulse == first.run.impacts == 0


def test_the_fixed_gap(score, timed, tmp_path):
    """The same history recorded with that gap has the same numbers."""
    assert (score.gap, scored(timed).gap) == (0.05, BENCH.gap)
    again = scored(recorded(tmp_path, BENCH.replace(gap=0.05)))
    assert again.gap == 0.05
    for one, other in zip(score.stretches, again.stretches, strict=True):
        for name, value in vars(other.run).items():
            assert getattr(one.fixed_gap, name) == pytest.approx(value, rel=1e-9), name
        assert vars(other.fixed_gap) == pytest.approx(vars(other.run), rel=1e-9)
    rig, squares = Rig(BENCH.replace(gap=0.05)), []
    # The force changes at the first tick of the second part.
    for end in (12.005, 24.0):
        instants = np.linspace(rig.time, end, 24_001)[1:]
        duration, x = end - rig.time, rig.run(end, instants).samples['x']
        squares.append(duration * np.mean(x**2))
        rig.change(rig.parameters.replace(**LOUDER))
    rms = math.sqrt(sum(squares) / 24.0)
    assert score.overall.fixed_gap.x_rms == pytest.approx(rms, rel=1e-4)


def test_amplitudes_are_those_of_whole_cycles_up_to_the_end():
    """Of the middle of each cycle; a cycle at the start that is not whole is left out."""
    rig = BENCH.replace(gap=5.0, friction=0.0)
    cycle = math.tau / rig.force_frequencies[0]
    stretch = replayed(rig, 20.4, InitialConditions(initial_primary_position=0.01))
    time, largest = amplitudes(stretch)
    assert len(time) == 20
    assert time == pytest.approx(stretch.end - (np.arange(20)[::-1] + 0.5) * cycle)
    for middle, value in zip(time, largest, strict=True):
        inside = np.abs(stretch.samples['time'] - middle) <= 0.5 * cycle
        assert value == pytest.approx(np.abs(stretch.samples['x'][inside]).max(), rel=0.05)


def test_what_the_control_did(score):
    rig = Rig(BENCH, control=TIMED)
    for stretch in score.stretches:
        before = sum(rig.energies)
        hits = rig.run(stretch.end).impacts()
        assert stretch.control == 'timed'
        assert stretch.run.actuator_energy == pytest.approx(sum(rig.energies) - before)
        assert stretch.run.total_impulse == pytest.approx(hits['impulse'].sum())
        assert stretch.run.largest_impulse == hits['impulse'].max()
        rig.change(rig.parameters.replace(**LOUDER))
    whole = score.overall
    assert whole.run.actuator_energy == pytest.approx(sum(rig.energies))
    assert whole.run.x_rms < whole.fixed_gap.x_rms < 0.3 * whole.alone.x_rms
    assert whole.fixed_gap.actuator_energy == whole.alone.impacts == 0
    assert (score.differences, score.faults, score.exit_code) == (0, (), 0)


def test_the_work_of_a_controllers_force(tmp_path):
    """A constant force F does F times the way; the references are without it."""
    external = GapControlParameters(gap_control='external', gap_min=0.001, gap_max=0.1)
    rig = RecordedRig(LIVELY, control=external, offset=0).start()
    rig.run(1, order=lambda: Order(force=2.5)).run(999)
    score = scored(rig.save(tmp_path / 'bag'))
    twin = Rig(LIVELY, control=external)
    twin.advance(0.005)
    twin.order(Order(force=2.5))
    begin, end = twin.sample().x, twin.run(5.0, [5.0]).samples['x'][-1]
    whole = score.overall
    assert whole.run.active_work == pytest.approx(2.5 * (end - begin), rel=1e-6)
    assert whole.fixed_gap.active_work == whole.alone.active_work == 0.0
    assert 'by the active force [' in score_table([score]).text()


def test_stretches_that_a_fixed_gap_does_not_have(tmp_path):
    """Where the gap was changed, the reference has no change; its parts are those of the run."""
    rig = RecordedRig(BENCH, offset=0).start().run(600).run(400, ('change', {'gap': 0.05}))
    shares = []
    bag = rig.run(400, ('change', LOUDER)).save(tmp_path / 'bag')
    score = scored(bag, progress=shares.append)
    lengths = [score.stretches[i].end - score.stretches[i].start for i in range(3)]
    assert lengths == pytest.approx([3.005, 2.0, 1.995])
    # The replay is half the work, the run with a fixed gap another quarter.
    assert shares == pytest.approx([0.5 * 3.005 / 7.0, 0.5 * 5.005 / 7.0, 0.5, 0.75])
    for name in ('run', 'fixed_gap', 'alone'):
        parts = [getattr(stretch, name) for stretch in score.stretches]
        assert [part.duration for part in parts] == pytest.approx(lengths)
        whole = getattr(score.overall, name)
        assert sum(part.force_work for part in parts) == pytest.approx(whole.force_work)
        assert sum(part.impacts for part in parts) == whole.impacts


def test_a_motion_that_does_not_settle(tmp_path):
    """A free vibration that dies out has no final amplitude, and nothing to compare with."""
    free = OFF_RESONANCE.replace(force_amplitudes=(0.0,), gap=1e3)
    start = InitialConditions(initial_primary_position=1.0)
    rig = RecordedRig(free, start, rate=5.0, offset=0).start().run(500)
    score = scored(rig.save(tmp_path / 'bag'))
    assert score.stretches[0].settling_time is None
    assert score.overall.run.x_max == 1.0


def test_the_command(timed, tmp_path, capsys, monkeypatch):
    pytest.importorskip('matplotlib')
    monkeypatch.setattr('impact_damper_ros.cli.command_line._REPORT_PERIOD', 0.0)
    other = recorded(tmp_path, BENCH, seconds=5, name='other')
    names = {name: tmp_path / f'score.{name}' for name in ('json', 'png')}
    files = ['--json', names['json'], '--figure', names['png'], '--score-gap', '50 mm']
    assert main(['--score', str(timed), str(other), *map(str, files)]) == 0
    runs = json.loads(names['json'].read_text())['runs']
    assert [len(run['stretches']) for run in runs] == [2, 2]
    assert runs[0]['overall']['run']['actuator_energy'] > 0.0
    assert runs[0]['stretches'][1]['cause'] == 'force_amplitudes = [1.8] N (was [1.2] N)'
    assert names['png'].read_bytes().startswith(b'\x89PNG')
    printed = capsys.readouterr()
    assert printed.out.count('log reproduced') == 2
    assert printed.out.count('fixed: gap 50 mm') == 2
    # How far it is, where there is no terminal for a progress bar
    shares = re.findall(r'^compare_run: scored (\d+) %$', printed.err, re.MULTILINE)
    assert len(shares) >= 4
    assert 0 <= int(shares[0]) < 50 < int(shares[-1]) <= 100
    with pytest.raises(SystemExit) as ended:
        main([str(timed), str(other)])
    assert ended.value.code == 2
    with pytest.raises(SystemExit):
        main([str(timed), '--score-gap', '0.05'])
