"""
What other programs rely on, as one file: `docs/reference/interfaces.json`.

    python docs/interfaces.py

Parameters, topics, services, commands, the keys and columns of what commands write, and formats of
files. A change of it is a change for users, and gets a line in CHANGELOG.rst; a test compares it.
"""

import argparse
import csv
import json
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from impact_damper_ros.bag import metadata, rig_topics  # noqa: E402
from impact_damper_ros.node.rig_client import SERVICES  # noqa: E402
from impact_damper_ros.parameters.parameter_spec import ParameterSpec  # noqa: E402
from impact_damper_ros.parameters.upgrades import newest  # noqa: E402
from impact_damper_ros.rig import snapshot  # noqa: E402
from impact_damper_ros.sweep import grid  # noqa: E402

FILE = ROOT / 'docs' / 'reference' / 'interfaces.json'
#: What the commands have written, which `test/museum` compares with what they write now
OUTPUTS = max(
    (ROOT / 'test' / 'museum').glob('*/outputs'),
    key=lambda path: [*map(int, path.parent.name.split('.'))],
)
COMMANDS = re.findall(r"'(\w+) = impact_damper_ros\.cli", (ROOT / 'setup.py').read_text())
#: Where what an object has is by name or number of the user's own
_OWN = re.compile(r'^[-+0-9.]+$')


def parameters() -> dict[str, Any]:
    """Return the parameters of the node, and those that stand for others at its start."""
    live = import_module('impact_damper_ros.parameters.all_parameters').ALL_SPECS
    structure = import_module('impact_damper_ros.parameters.structure').STRUCTURE_SPECS
    return {
        'node': {name: _parameter(spec) for name, spec in live.items()},
        'at a start': {name: _parameter(spec) for name, spec in structure.items()},
    }


def _parameter(spec: ParameterSpec) -> dict[str, Any]:
    stated = spec._asdict()
    return {
        name: stated[name]
        for name in ('kind', 'unit', 'low', 'high', 'least', 'default', 'choices', 'effect')
        if stated[name] not in (None, '', (), 0.0) or name == 'default'
    }


def topics() -> dict[str, Any]:
    """Return the topics that a node offers and takes."""
    tables = {
        'published': {**rig_topics.RIG_TOPICS, **rig_topics.LIVE_TOPICS},
        'taken': rig_topics.COMMAND_TOPICS,
    }
    return {
        way: {
            one.name: {
                'type': one.type,
                'reliability': one.qos.reliability,
                'durability': one.qos.durability,
                'frame_id': [*one.frames],
            }
            for one in table.values()
        }
        for way, table in tables.items()
    }


def services() -> dict[str, str]:
    """Return the services of a node, beside those of its parameters."""
    return {
        f'~/{name}': f'std_srvs/srv/{kind.__name__}'
        for name, kind in sorted(SERVICES.items())
        if kind.__module__.startswith('std_srvs.')
    }


def commands() -> dict[str, Any]:
    """Return arguments, options and exit codes of each command."""
    found = {}
    for command in COMMANDS:
        module = import_module(f'impact_damper_ros.cli.{command}')
        if not hasattr(module, '_parser'):
            # The node takes arguments of ROS.
            options = {name: {} for name in ('-h, --help', '--version', '--ros-args')}
            found[command] = {'options': options, 'exit codes': [0, 1, 2]}
            continue
        parser = module._parser()
        epilog = ' '.join((parser.epilog or '').split())
        stated = epilog.partition('Exit code: ')[2].partition('. ')[0]
        codes = re.findall(r'\b(\d{1,3}) (?:if|on|after)\b', stated)
        given = {', '.join(a.option_strings) or str(a.metavar): a for a in parser._actions}
        found[command] = {
            'arguments': {n: _argument(a) for n, a in given.items() if not a.option_strings},
            'options': {n: _argument(a) for n, a in given.items() if a.option_strings},
            'exit codes': sorted({0, *map(int, codes)}),
        }
    return found


def _argument(action: argparse.Action) -> dict[str, Any]:
    stated = {
        'metavar': action.metavar,
        'count': action.nargs,
        'choices': [*map(str, action.choices)] if action.choices else None,
        'required': action.required if action.option_strings else None,
    }
    return {name: value for name, value in stated.items() if value not in (None, False, 0)}


def keys(document: Any) -> Any:
    """Return the keys of a document, those of all entries of a list together, and types."""
    if isinstance(document, dict):
        if document and all(map(_OWN.match, document)):
            return {'<number>': together([keys(value) for value in document.values()])}
        return {name: keys(value) for name, value in document.items()}
    if isinstance(document, list):
        return [together([keys(value) for value in document])] if document else []
    return type(document).__name__.replace('NoneType', 'null')


def together(found: list[Any]) -> Any:
    """Return what one of several may have: all keys, and all types of a value."""
    if all(isinstance(one, dict) for one in found):
        names = dict.fromkeys(name for one in found for name in one)
        return {n: together([one[n] for one in found if n in one]) for n in names}
    if all(isinstance(one, list) for one in found):
        entries = [entry for one in found for entry in one]
        return [together(entries)] if entries else []
    plain = sorted({one for one in found if isinstance(one, str)})
    rest = [one for one in found if not isinstance(one, str)]
    if not rest:
        return ' or '.join(dict.fromkeys(' or '.join(plain).split(' or ')))
    return together(rest)


def outputs() -> dict[str, Any]:
    """Return keys of JSON and columns of CSV, by command and option."""
    found: dict[str, Any] = {'json': {}, 'csv': {}}
    for path in sorted(OUTPUTS.glob('*.json')):
        found['json'][path.stem] = keys(json.loads(path.read_text(encoding='utf-8')))
    table = OUTPUTS.parent / 'sweeps' / 'gap.csv'
    for path in (*sorted(OUTPUTS.glob('*.csv')), table):
        lines = (line for line in path.read_text().splitlines() if not line.startswith('#'))
        found['csv']['sweep_rig' if path is table else path.stem] = next(csv.reader(lines))
    return found


def interfaces() -> dict[str, Any]:
    """Return all of it."""
    return {
        'parameters': parameters(),
        'topics': topics(),
        'services': services(),
        'commands': commands(),
        **outputs(),
        'formats': {
            'bag': newest(snapshot.UPGRADES),
            'sweep': newest(grid.UPGRADES),
            'metadata.yaml of rosbag2': metadata.VERSION,
        },
    }


def files() -> dict[Path, str]:
    """Return the file with its text, and that of the museum of a version that has no date yet."""
    text = json.dumps(interfaces(), indent=1, ensure_ascii=False) + '\n'
    version = re.escape(OUTPUTS.parent.name)
    changelog = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    if re.search(rf'^{version}\.\d+ \(', changelog, re.MULTILINE):
        return {FILE: text}
    return {FILE: text, OUTPUTS.with_name(FILE.name): text}


if __name__ == '__main__':
    for path, text in files().items():
        path.write_text(text, encoding='utf-8')
