"""
What the documentation has of the code: help, parameters, glossary, Python library, gallery.

    python docs/generated.py [--figures]

It writes these parts as Markdown that GitHub shows, with `--figures` those of the gallery, too. A
test compares the texts.
"""

import ast
import inspect
import os
import re
import shutil
import subprocess
import sys
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml
from numpydoc.docscrape import NumpyDocString

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from impact_damper_ros import EventKind, GapControlParameters, Rig, load_parameters  # noqa: E402
from impact_damper_ros.bag import rig_topics  # noqa: E402
from impact_damper_ros.bag.messages import JOINT_STATE, JointState, decode  # noqa: E402
from impact_damper_ros.bag.robot_description import robot_description  # noqa: E402
from impact_damper_ros.bag.snapshots import Snapshots  # noqa: E402

DOCS = ROOT / 'docs'
SCRIPTS = sorted((ROOT / 'examples' / 'gallery').glob('plot_*.py'))
GALLERY = DOCS / 'results' / 'gallery'
#: Titles of the pages of the library, and per page the modules and the rooms they take names from.
LIBRARY = {
    'simulate': ('Simulation', 'impact_damper_ros', 'parameters', 'rig'),
    'events': ('Events and samples', 'impact_damper_ros', 'motion'),
    'laws': ('Gap control', 'impact_damper_ros', 'control'),
    'orbits': ('Periodic motions', 'impact_damper_ros', 'orbits'),
    'sweeps': ('Sweeps', 'impact_damper_ros.sweep'),
    'bags': ('Recordings', 'impact_damper_ros.bag'),
    'replay': ('Replay', 'impact_damper_ros.replay'),
    'compare': ('Comparison', 'impact_damper_ros.compare'),
    'report': ('Reports', 'impact_damper_ros.report'),
}
LISTS = 'Parameters', 'Attributes', 'Returns', 'Yields', 'Raises', 'Other Parameters'
PROSE = 'Notes', 'References'


def tables(name: str, page: str) -> str:
    """Return a page with the present tables of parameters."""
    rig_parameters = import_module('impact_damper_ros.parameters.rig_parameters')
    structure = import_module('impact_damper_ros.parameters.structure')
    table = import_module('impact_damper_ros.cli.simulate_rig').parameter_table
    groups = {
        'parameters.md': [
            (rig_parameters.PARAMETER_SPECS, rig_parameters.INITIAL_SPECS),
            (structure.STRUCTURE_SPECS,),
        ],
        'laws.md': [(rig_parameters.GAP_CONTROL_SPECS,)],
    }
    present = iter([table(*specs) for specs in groups[name]])
    return re.sub(
        r'^\| parameter \| unit .*\n(\|.*\n)+', lambda _: next(present), page, flags=re.M
    )


def commands(page: str) -> str:
    """Return the page of the commands with their present help."""
    # argparse breaks lines by the width of the terminal.
    os.environ['COLUMNS'] = '96'

    def block(match: re.Match[str]) -> str:
        parser = import_module(f'impact_damper_ros.cli.{match[1]}')._parser()
        return f'## `{match[1]}`\n\n```text\n{parser.format_help()}```\n'

    return re.sub(r'^## `(\w+)`\n\n```text\n.*?^```\n', block, page, flags=re.M | re.S)


def glossary(page: str) -> str:
    """Return the glossary with the words of the page in the browser and their sentences."""
    path = ROOT / 'impact_damper_ros' / 'page' / 'static' / 'glossary.js'
    # The object is a Python literal, too.
    literal = re.search(r'TERMS = (\{.*?\n\});', path.read_text(encoding='utf-8'), re.DOTALL)
    assert literal is not None
    terms = sorted(ast.literal_eval(literal[1]).values(), key=lambda term: term[0].lower())
    words = '\n'.join(f'- **{term}**: {sentence}' for term, sentence in terms)
    return re.sub(r'^- \*\*.*\Z', f'{words}\n'.replace('\\', r'\\'), page, flags=re.M | re.S)


def library(stem: str) -> str:
    """Return a page of the Python library."""
    title, module, *rooms = LIBRARY[stem]
    surface = import_module(module)
    # A name that comes from another folder is documented there.
    places = tuple(f'{module}.{room}.' for room in rooms) or (f'{module}.',)
    things = {name: getattr(surface, name) for name in surface.__all__}
    own = {
        name: thing
        for name, thing in things.items()
        if callable(thing) and thing.__module__.startswith(places)
    }
    lines = [f'# {title} in Python', '', f'From `{module}`:', '', '| name | |', '| --- | --- |']
    lines += [
        f'| [`{name}`](#{name.lower()}) | {_cell(inspect.getdoc(thing))} |'
        for name, thing in own.items()
    ]
    for name, thing in own.items():
        lines += ['', f'## `{name}`', '', *_entry(name, thing)]
        if isinstance(thing, type):
            for member, value in _members(thing):
                lines += ['', f'### `{name}.{member}`', '', *_entry(member, value)]
    return '\n'.join(lines) + '\n'


