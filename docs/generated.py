"""
What the documentation has of the code: help, parameters, interfaces, glossary, library, gallery.

    python docs/generated.py [--figures]

It writes these parts as Markdown that GitHub shows, with `--figures` those of the gallery, too. A
test compares the texts.
"""

import html
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from numpydoc.docscrape import NumpyDocString
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'docs')]

import interfaces  # noqa: E402

from impact_damper_ros import EventKind, GapControlParameters, Rig, load_parameters  # noqa: E402
from impact_damper_ros.bag import rig_topics  # noqa: E402
from impact_damper_ros.bag.messages import clock_message, encode  # noqa: E402
from impact_damper_ros.bag.robot_description import robot_description  # noqa: E402
from impact_damper_ros.bag.snapshots import Snapshots  # noqa: E402
from impact_damper_ros.node.diagnostics import Diagnostics  # noqa: E402
from impact_damper_ros.node.engine_state import EngineStatus  # noqa: E402
from impact_damper_ros.node.pacing import PacingCounts  # noqa: E402
from impact_damper_ros.node.recording import RecordingStatus  # noqa: E402
from impact_damper_ros.parameters.all_parameters import ALL_SPECS  # noqa: E402
from impact_damper_ros.rig.rig_state import RigState  # noqa: E402
from impact_damper_ros.theory.documents import theory  # noqa: E402

DOCS = ROOT / 'docs'
SCRIPTS = sorted((ROOT / 'examples' / 'gallery').glob('plot_*.py'))
GALLERY = DOCS / 'results' / 'gallery'
#: Titles of the pages of the library, and per page the modules and the rooms they take names from.
LIBRARY = {
    'simulate': ('Simulation', 'impact_damper_ros', 'parameters', 'rig'),
    'events': ('Events and samples', 'impact_damper_ros', 'motion'),
    'laws': ('Gap control', 'impact_damper_ros', 'control'),
    'orbits': ('Periodic motions', 'impact_damper_ros', 'orbits'),
    'fit': ('Fits', 'impact_damper_ros', 'fit'),
    'design': ('Dampers by design', 'impact_damper_ros', 'design'),
    'sweeps': ('Sweeps', 'impact_damper_ros.sweep'),
    'bags': ('Recordings', 'impact_damper_ros.bag'),
    'replay': ('Replay', 'impact_damper_ros.replay'),
    'compare': ('Comparison', 'impact_damper_ros.compare'),
    'report': ('Reports', 'impact_damper_ros.report'),
}
#: What the table of the node says of when a value takes effect.
EFFECTS = {
    'now': '',
    'start': ' Fixed while the node runs.',
    'next recording': ' For the next recording.',
}
LISTS = 'Parameters', 'Attributes', 'Returns', 'Yields', 'Raises', 'Other Parameters'
PROSE = 'Notes', 'References'


def tables(page: str) -> str:
    """Return the page of the parameters with their present tables."""
    rig_parameters = import_module('impact_damper_ros.parameters.rig_parameters')
    control = import_module('impact_damper_ros.parameters.gap_control_parameters')
    node = import_module('impact_damper_ros.parameters.node_settings')
    structure = import_module('impact_damper_ros.parameters.structure')
    table = import_module('impact_damper_ros.cli.simulate_rig').parameter_markdown
    settings = {
        name: spec._replace(description=f'{spec.description}{EFFECTS[spec.effect]}')
        for name, spec in node.SETTING_SPECS.items()
    }
    present = map(
        table,
        (
            rig_parameters.PARAMETER_SPECS | rig_parameters.INITIAL_SPECS,
            control.GAP_CONTROL_SPECS,
            settings,
            structure.STRUCTURE_SPECS,
        ),
    )
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
    path = ROOT / 'impact_damper_ros' / 'page' / 'static' / 'index.html'
    entry = r'<dt id="term-[\w-]+">(.*)</dt><dd>(.*)</dd>'
    terms = re.findall(entry, html.unescape(path.read_text(encoding='utf-8')))
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


