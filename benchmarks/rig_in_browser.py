"""
The rig that a browser computes: its agreement with CPython, its size, and how soon it answers.

    python benchmarks/rig_in_browser.py [--rigs N] [--json FILE]

Random rigs with a change on the way, and all presets, run in Chromium and in CPython and are
compared event for event: kind, stop, mode, and the instant to a millionth of the run. Where they
disagree, last digits decide if CPython itself has other events from a start that is 1e-14 gaps
away; all others are wrong. Knobs are turned, and it is measured how long the curve over the gap
takes. The exit status is 1 if rigs are wrong, if the page has more than 0.35 MB, takes more than
1 s to move, or 95 % of the curves more than 50 ms. It needs Playwright and Chromium.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / 'docs'), str(ROOT / 'test')]

import chromium  # noqa: E402
from in_browser.build import build  # noqa: E402
from page.browser import Browser  # noqa: E402
from page.compared_rigs import COMPARE, disagreements, preset_cases, random_cases  # noqa: E402
from page.javascript import JavaScript  # noqa: E402

#: Largest size of what a browser loads, B, longest time until the rig moves, s, and longest one
#: from a value to the curve over the gap, ms.
LARGEST, LONGEST, CURVE = 350_000, 1.0, 50.0
MOVES = 'impactDamper.history.own.samples.length > 20'
#: When that is so, s after the address was called, by the clock of the page.
FIRST = f"""new Promise((done) => {{
  const look = () => ({MOVES} ? done(performance.now() / 1000) : setTimeout(look, 1));
  look();
}})"""
#: Rig seconds per second of each preset, for two seconds of the machine.
SPEED = """() => {
  const { Rig, presets } = impactDamperRig;
  return Object.fromEntries(Object.entries(presets).map(([name, { rig, initial, control }]) => {
    const one = new Rig(rig, initial, 0, control);
    const begun = performance.now();
    let k = 0;
    for (; performance.now() < begun + 500; k += 1) {
      one.advance((k + 1) / 200);
      one.sample();
    }
    return [name, k / 200 / ((performance.now() - begun) / 1000)];
  }));
}"""

#: How long after a value the curve over the gap of that rig is there, ms, with some values.
CURVES = """async ([name, values]) => {
  const { store } = impactDamper;
  const times = [];
  for (const value of values) {
    const before = store.theory.curve;
    const begun = performance.now();
    impactDamper.actions.turn({ [name]: value });
    while (store.theory.curve === before || !store.theory.curve.branches.length) {
      await new Promise((resolve) => { setTimeout(resolve, 1); });
    }
    times.push(performance.now() - begun);
    await new Promise((resolve) => { setTimeout(resolve, 100); });
  }
  return times;
}"""
#: The same in Node without a page: milliseconds of the processor alone.
ANSWERS = """([name, values]) => {
  const { Rig, presets, theoryOf } = impactDamperRig;
  const { rig, initial } = presets.bench;
  let before = null;
  return values.map((value) => {
    const parameters = rig.replace({ [name]: value });
    const { _run: run, _waves: waves } = new Rig(parameters, initial);
    const angles = waves.map(({ angle }) => angle);
    const begun = process.cpuUsage();
    for (const answer of theoryOf({ parameters, control: 'off', run, angles, before })) {
      if (!answer?.gap_curve) continue;
      before = answer.expected;
      break;
    }
    return process.cpuUsage(begun).user / 1000;
  });
}"""
#: What is turned, from and to which value, of the preset of the first page, which has others.
TURNED = {
    'gap': (0.015, 0.05),
    'restitution_1': (0.61, 0.9),
    'damper_mass': (0.03, 0.1),
    'friction': (0.0, 0.2),
}


def curves(browser: Any, address: str, count: int = 60) -> dict[str, Any]:
    """Return how long the curve over the gap takes after a value."""
    page = browser.open(address)
    # Nobody turns a knob before the page has said what there is.
    page.wait('impactDamper.theory.orbit?.complete')
    taken = {}
    for name, (low, high) in TURNED.items():
        values = [low + (high - low) * k / (count - 1) for k in range(count)]
        taken[name] = sorted(page.tab.evaluate(CURVES, [name, values]))
    page.close()
    every = sorted(time_ for times in taken.values() for time_ in times)
    return {
        'median, ms': {name: median(times) for name, times in taken.items()},
        '95 %, ms': {name: times[int(0.95 * count)] for name, times in taken.items()},
        '95 % of all, ms': every[int(0.95 * len(every))],
    }


def answers(script: Path, count: int = 60) -> dict[str, Any]:
    """Return what the curve over the gap takes of the processor."""
    console = JavaScript(script)
    taken = {}
    for name, (low, high) in TURNED.items():
        values = [low + (high - low) * k / (count - 1) for k in range(count)]
        taken[name] = sorted(console.evaluate(ANSWERS, [name, values]))
    console.close()
    every = sorted(time_ for times in taken.values() for time_ in times)
    return {
        'median, ms': {name: median(times) for name, times in taken.items()},
        '95 % of all, ms': every[int(0.95 * len(every))],
    }


def compare(browser: Any, address: str, count: int) -> dict[str, Any]:
    """Compare random rigs and presets."""
    page = browser.open(address)
    cases = {**dict(enumerate(random_cases(count))), **preset_cases()}
    found = {name: page.tab.evaluate(COMPARE, [case])[0] for name, case in cases.items()}
    wrong, chaotic = disagreements(cases, found)
    page.close()
    alike = [one for name, one in found.items() if name not in (*wrong, *chaotic)]
    late = sorted(one['late'] for one in alike)
    return {
        'rigs': len(cases),
        'events': sum(one['expected'] for one in found.values()),
        'wrong': wrong,
        'last digits decide': chaotic,
        'largest difference of an instant, s': late[-1],
        'median of the largest of each rig, s': median(late),
        'largest relative difference of a constant': max(one['constants'] for one in alike),
    }


def first_motion(address: str, times: int = 7) -> dict[str, float]:
    """Return how long after the call of the address the rig has moved for 0.1 s, in new tabs."""
    browser = Browser(chromium.found(), screen='')
    taken = []
    for _ in range(times):
        page = browser.open(address)
        taken.append(page.run(FIRST))
        page.close()
    browser.close()
    return {'median, s': median(taken), 'longest, s': max(taken)}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n', maxsplit=1)[0])
    parser.add_argument('--rigs', type=int, default=400)
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        place = Path(directory)
        build(place)
        address = f'file://{place}/index.html'
        sizes = {p.name: len(gzip.compress(p.read_bytes())) for p in sorted(place.iterdir())}
        moved = first_motion(address)
        browser = Browser(chromium.found())
        page = browser.open(address)
        speed = page.tab.evaluate(SPEED)
        page.close()
        result = {
            'agreement': compare(browser, address, options.rigs),
            'size, gzipped, B': {**sizes, 'all': sum(sizes.values())},
            'first motion': moved,
            'curve over the gap': curves(browser, address),
            'curve over the gap, processor': answers(place / 'rig.js'),
            'rig seconds per second': {name: round(value) for name, value in speed.items()},
        }
        browser.close()
    text = json.dumps(result, indent=2)
    print(text)
    if options.json:
        options.json.write_text(text, encoding='utf-8')
    missed = [
        result['agreement']['wrong'],
        sum(sizes.values()) > LARGEST,
        result['first motion']['median, s'] > LONGEST,
        result['curve over the gap']['95 % of all, ms'] > CURVE,
    ]
    return 1 if any(missed) else 0


if __name__ == '__main__':
    sys.exit(main())
