"""The page in a real browser, with the real server and the real node."""

import json
import math
import re
import shutil

import chromium
import pytest

pytest.importorskip('tornado', reason='the page needs Tornado')
pytest.importorskip('rclpy', reason='a live rig needs ROS')

import numpy as np
from node.rig_client import SOURCE, RigClient, RigParametersClient, SimProcess, until
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.page.presets import load_presets
from impact_damper_ros.page.recorded import load_recording
from impact_damper_ros.parameters.rig_parameters import (
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
)
from page.browser import LONG, Browser
from page.frame_times import FULL as FULL_WINDOW, PROBE, quantile
from page.page_process import PageProcess

BENCH = SOURCE / 'config' / 'bench_rig.yaml'
SIZES = ((360, 780), (660, 900), (1280, 800), (2560, 1440))
#: The rig goes on; beside many other programs it lags, and the page says so.
SETTLED = "['running', 'lagging'].includes(document.querySelector('#status').dataset.state)"
FULL = (
    f"{SETTLED} && impactDamper.history.impacts.length > 3 && document.querySelector('#knob-gap')"
)

#: What a chaotic rig is said to do.
LONG_WORDS = (
    'Measured: undecided, 1.98 impacts per cycle',
    'Theory: 2 impacts in 1 cycle (stops 1,2), unstable; run ahead from its state, the rig does '
    'not repeat within 1500 cycles of the force; chaotic: Lyapunov exponent +0.342 ± 0.023 per '
    'cycle over 1125 cycles more',
)
#: Points of the traces, and of those of the what-if.
LENGTHS = "['own', 'other'].map(name => impactDamper.history[name].samples.length)"
#: Pixels in the colour of the what-if.
MAGENTA = """(canvas => {
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let count = 0;
    for (let n = 0; n < data.length; n += 4) {
        const [red, green, blue, alpha] = data.subarray(n, n + 4);
        if (alpha > 100 && Math.min(red, blue) - green > 70) count += 1;
    }
    return count;
})(document.querySelector('PLACE'))"""


@pytest.fixture(scope='module')
def browser():
    browser = Browser(chromium.needed())
    yield browser
    browser.close()


@pytest.fixture(scope='module')
def live(tmp_path_factory):
    """Start a bench rig and a server; return the server."""
    directory = tmp_path_factory.mktemp('live')
    server = node = None
    try:
        # Whatever other rigs the tests start, this one is shown first.
        server = PageProcess(directory, '--node', '/sim_node')
        node = SimProcess(directory, parameters_file=BENCH, bag_directory=str(server.recordings))
        yield server
    finally:
        if node is not None:
            node.kill()
        if server is not None:
            server.close()


@pytest.fixture(scope='module')
def parameters():
    """Return the parameters of the rig, as another program in the network sees them."""
    with RigClient() as client:
        yield RigParametersClient(client)


@pytest.fixture
def opened(browser, live):
    """Open pages, and hold at the end that none of them had to complain."""
    pages = []

    def open_page(place='', **options):
        page = browser.open(live.address + place, **options)
        pages.append(page)
        page.wait(FULL)
        return page

    yield open_page
    said = [text for page in pages for text in page.said]
    for page in pages:
        page.close()
    assert said == []


@pytest.fixture(scope='module')
def start(parameters):
    """Return the parameters of the rig at the start, by name."""
    names = [*PARAMETER_SPECS, *INITIAL_SPECS, *GAP_CONTROL_SPECS, 'record', 'bag_directory']
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
        assert rig.service('pause', SetBool.Request(data=False)).success
        assert rig.service('reset', Trigger.Request()).success


def picture(page, selector='#rig-canvas'):
    return page.run(f"document.querySelector('{selector}').toDataURL()")


def test_a_knob_turned_in_the_page_turns_the_rig(opened, parameters):
    page = opened()
    assert page.value('#knob-gap') == '24'
    # Some cycles of the force, and not a comb of 150
    assert page.value('#windows [aria-pressed=true]') == '3'
    page.type('#knob-gap', '30')
    until(lambda: parameters.get('gap') == 0.03, 'the parameter has not changed')
    # The stops in the picture follow, and a labelled line marks the change.
    page.wait('(s => Math.abs(s.stop1 - s.stop2 - 0.03) < 1e-6)(impactDamper.history.state)')
    page.wait("document.querySelector('#legend [data-series=stop] dd').textContent === '30.0 mm'")
    page.wait("impactDamper.history.changes.some(({text}) => text === 'd = 30 mm')")
    assert '30.0' in page.text('#rig-line')


def test_a_knob_turned_elsewhere_is_seen(opened, parameters):
    page = opened()
    # Somebody has just gone to the field: what is typed next replaces whatever comes in.
    page.run("document.querySelector('#knob-gap').focus()")
    assert parameters.set(gap=0.0215) == ''
    page.wait("document.querySelector('#knob-gap').value === '21.5'")
    page.wait("impactDamper.history.changes.some(({text}) => text === 'd = 21.5 mm')")
    page.tab.keyboard.insert_text('23')
    page.key('Enter')
    until(lambda: parameters.get('gap') == 0.023, lambda: parameters.get('gap'))


