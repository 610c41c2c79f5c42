"""Long runs are runs of the simulator, to the last bit, plain and compiled."""

import json
import os
import random
import subprocess
import sys
from math import pi
from pathlib import Path

import numpy as np
import pytest

from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters, Simulator
from impact_damper_ros.rig import kernels as kernel_cache
from impact_damper_ros.rig.certificate import safe_step
from impact_damper_ros.rig.long_run import SAMPLE_TYPE, LongRun, Outcome
from rig.long_run_events import rows, without_mode
from rig.random_rigs import random_command, random_rig

ROOT = Path(__file__).parents[2]
GOLDEN = (
    {'gravity': 0.0},
    {'angle': pi / 4, 'gravity': 1.0, 'force_frequencies': (1.02,)},
    {'angle': pi / 4, 'gravity': 1.0, 'friction': 0.5, 'force_frequencies': (1.02,)},
)
ONE_HARMONIC = {'force_amplitudes': [1.0], 'force_frequencies': [0.9], 'force_phases': [0.1]}
#: Bounces on elastic stops under gravity, ever faster.
ENDLESS = (
    RigParameters(restitution_1=1.0, angle=1.0, force_amplitudes=[0.0]),
    InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=-1e-5),
)


@pytest.fixture(params=[False, True], ids=['plain', 'compiled'])
def compiled(request):
    if request.param:
        pytest.importorskip('numba')
    return request.param


def followed(rig, instants):
    """Return samples and events of the simulator at a series of instants."""
    events, samples = [], []
    for instant in instants:
        events += rig.advance(float(instant))
        samples.append(tuple(rig.sample()))
    return events, samples


def assert_same(run, rig, instants):
    """Compare a long run over some instants with the simulator, bit for bit."""
    stretch = run.advance(float(instants[-1]), instants)
    events, samples = followed(rig, instants)
    assert stretch.outcome == Outcome.COMPLETE
    assert stretch.reason == ''
    assert stretch.samples.tolist() == samples
    assert without_mode(stretch.events) == rows(events)
    mine, its = run.snapshot(), rig.snapshot()
    assert mine == its
    return stretch


# Nine are more than are compiled as tuples; kernels for two are compiled in test_compiled.py.
@pytest.mark.parametrize('harmonics', [1, 9])
def test_random_rigs(compiled, harmonics):
    """Friction, slopes, air, one stop, all modes: samples, events and where it ends."""
    modes, happened = set(), 0
    for seed in range(40):
        parameters, initial = random_rig(
            f'long {seed}',
            force_amplitudes=[1.0 / (k + 1) for k in range(harmonics)],
            force_frequencies=[0.7 + 0.6 * k for k in range(harmonics)],
            force_phases=[0.1 * k for k in range(harmonics)],
            restitution_1=0.6 + 0.005 * seed,
        )
        run = LongRun(parameters, initial, compiled=compiled)
        rig = Simulator(parameters, initial)
        for end in (7.0, 7.0, 30.0):
            stretch = assert_same(run, rig, np.linspace(run.time, end, 23))
            modes |= set(stretch.events['mode'].tolist())
            happened += stretch.event_count
    assert happened > 1000
    assert modes >= {0, 1, 2, 3, 4, 5}


def test_stops_on_their_way(compiled):
    """Taken over from a simulator whose stops move: met, hit, arrived, in all modes."""
    kinds = set()
    for seed in range(120):
        rng = random.Random(seed)
        rig = Simulator(*random_rig(f'long {seed}', **ONE_HARMONIC, restitution_1=0.7))
        rig.advance(rng.uniform(0.0, 1.0))
        for _ in range(3):
            rig.move_stops(*random_command(rng, rig)[:2], 10 ** rng.uniform(-1, 1))
            run = LongRun.restore(rig.snapshot(), compiled=compiled)
            end = run.time + rng.uniform(0.0, 3.0)
            stretch = assert_same(run, rig, np.linspace(run.time, end, 5))
            kinds |= set(stretch.events['kind'].tolist())
    assert kinds >= set(EventKind) - {EventKind.CROSSING, EventKind.FREQUENCY_STEP}


