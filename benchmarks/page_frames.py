"""
Frame times of the page, with traces of 30 s, and how old its pictures are.

Headless Chromium measures them. A picture is taken to be on the screen when the next one begins;
its age is from the stamp of the newest joint state in it to that instant.

    python benchmarks/page_frames.py [--seconds S] [--window S]

Chromium draws without a graphics processor here, so that any real one is faster.
"""

import argparse
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
from running import SOURCE

BENCH = SOURCE / 'config' / 'bench_rig.yaml'
#: The page offers these.
WINDOWS = (3, 10, 30)
SIZES = ((360, 780), (1280, 800), (2560, 1440))
#: The traces have come to their length.
FULL = """(({{own: {{samples}}, end}}) =>
    end - samples.arrays[0][samples.start] > {length})(impactDamper.history)"""
#: Between frames of the screen, in drawing one that has something new, and from a joint state to
#: the screen.
PROBE = """new Promise(resolve => {{
    const {{ drawing, received }} = impactDamper;
    drawing.times.length = 0;
    const times = [], ages = [], {{ frames }} = received, begun = performance.now();
    let {{ drawn }} = drawing, epoch = null;
    requestAnimationFrame(function next(now) {{
        times.push(now);
        // The page has just drawn this one; it was asked for the frame before this probe was.
        if (epoch !== null) ages.push(performance.timeOrigin + now - 1000 * epoch);
        epoch = drawing.drawn === drawn ? null : received.epoch;
        drawn = drawing.drawn;
        if (now - begun < 1000 * {seconds}) return requestAnimationFrame(next);
        const spans = times.slice(1).map((time, n) => time - times[n]);
        resolve([spans, drawing.times, ages, (received.frames - frames) / {seconds}]);
    }});
}})"""


def quantile(values, part):
    """Return a quantile of the values."""
    return sorted(values)[min(len(values) - 1, int(part * len(values)))]


def main():
    parser = argparse.ArgumentParser(description='Measure the frame times of the page.')
    parser.add_argument('--seconds', type=float, default=10.0, help='of each measurement [10]')
    parser.add_argument(
        '--window', type=int, default=30, choices=WINDOWS, help='length of the traces, s [30]'
    )
    arguments = parser.parse_args()
    path = chromium.found()
    if path is None:
        parser.error(chromium.MISSING)
    with tempfile.TemporaryDirectory() as work:
        browser = Browser(path, screen='')  # as fast as it can be
        server = PageProcess(Path(work), '--node', '/sim_node')
        node = SimProcess(Path(work), parameters_file=BENCH)
        try:
            page = browser.open(server.address + f'#window={arguments.window}')
            page.wait(FULL.format(length=0.98 * arguments.window))
            print(
                '| window | between frames: median, p99 | drawing: median, p99 '
                '| joint state to screen: median, p99 | frames received |'
            )
            print('| --- | --- | --- | --- | --- |')
            for width, height in SIZES:
                page.resize(width, height)
                page.run('new Promise(resolve => setTimeout(resolve, 1500))')
                *measured, rate = page.run(PROBE.format(seconds=arguments.seconds))
                cells = [
                    f'{quantile(values, 0.5):.1f}, {quantile(values, 0.99):.1f} ms'
                    for values in measured
                ]
                print(f'| {width} × {height} | {" | ".join(cells)} | {rate:.0f} /s |')
        finally:
            node.stop()
            browser.close()
            server.close()


if __name__ == '__main__':
    main()
