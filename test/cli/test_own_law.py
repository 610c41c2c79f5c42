"""The option --law: the example of docs/controllers/laws.md, laws that fail, recorded runs."""

import re
import sys
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros.cli import sweep_rig
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main

ROOT = Path(impact_damper_ros.__file__).parents[1]


@pytest.fixture
def example(tmp_path, monkeypatch):
    """Write the file of the page to the present directory, and yield the page."""
    page = (ROOT / 'docs' / 'controllers' / 'laws.md').read_text(encoding='utf-8')
    source = re.search(r'^```python\n(.*?)^```', page, re.DOTALL | re.MULTILINE).group(1)
    (tmp_path / 'my_laws.py').write_text(
        source + '\n\ndef far(seen, memory):\n    return 1e9, 0.0\n'
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield page
    # Another page has a module of this name, too.
    sys.modules.pop('my_laws', None)


def largest(text):
    return re.search(r'largest \|X\| ([0-9.]+) m', text).group(1)


def test_the_example_is_the_timed_law(example, capsys):
    """And leaves what the page says."""
    rig = ['paper', '--duration', '500', '--set', 'gap_control_rate=5']
    assert main([*rig, '--law', 'my_laws:catch']) == 0
    own = capsys.readouterr().err
    assert 'gap control my_laws:catch: 314 commands' in own
    assert main([*rig, '--set', 'gap_control=timed']) == 0
    assert largest(own) == largest(capsys.readouterr().err)
    assert f'leaves {float(largest(own)):.2f} m of 100 m' in example


@pytest.mark.usefixtures('example')
def test_what_was_simulated_before_a_law_fails_is_written(capsys):
    arguments = ['paper', '--duration', '60', '--law', 'my_laws:far', '--states', 'states.csv']
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert 'the law my_laws:far returned (1000000000.0, 0.0) at 7.725' in said
    assert said.endswith('; the output so far is in states.csv.part\n')
    rows = Path('states.csv.part').read_text(encoding='utf-8').splitlines()
    assert float(rows[-1].split(',')[0]) == pytest.approx(7.725)


@pytest.mark.usefixtures('example')
def test_a_sweep_says_before_it_that_a_law_is_slow(capsys):
    pytest.importorskip('numba')
    source = Path('my_laws.py').read_text() + '\n\nimport numba\n\nfast = numba.njit(catch)\n'
    Path('swept_laws.py').write_text(source)
    for law, noted in (('fast', 0), ('catch', 1)):
        words = f'paper --vary gap=20,30 --law swept_laws:{law} -o {law}.csv'
        sweep_rig._announce(sweep_rig._grid(sweep_rig._parser().parse_args(words.split())))
        assert capsys.readouterr().err.count('with @numba.njit before its def') == noted


@pytest.mark.usefixtures('example')
def test_a_recording_is_replayed_with_its_law(capsys):
    """And with its control switched off, where the law has no say; without it, that is said."""
    words = '--duration 20 --set gap_control_rate=5 --change 15:gap_control=off --bag run --quiet'
    assert main(['paper', *words.split(), '--law', 'my_laws:catch']) == 0
    for command in (compare_run, replay_run):
        assert command(['run']) == 2
        assert 'take it as --law MODULE:FUNCTION' in capsys.readouterr().err
        assert command(['run', '--law', 'my_laws:catch', '--json', 'result.json']) == 0
    assert '"verdict": "identical"' in Path('result.json').read_text(encoding='utf-8')
    what_if = ['--set', 'gap_max=20', '--figure', 'what_if.png', '--quiet']
    assert replay_run(['run', '--law', 'my_laws:catch', *what_if]) == 0
    assert Path('what_if.png').stat().st_size > 10_000