def test_stops_that_follow_m(compiled):
    """Closed past m, they have its velocity on their way, and the samples show it."""
    following = 0
    for seed in range(60):
        rng = random.Random(seed)
        rig = Simulator(*random_rig(f'long {seed}', **ONE_HARMONIC, restitution_1=0.7))
        rig.advance(rng.uniform(0.0, 3.0))
        rig.change(rig.parameters.replace(gap=0.05 * rig.parameters.gap))
        run = LongRun.restore(rig.snapshot(), compiled=compiled)
        stretch = assert_same(run, rig, np.linspace(run.time, run.time + 0.2, 20))
        for s in stretch.samples.tolist():
            following += s[4] != s[2] and s[4] in s[7:]
    assert following > 20


def test_sides_of_x_are_taken_along(compiled):
    """At an impact at X = 0 the sign of X comes from the flight before."""
    seen = set()
    for nudge in range(-40, 41):
        rig = Simulator(
            RigParameters(gravity=0.0, damping=0.0, gap=2.0, force_amplitudes=[0.0]),
            InitialConditions(
                initial_primary_position=-1.0,
                initial_damper_velocity=2.0 / (pi / 2) + nudge * 2.0**-52,
            ),
        )
        run = LongRun.restore(rig.snapshot(), compiled=compiled)
        assert_same(run, rig, np.array([1.6]))
        seen.add(rig.snapshot()['origin']['side'])
    assert seen == {-1, 1}


@pytest.mark.parametrize('changes', GOLDEN)
def test_golden_rigs(compiled, changes):
    rig, run = (
        Simulator(RigParameters(**changes)),
        LongRun(RigParameters(**changes), compiled=compiled),
    )
    stretch = assert_same(run, rig, np.arange(0.0, 400.0, 0.5))
    assert len(stretch.impacts()) > 100
    assert len(stretch.impacts(1)) + len(stretch.impacts(2)) == len(stretch.impacts())
    assert stretch.time_in_mode.sum() == pytest.approx(stretch.time, rel=1e-12)


def test_time_in_mode_is_that_between_events(compiled):
    run = LongRun(RigParameters(**GOLDEN[2]), compiled=compiled)
    parts = [run.advance(t) for t in (0.5, 3.0, 3.0, 40.0)]
    spent = sum(part.time_in_mode for part in parts)
    events = np.concatenate([part.events for part in parts])
    release = events['time'][events['kind'] == EventKind.RELEASE]
    stick = events['time'][events['kind'] == EventKind.STICK]
    assert spent[Mode.STICK] == pytest.approx(release.sum() - stick.sum(), rel=1e-13)
    assert spent[Mode.SLIDE_DOWN] + spent[Mode.SLIDE_UP] == pytest.approx(
        40.0 - spent[Mode.STICK], rel=1e-13
    )


def test_without_recording_it_goes_the_same_way(compiled):
    runs = [LongRun(RigParameters(**GOLDEN[0]), compiled=compiled) for _ in range(2)]
    silent = runs[0].advance(300.0, record=False)
    told = runs[1].advance(300.0)
    assert len(silent.events) == 0
    assert silent.event_count == told.event_count == len(told.events)
    assert runs[0].snapshot() == runs[1].snapshot()


def test_more_events_than_one_array_takes(compiled, monkeypatch):
    """A gap this small has thousands of impacts, which take several arrays."""
    monkeypatch.setattr('impact_damper_ros.rig.long_run._ROWS', 500)
    parameters = RigParameters(gap=0.02, gravity=0.0, restitution_1=0.95, restitution_2=0.95)
    run, rig = LongRun(parameters, compiled=compiled), Simulator(parameters)
    stretch = assert_same(run, rig, np.array([30.0]))
    assert len(stretch.events) > 1000


def test_events_without_end_are_an_outcome(compiled):
    parameters, initial = ENDLESS
    run = LongRun(parameters, initial, compiled=compiled)
    stretch = run.advance(10.0, np.array([0.0, 10.0]), most_events=5000)
    assert stretch.outcome == Outcome.TOO_MANY_EVENTS
    assert stretch.event_count == 5000
    assert len(stretch.events) == 5000
    assert len(stretch.samples) == 1
    assert run.time == stretch.time == stretch.events['time'][-1]
    assert '5000 events from 0.0 s to 0.0' in stretch.reason
    # It goes on from there, and the way is that of the simulator.
    later = run.advance(2.0 * run.time)
    rig = Simulator(parameters, initial)
    assert rows(rig.advance(run.time)) == without_mode(stretch.events) + without_mode(later.events)


