"""What compiled kernels are made from, where they are kept, and signals while they run."""

import ast
import errno
import inspect
import math
import os
import re
import subprocess
import sys
import textwrap
import threading
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from rigs import HORIZONTAL
from running import until

import impact_damper_ros.rig.compiled_run as compiled_run
import impact_damper_ros.rig.rig as rig_module
import impact_damper_ros.rig.run_result as run_result
from impact_damper_ros import Rig, find_orbits
from impact_damper_ros.fit.sample_kernels import steady_sum
from impact_damper_ros.motion import kernels
from impact_damper_ros.motion.flight import motion_at
from impact_damper_ros.motion.kept_kernels import MachineCode

ROOT = Path(__file__).parents[2]


def test_names_are_unique():
    with pytest.raises(ValueError, match='two kernels named motion_at'):
        kernels.kernel(motion_at)


def test_kernels_raise_nothing_to_a_constant_power():
    """Compiled, that is a product; otherwise it is libm's `pow`, which may differ from it."""
    for name, function in kernels._KERNELS.items():
        code = ast.parse(textwrap.dedent(inspect.getsource(function)))
        powers = [
            node.right
            for node in ast.walk(code)
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)
        ]
        assert not any(isinstance(n, ast.Constant) for power in powers for n in ast.walk(power)), (
            name
        )


def test_kernels_are_kept_where_they_may_be(tmp_path, monkeypatch):
    pytest.importorskip('numba')
    blocked = tmp_path / 'a file'
    blocked.write_text('not a directory')
    monkeypatch.setenv('HOME', str(blocked))
    monkeypatch.setenv('XDG_CACHE_HOME', str(blocked))
    monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
    find = kernels.directory.__wrapped__
    assert find() is None
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    place = find()
    assert place.parent == tmp_path / 'cache' / 'impact_damper_ros'
    assert find() == place
    monkeypatch.setattr(kernels, '_compiler_digest', lambda: 'another compiler')
    assert find() != place


def test_digest_depends_on_what_kernels_do(monkeypatch):
    def digest_with(text, **names):
        space = {'copysign': math.copysign, 'LIMIT': 3.0, **names}
        exec(text, space)
        known = {name: space[name] for name in ('turned', 'below', 'beside') if name in space}
        monkeypatch.setattr(kernels, '_KERNELS', known)
        return kernels._digest('turned')

    pytest.importorskip('numba')
    text = 'def turned(x):\n    """Turn."""\n    return copysign(x, LIMIT) + 1.0\n'
    one = digest_with(text)
    assert digest_with('# A comment\n\n' + text.replace('Turn.', 'Turn it.')) == one
    others = [
        digest_with(text.replace('1.0', '2.0')),
        digest_with(text.replace('+', '-')),
        digest_with(text, LIMIT=4.0),
    ]
    assert len({one, *others}) == 4
    # What it calls counts, what stands beside it does not, whether it is loaded by then or not
    assert digest_with(text + 'def beside(x):\n    return x\n') == one
    calls = text.replace('+ 1.0', '+ below(x)') + 'def below(x):\n    return x\n'
    assert digest_with(calls) != digest_with(calls.replace('return x\n', 'return -x\n'))
    # An attribute with the name of a kernel that another module has
    reads = digest_with(text.replace('+ 1.0', '+ x.beside'))
    kernels._KERNELS['beside'] = digest_with
    assert kernels._digest('turned') == reads


def test_kept_kernels_share_no_names():
    """The loader takes the first of two functions of one name, which another process compiled."""
    pytest.importorskip('numba')
    Rig(HORIZONTAL, compiled=True).run(9.0)
    find_orbits(HORIZONTAL, (1, 2), simulate=False)
    # The newest of each form: those of other sources stay
    files = sorted(kernels.directory().iterdir(), key=lambda file: file.stat().st_mtime)
    newest = {tuple(file.name.split('-')[::2]): file for file in files}
    kept = [MachineCode.read(file).code for file in newest.values()]
    names = [set(re.findall(rb'_ZN17impact_damper_ros[\w.$]+', code)) for code in kept]
    assert len(kept) > 1
    assert all(names)
    assert not [one & other for one, other in combinations(names, 2) if one & other]