def test_what_is_typed_is_read_with_its_unit(opened, parameters):
    page = opened()
    error = "document.querySelector('#knob-gap-error').textContent"
    for text, gap, shown in (
        # The unit stays: who has typed millimetres would set metres with the next number.
        ('600', 0.6, '600'),
        ('24.5 mm', 0.0245, '24.5'),
        ('2,6 cm', 0.026, '26'),
        ('0.023m', 0.023, '23'),
    ):
        page.type('#knob-gap', text)
        until(lambda gap=gap: parameters.get('gap') == gap, text)
        page.wait(f"document.querySelector('#knob-gap').value === '{shown}'")
    for text, reason in (
        ('-5', 'gap is -5.0 mm: give a number from 1e-06 to 1e+12 mm'),
        ('abc', "gap is 'abc': give a number from 1e-06 to 1e+12 mm"),
        ('1,000', "gap is '1,000': write 1.000 or 1000"),
        ('3 inch', "gap is '3 inch': 'inch' is no unit of it: write m, cm, mm, µm, um"),
    ):
        page.type('#knob-gap', text)
        page.wait(f'{error} === {json.dumps(reason)}')
        assert page.run("document.querySelector('#knob-gap').ariaInvalid") == 'true'
    assert parameters.get('gap') == 0.023
    page.key('Escape')
    assert page.value('#knob-gap') == '23'
    assert page.run("document.querySelector('#knob-gap-error').hidden")
    for text, angle in (('0.1 rad', 0.1), ('-3', math.radians(-3.0))):
        page.type('#knob-angle', text)
        until(lambda angle=angle: parameters.get('angle') == pytest.approx(angle, rel=1e-12))
    page.wait('Math.abs(impactDamper.history.state.angle + 0.05236) < 1e-4')

    def frequency():
        (rate,) = parameters.get('force_frequencies')
        return rate / math.tau

    for text, hertz in (('300 rpm', 5.0), ('4,9', 4.9)):
        page.type('#knob-force_frequencies', text)
        until(lambda hertz=hertz: frequency() == pytest.approx(hertz, rel=1e-12))
    # What is being typed stays, whatever comes in meanwhile.
    page.type('#knob-force_frequencies', '6', enter=False)
    assert parameters.set(force_frequencies=[math.tau * 4.0]) == ''
    page.wait("document.querySelector('#rig-line').textContent.includes('4.000')")
    page.key('Enter')
    until(lambda: frequency() == pytest.approx(6.0))
    # What is usual is said where something is typed.
    page.run("document.querySelector('#knob-gap').focus()")
    page.wait(f"{error}.startsWith('Usually 100') && {error}.includes('Units: m, cm, mm')")
    # What is typed stays also where the slider gets another end.
    page.type('#knob-gap', '25', enter=False)
    assert parameters.set(gap=0.9) == ''
    page.wait('impactDamper.history.state.stop1 > 0.1')
    page.key('Enter')
    until(lambda: parameters.get('gap') == 0.025)


def test_a_gap_out_of_all_proportion_leaves_the_scales(opened, parameters):
    page = opened()
    page.wait('impactDamper.theory.curve?.done', 4.0 * LONG)
    beyond, high = page.run("""(({ curve }) => {
        curve.place(1e6, NaN);
        curve.draw();
        return [curve.beyond, curve.high]; })(impactDamper)""")
    assert beyond
    assert high < 0.5
    page.type('#knob-gap', '1e6 m')
    until(lambda: parameters.get('gap') == 1e6)
    page.wait("document.querySelector('#knob-gap-error').textContent.startsWith('This is far')")
    page.wait('impactDamper.history.state.stop1 > 1e5')
    # Traces and picture are of what moves, not of stops that are kilometres away.
    page.wait("!document.querySelector('#legend [data-series=x] dd').textContent.endsWith(' m')")
    page.wait('impactDamper.rig.plan.spread < 100')


def test_the_best_gap_is_there_at_once_and_marked(opened, parameters):
    page = opened()
    value = """[...document.querySelectorAll('#numbers div')]
        .find(one => one.textContent.startsWith('gap / best gap')).querySelector('dd')"""
    # The change makes the curve of before worthless.
    assert parameters.set(gap=0.0233) == ''
    page.wait("document.querySelector('#knob-gap').value === '23.3'")
    page.wait(f"({value}).textContent.startsWith('≈\u202f0.8')")
    assert 'gap curve' in page.run(f'({value}).title')
    page.wait('impactDamper.theory.curve?.done', 4.0 * LONG)
    page.wait(f"/^\\d/.test(({value}).textContent) && ({value}).title === ''")
    optimum = page.run('impactDamper.theory.curve.optimum.gap')
    shown = float(page.run(f'({value}).textContent'))
    assert shown == pytest.approx(0.0233 / optimum, abs=6e-3)
    assert page.text('#curve-line').startswith('best gap ')
    assert '≈' not in page.text('#curve-line')


def test_a_click_on_the_gap_curve_sets_the_gap(opened, parameters):
    page = opened()
    page.wait('impactDamper.theory.curve?.branches.length > 0', 4.0 * LONG)
    page.run("document.querySelector('#curve-canvas').scrollIntoView()")
    left, top, width, height = page.run("""(() => {
        const box = document.querySelector('#curve-canvas').getBoundingClientRect();
        return [box.left, box.top, box.width, box.height]; })()""")
    page.tab.mouse.click(left + 0.6 * width, top + 0.5 * height)
    until(lambda: parameters.get('gap') != 0.024, 'the click has set nothing')
    here = parameters.get('gap')
    assert 0.001 < here < 0.2
    # and with the keyboard, by one per cent
    page.wait(f"Math.abs(document.querySelector('#curve-canvas').ariaValueNow - {here}) < 1e-6")
    page.run("document.querySelector('#curve-canvas').focus()")
    page.key('ArrowRight')
    until(lambda: parameters.get('gap') == pytest.approx(1.01 * here, rel=1e-3))


def test_the_address_reproduces_the_rig(opened, parameters):
    directory = parameters.get('bag_directory')
    # Whether and where the node records is not for a link to say.
    rest = 'friction=0.03&window=3&record=true&bag_directory=/tmp'
    page = opened(f'#preset=bench&gap=0.0225&{rest}')
    until(lambda: parameters.get('gap') == 0.0225 and parameters.get('friction') == 0.03)
    assert parameters.get('record', 'bag_directory') == [False, directory]
    assert page.value('#windows [aria-pressed=true]') == '3'
    page.type('#knob-gap', '23')
    page.wait("location.hash.includes('gap=0.023') && location.hash.includes('preset=bench')")
    # Turned by others, it is in the link too; where the node records is not.
    assert parameters.set(restitution_2=0.55, bag_directory='elsewhere') == ['', '']
    page.wait("document.querySelector('#knob-restitution_2').value === '0.55'")
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
    page.wait("document.querySelector('#knob-gap').value === '26'")
    # Another link is pasted into the open tab.
    page.run("location.hash = '#gap=0.0215&window=10'")
    until(lambda: parameters.get('gap') == 0.0215)
    page.wait("document.querySelector('#windows [aria-pressed=true]').value === '10'")


