"""Sweeps of rigs under gap control: what they settle into, however and by whom they are run."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from control import laws
from control.controlled_rigs import IDEAL, TRIAL, control

from impact_damper_ros import InitialConditions, Rig
from impact_damper_ros.sweep import (
    Grid,
    GridError,
    Settling,
    find_optimum,
    sweep,
)
from impact_damper_ros.sweep.execution import rig_row
from impact_damper_ros.sweep.steady_state import steady_state

#: Sixteen samples in each cycle of the force, whose frequency is 1 rad/s.
IN_STEP = 16 / math.tau
TIMED = control('timed', gap_control_rate=IN_STEP)
#: m flies, since a law of one's own may not search for it.
START = InitialConditions(initial_primary_position=1.0, initial_damper_velocity=2.0)
BRIEF = Settling(cycles=200, watch=25, section=10)


def grid_of(rig=TRIAL, control=TIMED, settling=BRIEF, **options):
    return Grid(rig, START, control, settling=settling, **options)


def measured(rig, settling):
    return SimpleNamespace(**steady_state(rig, settling))


def settings_of(grid, row):
    return grid.settings(grid.values(row))


#: From a smallest gap that cannot be on.
VARIED = grid_of(gap_min=[1e-3, 0.1, 2e3], force_amplitudes=[0.5, 1])


def sampled_rms(law, cycles, watched):
    """Return the rms of X over the last cycles, by many samples of the controlled rig."""
    rig = Rig(TRIAL, START, control=law)
    rig.advance(math.tau * (cycles - watched))
    squares = []
    for k in range(1, 64 * watched + 1):
        rig.advance(math.tau * (cycles - watched + k / 64))
        squares.append(rig.sample().x ** 2)
    return math.sqrt(np.mean(squares))


def test_a_timed_law_in_step_repeats():
    state = measured(Rig(TRIAL, START, control=TIMED, compiled=None), BRIEF)
    assert state.kind == 'periodic'
    assert (state.cycles, state.impacts, state.stops) == (1, 2, '1,2')
    assert state.impacts_per_cycle == 2.0
    assert state.x_max / TRIAL.response_amplitude == pytest.approx(IDEAL, rel=0.03)
    assert state.x_rms == pytest.approx(sampled_rms(TIMED, 250, 4), rel=1e-5)
    assert sorted(state.impact_stop) == [1, 2]
    # Half a cycle apart
    assert abs(np.ptp(state.impact_phase) - 0.5) < 1e-3


def test_samples_out_of_step_or_noisy_are_measured_all_the_same():
    for law in (
        control('amplitude', gap_control_rate=5.0),
        control('timed', gap_control_rate=IN_STEP, gap_control_noise_position=0.02),
    ):
        state = measured(Rig(TRIAL, START, control=law, compiled=None), BRIEF)
        assert state.kind == 'not periodically driven'
        assert (state.cycles, state.settling_cycles, state.measured_cycles) == (None, 225, 25)
        assert state.impacts_per_cycle == pytest.approx(2.0, abs=0.05)
        assert state.x_rms == pytest.approx(sampled_rms(law, 250, 25), rel=1e-5)


def test_stops_on_their_way_are_not_a_settled_motion():
    """The damper at rest and far off, the stops creep towards it for a hundred cycles."""
    rig = TRIAL.replace(damping=1.0, gap=900.0)
    law = control('amplitude', gap_control_rate=IN_STEP, actuator_speed=0.5)
    state = measured(Rig(rig, control=law, compiled=None), BRIEF)
    fixed = measured(Rig(rig, compiled=None), BRIEF)
    assert fixed.kind == 'without impacts'
    assert fixed.settling_cycles == 100
    assert state.settling_cycles > fixed.settling_cycles + 50


def test_rows_of_varied_control():
    table = sweep(VARIED)
    assert list(table.gap_min) == [1e-3, 1e-3, 0.1, 0.1, 2e3, 2e3]
    assert list(table.ok) == [True] * 4 + [False] * 2
    assert 'gap_min is 2000.0 m and gap_max 1000.0 m: give a gap_min below' in table.reason[4]
    # The timed law does not depend on the level of the force
    assert table.x_max_ratio[0] == pytest.approx(table.x_max_ratio[1], rel=1e-3)
    # Not measured under control
    assert table.largest_multiplier.isna().all()


def test_followed_rigs_take_over_rig_and_control():
    grid = grid_of(gap_control_park=[1.4, 1.6], follow='up')
    row, rig = rig_row(grid.setup, {})
    state = rig.snapshot()
    # After the period that was measured and the cycle after it
    assert state['time'] == pytest.approx(math.tau * (row['settling_cycles'] + 2))
    assert state['gap_control']['state']['roused'] is True
    following, _ = rig_row(grid.setup, settings_of(grid, 1), state)
    fresh, _ = rig_row(grid.setup, settings_of(grid, 1))
    assert following['settled']
    assert following['x_max'] == pytest.approx(fresh['x_max'], rel=1e-6)
    assert following['settling_cycles'] <= fresh['settling_cycles']
    assert following['impact_phase'] == pytest.approx(fresh['impact_phase'], abs=1e-6)


def test_the_best_of_what_does_not_repeat():
    """Out of step, none of these repeats to the last digits; narrower stops are in the way."""
    law = control('timed', gap_control_rate=5.0, gap_control_noise_position=0.3)
    few = Settling(cycles=60, watch=21)
    table = sweep(grid_of(control=law, settling=few, gap_control_park=[0.6, 0.8, 1.0]))
    assert not table.settled.any()
    optimum = find_optimum(table, 'x_rms')
    assert (optimum.value, optimum.values) == (table.x_rms.min(), (1.0,))


def test_grids_with_control():
    with pytest.raises(GridError, match=r'gap_control_park is varied, but gap_control is off'):
        grid_of(control=control('off'), gap_control_park=[1, 2])
    assert Grid.from_inputs(json.loads(json.dumps(VARIED.inputs()))) == VARIED
    plain = Grid(TRIAL, START, force_amplitudes=[0.5, 1])
    assert 'gap_control' not in plain.inputs()
    assert Grid.from_inputs(plain.inputs()) == plain


def test_rigs_move_their_stops_by_a_law_of_the_users_own():
    """The motion is that of the law itself, and the inputs name it."""
    grid = grid_of(law='control.laws:follow', force_amplitudes=[0.5, 1])
    assert Grid.from_inputs(json.loads(json.dumps(grid.inputs()))) == grid
    row, last = rig_row(grid.setup, {})
    rig = Rig(TRIAL, START, control=TIMED, law=laws.follow)
    rig.advance(last.time)
    assert rig.snapshot()['gap_control'] == last.snapshot()['gap_control']
    assert row['cycles'] == 1
    assert row['x_max'] / TRIAL.response_amplitude < 1.2 * IDEAL


def test_a_law_that_fails_is_the_reason_in_the_row():
    row, last = rig_row(grid_of(law='control.laws:far', force_amplitudes=[0.5]).setup, {})
    assert last is None
    assert 'the law control.laws:far returned (inf, -1.0)' in row['reason']