_PROPERTIES = property, cached_property
_MEMBERS = (classmethod, staticmethod, *_PROPERTIES)


def _members(cls: type) -> list[tuple[str, Any]]:
    """Return the documented methods and properties of a class; `Rig` has those of its bases."""
    return [
        (name, value)
        for half in reversed(cls.__mro__)
        if half is cls or issubclass(half, RigState)
        for name, value in vars(half).items()
        if not name.startswith('_')
        and (isinstance(value, _MEMBERS) or inspect.isfunction(value))
        and getattr(value, '__doc__', None)
    ]


def _entry(name: str, thing: Any) -> list[str]:
    """Return signature and docstring of a function, class or property."""
    lines = []
    error = isinstance(thing, type) and issubclass(thing, Exception)
    if not error and not isinstance(thing, _PROPERTIES):
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


def messages(page: str) -> str:
    """Return the page of the node with the topics as they are offered, and sample messages."""
    tables = (rig_topics.RIG_TOPICS, rig_topics.LIVE_TOPICS, rig_topics.COMMAND_TOPICS)
    lines = [
        '| topic | reliability, durability, depth | messages | `frame_id` |',
        '| --- ' * 4 + '|',
    ]
    for topic in (topic for table in tables for topic in table.values()):
        qos = f'{topic.qos.reliability}, {topic.qos.durability}, {topic.qos.depth}'
        frames = ', '.join(f'`{frame}`' if frame else 'empty' for frame in topic.frames)
        when = '; '.join(filter(None, (_rate(topic), topic.when)))
        lines.append(f'| `{topic.name}` | {qos} | {when} | {frames} |')
    parameters = load_parameters('bench_rig')[0]
    rig, made = Rig(parameters), rig_topics.RigMessages()
    impacts = [one for one in rig.advance(2.0) if one.kind is EventKind.IMPACT]
    event = impacts[0]
    controlled = Rig(parameters, control=GapControlParameters(gap_control='timed'))
    controlled.advance(2.0)
    act = controlled.acts[0]
    seen, stop_rates = rig.measure(0)
    views = (seen.x, seen.y, seen.stop_1, seen.stop_2), (seen.x_rate, seen.y_rate, *stop_rates)
    names = {key: f'/{topic.name}' for key, topic in rig_topics.RIG_TOPICS.items()}
    snapshots = Snapshots('/sim_node', names, {}, 200.0)
    snapshots.run = 32 * '0'
    state = rig.snapshot()
    _, known = next(theory(state))
    names = ['stop_1', 'stop_2']
    samples = {
        'impacts': _read(made.impact(round(event.time * 1e9), event, 0.0)),
        'joint_states': _read(made.states(2 * 10**9, rig.sample(), 0.0, parameters.angle)),
        'gap_control': _read(made.control(round(act.time * 1e9), act)),
        'measurements': _read(made.measurement(2 * 10**9, *views)),
        'snapshot': String(data=snapshots.text(0, 'start', state)),
        '/parameter_events': ParameterEvent(
            stamp=Time(sec=2),
            node='/sim_node',
            changed_parameters=[Parameter('gap', value=0.012).to_parameter_msg()],
        ),
        '/diagnostics': _diagnostics(rig, len(impacts)),
        'robot_description': String(data=robot_description(parameters)),
        'theory': String(data=json.dumps(known)),
        '/clock': _read(clock_message(2 * 10**9), Clock),
        'stop_commands': JointState(name=names, position=[0.008, -0.008]),
        'force_command': WrenchStamped(wrench=Wrench(force=Vector3(x=0.5))),
    }
    lines += ['', '### Sample messages', '']
    lines += [
        'As `ros2 topic echo` prints them, with fewer digits. Texts are cut after 128 characters;',
        'of `/diagnostics`, of which [a page](diagnostics.md) describes the keys, only the first',
        'two statuses stand here. A stamp of 0 in a command is accepted: see',
        '[commands of a controller](../controllers/interface.md).',
    ]
    for key, message in samples.items():
        lines += ['', f'`{key}`:', '', '```yaml', *_echoed(message), '```']
    text = '\n'.join(lines)
    head = '### Quality of service, rates, frames\n\n'
    return re.sub(
        rf'(?<={re.escape(head)}).*?(?=\n\n### Services)', lambda _: text, page, flags=re.DOTALL
    )


