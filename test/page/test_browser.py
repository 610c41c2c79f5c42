"""The page in a real browser, with the real server and the real node, and without installation."""

import contextlib
import functools
import json
import math
import os
import re
import shutil
import signal
import subprocess
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from xml.etree import ElementTree

import chromium
import pytest

pytest.importorskip('tornado', reason='the page needs Tornado')
pytest.importorskip('rclpy', reason='a live rig needs ROS')

import numpy as np
from node.rig_client import RigClient, RigParametersClient, SimProcess
from PIL import Image
from playwright.sync_api import expect
from running import DEADLINE_S, SOURCE, until as at_once
from sensor_msgs.msg import JointState

from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.page.knobs import ALL_SPECS
from impact_damper_ros.page.presets import load_presets
from impact_damper_ros.page.recorded_source import load_recording
from page.browser import Browser
from page.page_process import PageProcess

BENCH = SOURCE / 'config' / 'bench_rig.yaml'
#: To ask a node for a value takes more of the processor than to wait for it.
until = functools.partial(at_once, pause=0.04)
DESK, PHONE = (1280, 800), (360, 740)
MOVES = 'impactDamper.store.frames > 3 && impactDamper.history.impacts.length > 2'
#: The rig goes on; beside many other programs it lags, and the page says so.
FULL = """['running', 'lagging'].includes(document.querySelector('#status').dataset.state)
    && impactDamper.history.impacts.length > 3 && document.querySelector('#knob-gap')"""
PLAYS = "document.body.classList.contains('playing') && impactDamper.history.state"
CANVASES = Path(__file__).with_name('canvases.js').read_text(encoding='utf-8')
FIREFOX = Path(__file__).with_name('firefox.mjs')
AXE = SOURCE / 'node_modules' / 'axe-core' / 'axe.min.js'
#: What axe-core finds, by rule, with the first elements of each.
ACCESSIBLE = """axe.run(document, { preload: false, runOnly: %s })
    .then(({ violations }) => violations.map(({ id, nodes }) => [
        id, nodes.slice(0, 3).map(({ target, any }) => [target.join(' '), any[0]?.message])]))"""
#: In another colour only the contrast is another one.
ALL_RULES, CONTRAST = ['wcag2a', 'wcag2aa', 'wcag21aa', 'wcag22aa'], ['color-contrast']
#: What a finger meets that is smaller than 44 pixels; the first link is for keyboards alone.
SMALL_TARGETS = """
    [...document.querySelectorAll('button, a[href]:not(.skip), input, select, summary')]
    .filter((one) => one.checkVisibility())
    .map((one) => {
        const { width, height } = (one.closest('label') ?? one).getBoundingClientRect();
        return [one.id || one.textContent, width, height]; })
    .filter(([, width, height]) => Math.min(width, height) < 43.9)"""
#: Points of the traces, and of those of the what-if.
LENGTHS = "['own', 'other'].map(name => impactDamper.history[name].samples.length)"


@pytest.fixture(scope='module')
def browser():
    browser = Browser(chromium.needed())
    yield browser
    browser.close()


@pytest.fixture(scope='module')
def tab(browser):
    """Open the tab that the tests share, each with a page of its own."""
    return browser.open()


@pytest.fixture(scope='module')
def live(tmp_path_factory):
    """Start a bench rig and a server; return the server."""
    directory = tmp_path_factory.mktemp('live')
    server = node = None
    try:
        # Whatever other rigs the tests start, this one is shown first.
        server = PageProcess(directory, '--node', '/sim_node')
        # Half of the usual rate takes half of the processor's time of node and server.
        setting = {'state_rate': 100.0, 'bag_directory': str(server.recordings)}
        node = SimProcess(directory, parameters_file=BENCH, **setting)
        yield server
    finally:
        if node is not None:
            node.kill()
        if server is not None:
            server.close()


@pytest.fixture(scope='module')
def parameters():
    """Return the parameters of the rig, as another program in the network sees them."""
    # To look 200 times a second takes 3 % of a processor.
    with RigClient(pause=0.02) as client:
        yield RigParametersClient(client)


@pytest.fixture
def opened(tab, live):
    """Open pages, and hold at the end that none of them had to complain."""

    def open_page(place='', size=DESK, ready=FULL):
        tab.visit(live.address + place, size)
        tab.wait(ready)
        return tab

    yield open_page
    tab.leave()
    assert tab.console == []


@pytest.fixture
def theory(live, parameters):
    """Let the node compute the theory of its rig."""
    del live
    assert parameters.set(predict_motion=True) == ''


@pytest.fixture(scope='module')
def start(parameters):
    """Return the parameters of the rig at the start, by name."""
    names = [name for name, spec in ALL_SPECS.items() if spec.effect != 'start']
    return dict(zip(names, parameters.get(*names), strict=True))


@pytest.fixture(autouse=True)
def _as_before(request):
    """
    Put the rig back to what it was, where a test has one.

    All of it: a rig whose force is left beside the resonance has hardly an impact.
    """
    uses = {'live', 'opened'} & set(request.fixturenames)
    before = request.getfixturevalue('start') if uses else {}
    yield
    if uses:
        rig = request.getfixturevalue('parameters')
        assert rig.set_atomically(**before) == ''
        assert rig.service('pause', data=False).success
        assert rig.service('reset').success


def picture(page, selector='#rig-canvas'):
    return page.run(f"document.querySelector('{selector}').toDataURL()")


def assert_drawn(canvases):
    """Assert that each plot has its lines and letters."""
    assert len(canvases) >= 4
    assert min(canvases.values()) > 2, canvases


def scrub(page, time):
    page('#scrub').evaluate(
        "(one, time) => { one.value = time; one.dispatchEvent(new Event('change')); }", time
    )


def bags(live):
    return set(live.recordings.glob('*'))


# Knobs


