"""The launch file, read as a syntax tree: `launch` has no wheels."""

import ast

import pytest
from running import SOURCE

from impact_damper_ros.parameters.all_parameters import ALL_SPECS

PATH = SOURCE / 'launch' / 'rig.launch.py'
TREE = ast.parse(PATH.read_text())
CALLS = [node for node in ast.walk(TREE) if isinstance(node, ast.Call)]


def assigned(name):
    """Return what a name of the module stands for."""
    for node in TREE.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, 'target', None)]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            return node.value
    raise KeyError(name)


def entries(name):
    """Return the entries of a dictionary, those of others in it among them."""
    held = assigned(name)
    found = {}
    for key, value in zip(held.keys, held.values, strict=True):
        found |= entries(value.id) if key is None else {key.value: value}
    return found


def called(name):
    return [call for call in CALLS if getattr(call.func, 'id', '') == name]


ARGUMENTS = entries('ARGUMENTS')


def test_every_argument_that_is_used_is_declared():
    used = {
        call.args[0].value for call in called('Given') if isinstance(call.args[0], ast.Constant)
    }
    assert used | set(entries('OF_THE_NODE')) == set(ARGUMENTS)
    assert set(entries('OF_THE_NODE')) <= set(ALL_SPECS)
    assert set(ast.literal_eval(assigned('PATHS'))) < set(entries('OF_THE_NODE'))
    choices = ast.literal_eval(ARGUMENTS['lock_step'])[2:]
    assert {*choices, 'off'} - {''} == set(ALL_SPECS['lock_step'].choices)


def test_what_it_starts_is_there():
    scripts = (SOURCE / 'setup.py').read_text()
    started = []
    for call in called('program'):
        first = call.args[0]
        words = first.value.elts if isinstance(first, ast.Starred) else call.args
        package, program = [one.value for one in words]
        started += [program] * (package == 'impact_damper_ros')
    assert sorted(started) == ['rig_page', 'sim_node']
    assert all(f"'{name} = impact_damper_ros." in scripts for name in (*started, 'simulate_rig'))
    _, _, none, *controllers = ast.literal_eval(ARGUMENTS['controller'])
    assert none == 'none'
    there = {path.stem for path in (SOURCE / 'examples' / 'controllers').glob('[!t]*.py')}
    assert set(controllers) == there | {'timed_gap'}
    texts = {one.value for one in ast.walk(TREE) if isinstance(one, ast.Constant)}
    for folder, name in (('rviz', 'rig.rviz'), ('config', 'bench_rig.yaml')):
        assert {folder, name} <= texts
        assert (SOURCE / folder / name).is_file()
    # The Python that runs `ros2 launch`, also in a virtual environment
    assert not {'python', 'python3'} & texts


@pytest.mark.parametrize(
    ('factor', 'clock', 'lock_step', 'simulated'),
    [
        ('', '', '', False),
        ('1', '', '', False),
        ('1.00', '', '', False),
        ('1e0', 'false', '', False),
        ('0.2', '', '', True),
        ('0', '', '', True),
        ('', 'true', '', True),
        ('', '', 'both', True),
    ],
)
def test_the_other_nodes_use_the_time_of_the_rig_where_it_publishes_one(
    factor, clock, lock_step, simulated
):
    given = {'real_time_factor': factor, 'publish_clock': clock, 'lock_step': lock_step}
    (expression,) = ARGUMENTS['use_sim_time'].elts[0].args
    parts = [
        part.value if isinstance(part, ast.Constant) else given[part.args[0].value]
        for part in expression.elts
    ]
    assert eval(''.join(parts)) is simulated
