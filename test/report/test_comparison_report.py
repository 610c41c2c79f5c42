"""The report: all that was found is on the page, and nothing makes the page go wrong."""

import dataclasses
import errno
import json
import math
import re
import resource
from importlib.resources import files
from xml.etree import ElementTree

import numpy as np
import pytest
from compare.recorded import compared
from report.example_comparison import example
from rigs import BENCH, VERTICAL

from impact_damper_ros import InitialConditions, find_orbits
from impact_damper_ros.compare import Verdict
from impact_damper_ros.compare.result import StretchCurves
from impact_damper_ros.report.formatting import instant, number, unit_for

pytest.importorskip('matplotlib', reason='the report has plots')

from impact_damper_ros.report.charts import PICTURES
from impact_damper_ros.report.drawing import COLORS, inline_svg, page_style
from impact_damper_ros.report.html_report import (
    MOST_DETAILED,
    MOST_LISTED,
    report_page,
    shown_stretches,
    with_gap_curves,
    write_report,
)
from impact_damper_ros.report.motion_charts import (
    draw_history,
    draw_run,
    predicted_impacts,
    predicted_lines,
    predicted_motion,
)

STYLE = (files('impact_damper_ros.report') / 'template' / 'report.css').read_text('utf-8')


@pytest.fixture(scope='module')
def run():
    return example()


@pytest.fixture(scope='module')
def page(run):
    return report_page(run, command='compare_run runs/run_20260101_120000 --report report')


def parsed(page):
    """Read the page strictly: it is well-formed as XML too, and its ids are unique."""
    first, _, rest = page.partition('\n')
    assert first == '<!DOCTYPE html>'
    root = ElementTree.fromstring(rest)
    for element in root.iter():
        element.tag = element.tag.rpartition('}')[2]
        link = element.attrib.pop('{http://www.w3.org/1999/xlink}href', None)
        element.attrib |= {} if link is None else {'href': link}
    ids = [element.get('id') for element in root.iter() if element.get('id')]
    assert len(ids) == len(set(ids))
    for element in root.iter():
        for name in ('href', 'aria-labelledby'):
            target = element.get(name, '')
            if name == 'href' and not target.startswith('#'):
                assert target == '' or target.startswith('data:image/png;base64,'), target
            elif target:
                assert target.lstrip('#') in ids
        for reference in re.findall(r'url\(#([^)]+)\)', ' '.join(element.attrib.values())):
            assert reference in ids
        assert not {'src', 'srcset', 'onload', 'onclick'} & set(element.attrib)
        assert element.tag not in ('script', 'iframe', 'object', 'link')
    return root


def section(root, number):
    (found,) = (e for e in root.iter('section') if e.get('id') == f'stretch-{number}')
    return found


def text_of(element):
    return ' '.join(''.join(element.itertext()).split())


def rows_of(element, caption):
    """Return the rows of the table with a caption, by their first cell; the last of equal ones."""
    for table in element.iter('table'):
        if text_of(table.find('caption')).startswith(caption):
            return [[text_of(cell) for cell in row] for row in table.iter('tr')]
    raise AssertionError(f'no table {caption}')


def without_pictures(run):
    """Return a run of which only the tables are to be seen, which takes no time to draw."""
    bare = (dataclasses.replace(stretch, curves=StretchCurves()) for stretch in run.stretches)
    return dataclasses.replace(run, stretches=tuple(bare))


def alone(run, n, **values):
    """Return a run of one stretch, with some of its values changed; without pictures."""
    stretch = without_pictures(run).stretches[n - 1]
    return dataclasses.replace(run, stretches=(dataclasses.replace(stretch, **values),))


def changed(run, n, **values):
    """Return a run in which a stretch is another one."""
    stretches = list(run.stretches)
    stretches[n - 1] = dataclasses.replace(stretches[n - 1], **values)
    return dataclasses.replace(run, stretches=tuple(stretches))


