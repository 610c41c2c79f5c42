"""The page on a real node, over DDS; and the command."""

import asyncio
import os
import re
import signal

import numpy as np
import pytest
from node.rig_client import LIVELY, RigClient, RigParametersClient, SimProcess
from running import alive, until

from impact_damper_ros.page.presets import load_presets

from .page_process import PageProcess
from .served import in_loop, opened, serving

pytest.importorskip('rclpy')

from impact_damper_ros.page.ros_client import RosClient


@pytest.fixture(scope='module')
def runs(tmp_path_factory):
    return tmp_path_factory.mktemp('runs')


@pytest.fixture(scope='module')
def node(tmp_path_factory, runs):
    """Start a node whose impacts are sent best effort."""
    override = {'qos_overrides./impacts.publisher.reliability': 'best_effort'}
    given = {'bag_directory': runs, **LIVELY, **override}
    with SimProcess(tmp_path_factory.mktemp('node'), **given) as process:
        yield process


def with_knobs(page):
    return [message for message in page.of('hello') if message['parameters']]


@in_loop
async def test_requests_are_answered_by_the_node(node, runs):
    """What a browser shows of it is in `test_browser`."""
    async with serving(runs, RosClient(), node='/sim_node') as server, opened(server) as page:
        await page.until(lambda: with_knobs(page), 'no parameters')
        knobs = {k['name']: k for k in with_knobs(page)[-1]['parameters']}
        assert (knobs['gap']['value'], knobs['record']['value']) == (0.01, False)
        await page.until(lambda: sum(len(f.impacts) for f in page.frames) > 10)
        ends = [frame.end for frame in page.frames]
        assert ends == sorted(ends)
        taken = server.sources['/sim_node'].motion.samples[:, 0]
        assert np.median(np.diff(taken)) == pytest.approx(0.005)
        # As it was typed, in the unit in which it is shown
        for text, unit, gap in (('24.5 mm', 'm', 0.0245), ('2,5', 'cm', 0.025)):
            typed = {'gap': {'text': text, 'unit': unit}}
            assert await page.ask(type='set', values=typed) == (True, '')
            assert page.of('answer')[-1]['values'] == {'gap': gap}
            await page.next('parameters', values={'gap': gap})
        # All or nothing, in the words of the node
        for values, words in (
            ({'gap': -1.0}, 'gap is -1.0 m: give a number from 1e-09 to 1e+09 m'),
            ({'gap': {'text': 'abc', 'unit': 'mm'}}, "gap is 'abc': give a number from 1e-06 to"),
            ({'gab': {'text': '1', 'unit': 'mm'}}, 'gab is not a parameter'),
            ({'gap': {'text': '1'}}, 'gap has no unit'),
            ({'gap': 0.02, 'friction': -1.0}, 'friction is -1.0'),
            ({'gap': 'abc'}, "gap is 'abc': give a number from"),
            ({'nonsense': 1.0}, 'not a parameter'),
            ({'damping': 1e3}, 'underdamped'),
        ):
            for kind in ('set', 'begin'):
                ok, reason = await page.ask(type=kind, values=values)
                assert (ok, words in reason) == (False, True), reason
        assert (await page.ask(type='set', values={'record': True}))[0]
        await page.next('parameters', values={'record': True})
        hellos = len(page.of('hello'))
        for state in ('paused', 'running'):
            assert (await page.ask(type='service', name='pause'))[0]
            known = 'paused', 'running', 'lagging'
            states = known[:1] if state == 'paused' else known[1:]
            await page.until(lambda s=states: page.of('status')[-1]['state'] in s)
        count = len(page.frames)
        await page.until(lambda: len(page.frames) > count + 5)
        # The rig is still the same one.
        assert len(page.of('hello')) == hellos
        refused = await page.ask(type='service', name='step')
        assert (refused[0], 'pause it first' in refused[1]) == (False, True)
        assert not (await page.ask(type='service', name='shutdown'))[0]
        # A preset is set as a whole, then the rig is reset. What was refused has reset nothing.
        assert 'reset' not in {one['kind'] for one in page.of('parameters')}
        values = {**load_presets()['bench'].values, 'gap': 0.023}
        ok, reason = await page.ask(type='begin', values=values)
        assert (ok, reason.startswith('reset to primary at 0 m')) == (True, True)
        await page.until(lambda: page.of('parameters')[-1]['kind'] == 'reset')
        took = {name: v for one in page.of('parameters') for name, v in one['values'].items()}
        assert (took['gap'], took['gap_max']) == (0.023, 0.3)
        assert (await page.ask(type='set', values={'record': False}))[0]
        listed = await page.until(
            lambda: [m for m in page.of('recordings') if any(r['whole'] for r in m['list'])]
        )
        assert re.fullmatch(r'run_\d+_\d+(_\d+)?', listed[-1]['list'][0]['name'])
    assert node.running()


@pytest.mark.usefixtures('node')
@in_loop
async def test_what_is_asked_before_the_node_is_known_is_done(tmp_path):
    """As of a page whose server was started again; the answer to a reset must not be lost."""
    async with serving(tmp_path, RosClient(), node='/sim_node') as server, opened(server) as page:
        ok, reason = await page.ask(type='begin', values={'gap': 0.017})
        assert (ok, reason.startswith('reset to primary at 0 m')) == (True, True)
        rig = server.sources['/sim_node']
        await page.until(lambda: with_knobs(page) and rig.values['gap'] == 0.017, 'not shown')