def _rate(topic: rig_topics.RigTopic) -> str:
    """Return how many messages a second a topic has, in words."""
    if isinstance(topic.rate, str):
        return f'`{topic.rate}`, {ALL_SPECS[topic.rate].default:g} a second'
    return f'{topic.rate:g} a second' if topic.rate else ''


def _diagnostics(rig: Rig, impacts: int) -> Any:
    """Return the report of a rig that was begun 2 s ago, its first two statuses."""
    time_ns, rate, clock = 2 * 10**9, 200.0, iter((0.0, 2.0))
    pacing = PacingCounts(400, 0, 0, 0, 120_000)
    status = EngineStatus(time_ns, False, rig.mode.name, impacts, 0, pacing, events=impacts)
    array = Diagnostics('/sim_node', rate, 1.0, lambda: next(clock)).report(
        time_ns, status, RecordingStatus()
    )
    message = _read(encode(array), DiagnosticArray)
    message.status = message.status[:2]
    return message


def _read(content: bytes, kind: Any = JointState) -> Any:
    return deserialize_message(content, kind)


def _echoed(message: Any) -> list[str]:
    """Return a message as `ros2 topic echo` prints it, with fewer digits."""
    text = yaml.safe_dump(_plain(message), sort_keys=False, width=sys.maxsize)
    return [*text.splitlines(), '---']


def _plain(value: Any) -> Any:
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, float):
        return float(f'{value:.6g}')
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, str):
        return value if len(value) <= 128 else f'{value[:128]}...'
    return value if isinstance(value, int) else list(map(_plain, value))


def columns(page: str) -> str:
    """Return the page of the sweeps with the columns of a table."""
    found = import_module('impact_damper_ros.sweep.table')._BY_NAME.values()
    rows = [(f'`{one.name}`', one.unit, one.description) for one in found]
    return _filled(page, 'columns', ('column', 'unit', 'meaning'), rows)


def overall(page: str) -> str:
    """Return the page of the comparison with the numbers over a whole run."""
    source = inspect.getsource(import_module('impact_damper_ros.compare.result').Overall)
    rows = []
    for comment, names in re.findall(r'((?:    #: .*\n)+)((?:    \w+: \w+\n)+)', source):
        keys = ', '.join(f'`{name}`' for name in re.findall(r'(\w+):', names))
        rows.append((keys, ' '.join(comment.replace('#:', '').split())))
    return _filled(page, 'overall', ('key', 'meaning'), rows)


def seen(page: str) -> str:
    """Return the page of the laws with what a law is given."""
    given = import_module('impact_damper_ros.control.own_law').LawInput
    rows = [
        (', '.join(f'`{name}`' for name in names.split(', ')), ' '.join(text))
        for names, _, text in NumpyDocString(inspect.getdoc(given))['Attributes']
    ]
    return _filled(page, 'seen', ('field', 'meaning'), rows)


def _filled(page: str, name: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a page with a table between two comments."""
    cells = [head, ('---',) * len(head), *rows]
    lines = [' | '.join(one.replace('|', r'\|') for one in row) for row in cells]
    table = '\n'.join(f'| {line} |' for line in lines)
    return re.sub(
        rf'(?<=<!-- {name} -->\n).*?(?=\n<!-- end -->)', lambda _: table, page, flags=re.DOTALL
    )


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
    made = {GALLERY / 'index.md': gallery(), **interfaces.files()}
    made |= {DOCS / 'reference' / 'python' / f'{stem}.md': library(stem) for stem in LIBRARY}
    fill = {
        'reference/commands.md': commands,
        'reference/glossary.md': glossary,
        'analysis/comparison.md': overall,
        'analysis/sweeps.md': columns,
        'controllers/laws.md': seen,
        'node/node.md': messages,
        'node/parameters.md': tables,
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
