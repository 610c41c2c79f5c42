"""
Gap control: forcing cycles per second, compiled and plain, and the loop without control beside it.

    python benchmarks/control.py [--rounds 5] [--cycles 20000] [--json FILE]

Each law runs the golden case at resonance at 32 samples per cycle, with both placements of the
stops, and with noise, delay and finite speed of the actuators. CPU time of the thread; compiling
is not counted. Before it is timed, each compiled run is compared with the plain one: the states of
rig and control must be the same, to the last bit.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import tau
from typing import Any

from golden_cases import CASES
from timing import in_turns, options, say, seconds_of, table, write_results

from impact_damper_ros import GapControlParameters, Rig, RigParameters

SAMPLES = 32
#: Cycles of the plain runs.
FEW = 60
#: Real sensors and actuators, in units of the golden case.
REAL: dict[str, Any] = {
    'gap_control_noise_position': 1e-3,
    'gap_control_noise_velocity': 1e-3,
    'actuator_delay': 0.1,
    'actuator_speed': 100.0,
}
RIG = RigParameters(**CASES[0].changes)
ALONE, TWICE, ONCE = 'without control', 'twice as many samples', 'amplitude, symmetric'


def controls() -> dict[str, GapControlParameters]:
    """Return the controls by their names."""
    return {
        f'{law}, {stops}' + (', noise, delay and speed' if real else ''): GapControlParameters(
            gap_control=law,
            gap_control_stops=stops,
            gap_control_rate=SAMPLES / tau,
            **real,
        )
        for law in ('amplitude', 'timed')
        for stops in ('symmetric', 'independent')
        for real in ({}, REAL)
    }


def checked(control: GapControlParameters) -> Rig:
    """Return a compiled rig that has the state of a plain one after some cycles."""
    end = 20.0 * tau
    plain = Rig(RIG, control=control)
    plain.advance(end)
    rig = Rig(RIG, control=control, compiled=True)
    rig.run(end, record=False)
    if rig.snapshot() != plain.snapshot():
        raise SystemExit('compiled and plain control differ')
    return rig


def ahead(rig: Rig, cycles: int) -> Callable[[], object]:
    """Return a call that runs a rig for some cycles more."""

    def run() -> None:
        end = rig.time + cycles * tau
        if rig.compiled:
            rig.run(end, record=False, most_events=10**9)
        else:
            rig.advance(end)

    return run


def main() -> int:
    """Run the benchmark."""
    parser = options(__doc__ or '', rounds=5)
    parser.add_argument('--cycles', type=int, default=20_000, help='cycles of each compiled run')
    arguments = parser.parse_args()
    cases = controls()
    cycles: dict[str, int] = {}
    calls: dict[str, Callable[[], object]] = {}
    plain: dict[str, float] = {}
    for name, control in cases.items():
        say(f'{name}: compiled and plain compared')
        rig = checked(control)
        cycles[name] = arguments.cycles
        calls[name] = ahead(rig, cycles[name])
        plain[name] = FEW / seconds_of(ahead(Rig.restore(rig.snapshot()), FEW))
    often = cases[ONCE].replace(gap_control_rate=2 * SAMPLES / tau)
    for name, rig in (
        (ALONE, Rig(RIG, compiled=True)),
        (TWICE, Rig(RIG, control=often, compiled=True)),
    ):
        rig.run(1.0, record=False)
        cycles[name], calls[name] = arguments.cycles, ahead(rig, arguments.cycles)
    times = in_turns(calls, arguments.rounds)
    speed = {name: cycles[name] / min(times[name]) for name in calls}
    print(f'cycles per second of {SAMPLES} samples; without control {speed[ALONE]:.3g}\n')
    head = ('control', 'compiled', 'plain', 'compiled / plain', 'without control / compiled')
    rows = (
        (
            name,
            f'{speed[name]:.3g}',
            f'{plain[name]:.3g}',
            f'{speed[name] / plain[name]:.0f}',
            f'{speed[ALONE] / speed[name]:.0f}',
        )
        for name in cases
    )
    print(table(head, rows))
    print(f'\nslowest: {min(speed[name] for name in cases):.3g} cycles per second')
    sample = (1.0 / speed[TWICE] - 1.0 / speed[ONCE]) / SAMPLES
    print(f'one sample more in a cycle ({ONCE}): {1e9 * sample:.0f} ns')
    write_results(arguments.json, {'compiled': speed, 'plain': plain})
    return 0


if __name__ == '__main__':
    sys.exit(main())
