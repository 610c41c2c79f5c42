"""A change of the base in a run waits for the next upward zero; all else is made at once."""

import math

import numpy as np
import pytest
from rigs import UNFORCED

from impact_damper_ros import GapControlParameters, Observer, Rig, TimedChange, run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from impact_damper_ros.rig.waiting_change import made_at_once

CONTROL = GapControlParameters()
SHAKEN = UNFORCED.replace(base_amplitudes=0.6, base_frequencies=31.4)
#: b = -B sin(W t) of an acceleration rises through zero after each half turn too many.
ZEROS_NS = [(2 * k + 1) * math.pi / 31.4 * 1e9 for k in range(100)]


class Diary(Observer):
    def __init__(self, rig):
        self.rig, self.changes = rig, []

    def ticks(self):
        return (k * 1e-3 for k in range(10**6))

    def take_change(self, time_ns, values, _):
        sample = self.rig.sample()
        self.changes.append((time_ns, dict(values), sample.base, self.rig.parameters))


def ran(changes, until=3.0, rig=SHAKEN):
    """Run with changes, time (s) and values each; return the diary and b at every millisecond."""
    simulated, parameters, timed = Rig(rig), rig, []
    for time, values in changes:
        parameters = parameters.replace(**values)
        timed.append(TimedChange(round(time * 1e9), values, parameters, CONTROL))
    diary, places = Diary(simulated), []

    class Places(Observer):
        def look_at(self, instant):
            places.append((instant, simulated.sample().base))

    run(simulated, until, [diary, Places()], timed)
    assert simulated.parameters == parameters
    return diary.changes, np.array(places)


def first_zero_after(time_ns):
    return next(zero for zero in ZEROS_NS if zero > time_ns)


def test_the_level_changes_at_the_next_upward_zero():
    changes, places = ran([(1.03, {'base_amplitudes': 1.8})])
    ((time_ns, values, base, _),) = changes
    assert values == {'base_amplitudes': (1.8,)}
    assert 0.0 <= time_ns - first_zero_after(1.03e9) < 2.0
    # Where the old motion has come to by the nanosecond, less than 0.6/31.4 m/s times 2 ns
    assert 0.0 <= base < 4e-11
    time, b = places.T
    assert np.abs(np.diff(b)).max() < 1.001 * 1.8 / 31.4 * 1e-3
    early = time < time_ns / 1e9
    assert np.abs(b[early]).max() == pytest.approx(0.6 / 31.4**2, rel=1e-3)
    assert np.abs(b[~early]).max() == pytest.approx(1.8 / 31.4**2, rel=1e-3)


def test_the_base_is_continuous():
    """The new motion begins at the place of the old one, also when that is just beyond zero."""
    rig = Rig(SHAKEN)
    rig.advance(1.03)
    for new in (
        SHAKEN.replace(base_amplitudes=1.8, base_frequencies=28.0),
        SHAKEN.replace(base_quantity='velocity', base_amplitudes=0.01),
        SHAKEN.replace(
            base_amplitudes=[0.5, -0.3], base_frequencies=[20.0, 47.0], base_phases=[1.0, 2.0]
        ),
    ):
        now, due_ns = made_at_once(rig, new)
        assert now == rig.parameters
        rig.advance(due_ns / 1e9)
        before = rig.sample()
        rig.change(new)
        after = rig.sample()
        assert after.base == pytest.approx(before.base, abs=1e-9 * 1.8 / 31.4**2)
        assert after.base_velocity > 0.0
        assert (after.x, after.primary_velocity) == (before.x, before.primary_velocity)
        rig.advance(rig.time + 0.37)


def test_what_does_not_move_the_base_is_made_at_once():
    asked = {'base_amplitudes': 1.8, 'gap': 0.03, 'stiffness': 2100.0, 'damping': 2.0}
    changes, _ = ran([(1.03, asked)])
    (first, values, _, rig), (later, rest, _, last) = changes
    assert first == 1_030_000_000
    assert values == {'gap': 0.03, 'stiffness': 2100.0, 'damping': 2.0}
    assert (rig.gap, rig.stiffness, rig.base_amplitudes) == (0.03, 2100.0, (0.6,))
    assert rest == {'base_amplitudes': (1.8,)}
    assert later == pytest.approx(first_zero_after(1.03e9), abs=2.0)
    assert last.base_amplitudes == (1.8,)


