"""
Pictures of the page for README and docs, of a real rig in a real browser.

    python docs/page_pictures.py docs/reference/page_pictures

With `--all DIR` six views at four sizes, light and dark.
"""

import argparse
import io
import os
import sys
import tempfile
import time
from pathlib import Path

# The browser and the processes are those of the tests.
sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))
import chromium
from PIL import Image

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))

from node.rig_client import SimProcess
from page.browser import Browser
from page.page_process import PageProcess
from running import SOURCE

BENCH = SOURCE / 'config' / 'bench_rig.yaml'
SIZES = {'phone': (360, 780), 'tablet': (768, 1024), 'desk': (1280, 800), 'wall': (2560, 1440)}
RUNNING = """['running', 'lagging'].includes(document.querySelector('#status').dataset.state)
    && impactDamper.history.impacts.length > 3 && document.querySelector('#knob-gap')"""
#: All of the curve
CURVE = 'impactDamper.theory.curve?.done'
AGREES = f"{CURVE} && document.querySelector('#verdict-text').textContent.startsWith('Agrees')"
#: Name of a view, address, seconds of the rig until it shows what it should, what to wait for.
VIEWS = (
    ('bench', '#preset=bench', 12.0, AGREES),
    ('incline', '#preset=bench&angle=0.14&friction=0.05&gap=0.02', 12.0, AGREES),
    ('chaos', '#preset=chaos', 25.0, 'true'),
    ('control', '#preset=control_changing_load', 14.0, 'true'),
)
#: Shades of the pictures in the docs.
SHADES = {
    'bench': ['light', 'dark'],
    'incline': ['light'],
    'chaos': ['dark'],
    'control': ['light'],
}
#: Of the animated picture: frames of rig time, their number, how long each is shown, and how much
#: slower the rig runs meanwhile.
FRAME_S, FRAMES, SHOWN_MS, FACTOR = 0.025, 50, 100, 0.06
#: The page at a width at which rig and traces have all of it, so that no text is scaled, and a
#: height at which nothing is scrolled.
FILM = (690, 1500)


def written(content, path):
    """Write a picture, as small as it can be without loss."""
    Image.open(io.BytesIO(content)).convert('RGB').save(path, optimize=True)
    print(f'{path}: {path.stat().st_size} bytes')


def settle(page, seconds, condition):
    """Let the rig run for so long, on its own clock."""
    page.wait(RUNNING)
    start = page.run('impactDamper.history.end')
    page.wait(f'impactDamper.history.end > {start + seconds}')
    page.wait(condition)


def shoot(page, name, directory, sizes, shades=('light', 'dark')):
    """Take a view at all sizes in light and dark."""
    for size in sizes:
        width, height = SIZES[size]
        page.resize(width, height)
        for shade in shades:
            page.shade(dark=shade == 'dark')
            time.sleep(1.5)
            whole = page.run('document.documentElement.scrollHeight')
            if size in ('phone', 'tablet'):
                page.resize(width, whole)
                time.sleep(0.5)
            # Beside other programs the rig lags at times; that is not what a picture is to show.
            on_time = "document.querySelector('#status').dataset.state !== 'lagging'"
            taken = False
            while not taken:
                page.wait(on_time)
                content = page.tab.screenshot()
                taken = page.run(on_time)
            written(content, directory / f'{name}_{size}_{shade}.png')
            page.resize(width, height)


def scrub(page, part):
    """Go to a part of the recording."""
    asked = page.run(f"""(() => {{ const scrub = document.querySelector('#scrub');
        scrub.value = String({1.0 - part} * Number(scrub.min) + {part} * Number(scrub.max));
        scrub.dispatchEvent(new Event('change')); return Number(scrub.value); }})()""")
    page.wait(f'Math.abs(impactDamper.history.end - {asked}) < 0.5')


def recording(page):
    """Record a change of the gap, and play it with another rig beside it."""
    page.wait(RUNNING)
    page.click('#record')
    settle(page, 4.0, 'true')
    page.type('#knob-gap', '30')
    settle(page, 5.0, 'true')
    page.click('#record')
    page.wait("document.querySelector('#record').ariaPressed === 'false'")
    page.click('#recordings-open')
    page.wait("/[kM]B$/.test(document.querySelector('.recording p')?.textContent)")
    page.click('.recording .primary')
    page.wait("document.body.classList.contains('playing') && impactDamper.history.state")
    page.click('#play')
    page.wait("document.querySelector('#status').dataset.state === 'paused'")
    page.run('document.querySelector(\'#windows button[value="3"]\').click()')
    scrub(page, 0.25)
    page.type('#knob-gap', '18')
    page.wait('impactDamper.history.ghost !== null')
    # The change is in view, and what the other rig does meanwhile is known.
    scrub(page, 0.65)
    page.wait('impactDamper.history.ghost !== null')
    page.wait(CURVE)
    page.run('document.activeElement.blur()')
    time.sleep(3.0)


