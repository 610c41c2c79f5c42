"""What a shell completes, asked as argcomplete's function of the shell asks."""

import io
import re
from importlib import import_module
from pathlib import Path

import pytest
from setup_file import COMMANDS as ALL

import impact_damper_ros
from impact_damper_ros.cli import completion

ROOT = Path(impact_damper_ros.__file__).parents[1]
finders = pytest.importorskip('argcomplete.finders')
#: ROS reads the arguments of the node.
COMMANDS = [command for command in ALL if command != 'sim_node']


class EndError(Exception):
    """In place of the end of the process."""


class Finder(finders.CompletionFinder):
    """Without the file descriptor of the shell's function, which is a file of the tests here."""

    def _init_debug_stream(self):
        pass


def completions(command, words, monkeypatch):
    """Return how a line goes on."""
    line = f'{command} {words}'
    answer = io.StringIO()

    def end(_):
        raise EndError

    def ask(parser, **options):
        Finder()(parser, exit_method=end, output_stream=answer, **options)

    monkeypatch.setattr('argcomplete.autocomplete', ask)
    asked = {'_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': '\n'}
    for name, value in {**asked, 'COMP_LINE': line, 'COMP_POINT': str(len(line))}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(EndError):
        import_module(f'impact_damper_ros.cli.{command}').main([])
    return answer.getvalue().split('\n')


@pytest.mark.parametrize('command', COMMANDS)
def test_options(command, monkeypatch):
    parser = import_module(f'impact_damper_ros.cli.{command}')._parser()
    expected = [name for action in parser._actions for name in action.option_strings]
    assert set(completions(command, '-', monkeypatch)) >= set(expected)


@pytest.mark.parametrize(
    ('command', 'words', 'expected'),
    [
        ('simulate_rig', '', {'paper', 'bench_rig', 'mine.yaml', 'runs/'}),
        ('simulate_rig', 'pa', {'paper'}),
        ('simulate_rig', 'paper --set gap=', {''}),
        ('simulate_rig', 'paper --duration ', {''}),
        ('compare_run', 'ru', {'runs/'}),
        ('rig_page', '--start be', {'bench_rig'}),
    ],
)
def test_arguments(command, words, expected, tmp_path, monkeypatch):
    (tmp_path / 'mine.yaml').touch()
    (tmp_path / 'runs').mkdir()
    monkeypatch.chdir(tmp_path)
    found = {text.strip() for text in completions(command, words, monkeypatch)}
    assert {text for text in found if not text.startswith('-')} - {''} == expected - {''}


def test_all_commands_are_completed_by_the_line_of_the_page():
    text = (ROOT / 'docs' / 'reference' / 'commands.md').read_text(encoding='utf-8')
    (line,) = re.findall(r'^eval "\$\(register-python-argcomplete (.*)\)"$', text, re.MULTILINE)
    assert line.split() == COMMANDS


def test_without_a_shell_that_asks(monkeypatch):
    monkeypatch.delenv('_ARGCOMPLETE', raising=False)
    monkeypatch.setattr('argcomplete.autocomplete', None)
    completion.complete(import_module('impact_damper_ros.cli.simulate_rig')._parser())