def test_a_knob_is_turned_here_and_elsewhere(opened, parameters):
    page = opened()
    page.expect('#knob-gap').to_have_value('24')
    # Some cycles of the force, and not a comb of 150
    page.expect('#windows [aria-pressed=true]').to_have_attribute('value', '3')
    page.type('#knob-gap', '30')
    until(lambda: parameters.get('gap') == 0.03, 'the parameter has not changed')
    # The stops in the picture follow, and a labelled line marks the change.
    page.wait('(s => Math.abs(s.stop_1 - s.stop_2 - 0.03) < 1e-6)(impactDamper.history.state)')
    page.expect('#legend [data-series=stop] dd').to_have_text('30.0 mm')
    page.wait("impactDamper.history.changes.some(({text}) => text === 'd = 30 mm')")
    page.expect('#rig-line').to_contain_text('30.0')
    # Somebody has just gone to the field: what is typed next replaces whatever comes in.
    page('#knob-gap').blur()
    page('#knob-gap').focus()
    assert parameters.set(gap=0.0215) == ''
    page.expect('#knob-gap').to_have_value('21.5')
    page.wait("impactDamper.history.changes.some(({text}) => text === 'd = 21.5 mm')")
    page.tab.keyboard.insert_text('23')
    page.key('Enter')
    until(lambda: parameters.get('gap') == 0.023, lambda: parameters.get('gap'))
    # A slider sends where it is dragged to; `history.test.js` has the lines that this makes.
    page.run("""(slider => { slider.value = 520; slider.dispatchEvent(new Event('input')); })(
        document.querySelector('.knob[data-name=gap].big input[type=range]'))""")
    page.wait('impactDamper.history.changes.at(-1).drag > 0')
    page('.knob[data-name=gap].big input[type=range]').dispatch_event('change')
    # The arrow keys go on from what was typed, with its comma and its unit.
    page.type('#knob-gap', '24,5 mm', enter=False)
    page.key('ArrowUp')
    until(lambda: parameters.get('gap') == pytest.approx(0.0255))
    # Parameters are found by their meaning.
    page('#more-knobs summary').click()
    page.type('#knob-search', 'compressed air')
    shown = page('#all-knobs .knob:visible')
    assert shown.evaluate_all('all => all.map(one => one.dataset.name)') == ['air_force']
    page('#more-knobs summary').click()
    # The speed of the rig is a knob, too.
    for value, factor in (('0.2', 0.2), ('1', 1.0)):
        page('#rig-speed').select_option(value)
        until(lambda factor=factor: parameters.get('real_time_factor') == factor)
    assert parameters.set(real_time_factor=0.5) == ''
    page.expect('#rig-speed option[data-own]').to_have_text('0.50×')
    assert parameters.set(real_time_factor=1.0) == ''
    page.expect('#rig-speed').to_have_value('1')
    # The unit stays: who has typed millimetres would set metres with the next number.
    for text, gap, shown in (('600', 0.6, '600'), ('0.023m', 0.023, '23')):
        page.type('#knob-gap', text)
        until(lambda gap=gap: parameters.get('gap') == gap, text)
        page.expect('#knob-gap').to_have_value(shown)
    page.type('#knob-gap', '-5')
    page.expect('#knob-gap-error').to_have_text(
        'gap is -5.0 mm: give a number from 1e-06 to 1e+12 mm'
    )
    page.expect('#knob-gap').to_have_attribute('aria-invalid', 'true')
    page.key('Escape')
    page.expect('#knob-gap').to_have_value('23')
    page.expect('#knob-gap-error').to_be_hidden()
    # What is being typed stays, whatever comes in meanwhile.
    page.type('#knob-force_frequencies', '6', enter=False)
    assert parameters.set(force_frequencies=[math.tau * 4.0]) == ''
    page.expect('#rig-line').to_contain_text('4.000')
    page.key('Enter')
    until(lambda: parameters.get('force_frequencies') == [pytest.approx(math.tau * 6.0)])


# The rig, and what is drawn of it


def test_keys_and_hands_move_the_rig(opened, parameters):
    page = opened()
    # The space bar holds the rig, and lets it go; L is large type; other letters do nothing.
    for pressed in ('true', 'false'):
        page.key('Space')
        page.expect('#pause').to_have_attribute('aria-pressed', pressed)
    for pressed in ('true', 'false'):
        page.key('l')
        page.expect('#large').to_have_attribute('aria-pressed', pressed)
    start = page.run('impactDamper.history.changes.length')
    for key in 'abcdefghijkmnopqrstuvwxyz.,':
        page.key(key)
    end = page.run('impactDamper.history.end')
    page.wait(f'impactDamper.history.end > {end} + 0.3')
    assert page.run('impactDamper.history.changes.length') == start
    # Little moves where that is asked for.
    moves = "getComputedStyle(document.querySelector('.knob.turned')).animationName"
    page.run("document.querySelector('.knob').classList.add('turned')")
    assert page.run(moves) == 'turned'
    page.shade(dark=False, calm=True)
    assert page.run(moves) == 'none'
    page.shade(dark=False)
    step = page.expect('#step')
    # A rig that moves has no steps.
    step.to_have_attribute('aria-disabled', 'true')
    page('#step').click(force=True)
    page.click('#pause')
    page.expect('#status').to_have_text('paused')
    step.to_have_attribute('aria-disabled', 'false')
    length = page.run('impactDamper.history.own.samples.length')
    assert length > 10
    for press in (
        lambda: page.click('#step'),
        lambda: page.key('Shift+ArrowRight'),
        # The focus stays on the button, from one step to the next.
        lambda: page.run('document.activeElement.click()'),
    ):
        # What is pressed before the answer to the last step is dropped.
        page.wait('!impactDamper.actions.stepping')
        end = page.run('impactDamper.history.end')
        press()
        page.wait(f'impactDamper.history.end > {end}')
        step.to_have_attribute('aria-disabled', 'false')
        assert page.run('impactDamper.history.end') == pytest.approx(end + 0.01, abs=1e-6)
    newest = "(all => all.field('time')[all.end - 1])(impactDamper.history.impacts)"
    for press in (lambda: page.click('#step-to-impact'), lambda: page.key('ArrowRight')):
        page.wait('!impactDamper.actions.stepping')
        last = page.run(newest)
        press()
        page.wait(
            f"{newest} > {last} && document.querySelector('#status').textContent === 'paused'"
        )
        hit, end = page.run(f'[{newest}, impactDamper.history.end]')
        assert 0.0 <= end - hit <= 0.01 + 1e-6
    # What was there before the steps is there still.
    assert page.run('impactDamper.history.own.samples.length') >= length
    # The stops, m and M are dragged.

    def place(u, v='0'):
        # The picture goes smoothly to another scale.
        until(
            lambda: page.run("""(async ({ rig }) => {
            const before = rig.plan?.scale;
            for (let n = 0; n < 3; n += 1) await new Promise(requestAnimationFrame);
            return before !== undefined && rig.plan.scale === before; })(impactDamper)""")
        )
        return page.run(f"""(({{ rig, history: {{ state }} }}) => {{
            const {{ scale, slug, left, right, up, down }} = rig.plan;
            const box = rig.canvas.getBoundingClientRect();
            return [box.left + rig.width / 2 + {u} - (left + right) / 2,
                box.top + rig.height / 2 + {v} + (up - down) / 2, scale]; }})(impactDamper)""")

    def drag(begin, metres):
        left, top, scale = begin
        page.tab.mouse.move(left, top)
        page.tab.mouse.down()
        page.tab.mouse.move(left + 0.5 * scale * metres, top)
        page.tab.mouse.move(left + scale * metres, top)
        page.tab.mouse.up()

    # Stop 1 by 3 mm: the gap is wider by twice that.
    drag(place('state.stop_1 * scale + slug'), 0.003)
    until(lambda: parameters.get('gap') == pytest.approx(0.03, abs=4e-4), parameters.get('gap'))
    page.wait(
        f'Math.abs(impactDamper.history.state.stop_1 - impactDamper.history.state.x - '
        f'{parameters.get("gap") / 2}) < 1e-6'
    )
    # m is let go where it is left, once; the next reset is from where it was.
    page.click('#reset')
    page.wait('impactDamper.history.state.z === 0 && impactDamper.history.state.x === 0')
    drag(place('state.z * scale'), 0.006)
    page.wait('Math.abs(impactDamper.history.state.z - 0.006) < 4e-4')
    until(lambda: parameters.get('initial_damper_offset') == 0.0)
    page.click('#reset')
    page.wait('impactDamper.history.state.z === 0')
    # and M with m in it, between m and stop 2 whatever the scale
    drag(place('0.5 * state.stop_2 * scale - slug'), -0.004)
    page.wait('Math.abs(impactDamper.history.state.x + 0.004) < 4e-4')
    # An impact that does not come is reported.
    assert parameters.set(gap=1000.0) == ''
    page.wait('!impactDamper.actions.stepping')
    page.click('#step-to-impact')
    page.expect('#toast').to_contain_text('No impact so far')


