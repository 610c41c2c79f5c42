"""Runs until a motion repeats: against the theory, dense samples and closed forms."""

import math

import pytest
from control.controlled_rigs import TRIAL, control

from impact_damper_ros import (
    GapControlParameters,
    MotionKind,
    Rig,
    RigParameters,
    find_orbits,
    settle,
)
from orbits.begun_rigs import begun_on

HORIZONTAL = RigParameters(gravity=0.0)
DETUNED = HORIZONTAL.replace(force_frequencies=1.02)


def test_it_may_begin_at_any_instant_and_after_changes():
    rig = Rig(HORIZONTAL.replace(gap=30.0, force_frequencies=1.1))
    rig.advance(97.3)
    rig.change(HORIZONTAL)
    found = settle(rig)
    assert rig.time == pytest.approx(found.end) == 97.3 + found.cycles * found.cycle
    orbit = find_orbits(HORIZONTAL, (1, 2)).orbits[0]
    assert orbit.distance(found.rhythm) < 1e-6


def test_an_unstable_motion_is_left():
    """A rig that starts on it, to eleven digits, stays near it for long and settles elsewhere."""
    rig = HORIZONTAL.replace(gap=12.0)
    unstable = [o for o in find_orbits(rig, (1, 2)).orbits if o.viable and not o.stable]
    (orbit,) = unstable[:1]
    found = settle(begun_on(orbit, before=True), cycles=600)
    assert found.rhythm is None or orbit.distance(found.rhythm) > 1e-2


def test_motions_without_impacts():
    still = settle(Rig(HORIZONTAL.replace(gap=500.0, damping=0.1)))
    assert (still.kind, still.rhythm, still.impacts) == (MotionKind.NO_IMPACTS, None, [])
    assert still.x_max == pytest.approx(HORIZONTAL.replace(damping=0.1).response_amplitude)
    ended = settle(Rig(HORIZONTAL.replace(gap=500.0)), quiet=100.0)
    assert (ended.kind, ended.cycles, ended.quiet) == (MotionKind.NO_IMPACTS, 100, math.inf)
    fallen = settle(Rig(RigParameters(angle=0.3, force_amplitudes=0.0)))
    assert fallen.kind is MotionKind.AT_REST


def test_a_force_that_repeats_after_two_cycles():
    rig = HORIZONTAL.replace(
        force_amplitudes=(1.0, 0.3), force_frequencies=(1.0, 1.5), force_phases=(0.0, 0.4)
    )
    found = settle(Rig(rig))
    assert (found.kind, found.period.cycles, found.rhythm.impacts) == (MotionKind.PERIODIC, 2, 4)
    never = settle(Rig(rig.replace(force_frequencies=(1.0, 1.618))), cycles=350, watch=300)
    assert never.kind is MotionKind.NOT_PERIODICALLY_DRIVEN
    swept = settle(Rig(HORIZONTAL.replace(sweep_mode='up')), cycles=50, watch=30)
    assert (swept.kind, swept.indications) == (MotionKind.NOT_PERIODICALLY_DRIVEN, None)


def test_chaos_and_its_evidence():
    found = settle(Rig(DETUNED.replace(gap=5.0), compiled=None), cycles=600)
    assert (found.kind, found.period, found.cycles) == (MotionKind.CHAOTIC, None, 600)
    assert found.indications.cycles == len(found.section) == 500
    assert 0.8 < found.indications.exponent < 1.6
    assert found.watched_from == pytest.approx(100 * found.cycle)
    assert found.events['time'][0] > found.watched_from


def test_under_control_the_stops_must_repeat_too():
    law = control('timed', gap_control_rate=16 / math.tau)
    found = settle(Rig(TRIAL, control=law, compiled=None), cycles=600, watch=25)
    assert (found.kind, found.rhythm.stops) == (MotionKind.PERIODIC, (1, 2))
    # Not measured there
    assert math.isnan(found.multiplier)
    assert math.isnan(found.exponent.value)


@pytest.mark.parametrize(('gap', 'kind'), [(37.0, 'periodic'), (5.0, 'undecided')])
def test_without_commands_an_external_control_changes_nothing(gap, kind):
    """It once ended in a ValueError, looking for the next sample of a law."""
    rig = DETUNED.replace(gap=gap)
    found, free = (
        settle(Rig(rig, control=law, compiled=None), cycles=600)
        for law in (GapControlParameters(gap_control='external'), None)
    )
    assert found.kind.value == kind
    assert (found.cycles, found.x_max, found.rhythm) == (free.cycles, free.x_max, free.rhythm)
    assert found.indications is None


def test_too_many_events_end_the_run():
    found = settle(Rig(HORIZONTAL), events=40)
    assert found.kind is MotionKind.UNDECIDED
    assert 'allow more events' in found.reason
    assert settle(Rig(HORIZONTAL)).reason == ''


def test_stops_that_a_control_sends_back_come_to_rest_on_the_way():
    """The control no longer acts in the end; it once ended the run with a ValueError."""
    law = GapControlParameters(gap_control='amplitude', actuator_speed=0.5)
    rig = Rig(HORIZONTAL, control=law)
    rig.advance(100.0)
    rig.change(HORIZONTAL, law.replace(gap_control='off'))
    assert rig.moves_stops
    found = settle(rig)
    assert not rig.moves_stops
    assert found.rhythm.distance(settle(Rig(HORIZONTAL)).rhythm) < 1e-6
