"""Parameters at the ends of their ranges and next to zero: each run ends, compiled or not."""

import math
import random
import time

import pytest
from hypothesis import given, strategies as st

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    ParameterError,
    Rig,
    RigParameters,
    load_parameters,
)
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS, PARAMETER_SPECS

BENCH = load_parameters('bench_rig')[0]
NAMES = [
    name
    for specs in (PARAMETER_SPECS, INITIAL_SPECS, GAP_CONTROL_SPECS)
    for name, spec in specs.items()
    if spec.low is not None
]
#: No sum, square or quotient of these keeps its digits.
TINY = (0.0, -0.0, 5e-324, -5e-324, 1e-300, -1e-300, 1e-160, 1e-20)
LAWS = ('off', 'amplitude', 'timed', 'external')


def values_of(spec):
    ends = spec.low, spec.high
    inner = math.nextafter(spec.low, spec.high), math.nextafter(spec.high, spec.low)
    return [*TINY, *ends, *inner]


class Tables:
    """A rig, its start and its control, in which values are set one after the other."""

    def __init__(self, position, law):
        self.parameters = BENCH
        self.initial = InitialConditions(initial_primary_position=position)
        self.control = GapControlParameters(gap_control=law, gap_min=2e-3, gap_max=0.1)

    def set(self, name, value):
        """Set a value, if no other one forbids it."""
        parameters, initial, control = self.parameters, self.initial, self.control
        try:
            if name in PARAMETER_SPECS:
                parameters = parameters.replace(**{name: value})
            elif name in INITIAL_SPECS:
                initial = initial.replace(**{name: value})
            else:
                control = control.replace(**{name: value})
            initial.check_within(parameters)
        except ParameterError:
            return
        self.parameters, self.initial, self.control = parameters, initial, control

    def run(self, *, compiled):
        """Return what a short run of the rig has: three periods of its fastest part."""
        amplitudes, frequencies, _ = self.parameters.harmonics
        acting = [w for f, w in zip(amplitudes, frequencies, strict=True) if f]
        end = 20.0 / max(self.parameters.omega, *acting, 1.0)
        end = min(end, 500.0 / self.control.gap_control_rate)
        rig = Rig(self.parameters, self.initial, control=self.control, compiled=compiled)
        run = rig.run(end, [end / 3, end / 2], most_events=200)
        # As text, in which NaN equals itself
        return [repr(v) for v in (rig.snapshot(), run.samples.tolist(), run.events.tolist())]

    def check(self):
        plain = self.run(compiled=False)
        assert 'nan' not in plain[1]
        if has_numba():
            assert self.run(compiled=True) == plain


@pytest.mark.parametrize('name', NAMES)
def test_one_value(name):
    spec = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}[name]
    for k, value in enumerate(values_of(spec)):
        laws = LAWS[1:3] if name in GAP_CONTROL_SPECS else LAWS[2 * (k % 2) :: 2][:1]
        for law in laws:
            tables = Tables(0.01, law)
            tables.set(name, value)
            tables.check()


@given(seed=st.integers(0, 10**9))
def test_several_values(seed):
    draw = random.Random(seed)
    tables = Tables(draw.choice([0.0, 0.01]), draw.choice(LAWS))
    specs = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
    for name in draw.sample(NAMES, draw.randint(2, 4)):
        tables.set(name, draw.choice(values_of(specs[name])))
    tables.check()


#: A rig in which most parameters act.
BUSY = {
    'base_amplitudes': 0.1,
    'base_frequencies': 30.0,
    'multisine_level': 0.5,
    'multisine_low': 10.0,
    'multisine_high': 60.0,
    'sweep_mode': 'up',
    'sweep_low': 25.0,
    'sweep_high': 40.0,
    'sweep_step': 0.5,
    'sweep_dwell': 0.05,
}


@given(seed=st.integers(0, 10**9))
def test_two_ends_of_ranges(seed):
    """Each pair is a motion, or has a reason not to be one, in 2 s of processor."""
    draw = random.Random(seed)
    tables = Tables(0.01, draw.choice(LAWS))
    if draw.random() < 0.5:
        tables.parameters = BENCH.replace(**BUSY)
    specs = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
    for name in draw.sample(NAMES, 2):
        tables.set(name, draw.choice([specs[name].low, specs[name].high, 1e-300]))
    begin = time.process_time()
    tables.run(compiled=False)
    assert time.process_time() < begin + 2.0


def test_a_speed_below_the_normal_floats_is_searched():
    """A step of the search to its reversal was below round-off, and never got on."""
    rig = Rig(
        RigParameters(),
        InitialConditions(initial_primary_position=0.01, initial_damper_velocity=-5e-324),
    )
    rig.advance(10.0)
    assert rig.time == 10.0
