"""What is given does not act on the terminal; what bags hold is in `test_hostile_bags`."""

from pathlib import Path

import pytest

from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig

#: Clear the screen; set the title; a C1 control; turn the direction of writing.
ESCAPES = '\x1b[2J\x1b]0;x\x07\x9b31m\u202e'


def is_harmless(said):
    text = said.out + said.err
    return not any(sign in text for sign in '\x1b\x07\x9b\u202e') and text


def test_a_node_that_is_named(tmp_path, capsys):
    bag = tmp_path / 'bag'
    assert simulate_rig(['bench_rig', '--duration', '2', '--bag', str(bag), '--quiet']) == 0
    assert compare_run([str(bag), '--node', ESCAPES]) == 2
    assert is_harmless(capsys.readouterr())


@pytest.mark.parametrize(
    'words',
    [
        [f'{ESCAPES[:4]}.yaml'],
        ['escapes.yaml'],
        ['paper', '--set', f'gap={ESCAPES}'],
        ['paper', '--set', f'{ESCAPES}=1'],
        ['paper', '--change', f'{ESCAPES}:gap=1'],
    ],
)
def test_paths_and_values(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path('escapes.yaml').write_text('/**:\n  ros__parameters:\n    gap: "\\e[2J"\n')
    assert simulate_rig([*words, '--duration', '1']) == 2
    assert is_harmless(capsys.readouterr())
