"""
Write the exhibits of this version that are not there yet: recordings, and what the commands write.

    PYTHONPATH=test python -m museum.make

Later versions read them for ever, so that none is written twice: one that is there stays as it is,
and a later version adds a folder of its own. `VERSION` is raised with the package.
"""

import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import chdir, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path

from running import Running

from impact_damper_ros import load_parameters
from impact_damper_ros.bag.snapshots import mathematics
from impact_damper_ros.rig.snapshot import ARITHMETIC
from impact_damper_ros.sweep import Grid, Settling, sweep

VERSION = '1.0'
HERE = Path(__file__).parent
PLACE = HERE / VERSION
CONFIG, DOCS = (HERE.parents[1] / name for name in ('config', 'docs'))
#: Of a bag, bytes
LARGEST = 60_000
BENCH = ('bench_rig', '--rate', '20')
#: M on a spring of 5 Hz that stands upright: m falls on the lower stop and bounces there to rest.
UPRIGHT = ('--set', 'angle=1.5707963267948966', '--set', 'friction=0', '--set', 'gap=0.05')
BASE = ('--set', 'force_amplitudes=0', '--set', 'gap=0.004')
#: Runs of `simulate_rig`
RUNS = {
    'free': (*BENCH, '--duration', '4'),
    'control': (*BENCH, '--duration', '3', '--set', 'gap_control=timed'),
    'changes': (
        *(*BENCH, '--duration', '3', '--change', '1:gap=0.02', '--change', '2:angle=0.05'),
        *('--change', '2:force_amplitudes=[1.0]'),
    ),
    'base_record': (*BENCH, *BASE, '--base-record', CONFIG / 'base_record.csv', '--duration', '6'),
    'random_base': (
        *(*BENCH, *BASE, '--base-psd', CONFIG / 'random_base.csv', '--psd-lines', '20'),
        *('--seed', '3', '--duration', '4'),
    ),
    'chatter': (*BENCH, *UPRIGHT, '--set', 'force_amplitudes=[2.0]', '--duration', '2'),
    'one_sided': (
        *(*BENCH, *UPRIGHT, '--set', 'one_sided=true', '--set', 'force_amplitudes=[8.0]'),
        *('--duration', '3'),
    ),
    'split': (*BENCH, '--duration', '1.6', '--max-bag-duration', '1'),
}
#: Where the C library rounds its functions otherwise, as on a processor without fused operations
ELSEWHERE = {'other_functions': 'glibc.cpu.hwcaps=-FMA,-AVX2,-FMA_Usable,-AVX2_Usable,-FMA4'}
#: Those of the real node: its parameters, and what is set while it records
NODES = {
    'node_free': ((), ()),
    'node_control': (('gap_control:=amplitude',), ()),
    'node_changes': ((), ('gap=0.02', 'force_amplitudes=[1.0]')),
}
DESIGN = '--mass 5kg --frequency 10Hz --damping-ratio 2% --base 0.2g --restitution 0.6'
#: What commands write: the file, the command, and its other words
OUTPUTS = {
    'simulate_rig_impacts.csv': 'simulate_rig bench_rig --duration 3 --quiet --impacts',
    'simulate_rig_events.csv': 'simulate_rig bench_rig --duration 3 --quiet --events',
    'simulate_rig_states.csv': 'simulate_rig bench_rig --duration 3 --quiet --rate 20 --states',
    'solve_periodic.json': 'solve_periodic bench_rig --impacts 2 --cycles 1 --quiet --json',
    'solve_periodic_branch.csv': (
        'solve_periodic bench_rig --impacts 2 --cycles 1 --follow gap=0.022:0.025 --quiet --csv'
    ),
    'ring_down.json': 'ring_down bench_rig --from 40mm --json',
    'ring_down.csv': 'ring_down bench_rig --from 40mm --csv',
    'design_damper.json': f'design_damper {DESIGN} --mass-ratio 0.05 --json',
    'fit_rig.json': 'fit_rig MEASURED --rig bench_rig --json',
    'sweep_rig.json': (
        'sweep_rig bench_rig --vary gap=0.02,0.024 -o TABLE --overwrite --quiet --json'
    ),
    'replay_run.json': 'replay_run BAG --json',
    'replay_run_what_if.json': 'replay_run BAG --set gap=0.02 --json',
    'compare_run.json': 'compare_run BAG --quiet --json',
    'compare_run_score.json': 'compare_run --score BAG --quiet --json',
}


