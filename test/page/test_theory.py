"""Theory for the page: the numbers of the solvers, and nothing old after a change."""

import asyncio
import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from impact_damper_ros.control import GapControlParameters, Rig
from impact_damper_ros.orbits import find_orbits, follow
from impact_damper_ros.page.measures import estimated_optimum
from impact_damper_ros.page.presets import load_presets
from impact_damper_ros.page.theorist import Theorist
from impact_damper_ros.page.theory import theory
from impact_damper_ros.rig import RigParameters, load_parameters
from impact_damper_ros.rig.parameters_file import preset_file

from .browser import in_loop, live_page
from .fake_rig import FakeLink

INCLINED = RigParameters(angle=0.7853981633974483, gravity=1.0, friction=0.5).replace(
    force_frequencies=(1.02,)
)


def messages(rig, control=None, **wanted):
    state = Rig(rig, control=control or GapControlParameters()).snapshot()
    found = list(theory(state, **{'orbit': True, 'curve': True, **wanted}))
    # As they are sent
    return json.loads(json.dumps(found, allow_nan=False))


@pytest.fixture(scope='module')
def paper():
    return messages(RigParameters(gravity=0.0))


def test_predicted_orbit_is_that_of_the_solver():
    found = messages(INCLINED, curve=False)
    assert {m['type'] for m in found} == {'orbit'}
    assert [m['complete'] for m in found] == [*([False] * (len(found) - 1)), True]
    last = found[-1]
    orbit = next(o for o in find_orbits(INCLINED, (1, 2), 1).orbits if o.stable and o.viable)
    assert last['label'] == '2 impacts in 1 cycle'
    assert last['x_max_ratio'] == pytest.approx(0.2113439, abs=1e-7)
    assert last['stable']
    assert last['viable']
    moduli = [abs(complex(*pair)) for pair in last['multipliers']]
    assert moduli == pytest.approx([0.94107, 0.94107, 0.57960, 0.57960], abs=1e-4)
    assert [i['phase'] for i in last['impacts']] == pytest.approx([0.7579950, 0.2697923], abs=1e-6)
    assert last['period'] == orbit.period


def test_drawn_orbit_is_the_motion_of_the_rig():
    """Set going on the orbit, the rig is where the message says."""
    last = messages(INCLINED, curve=False)[-1]
    t, x, z = (np.array(last[name]) for name in ('t', 'x', 'z'))
    assert (np.diff(t) >= 0.0).all()
    assert last['t_zero'] == pytest.approx(0.0)
    rig = Rig(INCLINED)
    rig.advance(1000 * last['period'])
    began = rig.time
    for share in (0.05, 0.3, 0.55, 0.9):
        rig.advance(began + share * last['period'])
        at = (rig.time - last['t_zero']) % last['period']
        sample = rig.sample()
        assert np.interp(at, t, x) == pytest.approx(sample.x, abs=5e-3)
        assert np.interp(at, t, z) == pytest.approx(sample.z, abs=3e-2)
    y, velocity = np.array(last['y']), np.array(last['relative_velocity'])
    assert np.abs(y).max() == pytest.approx(0.5 * INCLINED.gap, rel=1e-6)
    assert velocity.max() > 0.0 > velocity.min()


@in_loop
async def test_an_impact_is_drawn_from_before_it_to_after_it(tmp_path):
    """There Y' is multiplied by -R at once; elsewhere it is the rate of Y."""
    async with live_page(tmp_path) as (_, page):
        orbit = await page.next('orbit', found=True)
    t, y, rate = (np.array(orbit[name]) for name in ('t', 'y', 'relative_velocity'))
    off = np.diff(y) - np.diff(t) * 0.5 * (rate[1:] + rate[:-1])
    assert np.abs(off).max() < 1e-4 * 37.0
    (hits,) = np.nonzero(np.diff(t) < 1e-9)
    turned = [(y[n], rate[n + 1] / rate[n]) for n in hits if rate[n] * rate[n + 1] < 0.0]
    assert sorted(turned) == [pytest.approx((place, -0.75)) for place in (-18.5, 18.5)]


