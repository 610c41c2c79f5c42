# SPDX-License-Identifier: Apache-2.0
"""
The data of the tutorial 'From data to damper', as a bench would give them.

A rig whose parameters are not those of its drawing is released without its damper, and then
started from rest with it. A laser shows the place of M with noise, an accelerometer the impacts.
A microphone has the bounces of a ball.

    python examples/twin/measure.py [DIRECTORY]
"""

import sys
from pathlib import Path

import numpy as np

from impact_damper_ros import Rig, RigParameters

#: The rig that stands on the bench. rig.yaml has what its drawing and a scale say.
TRUE = RigParameters(
    primary_mass=2.0,
    stiffness=2031.0,
    damping=1.45,
    damper_mass=0.12,
    gap=0.0187,
    restitution_1=0.62,
    restitution_2=0.62,
    friction=0.015,
    force_amplitudes=1.5,
    force_frequencies=31.8,
)
RATE, NOISE = 200.0, 5e-5


def free(rng):
    """Return time and place of M that is released, without the damper."""
    time = np.arange(int(8.0 * RATE)) / RATE
    later = np.maximum(0.0, time - 0.6)
    zeta, omega = TRUE.zeta, TRUE.omega
    root = (-zeta + 1j * np.sqrt(1.0 - zeta**2)) * omega
    place = 0.012 * (np.exp(root * later) * (1.0 + 1j * zeta)).real
    return time, place + rng.normal(0.0, NOISE, len(time))


def from_rest(rng):
    """Return time and place of M once the shaker is switched on, and the impact times."""
    time = np.arange(int(12.0 * RATE)) / RATE
    run = Rig(TRUE).run(time[-1], time)
    hits = run.impacts()['time']
    place = run.samples['x'] + rng.normal(0.0, NOISE, len(time))
    return time, place, np.sort(hits + rng.normal(0.0, 3e-4, len(hits)))


def bounces(rng):
    """Return when a table-tennis ball hits a plate, whose restitution falls with its speed."""
    times, speed = [0.412], 2.6
    for _ in range(13):
        times.append(times[-1] + 2.0 * speed / 9.80665)
        speed *= 0.93 - 0.03 * speed
    return np.array(times) + rng.normal(0.0, 2e-4, len(times))


def main():
    """Write the files."""
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    rng = np.random.default_rng(20)
    time, place = free(rng)
    rows = [f'{t:.3f};{1e3 * x:.3f}'.replace('.', ',') for t, x in zip(time, place, strict=True)]
    (directory / 'free.csv').write_text('Zeit [s];Weg [mm]\n' + '\n'.join(rows) + '\n')
    time, place, hits = from_rest(rng)
    rows = [f'{t:.3f},{1e3 * x:.3f}' for t, x in zip(time, place, strict=True)]
    (directory / 'start.csv').write_text('t [s],x [mm]\n' + '\n'.join(rows) + '\n')
    for name, times in (('hits.csv', hits), ('bounces.csv', bounces(rng))):
        (directory / name).write_text('t [s]\n' + '\n'.join(f'{t:.4f}' for t in times) + '\n')


if __name__ == '__main__':
    main()