# Theory


@pytest.mark.usefixtures('theory')
def test_theory_is_drawn_and_its_curve_sets_the_gap(opened, parameters):
    page = opened()
    value = "#numbers div:has([data-term='best-gap']) dd"
    assert parameters.set(gap=0.0233) == ''
    page.expect('#knob-gap').to_have_value('23.3')
    page.wait('impactDamper.theory.curve?.gap === 0.0233')
    page.wait('impactDamper.theory.orbit?.complete')
    page.expect(value).to_have_attribute('title', '')
    optimum = page.run('impactDamper.theory.curve.optimum.gap')
    # Numbers come twice a second, theory as soon as it is known.
    ratio = pytest.approx(0.0233 / optimum, abs=6e-3)
    until(lambda: float(page(value).text_content()) == ratio, 'not the gap of the rig')
    page.expect('#curve-line').to_have_text(re.compile(r'^best gap \d'))
    # A gap out of all proportion leaves the scales.
    beyond, high = page.run("""(({ curve, store }) => {
        store.values.gap = 1e6;
        curve.stale = true;
        curve.draw();
        store.values.gap = 0.0233;
        return [curve.beyond, curve.high]; })(impactDamper)""")
    assert beyond
    assert high < 0.5
    # All of it is switched off and on. Nothing comes in that would have it drawn.
    page.click('#pause')
    page.expect('#status').to_have_text('paused')
    page.wait('impactDamper.history.paused && impactDamper.theory.orbit?.found')
    page.drawn()
    now = page('#legend [data-series=x] dd').text_content()
    page('#plot-canvas').hover(position={'x': 800, 'y': 60}, force=True)
    page.expect('#legend [data-series=x] dd').to_have_text(
        re.compile(f'^(?!{re.escape(now)})[\\d.−]+ mm$')
    )
    page.tab.mouse.move(1, 1)
    page.expect('#legend [data-series=x] dd').to_have_text(now)
    names = '#portrait-canvas', '#map-canvas', '#plot-canvas'
    for _ in ('off', 'on'):
        page.drawn()
        shown = {name: picture(page, name) for name in names}
        page.click('#theory')
        for name in names:
            until(lambda n=name, s=shown[name]: picture(page, n) != s, f'{name} is not drawn')
    page.click('#pause')
    # A click on the curve sets the gap, and the keyboard does, by one per cent.
    curve = page('#curve-canvas')
    curve.scroll_into_view_if_needed()
    box = curve.bounding_box()
    curve.click(position={'x': 0.6 * box['width'], 'y': 0.5 * box['height']}, force=True)
    until(lambda: parameters.get('gap') != 0.0233, 'the click has set nothing')
    here = parameters.get('gap')
    assert 0.001 < here < 0.2
    page.wait(f"Math.abs(document.querySelector('#curve-canvas').ariaValueNow - {here}) < 1e-6")
    curve.focus()
    # Special points are named by the keys, and by the pointer as the values under it are.
    page.wait('impactDamper.theory.curve?.special.length > 1')
    page.wait('impactDamper.curve.marks.length > 1')
    page.tab.mouse.move(1, 1)
    page.key('n')
    page.expect('#curve .read-out').to_have_text(re.compile(r' at [\d.]+.mm, Xmax.A [\d.]+\. \w'))
    same = (
        "document.querySelector('#curve-canvas').ariaDescription"
        " === document.querySelector('#curve .read-out').textContent"
    )
    page.wait(same)
    # The point keeps its name where the scale of the plot is another one.
    page.resize(1100, 800)
    page.drawn()
    page.expect('#curve .read-out').to_have_text(re.compile(r' at [\d.]+.mm, Xmax.A'))
    page.wait(same)
    page.resize(*DESK)
    for plot, words in (('portrait', 'Y .*Y′'), ('map', 'phase .*Z′ after'), ('curve', 'd .*mm')):
        place = page(f'#{plot}-canvas')
        place.hover(position={'x': 120, 'y': 90}, force=True)
        page.expect(f'#{plot} .read-out').to_have_text(re.compile(words))
    page('#multipliers-canvas').hover(position={'x': 9, 'y': 9}, force=True)
    page.expect('#verdict .read-out').to_have_text(re.compile('λ. .*°'))
    page.key('ArrowRight')
    until(lambda: parameters.get('gap') == pytest.approx(1.01 * here, rel=1e-3))


# Presets


def assert_loaded(parameters, name):
    """Assert that the rig is that of a preset; what each sets is in `test_presets`."""
    asked = load_presets()[name].values
    names = ['gap', 'primary_mass', 'angle', 'gap_control', 'friction']
    have = dict(zip(names, parameters.get(*names), strict=True))
    assert have == {key: asked[key] for key in names}, name


