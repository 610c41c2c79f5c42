"""What is refused: the one who asked is named, with the value, and what to give instead."""

import json
import math
from math import inf, nan

import pytest

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    LawError,
    Order,
    OwnLaw,
    ParameterError,
    Rig,
    RigParameters,
    run_ensemble,
)
from impact_damper_ros.parameters.all_parameters import ALL_SPECS

LEVEL = RigParameters(gravity=0.0)
FREE = LEVEL.replace(gap=1000.0, force_amplitudes=(0.0,))
EXTERNAL = GapControlParameters(gap_control='external', actuator_speed=4.0)
TWO, THREE = [1.0, 2.0], {'force_frequencies': [1, -1], 'force_phases': [0, 0]}
NOISE = {'multisine_level': 0.1}
BEYOND_FLOATS = 10**400
BAD_TIMES = (nan, inf, -inf, 1e300, 1.1e13, BEYOND_FLOATS, None, 'x', 3 + 0j, [1.0])


def table(cls, parts, **values):
    return parts, lambda _: cls(**values)


def rig(*parts, **values):
    return table(RigParameters, parts, **values)


def control(*parts, **values):
    return table(GapControlParameters, parts, **values)


def ordered(words, **values):
    return (words,), lambda one: one.order(Order(**values))


def ensemble(words, values, settings=None, offset=0.0, **changes):
    parameters = RigParameters(**changes)
    start = InitialConditions(initial_damper_offset=offset)
    return (words,), lambda _: run_ensemble(
        parameters, values, 10.0, control=settings, initial=start
    )


def typed(name, text, unit, words):
    return (f'{name} is ', words), lambda _: ALL_SPECS[name].read(text, unit)


def law(text, words):
    return (text, words), lambda _: OwnLaw.from_text(text)


