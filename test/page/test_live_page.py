"""The page on a real node, over DDS; and the command."""

import asyncio
import contextlib
import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from node.rig_client import LIVELY, RigClient, RigParametersClient, SimProcess, until

from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.theory.child_process import environment

from .served import in_loop, opened, serving

pytest.importorskip('rclpy')

from impact_damper_ros.page.ros_client import RosClient


@pytest.fixture
def node(tmp_path):
    process = SimProcess(tmp_path / 'node', bag_directory=tmp_path / 'runs', **LIVELY)
    try:
        yield process
    finally:
        process.kill()


@contextlib.asynccontextmanager
async def page_of(directory, **options):
    """Open the page on what is in the network."""
    network = RosClient()
    async with (
        serving(directory, network, **options) as server,
        opened(server) as page,
    ):
        yield server, page


def with_knobs(page):
    return [message for message in page.of('hello') if message['parameters']]


@pytest.mark.usefixtures('node')
@in_loop
async def test_a_knob_turned_in_the_page_turns_that_of_the_node(tmp_path):
    async with page_of(tmp_path, node='/sim_node') as (server, page):
        await page.until(lambda: with_knobs(page), 'no parameters')
        knobs = {k['name']: k for k in with_knobs(page)[-1]['parameters']}
        assert knobs['gap']['value'] == 0.01
        assert (knobs['gap']['unit'], knobs['gap']['max']) == ('m', 1e9)
        laws = ['off', 'amplitude', 'timed', 'predictive', 'external']
        assert knobs['gap_control']['choices'] == laws
        assert knobs['state_rate']['read_only']
        assert knobs['record']['value'] is False
        # The motion comes, with its impacts, in order.
        await page.until(lambda: sum(len(f.impacts) for f in page.frames) > 10)
        ends = [frame.end for frame in page.frames]
        assert ends == sorted(ends)
        taken = server.sources['/sim_node'].motion.samples[:, 0]
        assert np.median(np.diff(taken)) == pytest.approx(0.005)
        # All or nothing, in the words of the node
        refused = await page.ask(type='set', values={'gap': 0.02, 'friction': -1.0})
        assert refused[1].startswith('friction is -1.0')
        wrong = await page.ask(type='set', values={'gap': 'abc'})
        assert wrong[1].startswith("gap is 'abc': give a number from")
        assert (await page.ask(type='set', values={'gap': 0.02}))[0]
        turned = await page.next('parameters', values={'gap': 0.02})
        assert turned['time'] > 0.0
        await page.until(
            lambda: (
                page.frames[-1].state[4] - page.frames[-1].state[0]
                == pytest.approx(0.01, rel=1e-4)
            )
        )
        unknown = await page.ask(type='set', values={'nonsense': 1.0})
        assert 'not a parameter' in unknown[1]
        async with opened(server) as other:
            await other.until(lambda: with_knobs(other))
            values = {k['name']: k['value'] for k in with_knobs(other)[-1]['parameters']}
            assert values['gap'] == 0.02
            # Turned by the other page, and by somebody else on the network
            assert (await other.ask(type='preset', name='bench'))[0]
            for one in (page, other):
                await one.until(
                    lambda one=one: [
                        m for m in one.of('parameters') if m['values'].get('stiffness')
                    ]
                )
            seen = len(page.of('parameters'))
            await asyncio.to_thread(turn, 'friction', 0.3)
            turned = {'friction': 0.3}
            await page.until(
                lambda: [m for m in page.of('parameters')[seen:] if m['values'] == turned]
            )
        await page.until(
            lambda: [m for m in page.of('diagnostics') if m['verdict'] and m['message']]
        )
        assert (await page.next('orbit'))['found'] in (True, False)


def turn(name, value):
    with RigClient() as client:
        assert RigParametersClient(client).set(**{name: value}) == ''