def test_gap_curve_comes_part_by_part(paper):
    curves = [m for m in paper if m['type'] == 'gap_curve']
    assert len(curves) >= 3
    assert [m['done'] for m in curves] == [*([False] * (len(curves) - 1)), True]
    assert len(curves[0]['branches'][0]['gap']) < 40
    last = curves[-1]
    # It grows at both ends, and what is there stays.
    # Special points are located at the end, and are points of it then
    located = {special['gap'] for special in last['special']}
    whole = [gap for gap in last['branches'][0]['gap'] if gap not in located]
    for curve in curves:
        gaps = [gap for gap in curve['branches'][0]['gap'] if gap not in located]
        start = whole.index(gaps[0])
        assert whole[start : start + len(gaps)] == gaps
    counts = [len(curve['branches'][0]['gap']) for curve in curves]
    assert counts == sorted(counts)
    # All of it before the other motions that the rig can have
    kinds = [m['type'] if m['type'] == 'gap_curve' else m['complete'] for m in paper]
    before = paper[: kinds.index(True)]
    assert before[-1]['branches'][0]['gap'] == whole
    main = last['branches'][0]
    gap, ratio = np.array(main['gap']), np.array(main['x_max_ratio'])
    assert gap.min() == pytest.approx(37.0 / 4)
    assert gap.max() == pytest.approx(37.0 * 4)
    # Golden case at the rig's own gap
    here = int(np.abs(gap - 37.0).argmin())
    assert ratio[here] == pytest.approx(last['x_max_ratio'])
    for k in range(0, len(gap), 15):
        rig = RigParameters(gravity=0.0, gap=float(gap[k]))
        near = min(
            find_orbits(rig, (1, 2), 1).orbits, key=lambda o: abs(o.amplitude_ratio - ratio[k])
        )
        assert near.amplitude_ratio == pytest.approx(ratio[k], rel=1e-6)
        assert (near.stable, near.viable) == (main['stable'][k], main['viable'][k])
    assert 'Neimark-Sacker' in {special['kind'] for special in last['special']}


def test_no_optimum_is_taken_where_the_curve_goes_on(paper):
    """Its first parts fall to their ends: the best gap may be beyond."""
    *parts, last = (m for m in paper if m['type'] == 'gap_curve')
    for part in parts:
        for branch in part['branches'][-1:]:
            gaps, ratios = branch['gap'], branch['x_max_ratio']
            at = int(np.argmin(np.where(branch['stable'], ratios, np.inf)))
            if part['optimum'] is None:
                assert at in (0, len(gaps) - 1)
            else:
                assert part['optimum']['gap'] == pytest.approx(last['optimum']['gap'], rel=0.02)
    assert parts[0]['optimum'] is None


@in_loop
async def test_the_curve_goes_on_where_it_falls_at_the_end_of_its_range(tmp_path):
    """The best gap is 55.0 mm, almost seven times the present one of 8 mm."""
    four = next(preset for preset in load_presets() if preset.name == 'figure_2_four')
    async with live_page(tmp_path, FakeLink(rig=four.rig)) as (_, page):

        def beyond_its_own_branch():
            best = [m['optimum'] for m in page.of('gap_curve')[-1:] if m['optimum']]
            return [one for one in best if one['gap'] > 0.02]

        (best,) = await page.until(beyond_its_own_branch)
        assert best['gap'] == pytest.approx(0.055, rel=0.01)
        assert best['bound'] == ''


