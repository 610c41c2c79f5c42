"""The report as a reader sees it: opened from its file in Chromium, without a window."""

import json
import re
import struct
import subprocess

import chromium
import pytest
from report.example_comparison import example
from running import DEADLINE_S

pytest.importorskip('matplotlib', reason='the report has plots')

from impact_damper_ros.report.html_report import write_report

POLICY = "content=\"default-src 'none';"

# Run within a copy of the page, whose policy lets it; the page itself has no script. The copy is
# in a frame, since a window cannot be as narrow as a phone.
FRAME = """<!DOCTYPE html><html><body><iframe width="{width}" height="900" style="border:0"
src="{page}"></iframe><script>onmessage = event => {{ document.body.textContent = event.data; }}
</script></body></html>"""
PROBE = """
<script>
addEventListener('load', () => setTimeout(() => {
const wide = document.documentElement.scrollWidth;
const shown = e => e.getClientRects().length > 0;
const plots = [...document.querySelectorAll('figure svg')].filter(shown).map(svg => {
  const box = svg.getBoundingClientRect();
  const drawn = [...svg.querySelectorAll('path, use, image')].filter(part => {
    const place = part.getBoundingClientRect();
    return place.width > 0 || place.height > 0;
  });
  const text = [...svg.querySelectorAll('text')].map(t => t.getBoundingClientRect());
  const out = text.filter(t => t.left < box.left - 1 || t.right > box.right + 1).length;
  return [svg.getAttribute('aria-label'), box.width, box.height, drawn.length, text.length, out];
});
const clipped = [...document.querySelectorAll('p, dd, dt, h1, h2, figcaption')].filter(
  e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline').length;
// What goes on beyond an edge says so above it.
const boxes = [...document.querySelectorAll('*')].filter(e => shown(e) && !e.closest('svg'))
  .filter(e => e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0)
  .filter(e => !['visible', 'hidden'].includes(getComputedStyle(e).overflowX));
const unsaid = boxes.filter(e => !(e.previousElementSibling || {matches: () => false})
  .matches('.hint') || !shown(e.previousElementSibling))
  .map(e => `${e.textContent.slice(0, 24)}: ${e.scrollWidth} of ${e.clientWidth}`);
const hints = [...document.querySelectorAll('.hint')].filter(shown).length;
const cut = [...document.querySelectorAll('figure.narrow svg, nav a')].filter(shown).filter(e => {
  const box = e.getBoundingClientRect();
  return box.left < -1 || box.right > innerWidth + 1;
}).length;
const requests = performance.getEntriesByType('resource').map(entry => entry.name);
parent.postMessage('PROBE' + JSON.stringify(
  {wide, inner: innerWidth, plots, clipped, requests, unsaid, hints, cut}) + 'END', '*');
}, 200));
</script>
"""


@pytest.fixture(scope='module')
def browser():
    return chromium.needed()


@pytest.fixture(scope='module')
def report(tmp_path_factory):
    return write_report(example(), tmp_path_factory.mktemp('report'))


def opened(browser, page, profile, *options):
    """Open a page in a browser that has never been used; return what it wrote."""
    done = subprocess.run(
        chromium.command(browser, profile, '--enable-logging=stderr', *options, page.as_uri()),
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done


def probed(browser, page, directory, width):
    """Return what a browser shows of a page in so many pixels of width."""
    text = page.read_text(encoding='utf-8')
    assert POLICY in text
    text = text.replace(POLICY, f"{POLICY} script-src 'unsafe-inline';")
    copy = directory / 'probe.html'
    copy.write_text(text.replace('</body>', f'{PROBE}</body>'), encoding='utf-8')
    frame = directory / 'frame.html'
    frame.write_text(FRAME.format(width=width, page=copy.name), encoding='utf-8')
    options = ('--window-size=1400,1000', '--virtual-time-budget=5000', '--dump-dom')
    done = opened(browser, frame, directory / 'profile', *options)
    return json.loads(re.search('PROBE(.*)END', done.stdout)[1])


@pytest.mark.parametrize('width', [1280, 360])
def test_every_plot_is_seen(browser, report, tmp_path, width):
    seen = probed(browser, report, tmp_path, width)
    assert seen['requests'] == []
    assert seen['inner'] == width
    assert seen['wide'] <= width
    assert seen['clipped'] == seen['cut'] == 0
    # No part of the page is beyond an edge without a word.
    assert seen['unsaid'] == []
    # Two tables and the picture of the run, impacts and time history of each stretch
    assert seen['hints'] == (3 + 2 * 3 if width < 700 else 0)
    names = [plot[0] for plot in seen['plots']]
    assert len(names) == 1 + 7 + 7 + 4
    assert 'Poincaré section, stretch 1' in names
    for name, across, high, drawn, texts, outside in seen['plots']:
        assert across > 300, name
        assert high > 150, name
        assert drawn > 20, name
        assert texts > 8, name
        assert outside == 0, name


def test_the_page_itself(browser, report, tmp_path):
    """Nothing is said on the console, and there is something to be seen."""
    picture = tmp_path / 'page.png'
    options = ('--window-size=1280,1600', f'--screenshot={picture}')
    done = opened(browser, report, tmp_path / 'profile', *options)
    assert 'CONSOLE' not in done.stderr
    content = picture.read_bytes()
    assert struct.unpack('>II', content[16:24]) == (1280, 1600)
    assert len(content) > 50_000


def test_the_console_is_listened_to(browser, report, tmp_path):
    """The same, of a page that does what its policy forbids."""
    page = tmp_path / 'bad.html'
    bad = '<script>alert(1)</script><img src="http://127.0.0.1:9/x.png"/></body>'
    text = report.read_text(encoding='utf-8')
    page.write_text(text.replace('</body>', bad), encoding='utf-8')
    done = opened(browser, page, tmp_path / 'profile', '--dump-dom')
    assert done.stderr.count('CONSOLE') >= 2
