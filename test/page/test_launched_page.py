"""`page:=true` of the launch file: node, server and browser, all of them real."""

import os
import signal
import sys

import pytest

pytest.importorskip('tornado', reason='the page needs Tornado')
pytest.importorskip('rclpy', reason='a live rig needs ROS')

import chromium
from launched import Launched
from node.rig_client import DEADLINE_S, RigClient, RigParametersClient, until

from page.browser import Browser
from page.page_process import PageProcess


def test_a_node_that_dies_is_reported_and_started_again(tmp_path):
    browser = Browser(chromium.needed())
    server = PageProcess(tmp_path, '--start', 'bench_rig')
    try:
        page = browser.open(server.address)
        page.wait('impactDamper.history.impacts.length > 0', DEADLINE_S)
        (node,) = server.nodes()
        os.kill(node, signal.SIGKILL)
        page.wait("document.querySelector('#toast').textContent.includes('by signal 9')")
        assert 'rig_page: the node has ended by signal 9: it is started again' in server.printed
        until(lambda: server.nodes() and server.nodes() != [node])
        frames = page.run('impactDamper.received.frames')
        page.wait(f'impactDamper.received.frames > {frames} + 20', DEADLINE_S)
    finally:
        browser.close()
        server.close()
    assert server.nodes() == []


NODE = f"""#!/bin/sh
exec {sys.executable} -m impact_damper_ros.node.sim_node "$@"
"""
# The port of the page may be taken on this machine.
PAGE = f"""#!/bin/sh
exec {sys.executable} -m impact_damper_ros.cli.rig_page --port 0 "$@"
"""


def test_launch_opens_the_page_of_its_rig(tmp_path):
    launched = Launched(tmp_path, 'impact_damper_ros', sim_node=NODE, rig_page=PAGE)
    # What a desktop calls to open an address
    address = tmp_path / 'address'
    opener = tmp_path / 'opener'
    opener.write_text(f'#!/bin/sh\necho "$1" > {address}.new && mv {address}.new {address}\n')
    opener.chmod(0o755)
    prefixes = os.pathsep.join([str(tmp_path), os.environ.get('AMENT_PREFIX_PATH', '')])
    process = launched.begin(
        *('page:=true', 'use_robot_state_publisher:=false', 'namespace:=launched'),
        *('params_file:=bench_rig', f'bag_directory:={tmp_path / "runs"}'),
        AMENT_PREFIX_PATH=prefixes,
        BROWSER=f'{opener} %s',
        DISPLAY=':7',
    )
    browser = None
    try:
        until(lambda: address.is_file() or process.poll() is not None, lambda: launched.said)
        assert process.poll() is None, launched.said
        browser = Browser(chromium.needed())
        page = browser.open(address.read_text().strip())
        page.wait('impactDamper.history.impacts.length > 0', DEADLINE_S)
        page.wait("document.querySelector('#knob-gap')?.value === '24'", DEADLINE_S)
        chosen = page.run("document.querySelector('#rig-choice').value")
        assert chosen == '/launched/sim_node'
        with RigClient() as client:
            parameters = RigParametersClient(client, chosen)
            page.type('#knob-gap', '22')
            until(lambda: parameters.get('gap') == 0.022, 'the knob turns another rig')
        # Recordings of the node are those that the page lists.
        page.click('#record')
        page.wait("document.querySelector('#record').ariaPressed === 'true'", DEADLINE_S)
        start = page.run('impactDamper.history.end')
        page.wait(f'impactDamper.history.end > {start} + 1', DEADLINE_S)
        page.click('#record')
        page.click('#recordings-open')
        page.wait("document.querySelector('.recording')", DEADLINE_S)
        assert page.console == []
    finally:
        if browser is not None:
            browser.close()
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 0, launched.said
    assert list((tmp_path / 'runs').iterdir())
