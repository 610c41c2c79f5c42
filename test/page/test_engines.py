"""The live page, and the one without installation, in two engines."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import chromium
import pytest
from node.rig_client import SimProcess
from running import DEADLINE_S, SOURCE

from .page_process import PageProcess

SCRIPT = Path(__file__).with_name('engines.mjs')
BENCH = SOURCE / 'config' / 'bench_rig.yaml'


@pytest.fixture(params=['chrome', 'firefox'])
def shown(request):
    """Return a function that opens a page in an engine: what it has drawn, and its complaints."""
    node = shutil.which('node')
    if not (node and (SOURCE / 'node_modules' / 'puppeteer-core').is_dir()):
        pytest.skip('Node or puppeteer-core is not installed (npm install)')
    firefox = shutil.which('firefox-esr') or shutil.which('firefox')
    path = chromium.found() if request.param == 'chrome' else firefox
    if path is None:
        pytest.skip(f'{request.param} is not here (Debian: apt install chromium firefox-esr)')

    def show(address):
        # Modules are looked for from the script on
        words = [node, str(SCRIPT), request.param, path, address]
        ran = subprocess.run(words, capture_output=True, timeout=DEADLINE_S, check=False)
        assert ran.returncode == 0, ran.stderr.decode()
        found = json.loads(ran.stdout)
        assert request.param in found['engine'].lower()
        return found['drawn'], found['complaints']

    return show


def test_the_live_page(shown, tmp_path):
    directory = tmp_path / 'page'
    server = PageProcess(directory, '--node', '/sim_node')
    node = SimProcess(directory, parameters_file=BENCH)
    try:
        drawn, complaints = shown(server.address)
    finally:
        node.kill()
        server.close()
    assert complaints == []
    assert len(drawn) >= 5
    assert min(drawn.values()) > 2, drawn


def test_the_page_without_installation(shown, tmp_path):
    """From a disk."""
    if not (SOURCE / 'docs' / 'in_browser').is_dir():
        pytest.skip('the documentation is not here')
    sys.path.append(str(SOURCE / 'docs'))
    from in_browser.build import build

    build(tmp_path / 'try')
    drawn, complaints = shown(f'file://{tmp_path}/try/index.html')
    assert complaints == []
    assert len(drawn) >= 4
    assert min(drawn.values()) > 2, drawn