@in_loop
async def test_an_optimum_beyond_all_that_is_followed_is_a_bound(tmp_path):
    """Below its resonance, M moves the less the smaller the gap is."""
    rig = RigParameters(gravity=0.0, gap=0.5, damper_mass=0.02, force_frequencies=(0.9,))
    link = FakeLink(rig=rig.replace(restitution_1=0.0, restitution_2=0.0))
    async with live_page(tmp_path, link) as (_, page):
        await page.send(type='theory', orbit=False, curve=True)
        curve = await page.next('gap_curve', done=True)
        # Beside the gap of the rig, too
        await page.until(
            lambda: [m for m in page.of('numbers') if m.get('optimal_gap_basis') == 'at most']
        )
    least = min(gap for branch in curve['branches'] for gap in branch['gap'])
    assert (curve['optimum']['gap'], curve['optimum']['bound']) == (least, 'at most')


@pytest.mark.parametrize(
    'rig',
    [
        RigParameters(gravity=0.0),
        load_parameters(preset_file(Path('bench_rig')))[0],
        RigParameters(gravity=0.0, restitution_1=0.6, restitution_2=0.6, damper_mass=0.05),
    ],
    ids=['paper', 'bench', 'soft stops'],
)
def test_an_energy_balance_gives_about_the_optimal_gap(rig):
    estimate = estimated_optimum(rig)
    near = find_orbits(rig.replace(gap=0.8 * estimate), (1, 2), simulate=False).orbits
    best = follow(near[0], 'gap', 0.5 * estimate, 1.5 * estimate).best()
    assert estimate == pytest.approx(best.value, rel=0.2)