@in_loop
async def test_two_nodes_of_one_name_are_reported(node, tmp_path):
    async with serving(tmp_path, RosClient(), node='/sim_node') as server, opened(server) as page:
        await page.until(lambda: with_knobs(page), 'no parameters')
        other = SimProcess(tmp_path / 'other', **LIVELY)
        try:
            status = await page.next('status', state='doubled')
            assert status['text'].startswith('Several nodes are called /sim_node')
            # The other one leaves the network, which takes one that is killed 20 s.
            assert await asyncio.to_thread(other.stop) == 0
        finally:
            other.kill()
        await page.until(lambda: page.of('status')[-1]['state'] != 'doubled')
    assert node.running()


@in_loop
async def test_a_node_that_stands_still_for_a_while_does_what_is_asked_once(
    node, tmp_path, monkeypatch
):
    """And one that sends nothing for long is reported."""
    monkeypatch.setattr('impact_damper_ros.node.rig_client.ASK_AGAIN_S', 0.02)
    async with serving(tmp_path, RosClient(), node='/sim_node') as server, opened(server) as page:
        await page.until(lambda: with_knobs(page), 'no parameters')
        assert (await page.ask(type='service', name='pause'))[0]
        await page.until(lambda: page.of('status')[-1]['state'] == 'paused')
        await page.until(lambda: page.frames[-1].flags & 1)
        end = page.frames[-1].end
        node.send(signal.SIGSTOP)
        await page.send(type='service', name='step', id='step')
        # Meanwhile one that may be made twice is not sent twice: the node has answered before.
        await page.send(type='set', values={'friction': 0.125}, id='set')
        service = server.sources['/sim_node'].link._rig._services['set_parameters_atomically']
        await page.until(lambda: service._requests and service._requests[0].sent)
        await asyncio.sleep(0.1)
        assert [one.sent for one in service._requests] == [1]
        node.send(signal.SIGCONT)
        for asked in ('step', 'set'):
            assert (await page.next('answer', id=asked))['ok']
        await page.next('parameters', values={'friction': 0.125})
        assert (await page.ask(type='service', name='step'))[0]
        await page.until(lambda: page.frames[-1].end > end + 0.0075)
        assert page.frames[-1].end == pytest.approx(end + 0.01)
        monkeypatch.setattr('impact_damper_ros.page.ros_client.SILENT_S', 0.2)
        monkeypatch.setattr('impact_damper_ros.page.ros_client.LEAST_S', 0.2)
        node.send(signal.SIGSTOP)
        ok, reason = await page.ask(type='set', values={'friction': 0.25})
        assert (ok, 'may or may not have been made' in reason) == (False, True), reason
        node.send(signal.SIGCONT)
        monkeypatch.undo()
        assert (await page.ask(type='service', name='pause'))[0]
        await page.until(lambda: page.of('status')[-1]['state'] != 'paused')


def test_a_node_is_named_without_its_slash(node, tmp_path):
    """What others set is seen, too."""
    server = PageProcess(tmp_path / 'page', '--node', 'sim_node')

    async def watch():
        async with opened(server) as page:
            await page.until(lambda: with_knobs(page), 'no parameters')
            hello = with_knobs(page)[-1]
            assert hello['rig'] == '/sim_node'
            assert hello['rigs'] in ([], ['/sim_node'])
            with RigClient() as client:
                turned = asyncio.to_thread(RigParametersClient(client).set, real_time_factor=0.5)
                assert await turned == ''
                await page.next('parameters', values={'real_time_factor': 0.5})

    try:
        asyncio.run(watch())
    finally:
        assert server.close() == 0
    assert node.running()


def test_a_node_that_dies_is_reported(tmp_path):
    """As `page:=true` of the launch file has it; loose files are recordings, one by one."""
    loose = {'one.mcap', 'other.mcap'}
    (tmp_path / 'runs').mkdir()
    for name in loose:
        (tmp_path / 'runs' / name).touch()
    server = PageProcess(tmp_path, '--start', 'bench_rig')

    async def watch():
        async with opened(server) as page:
            await page.until(lambda: with_knobs(page), 'no parameters')
            assert with_knobs(page)[-1]['rig'] == '/sim_node'
            await page.until(lambda: loose in listed(page))
            (node,) = server.children()
            os.kill(node, signal.SIGKILL)
            notice = await page.next('notice')
            assert 'by signal 9' in notice['text']

    def listed(page):
        lists = [m['recordings'] for m in page.of('hello')] + [
            m['list'] for m in page.of('recordings')
        ]
        return [{one['name'] for one in recordings} for recordings in lists]

    try:
        asyncio.run(watch())
        assert 'rig_page: the node has ended by signal 9: start it again' in server.output
        assert server.children() == []
    finally:
        assert server.close(signal.SIGINT) == 0


def test_ctrl_c_reaches_a_node_that_still_imports_by_the_page_alone(tmp_path):
    """Ctrl-C in a terminal reaches both; the node prints no traceback of its imports."""
    server = PageProcess(tmp_path, '--start', 'bench_rig')
    try:
        (node,) = until(server.children)
        os.kill(node, signal.SIGINT)
        server.until(lambda: 'runs in real time' in server.output)
        assert server.children() == [node]
    finally:
        assert server.close(signal.SIGINT) == 0
    # The node ends with its page.
    until(lambda: not alive(node), 'it runs on')
    assert 'Traceback' not in server.output
    assert 'has ended' not in server.output
