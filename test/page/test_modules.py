"""The modules of the page without a browser: units in Node, and types of the messages."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from running import SOURCE

import impact_damper_ros.page
from impact_damper_ros.page.frames import LAYOUT
from impact_damper_ros.page.requests import REQUESTS

from .fake_rig import FakeLink
from .served import in_loop, live_page

STATIC = Path(impact_damper_ros.page.__file__).with_name('static')
UNITS = sorted(Path(__file__).with_name('units').glob('*.test.js'))
TSC = SOURCE / 'node_modules' / '.bin' / 'tsc'
MESSAGES = (STATIC / 'messages.d.ts').read_text(encoding='utf-8')
#: How `messages.d.ts` writes what a field of a request is
WORDS = {
    'number': 'a number',
    'string': 'a text',
    'Values': 'an object',
    'boolean': 'true or false',
    'Values | null': 'an object or null',
}


@pytest.fixture
def node():
    """Return the path of Node; without it the test is skipped."""
    path = shutil.which('node')
    if path is None:
        pytest.skip('Node is not installed (Debian: apt install nodejs)')
    return path


@pytest.mark.parametrize('path', UNITS, ids=lambda path: path.name)
def test_units(node, path):
    done = subprocess.run([node, '--test', path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-1000:]


def types_of(folder):
    """Return what the compiler of TypeScript says of the modules of a folder."""
    if not TSC.exists():
        pytest.skip('TypeScript is not installed (npm install)')
    options = json.loads((SOURCE / 'tsconfig.json').read_text())
    options['include'] = [f'{folder}/*.js', f'{folder}/panels/*.js']
    place = folder.parent / 'tsconfig.json'
    place.write_text(json.dumps(options))
    done = subprocess.run([TSC, '-p', place], capture_output=True, text=True, check=False)
    return done.stdout.splitlines()


def test_types_and_messages_of_a_wrong_shape(node, tmp_path):
    """One compilation for both: the copy has wrong messages in a module of its own."""
    del node
    copy = tmp_path / 'static'
    shutil.copytree(STATIC, copy)
    (copy / 'wrong.js').write_text("""
/** @param {import('./protocol.js').Connection} connection */
export function ask(connection) {
  connection.send({ type: 'seek', time: '3' });
  connection.ask({ type: 'play' });
  connection.ask({ type: 'stop' });
  connection.ask({ type: 'service', name: 'shutdown' });
  connection.send({ type: 'compare', recording: 'run', on: true });
}
/** @param {import('./messages.js').ServerMessage} message */
export const read = (message) => (message.type === 'status' ? message.txt : '');
""")
    errors = [line for line in types_of(copy) if 'error TS' in line]
    wrong = re.findall(r'wrong\.js\((\d+),', '\n'.join(errors))
    assert [line for line in errors if 'wrong.js' not in line] == []
    assert list(map(int, wrong)) == [4, 5, 6, 7, 11]


def fields_of(body):
    """Return the fields of a type that is written in a line, by name, with what they are."""
    depth, parts, start = 0, [], 0
    for n, sign in enumerate(body):
        depth += (sign in '{[(<') - (sign in '}])>')
        if sign == ',' and depth == 0:
            parts.append(body[start:n])
            start = n + 1
    pairs = (part.strip().partition(': ') for part in [*parts, body[start:]])
    return {name: what for name, _, what in pairs}


def messages_of(suffix):
    """Return the types of messages, by their `type`, of a name with an end."""
    pattern = rf"^export type \w*{suffix} = {{ type: '(\w+)'(?:, (.*))? }};$"
    return {kind: fields_of(body) for kind, body in re.findall(pattern, MESSAGES, re.M)}


def test_requests_are_those_that_the_server_takes():
    typed = {
        kind: {name: WORDS.get(what, 'a text') for name, what in fields.items()}
        for kind, fields in messages_of('Request').items()
    }
    assert typed == REQUESTS


@in_loop
async def test_messages_are_those_of_the_types(tmp_path):
    """Whatever a live rig sends has the fields that the page expects, and no others."""
    types = messages_of('')
    link = FakeLink()
    async with live_page(tmp_path, link) as (link, page):
        await page.until(lambda: [m for m in page.of('hello') if m['parameters']])
        link.change(gap=30.0)
        link.report((0, 'measured motion', 'words', {'State': 'transient'}))
        link.run(0.5)
        await page.next('parameters', values={'gap': 30.0})
        await page.until(lambda: any(m['message'] for m in page.of('diagnostics')))
        await page.ask(type='set', values={'gap': 31.0})
        (knob, *_) = page.of('hello')[-1]['parameters']
        seen = {message['type']: message for message in page.messages}
    assert set(seen) >= {'hello', 'status', 'parameters', 'diagnostics', 'numbers', 'answer'}
    for kind, message in seen.items():
        fields = types[kind]
        assert {n.rstrip('?') for n in fields} >= set(message) - {'type'}, kind
        assert {n for n in fields if not n.endswith('?')} <= set(message), kind
    for name, expected in (('Descriptor', knob), ('Layout', LAYOUT)):
        (body,) = re.findall(rf'^export type {name} = {{ (.*) }};$', MESSAGES, re.M)
        assert set(fields_of(body)) == set(expected)
