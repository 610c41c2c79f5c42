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
from analysis.example_comparison import example

from impact_damper_ros.analysis.report_units import difference, instant, number, unit_for
from impact_damper_ros.analysis.run_comparison import Verdict

pytest.importorskip('matplotlib', reason='the report has plots')

from impact_damper_ros.analysis.comparison_report import (
    MOST_DETAILED,
    MOST_LISTED,
    report_page,
    told_stretches,
    write_report,
)
from impact_damper_ros.analysis.report_history import draw_run, predicted_impacts, predicted_motion
from impact_damper_ros.analysis.report_motion import filled_motion
from impact_damper_ros.analysis.report_response import predicted_lines
from impact_damper_ros.analysis.report_stretch import PICTURES
from impact_damper_ros.analysis.report_svg import COLORS, drawing_style, inline_svg

STYLE = (files('impact_damper_ros.analysis') / 'report_template' / 'report.css').read_text('utf-8')


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


def alone(run, n, **values):
    """Return a run of one stretch, with some of its values changed."""
    return dataclasses.replace(
        run, stretches=(dataclasses.replace(run.stretches[n - 1], **values),)
    )


def changed(run, n, **values):
    """Return a run in which a stretch is another one."""
    stretches = list(run.stretches)
    stretches[n - 1] = dataclasses.replace(stretches[n - 1], **values)
    return dataclasses.replace(run, stretches=tuple(stretches))


def test_all_plots_are_there(page):
    root = parsed(page)
    for n, missing in ((1, set()), (2, set()), (3, {'convergence', 'spectrum', 'gap'})):
        part = section(root, n)
        shown = [svg.get('aria-label') for svg in part.iter('svg')]
        assert len(shown) == len(PICTURES) - len(missing)
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
    assert named['largest |X|'] == ['largest |X|', '5.072124', '5.072124', '0', 'm']
    assert named['Xmax / A'][1:3] == ['0.2113439', '0.2113439']
    assert named['decay per period'][1:3] == ['0.9411000', '0.9410652']
    first = rows.index(['Impact 1, on stop 1'])
    phase, x = rows[first + 1], rows[first + 2]
    assert phase == ['phase', '0.7579950', '0.7579950', '0', 'cycles']
    assert x[:3] == ['X', '4.132140', '4.132140']
    # A wrong impact is told with its sign, in the same unit.
    last = run.stretches[0].measured.last_period
    wrong = dataclasses.replace(last, x=(last.x[0] - 0.002, last.x[1]))
    measured = dataclasses.replace(run.stretches[0].measured, last_period=wrong)
    other = rows_of(section(parsed(report_page(alone(run, 1, measured=measured))), 1), 'Measured')
    assert other[first + 2] == ['X', '4.130140', '4.132140', '−0.002', 'm']


def test_phases_are_compared_around_the_clock(run):
    last = run.stretches[0].measured.last_period
    orbit = dataclasses.replace(run.stretches[0].predicted, phases=(0.999, 0.2698))
    turned = dataclasses.replace(last, phases=(0.001, 0.2698))
    measured = dataclasses.replace(run.stretches[0].measured, last_period=turned)
    page = report_page(alone(run, 1, measured=measured, predicted=orbit))
    rows = rows_of(section(parsed(page), 1), 'Measured')
    phases = [row for row in rows if row[0] == 'phase']
    assert phases[0][1:4] == ['0.0010000', '0.9990000', '+0.002']


def test_energy_adds_up_on_the_page(run, page):
    rows = {row[0]: row for row in rows_of(section(parsed(page), 1), 'Energy balance')[1:]}
    energy = run.stretches[0].energy
    force = energy.force / energy.periods
    assert float(rows['work of the force'][1]) == pytest.approx(force, rel=1e-4)
    taken = ('dashpot', 'friction', 'impacts', 'change of what is stored', 'unexplained')
    shares = [float(rows[name][2].replace('−', '-').split()[0]) for name in taken]
    assert sum(shares) == pytest.approx(100.0, abs=0.2)


def test_changes_and_findings_are_shown(run):
    stiffer = run.stretches[1].parameters.replace(stiffness=1.25)
    first = dataclasses.replace(run, stretches=run.stretches[:2])
    root = parsed(report_page(changed(first, 2, parameters=stiffer)))
    second = section(root, 2)
    marked = [row for row in second.iter('tr') if row.get('class') == 'changed']
    assert [[text_of(cell) for cell in row] for row in marked] == [
        ['stiffness', '1.25', 'N/m', '1']
    ]
    assert 'the impacts are 37.5 m apart in Y, not 37 m' in text_of(second)
    assert 'damping = 0.02 N s/m (was 0.01 N s/m)' in text_of(second.find('h2'))
    (badge,) = (e for e in second.iter('span') if e.get('class') == 'badge bad')
    assert text_of(badge) == '✗ differs'
    assert not [row for row in section(root, 1).iter('tr') if row.get('class') == 'changed']