def test_a_link_that_is_passed_on_is_for_watching(browser, live, parameters, tmp_path):
    del live
    server = PageProcess(tmp_path, '--node', '/sim_node', '--host', '0.0.0.0')
    pages = []
    try:
        address = re.sub('//[^:]+', '//127.0.0.1', server.address)
        pages.append(browser.open(address))
        (page,) = pages
        page.wait(FULL)
        page.allow('clipboard-read', 'clipboard-write')
        page.click('#link')
        page.wait("document.querySelector('#toast').textContent.includes('link to watch')")
        link = page.run('navigator.clipboard.readText()')
        assert link.partition('#')[0] != address
        assert link.endswith(page.run('location.hash'))
        pages.append(browser.open(link))
        watching = pages[1]
        watching.wait(FULL)
        watching.type('#knob-gap', '20')
        watching.wait(
            "document.querySelector('#knob-gap-error').textContent.includes('only shows')"
        )
        assert parameters.get('gap') == 0.024
        watching.key('Escape')
        watching.click('#reset')
        watching.wait("document.querySelector('#toast').textContent.includes('only shows')")
        page.type('#knob-gap', '25')
        until(lambda: parameters.get('gap') == 0.025)
        watching.wait("document.querySelector('#knob-gap').value === '25'")
        assert [one.said for one in pages] == [[], []]
    finally:
        for one in pages:
            one.close()
        server.close()


def test_a_preset_chosen_in_another_tab_is_named(opened, parameters):
    one, other = opened(), opened(width=600)
    one.run("document.querySelector('#presets button[data-name=bouncing_ball]').click()")
    other.wait("document.querySelector('#preset-name').textContent === 'Bouncing ball'")
    for page in (one, other):
        page.wait("impactDamper.history.changes.some(({text}) => text === 'Bouncing ball')")
        page.wait("location.hash.includes('preset=bouncing_ball')")
    # The theory is shown although the gap cannot be changed.
    one.wait('impactDamper.theory.curve?.text.includes("one-sided")')
    assert one.run('impactDamper.theory.orbit.found')
    assert parameters.set(gap=0.21) == ''


def test_texts_are_no_markup(opened, live, parameters):
    before = parameters.get('bag_directory')
    page = opened()
    page.run("document.querySelector('#more-knobs').open = true")
    bad = '<img src=x onerror="document.title=1">'
    assert parameters.set(bag_directory=bad) == ''
    page.wait(f"document.querySelector('#parameter-bag_directory').value === {bad!r}")
    assert page.run("document.querySelectorAll('img').length") == 0
    assert page.run('document.title') == 'Impact damper'
    assert parameters.set(bag_directory=before) == ''
    # nor do those of a bag
    bag = live.recordings / bad
    assert simulate_rig([str(BENCH), '--duration', '2', '--bag', str(bag), '--quiet']) == 0
    page.click('#recordings-open')
    row = f'.recording[data-name={json.dumps(bad)}]'
    page.wait(f'document.querySelector({json.dumps(row)})')
    page.click(f'{row} .primary')
    page.wait("document.body.classList.contains('playing') && impactDamper.history.state")
    assert page.text('#rig-choice') == bad
    page.click('#link')
    page.tab.reload()
    page.wait("document.body.classList.contains('playing') && impactDamper.history.state")
    assert page.run("document.querySelectorAll('img').length") == 0
    assert page.run('document.title') == 'Impact damper'
    shutil.rmtree(bag)


def test_the_layout_at_every_size(opened):
    page = opened(dark=True)
    for width, height in SIZES:
        page.resize(width, height)
        page.wait(f'innerWidth === {width}')
        assert page.run('document.documentElement.scrollWidth') <= width
        cut = page.run("""[...document.querySelectorAll('button, select, input, canvas, h2')]
            .filter(one => one.getClientRects().length && !one.closest('.visually-hidden'))
            .filter(one => { const box = one.getBoundingClientRect();
                return box.left < -1 || box.right > innerWidth + 1; })
            .map(one => one.id || one.textContent)""")
        assert cut == []
        small = page.run("""[...document.querySelectorAll('canvas')]
            .filter(one => one.getClientRects().length && one.id !== 'marks')
            .filter(one => one.clientWidth < 90 || one.clientHeight < 90).map(one => one.id)""")
        assert small == []
        # The longest verdict is shown as a whole, and moves nothing.
        before, after, hidden = page.run(f"""(() => {{
            const box = document.querySelector('#ratios').getBoundingClientRect();
            document.querySelector('#motion-text').textContent = {LONG_WORDS[0]!r};
            document.querySelector('#theory-text').textContent = {LONG_WORDS[1]!r};
            const parts = [...document.querySelectorAll('.verdict, .words')];
            return [box.top, document.querySelector('#ratios').getBoundingClientRect().top,
                parts.map(one => one.scrollHeight - one.clientHeight)]; }})()""")
        assert (before, hidden) == (after, [0, 0])
        # Names and numbers beside one another are not cut.
        clipped = page.run("""[...document.querySelectorAll('#numbers dt, #numbers dd, #legend')]
            .filter(one => one.scrollWidth > one.clientWidth).map(one => one.textContent)""")
        assert clipped == []
    shade = 'getComputedStyle(document.body).backgroundColor'
    assert page.run(shade) == 'rgb(15, 19, 23)'
    page.shade(dark=False)
    page.wait(f"{shade} === 'rgb(241, 244, 247)'")


def test_letters_have_their_size_on_a_dense_screen(opened):
    """Also in pictures; the size of the text of the page is 14.5 px here."""
    page = opened(scale=2.0)
    page.run("""(({ prototype }) => {
        globalThis.sizes = {};
        const { fillText } = prototype;
        prototype.fillText = function (...text) {
            const size = parseFloat(/[\\d.]+(?=px)/.exec(this.font)[0]);
            (sizes[this.canvas.id || 'plot'] ??= []).push(
                size * this.getTransform().a / devicePixelRatio);
            return fillText.apply(this, text);
        };
    })(CanvasRenderingContext2D)""")
    page.wait("sizes.plot?.length > 20 && sizes['rig-canvas'] && sizes['portrait-canvas']")
    sizes = page.run('sizes')
    assert min(size for picture in sizes.values() for size in picture) > 10.0


def test_nothing_jumps(opened):
    """What comes in does not move what is there."""
    page = opened()
    page.wait('impactDamper.theory.orbit?.found')
    places = """JSON.stringify([...document.querySelectorAll('.panel, .bar button, .knob')]
        .map(one => { const box = one.getBoundingClientRect();
            return [box.left, box.top, box.width, box.height].map(Math.round); }))"""
    before = page.run(places)
    frames = page.run('impactDamper.counted.frames')
    page.click('#reset')
    page.wait(f'impactDamper.counted.frames > {frames} + 30')
    assert page.run(places) == before