def test_all_plots_are_there(page):
    root = parsed(page)
    assert 'compare_run runs/run_20260101_120000 --report report' in text_of(root)
    for n, missing in ((1, set()), (2, set()), (3, {'convergence', 'spectrum', 'gap'})):
        part = section(root, n)
        shown = [svg.get('aria-label') for svg in part.iter('svg')]
        # A rig under a steady force has no ring-down and no sweep
        assert len(shown) == len(PICTURES) - len({'decay', 'loss', 'response', *missing})
        assert all(f'stretch {n}' in label for label in shown)
        captions = [text_of(caption) for caption in part.iter('figcaption')]
        assert any(c.startswith('Time history.') for c in captions)
        assert any(c.startswith('Poincaré section.') for c in captions)
        assert any(c.startswith('Largest |X| over the gap.') for c in captions) == (n != 3)
    # Every figure is drawn in the page's own colours.
    for svg in root.iter('svg'):
        styles = ' '.join(e.get('style', '') for e in svg.iter())
        assert 'var(--ink)' in styles
        assert not re.search(r'#[0-9a-f]{6}', styles)


def test_what_is_predicted_stands_beside_what_was_measured(run, page):
    rows = rows_of(section(parsed(page), 1), 'Measured and predicted')
    named = {row[0]: row for row in rows}
    assert named['largest |X|'][1:3] == ['5.072124', '5.072124']
    assert named['Xmax / A'][1:3] == ['0.2113439', '0.2113439']
    measured, predicted = named['decay per period'][1:3]
    # That of the last deviations, whose last digits are round-off
    assert (float(measured), predicted) == (pytest.approx(0.94105, abs=1e-5), '0.9410652')
    impacts = rows_of(section(parsed(page), 1), 'Impacts of the last period')
    assert impacts[0][1:3] == ['phase [cycles]', 'X [m]']
    first = impacts.index(['Impact 1, on stop 1'])
    for row, name in zip(impacts[first + 1 : first + 3], ('measured', 'predicted'), strict=True):
        assert (row[0], float(row[1]), row[2]) == (
            name,
            pytest.approx(0.757995, abs=5e-7),
            '4.13214',
        )
    assert float(impacts[first + 3][1].replace('−', '-')) < 1e-9
    # A wrong impact has its sign, in the same unit.
    last = run.stretches[0].measured.last_period
    wrong = dataclasses.replace(last, x=(last.x[0] - 0.002, last.x[1]))
    measured = dataclasses.replace(run.stretches[0].measured, last_period=wrong)
    other = rows_of(section(parsed(report_page(alone(run, 1, measured=measured))), 1), 'Impacts')
    assert [row[2] for row in other[first + 1 : first + 4]] == ['4.13014', '4.13214', '−0.002']


def test_phases_are_compared_around_the_clock(run):
    last = run.stretches[0].measured.last_period
    orbit = dataclasses.replace(run.stretches[0].predicted, phases=(0.999, 0.2698))
    turned = dataclasses.replace(last, phases=(0.001, 0.2698))
    measured = dataclasses.replace(run.stretches[0].measured, last_period=turned)
    page = report_page(alone(run, 1, measured=measured, predicted=orbit))
    rows = rows_of(section(parsed(page), 1), 'Impacts')
    assert [row[1] for row in rows[2:5]] == ['0.001', '0.999', '0.002']


def test_energy_adds_up_on_the_page(run, page):
    rows = {row[0]: row for row in rows_of(section(parsed(page), 1), 'Energy balance')[1:]}
    energy = run.stretches[0].energy
    force = energy.force / energy.periods
    assert float(rows['work of the force'][1]) == pytest.approx(force, rel=1e-4)
    taken = ('dashpot', 'friction', 'impacts', 'change of stored energy', 'unexplained')
    shares = [float(rows[name][2].replace('−', '-').split()[0]) for name in taken]
    assert sum(shares) == pytest.approx(100.0, abs=0.2)