@in_loop
async def test_pause_reset_and_record(node, tmp_path):
    (tmp_path / 'runs').mkdir()
    async with page_of(tmp_path / 'runs', node='/sim_node') as (_, page):
        await page.until(lambda: page.frames and with_knobs(page))
        assert (await page.ask(type='set', values={'record': True}))[0]
        await page.next('parameters', values={'record': True})
        hellos, seen = len(page.of('hello')), len(page.frames)
        assert (await page.ask(type='service', name='pause'))[0]
        await page.next('status', state='paused')
        await page.until(lambda: page.of('status')[-1]['state'] == 'paused')
        assert (await page.ask(type='service', name='pause'))[0]
        await page.until(lambda: page.of('status')[-1]['state'] != 'paused')
        count = len(page.frames)
        await page.until(lambda: len(page.frames) > count + 5)
        # The rig is still the same one, with the traces of before.
        assert len(page.of('hello')) == hellos
        assert not [f for f in page.frames[seen + 1 :] if f.flags & 2]
        refused = await page.ask(type='service', name='step')
        assert (refused[0], 'pause it first' in refused[1]) == (False, True)
        assert (await page.ask(type='service', name='pause'))[0]
        await page.until(lambda: page.of('status')[-1]['state'] == 'paused')
        ends = [page.frames[-1].end]
        for _ in range(3):
            step = await page.ask(type='service', name='step')
            assert (step[0], step[1][:19]) == (True, 'paused after a step')
            await page.until(lambda: page.frames[-1].end > ends[-1])
            ends.append(page.frames[-1].end)
        assert np.diff(ends) == pytest.approx([0.005] * 3, abs=1e-6)
        known = sum(len(frame.impacts) for frame in page.frames)
        assert (await page.ask(type='service', name='step_to_impact'))[0]
        await page.until(lambda: sum(len(f.impacts) for f in page.frames) > known)
        await page.until(lambda: page.frames[-1].flags & 1)
        assert 0.0 <= -page.frames[-1].impacts[-1, 0] <= 0.005 + 1e-6
        assert (await page.ask(type='service', name='pause'))[0]
        reset = await page.ask(type='service', name='reset')
        assert reset[1].startswith('reset to primary at 0 m')
        assert (await page.ask(type='set', values={'record': False}))[0]
        listed = await page.until(
            lambda: [m for m in page.of('recordings') if any(r['whole'] for r in m['list'])]
        )
        assert re.fullmatch(r'run_\d+_\d+(_\d+)?', listed[-1]['list'][0]['name'])
    assert node.running()


def started(directory, *arguments):
    """Start the command; return it, and the address that it prints."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'impact_damper_ros.cli.rig_page', '--port', '0', *arguments],
        cwd=directory,
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    address = ''
    while not address:
        line = process.stdout.readline()
        assert line or process.poll() is None, 'it has ended'
        found = re.search(r'http://\S+', line)
        address = found[0] if found else ''
    return process, address


def end(process, number=signal.SIGINT):
    process.send_signal(number)
    code = process.wait(100.0)
    process.stdout.close()
    return code


async def first_words(address):
    from tornado.websocket import websocket_connect

    socket = await websocket_connect(address.replace('http', 'ws') + 'ws')
    message = json.loads(await socket.read_message())
    socket.close()
    while await socket.read_message() is not None:
        pass
    return message


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_the_command_starts_a_rig_and_ends_it(number, tmp_path):
    process, address = started(tmp_path, '--start', 'bench_rig')
    try:
        assert re.fullmatch(r'http://127\.0\.0\.1:\d+/', address)
        assert asyncio.run(first_words(address))['rig'] == '/sim_node'
        children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
        nodes = [Path('/proc', word) for word in children.read_text(encoding='utf-8').split()]
        assert nodes
        assert end(process, number) == 0
        until(lambda: not any(node.exists() for node in nodes), 'it runs on')
    finally:
        process.kill()
        process.wait()


def test_the_command_lists_loose_files_one_by_one(tmp_path):
    runs = tmp_path / 'runs'
    runs.mkdir()
    for name in ('one.mcap', 'other.mcap'):
        (runs / name).touch()
    process, address = started(tmp_path)
    try:
        listed = asyncio.run(first_words(address))['recordings']
        assert {entry['name'] for entry in listed} == {'one.mcap', 'other.mcap'}
        assert end(process) == 0
    finally:
        process.kill()
        process.wait()


def test_the_command_plays_a_recording_without_ros(tmp_path):
    bag = tmp_path / 'run'
    assert simulate_rig(['bench_rig', '--duration', '2', '--bag', str(bag), '--quiet']) == 0
    process, address = started(tmp_path, '--bag', str(bag))
    try:
        assert asyncio.run(first_words(address))['bag'] == 'run'
        assert end(process) == 0
    finally:
        process.kill()
        process.wait()
