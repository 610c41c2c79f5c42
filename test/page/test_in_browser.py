"""The rig that a browser computes, in Node: its motion and theory against CPython's."""

import gzip
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import impact_damper_ros
from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.page import knobs
from impact_damper_ros.page.motion import MotionHistory, Stretch
from impact_damper_ros.page.numbers import numbers_of
from impact_damper_ros.page.presets import load_presets
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.quoting import similar_names
from impact_damper_ros.theory.expected_motion import predictions, run_ahead
from impact_damper_ros.theory.gap_curve import follow_gap
from impact_damper_ros.theory.motion_curve import orbit_curve
from page.compared_rigs import COMPARE, disagreements, preset_cases, random_cases
from page.javascript import JavaScript
from page.translated_examples import EXAMPLES

ROOT = Path(impact_damper_ros.__file__).parents[1]
if not (ROOT / 'docs' / 'in_browser').is_dir():
    pytest.skip('the documentation is not here', allow_module_level=True)
sys.path.append(str(ROOT / 'docs'))
from in_browser.translation import TranslationError, Translator  # noqa: E402

#: Largest size of what a browser loads, bytes.
LARGEST = 220_000


# The motion


@pytest.fixture(scope='module')
def bare(site):
    """Return a console with the rig."""
    console = JavaScript(site / 'rig.js')
    yield console
    console.close()


def compared(console, cases):
    """Return how far the events of cases agree, by name."""
    names = list(cases)
    results = console.evaluate(COMPARE, [cases[name] for name in names])
    return dict(zip(names, results, strict=True))


@pytest.fixture(scope='module')
def random():
    return dict(enumerate(random_cases(60)))


def test_random_rigs_have_every_event(bare, random):
    found = compared(bare, random)
    wrong, chaotic = disagreements(random, found)
    assert wrong == []
    assert len(chaotic) <= 1
    agreeing = [one for name, one in found.items() if name not in chaotic]
    assert sum(one['expected'] for one in agreeing) > 1000
    assert max(one['late'] for one in agreeing) < 1e-8
    assert max(one['constants'] for one in found.values()) < 4e-15
    # All parts of a rig are among them.
    assert {case['control']['gap_control'] for case in random.values()} == {
        *('off', 'amplitude', 'timed')
    }
    assert any(any(case['rig']['base_amplitudes']) for case in random.values())


def test_presets_have_every_event(bare):
    cases = preset_cases(seconds=8.0)
    found = compared(bare, cases)
    wrong, chaotic = disagreements(cases, found)
    assert wrong == []
    assert len(chaotic) <= 3
    assert set(load_presets()) <= set(found) - set(chaotic) | {'chaos'}


@pytest.mark.parametrize(
    ('right', 'wrong'),
    [
        # The impulse on M, and the direction of friction
        ('(velocity + ((share', '(velocity - ((share'),
        ('(constants.slope - (direction', '(constants.slope + (direction'),
    ],
)
def test_a_wrong_sign_is_noticed(site, random, tmp_path, right, wrong):
    text = (site / 'rig.js').read_text(encoding='utf-8')
    assert text.count(right) == 1
    place = tmp_path / 'wrong.js'
    place.write_text(text.replace(right, wrong), encoding='utf-8')
    console = JavaScript(place)
    some = compared(console, {name: random[name] for name in range(20)}).values()
    console.close()
    agree = [one for one in some if one['agree'] == one['events'] == one['expected']]
    assert len(some) - len(agree) > 3


#: What is typed into a knob, and in which unit it is shown.
TYPED = [
    *(
        ('gap', text, 'mm')
        for text in ('12', '2,5', '1,234', '1 cm', '3 N', '-3', '0', 'wide', '')
    ),
    *(('gap', text, 'm') for text in ('1e10', '24.5 mm', '5e-10', '1e-3', 'nan')),
    *(('force_frequencies', text, 'Hz') for text in ('5', '[1; 2 Hz]', '1;2', '1,2', '[300 rpm]')),
    *(('angle', text, '°') for text in ('10', '91', '0.1 rad', '10 deg')),
    ('base_amplitudes', '0.2 g', 'm/s^2'),
    ('multisine_lines', '2.5', ''),
    ('restitution_1', '75 %', ''),
    ('actuator_speed', '1e-7', 'm/s'),
    ('real_time_factor', '1e-5', ''),
]


def test_what_is_typed_is_read_and_refused_as_by_the_package(bare):
    requests = [{name: {'text': text, 'unit': unit}} for name, text, unit in TYPED]
    found = bare.evaluate(
        """(requests) => requests.map((one) => {
          try { return impactDamperRig.read_values(one); } catch ({ message }) { return message; }
        })""",
        requests,
    )
    expected = []
    for request in requests:
        try:
            expected.append(knobs.read_values(request))
        except knobs.RequestError as error:
            expected.append(str(error))
    assert found == expected
    assert len({one for one in expected if isinstance(one, str)}) > 8