def test_names_for_a_screen_reader(opened):
    page = opened()
    page.run("document.querySelector('#more-knobs').open = true")
    nodes = page.protocol().send('Accessibility.getFullAXTree')['nodes']
    roles = {'button', 'textbox', 'slider', 'checkbox', 'combobox', 'searchbox', 'image', 'dialog'}
    found = [n for n in nodes if n.get('role', {}).get('value') in roles and not n.get('ignored')]
    assert len(found) > 60
    nameless = [n for n in found if not n.get('name', {}).get('value')]
    assert nameless == []
    # A word of the glossary is read with its sentence.
    described = [n['description']['value'] for n in found if n.get('description', {}).get('value')]
    assert any('stays between the stops' in text or 'unit circle' in text for text in described)
    # The space bar holds the rig, and lets it go.
    page.run('document.activeElement.blur()')
    page.key('Space')
    page.wait("document.querySelector('#pause').ariaPressed === 'true'")
    page.key('Space')
    page.wait("document.querySelector('#pause').ariaPressed === 'false'")


def test_single_steps_of_a_paused_rig(opened):
    page = opened()
    # A rig that moves has no steps.
    assert page.run("document.querySelector('#step').ariaDisabled") == 'true'
    page.click('#step')
    page.click('#pause')
    page.wait("document.querySelector('#step').ariaDisabled === 'false'")
    length = page.run('impactDamper.history.own.samples.length')
    assert length > 10
    for press in (
        lambda: page.click('#step'),
        lambda: page.key('.'),
        # The focus stays on the button, from one step to the next.
        lambda: page.run('document.activeElement.click()'),
    ):
        # What is pressed before the answer to the last step is dropped.
        page.wait('!impactDamper.isStepping()')
        end = page.run('impactDamper.history.end')
        press()
        page.wait(f'impactDamper.history.end > {end}')
        page.wait("document.querySelector('#step').ariaDisabled === 'false'")
        assert page.run('impactDamper.history.end') == pytest.approx(end + 0.005, abs=1e-6)
    newest = "(all => all.field('time')[all.end - 1])(impactDamper.history.impacts)"
    for press in (lambda: page.click('#step-to-impact'), lambda: page.key('ArrowRight')):
        page.wait('!impactDamper.isStepping()')
        last = page.run(newest)
        press()
        page.wait(
            f"{newest} > {last} && document.querySelector('#status').textContent === 'paused'",
            LONG,
        )
        hit, end = page.run(f'[{newest}, impactDamper.history.end]')
        assert 0.0 <= end - hit <= 0.005 + 1e-6
    # What was there before the steps is there still.
    assert page.run('impactDamper.history.own.samples.length') >= length
    page.click('#pause')
    page.wait(SETTLED)
    assert page.run("document.querySelector('#step').ariaDisabled") == 'true'


def test_an_impact_that_does_not_come_is_reported(opened, parameters):
    page = opened()
    assert parameters.set(gap=1000.0) == ''
    page.click('#pause')
    page.wait("document.querySelector('#step').ariaDisabled === 'false'")
    page.click('#step-to-impact')
    page.wait("document.body.textContent.includes('No impact so far')")
    assert page.text('#status') != 'paused'


def test_a_knob_that_is_dragged_is_one_change(opened, parameters):
    page = opened()
    before = len(page.run('impactDamper.history.changes'))
    for place in (505, 520, 540, 560):
        page.run(f"""(slider => {{
            slider.value = {place}; slider.dispatchEvent(new Event('input')); }})(
            document.querySelector('.knob[data-name=gap].big input[type=range]'))""")
    value = page.value('#knob-gap')
    page.wait(f"impactDamper.history.changes.at(-1)?.text === 'd = {value} mm'")
    assert parameters.get('gap') == pytest.approx(float(value) / 1000.0)
    assert len(page.run('impactDamper.history.changes')) == before + 1
    # Another knob is another one.
    assert parameters.set(friction=0.03) == ''
    page.wait(f'impactDamper.history.changes.length === {before + 2}')


#: Calls of a method of pictures: the canvas, and what was given.
SPY = """(({ prototype }) => {
    globalThis.calls = [];
    const method = prototype.METHOD;
    prototype.METHOD = function (...given) {
        calls.push([this.canvas.id || 'plot', JSON.parse(JSON.stringify(given)),
            this.strokeStyle, this.measureText(String(given[0])).width]);
        return method.apply(this, given);
    };
})(CanvasRenderingContext2D)"""


def test_lines_of_changes_do_not_run_over_each_other(opened, parameters):
    page = opened('#window=10')
    for number in range(8):
        assert parameters.set(gap=0.02 + 0.001 * number) == ''
        assert parameters.set(friction=0.02 + 0.001 * number) == ''
    page.wait('impactDamper.history.changes.length >= 8')
    page.run(SPY.replace('METHOD', 'fillText'))
    page.wait(
        "calls.filter(([name, [text]]) => name === 'plot' && text.includes(' = ')).length > 30"
    )
    texts = page.run("""calls.filter(([name, [text]]) => name === 'plot' && text.includes(' = '))
        .map(([, [text, x, y], , width]) => [text, x, y, width])""")
    # Those of one picture: until the newest one, which is drawn first, comes again
    places = [tuple(one) for one in texts[:2]]
    for _, x, y, width in places[:1]:
        for _, x_2, y_2, width_2 in places[1:]:
            assert y != y_2 or x + width <= x_2 or x_2 + width_2 <= x
    # A list that only became as long as another one is no change.
    assert parameters.set(force_amplitudes=[1.2, 0.3]) == ''
    page.wait("impactDamper.history.changes.at(-1).text === 'F = 1.2, 0.3 N'")


