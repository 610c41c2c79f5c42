"""The rig that a browser computes: its motion against CPython's, and the page from a disk."""

import gzip
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import chromium
import pytest
from playwright.sync_api import expect

import impact_damper_ros
from impact_damper_ros.page.presets import load_presets
from page.browser import Browser
from page.compared_rigs import COMPARE, disagreements, preset_cases, random_cases

ROOT = Path(impact_damper_ros.__file__).parents[1]
if not (ROOT / 'docs' / 'in_browser').is_dir():
    pytest.skip('the documentation is not here', allow_module_level=True)
sys.path.append(str(ROOT / 'docs'))
from in_browser.build import build  # noqa: E402
from in_browser.translation import TranslationError, Translator  # noqa: E402

DESK, PHONE = (1280, 800), (360, 740)
MOVES = 'impactDamper.received.frames > 3 && impactDamper.history.impacts.length > 2'
#: Largest size of what a browser loads, without the theory of the presets, bytes.
LARGEST = 220_000


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    place = tmp_path_factory.mktemp('site') / 'try'
    build(place, with_theory=['bench'])
    return place


@pytest.fixture(scope='module')
def browser():
    browser = Browser(chromium.needed())
    yield browser
    browser.close()


@pytest.fixture
def opened(browser, site):
    """Open pages from the disk; at the end none has complained, or asked anywhere else."""
    pages, asked = [], []

    def open_page(place='', size=DESK):
        width, height = size
        page = browser.open('about:blank', width=width, height=height)
        page.tab.on('request', lambda one: asked.append(one.url))
        page.tab.goto(f'file://{site}/index.html{place}')
        pages.append(page)
        page.wait(MOVES)
        return page

    yield open_page
    consoles = [text for page in pages for text in page.console]
    for page in pages:
        page.close()
    assert consoles == []
    assert asked
    assert [url for url in asked if not url.startswith(f'file://{site}/')] == []


# The motion


def compared(page, cases):
    """Return how far the events of cases agree, by name."""
    names = list(cases)
    results = page.tab.evaluate(COMPARE, [cases[name] for name in names])
    return dict(zip(names, results, strict=True))


@pytest.fixture(scope='module')
def random():
    return dict(enumerate(random_cases(60)))


def test_random_rigs_have_every_event(opened, random):
    found = compared(opened(), random)
    wrong, chaotic = disagreements(random, found)
    assert wrong == []
    assert len(chaotic) <= 1
    agreeing = [one for name, one in found.items() if name not in chaotic]
    assert sum(one['expected'] for one in agreeing) > 1000
    assert max(one['late'] for one in agreeing) < 1e-9
    assert max(one['constants'] for one in found.values()) < 4e-15
    # All parts of a rig are among them.
    assert {case['control']['gap_control'] for case in random.values()} == {
        *('off', 'amplitude', 'timed')
    }
    assert any(any(case['rig']['base_amplitudes']) for case in random.values())


def test_presets_have_every_event(opened):
    cases = preset_cases()
    found = compared(opened(), cases)
    wrong, chaotic = disagreements(cases, found)
    assert wrong == []
    assert len(chaotic) <= 3
    assert set(load_presets()) <= set(found) - set(chaotic) | {'chaos'}


@pytest.mark.parametrize(
    ('right', 'wrong'),
    [
        # The impulse on M, the direction of friction, and what friction can hold
        ('after = (before + (', 'after = (before - ('),
        ('(constants.slope - (direction', '(constants.slope + (direction'),
        ('(need + constants.grip)', '(need - constants.grip)'),
    ],
)
def test_a_wrong_sign_is_noticed(browser, site, random, right, wrong):
    text = (site / 'rig.js').read_text(encoding='utf-8')
    assert text.count(right) == 1
    page = browser.open('about:blank')
    page.tab.add_script_tag(content=text.replace(right, wrong))
    some = {name: random[name] for name in range(30)}
    disagree, _ = disagreements(some, compared(page, some))
    page.close()
    assert len(disagree) > 3


def test_what_has_no_translation_stops_the_build(tmp_path, monkeypatch):
    place = tmp_path / 'strange.py'
    place.write_text('def f(x):\n    y = x\n    return [*y, (yield y)]\n', encoding='utf-8')
    monkeypatch.syspath_prepend(tmp_path)
    import strange

    with pytest.raises(TranslationError, match=r'strange\.py:3: no translation'):
        Translator('').program({'f': strange.f}, {})


# The page


def test_the_folder_is_small(site):
    size = sum(len(gzip.compress(path.read_bytes())) for path in site.iterdir())
    assert size < LARGEST