def test_names_that_are_no_parameter_are_named_as_by_the_package(bare):
    """In a link; also what only the package has."""
    names = [
        *('gapp', 'gab', 'restitution', 'frcition', 'force_amplitude', 'stifness', 'mass', 'x'),
        *('inital_damper_velocity', 'gap_control_gian', 'friktion', 'colour', 'recrod', 'Gap'),
    ]
    elsewhere = ['record', 'natural_frequency']
    bare.evaluate(
        """(names) => {
          globalThis.reasons = [];
          const socket = rigInPage();
          socket.onmessage = ({ data }) => {
            const { type, reason } = typeof data === 'string' ? JSON.parse(data) : {};
            if (type === 'answer') reasons.push(reason);
          };
          for (const name of names) {
            socket.send(JSON.stringify({ type: 'begin', id: name, values: { [name]: 0.03 } }));
          }
          queueMicrotask(() => socket.close());
        }""",
        [*names, *elsewhere],
    )
    found = bare.evaluate('reasons')
    for name, reason in zip(names, found, strict=False):
        near = similar_names(name, ALL_SPECS)
        hint = (
            f'did you mean {near}?' if near else 'the documentation has a table of all parameters'
        )
        assert reason == f'{name} is not a parameter of this rig: {hint}'
    assert found[len(names) :] == [f'{name} needs the installed package' for name in elsewhere]
    assert 'did you mean gap?' in found[0]


def test_rigs_that_no_rig_can_be_are_refused_as_by_the_package(bare):
    changes = [
        {'damping': 1e3},
        {'force_amplitudes': [1.0, 2.0]},
        {'base_amplitudes': [1.0], 'base_frequencies': [0.0]},
        {'sweep_mode': 'up', 'sweep_step': 1e-9},
        {'sweep_mode': 'up', 'sweep_low': 2.0, 'sweep_high': 1.0},
        {'gap': True},
        {'one_sided': 'yes'},
        {'sweep_mode': 'sideways'},
    ]
    found = bare.evaluate(
        """(changes) => changes.map((one) => {
          const rig = new impactDamperRig.RigParameters();
          try { return rig.replace(one); } catch ({ message }) { return message; }
        })""",
        changes,
    )
    expected = []
    for change in changes:
        with pytest.raises(ParameterError) as error:
            RigParameters().replace(**change)
        expected.append(str(error.value))
    assert found == expected


def test_key_numbers_are_those_of_the_package(bare):
    preset = load_presets()['bench']
    rig = Rig(preset.rig, preset.initial, control=preset.control)
    run = rig.run(8.0, instants=np.arange(1, 1601) / 200)
    stretch = Stretch(0, 0, preset.rig, None)
    motion = MotionHistory(10_000, 10_000)
    motion.add_samples(stretch.sample_rows(run.samples))
    motion.add_impacts(stretch.impact_rows(run.events))
    found = bare.evaluate(
        """([samples, impacts]) => {
          const { presets, numbers_of, Matrix } = impactDamperRig;
          const table = (rows) => new Matrix([rows.length, rows[0].length], rows.flat());
          const acts = new Matrix([0, 6], []);
          const motion = { samples: table(samples), impacts: table(impacts), acts };
          return numbers_of(presets.bench.rig, motion, 8);
        }""",
        [motion.samples.tolist(), motion.impacts.tolist()],
    )
    expected = numbers_of(preset.rig, motion, 8.0)
    score = found.pop('score')
    assert score == pytest.approx(expected.pop('score'), rel=1e-12)
    assert found.pop('type') == expected.pop('type')
    assert found == pytest.approx(expected, rel=1e-12)
    assert found['impacts_per_cycle'] == 2.0


@pytest.mark.parametrize('name', EXAMPLES)
def test_translated_python_does_the_same(bare, name):
    runtime = (ROOT / 'docs' / 'in_browser' / 'runtime.js').read_text(encoding='utf-8')
    text = Translator(runtime).program({name: EXAMPLES[name]}, {})
    found = bare.evaluate(f'(() => {{\n{runtime}\n{text}\nreturn {name}();\n}})()')
    # As JSON has it: no tuples
    assert found == json.loads(json.dumps(EXAMPLES[name]()))


def test_what_has_no_translation_stops_the_build(tmp_path, monkeypatch):
    place = tmp_path / 'strange.py'
    place.write_text('def f(x):\n    y = x\n    return [*y, b""]\n', encoding='utf-8')
    monkeypatch.syspath_prepend(tmp_path)
    import strange

    with pytest.raises(TranslationError, match=r'strange\.py:3: no translation'):
        Translator('').program({'f': strange.f}, {})


# Theory

