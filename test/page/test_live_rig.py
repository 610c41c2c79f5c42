"""A rig as the page follows it, from its messages."""

import asyncio
import json

import numpy as np
import pytest

from impact_damper_ros import RigParameters
from impact_damper_ros.bag import String
from impact_damper_ros.bag.messages import STRING, decode, encode
from impact_damper_ros.page.client import Client
from impact_damper_ros.page.live import LiveRig
from impact_damper_ros.parameters.upgrades import newest
from impact_damper_ros.rig.snapshot import UPGRADES

from .fake_rig import FakeLink
from .served import in_loop


def followed(link):
    return LiveRig(link, dict)


def sink(texts, frames=None):
    """Return a connection that keeps what is written to it."""

    class Sink:
        def write_message(self, content, binary):
            (frames if binary else texts).append(content)
            written = asyncio.get_running_loop().create_future()
            written.set_result(None)
            return written

    return Sink()


async def left(live):
    await asyncio.sleep(0.0)
    await live.close()


@pytest.mark.parametrize('seconds', [1, 3600, -1, -3600])
@in_loop
async def test_a_step_of_the_system_clock_leaves_the_motion_as_it_is(seconds):
    """Also of the messages from before it that come in with its snapshot."""
    found = []
    for step in (0, seconds):
        link = FakeLink(rig=RigParameters(gravity=0.0, gap=1.0))
        live = followed(link)
        for _ in range(3):
            link.run(5.0)
            live.tick()
            link.run(0.1)
            link.slip(step)
            link.run(0.1)
            live.tick()
        found.append((live.motion.samples.copy(), live.motion.impacts.copy()))
        await left(live)
    (samples, impacts), (after, hits) = found
    assert len(samples) == 3120
    assert np.array_equal(after[:, :8], samples[:, :8])
    # The phase, counted from either snapshot
    assert np.abs(after[:, 8] - samples[:, 8]).max() < 1e-12
    assert len(impacts) > 0
    assert np.array_equal(hits[:, :9], impacts[:, :9])


@in_loop
async def test_changes_that_come_in_at_once_belong_each_to_its_samples():
    """Positions count from the equilibrium, which each angle moves."""
    link = FakeLink(rig=RigParameters(gravity=1.0, gap=3.0))
    live = followed(link)
    exact = []
    for angle in (0.1, 0.3, -0.2, 0.0):
        for _ in range(20):
            link.run(1 / 200)
            sample = link.rig.sample()
            exact.append((sample.time, sample.x, sample.z, link.rig.parameters.angle))
        link.change(angle=angle)
    live.tick()
    found = live.motion.samples[:, [0, 1, 3, 7]]
    # The sample at the instant of a change may be of either rig.
    inside = np.arange(80) % 20 != 19
    assert np.allclose(found[inside], np.array(exact)[inside], rtol=0.0, atol=1e-14)
    await left(live)


@in_loop
async def test_changes_without_end_are_forgotten():
    link = FakeLink()
    live = followed(link)
    for number in range(200):
        link.run(0.1)
        link.change(gap=10.0 + number)
        live.tick()
    # Of the last ten seconds, within which messages may come late
    assert len(live._stretches) == pytest.approx(101, abs=2)
    # For a page that comes later it is one turn of a knob
    (turned,) = live.hello()['changes']
    assert turned['values'] == {'gap': 209.0}
    link.run(2.0)
    link.change(gap=3.0, friction=0.1)
    live.tick()
    assert [sorted(one['values']) for one in live.hello()['changes']] == [
        ['gap'],
        ['friction', 'gap'],
    ]
    await left(live)


@in_loop
async def test_a_slow_rig_is_shown_between_its_samples(monkeypatch):
    now = [100.0]
    monkeypatch.setattr('impact_damper_ros.page.live.time.monotonic', lambda: now[0])
    link = FakeLink()
    live = followed(link)
    link.run(1.0)
    live.tick()
    assert live._instant_to_show() == pytest.approx(1.0, abs=1e-12)
    # At 1/20 of the speed 0.1 s pass between two samples.
    live.values['real_time_factor'] = 0.05
    for later, shown in ((0.0, 0.995), (0.04, 0.997), (0.1, 1.0), (5.0, 1.0)):
        now[0] = 100.0 + later
        assert live._instant_to_show() == pytest.approx(shown, abs=1e-12)
    await left(live)


