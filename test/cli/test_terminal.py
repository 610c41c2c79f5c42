"""What files hold does not act on the terminal."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

import impact_damper_ros
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig

ROOT = Path(impact_damper_ros.__file__).parents[1]
#: Clear the screen; set the title; a C1 control; turn the direction of writing.
ESCAPES = '\x1b[2J\x1b]0;x\x07\x9b31m\u202e'


def is_harmless(said):
    text = said.out + said.err
    return not any(sign in text for sign in '\x1b\x07\x9b\u202e') and text


@pytest.fixture
def foreign(tmp_path):
    """Write a bag whose names hold escape sequences."""
    path = tmp_path / f'bag{ESCAPES[:4]}.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2', library=ESCAPES)
        schema = writer.register_schema(f'std_msgs/msg/{ESCAPES}', 'ros2msg', b'string data\n')
        channel = writer.register_channel(f'/{ESCAPES}', 'cdr', schema)
        writer.add_message(channel, 1, b'\0\1\0\0\2\0\0\0a\0', 1)
        writer.finish()
    return path


@pytest.mark.parametrize('main', [compare_run, replay_run, recover_run])
def test_names_in_bags(main, foreign, capsys):
    main([str(foreign)])
    assert is_harmless(capsys.readouterr())


def test_node_names_in_bags(tmp_path, capsys):
    """A whole recording, of which the text says the names of node and topics."""
    bag = tmp_path / 'bag'
    assert simulate_rig(['bench_rig', '--duration', '2', '--bag', str(bag), '--quiet']) == 0
    assert compare_run([str(bag), '--node', ESCAPES]) == 2
    assert is_harmless(capsys.readouterr())


def test_paths_and_values(tmp_path, capsys):
    path = tmp_path / f'{ESCAPES[:4]}.yaml'
    assert simulate_rig([str(path), '--duration', '1']) == 2
    assert is_harmless(capsys.readouterr())
    path.write_text('/**:\n  ros__parameters:\n    gap: "\\e[2J"\n')
    assert simulate_rig([str(path), '--duration', '1']) == 2
    assert is_harmless(capsys.readouterr())
    assert simulate_rig(['paper', '--duration', '1', '--set', f'gap={ESCAPES}']) == 2
    assert is_harmless(capsys.readouterr())


def test_tests_can_interrupt_in_the_background_of_a_script():
    """SIGINT is ignored there by inheritance, which children of the tests must not inherit."""
    one = 'test_a_run_that_is_stopped_is_whole[SIGINT]'
    file = ROOT / 'test' / 'cli' / 'test_interruption.py'
    words = [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', f'{file}::{one}']
    done = subprocess.run(
        ['sh', '-c', 'trap "" INT; exec "$@"', 'sh', *words],
        cwd=ROOT,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert '1 passed' in done.stdout
