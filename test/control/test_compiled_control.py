"""The kernels of the control, compiled: the same states as in plain Python, to the last bit."""

import math
import random
from functools import cache

import pytest

from control import laws
from control.controlled_rigs import random_control
from impact_damper_ros.control import OwnLaw, actuator, controller
from impact_damper_ros.control.controller import Control
from impact_damper_ros.control.own_law import call_by_address
from impact_damper_ros.rig import InitialConditions, RigParameters, Simulator
from impact_damper_ros.rig.kernels import by_reference, compiled

numba = pytest.importorskip('numba')

NAMES = {
    actuator: ('commands_full', 'next_command', 'start_command', 'stop_stopped'),
    controller: (
        'end_sample',
        'holds_off',
        'measured',
        'next_sample',
        'take_crossing',
        'take_sample',
        'trigger_number',
    ),
}


class Plain:
    """The kernels as they stand."""

    def __init__(self):
        for module, names in NAMES.items():
            for name in names:
                setattr(self, name, getattr(module, name))


@cache
def compiled_kernels():
    both = Plain()
    names = tuple(vars(both))
    given = {'call_law': call_by_address()}
    for name, kernel in zip(names, compiled(*names, given=given), strict=True):
        setattr(both, name, kernel)
    return both


def motion(rng, time):
    """Return a made-up motion: a wave, and m that flies to and fro in a gap of its own."""
    x, x_rate = 2.0 * math.sin(time), 2.0 * math.cos(time)
    y = 3.0 * math.asin(math.sin(time + 0.4)) + rng.uniform(-0.3, 0.3)
    y_rate = math.copysign(3.0, math.cos(time + 0.4)) + rng.uniform(-0.5, 0.5)
    return time, x, x_rate, y, y_rate, rng.uniform(3.0, 5.0), rng.uniform(-5.0, -3.0)


def run(kernels, control, model, seed, *, control_off=False):
    """Go through samples, crossings and commands; return what came of them."""
    rng = random.Random(seed)
    time, crossings, commands = 0.0, 0, 0
    results = []
    while time < 60.0:
        if kernels.commands_full(control):
            control = control.enlarged()
        sample, command = kernels.next_sample(control), kernels.next_command(control)
        passage = math.pi * (crossings + 1) + 0.05 * math.sin(crossings)
        time = min(sample, command, passage)
        seen = motion(rng, time)
        if command <= time:
            targets = kernels.start_command(control, seen[5], seen[6])
            results += targets
            commands += 1
        elif passage <= time:
            crossings += 1
            if not kernels.holds_off(control, time) and not control_off:
                index = kernels.trigger_number(control)
                taken = kernels.measured(control, index, *seen)
                kernels.take_crossing(control, taken, crossings % 2 == 0, *model)
        else:
            taken = kernels.measured(control, control.controller.sample_index, *seen)
            results += taken
            kernels.take_sample(control, taken)
            kernels.end_sample(control, time, seen[5], seen[6])
        if rng.random() < 0.1:
            place = rng.choice([math.nan, rng.uniform(-4.0, 4.0)])
            kernels.stop_stopped(control, rng.choice([1, 2]), place)
    return control, results, commands


@pytest.mark.parametrize('seed', range(16))
def test_plain_and_compiled_control_have_the_same_bits(seed):
    law = random_control(random.Random(f'q{seed}')).replace(
        gap_control=['amplitude', 'timed', 'predictive'][seed % 3]
    )
    if seed % 5 == 0:
        law = law.replace(actuator_delay=20.0)
    rig = RigParameters(one_sided=seed % 7 == 0, gap=8.0)
    start = Control.of(law, rig, OwnLaw(numba.njit(laws.push)) if seed % 4 == 3 else None)
    simulator = Simulator(rig, InitialConditions(initial_damper_velocity=2.0))
    model = simulator._constants, simulator._present()
    off = start.settings.law == 0
    plain, expected, commands = run(Plain(), start.copied(), model, seed, control_off=off)
    known = by_reference(model[0]), model[1]
    records, found, count = run(compiled_kernels(), start.packed(), known, seed, control_off=off)
    assert repr([float(value) for value in found]) == repr(list(map(float, expected)))
    assert count == commands
    assert commands > 0 or plain.refusal.time > 0.0
    there = start.unpacked(records)
    assert repr(there.as_dict()) == repr(plain.as_dict())
    assert (there.memory, repr(there.refusal)) == (plain.memory, repr(plain.refusal))


def test_a_control_is_packed_and_unpacked_as_it_is():
    start = Control.of(random_control(random.Random(1)), RigParameters())
    simulator = Simulator(RigParameters())
    model = simulator._constants, simulator._present()
    other, _, _ = run(Plain(), start.copied(), model, 1)
    again = start.unpacked(other.packed())
    assert repr(again.as_dict()) == repr(other.as_dict())
    assert repr(again.states()) == repr(other.states())