def test_changes_and_findings_are_shown(run):
    stiffer = run.stretches[1].parameters.replace(stiffness=1.25)
    run = without_pictures(run)
    first = dataclasses.replace(run, stretches=run.stretches[:2])
    root = parsed(report_page(changed(first, 2, parameters=stiffer)))
    second = section(root, 2)
    assert rows_of(second, 'Changed parameters')[1:] == [['stiffness', '1.25', 'N/m', '1']]
    assert (
        'position of stop_1 on /joint_states at 605 s is 37.5 m in the log, and 37 m'
        in text_of(second)
    )
    assert 'damping = 0.02 N s/m (was 0.01 N s/m)' in text_of(second.find('h2'))
    (badge,) = (e for e in second.iter('span') if e.get('class') == 'badge bad')
    assert text_of(badge) == '✗ differs'
    # The first stretch has all of them, the others what is changed.
    assert ['damping', '0.01', 'N s/m'] in rows_of(section(root, 1), 'Parameters')
    assert 'Parameters' not in [text_of(c) for c in second.iter('caption')]


def test_the_page_is_the_same_each_time_whatever_the_readers_own_style(run):
    import matplotlib as mpl

    short = dataclasses.replace(run, stretches=run.stretches[2:])
    plain = report_page(short)
    with mpl.rc_context({'lines.linewidth': 9, 'font.size': 20, 'axes.grid': False}):
        before = dict(mpl.rcParams)
        assert report_page(short) == plain
        assert dict(mpl.rcParams) == before


HOSTILE = '<script>alert(1)</script>"\'&amp;]]>\x00\x1b[31m\u202e\ud800 $title ${style}'


def test_hostile_text_is_only_text(run):
    run = without_pictures(run)
    named = dataclasses.replace(
        changed(run, 1, cause=HOSTILE, sentence=HOSTILE, evidence=HOSTILE, solver=HOSTILE),
        bag=f'runs/{HOSTILE}',
        node=HOSTILE,
        faults=(HOSTILE,),
        remarks=(HOSTILE,),
    )
    wrong = dataclasses.replace(run.stretches[1].differences[0], topic=HOSTILE)
    named = changed(named, 2, differences=(wrong,), control={HOSTILE: HOSTILE})
    page = report_page(named, command=HOSTILE)
    root = parsed(page)
    assert '<script' not in page
    assert text_of(root).count('<script>alert(1)</script>') >= 10
    assert '$title' in text_of(root)
    assert not any(c in page for c in '\x00\x1b\u202e\ud800')


def test_nothing_known_but_the_stretch(run):
    """No impacts, no measurement, no prediction, no curves; then no stretch at all."""
    nothing = {
        'measured': None,
        'predicted': None,
        'predicted_impulse': (),
        'energy': None,
        'decay': None,
        'settled_at': None,
        'solver': '',
        'impacts': 0,
        'curves': StretchCurves(),
        'verdict': Verdict.TOO_SHORT,
    }
    part = section(parsed(report_page(alone(run, 1, **nothing))), 1)
    assert 'Too little of this stretch was recorded' in text_of(part)
    assert rows_of(part, 'Parameters')
    bare = parsed(report_page(dataclasses.replace(run, stretches=())))
    assert 'nothing to compare' in text_of(bare)


def test_numbers_that_are_not(run):
    measured = run.stretches[0].measured
    lost = {
        f.name: math.nan
        for f in dataclasses.fields(measured)
        if isinstance(getattr(measured, f.name), float)
    }
    energy = dataclasses.replace(
        run.stretches[0].energy,
        **dict.fromkeys(('force', 'air', 'dashpot', 'impacts', 'residual'), math.inf),
        periods=0,
    )
    odd = alone(run, 1, measured=dataclasses.replace(measured, **lost), energy=energy)
    part = section(parsed(report_page(odd)), 1)
    assert rows_of(part, 'Measured')[2] == ['largest |X|', '–', '5.072124', '–', 'm']
    assert 'nan' not in text_of(part).lower().split()