def _cell(doc: str | None) -> str:
    """Return the first paragraph of a docstring for a table."""
    first = (doc or '').partition('\n\n')[0].replace('\n', ' ')
    return _inline(first).replace('|', r'\|')


def _members(cls: type) -> list[tuple[str, Any]]:
    """Return the documented methods and properties that a class defines."""
    return [
        (name, value)
        for name, value in vars(cls).items()
        if not name.startswith('_')
        and isinstance(value, (classmethod, staticmethod, property)) | inspect.isfunction(value)
        and getattr(value, '__doc__', None)
    ]


def _entry(name: str, thing: Any) -> list[str]:
    """Return signature and docstring of a function, class or property."""
    lines = []
    error = isinstance(thing, type) and issubclass(thing, Exception)
    if not error and not isinstance(thing, property):
        full = inspect.signature(getattr(thing, '__func__', thing))
        given = [one for one in full.parameters.values() if one.name != 'self']
        bare = [one.replace(annotation=full.empty) for one in given]
        signature = str(full.replace(parameters=bare, return_annotation=full.empty))
        signature = re.sub(r"<class '(\w+)'>", r'\1', signature)
        signature = re.sub(r'<function .*? at 0x\w+>', '...', signature)
        lines += ['```python', f'{name}{signature}', '```', '']
    doc = NumpyDocString(inspect.getdoc(thing) or '')
    for part in ('Summary', 'Extended Summary'):
        if text := doc[part]:
            lines += [*_prose(text), '']
    for part in LISTS:
        if rows := doc[part]:
            lines += [f'**{part}**', '', *(_row(*row) for row in rows), '']
    for part in PROSE:
        if text := doc[part]:
            lines += [f'**{part}**', '', *_prose(text), '']
    if text := doc['Examples']:
        lines += ['**Examples**', '', '```python', *text, '```', '']
    return lines[:-1]


def _row(name: str, kind: str, text: list[str]) -> str:
    """Return one parameter, result or error."""
    label = ' : '.join(f'`{part}`' for part in (name, kind) if part)
    return f'- {label}: {_inline(" ".join(line.strip() for line in text))}'.rstrip(': ')


def _prose(lines: list[str]) -> list[str]:
    return [_inline(line) for line in lines]


def _inline(text: str) -> str:
    """Return reStructuredText of one line as Markdown."""
    text = re.sub(r':\w+:`~?([^`]*)`', r'`\1`', text)
    return text.replace('``', '`')


#: When each topic of the node has a message, and its `frame_id`.
RATES = {
    'joint_states': ('`state_rate`, 200 a second; 10 a second while paused', 'empty; `paused`'),
    'impacts': ('at each impact', '`stop_1` or `stop_2`, the stop'),
    'gap_control': ('at each act of the control', 'the act'),
    'measurements': ('`measurement_rate`, 0', 'empty'),
    'snapshot': ('at the start, after each change, reset and pause', ''),
    'parameter_events': ('at each change of a parameter', ''),
    'diagnostics': ('once a second', 'empty'),
    'robot_description': ('at the start, and when a change is visible', ''),
    'theory': ('when more is known', ''),
    'clock': ('as `joint_states`, of a rig with simulated time', ''),
    'stop_commands': ('taken at each sample and measurement', 'not read'),
    'force_command': ('taken at each sample and measurement', 'not read'),
}