@pytest.mark.parametrize('size', [DESK, PHONE], ids=['desk', 'phone'])
def test_a_stranger_turns_the_gap(opened, size):
    page = opened(size=size)
    page.expect('#status').to_have_text('running')
    page.expect('#preset-name').to_have_text('Bench rig')
    page.type('#knob-gap', '12')
    page.wait("location.hash.includes('gap=0.012')")
    page.expect('#rig-line').to_contain_text('gap 12.0')
    page.type('#knob-gap', '-3')
    page.expect('[data-name=gap].big .error').to_contain_text('gap is -3.0 mm: give a number')
    page.wait('impactDamper.history.state.stop_1 - impactDamper.history.state.x < 0.0061')
    # What needs the package is not offered.
    for button in ('#record', '#recordings-open', '#rig-choice'):
        page.expect(button).to_be_hidden()
    page.expect('a[href="../start/installation.html"]').to_be_attached()
    assert page.run('document.documentElement.scrollWidth') <= size[0]


@pytest.mark.parametrize('size', [DESK, PHONE], ids=['desk', 'phone'])
def test_presets_and_their_theory(opened, size):
    page = opened(size=size)
    page.expect('#verdict-text').to_have_text('2 impacts in 1 cycle, stable')
    page.expect('#curve-line').to_contain_text('best gap 28')
    page.click('#presets-open')
    page.click('#presets [data-name=ring_down]')
    page.expect('#preset-name').to_have_text('Ring-down')
    page.wait('Math.abs(impactDamper.history.state.x) > 0.005')
    page.wait("location.hash.includes('preset=ring_down')")
    page.expect('#curve-line').to_have_text('')
    # The link starts the same rig, also after it has been loaded anew.
    page.tab.reload()
    page.wait(MOVES)
    page.expect('#preset-name').to_have_text('Ring-down')


@pytest.mark.parametrize('size', [DESK, PHONE], ids=['desk', 'phone'])
def test_a_controller_moves_the_stops(opened, size):
    page = opened('#preset=bench&gap_control=timed', size=size)
    page.wait("document.querySelector('#knob-gap_control').value === 'timed'")
    page.wait('impactDamper.history.own.acts.length > 10')
    choices = page.run(
        "[...document.querySelector('#knob-gap_control').options].map(o => o.value)"
    )
    assert choices == ['off', 'amplitude', 'timed']
    page.wait("document.querySelector('#score dd').textContent !== '–'")


@pytest.mark.parametrize('size', [DESK, PHONE], ids=['desk', 'phone'])
def test_the_base_moves(opened, size):
    page = opened('#preset=bench&force_amplitudes=[0]&base_amplitudes=[0.5]', size=size)
    page.expect('#relative-switch').to_be_visible()
    page.expect('#rig-line').to_contain_text('base')
    page.click('#relative')
    page.wait("location.hash.includes('relative=1')")
    page.wait('impactDamper.history.state && Math.abs(impactDamper.history.state.base) < 1e-9')


@pytest.mark.parametrize('size', [DESK, PHONE], ids=['desk', 'phone'])
def test_pause_steps_and_reset(opened, size):
    page = opened(size=size)
    page.click('#pause')
    page.expect('#status').to_have_text('paused')
    impacts = page.run('impactDamper.history.impacts.end')
    page.click('#step-to-impact')
    page.wait(f'impactDamper.history.impacts.end > {impacts}')
    page.expect('#status').to_have_text('paused')
    page.click('#reset')
    page.wait('Math.abs(impactDamper.history.state.x) < 1e-6')
    page.click('#pause')
    page.expect('#status').to_have_text('running')


class Folder(SimpleHTTPRequestHandler):
    """Files of a folder, without a log."""

    def log_message(self, *_arguments):
        pass


def test_in_the_page_of_a_lecture(browser, site):
    """The page is embedded, from a server, with the preset of a link."""
    link = 'try/index.html#preset=bench&gap=0.034&window=3'
    lecture = site.parent / 'lecture.html'
    lecture.write_text(
        '<!DOCTYPE html><link rel="icon" href="try/icon.svg">'
        f'<iframe src="{link}" width=800 height=700></iframe>'
    )
    with ThreadingHTTPServer(('127.0.0.1', 0), partial(Folder, directory=site.parent)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        page = browser.open(f'http://127.0.0.1:{server.server_port}/lecture.html')
        inside = page.tab.frame_locator('iframe').locator
        expect(inside('#rig-line')).to_contain_text('gap 34.0')
        expect(inside('#status')).to_have_text('running')
        inside('#glossary-open').click()
        expect(inside('#glossary')).to_be_visible()
        page.close()
        server.shutdown()
    assert page.console == []