def test_motions_have_their_lines_and_special_points_their_names(opened, parameters):
    page = opened()
    assert parameters.set(gap=0.024) == ''
    page.wait('impactDamper.theory.curve?.done', 4.0 * LONG)
    page.run(SPY.replace('METHOD', 'setLineDash'))
    page.run('impactDamper.curve.stale = true')
    page.wait("calls.some(([name]) => name === 'curve-canvas')")
    dashes = page.run("calls.filter(([name]) => name === 'curve-canvas').map(([, [one]]) => one)")
    # Stable, unstable, not viable
    for dash in ([], [5, 4], [1, 3]):
        assert dash in dashes
    points = page.run("""(() => { const box =
        document.querySelector('#curve-canvas').getBoundingClientRect();
        return impactDamper.curve.places.map(([a, b, kind]) => [a + box.left, b + box.top, kind]);
        })()""")
    left, top, _ = next(one for one in points if one[2] == 'Neimark-Sacker')
    page.tab.mouse.move(left, top)
    page.wait("document.querySelector('#curve-canvas').title.startsWith('Neimark-Sacker: Where')")


def test_one_colour_for_a_stop(opened):
    page = opened()
    page.run(SPY.replace('METHOD', 'fillRect'))
    page.run("""(({ prototype }) => { const { fillRect } = prototype;
        globalThis.fills = {};
        prototype.fillRect = function (...given) {
            (fills[this.canvas.id] ??= {})[this.fillStyle] = true;
            return fillRect.apply(this, given); };
    })(CanvasRenderingContext2D)""")
    page.wait("Object.keys(fills['map-canvas'] ?? {}).length && fills['rig-canvas']")
    lower, upper = page.run("""['--lower', '--upper'].map(name =>
        getComputedStyle(document.documentElement).getPropertyValue(name).trim())""")
    fills = page.run(
        'Object.fromEntries(Object.entries(fills).map(([k, v]) => [k, Object.keys(v)]))'
    )
    assert {lower, upper} <= set(fills['rig-canvas'])
    assert lower in fills['map-canvas']


def test_targets_are_large_enough(opened):
    page = opened()
    page.run("document.querySelector('#more-knobs').open = true")
    for width, height in ((390, 844), (1280, 800), (2560, 1440)):
        page.resize(width, height)
        page.wait(f'innerWidth === {width}')
        small = page.run("""[...document.querySelectorAll(
            'button:not(.term), select, input:not([type=checkbox]), summary, .switch')]
            .filter(one => one.getClientRects().length && !one.closest('.visually-hidden, .skip'))
            .map(one => [one.id || one.textContent.trim(), one.getBoundingClientRect()])
            .filter(([, box]) => box.height < 23.9 || box.width < 23.9)
            .map(([name, box]) => [name, box.width, box.height])""")
        assert small == []
    # All parameters have room at the size of a common laptop.
    page.resize(1280, 800)
    page.wait('innerWidth === 1280')
    seen = page.run("""[...document.querySelectorAll('#all-knobs .knob')].filter(one => {
        const [box, panel] = [one, document.querySelector('#knobs')]
            .map(of => of.getBoundingClientRect());
        return box.top >= panel.top && box.bottom <= panel.bottom; }).length""")
    assert seen >= 8


def test_a_steep_rig_is_large(opened, parameters):
    page = opened()
    assert page.run("document.querySelector('#rig-canvas').clientHeight") < 300
    assert parameters.set(angle=math.pi / 2.0) == ''
    page.wait("document.querySelector('#rig-canvas').clientHeight > 350")
    page.wait('impactDamper.rig.plan.right - impactDamper.rig.plan.left > 250')
    assert parameters.set(angle=0.0) == ''
    page.wait("document.querySelector('#rig-canvas').clientHeight < 300")


def test_on_a_phone_the_rig_is_in_sight_while_a_knob_is_turned(opened):
    page = opened(width=390, height=600)
    page.run("document.querySelector('#knob-restitution_2').focus()")
    page.wait("""(([rig, knob]) => rig.top >= -1 && rig.bottom > 100 && knob.top > rig.bottom)(
        ['#rig', '#knob-restitution_2'].map(name =>
            document.querySelector(name).getBoundingClientRect()))""")


def test_after_a_preset_the_scale_is_its_own(opened, parameters):
    page = opened()
    assert parameters.set(gap=0.5) == ''
    page.wait("document.querySelector('#knob-gap').value === '500'")
    page.wait('impactDamper.rig.plan.spread >= 0.25')
    page.click('#presets-open')
    assert page.run("document.querySelectorAll('#presets svg.sketch').length") == len(
        load_presets()
    )
    page.click('#presets button[data-name=bench]')
    page.wait("document.querySelector('#knob-gap').value === '24'")
    end = page.run('impactDamper.history.end')
    page.wait('impactDamper.rig.plan.spread < 0.05')
    # Not when what was shown of the other rig has left the window
    assert page.run('impactDamper.history.end') - end < 2.5


def test_the_speed_of_the_rig(opened, parameters):
    page = opened()
    for value, factor in (('0.2', 0.2), ('1', 1.0)):
        page.choose('#rig-speed', f"'{value}'")
        until(lambda factor=factor: parameters.get('real_time_factor') == factor)
    assert parameters.set(real_time_factor=0.5) == ''
    page.wait("document.querySelector('#rig-speed').selectedOptions[0].textContent === '0.50×'")
    assert parameters.set(real_time_factor=1.0) == ''
    page.wait("document.querySelector('#rig-speed').value === '1'")