def test_presets_load_and_scales_follow(opened, parameters):
    page = opened()
    page.click('#windows [value="30"]')
    page.type('#knob-gap', '1e6 m')
    until(lambda: parameters.get('gap') == 1e6)
    page.expect('#knob-gap-error').to_contain_text('This is far')
    page.wait('impactDamper.history.state.stop_1 > 1e5')
    # Traces and picture are of what moves, not of stops that are kilometres away.
    page.wait("!document.querySelector('#legend [data-series=x] dd').textContent.endsWith(' m')")
    page.wait('impactDamper.rig.plan.spread < 100')
    # With a preset they are those of another rig, before what was shown has left the window.
    page.click('#presets-open')
    page.expect('#presets svg.sketch').to_have_count(len(load_presets()))
    page.click('#presets button[data-name=bench]')
    page.expect('#knob-gap').to_have_value('24')
    end = page.run('impactDamper.history.end')
    page.wait('impactDamper.rig.plan.spread < 0.05')
    assert page.run('impactDamper.history.end') - end < 25.0
    # The last impacts in slow motion
    page.click('#slow')
    blank = picture(page, '#slow-canvas')
    page.wait("document.querySelector('#slow-canvas').width > 300")
    until(lambda: picture(page, '#slow-canvas') != blank)
    page.click('#presets-open')
    page.click('#presets button[data-name=control_changing_load]')
    page.wait("location.hash.includes('preset=control_changing_load')")
    assert_loaded(parameters, 'control_changing_load')
    # Chosen elsewhere it is named, too, and its theory is shown though its gap cannot be changed.
    assert parameters.set_atomically(**load_presets()['bouncing_ball'].values) == ''
    assert parameters.set(predict_motion=True) == ''
    page.expect('#preset-name').to_have_text('Bouncing ball')
    page.wait("impactDamper.history.changes.at(-1).text === 'Bouncing ball'")
    page.wait("location.hash.includes('preset=bouncing_ball')")
    page.wait('impactDamper.theory.curve?.text.includes("one-sided")')
    assert page.run('impactDamper.theory.orbit.found')


# Links


def test_the_address_reproduces_the_rig(opened, parameters):
    directory = parameters.get('bag_directory')
    # Whether and where the node records is not for a link to say.
    rest = 'friction=0.03&window=3&record=true&bag_directory=/tmp'
    page = opened(f'#preset=bench&gap=0.0225&{rest}')
    until(lambda: parameters.get('gap') == 0.0225 and parameters.get('friction') == 0.03)
    assert parameters.get('record', 'bag_directory') == [False, directory]
    page.expect('#windows [aria-pressed=true]').to_have_attribute('value', '3')
    page.type('#knob-gap', '23')
    page.wait("location.hash.includes('gap=0.023') && location.hash.includes('preset=bench')")
    # Turned by others, it is in the link too; where the node records is not.
    assert parameters.set(restitution_2=0.55, bag_directory='elsewhere') == ['', '']
    page.expect('#knob-restitution_2').to_have_value('0.55')
    page.click('#link')
    page.wait("location.hash.includes('restitution_2=0.55')")
    link = page.run('location.hash')
    assert 'gap=0.023' in link
    assert 'friction=0.03' in link
    assert 'elsewhere' not in link
    assert 'stiffness' not in link
    # Loaded anew, the page leaves the rig as it is by then.
    assert parameters.set(gap=0.026) == ''
    page.tab.reload()
    page.wait(FULL)
    page.expect('#knob-gap').to_have_value('26')
    page.expect('#preset-name').to_have_text('Bench rig')
    # Another link is pasted into the open tab.
    page.run("location.hash = '#gap=21.5%20mm&window=10'")
    until(lambda: parameters.get('gap') == 0.0215)
    page.expect('#knob-gap').to_have_value('21.5')
    page.expect('#windows [aria-pressed=true]').to_have_attribute('value', '10')
    page.wait("location.hash.includes('gap=0.0215&')")
    page.run("location.hash = '#gap=12'")
    page.expect('#toast').to_contain_text('gap=12 without a unit: that is 12.0 m')
    until(lambda: parameters.get('gap') == 12.0)


def test_another_machine_watches_and_sees_that(tab, live, parameters, tmp_path):
    del live
    arguments = '--node', '/sim_node', '--host', '0.0.0.0'
    server = PageProcess(tmp_path / 'server', *arguments, elsewhere=True)
    address = f'http://127.0.0.1:{server.port}/'
    token = server.address.partition('?')[2]
    try:
        # What the address asks for is not done, and the rig is called by what it is. A token of
        # another start of the server is called so.
        page = tab.visit(f'{address}?token=wrong#preset=chaos&gap=0.03')
        page.expect('#toast').to_contain_text('makes a new one at each start')
        page.wait(f"{FULL} && location.search === ''")
        page.expect('#watching').to_be_visible()
        page.expect('#preset-name').to_have_text('Bench rig')
        for selector in ('#pause', '#reset', '#record', '#presets-open', '#tour-open'):
            page.expect(selector).to_be_hidden()
        page.expect('#knob-gap').to_be_disabled()
        page.key('Space')
        assert parameters.set(gap=0.025) == ''
        page.expect('#knob-gap').to_have_value('25')
        page.expect('#preset-name').to_have_text('')
        page.expect('#status').not_to_have_text('paused')
        assert page.run('impactDamper.actions.connection.ids') == 0
        # Who has the token steers, also after a link without it was opened.
        page.visit(f'{address}?{token}').wait(FULL)
        assert 'token' not in page.run('location.href')
        page.visit(address).wait(FULL)
        page.expect('#watching').to_be_hidden()
        page.context.grant_permissions(['clipboard-read', 'clipboard-write'])
        page.click('#link')
        page.expect('#toast').to_contain_text('watches')
        link = page.run('navigator.clipboard.readText()')
        assert token not in link
        assert link.endswith(page.run('location.hash'))
        page.type('#knob-gap', '26')
        until(lambda: parameters.get('gap') == 0.026)
        assert page.console == []
    finally:
        tab.leave()
        tab.context.clear_cookies()
        server.close()


# Rules


#: The controls that are in the page now, and the one that has the focus with whether that is seen.
KEYBOARD = """
document.querySelector('.skip').focus();
globalThis.controls = [...document.querySelectorAll(
    'a[href], button, select, input, summary, [tabindex="0"]')]
    .filter(one => one.checkVisibility({ visibilityProperty: true }) && !one.disabled);
globalThis.named = one => one.id || `${one.closest('[data-name], section, aside')?.dataset.name
    ?? one.closest('section, aside')?.id} ${one.dataset.term || one.value || one.textContent}`;
globalThis.tabbed = () => {
    const one = document.activeElement;
    if (one === document.body) return null;
    const { outlineStyle, outlineWidth, boxShadow } = getComputedStyle(one);
    const outlined = outlineStyle !== 'none' && parseFloat(outlineWidth) > 0;
    return [named(one), outlined || boxShadow !== 'none'];
}; 0"""