#: Parts of what is said, with the parameter that is blamed in the first; and what was tried, with
#: a rig under external control.
REFUSED = [
    # What holds between parameters; the range of each is tested in test_parameters
    rig('force_frequencies', '2 entries', 'has 1', force_frequencies=TWO),
    rig('force_frequencies', '[1] is -1.0', force_amplitudes=[1, 1], **THREE),
    rig('damping', 'underdamped, give at most 1.9998', damping=1.99981),
    rig(
        'multisine_high 1.5 rad/s',
        *('multisine_low is 2 rad/s (0.31831 Hz)', 'more than 2', 'both'),
        **NOISE,
        multisine_low=2.0,
    ),
    rig(
        'sweep_high 0.5 rad/s',
        *('sweep_low is 0.5 rad/s', 'less than 0.5'),
        sweep_mode='up',
        sweep_high=0.5,
    ),
    rig(
        'sweep_step is 1e-06 rad/s',
        *('1e+06 steps', 'at least 1e-05 rad/s'),
        sweep_mode='down',
        sweep_step=1e-6,
    ),
    rig(
        'sweep_step is 1e-06 rad/s',
        *('5.493e+05 steps', 'at least 5.49e-06 rad/s'),
        sweep_mode='up',
        sweep_spacing='logarithmic',
        sweep_step=1e-6,
    ),
    rig(
        'sweep_rate is 2.0 octaves a minute',
        *('sweep_spacing linear', 'give sweep_spacing logarithmic'),
        sweep_mode='up',
        sweep_rate=2.0,
    ),
    rig(
        'sweep_notch_frequencies has 1 entries and sweep_notch_factors 2',
        sweep_mode='up',
        sweep_notch_factors=[1.0, 0.5],
    ),
    rig(
        'sweep_notch_frequencies[1] is 1.0 rad/s, after 2.0 rad/s: give rising frequencies',
        sweep_mode='up',
        sweep_notch_factors=[1.0, 0.5],
        sweep_notch_frequencies=[2.0, 1.0],
    ),
    rig(
        *('base_amplitudes[0] is 1000000.0', 'at 0.0001 rad/s', 'pulls M by 1e+14 N'),
        force_amplitudes=0.0,
        base_amplitudes=5e5,
        sweep_mode='up',
        sweep_low=1e-4,
        sweep_notch_factors=[1.0, 2.0],
        sweep_notch_frequencies=[1.0, 2.0],
    ),
    control('gap_min', 'gap_max', 'below', gap_min=0.5, gap_max=0.5),
    control('gap_min', '2.0', 'both at once', gap_min=2.0, gap_max=1.0),
    control('gap_control_seed', 'from 0 to 2147483647', gap_control_seed=2**31),
    (('gapp is not a parameter of the rig',), lambda _: LEVEL.replace(gapp=1.0)),
    # Each value is in its range, but not beside the others.
    (('damping',), lambda _: RigParameters(damping=1.5).replace(stiffness=0.1)),
    (('friction',), lambda _: LEVEL.replace(gap=10.0, friction=-1.0)),
    *(
        (
            ('initial_damper_offset', 'from -1 to 1 m'),
            lambda _, y=y: InitialConditions(initial_damper_offset=y).check_within(
                RigParameters(gap=2.0)
            ),
        )
        for y in (math.nextafter(1.0, 2.0), math.nextafter(-1.0, -2.0))
    ),
    # What a person types
    typed('gap', 'abc', 'mm', "'abc': give a number from 1e-06 to 1e+12 mm"),
    typed('gap', '1,000', 'mm', "'1,000': write 1.000 or 1000"),
    typed('gap', '3 inch', 'mm', "'3 inch': 'inch' is no unit of it: write m, cm, mm, µm, um"),
    *(
        typed('force_amplitudes', text, '', f'write {points}, with a decimal point, or {listed}')
        for text, points, listed in (
            ('2,5', '2.5', '2; 5 for 2 numbers'),
            ('-2,5 N', '-2.5 N', '-2; 5 N for 2 numbers'),
            ('1,5 N, 2,5 N', '1.5 N; 2.5 N', '1; 5 N; 2; 5 N for 4 numbers'),
        )
    ),
    *(
        typed('force_amplitudes', text, '', f'{bare} has no unit, as others have')
        for text, bare in (('[1,5 N, 2,5 N]', 1), ('1,50 N, 2 N', 1))
    ),
    typed('max_bag_size', '3 kB', '', '3.0 kB: give 0 (no limit) or a number from 100 to 1e+12'),
    # Times: a control that was begun at 1e300 s once sought its next sample for ever.
    *(
        (
            ('cannot start at', 'give a number from -1e+13 to 1e+13'),
            lambda _, t=t: Rig(LEVEL, time=t),
        )
        for t in BAD_TIMES
    ),
    *((('cannot advance to', 'give a'), lambda one, t=t: one.advance(t)) for t in BAD_TIMES),
    *((('cannot advance to', 'give a'), lambda one, t=t: one.run(t)) for t in BAD_TIMES),
    *(
        ((f'{name} is {most!r}: give a number from 0 on',), call)
        for most in (nan, -1, -inf)
        for name, call in (
            ('most_in_period', lambda one, most=most: one.advance(9.0, most_in_period=most)),
            ('most_events', lambda one, most=most: one.run(9.0, most_events=most)),
        )
    ),
    (('instants are', ': give'), lambda one: one.run(1.0, BEYOND_FLOATS)),
    # Places of the stops
    (
        (' is ', 'a number from -1e+09 to 1e+09 m'),
        lambda _: Rig(LEVEL).move_stops(BEYOND_FLOATS, None),
    ),
    ((' is ', ': give'), lambda _: Rig(LEVEL).move_stops(1.0, None, None)),
    ordered('half of gap_max, 500 m', stop_1=600.0),
    ordered('above stop_2', stop_1=-500.0),
    ordered('stop_1 at 1 m and stop_2 at 2 m', stop_1=1.0, stop_2=2.0),
    ordered('speed_1 is -1.0', stop_1=1.0, speed_1=-1.0),
    ordered('stop_1 is inf', stop_1=inf),
    ordered('force is inf', force=inf),
    *(
        (
            ('set gap_control to external',),
            lambda _, mode=mode: Rig(FREE, control=GapControlParameters(gap_control=mode)).order(
                Order(force=1.0)
            ),
        )
        for mode in ('off', 'timed')
    ),
    (
        ('one-sided',),
        lambda _: Rig(FREE.replace(one_sided=True), control=EXTERNAL).order(Order(stop_2=-1.0)),
    ),
    (
        ('initial_damper_offset',),
        lambda one: one.reset(InitialConditions(initial_damper_offset=501.0)),
    ),
    # Ensembles
    ensemble('gap is -2.0', {'gap': [1.0, -2.0]}),
    ensemble('gap is nan', {'gap': [1.0, nan]}),
    ensemble(
        'damping is 1.9 N s/m, a damping ratio of 1.344: the rig must be underdamped',
        {'damping': [0.1, 1.9], 'stiffness': [1.0, 0.5]},
    ),
    ensemble('force_amplitudes does not vary in this', {'force_amplitudes': [1.0, 2.0]}),
    ensemble('lists of one length', {'gap': [1.0, 2.0], 'angle': [0.1]}),
    ensemble('lists of one length', {'gap': 1.0}),
    ensemble('at least one parameter', {}),
    ensemble(
        "sweep_mode is 'up': an ensemble has no stepped sine", {'gap': [1.0]}, sweep_mode='up'
    ),
    ensemble('gap_min does not vary in this ensemble', {'gap_min': [1.0, 2.0]}),
    ensemble('initial_damper_offset', {'gap': [9.0, 3.0, 8.0]}, offset=2.0),
    ensemble(
        'gap_min', {'gap_min': [1.0, 3.0]}, GapControlParameters(gap_control='timed', gap_max=3.0)
    ),
    ensemble(
        'gap_control_rate is -1',
        {'gap_control_rate': [10.0, -1.0]},
        GapControlParameters(gap_control='timed'),
    ),
    # Laws of one's own
    law('follow', 'give MODULE:FUNCTION'),
    law('no_such_module:law', "No module named 'no_such_module'"),
    law('control.laws:missing', 'has no missing'),
    law('control.laws:number', 'is 3: give the name of a function'),
    law('control.laws:one_argument', 'define it as law(seen, memory)'),
    # Snapshots
    *((('snapshot',), lambda _, held=held: Rig.restore(held)) for held in (None, [], 'x', 5, {})),
]


