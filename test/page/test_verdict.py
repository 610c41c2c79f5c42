"""What *Verdict* makes of a report of the node."""

from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import chromium
import pytest

import impact_damper_ros.page
from page.browser import Browser

STATIC = Path(impact_damper_ros.page.__file__).parent / 'static'
READ = """async ([message, agreement]) => {
  const { Verdict } = await import('./verdict.js');
  const verdict = Object.create(Verdict.prototype);
  verdict.goesOn = () => {};
  verdict.diagnostics({ level: 'ok', message, agreement }, {});
  return document.getElementById('verdict-text').textContent;
}"""


@pytest.fixture(scope='module')
def page():
    """Return a page with the modules and the elements of the page, and no server of a rig."""
    folder = partial(SimpleHTTPRequestHandler, directory=STATIC)
    browser = Browser(chromium.needed())
    with ThreadingHTTPServer(('127.0.0.1', 0), folder) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield browser.open(f'http://127.0.0.1:{server.server_port}/index.html')
        browser.close()
        server.shutdown()


@pytest.mark.parametrize(
    ('message', 'agreement', 'words'),
    [
        ('m has not hit a stop for 14867 cycles of the force', None, 'No impacts'),
        ('2 impacts in 1 cycle (stops 1,2), transient', None, 'Settling'),
        ('2 impacts in 1 cycle (stops 1,2), settled', 'agrees', 'Agrees with theory'),
        ('not periodically driven', None, 'No verdict'),
    ],
)
def test_the_words_of_a_verdict(page, message, agreement, words):
    assert page.tab.evaluate(READ, [message, agreement]) == words