def within(page):
    """Return what is beyond an edge of the window, too small for a finger, or cut."""
    cut = page.run("""[...document.querySelectorAll('button, select, input, canvas, h2')]
        .filter(one => one.getClientRects().length && !one.closest('.visually-hidden'))
        .filter(one => { const box = one.getBoundingClientRect();
            return box.left < -1 || box.right > innerWidth + 1; })
        .map(one => one.id || one.textContent)""")
    small = page.run("""[...document.querySelectorAll(
        'button:not(.term), select, input:not([type=checkbox]), summary, .switch')]
        .filter(one => one.getClientRects().length && !one.closest('.visually-hidden, .skip'))
        .map(one => [one.id || one.textContent.trim(), one.getBoundingClientRect()])
        .filter(([, box]) => box.height < 23.9 || box.width < 23.9)
        .map(([name, box]) => [name, box.width, box.height])""")
    words = page.run("""[...document.querySelectorAll('.knob label, .knob .unit')]
        .filter(one => one.scrollWidth > one.clientWidth).map(one => one.textContent)""")
    return cut, small, words


def test_everything_is_in_sight_large_enough_and_accessible(opened):
    """By axe-core: names, roles, contrast in both colours, sizes of targets."""
    axe = AXE.exists()
    page = opened(size=(360, 780))
    page.run("document.querySelector('#more-knobs').open = true")
    if axe:
        page.run(f'{AXE.read_text(encoding="utf-8")}; 0')
    for size in ((360, 780), (768, 1024), (1280, 800), (2560, 1440)):
        page.resize(*size)
        page.drawn()
        assert within(page) == ([], [], []), size
        assert page.run('document.documentElement.scrollWidth') <= size[0]
        for dark, rules in (
            ((False, ALL_RULES), (True, CONTRAST)) if axe and size[0] < 2000 else ()
        ):
            page.shade(dark)
            page.drawn()
            assert page.run(ACCESSIBLE % rules) == [], (size, dark)
    # On a phone all is as large as a finger, also above the page
    page.resize(390, 600)
    for name in ('presets', 'pictures', 'recordings', 'structure', 'glossary', 'tour'):
        page.run(f"document.querySelector('#{name}-open').click()")
        page.expect(f'#{name}').to_be_visible()
        assert page.run(SMALL_TARGETS) == [], name
        close = 'one.matches("dialog") ? one.close() : one.hidePopover()'
        page.run(f"(one => {{ {close}; }})(document.querySelector('#{name}'))")
    # The rig while a knob is turned, and the meaning of a word
    page('#knob-restitution_2').focus()
    page.expect('#rig-canvas').to_be_in_viewport(ratio=0.9)
    page.expect('#knob-restitution_2').to_be_in_viewport(ratio=1.0)
    page.resize(360, 700)
    page.click('#verdict button[data-term=multiplier]')
    page.expect('#term').to_contain_text('unit circle')
    page.expect('#term').to_be_in_viewport(ratio=1.0)
    page.key('Escape')
    page.resize(*DESK)
    page.drawn()
    assert_drawn(page.run(CANVASES))
    # By the Tab key alone each control is reached, once, and seen to be
    page.run("document.querySelector('#more-knobs').open = false")
    page.run(KEYBOARD)
    reached = []
    wanted = set(page.run('controls.map(named)'))
    # Twice round: what the rig brings to the page may take the focus back to its beginning
    for _ in range(2 * len(wanted) + 10):
        if (at := page.run('tabbed()')) and at not in reached:
            reached.append(at)
        if wanted <= {name for name, _ in reached}:
            break
        page.key('Tab')
    assert wanted == {name for name, _ in reached}
    assert [name for name, seen in reached if not seen] == []
    if not axe:
        pytest.skip('axe-core is not installed (npm install)')


def test_a_journey_on_a_phone(opened, live, parameters, tmp_path):
    """Each control is pressed where it is seen, with nothing before it."""
    page = opened(size=(390, 844))
    # A knob
    page('#knob-gap').click()
    page.tab.keyboard.insert_text('26')
    page.key('Enter')
    until(lambda: parameters.get('gap') == 0.026)
    # The best gap of the curve
    assert parameters.set(predict_motion=True) == ''
    page.wait('impactDamper.theory.curve?.branches.length > 0')
    # There is nothing to click before it is drawn, two pictures of a page just opened later.
    page.drawn()
    box = page('#curve-canvas').bounding_box()
    page('#curve-canvas').click(position={'x': 0.6 * box['width'], 'y': 0.5 * box['height']})
    until(lambda: parameters.get('gap') != 0.026)
    assert parameters.set(predict_motion=False) == ''
    # Steps to an impact
    page('#pause').click()
    page.expect('#status').to_have_text('paused')
    page.wait('impactDamper.history.paused')
    end = page.run('impactDamper.history.end')
    page('#step-to-impact').click()
    page.wait(f'impactDamper.history.end > {end}')
    page.expect('#status').to_have_text('paused')
    page('#pause').click()
    # A preset
    page('#presets-open').click()
    page('#presets [data-name=ring_down]').click()
    page.expect('#preset-name').to_have_text('Ring-down')
    assert_loaded(parameters, 'ring_down')
    page('#presets-open').click()
    page('#presets [data-name=bench]').click()
    page.expect('#preset-name').to_have_text('Bench rig')
    # A recording is made and downloaded, as it is.
    there = bags(live)
    page('#record').click()
    page.expect('#record').to_have_attribute('aria-pressed', 'true')
    start = page.run('impactDamper.history.end')
    page.type('#knob-gap', '28')
    page.wait(f'impactDamper.history.end > {start} + 2.5')
    page('#record').click()
    page.expect('#record').to_have_attribute('aria-pressed', 'false')
    until(lambda: parameters.get('record') is False)
    assert parameters.set(gap=0.024) == ''
    (bag,) = bags(live) - there
    row = f'.recording[data-name="{bag.name}"]'
    page('#recordings-open').click()
    page.wait(f"/\\d B$|kB$|MB$/.test(document.querySelector('{row} p').textContent)")
    with page.tab.expect_download() as download:
        page(f'{row} a[download]').click()
    (source,) = bag.glob('*.mcap')
    copy = tmp_path / source.name
    download.value.save_as(copy)
    assert copy.read_bytes() == source.read_bytes()
    assert replay_run([str(copy)]) == 0
    # It is played to its end.
    page(f'{row} .primary').click()
    page.wait(PLAYS)
    page('[aria-label="On to the next impact"]').click()
    page.expect('#play').to_have_text('Play')
    page('#play').click()
    page('#speed').select_option('5')
    page.expect('#status').to_have_text('ended')
    # The last frame comes after the word.
    page.wait("Math.abs(impactDamper.history.end - document.querySelector('#scrub').max) < 0.1")
    # The address has its time, not that of the rig before, and changes the words of the live page.
    scrub(page, 0)
    time = 'Number(/time=([\\d.]+)/.exec(location.hash)?.[1])'
    page.wait(f"Math.abs({time} - document.querySelector('#scrub').min) < 0.1")
    assert page.run('impactDamper.history.changes.map(({text}) => text)') == ['d = 28 mm']
    # Another rig beside it: the knob is its own, what is written over the picture the recording's.
    page.type('#knob-gap', '20')
    page.wait('impactDamper.history.ghost !== null')
    page.expect('#totals').to_contain_text('impacts')
    page('#play').click()
    page.expect('#rig-line').to_contain_text('28.0')
    page.expect('#knob-gap').to_have_value('20')
    page.expect('#status').to_have_text('ended')
    page.wait(f'{LENGTHS}[1] > 100 && {LENGTHS}[0] === {LENGTHS}[1]')
    page.wait(
        "/^X .+ mm, Z .+ mm$/.test(document.querySelector('#legend [data-series=ghost] dd')"
        '.textContent)'
    )
    # The link has it too.
    page.wait("location.hash.includes('gap=0.02')")
    page.tab.reload()
    page.wait(f'{LENGTHS}?.[1] > 100')
    page.expect('#knob-gap').to_have_value('20')
    page('#clear-ghost').click()
    page.wait(f'{LENGTHS}[1] === 0 && impactDamper.history.ghost === null')
    page.expect('#legend [data-series=ghost]').to_be_hidden()
    page('#back-live').click()
    page.wait(FULL)
    page.wait('!/bag=|gap=/.test(location.hash)')
    page.expect('#knob-gap').to_have_value('24')
    shutil.rmtree(bag)
    # The tour, which leaves the gap control as it was
    assert parameters.set(gap_control='amplitude') == ''
    page.expect('#knob-gap_control').to_have_value('amplitude')
    page('#tour-open').click()
    for step in range(1, 7):
        page.expect('#tour-count').to_have_text(f'Step {step} of 6')
        page.expect('.toured').to_have_count(1)
        page.expect('#tour').to_be_in_viewport(ratio=1.0)
        if step == 6:
            page('#tour-try').click()
            until(lambda: parameters.get('gap_control') == 'timed')
        page('#tour-next').click()
    page.expect('#tour').to_be_hidden()
    page.expect('#tour-open').to_be_focused()
    until(lambda: parameters.get('gap_control') == 'amplitude')