@pytest.mark.parametrize(
    'changes',
    [
        {'one_sided': True},
        {'angle': 0.6, 'gravity': 9.81},
        {'friction': 0.3, 'gravity': 9.81},
        {'air_force': 0.2},
        {'restitution_1': 0.5},
        {'restitution_1': 1.0, 'restitution_2': 1.0},
        {'force_frequencies': 1.3},
        {'force_amplitudes': 0.0},
        {'sweep_mode': 'up'},
        {'multisine_level': 1.0},
        {'force_amplitudes': (1.0, 0.2), 'force_frequencies': (1.0, 2.0), 'force_phases': (0, 0)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_no_energy_balance_where_it_does_not_hold(changes):
    assert estimated_optimum(RigParameters(gravity=0.0).replace(**changes)) is None


@in_loop
async def test_the_best_gap_that_is_known_by_now():
    theorist = Theorist(lambda _: None, (sys.executable, '-c', 'input()'))
    rig = RigParameters(gravity=0.0)
    theorist._number = 1

    def hear(**message):
        theorist._take(json.dumps({'for': 1, **message}).encode())
        return theorist.best_gap(rig)

    first = estimated_optimum(rig), 'formula'
    assert theorist.best_gap(rig) == first
    assert theorist.best_gap(None) == (None, '')
    curve = {'type': 'gap_curve', 'done': False}
    assert hear(**curve, optimum=None) == first
    assert hear(**curve, optimum={'gap': 57.0, 'bound': ''}) == (57.0, 'part of the curve')
    curve['done'] = True
    assert hear(**curve, optimum={'gap': 58.0, 'bound': ''}) == (58.0, 'curve')
    assert hear(**curve, optimum={'gap': 59.0, 'bound': 'at least'}) == (59.0, 'at least')
    # Where all of the curve has no best gap, and where there is no theory, there is none.
    assert hear(**curve, optimum=None) == (None, '')
    theorist.forget()
    assert theorist.best_gap(rig) == first
    assert hear(type='theory_failed', text='') == (None, '')
    await theorist.close()


def test_optimum_of_the_curve_is_the_optimal_gap(paper):
    orbit = find_orbits(RigParameters(gravity=0.0), (1, 2)).orbits[0]
    best = follow(orbit, 'gap', 30.0, 70.0).best()
    optimum = paper[-1]['optimum']
    assert optimum['gap'] == pytest.approx(best.value, rel=1e-5)
    assert optimum['x_max_ratio'] == pytest.approx(best.orbit.amplitude_ratio, rel=1e-9)


@pytest.mark.parametrize(
    ('rig', 'control', 'words'),
    [
        (RigParameters(multisine_level=1.0), None, ''),
        (RigParameters(sweep_mode='up'), None, ''),
        (RigParameters(), GapControlParameters(gap_control='timed'), 'gap_control is timed'),
    ],
    ids=['multisine', 'sweep', 'control'],
)
def test_where_there_is_no_theory_it_says_why(rig, control, words):
    *_, last = messages(rig, control)
    assert last['type'] == 'theory_failed'
    assert last['text'].startswith(words)
    assert last['text']


def test_a_one_sided_rig_has_an_orbit_but_no_curve():
    ball = next(preset for preset in load_presets() if preset.name == 'bouncing_ball')
    found = messages(ball.rig)
    *orbits, curve = found
    assert {m['type'] for m in orbits} == {'orbit'}
    assert orbits[-1]['found']
    assert (curve['type'], curve['done'], curve['branches']) == ('gap_curve', True, [])
    assert 'one-sided' in curve['text']


def test_what_is_not_wanted_is_not_computed():
    assert messages(INCLINED, orbit=False, curve=False) == []


@in_loop
async def test_only_the_newest_rig_is_answered():
    """Also while a rig that takes long is being worked on."""
    found = []
    done = asyncio.Event()

    def take(message):
        found.append(message)
        if message['type'] == 'gap_curve' and message['done']:
            done.set()

    theorist = Theorist(take)
    slow = Rig(RigParameters(gravity=0.0, gap=8.0)).snapshot()
    for _ in range(5):
        theorist.ask(slow)
        await asyncio.sleep(0.02)
    while not found:
        await asyncio.sleep(0.01)
    number = found[-1]['for']
    found.clear()
    theorist.ask(Rig(RigParameters(gravity=0.0)).snapshot())
    assert theorist.known() == []
    await asyncio.wait_for(done.wait(), 100.0)
    await theorist.close()
    assert {message['for'] for message in found} == {number + 1}
    assert theorist.predicted == pytest.approx(0.104644, abs=1e-6)
    assert theorist.optimum == pytest.approx(58.3, rel=0.02)
    assert {message['type'] for message in theorist.known()} == {'orbit', 'gap_curve'}


@in_loop
async def test_theory_that_takes_too_long_says_so():
    program = (
        'from impact_damper_ros.page import theory_process as process\n'
        'def endless(state, **_):\n'
        '    yield {"type": "orbit", "found": False}\n'
        '    while True: pass\n'
        'process.theory, process._PATIENCE_S = endless, 0.2\n'
        'process.main()\n'
    )
    found = []
    theorist = Theorist(found.append, (sys.executable, '-c', program))
    theorist.ask({})
    async with asyncio.timeout(100.0):
        while len(found) < 2:
            await asyncio.sleep(0.01)
    await theorist.close()
    assert [message['type'] for message in found] == ['orbit', 'theory_failed']
    assert 'not finished within 0.2 s' in found[1]['text']


def theory_process():
    """Return the number of the process that computes theory for this one, once it is there."""
    own = Path('/proc/self/task')
    for children in own.glob('*/children'):
        for child in children.read_text('utf-8').split():
            if b'theory_process' in Path('/proc', child, 'cmdline').read_bytes():
                return int(child)
    return 0


@in_loop
async def test_a_theory_process_that_is_killed_is_started_again(tmp_path):
    """It answers the last request, whether that was under way or is made just after its end."""
    async with live_page(tmp_path) as (link, page):
        link.change(gap=36.0)
        await page.next('gap_curve', gap=36.0)
        os.kill(theory_process(), signal.SIGKILL)
        await page.next('gap_curve', gap=36.0, done=True)
        os.kill(theory_process(), signal.SIGKILL)
        link.change(gap=38.0)
        await page.next('gap_curve', gap=38.0, done=True)
