"""The site builds without a warning, and its links lead to a rig in the browser."""

import os
import re
import subprocess
import sys
from pathlib import Path

import chromium
import pytest
from docs.tutorial import PAGES
from running import DEADLINE_S

import impact_damper_ros

ROOT = Path(impact_damper_ros.__file__).parents[1]


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    for extra in ('jupytext', 'myst_parser', 'sphinx'):
        pytest.importorskip(extra)
    place = tmp_path_factory.mktemp('site')
    options = ['-q', '--no-color', '-W', '--keep-going', '-b', 'html']
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', *options, ROOT / 'docs', place],
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        # It takes longest of all that a test waits for.
        timeout=4.0 * DEADLINE_S,
        check=False,
    )
    # Kernels that nobody has used yet are compiled, and that is reported
    notices = [line for line in done.stdout.splitlines() if line and 'compiling the' not in line]
    assert (done.returncode, notices) == (0, [])
    return place


def test_a_link_of_the_lecture_moves_a_rig_in_the_browser(site):
    executable = chromium.needed()
    playwright = pytest.importorskip('playwright.sync_api')
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable)
        tab = browser.new_page()
        tab.set_default_timeout(1000.0 * DEADLINE_S)
        failed = []
        tab.on('pageerror', lambda error: failed.append(str(error)))
        tab.goto(f'file://{site}/lecture.html')
        tab.get_by_role('link', name='in your browser').nth(3).click()
        tab.wait_for_function('globalThis.impactDamper?.history.impacts.length > 2')
        assert tab.url.startswith(f'file://{site}/try/index.html#preset=bench')
        playwright.expect(tab.locator('#rig-line')).to_contain_text(
            'gap 27.0', timeout=1000.0 * DEADLINE_S
        )
        browser.close()
    assert failed == []


def test_tutorials_are_notebooks_too(site):
    nbformat = pytest.importorskip('nbformat')
    pages = [page for page in PAGES if '```python' in page.read_text(encoding='utf-8')]
    assert len(pages) > 4
    for page in pages:
        notebook = nbformat.read(
            site / page.relative_to(ROOT / 'docs').with_suffix('.ipynb'), as_version=4
        )
        nbformat.validate(notebook)
        blocks = re.findall(
            r'^```python\n(.*?)^```$', page.read_text(encoding='utf-8'), re.DOTALL | re.MULTILINE
        )
        code = [cell.source for cell in notebook.cells if cell.cell_type == 'code']
        assert [block.rstrip() for block in blocks] == [
            re.sub(r'^%%writefile .*\n', '', source)
            for source in code
            if not source.startswith('%%bash')
        ]