def test_the_rig_is_moved_by_hand(opened, parameters):
    page = opened()
    page.click('#pause')
    page.wait("document.querySelector('#status').dataset.state === 'paused'")

    def place(u, v='0'):
        # The picture goes smoothly to another scale.
        until(
            lambda: page.run("""(async ({ rig }) => {
            const before = rig.plan.scale;
            for (let n = 0; n < 10; n += 1) await new Promise(requestAnimationFrame);
            return rig.plan.scale === before; })(impactDamper)""")
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
    drag(place('state.stop1 * scale + slug'), 0.003)
    until(lambda: parameters.get('gap') == pytest.approx(0.03, abs=4e-4), parameters.get('gap'))
    page.wait(
        f'Math.abs(impactDamper.history.state.stop1 - impactDamper.history.state.x - '
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
    drag(place('0.5 * state.stop2 * scale - slug'), -0.004)
    page.wait('Math.abs(impactDamper.history.state.x + 0.004) < 4e-4')
    page.click('#pause')


def test_little_motion_where_it_is_asked_for(opened):
    page = opened()
    page.shade(dark=False, calm=True)
    assert page.run("getComputedStyle(document.querySelector('.dot')).animationName") == 'none'


def test_words_are_explained(opened):
    page = opened(width=360, height=700)
    page.click('#verdict button[data-term=multiplier]')
    page.wait("document.querySelector('#term').matches(':popover-open')")
    assert 'unit circle' in page.text('#term')
    box = page.run("""(() => { const box = document.querySelector('#term').getBoundingClientRect();
        return [box.left, box.right, box.top, box.bottom]; })()""")
    assert 0 <= box[0] < box[1] <= 360
    assert 0 <= box[2] < box[3] <= 700


@pytest.mark.parametrize('size', [(1280, 800), (390, 844)])
def test_the_tour_hides_nothing_and_leaves_a_rig_with_a_verdict(opened, parameters, size):
    page = opened(width=size[0], height=size[1])
    page.click('#tour-open')
    for step in range(1, 7):
        assert page.text('#tour-count') == f'Step {step} of 6'
        assert page.run("document.querySelectorAll('.toured').length") == 1
        card, shown = page.run("""['#tour', '.toured'].map(name => {
            const { left, top, right, bottom } =
                document.querySelector(name).getBoundingClientRect();
            return { left, top, right, bottom }; })""")
        assert min(card['left'], card['top']) >= 0
        assert card['right'] <= size[0]
        assert card['bottom'] <= size[1]
        apart = card['left'] >= shown['right'] or card['right'] <= shown['left']
        assert apart or card['top'] >= shown['bottom'] or card['bottom'] <= shown['top']
        if step == 6:
            page.click('#tour-try')
            until(lambda: parameters.get('gap_control') == 'timed')
        page.click('#tour-next')
    assert page.run("document.querySelector('#tour').hidden")
    assert page.run('document.activeElement.id') == 'tour-open'
    until(lambda: parameters.get('gap_control') == 'off')


def test_theory_is_drawn_while_the_rig_is_paused(opened):
    page = opened()
    page.wait('impactDamper.theory.orbit?.found')
    page.click('#pause')
    page.wait("document.querySelector('#status').dataset.state === 'paused'")
    page.wait('impactDamper.history.paused')
    # Nothing comes in any more that would have it drawn.
    names = '#portrait-canvas', '#map-canvas', '#plot canvas'
    for _ in ('off', 'on'):
        shown = {name: picture(page, name) for name in names}
        page.click('#theory')
        for name in names:
            until(lambda n=name, s=shown[name]: picture(page, n) != s, f'{name} is not drawn')


def test_slow_motion_shows_the_last_impacts(opened):
    page = opened()
    page.click('#slow')
    blank = picture(page, '#slow-canvas')
    page.wait("document.querySelector('#slow-canvas').width > 300")
    until(lambda: picture(page, '#slow-canvas') != blank)
    page.wait("document.querySelector('#rig-canvas').getBoundingClientRect().width < 600")


def test_parameters_are_found_by_their_meaning(opened):
    page = opened()
    page.run("document.querySelector('#more-knobs').open = true")
    page.type('#knob-search', 'compressed air')
    shown = """[...document.querySelectorAll('#all-knobs .knob')]
        .filter(one => one.getClientRects().length).map(one => one.dataset.name)"""
    assert page.run(shown) == ['air_force']


def test_every_preset_loads(opened, parameters):
    page = opened()
    assert len(load_presets()) >= 6
    for name, preset in load_presets().items():
        page.run("document.querySelector('#presets').showPopover()")
        page.click(f'#presets button[data-name={json.dumps(name)}]')
        page.wait(f"location.hash.includes('preset={name}')")
        asked = preset.values
        names = ['gap', 'primary_mass', 'angle', 'gap_control', 'friction']
        have = dict(zip(names, parameters.get(*names), strict=True))
        assert have == {key: asked[key] for key in names}, name
        frames = page.run('impactDamper.counted.frames')
        page.wait(f'impactDamper.counted.frames > {frames} + 5')
        assert page.said == [], name
    page.run("document.querySelector('#presets').showPopover()")
    page.click('#presets button[data-name=bench]')
    page.wait("location.hash.includes('preset=bench')")


@pytest.fixture
def own(browser, live, tmp_path):
    """Start a node in a namespace, and show it to a page; return how, and its name."""
    started, pages = [], []

    def start(space, **parameters):
        remap, name = f'__ns:={space}', f'{space}/sim_node'
        directory = tmp_path / f'node_{len(started)}'
        started.append(SimProcess(directory, [remap], parameters_file=BENCH, **parameters))
        if not pages:
            pages.append(browser.open(live.address))
            pages[0].wait(FULL)
            pages[0].wait(f'document.querySelector(\'#rig-choice option[value="{name}"]\')')
            pages[0].choose('#rig-choice', f"'{name}'")
        pages[0].wait(f"document.querySelector('#rig-choice').value === '{name}'")
        pages[0].wait(FULL)
        return started[-1], pages[0]

    yield start
    for process in started:
        process.kill()
    said = [text for page in pages for text in page.said]
    for page in pages:
        page.close()
    assert said == []


def test_a_node_killed_and_started_again(own):
    node, page = own('/of_a_page')
    page.wait("location.hash.startsWith('#rig=/of_a_page/sim_node')")
    node.kill()
    page.wait("document.querySelector('#status').dataset.state === 'gone'")
    assert 'does not answer' in page.text('#curtain')
    own('/of_a_page', gap=0.02)
    page.wait("document.querySelector('#knob-gap').value === '20'")
    assert page.run("document.querySelector('#curtain').hidden")


def test_a_controller_and_its_score(own, tmp_path):
    """What it sees and commands in the traces, the age of its commands, and faults."""
    runs, space = tmp_path / 'runs', '/of_a_controller'
    setting = {'gap_control': 'external', 'measurement_rate': 50.0, 'bag_directory': str(runs)}
    _, page = own(space, **setting)
    with RigClient() as client:
        rig = RigParametersClient(client, f'{space}/sim_node')
        assert rig.set(record=True) == ''
        stops = client.node.create_publisher(JointState, f'{space}/stop_commands', 10)
        command = JointState(name=['stop_1', 'stop_2'], position=[0.009, -0.009])
        timer = client.node.create_timer(0.1, lambda: stops.publish(command))
        page.wait('impactDamper.history.own.measured.length > 30')
        age = "document.querySelector('#command-age').textContent"
        page.wait(f"{age}.startsWith('Controller: commands are carried out, ')")
        page.wait('(acts => acts.field("stop1")[acts.end - 1])(impactDamper.history.own.acts)')
        # A measurement is on the line of the motion, as there is no noise.
        page.wait("""(({ own }) => Math.max(...[...Array(20).keys()].map(n => {
            const seen = own.measured.row(own.measured.end - 21 - n);
            const { x, z } = own.at(seen.time);
            return Math.max(Math.abs(x - seen.x), Math.abs(z - seen.z)); })))(
            impactDamper.history) < 1e-5""")
        for key in ('measured', 'commands'):
            page.wait(f"!document.querySelector('#legend [data-series={key}]').hidden")
        page.wait("/^[\\d.]+.mm$/.test(document.querySelector('#score dd').textContent)")
        # A fault is a switch.
        bias = "document.querySelector('#faults button[value=bias]')"
        for fault, pressed in (('bias', 'true'), ('none', 'false')):
            page.run(f'{bias}.click()')
            until(lambda fault=fault: rig.get('sensor_fault') == fault, fault)
            page.wait(f"{bias}.ariaPressed === '{pressed}'")
        timer.cancel()
        page.wait(f"{age}.includes('parked')")
        assert rig.set(record=False) == ''
    (bag,) = runs.iterdir()
    motion = load_recording(bag).motion
    assert len(motion.measured) > 30
    x = np.interp(motion.measured[:, 0], *motion.samples[:, :2].T)
    assert np.abs(motion.measured[:, 1] - x).max() < 1e-5
    assert (motion.acts[:, 1] == 1.0).sum() > 10


@pytest.mark.usefixtures('live')
def test_a_server_that_comes_back(browser, tmp_path):
    """The page joins it again by itself; see the reconnection in connection.js."""
    server = PageProcess(tmp_path / 'one', '--node', '/sim_node')
    page = browser.open(server.address)
    try:
        page.wait(FULL)
        port = server.address.rstrip('/').rpartition(':')[2]
        server.close()
        page.wait("document.querySelector('#status').dataset.state === 'offline'")
        server = PageProcess(tmp_path / 'two', '--node', '/sim_node', '--port', port)
        page.wait(FULL)
    finally:
        page.close()
        server.close()


def newest_recording(live):
    return max(live.recordings.iterdir(), key=lambda path: path.stat().st_mtime).name


def list_recordings(page, name):
    """Open the list of recordings and return the selector of one that is finished."""
    row = f'.recording[data-name="{name}"]'
    page.click('#recordings-open')
    page.wait(f"/\\d B$|kB$|MB$/.test(document.querySelector('{row} p').textContent)")
    return row


@pytest.fixture(scope='module')
def recording(browser, live, parameters):
    """Record a few seconds of the rig, in which its gap is changed."""
    page = browser.open(live.address)
    page.wait(FULL)
    assert page.run("document.querySelector('#record').ariaPressed") == 'false'
    page.click('#record')
    page.wait("document.querySelector('#record').ariaPressed === 'true'")
    start = page.run('impactDamper.history.end')
    page.type('#knob-gap', '28')
    page.wait(f'impactDamper.history.end > {start} + 2.5')
    page.click('#record')
    page.wait("document.querySelector('#record').ariaPressed === 'false'")
    until(lambda: parameters.get('record') is False)
    assert parameters.set(gap=0.024) == ''
    page.close()
    return newest_recording(live)


@pytest.fixture
def recorded(recording, opened):
    """Return a page, and the row of the recording in its open list."""
    page = opened()
    return page, list_recordings(page, recording)


def test_a_recording_is_played_to_its_end(recorded):
    page, row = recorded
    page.click(f'{row} .primary')
    page.wait("document.body.classList.contains('playing') && impactDamper.history.state")
    page.choose('#speed', 5)
    if page.text('#play') == 'Play':
        page.click('#play')
    page.wait("document.querySelector('#status').dataset.state === 'ended'")
    end = page.run("[impactDamper.history.end, Number(document.querySelector('#scrub').max)]")
    assert end[0] == pytest.approx(end[1], abs=0.1)
    # The address has its time, not that of the rig before.
    page.choose('#scrub', 'one.min')
    page.wait("location.hash.includes('time=')")
    time = 'Number(/time=([\\d.]+)/.exec(location.hash)?.[1])'
    page.wait(f"Math.abs({time} - document.querySelector('#scrub').min) < 0.1")
    # in the words of the live page
    assert page.run('impactDamper.history.changes.map(({text}) => text)') == ['d = 28 mm']
    # A second, ghosted rig with another gap
    page.choose('#scrub', 'one.min')
    page.type('#knob-gap', '20')
    page.wait('impactDamper.history.ghost !== null')
    # What both amount to stands beside each other.
    page.wait(
        "/^impacts\\d+\\d+[\\d.]+$/.test(document.querySelector('#totals').rows[3].textContent)"
    )
    # The knob is that of the ghost, what is written over the picture that of the rig.
    assert page.value('#knob-gap') == '20'
    page.click('#play')
    page.wait("document.querySelector('#rig-line').textContent.includes('28.0')")
    assert page.value('#knob-gap') == '20'
    # Its traces run beside those of the recording, in a colour that nothing else there has.
    page.wait("document.querySelector('#status').dataset.state === 'ended'")
    page.wait(f'{LENGTHS}[1] > 100 && {LENGTHS}[0] === {LENGTHS}[1]')
    assert page.run("document.querySelector('#legend [data-series=ghost]').hidden") is False
    legend = "document.querySelector('#legend [data-series=ghost] dd').textContent"
    page.wait(f'/^X .+ mm, Z .+ mm$/.test({legend})')
    own, other = page.run("""['own', 'other'].map(name =>
        Array.from(impactDamper.history[name].samples.field('x').subarray(0, 200)))""")
    assert max(abs(a - b) for a, b in zip(own, other, strict=True)) > 1e-4
    # without the line of the change, which is as coloured
    page.run("""(async ({history}) => {
        history.changes = [];
        history.version += 1;
        for (const _ of [1, 2]) await new Promise(requestAnimationFrame);
    })(impactDamper)""")
    assert page.run(MAGENTA.replace('PLACE', '#plot canvas')) > 200
    assert page.run(MAGENTA.replace('PLACE', '#portrait-canvas')) > 50
    # The link has it too.
    page.wait("location.hash.includes('gap=0.02')")
    page.tab.reload()
    page.wait(f'{LENGTHS}?.[1] > 100')
    assert page.value('#knob-gap') == '20'
    page.click('#clear-ghost')
    page.wait(f'{LENGTHS}[1] === 0 && impactDamper.history.ghost === null')
    page.wait("document.querySelector('#legend [data-series=ghost]').hidden")
    page.wait(f'{MAGENTA.replace("PLACE", "#portrait-canvas")} === 0')
    page.click('#back-live')
    page.wait(FULL)
    page.wait('!/bag=|gap=/.test(location.hash)')
    page.wait("document.querySelector('#knob-gap').value === '24'")


def test_frame_times_are_measured(opened):
    """By the probe of `page.frame_times`, as benchmarks/README.md names it."""
    page = opened('#window=3')
    page.wait(FULL_WINDOW.format(length=1.0))
    between, drawing, ages, rate = page.run(PROBE.format(seconds=1.0))
    assert 0.0 < quantile(between, 0.5) <= quantile(between, 0.99)
    # Drawn in the frame before, of a joint state that was there by then
    assert 0.0 < quantile(drawing, 0.5) < quantile(ages, 0.5) < 10_000.0
    # A browser that was late may draw more than its 60 frames in a second
    assert rate > 0.0


def test_sound_makes_a_click_at_each_impact(opened):
    page = opened()
    events = []
    protocol = page.protocol()
    for name in ('audioNodeCreated', 'nodesConnected', 'contextChanged'):
        protocol.on(f'WebAudio.{name}', lambda told, name=name: events.append((name, told)))
    protocol.send('WebAudio.enable')

    def made(kind):
        page.run('0')
        nodes = [told['node'] for name, told in events if name == 'audioNodeCreated']
        return [node['nodeId'] for node in nodes if node['nodeType'] == kind]

    def states():
        page.run('0')
        return [told['context']['contextState'] for n, told in events if n == 'contextChanged']

    # No sound, and nothing that could make one, before it is asked for
    frames = page.run('impactDamper.counted.frames')
    page.wait(f'impactDamper.counted.frames > {frames} + 60')
    assert events == []
    page.click('#sound')
    until(lambda: len(made('AudioBufferSource')) > 5, 'no click is made')
    page.click('#sound')
    until(lambda: states()[-1:] == ['suspended'], lambda: f'it does not become silent: {states()}')
    # Each click went through its own loudness and side to the loudspeakers.
    sources, gains, sides = map(made, ('AudioBufferSource', 'Gain', 'StereoPanner'))
    (speakers,) = made('AudioDestination')
    links = {(t['sourceId'], t['destinationId']) for n, t in events if n == 'nodesConnected'}
    for source, gain, side in zip(sources, gains, sides, strict=True):
        assert {(source, gain), (gain, side), (side, speakers)} <= links
    end = page.run('impactDamper.history.end')
    page.wait(f'impactDamper.history.end > {end} + 1')
    assert made('AudioBufferSource') == sources


def test_a_recording_is_downloaded(live, recorded, tmp_path):
    page, row = recorded
    name = page.run(f"document.querySelector('{row}').dataset.name")
    (source,) = (live.recordings / name).glob('*.mcap')
    with page.tab.expect_download() as download:
        page.click(f'{row} a[download]')
    copy = tmp_path / source.name
    download.value.save_as(copy)
    assert copy.read_bytes() == source.read_bytes()
    assert replay_run([str(copy)]) == 0


def test_a_recording_is_taken_care_of(live, recorded):
    page, row = recorded
    name = page.run(f"document.querySelector('{row}').dataset.name")

    def fill(button, text):
        page.run(f"""[...document.querySelectorAll('{row} button')]
            .find(one => one.textContent === '{button}').click()""")
        page.type(f'{row} form input', text)

    fill('Note', 'Stop 1 is loose')
    page.wait(f"document.querySelector('{row} .note').textContent === 'Stop 1 is loose'")
    assert (live.recordings / name / 'note.txt').read_text() == 'Stop 1 is loose\n'
    fill('Rename', '../elsewhere')
    page.wait("document.querySelector('#toast').textContent.includes('cannot be a name')")
    # Above the list, which is open
    assert page.run("document.querySelector('#toast').matches(':popover-open')")
    page.type(f'{row} form input', 'first')
    page.wait("document.querySelector('.recording[data-name=first]')")
    assert not (live.recordings / name).exists()
    row = '.recording[data-name=first]'
    page.run(f"""[...document.querySelectorAll('{row} button')]
        .find(one => one.textContent === 'Delete').click()""")
    page.wait(f"!document.querySelector('{row}')")
    assert not (live.recordings / 'first').exists()
    page.click('#recordings-deleted button')
    page.wait(f"document.querySelector('{row} .note').textContent === 'Stop 1 is loose'")
    fill('Rename', name)
    page.wait(f'document.querySelector(\'.recording[data-name="{name}"]\')')


def test_the_report_of_a_comparison_opens_in_the_page(recorded):
    page, row = recorded
    name = page.run(f"document.querySelector('{row}').dataset.name")
    page.click(f'{row} [data-compare]')
    page.wait(f"document.querySelector('{row} [data-compare]').textContent.startsWith('Cancel (')")
    page.wait("document.querySelector('#report').open", 4.0 * LONG)
    assert name in page.text('#report-title')
    assert not page.run("document.querySelector('#recordings').open")
    place = page.run("document.querySelector('#report-frame').src")
    assert place.endswith(f'/reports/{name}/report.html')
    # A script lets the browser tell of its frames.
    until(lambda: page.run('true') and page.tab.frame(url=place) is not None)
    report = page.tab.frame(url=place)
    until(lambda: report.evaluate("document.querySelectorAll('figure svg').length") > 3)
    assert 'replayed bit for bit' in report.evaluate('document.body.textContent')
    # It is shown, at the width that the page has for it.
    width = page.run("document.querySelector('#report-frame').clientWidth")
    assert report.evaluate('innerWidth') == width > 600
    assert report.evaluate('document.documentElement.scrollWidth') <= width
    page.click('#report [data-close]')
    page.wait("!document.querySelector('#report').open")
    page.wait("!document.querySelector('#report-frame').hasAttribute('src')")
