"""A rig in a line: in hertz, with the slip of unit that a frequency may be."""

import math

import pytest
from rigs import BENCH

from impact_damper_ros import RigParameters, load_parameters
from impact_damper_ros.parameters.description import describe_rig, frequency_hint
from impact_damper_ros.parameters.parameters_file import presets
from impact_damper_ros.parameters.quoting import printable, quote


def test_line_in_hertz_and_shares():
    assert describe_rig(BENCH.replace(force_frequencies=5.0)) == (
        'natural frequency 5.00 Hz (31.42 rad/s), ζ 1.00 %; force 1.2 N at 0.796 Hz (5 rad/s), '
        '0.159 times the natural one; gap 0.024 m; horizontal, friction 0.02'
    )


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'angle': math.pi / 4, 'friction': 0.5}, 'inclined by 45°, friction 0.5'),
        ({'one_sided': True}, 'gap 0.024 m, stop 1 only'),
        ({'force_amplitudes': 0.0}, 'no force'),
        ({'force_frequencies': 0.0}, 'force 1.2 N with frequency 0'),
        (
            {'force_amplitudes': (1, 2), 'force_frequencies': (30, 60), 'force_phases': (0, 0)},
            'force 1 N at 4.77 Hz (30 rad/s), 0.955 times the natural one; and 1 harmonic more',
        ),
        (
            {'sweep_mode': 'up_down', 'sweep_low': 25.13, 'sweep_high': 37.7},
            'stepped up and down from 4.00 Hz to 6.00 Hz, 0.8 to 1.2 times the natural one',
        ),
        (
            {
                'sweep_mode': 'down',
                'sweep_low': 25.13,
                'sweep_high': 37.7,
                'force_amplitudes': 0.0,
                'base_amplitudes': '0.1 g',
            },
            'base moved by 0.9807 m/s^2 = 0.1 g stepped down from 4.00 Hz to 6.00 Hz, 0.8 to',
        ),
        *(
            (
                {
                    f'base_{name}': (value,) * count
                    for name, value in (('amplitudes', 1.0), ('frequencies', 9.0), ('phases', 0.0))
                },
                f'and {count - 1} {words} more of the base',
            )
            for count, words in ((2, 'line'), (3, 'lines'))
        ),
        (
            {'multisine_level': 0.5, 'multisine_low': 18.85, 'multisine_high': 43.98},
            'multisine 0.5 N rms from 3.00 Hz to 7.00 Hz, 0.6 to 1.4 times the natural one',
        ),
    ],
)
def test_line_names_what_is_out_of_the_ordinary(changes, words):
    assert words in describe_rig(BENCH.replace(**changes))


@pytest.mark.parametrize('factor', [0.93, 1.0, 1.07])
def test_hint_at_hertz(factor):
    """A frequency near the resonance, in Hz; and one multiplied by 2 pi once too often."""
    meant = factor * BENCH.omega
    hint = frequency_hint(BENCH.replace(force_frequencies=meant / math.tau))
    assert 'frequencies are in rad/s' in hint
    assert hint.endswith(f'give {meant:.6g}')
    hint = frequency_hint(BENCH.replace(force_frequencies=meant * math.tau))
    assert hint.endswith(f'if the resonance was meant, give {meant:.6g}')


@pytest.mark.parametrize('share', [0.25, 0.5, 0.9, 1.0, 1.02, 2.0, 3.0, 0.05, 7.5, 1 / 7.5])
def test_no_hint_elsewhere(share):
    assert frequency_hint(BENCH.replace(force_frequencies=share * BENCH.omega)) == ''


def test_hint_once_a_change_of_the_frequency():
    """Not at each change of the spring or of anything else."""
    meant, other = ({'force_frequencies': f * BENCH.omega / math.tau} for f in (1.0, 1.03))
    rig = BENCH.replace(**meant)
    assert frequency_hint(rig, BENCH)
    for change in ({'gap': 0.02}, {'stiffness': 1.01 * BENCH.stiffness}):
        assert frequency_hint(rig.replace(**change))
        assert frequency_hint(rig.replace(**change), rig) == ''
    assert frequency_hint(rig.replace(**other), rig)


def test_hint_at_bands():
    swept = {'sweep_mode': 'up', 'sweep_low': 4.0, 'sweep_high': 6.0}
    hint = frequency_hint(BENCH.replace(**swept))
    assert hint.startswith('sweep_low and sweep_high are 4 to 6 rad/s')
    noise = BENCH.replace(multisine_level=1.0, multisine_low=3.0, multisine_high=7.0)
    assert frequency_hint(noise).startswith('multisine_low and multisine_high are 3 to 7 rad/s')
    # What exerts no force has no frequency
    assert frequency_hint(BENCH.replace(force_frequencies=5.0, force_amplitudes=0.0)) == ''
    # As if only the amplitudes had been given
    two = {'force_amplitudes': (1.2, 2.0), 'force_phases': (0.0, 0.0)}
    hint = frequency_hint(BENCH.replace(force_frequencies=(BENCH.omega, 0.0), **two))
    assert hint.startswith('harmonic 2 of the force has the amplitude 2 N, but')
    assert frequency_hint(BENCH.replace(force_frequencies=(BENCH.omega, 3.0), **two)) == ''


def test_no_hint_at_the_presets():
    for name in presets():
        assert frequency_hint(load_parameters(name)[0]) == ''


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        ('short', "'short'"),
        ('\x1b[2J\n\t', r"'\x1b[2J\n\t'"),
        (3.5, '3.5'),
        ('\u202egpj.exe', r"'\u202egpj.exe'"),
    ],
)
def test_values_in_messages(value, text):
    assert quote(value) == text


@pytest.mark.parametrize(
    'value', ['x' * 10**6 + 'end', ['y'] * 10**5, {'a': 'z' * 300}, b'b' * 10**5]
)
def test_long_values_are_cut(value):
    text = quote(value)
    assert len(text) < 120
    assert 'characters' in text
    assert text[:4] == repr(value)[:4]
    assert not text.startswith("'x") or text.endswith("xend'")


def test_printable_keeps_lines():
    assert printable('two\nlines\tand é θ \x1b]0;x\x07\x9b31m') == (
        'two\nlines\tand é θ \\x1b]0;x\\x07\\x9b31m'
    )


def test_a_number_of_more_digits_than_python_writes():
    assert quote(10**5000) == 'int of too many digits'


def test_a_frequency_of_the_base_in_hertz():
    rig = RigParameters.of_structure(
        primary_mass=5.0,
        natural_frequency=10.0,
        damping_ratio=0.02,
        force_amplitudes=0.0,
        base_amplitudes='0.2 g',
        base_frequencies=10.0,
    )
    hint = frequency_hint(rig)
    assert hint.startswith('base_frequencies is 10 rad/s, about 1/(2π) times the natural')
    assert hint.endswith('if Hz were meant, give 62.8319')
    assert not frequency_hint(rig.with_first_frequency(44.0))