def many(run, count):
    """Return a run of many stretches, of which a few late ones differ."""
    stretches = []
    for n in range(1, count + 1):
        template = run.stretches[1 if n % 150 == 149 else 0]
        bare = dataclasses.replace(template.curves, motion=None, impacts=None, spectrum=None)
        bare = dataclasses.replace(bare, gap_curve=None, convergence=None)
        times = {'start': 10.0 * n, 'end': 10.0 * n + 10.0 + (n == 7)}
        stretches.append(dataclasses.replace(template, number=n, curves=bare, **times))
    return dataclasses.replace(run, stretches=tuple(stretches))


def test_many_stretches_stay_readable(run):
    page = report_page(many(run, 600))
    root = parsed(page)
    detailed = [int(e.get('id')[8:]) for e in root.iter('section') if e.get('class') == 'stretch']
    assert len(detailed) == MOST_DETAILED
    assert {149, 299, 449, 599, 7} <= set(detailed)
    assert detailed == sorted(detailed)
    rows = rows_of(root, 'All stretches')
    assert len(rows) == MOST_LISTED + 1
    text = text_of(root)
    assert f'{MOST_DETAILED} of 600 are shown in detail' in text
    assert f'{600 - MOST_LISTED} are not listed here' in text
    assert len(page) < 1_000_000


def test_the_most_telling_stretches(run):
    stretches = run.stretches
    assert shown_stretches(stretches, 1) == (stretches[1],)
    assert shown_stretches(stretches, 9) == stretches


def test_points_and_periods_that_show_nothing_more(run):
    stretch = run.stretches[0]
    impacts, convergence = stretch.curves.impacts, stretch.curves.convergence
    again, phases = (np.tile(part[-2:], 10000) for part in (impacts, stretch.curves.phases))
    floor = np.full(4000, 0.5 * convergence.decay.floor)
    settled = dataclasses.replace(
        convergence,
        time=6.16 * np.arange(len(convergence.distance) + 4000),
        distance=np.concatenate([convergence.distance, floor]),
    )
    curves = dataclasses.replace(stretch.curves, impacts=again, phases=phases, convergence=settled)
    long = dataclasses.replace(stretch, curves=curves)
    with page_style():
        section = PICTURES['section'](long)
        approach = PICTURES['convergence'](long)
    svg = inline_svg(section.figure, 'k', 'section')
    assert '<image' not in svg
    assert svg.count('<use ') < 300
    assert '20000 latest impacts' in section.caption
    # The approach takes less than 400 periods; the rest lies on the floor.
    assert 1000.0 < approach.figure.axes[0].get_xlim()[1] < 6.16 * 600.0


def test_the_slopes_of_an_approach(run):
    """Each line falls by its factor in a period; two points are enough to be drawn."""
    stretch = run.stretches[0]
    found = stretch.curves.convergence
    with page_style():
        (axes,) = PICTURES['convergence'](stretch).figure.axes
    lines = {line.get_label().partition(':')[0]: line.get_ydata() for line in axes.lines}
    for name in ('measured', 'predicted'):
        steps = lines[name][1:] / lines[name][:-1]
        assert steps[np.isfinite(steps)] == pytest.approx(getattr(found.decay, name))
    for count in (1, 2):
        few = dataclasses.replace(found, time=found.time[:count], distance=found.distance[:count])
        curves = dataclasses.replace(stretch.curves, convergence=few)
        with page_style():
            picture = PICTURES['convergence'](dataclasses.replace(stretch, curves=curves))
        assert (picture is None) == (count == 1)