def test_firefox_shows_both_pages(live, site):
    """The live one, and from a disk the one without installation; Chromium by all other tests."""
    node, browser = shutil.which('node'), shutil.which('firefox-esr') or shutil.which('firefox')
    if not (node and browser and (SOURCE / 'node_modules' / 'puppeteer-core').is_dir()):
        pytest.skip('Firefox, Node or puppeteer-core is not here (apt install firefox-esr nodejs)')
    addresses = [live.address, f'file://{site}/index.html']
    # Modules are looked for from the script on.
    words = [node, str(FIREFOX), browser, *addresses]
    ran = subprocess.run(words, capture_output=True, timeout=DEADLINE_S, check=False)
    assert ran.returncode == 0, ran.stderr.decode()
    found = json.loads(ran.stdout)
    assert 'firefox' in found['version'].lower()
    assert len(found['shown']) == len(addresses)
    for one in found['shown']:
        assert one['complaints'] == []
        assert_drawn(one['canvases'])


# Nodes and servers that come and go


def test_a_node_comes_back_with_a_controller(opened, tmp_path):
    """What the controller sees and commands in the traces, the age of its commands, and faults."""
    runs, space = tmp_path / 'runs', '/of_a_controller'
    name = f'{space}/sim_node'

    def start(place, **setting):
        return SimProcess(tmp_path / place, [f'__ns:={space}'], parameters_file=BENCH, **setting)

    with contextlib.ExitStack() as nodes:
        node = nodes.enter_context(start('first'))
        page = opened()
        page('#rig-choice').select_option(name)
        page.expect('#rig-choice').to_have_value(name)
        page.wait(FULL)
        page.wait(f"location.hash.startsWith('#rig={name}')")
        node.kill()
        page.expect('#status').to_have_text('rig gone')
        page.expect('#curtain').to_contain_text('does not answer')
        setting = {'gap_control': 'external', 'measurement_rate': 50.0}
        changed = {'gap': 0.02, 'real_time_factor': 0.9, 'bag_directory': str(runs)}
        nodes.enter_context(start('second', **setting, **changed))
        page.expect('#knob-gap').to_have_value('20')
        # Also what no snapshot holds
        page.expect('#rig-speed').to_have_value('0.9')
        page.expect('#curtain').to_be_hidden()
        client = nodes.enter_context(RigClient())
        rig = RigParametersClient(client, f'{space}/sim_node')
        assert rig.set(record=True) == ''
        stops = client.node.create_publisher(JointState, f'{space}/stop_commands', 10)
        command = JointState(name=['stop_1', 'stop_2'], position=[0.009, -0.009])
        ended = threading.Event()

        def publish():
            while not ended.wait(0.1):
                stops.publish(command)

        controller = threading.Thread(target=publish)
        controller.start()
        nodes.callback(ended.set)
        page.wait('impactDamper.history.own.measured.length > 30')
        page.expect('#command-age').to_contain_text('Controller: commands are carried out, ')
        page.wait('(acts => acts.field("stop_1")[acts.end - 1])(impactDamper.history.own.acts)')
        # A measurement is on the line of the motion, as there is no noise.
        page.wait("""(({ own }) => Math.max(...[...Array(20).keys()].map(n => {
            const seen = own.measured.row(own.measured.end - 21 - n);
            const { x, z } = own.at(seen.time);
            return Math.max(Math.abs(x - seen.x), Math.abs(z - seen.z)); })))(
            impactDamper.history) < 1e-5""")
        for key in ('measured', 'commands'):
            page.expect(f'#legend [data-series={key}]').to_be_visible()
        page.wait("/^[\\d.]+.mm$/.test(document.querySelector('#score dd').textContent)")
        # A fault is a switch.
        bias = '#faults button[value=bias]'
        for fault, pressed in (('bias', 'true'), ('none', 'false')):
            page(bias).click()
            until(lambda fault=fault: rig.get('sensor_fault') == fault, fault)
            page.expect(bias).to_have_attribute('aria-pressed', pressed)
        ended.set()
        controller.join()
        page.expect('#command-age').to_contain_text('parked')
        assert rig.set(record=False) == ''
    (bag,) = runs.iterdir()
    motion = load_recording(bag).motion
    assert len(motion.measured) > 30
    x = np.interp(motion.measured[:, 0], *motion.samples[:, :2].T)
    assert np.abs(motion.measured[:, 1] - x).max() < 1e-5
    # Some may have been late on a busy machine
    assert (motion.acts[:, 1] == 1.0).any()