def test_a_runaway_is_an_outcome(compiled, monkeypatch):
    """The simulator raises an error in its place."""
    if compiled:
        pytest.skip('numbers in compiled code cannot be changed')
    monkeypatch.setattr('impact_damper_ros.rig.run_loop.MOST_AT_ONCE', 50)
    monkeypatch.setattr('impact_damper_ros.rig.run_loop.least_step', lambda horizon: horizon)
    stretch = LongRun(*ENDLESS, compiled=False).advance(10.0)
    assert stretch.outcome == Outcome.RUNAWAY
    assert stretch.event_count == 51
    assert 'events without end at' in stretch.reason


def test_hand_over_and_back(compiled):
    parameters = RigParameters(**GOLDEN[2])
    alone = Simulator(parameters)
    alone.advance(50.0)
    alone.change(RigParameters(**{**GOLDEN[2], 'gap': 20.0}))
    alone.advance(120.0)

    first = Simulator(parameters)
    first.advance(21.3)
    run = LongRun.restore(first.snapshot(), compiled=compiled)
    run.advance(50.0)
    run.change(RigParameters(**{**GOLDEN[2], 'gap': 20.0}))
    run.advance(80.0)
    last = run.simulator()
    last.advance(120.0)
    assert last.snapshot() == alone.snapshot()
    assert run.parameters.gap == 20.0
    assert run.mode == Mode.SLIDE_UP or run.mode == Mode.SLIDE_DOWN


def test_an_impact_with_which_the_rig_starts(compiled):
    initial = InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=1.0)
    run = LongRun(RigParameters(), initial, compiled=compiled)
    rig = Simulator(RigParameters(), initial)
    stretch = assert_same(run, rig, np.array([0.0, 5.0]))
    assert stretch.events[0]['kind'] == EventKind.IMPACT
    assert stretch.events[0]['time'] == 0.0
    assert len(run.advance(6.0).events) == len(rig.advance(6.0))


def test_what_it_cannot_do(compiled):
    run = LongRun(RigParameters(), time=2.0, compiled=compiled)
    with pytest.raises(ValueError, match=r'cannot advance to 1\.0 s: .* not before 2\.0 s'):
        run.advance(1.0)
    for instants in ([1.0, 3.0], [3.0, 2.5], [3.0, 5.0]):
        with pytest.raises(ValueError, match=r'instants must ascend from 2\.0 s to 4\.0 s'):
            run.advance(4.0, instants)
    assert run.time == 2.0
    assert run.advance(2.0, [2.0]).samples.dtype == SAMPLE_TYPE


def python(code, **environment):
    """Start a program that prints something."""
    return subprocess.Popen(
        [sys.executable, '-c', code],
        env={**os.environ, 'PYTHONPATH': str(ROOT), **environment},
        stdout=subprocess.PIPE,
        text=True,
    )


# One kernel, kept as the loops are, which take long to compile
SMALL = """
import numba
from impact_damper_ros.rig import Simulator, kernels
with kernels.compiling_alone(kernels.stamp(), 'small'):
    (step,) = kernels.compiled('safe_step', form='small')
    step.compile((numba.float64,) * 5)
print(sum(step.stats.cache_hits.values()), step(1.0, -1.0, 0.0, 0.0, 7.0))
"""