def test_predicted_motion_is_laid_over_any_time(run):
    stretch = run.stretches[0]
    curve, orbit = stretch.curves.predicted, stretch.predicted
    start = stretch.end - 5.0 * orbit.period
    end = start + 3.0 * orbit.period
    hit, place = predicted_impacts(stretch, start, end)
    assert len(hit) == 6
    for at in stretch.curves.impacts['time']:
        if start <= at <= end:
            assert np.abs(hit - at).min() < 0.01
    # m is at the stop that it hits
    half = {1: 18.5, 2: -18.5}
    places = [x + half[stop] for x, stop in zip(orbit.x, orbit.stops, strict=True)]
    assert sorted(place) == pytest.approx(sorted(3 * places))
    time, x, y = predicted_motion(curve, start, end)
    assert start <= time[0] < start + 0.1
    assert end - 0.1 < time[-1] <= end
    assert np.abs(x).max() == pytest.approx(orbit.x_max, rel=1e-3)
    assert np.abs(y).max() == pytest.approx(37.0 / 2.0, rel=1e-9)
    measured = stretch.curves.motion
    there = np.interp(time, measured.time, measured.x)
    assert np.abs(x - there).max() < 2e-3 * orbit.x_max


def test_predicted_lines_are_the_fourier_coefficients(run):
    curve = run.stretches[0].curves.predicted
    angle = np.linspace(0.0, math.tau, 4001)
    known = dataclasses.replace(
        curve,
        phase=0.3 + 2.0 * angle / math.tau,
        x=3.0 * np.cos(angle - 0.4) + 0.5 * np.sin(4.0 * angle) + 7.0,
        cycle=0.5,
        cycles=2,
    )
    frequency, amplitude = predicted_lines(known, 5.0)
    assert frequency == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])
    assert amplitude == pytest.approx([3.0, 0.0, 0.0, 0.5, 0.0], abs=1e-5)


@pytest.fixture(scope='module')
def runs(run):
    """Return runs of all kinds: settled, chaotic, without impacts, one-sided, empty."""
    cases = [
        (BENCH, 130),
        (BENCH.replace(angle=0.2), 150),
        (BENCH.replace(gap=0.3), 60),
        (VERTICAL, 40),
    ]
    stretches = []
    for rig, cycles in cases:
        stretch = compared(rig, cycles, InitialConditions())
        stretches.append(dataclasses.replace(stretch, number=len(stretches) + 1))
    several = dataclasses.replace(run, stretches=tuple(stretches))
    return [run, several, dataclasses.replace(run, stretches=())]


def lines_of(picture):
    """Yield points of the lines of a picture that are drawn in the units of its axes."""
    (axes,) = picture.figure.axes
    for line in axes.lines:
        x, y = np.array(line.get_data(), dtype=float)
        if line.get_transform() == axes.transData and len(x) > 2 and np.isfinite(y).any():
            yield axes, line, (x, y)


def test_the_predicted_orbit_closes(runs):
    """Also where it was cut open, at its first impact; on the page too."""
    shown = [s for s in runs[1].stretches if s.curves.predicted is not None]
    assert len(shown) == 3
    for stretch in shown:
        curve, orbit = stretch.curves.predicted, stretch.predicted
        columns = (curve.x, curve.velocity, curve.y, curve.relative_velocity)
        for column in columns:
            assert column[-1] == column[0]
        assert curve.phase[-1] - curve.phase[0] == pytest.approx(orbit.cycles)
        # Each impact is a step of the velocity at one X.
        steps = np.abs(np.diff(curve.velocity)) > 0.02 * np.ptp(curve.velocity)
        steps &= np.abs(np.diff(curve.x)) < 1e-9 * np.ptp(curve.x)
        impulses = np.abs(stretch.predicted_impulse) / stretch.parameters.primary_mass
        assert steps.sum() == (impulses > 0.02 * np.ptp(curve.velocity)).sum() > 0


