"""Rigs with a change on the way, and what CPython computes of them: for a comparison elsewhere."""

import math
import random
from pathlib import Path

from impact_damper_ros import GapControlParameters, InitialConditions, Rig, RigParameters
from impact_damper_ros.page.knobs import as_json
from impact_damper_ros.page.presets import load_presets
from impact_damper_ros.rig.runaway import RunawayError

#: Largest number of events in a period that a rig may have to be among the random ones.
MOST_IN_PERIOD = 150
HALF_PI = 1.5707963267948966


def drawn_rig(chance):
    """Return parameters of a random rig."""
    omega, mass = 10 ** chance.uniform(0, 1.5), 10 ** chance.uniform(-1, 1)
    stiffness = mass * omega**2

    def restitution():
        return chance.choice([0.0, 1.0, chance.uniform(0, 1), chance.uniform(0.3, 0.95)])

    def lines(count, largest):
        return (
            [chance.uniform(-1, 1) * largest for _ in range(count)],
            [omega * chance.choice([0.25, 0.5, 1, 2.3]) for _ in range(count)],
            [chance.uniform(0, 6) for _ in range(count)],
        )

    forces, frequencies, phases = lines(chance.choice([1, 1, 2, 3]), 0.02 * stiffness)
    frequencies = [chance.choice([0.0, w, w, w]) for w in frequencies]
    base = lines(chance.choice([1, 2]), chance.choice([0.0, 0.0, 0.02]))
    return RigParameters(
        primary_mass=mass,
        stiffness=stiffness,
        damping=2 * mass * omega * chance.choice([0, 0.01, 0.2, 0.8]),
        damper_mass=mass * chance.choice([0.01, 0.1, 1.0]),
        gap=10 ** chance.uniform(-3, 0),
        restitution_1=restitution(),
        restitution_2=restitution(),
        friction=chance.choice([0, 0.1, 0.6]),
        angle=chance.choice([0, 0.3, -0.5, HALF_PI]),
        gravity=chance.choice([0, 9.81]),
        air_force=chance.choice([0, 0, 0.05]),
        one_sided=chance.random() < 0.15,
        force_amplitudes=forces,
        force_frequencies=frequencies,
        force_phases=phases,
        base_amplitudes=base[0],
        base_frequencies=base[1],
        base_phases=base[2],
        base_quantity='displacement',
        multisine_level=chance.choice([0, 0, 0, 0.01 * stiffness]),
        multisine_low=0.5 * omega,
        multisine_high=1.5 * omega,
        multisine_lines=7,
        sweep_mode=chance.choice(['off'] * 5 + ['up', 'down']),
        sweep_low=0.8 * omega,
        sweep_high=1.2 * omega,
        sweep_step=0.1 * omega,
        sweep_dwell=1.7 / omega,
        restitution_speed=chance.choice([0.0, 0.0, 0.01, 1.0]),
        restitution_exponent=chance.choice([0.25, 0.9]),
    )


def drawn_control(chance, rig):
    """Return parameters of a random gap control; off in half of the rigs."""
    law = chance.choice(['off', 'off', 'amplitude', 'timed'])
    noise = chance.choice([0.0, 0.0, 1e-4])
    return GapControlParameters(
        gap_control=law,
        gap_control_stops=chance.choice(['symmetric', 'independent']),
        gap_min=0.1 * rig.gap,
        gap_max=10 * rig.gap,
        gap_control_rate=chance.choice([20.0, 100.0]) * rig.omega / math.tau,
        gap_control_noise_position=noise * rig.gap,
        gap_control_noise_velocity=noise * rig.gap * rig.omega,
        gap_control_seed=chance.randrange(1000),
        sensor_fault=chance.choice(['none', 'none', 'none', 'bias', 'spike']),
        sensor_fault_size=0.01 * rig.gap,
        actuator_delay=chance.choice([0.0, 0.02 / rig.omega]),
        actuator_speed=chance.choice([0.0, rig.gap * rig.omega]),
    )


def drawn_case(chance):
    """Return a random rig with a change on the way, or None where its events have no end."""
    try:
        rig = drawn_rig(chance)
        control = drawn_control(chance, rig)
        initial = InitialConditions(
            initial_damper_offset=rig.gap * chance.uniform(-0.5, 0.5),
            initial_damper_velocity=chance.choice([0, 0.1, -0.3]),
            initial_primary_position=chance.uniform(-0.01, 0.01),
        )
        after = rig.replace(
            gap=rig.gap * chance.choice([0.7, 1.4]), angle=chance.choice([rig.angle, 0.1])
        )
        change = chance.uniform(3, 12) / rig.omega
        return computed(rig, initial, control, after, change, change + 12 / rig.omega)
    except (ValueError, RunawayError):
        return None


def computed(rig, initial, control, after, change, end):
    """Return a rig that is changed, with its events, last sample and constants."""
    running = Rig(rig, initial, control=control)
    constants = [*numbers(running._constants), *(x for line in running._lines for x in line)]
    events = running.advance(change, MOST_IN_PERIOD)
    if after is not None:
        events += running.change(after)
    events += running.advance(end, MOST_IN_PERIOD)
    return {
        'rig': plain(rig),
        'initial': plain(initial),
        'control': plain(control),
        'after': None if after is None else plain(after),
        'change': change,
        'end': end,
        'events': [[e.time, int(e.kind), e.stop, e.mode] for e in events],
        'last': as_json(list(running.sample())),
        'constants': constants,
    }


def numbers(record):
    """Return all numbers of a record, those of records within it, too."""
    for value in record:
        if isinstance(value, tuple):
            yield from numbers(value)
        else:
            yield float(value)


def plain(table):
    return as_json(table.as_dict())


def random_cases(count, seed=11):
    """Return some random rigs."""
    chance, found = random.Random(seed), []
    while len(found) < count:
        if (case := drawn_case(chance)) is not None:
            found.append(case)
    return found


def preset_cases(seconds=20.0):
    """Return each preset, as it is and with half the gap from the middle of the run on."""
    found = {}
    for name, preset in load_presets().items():
        parts = preset.rig, preset.initial, preset.control
        half = preset.rig.replace(gap=0.5 * preset.rig.gap)
        found[name] = computed(*parts, None, 0.5 * seconds, seconds)
        found[f'{name}, half the gap'] = computed(*parts, half, 0.5 * seconds, seconds)
    return found


#: In the browser: runs cases, and returns how far each agrees.
COMPARE = Path(__file__).with_name('compare_rigs.js').read_text(encoding='utf-8')


def strayed(case):
    """Return how many events of a rig are as before if M starts some last digits elsewhere."""
    initial = dict(case['initial'])
    initial['initial_primary_position'] += 1e-14 * case['rig']['gap']
    after = case['after'] and RigParameters(**case['after'])
    control = GapControlParameters(**case['control'])
    parts = RigParameters(**case['rig']), InitialConditions(**initial), control, after
    other = computed(*parts, case['change'], case['end'])
    pairs = zip(case['events'], other['events'], strict=False)
    alike = [a[1:] == b[1:] and abs(a[0] - b[0]) <= 1e-6 * case['end'] for a, b in pairs]
    return alike.index(False) if False in alike else len(case['events'])


def disagreements(cases, found):
    """
    Return the names of cases that disagree, and of those where last digits decide.

    In the latter, a start that is off by last digits has other events in CPython, too.
    """
    wrong, chaotic = [], []
    for name, one in found.items():
        if one['agree'] == one['events'] == one['expected']:
            continue
        case = cases[name]
        (chaotic if strayed(case) < one['expected'] else wrong).append(name)
    return wrong, chaotic