def test_two_processes_compile_at_once_and_one_result_is_kept(tmp_path):
    pytest.importorskip('numba')
    processes = [python(SMALL, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    told = [process.communicate(timeout=300)[0].split() for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    # One of them loads what the other has compiled.
    assert sorted(hits for hits, _ in told) == ['0', '1']
    code = sorted(tmp_path.rglob('*.nbc'))
    assert len(code) == 1
    written = code[0].stat().st_mtime_ns
    again, _ = python(SMALL, NUMBA_CACHE_DIR=str(tmp_path)).communicate(timeout=300)
    told.append(again.split())
    assert told[-1][0] == '1'
    assert code[0].stat().st_mtime_ns == written
    assert sorted(tmp_path.rglob('*.nbc')) == code
    assert {value for _, value in told} == {repr(safe_step(1.0, -1.0, 0.0, 0.0, 7.0))}


RUN = """
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.long_run import LongRun
run = LongRun(RigParameters(gravity=0.0), compiled=True)
run.advance(100.0)
print(sum(run._loop._loop.stats.cache_hits.values()), run.snapshot())
"""


def test_a_compiled_loop_is_kept_for_other_processes():
    pytest.importorskip('numba')
    LongRun(RigParameters(gravity=0.0), compiled=True).advance(100.0)
    # It was compiled, or loaded, by one process at a time.
    assert kernel_cache.stamp().with_name('run_through_1.lock').exists()
    told, _ = python(RUN).communicate(timeout=300)
    run = LongRun(RigParameters(gravity=0.0), compiled=False)
    run.advance(100.0)
    assert told == f'1 {run.snapshot()}\n'


def test_the_cache_goes_where_it_may(tmp_path, monkeypatch):
    blocked = tmp_path / 'a file'
    blocked.write_text('not a directory')
    monkeypatch.setenv('HOME', str(blocked))
    monkeypatch.setenv('XDG_CACHE_HOME', str(blocked))
    monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
    assert kernel_cache.stamp_file() is None
    with kernel_cache.compiling_alone(None, 'any'):
        pass
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    stamp = kernel_cache.stamp_file()
    assert stamp.is_relative_to(tmp_path / 'cache' / 'impact_damper_ros')
    before = stamp.stat()
    assert kernel_cache.stamp_file() == stamp
    assert stamp.stat().st_mtime_ns == before.st_mtime_ns == 0
    monkeypatch.setattr(kernel_cache, '_digest', lambda: 'other sources')
    assert kernel_cache.stamp_file().parent != stamp.parent


@pytest.mark.skipif(os.geteuid() != 0, reason='only the superuser can give files away')
@pytest.mark.parametrize('place', ['impact_damper_ros', 'the folder', 'a file'])
def test_a_cache_of_somebody_else_is_not_used(place, tmp_path, monkeypatch):
    """What is in it would be run with the rights of whoever loads it."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'shared'))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'own'))
    stamp = kernel_cache.stamp_file()
    assert stamp.is_relative_to(tmp_path / 'shared')
    planted = stamp.with_name('kernels.planted-1.nbi')
    planted.write_bytes(b'')
    assert kernel_cache.stamp_file() == stamp
    given = {'impact_damper_ros': stamp.parents[1], 'the folder': stamp.parent}.get(place, planted)
    os.chown(given, 12345, -1)
    assert kernel_cache.stamp_file().is_relative_to(tmp_path / 'own')


def test_a_cache_that_others_may_write_is_closed_or_passed_over(tmp_path, monkeypatch):
    shared = tmp_path / 'shared'
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(shared))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'own'))
    stamp = kernel_cache.stamp_file()
    # As a umask of 002 made them in earlier versions
    for directory in (stamp.parent, stamp.parents[1]):
        directory.chmod(0o775)
    assert kernel_cache.stamp_file() == stamp
    assert {d.stat().st_mode & 0o777 for d in (stamp.parent, stamp.parents[1])} == {0o755}
    # With the sticky bit nobody can put another directory in its place, without it anybody can
    shared.chmod(0o1777)
    assert kernel_cache.stamp_file() == stamp
    shared.chmod(0o777)
    assert kernel_cache.stamp_file().is_relative_to(tmp_path / 'own')


def test_snapshots_are_those_of_the_simulator(compiled):
    run = LongRun(RigParameters(**GOLDEN[1]), compiled=compiled)
    run.advance(77.0)
    stored = json.loads(json.dumps(run.snapshot(), allow_nan=False))
    rig = Simulator.restore(stored)
    assert_same(LongRun.restore(stored, compiled=compiled), rig, np.linspace(77.0, 99.0, 5))


INTERRUPTED = """
import signal
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.long_run import LongRun

class Alarm(Exception):
    pass

def ring(*_):
    raise Alarm

run = LongRun(RigParameters(gravity=0.0), compiled=True)
run.advance(10.0)
signal.signal(signal.SIGALRM, ring)
caught = 0
for delay in range(40):
    try:
        signal.setitimer(signal.ITIMER_REAL, 1e-4 * (1 + delay % 20))
        for _ in range(50):
            run.advance(run.time + 5000.0)
    except Alarm:
        caught += 1
print(caught)
"""


def test_signals_during_compiled_code_are_exceptions():
    """And no crash, as where their exception is raised while a result is made."""
    pytest.importorskip('numba')
    done = subprocess.run(
        [sys.executable, '-c', INTERRUPTED],
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == 40


def test_ctrl_c_as_compiled_code_returns():
    """Python then takes it for a fault of that code; it once ended a sweep as one."""

    def interrupted(*_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError('returned a result with an exception set') from error

    run = LongRun(RigParameters(gravity=0.0), compiled=False)
    before = run.snapshot()
    run._loop._loop = interrupted
    with pytest.raises(KeyboardInterrupt):
        run.advance(10.0)
    assert run.snapshot() == before