def test_my_structure_and_a_server_that_comes_back(opened, live, parameters):
    """The page joins it again by itself; see `Connection` in protocol.js."""
    bag = live.recordings / 'run'
    assert simulate_rig([str(BENCH), '--duration', '6', '--bag', str(bag), '--quiet']) == 0
    page = opened()
    page.click('#recordings-open')
    compare = '.recording[data-name=run] [data-compare]'
    page.click(compare)
    page.expect(compare).to_contain_text('Cancel (')
    # It does not end before the server does.
    (comparison,) = until(lambda: live.children('cli.compare_run'))
    os.kill(comparison, signal.SIGSTOP)
    page.click('#recordings [data-close]')
    page.click('#presets-open')
    page.click('#structure-open')
    page.expect('#structure').to_be_visible()
    # It answers while one types, and sets nothing.
    page.expect('#structure-result h3').to_have_text('Best gap 21.5\u202fmm, with 250\u202fg')
    page('#structure-mass_ratio').fill('10')
    page.expect('#structure-result h3').to_contain_text('with 500\u202fg')
    page('#structure-mass_ratio').fill('5')
    page.expect('#structure-result h3').to_contain_text('with 250\u202fg')
    page.type('#structure-mass', '5 lb')
    page.expect('#structure-mass-error').to_contain_text('lb')
    page.expect('#structure-mass').to_have_attribute('aria-invalid', 'true')
    assert parameters.get('primary_mass') == 2.0
    # What only computes is asked again. A change is not: it may have been made.
    live.send(signal.SIGSTOP)
    page.type('#structure-mass', '5000 g')
    page.wait('impactDamper.actions.connection.pending.size === 1')
    page.run("document.querySelector('#pause').click()")
    page.wait('impactDamper.actions.connection.pending.size === 2')
    live.close(signal.SIGKILL)
    os.kill(comparison, signal.SIGKILL)
    page.expect('#toast').to_contain_text('may or may not have been made')
    page.expect('#status').to_have_text('no server')
    page.run("document.querySelector('#pause').click()")
    page.expect('#toast').to_contain_text('nothing was changed')
    live.again()
    page.wait(FULL)
    page.wait("document.querySelector('#report').open")
    page.expect('#report-title').to_have_text('run: comparison with theory')
    page.expect('#recordings').to_be_hidden()
    report = page.tab.frame_locator('#report-frame')
    report.locator('figure').first.wait_for()
    assert 'replayed bit for bit' in report.locator('body').text_content()
    page.click('#report [data-close]')
    page.wait("!document.querySelector('#report-frame').hasAttribute('src')")
    page.expect('#structure-result h3').to_have_text('Best gap 21.5\u202fmm, with 250\u202fg')
    page.expect('#structure-mass-error').to_be_hidden()
    bars = page('#structure-result .ratios div').all_text_contents()
    assert bars == [
        'no damper12.4\u202fmm, 100 %',
        'tuned mass damper2.33\u202fmm, 18.7 %',
        'impact damper1.76\u202fmm, 14.2 %',
    ]
    page.expect('#structure-result code').to_contain_text('design_damper --mass 5000g')
    until(lambda: parameters.get('primary_mass') == 5.0)
    for size in ((390, 844), DESK):
        page.resize(*size)
        page.expect('#structure').to_be_in_viewport(ratio=1.0)
        # Nothing is cut off, and nothing is too small for a finger
        hidden, low = page.run("""(one => [one.scrollWidth - one.clientWidth,
            [...one.querySelectorAll('input, select, button')]
                .filter(one => one.getBoundingClientRect().height < 24).length])(
            document.querySelector('#structure'))""")
        assert (hidden, low) == (0, 0)
    # The rig is that structure, at rest in the first instant, and the base comes first
    have = parameters.get('primary_mass', 'gap', 'base_quantity')
    assert have == [5.0, 0.02148, 'acceleration']
    page.click('#structure [data-close]')
    page.expect('#preset-name').to_have_text('My structure')
    page.expect('#knob-base_amplitudes').to_have_value('1.96133')
    assert page.run('impactDamper.store.design.gap') == pytest.approx(0.02148, rel=1e-3)
    # A link reproduces it
    page.wait("location.hash.includes('gap=0.02148')")
    # Another gap is the same structure, another mass is not
    assert parameters.set(gap=0.02) == ''
    page.expect('#knob-gap').to_have_value('20')
    page.expect('#preset-name').to_have_text('My structure')
    assert parameters.set(damper_mass=0.2) == ''
    page.expect('#preset-name').to_have_text('')
    assert page.run('impactDamper.store.design === null')
    # What it complained of was that the server was gone.
    lost = [one for one in page.console if 'ERR_CONNECTION_REFUSED' not in one]
    assert lost == []
    page.console.clear()
    shutil.rmtree(bag)


# A recording


def test_a_recording_goes_on_where_the_connection_was_lost(opened, live, parameters):
    """Texts of it, and of parameters, are no markup."""
    bad = '<img src=x onerror="document.title=1">'
    bag = live.recordings / bad
    assert simulate_rig([str(BENCH), '--duration', '20', '--bag', str(bag), '--quiet']) == 0
    page = opened()
    page('#more-knobs summary').click()
    assert parameters.set(bag_directory=bad) == ''
    page.expect('#parameter-bag_directory').to_have_value(bad)
    page.expect('img').to_have_count(0)
    page.click('#recordings-open')
    page.click(f'.recording[data-name={json.dumps(bad)}] .primary')
    page.wait(PLAYS)
    page.expect('#rig-choice').to_have_text(bad)
    page.click('#link')
    page.tab.reload()
    page.wait(PLAYS)
    page.expect('img').to_have_count(0)
    assert page.tab.title() == 'Impact damper'
    page('#speed').select_option('0.05')
    scrub(page, 10)
    page.wait('impactDamper.history.end > 9')
    connection = 'impactDamper.actions.connection'
    for playing in (True, False):
        if not playing:
            page.click('#play')
            page.expect('#status').to_have_text('paused')
        page.wait(f'impactDamper.history.paused === {json.dumps(not playing)}')
        left, frames = page.run('[impactDamper.history.end, impactDamper.store.frames]')
        page.run(f'(one => {{ globalThis.lost = one.socket; one.socket.close(); }})({connection})')
        page.wait(f'{connection}.socket !== globalThis.lost && {connection}.joined')
        page.expect('#status').to_have_text('running' if playing else 'paused')
        page.wait(f'impactDamper.store.frames > {frames + 5 * playing}')
        page.wait(f'impactDamper.history.end {">" if playing else "==="} {left}')
        assert page.run('impactDamper.history.end') < 19.0
    shutil.rmtree(bag)