def test_the_page_is_the_same_each_time(run, page):
    first = alone(run, 1)
    assert report_page(first) == report_page(first)
    assert 'compare_run runs/run_20260101_120000 --report report' in page


def test_the_readers_own_style_does_not_reach_the_page(run):
    import matplotlib as mpl

    short = dataclasses.replace(run, stretches=run.stretches[2:])
    plain = report_page(short)
    with mpl.rc_context({'lines.linewidth': 9, 'font.size': 20, 'axes.grid': False}):
        before = dict(mpl.rcParams)
        assert report_page(short) == plain
        assert dict(mpl.rcParams) == before


HOSTILE = '<script>alert(1)</script>"\'&amp;]]>\x00\x1b[31m\u202e\ud800 $title ${style}'


def test_hostile_text_is_only_text(run):
    named = dataclasses.replace(
        changed(run, 1, cause=HOSTILE, sentence=HOSTILE, evidence=HOSTILE, solver=HOSTILE),
        bag=f'runs/{HOSTILE}',
        node=HOSTILE,
        faults=(HOSTILE,),
        remarks=(HOSTILE,),
    )
    finding = dataclasses.replace(run.stretches[1].findings[0], text=HOSTILE)
    named = changed(named, 2, findings=(finding,), control={HOSTILE: HOSTILE})
    page = report_page(named, command=HOSTILE)
    root = parsed(page)
    assert '<script' not in page
    assert text_of(root).count('<script>alert(1)</script>') >= 10
    assert '$title' in text_of(root)
    assert not any(c in page for c in '\x00\x1b\u202e\ud800')


def emptied(curves):
    """Yield the curves with each of their arrays empty, and with nothing but NaN in it."""
    for name in (f.name for f in dataclasses.fields(curves)):
        part = getattr(curves, name)
        if part is None:
            continue
        arrays = [f.name for f in dataclasses.fields(part)]
        arrays = [a for a in arrays if isinstance(getattr(part, a), np.ndarray)]
        empty = dataclasses.replace(part, **{a: getattr(part, a)[:0] for a in arrays})
        yield f'{name} empty', dataclasses.replace(curves, **{name: empty})
        one = dataclasses.replace(part, **{a: getattr(part, a)[:1] for a in arrays})
        yield f'{name} of one', dataclasses.replace(curves, **{name: one})
        for array in arrays:
            values = getattr(part, array)
            if values.dtype.kind == 'f':
                lost = dataclasses.replace(part, **{array: np.full_like(values, np.nan)})
                yield f'{name}.{array} nan', dataclasses.replace(curves, **{name: lost})
                zero = dataclasses.replace(part, **{array: np.zeros_like(values)})
                yield f'{name}.{array} zero', dataclasses.replace(curves, **{name: zero})


#: In which plots the parts of the curves are.
SHOWN_IN = {
    'motion': ('history', 'portrait', 'relative'),
    'impacts': ('history', 'section'),
    'predicted': ('history', 'portrait', 'spectrum'),
    'convergence': ('convergence',),
    'spectrum': ('spectrum',),
    'gap_curve': ('gap',),
}


def test_no_array_makes_a_plot_fail(run):
    stretch = run.stretches[0]
    names = []
    with drawing_style():
        for name, curves in emptied(stretch.curves):
            broken = dataclasses.replace(stretch, curves=curves)
            part = name.split()[0].split('.')[0]
            pictures = [PICTURES[key](broken) for key in SHOWN_IN.get(part, ())]
            if part == 'envelope':
                pictures.append(draw_run([broken, run.stretches[1]]))
            for picture in pictures:
                # What is set up can be drawn; of each part, once it is drawn too.
                if picture is not None and name.endswith('of one'):
                    picture.figure.draw_without_rendering()
            names.append(name)
    assert len(names) > 60


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
        'curves': type(run.stretches[0].curves)(),
        'verdict': Verdict.TOO_SHORT,
    }
    part = section(parsed(report_page(alone(run, 1, **nothing))), 1)
    assert 'too little was recorded to draw' in text_of(part)
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
    assert f'{600 - MOST_LISTED} are left out here' in text
    assert len(page) < 1_000_000


def test_the_most_telling_stretches(run):
    stretches = run.stretches
    assert told_stretches(stretches, 1) == (stretches[1],)
    assert told_stretches(stretches, 9) == stretches