def test_changes_while_one_waits_are_made_with_it():
    """The newest counts; one that takes the base back to what it is ends the waiting."""
    changes, _ = ran(
        [
            (1.03, {'base_amplitudes': 1.8}),
            (1.04, {'gap': 0.03}),
            (1.05, {'base_amplitudes': 1.2, 'base_frequencies': 25.0}),
        ]
    )
    assert [(round(t / 1e7), v) for t, v, *_ in changes] == [
        (104, {'gap': 0.03}),
        (110, {'base_amplitudes': (1.2,), 'base_frequencies': (25.0,)}),
    ]
    changes, _ = ran([(1.03, {'base_amplitudes': 1.8}), (1.05, {'base_amplitudes': 0.6})])
    assert [(t, v) for t, v, *_ in changes] == [(1_050_000_000, {'base_amplitudes': 0.6})]


def test_a_base_that_begins_and_one_that_ends():
    """Switched on it begins at zero phase of its own at once; off it ends at an upward zero."""
    changes, places = ran(
        [(1.0, {'base_amplitudes': 0.6}), (2.0, {'base_amplitudes': 0.0})],
        rig=SHAKEN.replace(base_amplitudes=0.0),
    )
    (on, _, base, _), (off, _, end, _) = changes
    assert (on, base) == (1_000_000_000, pytest.approx(0.0, abs=1e-17))
    turns = (off / 1e9 - 1.0) * 31.4 / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-7)
    assert end == 0.0
    time, b = places.T
    assert np.abs(np.diff(b)).max() < 1.001 * 0.6 / 31.4 * 1e-3
    inside = (time > 1.0) & (time < off / 1e9)
    assert b[inside] == pytest.approx(
        0.6 / 31.4**2 * np.sin(31.4 * (time[inside] - 1.0)), abs=1e-12
    )
    assert not b[time > off / 1e9].any()


def test_a_base_that_never_passes_zero_changes_at_once():
    still = SHAKEN.replace(
        base_quantity='displacement', base_amplitudes=1e-3, base_frequencies=0.0, base_phases=1.0
    )
    changes, _ = ran([(1.0, {'base_amplitudes': 2e-3})], rig=still)
    assert [t for t, *_ in changes] == [1_000_000_000]


def test_a_sweep_of_the_base_begins_and_ends_at_upward_zeros():
    sweep = {'sweep_mode': 'up', 'sweep_low': 20.0, 'sweep_high': 40.0, 'sweep_step': 2.0}
    changes, places = ran(
        [(0.6, {**sweep, 'sweep_dwell': 0.1}), (1.9, {'sweep_mode': 'off'})], until=4.0
    )
    # What a sweep that is off consists of does not wait for anything.
    (begin_ns, *_), (end_ns, *_) = (c for c in changes if 'sweep_mode' in c[1])
    assert begin_ns == pytest.approx(first_zero_after(0.6e9), abs=2.0)
    assert end_ns > 1.9e9
    time, b = places.T
    assert np.abs(np.diff(b)).max() < 1.001 * 0.6 / 20.0 * 1e-3
    swept = (time > begin_ns / 1e9) & (time < begin_ns / 1e9 + 0.1)
    assert np.abs(b[swept]).max() == pytest.approx(0.6 / 20.0**2, rel=0.2)
    assert np.abs(b[time > end_ns / 1e9]).max() == pytest.approx(0.6 / 31.4**2, rel=1e-3)


def test_simulated_changes_of_the_base_are_replayed_bit_for_bit(tmp_path):
    bag = tmp_path / 'bag'
    words = ['bench_rig', '--duration', '6', '--quiet', '--bag', str(bag)]
    words += ['--set', 'force_amplitudes=0', '--set', 'base_amplitudes=0.06g']
    for change in ('1:base_amplitudes=0.1g', '2.011:base_frequencies=4.8Hz', '2.02:gap=20mm'):
        words += ['--change', change]
    assert simulate_rig([*words, '--change', '4:base_amplitudes=0']) == 0
    findings = Replay(RecordedRun(bag)).run()
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences
    assert findings.changes == 4
