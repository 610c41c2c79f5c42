"""`page:=true` of the launch file: node, server and browser, all of them real."""

import os
import signal

import pytest

pytest.importorskip('tornado', reason='the page needs Tornado')
pytest.importorskip('rclpy', reason='a live rig needs ROS')

import chromium
from running import until

from page.browser import Browser
from page.page_process import PageProcess


def test_a_node_that_dies_is_reported_and_started_again(tmp_path):
    browser = Browser(chromium.needed())
    server = PageProcess(tmp_path, '--start', 'bench_rig')
    try:
        page = browser.open(server.address)
        page.wait('impactDamper.history.impacts.length > 0')
        (node,) = server.nodes()
        os.kill(node, signal.SIGKILL)
        page.wait("document.querySelector('#toast').textContent.includes('by signal 9')")
        assert 'rig_page: the node has ended by signal 9: it is started again' in server.output
        until(lambda: server.nodes() and server.nodes() != [node])
        frames = page.run('impactDamper.received.frames')
        page.wait(f'impactDamper.received.frames > {frames} + 20')
    finally:
        browser.close()
        server.close()
    assert server.nodes() == []
