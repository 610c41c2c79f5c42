"""Each preset does what its description says."""

import math
import re

import numpy as np
import pytest

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    Rig,
    RigParameters,
    find_orbits,
    settle,
)
from impact_damper_ros.page.presets import load_presets, preset_with

PRESETS = load_presets()
#: Of the rigs that settle: stops of a period of one cycle, and Xmax/A.
SETTLED = {
    'bench': ((1, 2), 0.107195),
    'paper': ((1, 2), 0.104644),
    'figure_2_incline': ((1, 2), 0.211344),
    'figure_2_three': ((1, 2, 2), 0.3724),
    'figure_2_four': ((1, 1, 2, 2), 0.4316),
    'figure_5_best_gap': ((1, 2), 0.03114),
    'bouncing_ball': ((1,), 1.0),
    'boring_bar': ((1, 2), 0.0879),
    'light_pole': ((1, 2), 0.1121),
}


def test_all_are_there_with_words():
    assert set(SETTLED) | {'ring_down', 'conveyor', 'chaos', 'control_changing_load'} == set(
        PRESETS
    )
    for preset in PRESETS.values():
        assert preset.title
        assert preset.description.endswith('.')
        assert re.fullmatch('[a-z0-9_]+', preset.name)
        assert '\n' not in preset.description


@pytest.mark.parametrize('name', PRESETS)
def test_a_sweep_and_a_multisine_are_about_the_resonance(name):
    rig = PRESETS[name].rig.replace(sweep_mode='up')
    for low, high in ((rig.sweep_low, rig.sweep_high), (rig.multisine_low, rig.multisine_high)):
        assert 0.45 * rig.omega < low < 0.9 * rig.omega < 1.1 * rig.omega < high < 1.6 * rig.omega
    assert rig.base_frequencies == pytest.approx([rig.omega], rel=1e-3)
    assert 10.0 < rig.sweep_dwell * rig.omega / math.tau < 60.0


@pytest.mark.parametrize('name', SETTLED)
def test_settled_rigs(name):
    preset, (stops, ratio) = PRESETS[name], SETTLED[name]
    found = settle(Rig(preset.rig, preset.initial, control=preset.control))
    turned = [stops[k:] + stops[:k] for k in range(len(stops))]
    assert found.rhythm.stops in turned
    assert found.rhythm.cycles == 1
    assert found.x_max / preset.rig.response_amplitude == pytest.approx(ratio, rel=0.01)


def test_paper_rigs_are_those_of_the_paper():
    """In other units: the ratios are the paper's."""
    basic = RigParameters(gravity=1.0)
    for name, changes in {
        'paper': {},
        'figure_2_incline': {
            'angle': math.pi / 4,
            'friction': 0.5,
            'force_frequencies': (1.02,),
        },
        'figure_2_three': {'gap': 18.0, 'force_frequencies': (1.02,)},
        'figure_2_four': {'gap': 8.0, 'force_frequencies': (1.02,)},
        'figure_5_best_gap': {'gap': 55.0},
    }.items():
        rig, paper = PRESETS[name].rig, basic.replace(**changes)
        for ratio in (
            lambda r: r.frequency_ratio,
            lambda r: r.zeta,
            lambda r: r.mass_ratio,
            lambda r: r.gap * r.stiffness / r.force_amplitudes[0],
            lambda r: r.gravity * r.primary_mass / r.force_amplitudes[0],
            lambda r: r.friction,
            lambda r: r.angle,
        ):
            assert ratio(rig) == pytest.approx(ratio(paper), rel=1e-6), name
        assert rig.omega == pytest.approx(4 * math.pi)


def test_the_best_gap_is_not_reached_from_rest():
    preset = PRESETS['figure_5_best_gap']
    rig = Rig(preset.rig)
    rig.advance(100.0)
    events = [e for e in rig.advance(110.0) if e.kind is EventKind.IMPACT]
    assert len(events) != 40


def test_bouncing_ball_bounces_high_and_low_in_turn_under_more_force():
    preset = PRESETS['bouncing_ball']
    rig = Rig(preset.rig.replace(force_amplitudes=(1060.0,)), preset.initial)
    rig.advance(60.0)
    speeds = [e.damper_velocity_after for e in rig.advance(62.0) if e.kind is EventKind.IMPACT]
    assert len(speeds) == 10
    assert speeds[0] == pytest.approx(speeds[2], rel=1e-3)
    assert abs(speeds[0] - speeds[1]) > 0.3


def test_ring_down_ends_long_before_that_of_the_dashpot_alone():
    preset = PRESETS['ring_down']
    rig = Rig(preset.rig, preset.initial)
    assert preset.rig.force_amplitudes == (0.0,)
    impacts = [event for event in rig.advance(4.0) if event.kind is EventKind.IMPACT]
    assert len(impacts) > 40
    sample = rig.sample()
    left = math.hypot(sample.x, sample.primary_velocity / preset.rig.omega)
    assert left == pytest.approx(0.001, rel=0.1)
    alone = 0.04 * math.exp(-preset.rig.zeta * preset.rig.omega * 4.0)
    assert alone == pytest.approx(0.011, rel=0.05)
    rig.advance(5.0)
    assert EventKind.IMPACT not in {event.kind for event in rig.advance(30.0)}


