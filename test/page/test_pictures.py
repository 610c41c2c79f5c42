"""
How the page looks, against stored pictures, with a tolerance for other fonts and browsers.

Stored are a recording at an instant, where all is drawn that there is, and a live page without
what moves. Where they are meant to look otherwise, the new pictures are taken by

    ACCEPT_PICTURES=1 python -m pytest test/page/test_pictures.py
"""

import io
import os
from pathlib import Path

import chromium
import numpy as np
import pytest

pytest.importorskip('tornado', reason='the page needs Tornado')

from PIL import Image

from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from page.browser import Browser
from page.page_process import PageProcess

STORED = Path(__file__).with_name('pictures')
SIZES = {'desk': (1280, 800), 'phone': (360, 780)}
#: Pictures are compared in squares of so many pixels, in which letters of another font are grey.
SQUARE = 8
#: A square is another one if its mean differs by so much of 255, and a picture with so many.
DIFFERENCE, SHARE = 28, 0.02


@pytest.fixture(scope='module')
def page(tmp_path_factory):
    """Show an instant of a recording of the bench rig, whose gap and angle were changed."""
    directory = tmp_path_factory.mktemp('played')
    changes = ['--change', '6:gap=0.027', '--change', '7:angle=0.12']
    bag = str(directory / 'run')
    given = ['bench_rig', '--duration', '12', '--bag', bag, *changes, '--quiet']
    assert simulate_rig(given) == 0
    browser = Browser(chromium.needed())
    server = PageProcess(directory / 'page', '--bag', bag)
    try:
        page = browser.open()
        # Without smooth changes of scales and marks that fade
        page.shade(dark=False, calm=True)
        page.tab.goto(f'{server.address}#window=3')
        page.expect('#player').to_be_visible()
        # A jump pauses also where the recording has ended meanwhile. While the page is laid out,
        # a press with the mouse may miss; a jump that misses its end would go on playing.
        page.wait("""document.querySelector('#status').textContent === 'paused' ||
            document.querySelector('[aria-label="Back to the sample before"]').click()""")
        page.run("""(one => { one.value = 9.5; one.dispatchEvent(new Event('change')); })(
            document.querySelector('#scrub'))""")
        page.wait('Math.abs(impactDamper.history.end - 9.5) < 0.01')
        page.expect('#status').to_have_text('paused')
        page.expect('#knob-angle').to_have_value('6.8755')
        page.wait('impactDamper.theory.curve?.done')
        page.run('document.activeElement.blur()')
        yield page
        assert page.console == []
    finally:
        browser.close()
        server.close()


def squares(image):
    """Return the means of the squares of a picture."""
    wide, high = (length // SQUARE for length in image.size)
    return image.convert('RGB').resize((wide, high), Image.Resampling.BOX)


def compare(content, name, directory):
    """Compare a picture with the stored one of that name."""
    seen = squares(Image.open(io.BytesIO(content)))
    path = STORED / f'{name}.png'
    if os.environ.get('ACCEPT_PICTURES'):
        seen.save(path, optimize=True)
    stored = Image.open(path).convert('RGB')
    assert seen.size == stored.size, f'{name} is {seen.size}, in squares, not {stored.size}'
    apart = np.abs(np.asarray(seen, dtype=int) - np.asarray(stored, dtype=int)).max(axis=2)
    share = (apart > DIFFERENCE).mean()
    if share > SHARE:
        (directory / f'{name}.png').write_bytes(content)
    assert share <= SHARE, (
        f'{name}: {share:.1%} of the picture are another one; it is {directory / name}.png, see '
        'the beginning of this file'
    )


@pytest.mark.parametrize('dark', [False, True], ids=['light', 'dark'])
@pytest.mark.parametrize('size', SIZES)
def test_a_recording_looks_as_it_did(page, size, dark, tmp_path):
    page.resize(*SIZES[size])
    page.shade(dark, calm=True)
    page.drawn()
    # Scales of what was seen on the way are kept for a while.
    page.run('impactDamper.drawing.rescale(NaN); impactDamper.drawing.redraw()')
    name = f'recording_{size}_{"dark" if dark else "light"}'
    compare(page.still(full_page=size == 'phone'), name, tmp_path)
