"""Options without effect, for lack of another one or beside it, are refused: tables `NEEDS`."""

from importlib import import_module

import pytest
from setup_file import COMMANDS

from impact_damper_ros.cli.command_line import command_parser
from impact_damper_ros.cli.needs import names_of

#: What each command works with.
GIVEN = {
    'compare_run': 'bag',
    'fit_rig': 'run.csv',
    'replay_run': 'bag',
    'simulate_rig': 'bench_rig',
    'solve_periodic': 'bench_rig --impacts 2',
    'sweep_rig': 'bench_rig -o a.csv',
}
#: A value of an option or a positional argument, by its metavar.
VALUES = {
    **dict.fromkeys(('FILE', 'DIR', 'BAG', 'NAME', 'RIG', 'PARAMS', 'FITTED'), 'name'),
    **dict.fromkeys(('N', 'T', 'HZ', 'K', 'TIME', 'KG', 'MU', 'R', 'V'), '1'),
    **dict.fromkeys(('GAMMA', 'ANGLE', 'ZETA', 'RATIO', 'GAP'), '0.1'),
    'BYTES': '1e6',
    'UNIT': 'mm',
    'FIGURE': 'a.png',
    'SIZE': '2g',
    '1,2,...': '1,2',
    'LOW:HIGH': '0.5:2',
    'NAME=VALUE': 'gap=1',
    'NAME=LOW:HIGH': 'gap=1:2',
    'NAME=PERCENT': 'damper_mass=2%',
    'TIME:NAME=VALUE': '1:gap=1',
    'MODULE:FUNCTION': 'a:b',
}
MODULES = {
    command: module
    for command in COMMANDS
    if hasattr(module := import_module(f'impact_damper_ros.cli.{command}'), 'NEEDS')
}


def words_of(names, term):
    """Return an option, or a positional argument, with a value."""
    name, _, value = term.partition(' ')
    action = names[name]
    if action.nargs == 0:
        return [name]
    value = value or [*(action.choices or ()), VALUES.get(action.metavar)][0]
    return [name, value] if action.option_strings else [value]


@pytest.mark.parametrize(
    ('command', 'row'), [(c, row) for c, module in MODULES.items() for row in module.NEEDS]
)
def test_an_option_that_would_be_ignored_is_refused(command, row, capsys):
    parser = MODULES[command]._parser()
    assert row in parser._needs
    names = names_of(parser)
    option, *terms = row

    def refusal(*more):
        """Return the last line of a command that its parser refuses for this row."""
        given = GIVEN.get(command, '').split()
        words = [w for term in (option, *more) for w in words_of(names, term)]
        fresh = MODULES[command]._parser()
        fresh._needs = [row]
        try:
            alone = option == '--parameters'
            given = given[: 0 if alone else 1 if '--settled' in words else None]
            fresh.parse_args([*given, *words])
        except SystemExit:
            return capsys.readouterr().err.splitlines()[-1].removeprefix(f'{command}: error: ')
        return ''

    if terms[0].startswith('only'):
        groups = parser._mutually_exclusive_groups
        together = [one for g in groups for a in g._group_actions for one in a.option_strings]
        allowed = {*terms[0].split()[1:]}
        others = {name for name in names if name[:2] == '--'} - {option, '--help', '--version'}
        for name in others - {*allowed, *together}:
            assert refusal(name) == f'{name} has no effect with {option}: leave one of them out'
        assert not any(map(refusal, allowed & others))
        return
    excluded = [term[3:] for term in terms if term.startswith('no ')]
    line = refusal(*excluded)
    assert line.startswith(f'{option} has no effect with')
    assert all(term.removeprefix('no ') in line for term in terms)
    for term in terms:
        assert refusal(*([] if term.startswith('no ') else [*excluded, term])) == ''


def test_what_is_given_counts_and_not_a_default():
    parser = command_parser('a', '', needs=[('--rate', '--states')])
    for name in ('--rate', '--states'):
        parser.add_argument(name, default='1')
    assert vars(parser.parse_args([])) == {'rate': '1', 'states': '1'}
    assert parser.parse_args(['--states', '1', '--rate', '2']).rate == '2'
    with pytest.raises(SystemExit):
        parser.parse_args(['--rate', '1'])