def messages(page: str) -> str:
    """Return the page of the node with the topics as they are offered, and sample messages."""
    tables = (rig_topics.RIG_TOPICS, rig_topics.LIVE_TOPICS, rig_topics.COMMAND_TOPICS)
    lines = [
        '| topic | reliability, durability, depth | messages | `frame_id` |',
        '| --- ' * 4 + '|',
    ]
    for key, topic in (pair for table in tables for pair in table.items()):
        qos = f'{topic.qos.reliability}, {topic.qos.durability}, {topic.qos.depth}'
        rate, frame = RATES[key]
        lines.append(f'| `{topic.name}` | {qos} | {rate} | {frame} |')
    parameters = load_parameters('bench_rig')[0]
    rig, made = Rig(parameters), rig_topics.RigMessages()
    event = next(one for one in rig.advance(2.0) if one.kind is EventKind.IMPACT)
    rig.advance(2.0)
    controlled = Rig(parameters, control=GapControlParameters(gap_control='timed'))
    controlled.advance(2.0)
    act = controlled.records[0]
    seen, stop_rates = rig.measure(0)
    views = (seen.x, seen.y, seen.stop_1, seen.stop_2), (seen.x_rate, seen.y_rate, *stop_rates)
    names = {key: f'/{topic.name}' for key, topic in rig_topics.RIG_TOPICS.items()}
    snapshots = Snapshots('/sim_node', names, {}, 200.0)
    snapshots.run = 32 * '0'
    samples = {
        'impacts': _echoed(made.impact(round(event.time * 1e9), event, 0.0)),
        'joint_states': _echoed(made.states(2 * 10**9, rig.sample(), 0.0, parameters.angle)),
        'gap_control': _echoed(made.control(round(act.time * 1e9), act)),
        'measurements': _echoed(made.measurement(2 * 10**9, *views)),
        'snapshot': _echoed_text(snapshots.text(0, 'start', {})),
        'robot_description': _echoed_text(robot_description(parameters)),
    }
    lines += ['', '### Sample messages', '']
    lines += [
        'As `ros2 topic echo` prints them, with fewer digits. Long texts are cut after 128',
        'characters.',
        '[Diagnostics](diagnostics.md) describes `/diagnostics` and `theory`,',
        '[commands of a controller](../controllers/interface.md) the topics that the node takes.',
    ]
    for key, echoed in samples.items():
        lines += ['', f'`{key}`:', '', '```yaml', *echoed, '```']
    text = '\n'.join(lines)
    head = '### Quality of service, rates, frames\n\n'
    return re.sub(
        rf'(?<={re.escape(head)}).*?(?=\n\n### Services)', lambda _: text, page, flags=re.DOTALL
    )


def _echoed(content: bytes) -> list[str]:
    """Return a JointState as `ros2 topic echo` prints it, with fewer digits."""
    message = decode(JOINT_STATE, content)
    assert isinstance(message, JointState)
    seconds, nanoseconds = divmod(message.stamp_ns, 10**9)
    lines = ['header:', '  stamp:', f'    sec: {seconds}', f'    nanosec: {nanoseconds}']
    lines.append(f'  frame_id: {message.frame_id or repr("")}')
    for key in ('name', 'position', 'velocity', 'effort'):
        values = getattr(message, key)
        lines += [f'{key}:' if values else f'{key}: []']
        lines += [f'- {v if isinstance(v, str) else float(f"{v:.6g}")}' for v in values]
    return [*lines, '---']


def _echoed_text(text: str) -> list[str]:
    """Return a String as `ros2 topic echo` prints it: 128 characters of its text."""
    cut = f'{text[:128]}...'
    return [*yaml.safe_dump({'data': cut}, width=sys.maxsize).splitlines(), '---']


def gallery() -> str:
    """Return the page of the figures to print."""
    lines = [
        '# Figures to print',
        '',
        'Nine figures as a paper would print them, one column wide, with the script of each. A',
        'script runs in its own folder, for instance',
        '`cd examples/gallery && python plot_resonance.py`, takes less than ten seconds, and',
        'writes the figure there.',
    ]
    for path in SCRIPTS:
        _, text, code = path.read_text(encoding='utf-8').split('"""', 2)
        title, _, *words = text.strip().splitlines()
        name = path.stem.removeprefix('plot_')
        lines += ['', f'## {title}', *map(_inline, words), '', f'![{title}]({name}.png)', '']
        lines += [f'`examples/gallery/{path.name}`:', '', '```python', code.strip(), '```']
    return '\n'.join(lines) + '\n'


def draw() -> None:
    """Draw the figures of the gallery."""
    for path in SCRIPTS:
        subprocess.run(
            [sys.executable, path.name],
            cwd=path.parent,
            env={**os.environ, 'MPLBACKEND': 'agg', 'PYTHONPATH': str(ROOT)},
            check=True,
        )
        name = path.with_stem(path.stem.removeprefix('plot_')).with_suffix('.png').name
        shutil.move(path.parent / name, GALLERY / name)


def pages() -> dict[Path, str]:
    """Return the pages with generated parts."""
    made = {GALLERY / 'index.md': gallery()}
    made |= {DOCS / 'reference' / 'python' / f'{stem}.md': library(stem) for stem in LIBRARY}
    fill = {
        'reference/commands.md': commands,
        'controllers/laws.md': partial(tables, 'laws.md'),
        'reference/glossary.md': glossary,
        'node/node.md': messages,
        'node/parameters.md': partial(tables, 'parameters.md'),
    }
    for name, filled in fill.items():
        path = DOCS / name
        made[path] = filled(path.read_text(encoding='utf-8'))
    return made


if __name__ == '__main__':
    if '--figures' in sys.argv:
        draw()
    for path, text in pages().items():
        path.write_text(text, encoding='utf-8')