def test_a_coarse_recording_is_drawn_smooth(run):
    """A free flight is a parabola, also between its samples; a gap in the log stays one."""
    stretch = run.stretches[0]
    time = np.array([0.0, 0.5, 1.0, 1.0, 1.5, 9.0])
    y = np.array([0.0, 1.5, 2.0, 2.0, 0.5, 5.0])
    rate = np.array([4.0, 2.0, 0.0, -2.0, -4.0, 1.0])
    other = np.zeros(6)
    motion = type(stretch.curves.motion)(time, other, other, y, rate, other + 2.0, other - 2.0)
    coarse = dataclasses.replace(stretch.curves, motion=motion)
    filled = filled_motion(dataclasses.replace(stretch, curves=coarse))
    first = filled.time <= 1.0
    assert len(filled.time) > 10
    flight = filled.time[first][:6]
    assert filled.y[:6] == pytest.approx(4.0 * flight - 2.0 * flight**2)
    assert filled.relative_velocity[:6] == pytest.approx(4.0 - 4.0 * flight)
    assert not np.any((filled.time > 1.5) & (filled.time < 9.0))
    assert np.all(np.diff(filled.time) >= 0.0)
    # What is sampled finely enough is left as it is.
    assert filled_motion(stretch) is stretch.curves.motion


def test_points_and_periods_that_show_nothing_more(run):
    stretch = run.stretches[0]
    impacts, convergence = stretch.curves.impacts, stretch.curves.convergence
    arrays = {f.name: getattr(impacts, f.name) for f in dataclasses.fields(impacts)}
    again = type(impacts)(**{name: np.tile(values[-2:], 10000) for name, values in arrays.items()})
    floor = np.full(4000, 0.5 * convergence.floor)
    settled = dataclasses.replace(
        convergence,
        time=6.16 * np.arange(4090),
        distance=np.concatenate([convergence.distance, floor]),
    )
    curves = dataclasses.replace(stretch.curves, impacts=again, convergence=settled)
    long = dataclasses.replace(stretch, curves=curves)
    with drawing_style():
        section = PICTURES['section'](long)
        approach = PICTURES['convergence'](long)
    svg = ElementTree.fromstring(inline_svg(section.figure, 'k', 'section'))
    assert not list(svg.iter('image'))
    marks = [g for g in svg.iter('g') if any('primary' in e.get('style', '') for e in g.iter())]
    assert marks
    assert '20000 latest impacts' in section.caption
    # The approach takes 90 periods; the rest lies on the floor.
    assert 500.0 < approach.figure.axes[0].get_xlim()[1] < 1000.0


def test_predicted_motion_is_laid_over_any_time(run):
    stretch = run.stretches[0]
    curve, orbit = stretch.curves.predicted, stretch.predicted
    start, end = 590.0, 590.0 + 3.0 * orbit.period
    hit, place = predicted_impacts(stretch, start, end)
    assert len(hit) == 6
    for at in stretch.curves.impacts.time:
        if start <= at <= end:
            assert np.abs(hit - at).min() < 0.01
    assert np.abs(place).max() < 37.0 / 2.0 + orbit.x_max
    time, x, y = predicted_motion(curve, start, end)
    assert start <= time[0] < start + 0.1
    assert end - 0.1 < time[-1] <= end
    assert np.abs(x).max() == pytest.approx(orbit.x_max, rel=1e-3)
    assert np.abs(y).max() == pytest.approx(37.0 / 2.0, rel=1e-9)
    measured = stretch.curves.motion
    assert np.interp(592.0, time, x) == pytest.approx(
        np.interp(592.0, measured.time, measured.x), abs=0.05
    )


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


def test_numbers_for_readers():
    assert number(0.00012345678) == '0.000123457'
    assert number(-1.5e-7, 3) == '−1.5\xa0×\xa010⁻⁷'
    assert number(math.nan) == number(None) == '–'
    assert number(math.inf) == '∞'
    assert difference(1.234e-9) == '+1.2\xa0×\xa010⁻⁹'
    assert difference(0.0) == '0'
    assert instant(12.0) == '12'
    assert instant(0.12345) == '0.123'
    assert unit_for('m', [0.003, math.nan]) == (1e3, 'mm')
    assert unit_for('N s', 2e-5) == (1e6, 'µN s')
    assert unit_for('m', []) == (1.0, 'm')


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
            ('ink', 'mark'),
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
        for line in ('primary', 'damper', 'theory', 'special'):
            assert contrast(scheme[line], scheme['page']) >= 3.0, line


def test_files(run, tmp_path):
    place = tmp_path / 'new' / 'report'
    seen = []
    path = write_report(run, place, drawn=lambda done, total: seen.append((done, total)))
    assert path == place / 'report.html'
    assert seen == [(1, 3), (2, 3), (3, 3)]
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
    # What is there already stays whole when the new one cannot be written.
    place = tmp_path / 'report'
    write_report(short, place)
    before = (place / 'report.html').read_bytes()
    (place / '.report.html.part').mkdir()
    with pytest.raises(OSError) as caught:
        write_report(short, place, command='another')
    assert caught.value.filename.endswith('report.html')
    assert (place / 'report.html').read_bytes() == before
    assert len(list(place.iterdir())) == 3


def test_a_full_disk(run, tmp_path):
    """A limit on the size of files stands for it: cut within a write, and without a name."""
    short = dataclasses.replace(run, stretches=())
    path = write_report(short, tmp_path)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(OSError) as caught:
            write_report(alone(run, 1), tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(path)
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ['report.html', 'report.json']