def moving(browser, work, path):
    """Write the animated picture: a gap that becomes too wide, at a quarter of the speed."""
    server = PageProcess(work, '--node', '/sim_node')
    # Slow enough for a picture of every frame.
    node = SimProcess(work, parameters_file=BENCH, real_time_factor=FACTOR, predict_motion=True)
    try:
        pictures = filmed(browser.open(server.address, width=FILM[0], height=FILM[1]))
    finally:
        node.stop()
        server.close()
    # Without loss it is hardly larger than with any that is not seen in lines and letters.
    pictures[0].save(
        path,
        save_all=True,
        append_images=pictures[1:],
        duration=SHOWN_MS,
        loop=0,
        lossless=True,
        quality=100,
        method=6,
    )
    print(f'{path}: {path.stat().st_size} bytes, {len(pictures)} frames')


def filmed(page):
    """Return pictures of the page at equal steps of the rig's time."""
    page.wait(RUNNING)
    page.run('document.querySelector(\'#windows button[value="1"]\').click()')
    page.click('#theory')
    settle(page, 3.0, 'true')
    left, top, right, bottom = page.run("""(() => {
        const first = document.querySelector('#rig').getBoundingClientRect();
        const last = document.querySelector('#traces').getBoundingClientRect();
        return [first.left, first.top, last.right, last.bottom]; })()""")
    size = {'width': right - left, 'height': bottom - top}
    clip = {'x': left, 'y': top, **size}
    start = page.run('impactDamper.history.end')
    pictures = []
    for number in range(FRAMES):
        if number == FRAMES // 4:
            page.type('#knob-gap', '34')
            page.run('document.activeElement.blur()')
        page.wait(f'impactDamper.history.end >= {start + number * FRAME_S}')
        page.run('new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))')
        content = page.tab.screenshot(clip=clip)
        pictures.append(Image.open(io.BytesIO(content)).convert('RGB'))
    page.close()
    return pictures


def still(browser, work, arguments):
    """Write the pictures of all views."""
    server = PageProcess(work, '--node', '/sim_node')
    bags = str(server.recordings)
    node = SimProcess(work, parameters_file=BENCH, bag_directory=bags, predict_motion=True)
    try:
        for name, address, seconds, condition in VIEWS:
            page = browser.open(server.address + address)
            settle(page, seconds, condition)
            if arguments.all is not None:
                shoot(page, name, arguments.all, SIZES)
            else:
                shoot(page, name, arguments.directory, ['desk'], SHADES[name])
            page.close()
        page = browser.open(server.address + '#preset=bench')
        recording(page)
        if arguments.all is not None:
            shoot(page, 'player', arguments.all, SIZES)
        else:
            shoot(page, 'player', arguments.directory, ['desk'], ['light'])
        page.click('#recordings-open')
        page.expect('#recordings').to_be_visible()
        if arguments.all is not None:
            shoot(page, 'recordings', arguments.all, SIZES)
        else:
            shoot(page, 'recordings', arguments.directory, ['desk'], ['light'])
        page.close()
    finally:
        node.stop()
        server.close()


def main():
    """Run the command."""
    parser = argparse.ArgumentParser(description='Take pictures of the page.')
    parser.add_argument('directory', type=Path, help='where those of the docs go')
    parser.add_argument('--all', type=Path, metavar='DIR', help='take all views, into this one')
    arguments = parser.parse_args()
    path = chromium.found()
    if path is None:
        parser.error(chromium.MISSING)
    arguments.directory.mkdir(parents=True, exist_ok=True)
    if arguments.all is not None:
        arguments.all.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        browser = Browser(path)
        try:
            if arguments.all is None:
                moving(browser, work / 'moving', arguments.directory / 'page.webp')
            still(browser, work / 'still', arguments)
        finally:
            browser.close()


if __name__ == '__main__':
    main()