def test_conveyor_carries_the_mass_to_stop_1_again_and_again():
    preset = PRESETS['conveyor']
    rig = Rig(preset.rig, preset.initial)
    start = rig.sample().z - rig.sample().x
    events = [e for e in rig.advance(30.0) if e.kind is EventKind.IMPACT]
    assert start == -0.09
    assert len(events) > 10
    assert {event.stop for event in events} == {1}


def test_chaos_never_repeats_and_feels_its_start():
    preset = PRESETS['chaos']
    one = Rig(preset.rig, preset.initial)
    one.advance(20.0)
    state = one.snapshot()
    other = Rig.restore(state)
    other.change(preset.rig.replace(gap=preset.rig.gap * (1 + 1e-9)))
    one.advance(80.0)
    other.advance(80.0)
    assert abs(one.sample().x - other.sample().x) > 1e-4
    impacts = [event for event in one.advance(100.0) if event.kind is EventKind.IMPACT]
    phases = [event.time * 31.416 / math.tau % 1.0 for event in impacts if event.stop == 1]
    assert len({round(phase, 2) for phase in phases}) > 25


def test_control_halves_the_motion_under_the_changing_load():
    preset = PRESETS['control_changing_load']
    largest = []
    for control in (preset.control, GapControlParameters()):
        rig = Rig(preset.rig, preset.initial, control=control)
        cycle = math.tau / preset.rig.force_frequencies[0]
        run = rig.run(200 * cycle, instants=50 * cycle + np.arange(1, 6001) * cycle / 40)
        largest.append(np.abs(run.samples['x']).max())
    assert largest[0] < 0.5 * largest[1]


def test_values_are_complete():
    """So that a preset leaves nothing of the rig before it."""
    values = PRESETS['bench'].values
    names = {*RigParameters().as_dict(), *GapControlParameters().as_dict()}
    assert names < set(values)
    assert sum(name.startswith('initial_') for name in values) == 4
    assert values['force_amplitudes'] == [1.2]


def test_a_rig_is_known_as_a_preset_by_its_values():
    for preset in PRESETS.values():
        values = preset.values
        assert preset_with(values) == preset.title
        # Where it starts is no part of it.
        assert preset_with({**values, 'initial_primary_position': 1.0}) == preset.title
        assert preset_with({**values, 'gap': 1.01 * values['gap']}) == ''
    assert preset_with({}) == ''


def cantilever(modulus, density, moment, area, length, tip=0.0):
    """Return modal mass at the tip, circular frequency and stiffness of a clamped beam."""
    stiffness = 3.0 * modulus * moment / length**3
    if tip:
        # Rayleigh, with the deflection under a force at the tip
        mass = tip + 33.0 / 140.0 * density * area * length
        return mass, math.sqrt(stiffness / mass), stiffness
    rate = 1.875104**2 * math.sqrt(modulus * moment / (density * area)) / length**2
    return stiffness / rate**2, rate, stiffness


def test_the_boring_bar_is_a_steel_bar_slowed_down():
    d, slower = 0.025, 50.0
    mass, rate, stiffness = cantilever(
        206e9, 7850.0, math.pi * d**4 / 64.0, math.pi * d**2 / 4.0, 0.25
    )
    rig = PRESETS['boring_bar'].rig
    assert rate / math.tau == pytest.approx(287.0, rel=2e-3)
    assert rig.primary_mass == pytest.approx(mass, rel=1e-3)
    assert rig.stiffness == pytest.approx(stiffness / slower**2, rel=1e-3)
    assert (rig.zeta, rig.mass_ratio) == pytest.approx((0.01, 0.05), rel=1e-3)
    assert rig.frequency_ratio == pytest.approx(1.0, abs=1e-4)
    assert rig.response_amplitude == pytest.approx(1e-4, rel=1e-3)


def test_the_light_pole_is_a_tube_with_a_luminaire():
    outer, inner = 0.1524, 0.1524 - 2.0 * 0.0048
    mass, rate, stiffness = cantilever(
        *(69e9, 2700.0, math.pi * (outer**4 - inner**4) / 64.0),
        *(math.pi * (outer**2 - inner**2) / 4.0, 8.0, 25.0),
    )
    rig = PRESETS['light_pole'].rig
    assert rate / math.tau == pytest.approx(1.31, rel=2e-3)
    assert rig.primary_mass == pytest.approx(mass, rel=1e-3)
    assert rig.stiffness == pytest.approx(stiffness, rel=1e-3)
    assert (rig.zeta, rig.mass_ratio) == pytest.approx((0.005, 0.03), rel=1e-3)
    assert rig.frequency_ratio == pytest.approx(1.0, abs=1e-4)
    assert rig.response_amplitude == pytest.approx(0.1, rel=1e-2)


@pytest.mark.parametrize('name', ['boring_bar', 'light_pole'])
def test_their_gap_is_a_tenth_below_the_best(name):
    rig = PRESETS[name].rig
    beside, best, beyond = (
        min(orbit.x_max for orbit in find_orbits(rig.replace(gap=gap), (1, 2)).orbits)
        for gap in rig.gap / 0.9 * np.array([0.98, 1.0, 1.02])
    )
    assert best < beside
    assert best < beyond