@in_loop
async def test_a_run_is_known_by_its_identity(monkeypatch):
    """Not by what its clock does: a node that stood still for long and then slips is the same."""
    monkeypatch.setattr('impact_damper_ros.page.live.GONE_S', -1.0)
    link = FakeLink()
    live = followed(link)
    link.run(5.0)
    live.tick()
    assert live.news()[0]['state'] == 'gone'
    link.slip(4)
    link.run(0.1)
    live.tick()
    assert len(live.motion.samples) == 1020
    # One that is started anew is another, though it counts from the same stamp.
    link.restart(RigParameters(gap=5.0), 'change')
    link.run(3.0)
    live.tick()
    assert (len(live.motion.samples), live.values['gap']) == (600, 5.0)
    await left(live)


@in_loop
async def test_theory_of_a_change_does_not_wait_for_the_next_tick(monkeypatch):
    """Otherwise it comes with a tick."""
    monkeypatch.setattr('impact_damper_ros.page.live.time.monotonic', lambda: 100.0)
    link, texts, frames = FakeLink(), [], []
    live = followed(link)
    client = Client(sink(texts, frames), live, lambda message, _: live.handle(message))
    client.pump()
    assert not live.hasten()
    assert (await live.handle({'type': 'set', 'values': {'gap': 0.02}}))['ok']
    document = {'theory_failed': {'type': 'theory_failed', 'text': 'as it came'}}
    link.messages['theory'].append(encode(String(json.dumps(document))))
    assert live.hasten()
    assert json.loads(texts[-1]) == document['theory_failed']
    monkeypatch.setattr('impact_damper_ros.page.live.time.monotonic', lambda: 101.0)
    assert not live.hasten()
    await left(live)


@in_loop
async def test_a_page_that_comes_into_view_is_shown_what_is_new(monkeypatch):
    """Hidden, it takes a frame a second; it does not wait for the next of these."""
    monkeypatch.setattr('impact_damper_ros.page.client.time.monotonic', lambda: 100.0)
    link = FakeLink()
    live = followed(link)
    frames = []
    client = Client(sink([], frames), live, lambda message, _: live.handle(message))
    client.take('{"type": "view", "window": 30, "rate": 1}')
    await asyncio.sleep(0.0)
    for expected in (1, 1):
        link.run(0.1)
        live.tick()
        client.pump()
        assert len(frames) == expected
    client.take('{"type": "view", "window": 30, "rate": 60}')
    await asyncio.sleep(0.0)
    client.pump()
    assert len(frames) == 2
    await left(live)


@in_loop
async def test_a_node_of_another_version_is_called_so():
    link = FakeLink()
    (content,) = link.messages['snapshot']
    text = decode(STRING, content).data
    newer = json.loads(text)
    newer['state']['format'] = newest(UPGRADES) + 1
    link.messages['snapshot'] = [encode(String(json.dumps(newer)))]
    live = followed(link)
    live.tick()
    status, *_ = live.news()
    assert status['state'] == 'other_version'
    assert f'of format {newest(UPGRADES) + 1}; this version reads format' in status['text']
    # The same node, started again from the version of the page
    link.messages['snapshot'] = [content]
    link.run(0.1)
    live.tick()
    assert live.news()[0]['state'] == 'running'
    await left(live)


@in_loop
async def test_only_another_node_leaves_requests_unanswered(monkeypatch):
    """The first snapshot that comes in is not one of another node."""
    link, given_up = FakeLink(), []
    monkeypatch.setattr(link, 'begin_again', lambda: given_up.append(True))
    live = followed(link)
    live.tick()
    assert not given_up
    link.restart(RigParameters(gap=5.0))
    live.tick()
    assert given_up
    await left(live)


@in_loop
async def test_impacts_per_cycle_are_those_that_the_node_reports():
    link = FakeLink()
    live = followed(link)
    link.run(20.0)
    measured = {'Impacts per cycle of the force': '2', 'Largest X / A': ''}
    link.report((0, 'measured motion', '2 impacts in 1 cycle', measured))
    live.tick()
    (numbers,) = [one for one in live.news() if one['type'] == 'numbers']
    assert (numbers['impacts_per_cycle'], numbers['x_max_ratio']) == (2.0, None)
    assert numbers['energy_per_cycle'] is not None
    await left(live)