KEPT = """
import sys
from impact_damper_ros import GapControlParameters, Rig, RigParameters, find_orbits

rig = Rig(RigParameters(gravity=0.0), compiled=True)
rig.run(9.0)
controlled = Rig(rig.parameters, control=GapControlParameters(gap_control='timed'), compiled=True)
controlled.run(60.0)
orbits = find_orbits(rig.parameters, (1, 2), simulate=False).orbits
print(sorted(name for name in sys.modules if name.split('.')[0] == 'numba'))
if {more}:
    import numba

    Rig(rig.parameters, law=numba.njit(lambda seen, memory: (9.0, -9.0)), compiled=True).run(9.0)
    again = Rig(rig.parameters, compiled=True)
    again.run(9.0)
    print(again.snapshot() == rig.snapshot())
print(controlled.snapshot(), orbits)
"""


def test_what_is_kept_is_loaded_without_numba():
    """But for its extension modules; and numba works beside it, if it is needed later."""
    pytest.importorskip('numba')

    def lines(more):
        words = [sys.executable, '-c', KEPT.replace('{more}', str(more))]
        return subprocess.check_output(words, text=True, cwd=ROOT).splitlines()

    lines(more=False)
    modules, result = lines(more=False)
    assert modules == "['numba._dynfunc', 'numba._helperlib', 'numba._version']"
    assert lines(more=True) == [modules, 'True', result]


def test_compiled_code_that_cannot_be_kept_serves_this_process(caplog, monkeypatch):
    """As on a full disk."""
    pytest.importorskip('numba')

    def write(*_):
        raise OSError(errno.EFBIG, 'File too large')

    monkeypatch.setattr(kernels, '_compile', lambda *_: (lambda number: number + 1, code))
    monkeypatch.setattr(kernels, '_ENTRIES', {})
    monkeypatch.setattr(MachineCode, 'write', write)
    code = MachineCode(b'', '', '', ())
    assert kernels.compiled_kernel('loop', (5,))(5) == 6
    assert 'cannot be kept (File too large)' in caplog.text


@pytest.mark.parametrize(
    ('installed', 'words'),
    [
        (None, 'numba is not installed'),
        ('0.58.1', 'numba 0.58.1 is too old'),
        ('0.59.0', ''),
        ('0.69.0rc1', 'numba 0.69.0rc1 is not known yet'),
    ],
)
def test_what_runs_on_without_a_compiler_says_so(installed, words, monkeypatch, caplog):
    monkeypatch.setattr(kernels, 'numba_version', lambda: installed)
    monkeypatch.setattr(kernels, '_PATIENCE_S', 0.0)
    assert kernels.has_numba.__wrapped__() == (not words)
    if words:
        until(lambda: caplog.records)
        assert caplog.records[0].message.startswith(f'{words}: long runs take')


