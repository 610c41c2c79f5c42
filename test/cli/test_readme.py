"""What README.md and docs/ state of the commands is what they print, and every command runs."""

import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from docs.tutorial import PAGES as WORKED_THROUGH
from running import DEADLINE_S
from setup_file import COMMANDS

import impact_damper_ros
from impact_damper_ros import EventKind, ParameterError, Rig, load_parameters
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.parameters.all_parameters import ALL_SPECS

ROOT = Path(impact_damper_ros.__file__).parents[1]
README = ROOT / 'README.md'
PAGES = [README, *sorted((ROOT / 'docs').rglob('*.md'))]
#: Those that test/docs/test_tutorials.py works through from top to bottom.
TUTORIALS = sorted([README, *WORKED_THROUGH])
#: The recording that the pages speak of.
BAG = 'runs/run_20261120_221707'
#: The one that a command of the README makes, for others after it.
MADE = 'runs/bench'
#: Of other packages: only what is said of this one in them is looked at.
FOREIGN = {
    *('cd', 'colcon', 'dask', 'docker', 'done', 'eval', 'export', 'for', 'git', 'make', 'mkdir'),
    *('pip', 'python', 'python3', 'ros2', 'rosbags-convert', 'rosdep', 'sed', 'source', 'sudo'),
    'touch',
}
#: Less of the same, so that it does not take minutes: what is replaced, by what.
LESS = (
    ('--duration 3600', '--duration 20'),
    ('--duration 400', '--duration 8 --psd-lines 10'),
    ('--duration 60 --states', '--duration 6 --states'),
    ('--duration 60 --set force_amplitudes=[0]', '--duration 4 --set force_amplitudes=[0]'),
    ('--duration 60 --bag runs/changed --change 20', '--duration 9 --bag runs/changed --change 3'),
    ('--change 40:gap_control', '--change 6:gap_control'),
    ('--duration 500', '--duration 20'),
    ('multisine_lines=128', 'multisine_lines=16'),
    ('=0.4:1.2:33', '=0.4:1.2:2'),
    ('--cycles 300 --watch 100', '--cycles 60 --watch 21'),
    ('--restitution 0.3:0.8', '--restitution 0.3:0.8 --mass-ratio 5% --levels 1:1'),
    ('--optimum greatest', '--optimum greatest --cycles 60 --watch 21'),
    ('--impacts 1:4 --cycles 1:3', '--impacts 1:2 --cycles 1:2'),
)
LESS_OF_PYTHON = (('(10, 60, 200)', '(24, 40, 3)'),)
#: Files of the sources or of the package, but those that a reader makes
NAMED = re.compile(r'`([a-z]+/[a-z0-9_/]+\.(?!html)[a-z]+)`')
RANGE = re.compile(r'(=-?[0-9.]+(?:Hz)?:-?[0-9.]+(?:Hz)?):\d+')


def blocks(page, language):
    """Return what stands between the fences of a page."""
    text = re.sub('^> ?', '', page.read_text(encoding='utf-8'), flags=re.MULTILINE)
    return re.findall(rf'^```{language}\n(.*?)^```', text, re.DOTALL | re.MULTILINE)


def lines_of(page):
    """Return each command line of a page, a continued one as one line."""
    text = '\n'.join(blocks(page, 'bash')).replace('\\\n', ' ')
    return [' '.join(line.split()) for line in text.splitlines() if line.strip()]


LINES = [(page, line) for page in PAGES for line in lines_of(page)]


def own_words(line):
    """Return the words of a command of this package; none of another one."""
    words = shlex.split(line, comments=True)
    if words[:3] == ['ros2', 'run', 'impact_damper_ros']:
        words = words[3:]
    return words if words and words[0] in COMMANDS else []


def without_output(line):
    """Return the words of a command without the names of what it writes."""
    words = re.sub(r'--output \S+', '', ' '.join(own_words(line)))
    return re.sub(r'(--figure|--rig-out) \S+', r'\1', words)


IN_TUTORIALS = {without_output(line) for page, line in LINES if page in TUTORIALS}
#: Each other command once, wherever it writes to.
OWN = [
    pytest.param(line, id=f'{page.relative_to(ROOT)}: {line[:60]}')
    for page, line in {
        without_output(line): (page, line)
        for page, line in LINES
        if own_words(line) and '...' not in line and without_output(line) not in IN_TUTORIALS
    }.values()
]


def test_readme_is_short():
    assert len(README.read_bytes()) <= 8_000


