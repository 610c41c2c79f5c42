"""
The site as a reader meets it.

It builds without a warning but for what is not there, and its search finds the page.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import chromium
import pytest
from running import DEADLINE_S

import impact_damper_ros

ROOT = Path(impact_damper_ros.__file__).parents[1]
#: What users type, and the page that is to be among the first three.
SEARCHES = {
    'parameters': 'reference/parameters',
    'units': 'reference/parameters',
    'units of damping': 'reference/parameters',
    'changelog': 'start/changelog',
    'cite': 'start/citing',
    'licence': 'start/citing',
    'chatter': 'theory/chatter',
    'exit code': 'reference/commands',
    'controller': 'controllers/commands',
    'lock-step': 'controllers/lock_step',
    'noise': 'controllers/measurements',
    'score': 'controllers/scores',
    'plant': 'controllers/plant',
    'gap control': 'reference/control',
    'diagnostics': 'reference/diagnostics',
    'topics': 'reference/node',
    'browser': 'reference/page',
    'replay': 'reference/recordings',
    'CSV': 'reference/recordings',
    'shaker': 'reference/shaker',
    'ring-down': 'reference/shaker',
    'design': 'reference/design',
    'multisine': 'reference/test_signals',
    'sweep': 'reference/sweeps',
    'RViz': 'reference/viewers',
    'try': 'try_it',
    'Windows': 'start/installation',
    'stuck': 'start/trouble',
    'undecided': 'start/trouble',
    'limits': 'start/limits',
    'modal mass': 'start/your_structure',
    'restitution': 'start/your_structure',
    'symbols': 'theory/notation',
    'best gap': 'tutorials/best_gap',
    'verdict': 'reference/glossary',
    'settled': 'reference/glossary',
    'find_orbits': 'reference/python/orbits',
    'Lyapunov exponent': 'tutorials/chaos',
    'multiplier': 'reference/glossary',
    'measure R': 'start/your_structure',
    'contact force': 'start/limits',
    'two tabs': 'start/clarifications',
    'what is an impact damper': 'start/impact_damper',
    'end recording': 'reference/recordings',
    'my data': 'reference/fit',
    'exit code 1': 'reference/commands',
    'delay': 'controllers/plant',
    'own law': 'controllers/own_law',
    'actuator_speed': 'reference/control',
    'unit of joint_states': 'reference/node',
    'token': 'reference/page_network',
    'DIFFERS': 'reference/verdict',
    'stick_share': 'reference/sweep_measures',
    'Dask': 'reference/sweep_files',
    'earthquake': 'reference/test_signals',
}


#: A picture and a link of raw HTML, which Sphinx takes as they are.
MISSING = '<img src="no.png" alt="">\n\n<a href="installation.html#no">no anchor</a>\n'


class Site:
    """A copy of the documentation, built without what takes long, as figures of the gallery."""

    def __init__(self, place):
        for name in ('docs', 'examples'):
            made = shutil.ignore_patterns('_build', 'made')
            shutil.copytree(ROOT / name, place / name, ignore=made)
        (place / 'impact_damper_ros').symlink_to(ROOT / 'impact_damper_ros')
        for path in filter(Path.is_file, ROOT.iterdir()):
            shutil.copy(path, place)
        self.sources, self.pages = place / 'docs', place / 'site'
        with (self.sources / 'start' / 'citing.md').open('a', encoding='utf-8') as page:
            page.write(f'\n{MISSING}')

    def build(self):
        """Return the exit code of Sphinx, and what it printed."""
        options = ['-q', '--no-color', '-W', '--keep-going', '-b', 'html', '-t', 'quick']
        done = subprocess.run(
            [sys.executable, '-m', 'sphinx', *options, self.sources, self.pages],
            env={**os.environ, 'PYTHONPATH': str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            # It takes longest of all that a test waits for.
            timeout=4.0 * DEADLINE_S,
            check=False,
        )
        return done.returncode, done.stdout


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    for extra in ('sphinx', 'myst_parser', 'sphinx_gallery'):
        pytest.importorskip(extra)
    made = Site(tmp_path_factory.mktemp('site'))
    code, printed = made.build()
    # Nothing else is reported
    lines = [line for line in printed.splitlines() if 'WARNING' in line]
    assert (code, lines) == (
        1,
        [
            "WARNING: start/citing.html: no target of 'installation.html#no'",
            "WARNING: start/citing.html: no target of 'no.png'",
        ],
    ), printed
    return made


def test_search_finds_the_page(site):
    playwright = pytest.importorskip('playwright.sync_api')
    missed = {}
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium.needed())
        tab = browser.new_page()
        tab.set_default_timeout(1000.0 * DEADLINE_S)
        tab.goto(f'file://{site.pages}/search.html?q=gap')
        for words, page in SEARCHES.items():
            tab.evaluate(
                "words => { document.getElementById('search-results').replaceChildren();"
                ' Search.performSearch(words) }',
                words,
            )
            # The theme shows the number of results once the last one is listed.
            tab.wait_for_function(
                "/found|did not match/.test(document.querySelector('.search-summary')?.innerText)"
            )
            first = tab.evaluate(
                "[...document.querySelectorAll('ul.search > li > a')].slice(0, 3)"
                ".map(link => link.getAttribute('href').split(/\\.html/)[0])"
            )
            if page not in first:
                missed[words] = first
        browser.close()
    assert not missed


def test_a_link_of_the_lecture_moves_a_rig_in_the_browser(site):
    playwright = pytest.importorskip('playwright.sync_api')
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium.needed())
        tab = browser.new_page()
        tab.set_default_timeout(1000.0 * DEADLINE_S)
        failed = []
        tab.on('pageerror', lambda error: failed.append(str(error)))
        tab.goto(f'file://{site.pages}/tutorials/lecture.html')
        tab.get_by_role('link', name='in your browser').nth(3).click()
        tab.wait_for_function('globalThis.impactDamper?.history.impacts.length > 2')
        assert tab.url.startswith(f'file://{site.pages}/try/index.html#preset=bench')
        playwright.expect(tab.locator('#rig-line')).to_contain_text(
            'gap 27.0', timeout=1000.0 * DEADLINE_S
        )
        browser.close()
    assert failed == []


@pytest.mark.parametrize(
    ('name', 'anchor'),
    [
        ('gap_max', 'reference/control.html#gap_max'),
        ('restitution_2', 'reference/parameters.html#restitution_2'),
        ('robot_description', 'reference/node.html#robot_description'),
        ('lyapunov_exponent', 'reference/sweep_measures.html#lyapunov_exponent'),
    ],
)
def test_a_row_of_a_table_has_an_address(site, name, anchor):
    page, _, row = anchor.partition('#')
    assert f'id="{row}"' in (site.pages / page).read_text(encoding='utf-8')
    index = (site.pages / 'searchindex.js').read_text(encoding='utf-8')
    assert f'"{name}"' in index.partition('"objects":')[2].partition('"objnames":')[0]


def test_tutorials_are_notebooks_too(site):
    nbformat = pytest.importorskip('nbformat')
    pages = sorted((site.sources / 'tutorials').glob('*.md'))
    assert pages
    for page in pages:
        notebook = nbformat.read(site.pages / f'tutorials/{page.stem}.ipynb', as_version=4)
        nbformat.validate(notebook)
        blocks = re.findall(
            r'^```python\n(.*?)^```$', page.read_text(encoding='utf-8'), re.DOTALL | re.MULTILINE
        )
        code = [cell.source for cell in notebook.cells if cell.cell_type == 'code']
        assert [block.rstrip() for block in blocks] == [
            re.sub(r'^%%writefile .*\n', '', source)
            for source in code
            if not source.startswith(('%%bash', '%%writefile')) or '.py\n' in source
        ]


def test_every_public_name_has_an_entry(site):
    pages = [
        path.read_text(encoding='utf-8') for path in (site.pages / 'reference/python').iterdir()
    ]
    # Types of rows are named in a sentence.
    names = {*impact_damper_ros.__all__} - {'__version__', 'EVENT_TYPE', 'SAMPLE_TYPE'}
    assert len(names) > 40
    for name in names:
        assert any(f'id="impact_damper_ros.{name}"' in text for text in pages), name


def test_the_glossary_has_every_word_of_the_page(site):
    """The list of the page in the browser is the only one."""
    source = ROOT / 'impact_damper_ros' / 'page' / 'static' / 'glossary.js'
    words = re.findall(
        r"^  '[\w-]+': \['([^']+)'", source.read_text(encoding='utf-8'), re.MULTILINE
    )
    page = (site.pages / 'reference/glossary.html').read_text(encoding='utf-8')
    listed = re.findall(r'<dt id="term-[^"]+">(.*?)<a', page)
    assert len(words) > 40
    assert sorted(listed) == sorted(words)