@pytest.mark.parametrize('elsewhere', [False, True], ids=['here', 'elsewhere'])
def test_compiling_and_damage_are_reported_and_loading_is_not(
    elsewhere, caplog, monkeypatch, tmp_path
):
    """Elsewhere, a process compiles what this one then loads."""
    pytest.importorskip('numba')
    monkeypatch.setattr(kernels, '_ELSEWHERE', threading.Event())
    if elsewhere:
        kernels.compile_elsewhere()
        monkeypatch.setattr(kernels, '_compile', None)
    monkeypatch.setattr(kernels, 'directory', lambda: tmp_path)
    arguments = (1.0, 2.0, 0.0, 0.5)
    fine = ['compiling the simulator']
    damaged = [f'the compiled code kept in {tmp_path}/chatter_duration-', *fine]
    cases = [
        (None, fine),
        (None, []),
        (lambda data: data[: len(data) // 2], damaged),
        (lambda data: data.replace(b'chatter', b'chat\xcaer'), damaged),
        (lambda data: bytes(len(data)), damaged),
        (lambda _: b'', damaged),
        (None, []),
    ]
    # A process for each case that compiles
    for damage, notices in cases[:3] if elsewhere else cases:
        for kept in tmp_path.iterdir() if damage else ():
            kept.write_bytes(damage(kept.read_bytes()))
        monkeypatch.setattr(kernels, '_ENTRIES', {})
        monkeypatch.setattr(kernels, '_REPORTED', set())
        assert kernels.compiled_kernel('chatter_duration', arguments)(*arguments) == 2.0
        said = [record.message for record in caplog.records]
        assert len(said) == len(notices)
        assert all(map(str.startswith, said, notices))
        assert len(list(tmp_path.iterdir())) == 1
        caplog.clear()


def test_another_kind_of_argument_is_other_code():
    kind = kernels._kind
    array = np.zeros((2, 3))
    for other in (array[:, ::2], array.T, array[0], array.astype('f4'), array.tolist(), 1, None):
        assert kind(other) != kind(array)
    rows, others = np.zeros(2, [('a', 'f8')]), np.zeros(2, [('b', 'f8')])
    assert len({kind((one, 1.0)) for one in (rows, others, rows[0])}) == 3
    # One row is in both orders, and of the same type as many
    assert kind(np.ones((1, 3))) == kind(np.ones((4, 3))) == kind(array)


def test_arrays_that_compiled_code_would_misread_are_refused(monkeypatch, tmp_path):
    pytest.importorskip('numba')
    monkeypatch.setattr(kernels, 'directory', lambda: tmp_path)
    monkeypatch.setattr(kernels, '_ENTRIES', {})
    monkeypatch.setattr(kernels, '_ARRAYS', {})
    wave, turned = np.arange(9.0), np.arange(8.0)
    assert kernels.call_kernel(steady_sum, wave, 0, turned) == 3.0 * 1.0 + 4.0 * 0.0
    assert kernels.call_kernel(steady_sum, wave, 2, turned[4:]) == 5.0 * 5.0 + 6.0 * 4.0
    for others in (turned[::2], turned.astype(int), turned[:, None]):
        with pytest.raises(
            TypeError, match=r'steady_sum is compiled for .* np\.ascontiguousarray'
        ):
            kernels.call_kernel(steady_sum, wave, 0, others)


@pytest.mark.parametrize('code', [False, True])
def test_more_events_than_the_first_table_takes(code, monkeypatch):
    if code:
        pytest.importorskip('numba')
    for module in (rig_module, run_result):
        monkeypatch.setattr(module, 'FIRST_ROWS', 16)
    run, rig = Rig(HORIZONTAL, compiled=code), Rig(HORIZONTAL)
    table = run.run(600.0).events
    assert len(table) > 100
    assert table['time'].tolist() == [event.time for event in rig.advance(600.0)]
    silent = Rig(HORIZONTAL, compiled=code)
    assert silent.run(600.0, record=False).event_count == len(table)
    assert silent.snapshot() == run.snapshot()


INTERRUPTED = """
import signal
from impact_damper_ros import Rig, RigParameters


class Alarm(Exception):
    pass


def alarm(*_):
    raise Alarm


rig = Rig(RigParameters(gravity=0.0), compiled=True)
rig.run(10.0)
signal.signal(signal.SIGALRM, alarm)
caught = 0
for delay in range(40):
    try:
        signal.setitimer(signal.ITIMER_REAL, 1e-4 * (1 + delay % 20))
        for _ in range(50):
            rig.run(rig.time + 5000.0)
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


def test_ctrl_c_as_compiled_code_returns(monkeypatch):
    """Python then takes it for a fault of that code; it once ended a sweep as one."""

    def interrupted(*_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError('returned a result with an exception set') from error

    run = Rig(HORIZONTAL, compiled=True)
    before = run.snapshot()
    monkeypatch.setattr(compiled_run, 'compiled_kernel', lambda *_, **__: interrupted)
    with pytest.raises(KeyboardInterrupt):
        run.run(10.0)
    assert run.snapshot() == before