def command(name, *words, cwd=None, **environment):
    """Run a command of the package, and return its exit code and what it printed."""
    if environment or name == 'set_rig':
        ran = subprocess.run(
            [sys.executable, '-m', f'impact_damper_ros.cli.{name}', *map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            env={**os.environ, **environment},
        )
        return ran.returncode, ran.stdout + ran.stderr
    text = io.StringIO()
    with chdir(cwd or Path.cwd()), redirect_stdout(text), redirect_stderr(text):
        code = import_module(f'impact_damper_ros.cli.{name}').main([*map(str, words)])
    return code, text.getvalue()


def measure(scratch):
    """Write the motion of a rig as a laboratory would have it."""
    run = '--duration', 4, '--quiet', '--rate', 100, '--states', 'measured.csv'
    assert command('simulate_rig', 'bench_rig', *run, cwd=scratch)[0] == 0


def write_output(name, path, scratch, bag):
    """Let a command of this version write the file of a name; what it names is below `scratch`."""
    words = OUTPUTS[name].split()
    if 'MEASURED' in words:
        measure(scratch)
    if 'BAG' in words and not (scratch / 'run').exists():
        shutil.copytree(bag, scratch / 'run')
    places = {'MEASURED': 'measured.csv', 'BAG': 'run', 'TABLE': 'table.csv'}
    code, text = command(*(places.get(word, word) for word in words), path, cwd=scratch)
    assert path.exists(), text
    return code


def record_node(bag, scratch, parameters, changes):
    """Record the real node for a second, and end it as Ctrl-C does."""
    given = ('state_rate:=5.0', 'bag_directory:=runs', 'record:=true')
    words = [w for option in (*parameters, *given) for w in ('-p', option)]
    file = '--params-file', CONFIG / 'bench_rig.yaml'
    command_line = '-m', 'impact_damper_ros.cli.sim_node', '--ros-args', *file, *words
    with Running(scratch, *command_line) as node:
        node.until(lambda: 'recording  to' in node.output)
        if changes:
            # That takes a second in any case.
            code, text = command('set_rig', *changes)
            assert code == 0, text
        time.sleep(1.0)
        assert node.stop() == 0, node.output
    (made,) = (scratch / 'runs').iterdir()
    shutil.move(made, bag)


def cut(bag, other):
    """Leave a bag as a power cut leaves it: no metadata, and the end of the file lost."""
    bag.mkdir()
    (whole,) = other.glob('*.mcap')
    content = whole.read_bytes()
    (bag / whole.name).write_bytes(content[: len(content) * 2 // 3])


def said_of(bag):
    """Return what replay_run and compare_run say of a bag, with their exit codes."""
    said = {}
    for name, words in (('replay_run', ()), ('compare_run', ('--quiet',))):
        with tempfile.TemporaryDirectory() as place:
            result = Path(place) / 'said.json'
            code, text = command(name, bag, *words, '--json', result)
            held = json.loads(result.read_text()) if result.exists() else {'error': text}
        said[name] = {'exit_code': code, **held, 'bag': bag.name}
    return said


def half_of_a_sweep(path):
    """Leave the file of a sweep that was ended in its middle."""
    grid = Grid(load_parameters('bench_rig')[0], gap=[0.02, 0.022, 0.024], settling=Settling(200))

    class EndedError(Exception):
        pass

    def end(done):
        if done >= 2:
            raise EndedError

    try:
        sweep(grid, path, progress=end)
    except EndedError:
        assert path.with_name(path.name + '.part').exists()


def make():
    """Write what is not there."""
    bags, outputs, tables = (PLACE / name for name in ('bags', 'outputs', 'sweeps'))
    for folder in (bags, outputs, tables):
        folder.mkdir(parents=True, exist_ok=True)
    for name, words in RUNS.items():
        if not (bags / name).exists():
            assert command('simulate_rig', *words, '--quiet', '--bag', bags / name)[0] == 0
    for name, setting in ELSEWHERE.items():
        if not (bags / name).exists():
            words = *RUNS['changes'], '--quiet', '--bag', bags / name
            assert command('simulate_rig', *words, GLIBC_TUNABLES=setting)[0] == 0
    for name, (parameters, changes) in NODES.items():
        if not (bags / name).exists():
            with tempfile.TemporaryDirectory() as scratch:
                record_node(bags / name, Path(scratch), parameters, changes)
    if not (bags / 'cut').exists():
        cut(bags / 'cut', bags / 'changes')
    for bag in sorted(path for path in bags.iterdir() if path.is_dir()):
        size = sum(file.stat().st_size for file in bag.iterdir())
        assert size <= LARGEST, f'{bag} has {size} bytes'
        said = bag.with_suffix('.json')
        if not said.exists():
            said.write_text(json.dumps(said_of(bag), indent=1) + '\n')
            print(bag.name, size, json.loads(said.read_text())['replay_run'].get('verdict'))
    with tempfile.TemporaryDirectory() as scratch:
        for name in OUTPUTS:
            if not (outputs / name).exists():
                write_output(name, outputs / name, Path(scratch), bags / 'free')
                print(name)
    for suffix in ('csv', 'parquet'):
        if not (tables / f'gap.{suffix}').exists():
            grid = Grid(load_parameters('bench_rig')[0], gap=[0.02, 0.024], settling=Settling(200))
            sweep(grid, tables / f'gap.{suffix}')
    if not (tables / 'half.csv.part').exists():
        half_of_a_sweep(tables / 'half.csv')
    twin = PLACE / 'twin.yaml'
    if not twin.exists():
        with tempfile.TemporaryDirectory() as scratch:
            measure(scratch)
            given = 'measured.csv', '--rig', 'bench_rig', '--rig-out', twin
            assert command('fit_rig', *given, cwd=scratch)[0] == 0
    # Keys and columns there are those of the outputs above.
    subprocess.run([sys.executable, DOCS / 'interfaces.py'], check=True)
    about = PLACE / 'made_with.json'
    if not about.exists():
        numbers = {'arithmetic': ARITHMETIC, 'mathematics': mathematics()}
        about.write_text(json.dumps(numbers) + '\n')


if __name__ == '__main__':
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 101)
    make()