@pytest.mark.parametrize('case', range(len(REFUSED)), ids=lambda k: f'{k}: {REFUSED[k][0][0]}')
def test_refused(case):
    """And the rig stays as it was."""
    words, tried = REFUSED[case]
    one = Rig(FREE, control=EXTERNAL)
    before = one.snapshot()
    with pytest.raises(ValueError) as caught:
        tried(one)
    for part in words:
        assert part in str(caught.value)
    if isinstance(caught.value, ParameterError) and caught.value.name in ALL_SPECS:
        assert caught.value.name in words[0] + words[-1]
    assert one.snapshot() == before


def test_numbers_of_a_force_that_is_off_can_be_set_one_by_one():
    RigParameters(multisine_low=2.0)
    RigParameters(sweep_high=0.5)
    RigParameters(sweep_step=1e-6)
    RigParameters(sweep_rate=2.0, sweep_notch_factors=[1.0, 0.5])


@pytest.fixture(scope='module')
def snapshot():
    """Return a snapshot of a rig that has everything."""
    parameters = LEVEL.replace(sweep_mode='up', multisine_level=0.1, multisine_lines=3)
    timed = {'gap_control': 'timed', 'gap_control_rate': 5.0}
    control = GapControlParameters(**timed, actuator_speed=1.0, actuator_delay=0.3)
    one = Rig(parameters, control=control)
    one.advance(137.3)
    return json.dumps(one.snapshot())


#: What a snapshot cannot hold, and what is said of it; some once kept a rig busy for ever.
STATES = [
    ('time', nan, 'time is nan: give a number from'),
    ('time', 1e300, 'time is 1e+300: give a number from -1e+13 to 1e+13'),
    ('origin', None, 'snapshot is not complete'),
    ('origin.time', -1e18, 'origin.time is -1e'),
    ('origin.time', 1e9, 'origin.time is 1000000000.0 s, after time, 137.3 s'),
    ('origin.time_low', nan, 'origin.time_low is nan: give a number from -1 to 1'),
    ('origin.time_low', -1e18, 'origin.time_low is -1e'),
    ('origin.x', None, 'origin.x is None'),
    ('origin.x', 1e300, 'origin.x is 1e+300: give a number from -1e+100 to 1e+100'),
    ('origin.velocity', inf, 'origin.velocity is inf: give a number from'),
    ('origin.clearance_1', -1e-9, 'origin.clearance_1 is -1e-09: give a number from 0 to'),
    ('origin.side', nan, 'origin.side is nan: give a whole number from -1 to 1'),
    ('origin.mode', 99, 'origin.mode is 99: give a whole number from 0 to'),
    ('origin.angles', [], 'origin.angles has 0 entries, the force has 4 harmonics'),
    ('sweep.start', nan, 'sweep.start is nan: give a number from'),
    ('sweep.start', -1e9, 'sweep.due is 200.0 s: it must be at most 161.9'),
    ('sweep.due', nan, 'sweep.step is 1, from 100.0 s to nan s'),
    ('sweep.due', 130.0, 'sweep.step is 1, from 100.0 s to 130.0 s: it must be the one at time'),
    ('sweep.due', 1e9, 'sweep.due is 1000000000.0 s: it must be at most'),
    ('sweep.due', None, 'sweep.due is inf s at step 1 of 100'),
    ('sweep.due', 1e300, 'sweep.due is 1e+300 s: it must be at most'),
    ('sweep.step', -(2**62), 'sweep.step is -4611686018427387904: give a whole number from 0'),
    ('sweep.step', 1.5, 'sweep.step is 1.5: give a whole number'),
    ('gap_control.state.sample_index', -(2**62), 'sample_index is -4611686018427387904, a'),
    ('gap_control.state.sample_index', 2**64, 'sample_index is 18446744073709551616: give'),
    ('gap_control.state.sample_index', nan, 'sample_index is nan: give a whole'),
    ('gap_control.state', {}, 'sample_index'),
]


@pytest.mark.parametrize(('path', 'value', 'words'), STATES)
def test_a_state_that_no_rig_can_have(snapshot, path, value, words):
    held = part = json.loads(snapshot)
    *names, last = path.split('.')
    for name in names:
        part = part[name]
    part[last] = value
    with pytest.raises(ValueError) as caught:
        Rig.restore(held)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ('code', 'words'),
    [
        ('import sys; sys.exit(4)', 'SystemExit: 4'),
        ('raise AttributeError("mine")', 'AttributeError: mine'),
        ('def f(:', 'SyntaxError: invalid syntax'),
    ],
)
def test_a_module_that_cannot_be_imported(tmp_path, monkeypatch, code, words):
    """The first once ended the command without a word, the second was taken for a missing name."""
    name = f'law_{len(code)}'
    (tmp_path / f'{name}.py').write_text(code)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LawError, match=f'the law {name}:law: {words}'):
        OwnLaw.from_text(f'{name}:law')