def test_the_message_of_the_readme_is_an_impact_of_the_bench_rig():
    shown = next(block for block in blocks(README, 'none') if 'effort' in block)
    message = yaml.safe_load(shown)
    rig, initial, _ = load_parameters('bench_rig')
    events = Rig(rig, initial).advance(20.0)
    impact = next(
        e for e in events if e.kind is EventKind.IMPACT and e.x == message['position'][0]
    )
    assert message['header']['frame_id'] == f'stop_{impact.stop}'
    assert message['name'] == ['primary', 'damper']
    stop = {1: 0.5, 2: -0.5}[impact.stop] * rig.gap
    assert message['position'][1] == pytest.approx(impact.x + stop, abs=1e-15)
    assert message['velocity'] == [impact.primary_velocity_after, impact.damper_velocity_after]
    gained = rig.primary_mass * (impact.primary_velocity_after - impact.primary_velocity_before)
    assert message['effort'] == pytest.approx([gained, -gained], rel=1e-12)


def anchors(page):
    """Return the anchors that a page's headings have where Markdown is shown."""
    text = re.sub(r'^```.*?^```', '', page.read_text(encoding='utf-8'), flags=re.S | re.M)
    return {
        re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-')
        for heading in re.findall(r'^#+ (.*)$', text, re.MULTILINE)
    }


@pytest.mark.parametrize(
    'page',
    [*PAGES, ROOT / 'CONTRIBUTING.md', ROOT / 'benchmarks' / 'README.md'],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding='utf-8')
    targets = re.findall(r'\]\(([^)\s]+)\)', text) + re.findall(r'<img src="([^"]+)"', text)
    for target in targets:
        if target.startswith(('http://', 'https://')):
            continue
        path, _, anchor = target.partition('#')
        found = (page.parent / path).resolve() if path else page
        assert found.exists(), f'{page.name}: {target}'
        if anchor:
            assert anchor in anchors(found), f'{page.name}: {target}'
    for name in NAMED.findall(text):
        places = (ROOT / name, ROOT / 'impact_damper_ros' / name, page.parent / name)
        assert any(place.is_file() for place in places), f'{page.name}: {name}'


def test_every_line_is_known():
    """So that a new command in a page cannot go by untried."""
    assert len(OWN) > 15
    for _, line in LINES:
        words = shlex.split(line, comments=True)
        first = next(word for word in words if '=' not in word)
        assert own_words(line) or first in FOREIGN, line
    replaced = ' '.join(line for _, line in LINES)
    for longer, _ in LESS:
        assert longer in replaced, f'{longer} stands in no page any more'


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    bag = tmp_path_factory.mktemp('recorded') / 'bag'
    assert simulate_rig(['bench_rig', '--duration', '10', '--bag', str(bag), '--quiet']) == 0
    return bag


@pytest.fixture
def place(tmp_path, monkeypatch, recording):
    """Go to a directory like that of the sources, with a recording in it."""
    for folder in ('config', 'examples'):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / BAG).parent.mkdir()
    for bag in (BAG, MADE):
        (tmp_path / bag).symlink_to(recording)
    # A rig such as `design_damper --rig-out damper.yaml` writes
    shutil.copy(ROOT / 'config' / 'bench_rig.yaml', tmp_path / 'damper.yaml')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def less(line):
    """Return a command line with less to do."""
    for longer, shorter in LESS:
        line = line.replace(longer, shorter)
    count = 5 if 'initial_' in line else 3
    line = RANGE.sub(rf'\1:{count}', line)
    return line + (' --jobs 1' if own_words(line)[0] == 'sweep_rig' else '')


def carry_out(line):
    """Run a command of this package in this process."""
    command, *words = own_words(less(line))
    main = import_module(f'impact_damper_ros.cli.{command}').main
    assert main(words) == 0


@pytest.mark.parametrize('line', OWN)
@pytest.mark.usefixtures('place')
def test_command(line, capfd):
    command, *words = own_words(line)
    checks = {
        'sim_node': ('rclpy', check_node),
        'set_rig': ('rclpy', check_settings),
        'rig_page': ('tornado', check_page),
    }
    if command in checks:
        library, check = checks[command]
        pytest.importorskip(library)
        check(words)
        return
    for extra in ('matplotlib', 'pyarrow'):
        pytest.importorskip(extra)
    if 'initial_' in line:
        line += ' --json basins.json'
    if command == 'simulate_rig' and MADE in words:
        Path(MADE).unlink()
    carry_out(line)
    said = capfd.readouterr()
    assert 'Traceback' not in said.err
    for option in ('--figure', '--impacts', '--events', '--states', '--json', '--bag', '-o'):
        if option in words and command != 'solve_periodic':
            assert Path(words[words.index(option) + 1]).stat().st_size > 100
    if 'initial_' in line:
        # Basins of attraction: more than one colour
        found = json.loads(Path('basins.json').read_text())
        assert len(found['attractors']) > 1


def check_page(words):
    """Read the line; that such commands run is in test/page/test_live_page.py."""
    from impact_damper_ros.cli import rig_page

    given = rig_page._parser().parse_args(words)
    assert given.bag is None or given.bag.exists()