# Without installation


@pytest.fixture
def from_disk(tab, site):
    """Open pages from the disk; at the end none has complained, or asked anywhere else."""
    asked = []

    def note(request):
        asked.append(request.url)

    def open_page(place='', size=DESK):
        tab.visit(f'file://{site}/index.html{place}', size)
        tab.wait(MOVES)
        return tab

    tab.tab.on('request', note)
    yield open_page
    tab.leave()
    tab.tab.remove_listener('request', note)
    assert tab.console == []
    assert asked
    # The worker is part of the page.
    own = f'file://{site}/', 'blob:null/'
    assert [url for url in asked if not url.startswith(own)] == []


def test_a_stranger_turns_the_gap_and_chooses_a_preset(from_disk):
    page = from_disk(size=PHONE)
    page.expect('#status').to_have_text('running')
    page.expect('#preset-name').to_have_text('Bench rig')
    page.expect('#verdict-text').to_have_text('2 impacts in 1 cycle, stable')
    page.expect('#curve-line').to_contain_text('best gap 28')
    page.type('#knob-gap', '12')
    page.wait("location.hash.includes('gap=0.012')")
    page.expect('#rig-line').to_contain_text('gap 12.0')
    page.wait('impactDamper.theory.curve.gap === 0.012 && impactDamper.theory.orbit.complete')
    page.expect('#theory-text').to_contain_text('2 impacts in 1 cycle, unstable; run ahead')
    page.type('#knob-gap', '-3')
    page.expect('[data-name=gap].big .error').to_contain_text('gap is -3.0 mm: give a number')
    page.wait('impactDamper.history.state.stop_1 - impactDamper.history.state.x < 0.0061')
    # What needs the package is not offered.
    for button in ('#record', '#recordings-open', '#rig-choice'):
        page.expect(button).to_be_hidden()
    page.expect('a[href="../start/installation.html"]').to_be_attached()
    assert page.run('document.documentElement.scrollWidth') <= PHONE[0]
    # Pause, steps, reset
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
    # A preset; the link starts the same rig, also after it has been loaded anew.
    page.click('#presets-open')
    page.click('#presets [data-name=ring_down]')
    page.expect('#preset-name').to_have_text('Ring-down')
    page.expect('#rig-line').to_contain_text('no force · gap')
    page.wait('Math.abs(impactDamper.history.state.x) > 0.005')
    page.wait("location.hash.includes('preset=ring_down')")
    page.expect('#curve-line').to_have_text('')
    page.tab.reload()
    page.wait(MOVES)
    page.expect('#preset-name').to_have_text('Ring-down')


def test_a_controller_moves_the_stops_and_the_base_moves(from_disk):
    link = '#preset=bench&gap_control=timed'
    page = from_disk(f'{link}&force_amplitudes=[0]&base_amplitudes=[0.5]')
    page.wait("document.querySelector('#knob-gap_control').value === 'timed'")
    page.wait('impactDamper.history.own.acts.length > 10')
    choices = page('#knob-gap_control option').evaluate_all('all => all.map(one => one.value)')
    assert choices == ['off', 'amplitude', 'timed']
    page.wait("document.querySelector('#score dd').textContent !== '–'")
    page.expect('#relative-switch').to_be_visible()
    page.expect('#rig-line').to_contain_text('base')
    page.click('#relative')
    page.wait("location.hash.includes('relative=1')")
    page.wait('impactDamper.history.state && Math.abs(impactDamper.history.state.base) < 1e-9')


def test_plots_are_saved_with_the_values_of_the_rig(from_disk):
    page = from_disk('#preset=bench')
    page.click('#pictures-open')
    saved = {}
    kinds = (
        'rig.png',
        'motion.png',
        'gap_curve.png',
        'rig.svg',
        'motion.svg',
        'gap_curve.svg',
        'impact_map.svg',
        'multipliers.svg',
    )
    for name in kinds:
        with page.tab.expect_download() as download:
            page(f'[data-picture="{name}"]').click()
        assert download.value.suggested_filename == name
        saved[name] = Path(download.value.path())
    for name, canvas in (('rig', '#rig-canvas'), ('motion', '#plot-canvas')):
        width, height = (page(canvas).bounding_box()[one] for one in ('width', 'height'))
        picture = Image.open(saved[f'{name}.png'])
        assert picture.size == pytest.approx((2 * width, 2 * (height + 56)), abs=2)
        assert len(picture.convert('RGB').getcolors(1 << 20)) > 20
    for name, words in (
        *(('gap_curve', 'Xmax / A'), ('impact_map', 'phase of the force (cycles)')),
        ('multipliers', 'Multipliers'),
        *(('rig', 'M'), ('rig', 'm'), ('rig', 'F')),
        *(('motion', 'rig time (s)'), ('motion', 'X, Z (mm)')),
    ):
        texts = [one.text for one in ElementTree.parse(saved[f'{name}.svg']).iter() if one.text]
        assert words in texts
        assert '1.20\u202fN at 5.000\u202fHz · gap 24.0\u202fmm' in texts


class Folder(SimpleHTTPRequestHandler):
    """Files of a folder, without a log."""

    def log_message(self, *_arguments):
        pass


def test_in_the_page_of_a_lecture(tab, site):
    """The page is embedded, from a server, with the preset of a link."""
    link = 'try/index.html#preset=bench&gap=0.034&window=3'
    lecture = site.parent / 'lecture.html'
    lecture.write_text(
        '<!DOCTYPE html><link rel="icon" href="try/icon.svg">'
        f'<iframe src="{link}" width=800 height=700></iframe>'
    )
    with ThreadingHTTPServer(
        ('127.0.0.1', 0), functools.partial(Folder, directory=site.parent)
    ) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        tab.visit(f'http://127.0.0.1:{server.server_port}/lecture.html')
        inside = tab.tab.frame_locator('iframe').locator
        expect(inside('#rig-line')).to_contain_text('gap 34.0')
        expect(inside('#status')).to_have_text('running')
        inside('#glossary-open').click()
        expect(inside('#glossary')).to_be_visible()
        tab.leave()
        server.shutdown()
    assert tab.console == []
