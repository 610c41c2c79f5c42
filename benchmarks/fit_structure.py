# SPDX-License-Identifier: Apache-2.0
"""
Do the 95 % intervals of a structure hold? Ring-downs of random structures, and sweeps.

Each case has its own seed: frequency, damping ratio from 0.2 to 5 %, sampling rate, length, noise
of 0.3 to 3 % of the first amplitude, and an offset of the sensor; a sweep has a measured force
with a noise of 0, 1 or 3 %, and its motion is computed at 20 times the sampling rate.

    python benchmarks/fit_structure.py [--cases 100] [--first 0]
"""

import argparse
import math
import os
import time

# Threads of BLAS that wait for each other would count as time of the fit
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from scipy.signal import lsim

from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.structure import fit_structure


def ring_down(rng):
    frequency, ratio = rng.uniform(3.0, 30.0), 10.0 ** rng.uniform(-2.7, -1.3)
    omega, rate = math.tau * frequency, frequency * rng.choice([20.0, 50.0, 100.0])
    span = min(60.0, max(8.0 / frequency, rng.uniform(1.0, 3.0) / (ratio * omega)))
    times = np.arange(int(span * rate)) / rate
    turn = math.sqrt(1.0 - ratio * ratio) * omega * times + rng.uniform(0.0, math.tau)
    motion = np.exp(-ratio * omega * times) * np.cos(turn) + rng.normal(0.0, 0.3)
    motion += rng.normal(0.0, 10.0 ** rng.uniform(-2.5, -1.5), len(times))
    used = np.ones(len(times), bool)
    data = MeasuredMotion(times, 0.01 * motion, 'displacement', used, source='ring-down')
    return data, {'frequency': frequency, 'damping_ratio': ratio}


def sweep(rng):
    frequency, ratio, mass = rng.uniform(3.0, 12.0), rng.uniform(0.005, 0.04), rng.uniform(1, 5)
    omega, rate, span = math.tau * frequency, 40.0 * frequency, 20.0
    fine = 20
    times = np.arange(int(span * rate) * fine) / (rate * fine)
    low, high = 0.6 * frequency, 1.6 * frequency
    force = np.sin(math.tau * (low * times + 0.5 * (high - low) / span * times**2))
    system = ([1.0 / mass], [1.0, 2.0 * ratio * omega, omega * omega])
    _, motion, _ = lsim(system, force, times)
    times, force, motion = times[::fine], force[::fine], motion[::fine]
    motion = motion + rng.normal(0.0, 0.02 * np.std(motion), len(times))
    force = force + rng.normal(0.0, rng.choice([0.0, 0.01, 0.03]), len(times))
    used = np.ones(len(times), bool)
    data = MeasuredMotion(times, motion, 'displacement', used, force=force, source='sweep')
    return data, {'frequency': frequency, 'damping_ratio': ratio, 'mass': mass}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--cases', type=int, default=100)
    parser.add_argument('--first', type=int, default=0)
    arguments = parser.parse_args()
    for make in (ring_down, sweep):
        held, worst, accepted, used = {}, {}, 0, time.process_time()
        for seed in range(arguments.first, arguments.first + arguments.cases):
            data, true = make(np.random.default_rng(seed))
            found = fit_structure(data)
            accepted += found.accepted
            for name, value in true.items():
                one = getattr(found, name)
                held[name] = held.get(name, 0) + (one.interval[0] <= value <= one.interval[1])
                off = abs(one.value - value) / one.standard_deviation
                worst[name] = max(worst.get(name, 0.0), off)
        used = (time.process_time() - used) / arguments.cases
        print(f'{make.__name__}: {accepted} of {arguments.cases} accepted, {used:.2f} s each')
        for name, count in held.items():
            share = 100.0 * count / arguments.cases
            print(f'  {name:14} {share:.0f} % within, at most {worst[name]:.1f} deviations off')


if __name__ == '__main__':
    main()
