"""
The two pictures of the page in README and docs, of a real rig in a real browser.

    python docs/screenshots.py docs/node/page_pictures

`page.webp` moves: a gap becomes too wide, slowed down. `bench.webp` is the whole page.
"""

import argparse
import io
import os
import sys
import tempfile
from pathlib import Path

# The browser and the processes are those of the tests.
sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))
import chromium

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))

from node.rig_client import SimProcess
from page.browser import Browser
from page.page_process import PageProcess
from PIL import Image
from running import SOURCE

BENCH = SOURCE / 'config' / 'bench_rig.yaml'
RUNNING = """['running', 'lagging'].includes(document.querySelector('#status').dataset.state)
    && impactDamper.history.impacts.length > 3 && document.querySelector('#knob-gap')"""
AGREES = """impactDamper.theory.curve?.done
    && document.querySelector('#verdict-text').textContent.startsWith('Agrees')"""
#: Of the moving picture: frames of rig time, their number, how long each is shown, and the speed
#: of the rig meanwhile, slow enough for a picture of every frame.
FRAME_S, FRAMES, SHOWN_MS, FACTOR = 0.025, 50, 100, 0.06
#: A width at which rig and traces have all of the page, and a height at which nothing is scrolled.
FILM = (690, 1500)


def settle(page, seconds, condition='true'):
    """Let the rig run for so long, on its own clock."""
    page.wait(RUNNING)
    start = page.run('impactDamper.history.end')
    page.wait(f'impactDamper.history.end > {start + seconds} && {condition}')


def filmed(page):
    """Return pictures of rig and traces at equal steps of the rig's time."""
    page.wait(RUNNING)
    page.click('#windows button[value="1"]')
    page.click('#theory')
    settle(page, 3.0)
    left, top, right, bottom = page.run("""(() => {
        const [first, last] = ['#rig', '#traces'].map(
            one => document.querySelector(one).getBoundingClientRect());
        return [first.left, first.top, last.right, last.bottom]; })()""")
    clip = {'x': left, 'y': top, 'width': right - left, 'height': bottom - top}
    start = page.run('impactDamper.history.end')
    for number in range(FRAMES):
        if number == FRAMES // 4:
            page.type('#knob-gap', '34')
            page.run('document.activeElement.blur()')
        page.wait(f'impactDamper.history.end >= {start + number * FRAME_S}')
        page.drawn()
        yield Image.open(io.BytesIO(page.tab.screenshot(clip=clip))).convert('RGB')


def write(pictures, path):
    """Write a picture, or a film; without loss it is hardly larger than with any that is seen."""
    first, *rest = pictures
    film = {'save_all': True, 'append_images': rest, 'duration': SHOWN_MS, 'loop': 0}
    first.save(path, lossless=True, quality=100, method=4, **(film if rest else {}))
    print(f'{path}: {path.stat().st_size} bytes')


def main():
    """Run the command."""
    parser = argparse.ArgumentParser(description='Take the pictures of the page.')
    parser.add_argument('directory', type=Path)
    directory = parser.parse_args().directory
    directory.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        browser = Browser(chromium.needed(), screen='')
        server = PageProcess(Path(work), '--node', '/sim_node')
        node = SimProcess(Path(work), parameters_file=BENCH, predict_motion=True)
        try:
            page = browser.open(f'{server.address}#preset=bench')
            settle(page, 12.0, AGREES)
            # Beside other programs the rig lags at times; that is not what a picture is to show.
            page.wait("document.querySelector('#status').dataset.state === 'running'")
            write([Image.open(io.BytesIO(page.tab.screenshot()))], directory / 'bench.webp')
            page.resize(*FILM)
            page.run(f"""impactDamper.actions.set({{ real_time_factor: {FACTOR} }})""")
            write(list(filmed(page)), directory / 'page.webp')
        finally:
            node.stop()
            server.close()
            browser.close()


if __name__ == '__main__':
    main()
