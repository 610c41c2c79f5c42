"""The force: lines and phases of a multisine."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, strategies as st
from motion.random_rigs import random_rig

from impact_damper_ros import InitialConditions, OrbitError, Rig, RigParameters, find_orbits
from impact_damper_ros.parameters.forcing import mix, multisine
from oracle.precise_motion import Harmonic, Motion, Oscillator, mp

PHASES_OF_SEED_1 = [
    '0x1.c7a7e617bba41p+1',
    '0x1.2be58a1d0b8f7p+2',
    '0x1.86769fbeabb13p+2',
    '0x1.655ff89615dddp+1',
]
NOISY = RigParameters(
    gravity=0.0,
    gap=10.0,
    damping=0.1,
    force_amplitudes=[0.3],
    multisine_level=0.5,
    multisine_low=0.4,
    multisine_high=2.0,
    multisine_lines=9,
    multisine_seed=7,
)


def test_the_generator_is_split_mix_64():
    """The published sequence of seed 1234567."""
    step = 0x9E3779B97F4A7C15
    assert [mix(1234567 + k * step) for k in range(5)] == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]


def test_the_phases_of_a_seed_are_those_for_ever():
    _, _, phases = multisine(1.0, 1.0, 2.0, 4, 1)
    assert [p.hex() for p in phases] == PHASES_OF_SEED_1
    assert all(0.0 <= p < math.tau for p in phases)
    # More lines keep the phases of the first ones; another seed has others.
    assert multisine(1.0, 1.0, 2.0, 512, 1)[2][:4] == phases
    assert multisine(1.0, 1.0, 2.0, 4, 2)[2] != phases


def test_lines_fill_the_band_evenly():
    amplitudes, frequencies, _ = multisine(0.5, 0.4, 2.0, 9, 7)
    assert frequencies[0] == 0.4
    assert frequencies[-1] == 2.0
    assert np.diff(frequencies) == pytest.approx([0.2] * 8, rel=1e-14)
    assert set(amplitudes) == {0.5 * math.sqrt(2.0 / 9)}
    assert multisine(1.0, 1.0, 2.0, 1, 3)[1] == (1.5,)


@pytest.mark.parametrize('lines', [1, 2, 64])
def test_the_level_is_the_effective_value(lines):
    """Compared with the mean square of samples over a period of the sum."""
    amplitudes, frequencies, phases = map(np.array, multisine(0.7, 1.0, 3.0, lines, 5))
    spacing = 2.0 / max(1, lines - 1)
    # All lines are whole multiples of the spacing from the first one.
    period = math.tau / spacing if lines > 1 else math.tau / 2.0
    t = np.arange(8192) * period / 8192
    force = (amplitudes * np.exp(1j * (np.outer(t, frequencies) + phases))).sum(axis=1)
    assert math.sqrt(np.mean(np.abs(force) ** 2) / 2) == pytest.approx(0.7, rel=1e-10)


def test_it_is_added_to_the_harmonics():
    amplitudes, frequencies, phases = NOISY.harmonics
    assert (amplitudes[0], frequencies[0], phases[0]) == (0.3, 1.0, 0.0)
    lines = multisine(0.5, 0.4, 2.0, 9, 7)
    assert (amplitudes[1:], frequencies[1:], phases[1:]) == lines
    assert NOISY.replace(multisine_level=0.0).harmonics == ((0.3,), (1.0,), (0.0,))


@given(seed=st.integers(0, 10**9))
def test_it_moves_the_rig_as_plain_arrays_do(seed):
    """Bit for bit."""
    parameters, initial = random_rig(f'multisine {seed}')
    noisy = parameters.replace(multisine_level=0.4, multisine_lines=5, multisine_seed=seed)
    names = ('force_amplitudes', 'force_frequencies', 'force_phases')
    plain = parameters.replace(**dict(zip(names, noisy.harmonics, strict=True)))
    one, other = Rig(noisy, initial), Rig(plain, initial)
    for time in (0.7, 4.0):
        assert one.advance(time) == other.advance(time)
        assert one.sample() == other.sample()


def test_it_agrees_with_110_digits():
    free = NOISY.replace(gap=1e6, multisine_lines=40)
    rig = Rig(free, InitialConditions(initial_primary_position=0.5))
    lines = [Harmonic(*map(mp.mpf, row)) for row in zip(*free.harmonics, strict=True)]
    oscillator = Oscillator(mp.mpf(1), mp.mpf(free.damping), mp.mpf(1), lines)
    motion = Motion(oscillator, mp.mpf(0), mp.mpf(0.5), mp.mpf(0), mp.mpf(0))
    for time in (1.0, 17.0, 63.0):
        rig.advance(time)
        exact = [float(v) for v in motion.derivatives(mp.mpf(time))[:2]]
        sample = rig.sample()
        assert (sample.x, sample.primary_velocity) == pytest.approx(exact, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [({'multisine_level': 0.25}, 'multisine_level is 0.25 N'), ({'sweep_mode': 'up'}, "is 'up'")],
)
def test_the_periodic_theory_refuses_it(changes, words):
    with pytest.raises(OrbitError, match=words):
        find_orbits(RigParameters(gravity=0.0, **changes), (1, 2))


def angles(rig):
    """Return what each harmonic has turned up to the present time."""
    origin = rig.snapshot()['origin']
    own, frequencies, _ = rig.parameters.harmonics
    since = rig.time - origin['time']
    assert len(own) == len(origin['angles'])
    return [a + w * since for a, w in zip(origin['angles'], frequencies, strict=True)]


def turned(got, want):
    assert [math.sin(a) for a in got] == pytest.approx([math.sin(a) for a in want], abs=1e-12)


def test_harmonics_and_lines_keep_their_angles_apart():
    """Whatever is added or taken away among the ones leaves the others as they are."""
    rig = Rig(NOISY)
    rig.advance(11.0)
    lines = [11.0 * w for w in NOISY.harmonics[1][1:]]
    rig.change(
        rig.parameters.replace(
            force_amplitudes=[0.3, 0.1, 0.2],
            force_frequencies=[1.0, 2.0, 3.0],
            force_phases=[0.0, 0.5, 1.0],
        )
    )
    turned(angles(rig), [11.0, 0.0, 0.0, *lines])
    rig.advance(13.0)
    lines = [a + 2.0 * w for a, w in zip(lines, NOISY.harmonics[1][1:], strict=True)]
    turned(angles(rig), [13.0, 4.0, 6.0, *lines])
    # Fewer lines, then more, then none, then again
    rig.change(rig.parameters.replace(multisine_lines=4))
    turned(angles(rig), [13.0, 4.0, 6.0, *lines[:4]])
    rig.change(rig.parameters.replace(multisine_lines=6, multisine_level=0.1))
    turned(angles(rig), [13.0, 4.0, 6.0, *lines[:4], 0.0, 0.0])
    rig.change(rig.parameters.replace(force_amplitudes=[1], force_frequencies=[1], force_phases=0))
    turned(angles(rig), [13.0, *lines[:4], 0.0, 0.0])
    rig.change(rig.parameters.replace(multisine_seed=3, multisine_high=2.5))
    turned(angles(rig), [13.0, *lines[:4], 0.0, 0.0])
    rig.change(rig.parameters.replace(multisine_level=0.0))
    turned(angles(rig), [13.0])
    rig.change(rig.parameters.replace(multisine_level=0.2))
    turned(angles(rig), [13.0, *[0.0] * 6])


CONSTANTS = """
import hashlib
import random

from impact_damper_ros import RigParameters
from impact_damper_ros.motion.state import constants_of

draw, digest = random.Random(1), hashlib.sha256()
for _ in range(300):
    force = [[draw.uniform(0.1, 9.0) for _ in range(3)] for _ in range(3)]
    parameters = RigParameters(
        stiffness=draw.uniform(0.1, 9.0),
        force_amplitudes=force[0],
        force_frequencies=force[1],
        force_phases=force[2],
    )
    digest.update(repr(constants_of(parameters)).encode())
print(digest.hexdigest())
"""


def test_constants_do_not_depend_on_the_features_of_the_processor():
    """Where numpy has other last bits, as in its powers with AVX-512, it is not used."""
    used = np.show_config(mode='dicts')['SIMD Extensions'].get('found', [])
    found = set()
    for disabled in ('', ' '.join(used)):
        done = subprocess.run(
            [sys.executable, '-W', 'ignore', '-c', CONSTANTS],
            env={**os.environ, 'NPY_DISABLE_CPU_FEATURES': disabled},
            capture_output=True,
            text=True,
            check=True,
        )
        found.add(done.stdout)
    assert len(found) == 1
