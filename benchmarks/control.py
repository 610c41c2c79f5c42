"""
Gap control: forcing cycles per second, compiled and plain, and the loop without control beside it.

    python benchmarks/control.py [--rounds 5] [--cycles 20000] [--json FILE]

Each law runs the golden case at resonance at 32 samples per cycle, with both placements of the
stops, and with noise, delay and finite speed of the actuators. CPU time of the thread, best of
rounds in turns; compiling is not counted. Before it is timed, each compiled run is compared with
the plain one: the states of rig and control must be the same, to the last bit.
"""

from __future__ import annotations

import argparse
import json
import sys
from math import inf, tau
from pathlib import Path
from time import thread_time
from typing import Any

from simulator import CASES, say

from impact_damper_ros.control import Rig
from impact_damper_ros.rig import GapControlParameters, RigParameters

SAMPLES = 32
#: Cycles of the plain runs, and of the predictive law, which runs the model ahead some fifty times
#: at each passage of X through zero.
FEW, SOME = 60, 1_000
#: Real sensors and actuators, in units of the golden case.
REAL: dict[str, Any] = {
    'gap_control_noise_position': 1e-3,
    'gap_control_noise_velocity': 1e-3,
    'actuator_delay': 0.1,
    'actuator_speed': 100.0,
}


def controls() -> dict[str, GapControlParameters]:
    """Return the controls by their names."""
    rate = SAMPLES / tau
    found = {}
    for law in ('amplitude', 'timed', 'predictive'):
        for stops in ('symmetric', 'independent'):
            for real in ({}, REAL):
                name = f'{law}, {stops}' + (', noise, delay and speed' if real else '')
                found[name] = GapControlParameters(
                    gap_control=law, gap_control_stops=stops, gap_control_rate=rate, **real
                )
    return found


def timed(rig: Rig, cycles: int) -> float:
    """Return how many cycles per second a rig makes from its present time on."""
    end = rig.time + cycles * tau
    began = thread_time()
    if rig.compiled:
        rig.run(end, record=False, most_events=10**9)
    else:
        rig.advance(end)
    return cycles / (thread_time() - began)


def checked(parameters: RigParameters, control: GapControlParameters) -> Rig:
    """Return a compiled rig that has the state of a plain one after some cycles."""
    end = 20.0 * tau
    plain = Rig(parameters, control=control)
    plain.advance(end)
    rig = Rig(parameters, control=control, compiled=True)
    rig.run(end, record=False)
    if rig.snapshot() != plain.snapshot():
        raise SystemExit('compiled and plain control differ')
    return rig


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n', maxsplit=1)[0].strip())
    parser.add_argument('--rounds', type=int, default=5, help='rounds of all in turns')
    parser.add_argument('--cycles', type=int, default=20_000, help='cycles of each compiled run')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    options = parser.parse_args(argv)
    parameters = RigParameters(**CASES[0].changes)
    cases = controls()
    rigs: dict[str, Rig] = {}
    for name, control in cases.items():
        say(f'{name}: compiled and plain compared')
        rigs[name] = checked(parameters, control)
    free = Rig(parameters, compiled=True)
    free.run(1.0)
    first = next(iter(cases))
    often = cases[first].replace(gap_control_rate=2 * SAMPLES / tau)
    twice = Rig(parameters, control=often, compiled=True)
    best_twice = 0.0
    best = {name: {'compiled': 0.0, 'plain': 0.0} for name in cases}
    alone = 0.0
    least = inf
    for number in range(options.rounds):
        say(f'round {number + 1} of {options.rounds}')
        alone = max(alone, timed(free, options.cycles))
        best_twice = max(best_twice, timed(twice, options.cycles))
        for name, control in cases.items():
            predictive = control.gap_control == 'predictive'
            cycles = min(options.cycles, SOME) if predictive else options.cycles
            row = best[name]
            row['compiled'] = max(row['compiled'], timed(rigs[name], cycles))
            if number == 0:
                plain = Rig.restore(rigs[name].snapshot())
                row['plain'] = timed(plain, 2 if predictive else FEW)
    print(f'cycles per second of {SAMPLES} samples; without control {alone:.3g}\n')
    print('| control | compiled | plain | compiled / plain | without control / compiled |')
    print('| --- | ---: | ---: | ---: | ---: |')
    for name, row in best.items():
        quick, slow = row['compiled'], row['plain']
        if not name.startswith('predictive'):
            least = min(least, quick)
        print(f'| {name} | {quick:.3g} | {slow:.3g} | {quick / slow:.0f} | {alone / quick:.0f} |')
    print(f'\nslowest without a model: {least:.3g} cycles per second')
    sample = (1.0 / best_twice - 1.0 / best[first]['compiled']) / SAMPLES
    print(f'one sample more in a cycle ({first}): {1e9 * sample:.0f} ns')
    if options.json:
        options.json.write_text(json.dumps({'alone': alone, 'controls': best}, indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
