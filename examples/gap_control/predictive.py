# SPDX-License-Identifier: Apache-2.0
"""
A controller that knows the model: it tries places of the stops in the simulator itself.

At each passage of X through zero the motion ahead is simulated from the exact state, with the
stops at one pair of places after the other. They are sent where the vibration of M has the least
energy after 2.1 half cycles. Each stop is tried around a quarter of the optimal gap of the present
amplitude, then more and more finely around the best pair. No real controller knows so much: the
row shows what knowing the structure and the force is worth.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
import study

from impact_damper_ros import GapControlParameters, Order, Rig, RigParameters
from impact_damper_ros.control.state import damper_of

#: Time after which M is to have the least energy, in half cycles.
HORIZON = 2.1
#: Places tried on either side of the middle one at first; their step, over half the optimal gap.
TRIES, STEP = 8, 0.125
#: How often the best place is sought, and by how much finer each time.
SEARCHES, FINER = 4, 0.4
EXTERNAL = GapControlParameters(gap_control='external')


def energy_ahead(rig: Rig, places: tuple[float, float], time: float) -> float:
    """Return the energy of M at a later time, over M/2, with the stops sent to places now."""
    mark = rig.mark()
    rig.order(Order(*places))
    ahead = rig.run(time, [time], record=False).samples[0]
    rig.go_back(mark)
    return float(ahead['primary_velocity'] ** 2 + (rig.parameters.omega * ahead['x']) ** 2)


def best_places(rig: Rig, amplitude: float, time: float) -> tuple[float, float]:
    """Return the places of both stops that leave the least energy at a later time, Y in m."""
    unit = 0.5 * damper_of(rig.parameters).optimal_gap(amplitude, EXTERNAL.gap_max)
    best, step, tries = rig.stops, STEP * unit, TRIES
    least = energy_ahead(rig, best, time)
    for fineness in range(SEARCHES):
        for side in (0, 1):
            middle = 0.5 * unit * (1 - 2 * side) if fineness == 0 else best[side]
            for k in range(-tries, tries + 1):
                place = middle + k * step
                places = (place, best[1]) if side == 0 else (best[0], place)
                if places[0] - places[1] < EXTERNAL.gap_min:
                    continue
                energy = energy_ahead(rig, places, time)
                if energy < least:
                    least, best = energy, places
        step, tries = FINER * step, 1
    return best


def rms_under_control(parameters: RigParameters, settle: float, watch: float) -> float:
    """Return the rms of X of a rig from rest, over natural periods after the first ones, m."""
    rig = Rig(parameters, control=EXTERNAL, compiled=None)
    step = math.tau / parameters.omega / study.RATE
    crossed, peak, amplitude, half_cycle = math.nan, 0.0, 0.0, 0.0
    seen = []
    for k in range(1, round((settle + watch) * study.RATE) + 1):
        mark, before = rig.mark(), rig.sample().x
        rig.run(k * step, record=False)
        x = rig.sample().x
        seen.append(x)
        if before * x < 0.0:
            # Back to the passage itself
            rig.go_back(mark)
            rig.run(rig.time + (k * step - rig.time) * before / (before - x), record=False)
            if not math.isnan(crossed):
                share = 0.3 if half_cycle else 1.0
                amplitude += share * (peak - amplitude)
                half_cycle += share * (rig.time - crossed - half_cycle)
                later = rig.time + HORIZON * half_cycle
                rig.order(Order(*best_places(rig, amplitude, later)))
            crossed, peak = rig.time, 0.0
            rig.run(k * step, record=False)
        peak = max(peak, abs(x))
    return float(np.sqrt(np.mean(np.square(seen[round(settle * study.RATE) :]))))


def main() -> None:
    """Print the row, beside that of the timed law."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='a few cycles only')
    quick = parser.parse_args().quick
    settle, watch = (40.0, 20.0) if quick else (240.0, 80.0)
    cases = {
        f'resonance, {level:g} N': study.RIG.replace(force_amplitudes=level)
        for level in (0.25, 1.0, 4.0)
    }
    cases['broadband, seed 1'] = study.broadband_rig(1)
    print('| rms of X [m] | predictive (knows the model) | timed, independent stops |')
    print('| --- | --- | --- |')
    for name, rig in cases.items():
        spans = (settle, watch) if name.startswith('resonance') else (study.START, settle + watch)
        timed = study.watched(rig, study.law('timed', rig), settle=spans[0], watch=spans[1])
        print(f'| {name} | {rms_under_control(rig, *spans):.4g} | {timed.rms:.4g} |')


if __name__ == '__main__':
    main()