def check_settings(words):
    """Judge the values as the node does; that such commands run is in test/cli/test_set_rig.py."""
    from impact_damper_ros.cli import set_rig
    from impact_damper_ros.cli.rig_options import values_of
    from impact_damper_ros.node.parameters import NodeParameters

    rig, initial, _ = load_parameters('bench_rig')
    present = NodeParameters.from_values({**rig.as_dict(), **initial.as_dict()})
    settings = set_rig._parser().parse_args(words).settings
    values = values_of(settings, present.as_dict(), '', 'set_rig')
    assert present.with_changes(values) != present


def check_node(words):
    """Have ROS read the line, and the node what ROS makes of it."""
    from rclpy.context import Context
    from rclpy.node import Node

    from impact_damper_ros.node.parameters import parameters_from_overrides

    if '$(ros2' in words:
        words = ['--ros-args', '--params-file', 'config/bench_rig.yaml']
    context = Context()
    context.init(words)
    try:
        node = Node('sim_node', context=context, enable_rosout=False)
        overrides = {name: p.value for name, p in node._parameter_overrides.items()}
        node.destroy_node()
    finally:
        context.try_shutdown()
    assert parameters_from_overrides(overrides, (), pytest.fail).rig.gap == 0.024


def test_parameters_that_are_set_on_the_node():
    """With `ros2 param set`, in the order of each page and of the presets; refusals as shown."""
    pytest.importorskip('rclpy')
    from rclpy.parameter import Parameter

    from impact_damper_ros.node.parameters import NodeParameters, readable, values_in

    tried = 0
    presets = sorted((ROOT / 'config').glob('*.yaml'))
    for page in (*PAGES, *presets):
        rig, initial, _ = load_parameters('bench_rig' if page in PAGES else page)
        node = NodeParameters.from_values({**rig.as_dict(), **initial.as_dict()})
        text = page.read_text(encoding='utf-8')
        shown = (
            r'ros2 param set (/\S+ \S+ (?:"[^"\n]*"|[^\s`]+))(?:\nSetting parameter failed: (.*))?'
        )
        for words, reason in re.findall(shown, text):
            target, name, value = shlex.split(words)
            assert target == '/sim_node'
            request = [Parameter(name, value=yaml.safe_load(value))]
            try:
                read = readable(request, node.rig, ALL_SPECS.__contains__)
                node, refused = node.with_changes(values_in(read)), ''
            except ParameterError as error:
                refused = str(error)
            assert refused == reason, words
            tried += 1
    assert tried > 12


def test_make_targets_and_scripts_are_there():
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    pages = '\n'.join(page.read_text(encoding='utf-8') for page in PAGES)
    targets = set(re.findall(r'^(?:`)?make ([a-z]+)', pages, re.MULTILINE))
    targets |= set(re.findall(r'`make ([a-z]+)', pages))
    assert {'demo', 'test'} <= targets
    for target in targets:
        assert re.search(rf'^{target}:', makefile, re.MULTILINE), target
    scripts = set(re.findall(r'python (benchmarks/\w+\.py)', pages))
    assert len(scripts) > 4
    assert all((ROOT / script).is_file() for script in scripts)


def test_check_of_first_events_runs():
    """The README gives its command, for many more flights."""
    module = re.search(r'python -m (\S+) --count 300000', README.read_text(encoding='utf-8'))[1]
    done = subprocess.run(
        # Plain: to compile its loop, which is kept nowhere, takes 7 s
        [sys.executable, '-m', module, '--count', '20', '--plain'],
        env={**os.environ, 'PYTHONPATH': f'{ROOT}{os.pathsep}{ROOT / "test"}'},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=True,
    )
    assert 'missed 0, false 0' in done.stdout


#: The pages of the library have its signatures, that of the gallery its scripts.
PYTHON = [
    pytest.param(text, id=f'{page.relative_to(ROOT)}: {text.splitlines()[0]}')
    for page in PAGES
    if page not in TUTORIALS and page.parent.name not in ('python', 'gallery')
    for text in blocks(page, 'python')
]


@pytest.mark.parametrize('text', PYTHON)
def test_python(text, place, monkeypatch):
    for extra in ('numba', 'pandas', 'pyarrow', 'matplotlib', 'xarray'):
        pytest.importorskip(extra)
    for name in re.findall(r"read_parquet\('(\w+\.parquet)'", text):
        line = next(line for page, line in LINES if name in line and page != README)
        # The table alone; `test_command` draws it
        carry_out(re.sub(r' --figure \S+', '', line))
    script = place / 'script.py'
    for longer, shorter in LESS_OF_PYTHON:
        text = text.replace(longer, shorter)
    script.write_text(text, encoding='utf-8')
    monkeypatch.setenv('MPLBACKEND', 'agg')
    runpy.run_path(str(script), run_name='__main__')