def test_no_curve_is_cut(runs):
    seen = 0
    pictures = []
    with page_style():
        pictures.append(draw_run(runs[0].stretches))
        for each in runs:
            for stretch in each.stretches:
                pictures += [draw(stretch) for draw in PICTURES.values()]
    for picture in filter(None, pictures):
        for axes, _, (x, y) in lines_of(picture):
            (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
            slack = 1e-9 * (right - left)
            assert np.nanmin(x) >= left - slack, picture.title
            assert np.nanmax(x) <= right + slack, picture.title
            assert np.nanmax(y) <= high * (1.0 + 1e-9), picture.title
            # What is below the floor of the spectrum is no curve to be seen.
            assert np.nanmin(y) >= low - 1e-9 * abs(low) or picture.title == 'Spectrum'
            seen += 1
    assert seen > 50


def branch_of(stretch, **columns):
    """Return the stretch with other columns of the branch over its gap, and no special points."""
    curve = stretch.curves.gap_curve
    branch = {**curve['branches'][0], **columns}
    curve = {**curve, 'branches': [branch], 'special': []}
    return dataclasses.replace(
        stretch, curves=dataclasses.replace(stretch.curves, gap_curve=curve)
    )


def gap_curve(run, factor):
    """Draw the curve over the gap with its part that is not viable made taller."""
    stretch = run.stretches[0]
    count = len(stretch.curves.gap_curve['branches'][0]['gap'])
    viable = np.arange(count) < count // 2
    ratio = np.where(viable, 0.2, 0.2 * factor)
    with page_style():
        return PICTURES['gap'](branch_of(stretch, x_max_ratio=ratio, viable=viable))


def test_what_is_not_viable_is_shown_or_said_to_be_left_out(run):
    whole, cut = gap_curve(run, 2.0), gap_curve(run, 40.0)
    assert whole.figure.axes[0].get_ylim()[1] > 0.4
    assert 'left out' not in whole.caption
    assert max(np.nanmax(y) for _, _, (_, y) in lines_of(whole)) == pytest.approx(0.4)
    top = cut.figure.axes[0].get_ylim()[1]
    assert top < 0.3
    assert f'Motions that are not viable are not drawn above {number(top, 2)}.' in cut.caption
    assert max(np.nanmax(y) for _, _, (_, y) in lines_of(cut)) <= top


def test_the_caption_of_the_gap_curve(run, page):
    """A least motion where the branch was not followed further is no minimum."""
    curve = run.stretches[0].curves.gap_curve
    best = curve['optimum']
    assert best['bound'] == ''
    least = f'Least: {number(best["x_max_ratio"], 3)} at a gap of'
    assert f'{least} {number(best["gap"], 3)} m. Special' in text_of(section(parsed(page), 1))
    at_end = {**curve, 'optimum': {**best, 'bound': 'at least'}}
    stretch = run.stretches[0]
    stretch = dataclasses.replace(
        stretch, curves=dataclasses.replace(stretch.curves, gap_curve=at_end)
    )
    with page_style():
        caption = PICTURES['gap'](stretch).caption
    assert f'{least} at least {number(best["gap"], 3)} m. It was not followed' in caption


def test_lines_of_motions_mean_the_same_everywhere(run):
    """Solid stable, dashed unstable, dotted not viable: over the gap and over the run."""
    stretch = run.stretches[0]
    count = len(stretch.curves.gap_curve['branches'][0]['gap'])
    third = np.arange(count) * 3 // count
    with page_style():
        picture = PICTURES['gap'](branch_of(stretch, stable=third == 0, viable=third < 2))
    drawn = {
        line.get_label(): line.get_linestyle()
        for line in picture.figure.axes[0].lines
        if not line.get_label().startswith('_')
    }
    assert [drawn[name] for name in ('stable', 'unstable', 'not viable')] == ['-', '--', ':']
    multipliers = (1.5 + 0j, *stretch.predicted.multipliers[1:])
    orbit = dataclasses.replace(stretch.predicted, multipliers=multipliers)
    for predicted, label, style in (
        (stretch.predicted, 'predicted', '-'),
        (orbit, 'predicted, but unstable', '--'),
    ):
        shown = dataclasses.replace(stretch, predicted=predicted)
        with page_style():
            (axes,) = draw_history(shown).figure.axes
        (line,) = (line for line in axes.lines if line.get_label() == label)
        assert line.get_linestyle() == style


def test_a_gap_curve_serves_all_stretches_of_its_rig(run):
    """Motions on one branch are followed once, another rig has a curve of its own."""
    bare = dataclasses.replace(run.stretches[0].curves, gap_curve=None)
    first = dataclasses.replace(run.stretches[0], curves=bare)
    wider = first.parameters.replace(gap=1.1 * first.parameters.gap)
    second = dataclasses.replace(first, number=2, predicted=find_orbits(wider, (1, 2)).orbits[0])
    softer = first.parameters.replace(stiffness=0.9 * first.parameters.stiffness)
    third = dataclasses.replace(first, number=3, predicted=find_orbits(softer, (1, 2)).orbits[0])
    several = dataclasses.replace(run, stretches=(first, second, third))
    one, other, softly = (s.curves.gap_curve for s in with_gap_curves(several).stretches)
    assert one['branches'] == other['branches'] != softly['branches']
    assert len(one['branches']) == len(softly['branches']) == 1


def test_numbers_over_the_whole_run(runs):
    page = report_page(without_pictures(runs[1]))
    rows = rows_of(parsed(page), 'Largest |X|, impacts and energy')
    assert [row[0] for row in rows[1:]] == ['1', '2', '3', '4', 'all']
    overall, units = runs[1].overall, rows[0]
    unit = unit_for('m', overall.x_max)
    assert units[2:4] == [f'largest |X| [{unit.name}]', f'rms of X [{unit.name}]']
    assert units[7] == 'work of the force [J]'
    last = rows[-1]
    assert last[1] == instant(overall.duration)
    assert last[2:4] == [number(unit.factor * x, 5) for x in (overall.x_max, overall.x_rms)]
    counts = [overall.impacts, overall.impacts_on_stop_1, overall.impacts_on_stop_2]
    assert last[4:7] == [str(count) for count in counts]
    energies = [
        overall.force_work,
        overall.impact_energy,
        overall.impact_loss,
        overall.dashpot_energy,
    ]
    assert last[7:] == [number(energy, 5) for energy in energies]
    # Of one stretch there is no sum.
    one = parsed(report_page(alone(runs[1], 1)))
    assert [row[0] for row in rows_of(one, 'Largest |X|, impacts and energy')[1:]] == ['1']
    assert 'Largest |X|, impacts and energy' not in text_of(
        parsed(report_page(alone(runs[0], 3, overall=None)))
    )


def test_the_axis_of_points_at_one_place(run):
    """The numbers at the axis have no more digits than there is room for."""
    stretch = run.stretches[2]
    impacts = stretch.curves.impacts[:1].copy()
    impacts['damper_velocity_after'] = -0.187654321
    phases = stretch.curves.phases[:1]
    curves = dataclasses.replace(stretch.curves, impacts=impacts, phases=phases)
    with page_style():
        picture = PICTURES['section'](dataclasses.replace(stretch, curves=curves))
        picture.figure.draw_without_rendering()
    labels = [label.get_text() for label in picture.figure.axes[0].get_yticklabels()]
    assert len(labels) > 2
    assert max(map(len, labels)) <= 6
    assert len(set(labels)) == len(labels)


def test_a_very_long_cause_is_shortened(run):
    names = [f'gap_control_{name}' for name in ('gain', 'lead', 'park', 'rate', 'seed')]
    changes = [f'{name} = 0.5 (was none)' for name in names]
    changes += ['gap_control = timed (was off)', 'force_amplitudes = [1, 2] N (was [1.2] N)']
    root = parsed(report_page(alone(run, 1, cause=', '.join(changes))))
    title = text_of(section(root, 1).find('h2'))
    assert title.startswith(
        'Stretch 1: gap_control = timed (was off), force_amplitudes = [1, 2] N (was [1.2] N), '
    )
    assert title.endswith(' and 3 more changes')
    # A few changes are all named, in their order.
    root = parsed(report_page(alone(run, 1, cause=', '.join(changes[4:]))))
    assert ', '.join(changes[4:]) in text_of(section(root, 1).find('h2'))


def test_numbers_of_stretches_do_not_cover_each_other(run):
    """Three stretches of 10 s, 0.1 s and 10 s."""
    stretches = []
    for number_, (start, end) in enumerate(((0.0, 10.0), (10.0, 10.1), (10.1, 20.0)), 1):
        part = np.array([[start], [-1.0], [1.0]])
        curves = dataclasses.replace(run.stretches[0].curves, envelope=part)
        values = {'number': number_, 'start': start, 'end': end, 'curves': curves}
        stretches.append(dataclasses.replace(run.stretches[0], **values))
    with page_style():
        picture = draw_run(stretches)
    assert [text.get_text() for text in picture.figure.axes[0].texts] == ['1', '2']


def schemes():
    """Return the colours of the page in each scheme, by name."""
    blocks = re.findall(r':root \{(.*?)\n\s*\}', STYLE, re.DOTALL)
    return [dict(re.findall(r'--([\w-]+): (#[0-9a-f]{6})', block)) for block in blocks]


def contrast(one, other):
    """Return the contrast ratio of WCAG 2."""

    def luminance(color):
        parts = [int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_colours_can_be_told_apart():
    light, dark, printed = schemes()
    assert printed == {**light, 'link': light['ink']}
    assert set(dark) == set(light)
    assert {name: light[name] for name in COLORS} == COLORS
    for scheme in (light, dark):
        for text, back in (
            ('ink', 'page'),
            ('ink', 'panel'),
            ('ink', 'bad-back'),
            ('ink', 'none-back'),
            ('quiet', 'page'),
            ('quiet', 'panel'),
            ('link', 'page'),
            ('link', 'panel'),
            ('good', 'good-back'),
            ('bad', 'bad-back'),
            ('open', 'open-back'),
        ):
            assert contrast(scheme[text], scheme[back]) >= 4.5, (text, back)
        for line in ('primary', 'damper', 'theory', 'special', 'lower', 'upper'):
            assert contrast(scheme[line], scheme['page']) >= 3.0, line


def test_files(run, tmp_path):
    place = tmp_path / 'new' / 'report'
    seen = []
    run = without_pictures(run)
    path = write_report(run, place, done=lambda: seen.append(1))
    assert path == place / 'report.html'
    assert len(seen) == 6
    assert sorted(p.name for p in place.iterdir()) == ['report.html', 'report.json']
    parsed(path.read_text(encoding='utf-8'))
    numbers = json.loads((place / 'report.json').read_text(encoding='utf-8'))
    assert numbers['stretches'][1]['verdict'] == 'differs'
    assert numbers['stretches'][0]['predicted']['x_max'] == run.stretches[0].predicted.x_max


def test_a_place_that_cannot_be_written(run, tmp_path):
    short = dataclasses.replace(run, stretches=())
    taken = tmp_path / 'taken'
    taken.write_text('a file')
    with pytest.raises(NotADirectoryError) as caught:
        write_report(short, taken)
    assert caught.value.filename == str(taken)


def test_a_full_disk(run, tmp_path):
    """A limit on the size of files stands for it: cut within a write, and without a name."""
    short = dataclasses.replace(run, stretches=())
    path = write_report(short, tmp_path)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(OSError) as caught:
            write_report(alone(run, 1, curves=run.stretches[0].curves), tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(path)
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ['report.html', 'report.json']