#: The last answer on a rig, begun from rest.
THEORY = """(values) => {
  const { Rig, RigParameters, theoryOf } = impactDamperRig;
  const parameters = RigParameters.$of(values);
  const { _run: run, _waves: waves } = new Rig(parameters);
  const asked = { parameters, control: 'off', run, angles: waves.map(({ angle }) => angle) };
  return [...theoryOf(asked)].filter(Boolean).at(-1);
}"""
INCLINED = {'primary_mass': 1.0, 'angle': math.pi / 4, 'gravity': 1.0}
RIGS = {
    'horizontal': {'gravity': 0.0},
    'frictionless, inclined': INCLINED | {'force_frequencies': (1.02,)},
    'with friction': INCLINED | {'friction': 0.5, 'force_frequencies': (1.02,)},
    'small gap': {'gravity': 0.0, 'gap': 8.0, 'force_frequencies': (1.02,)},
    'unequal stops': {'gravity': 0.0, 'restitution_1': 0.7, 'force_frequencies': (1.02,)},
    'two harmonics': {
        'gravity': 0.0,
        'force_amplitudes': (1.0, 0.1),
        'force_frequencies': (1.0, 3.0),
        'force_phases': (0.0, 0.5),
    },
    'base': {
        'gravity': 0.0,
        'force_amplitudes': (0.0,),
        'base_amplitudes': (1.0,),
        'base_frequencies': (1.03,),
    },
    # 29 impacts in a cycle; a branch of it ends at a flight before the first impact.
    'steep': load_presets()['bench'].rig.as_dict() | {'angle': 0.9},
}


def alike(found, expected, error=1e-9):
    return np.abs(np.subtract(found, expected)).max() <= error * np.abs(expected).max()


@pytest.mark.parametrize('name', RIGS)
def test_theory_of_any_rig_is_that_of_the_package(bare, name):
    rig = RigParameters(**RIGS[name])
    found = bare.evaluate(THEORY, knobs.as_json(rig.as_dict()))
    motion = found['orbit']
    ahead = run_ahead(Rig(rig))
    assert motion['basis'] == 'run ahead'
    expected = ahead.orbit
    assert expected is not None
    assert tuple(motion['stops']) == expected.stops
    assert motion['cycles'] == expected.cycles
    impacts = [list(one) for one in zip(*(i.values() for i in motion['impacts']), strict=True)]
    assert alike(impacts[0], expected.phases)
    assert alike(impacts[1], expected.x)
    assert alike(impacts[3], expected.primary_velocity_after)
    assert alike(impacts[4], expected.damper_velocity_after)
    assert motion['x_max'] == pytest.approx(expected.x_max, rel=1e-9)
    multipliers = [complex(*one) for one in motion['multipliers']]
    assert multipliers == pytest.approx(expected.multipliers, abs=1e-9)
    curve = orbit_curve(expected)
    at = np.interp(expected.phases[0] + 0.1, curve[:, 0], curve[:, 1])
    phase = (expected.phases[0] + 0.1) % expected.cycles
    assert np.interp(phase, motion['phase'], motion['x']) == pytest.approx(at, rel=1e-9)
    # The branch of that motion, point by point
    branch = follow_gap(expected).branch
    own = next(
        one
        for one in found['gap_curve']['branches']
        if one['gap'] == pytest.approx(branch.values, rel=1e-9)
    )
    # At a fold last digits of the gap are more of the motion.
    assert alike(own['x_max_ratio'], [orbit.x_max_ratio for orbit in branch.orbits], 1e-7)
    assert own['stable'] == [orbit.stable for orbit in branch.orbits]
    assert own['viable'] == [orbit.viable for orbit in branch.orbits]
    special = {(one['kind'], round(one['gap'], 6)) for one in found['gap_curve']['special']}
    viable = [one for one in branch.special if one.orbit.viable]
    assert {(one.kind.value, round(one.value, 6)) for one in viable} <= special


REFUSED = [
    ({'force_amplitudes': [0.0]}, 'no force acts'),
    ({'sweep_mode': 'up'}, 'sweep_mode'),
    (
        {
            'force_amplitudes': [1, 1],
            'force_frequencies': [1, math.sqrt(2)],
            'force_phases': [0, 0],
        },
        'a whole number',
    ),
]


@pytest.mark.parametrize(('values', 'text'), REFUSED)
def test_rigs_without_theory_have_the_reason_of_the_package(bare, values, text):
    rig = RigParameters(**values)
    found = bare.evaluate(THEORY, knobs.as_json(rig.as_dict()))
    (expected,) = predictions(Rig(rig))
    assert found['theory_failed'] == {'type': 'theory_failed', 'text': expected.reason}
    assert text in expected.reason


def test_the_folder_is_small(site):
    size = sum(len(gzip.compress(path.read_bytes())) for path in site.iterdir())
    assert size < LARGEST
