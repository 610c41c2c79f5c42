"""Simulated stretches of all kinds: what they are found to be, and the prediction beside them."""

import math

import numpy as np
import pytest
from compare.recorded import DISPLACED, built, compared, replayed, simulated
from rigs import BENCH, FRICTION, HORIZONTAL, OFF_RESONANCE, VERTICAL

from impact_damper_ros import InitialConditions, RigParameters, find_orbits
from impact_damper_ros.compare import Verdict
from impact_damper_ros.compare.measures import motion_curve
from impact_damper_ros.compare.stretches import LoggedRig
from impact_damper_ros.compare.verdict import compare_stretch
from impact_damper_ros.orbits.recurrence import LONGEST_PERIOD, MotionKind

SYMMETRIC = OFF_RESONANCE.replace(damping=0.05, damper_mass=0.3)


@pytest.mark.parametrize(
    ('rig', 'golden', 'ratio'),
    [
        (
            HORIZONTAL,
            (
                (1, 0.733784, 9.9294, -1.9340, -18.0987),
                (2, 0.233784, -9.9294, 1.9340, 18.0987),
            ),
            None,
        ),
        (
            FRICTION.replace(friction=0.0),
            (
                (1, 0.7513744, 4.2199719, -1.3654370, -15.4743588),
                (2, 0.2632173, -4.0551342, 1.8294568, 13.9932174),
            ),
            0.2032358,
        ),
        (
            FRICTION,
            (
                (1, 0.7579950, 4.1321400, -1.9067334, -15.9650212),
                (2, 0.2697923, -3.9291024, 2.3620421, 14.4522209),
            ),
            0.2113439,
        ),
    ],
    ids=['horizontal', 'inclined', 'friction'],
)
def test_golden_motions(rig, golden, ratio):
    found = compared(rig, 600, per_cycle=60)
    assert (found.kind, found.verdict) == (MotionKind.PERIODIC, Verdict.AGREES), found.sentence
    assert (found.cycles, found.stops) == (1, (1, 2))
    period, orbit = found.measured.last_period, found.predicted
    for i, (stop, phase, x, velocity, damper) in enumerate(golden):
        assert period.stops[i] == stop
        digits = {'abs': 6e-5 if ratio is None else 6e-8}
        assert period.phases[i] == pytest.approx(phase, abs=6e-7)
        assert period.x[i] == pytest.approx(x, **digits)
        assert period.primary_velocity_after[i] == pytest.approx(velocity, abs=6e-5)
        assert period.damper_velocity_after[i] == pytest.approx(damper, **digits, rel=3e-7)
        # Whole nanoseconds, in cycles of 6 s
        assert period.phases[i] == pytest.approx(orbit.phases[i], abs=1e-8)
        assert period.x[i] == pytest.approx(orbit.x[i], rel=2e-8)
        assert period.impulse[i] == pytest.approx(found.predicted_impulse[i], rel=2e-8)
    if ratio is not None:
        assert found.measured.x_max_ratio == pytest.approx(ratio, rel=1e-6)
    assert orbit.stable
    decay = found.decay
    assert math.log(decay.measured) == pytest.approx(math.log(decay.predicted), rel=5e-3)
    assert f'a period multiplies deviations by {decay.measured:.5g}' in found.sentence
    assert decay.distance < 2e-8
    energy = found.energy
    assert energy.periods == 50
    scale = energy.force + energy.dashpot + energy.friction + energy.impacts
    assert energy.tolerance == pytest.approx(1e-9 * scale, rel=1e-6)
    assert abs(energy.residual) < energy.tolerance < 2e-5 * energy.force
    assert abs(energy.stored) < 1e-7 * energy.force
    assert (energy.friction > 0.0) == (rig.friction > 0.0)


@pytest.mark.parametrize(
    ('rig', 'cycles', 'period', 'stops'),
    [
        (OFF_RESONANCE.replace(gap=18.0), 600, 1, (1, 2, 2)),
        (OFF_RESONANCE.replace(gap=8.0), 500, 1, (1, 1, 2, 2)),
        (FRICTION.replace(gap=15.0), 500, 1, (1, 1, 2)),
        # Its chaotic way there takes some hundred cycles more or less.
        (FRICTION.replace(gap=20.0), 1200, 2, (1, 2, 1, 2)),
        (FRICTION.replace(air_force=0.01), 250, 1, (1, 2)),
        (OFF_RESONANCE.replace(restitution_1=0.0, restitution_2=0.0), 200, 1, (1, 2)),
        (
            HORIZONTAL.replace(
                force_amplitudes=(1.0, 0.5),
                force_frequencies=(1.0, 1.5),
                force_phases=(0.2, 0.4),
            ),
            400,
            2,
            (1, 2, 1, 2),
        ),
    ],
    ids=['three', 'four', 'same stop', 'doubled', 'air', 'plastic', 'two harmonics'],
)
def test_other_periodic_motions(rig, cycles, period, stops):
    found = compared(rig, cycles, per_cycle=30)
    assert (found.kind, found.verdict) == (MotionKind.PERIODIC, Verdict.AGREES), found.sentence
    turns = [stops[i:] + stops[:i] for i in range(len(stops))]
    assert found.cycles == period
    assert found.stops in turns or tuple(3 - s for s in found.stops) in turns
    assert found.predicted.stops == found.stops
    hits = [sum(s == stop for s in found.stops) for stop in (1, 2)]
    overall = found.overall.impacts_on_stop_1, found.overall.impacts_on_stop_2
    assert found.impacts == sum(overall)
    assert overall[0] / overall[1] == pytest.approx(hits[0] / hits[1], rel=0.1)
    assert found.measured.impacts == 20 * sum(hits)
    energy, cycle = found.energy, found.curves.predicted.cycle
    assert energy.end - energy.start == pytest.approx(energy.periods * period * cycle, rel=1e-6)
    assert found.decay.distance < 1e-4
    # From how far the run comes in, and over how many periods, is a matter of the last digit; and
    # with friction the rate is another as long as m turns once more or less in a period.
    close = 2e-3 if found.decay.periods >= 60 and not rig.friction else 5e-2
    assert found.decay.measured == pytest.approx(found.decay.predicted, abs=close)
    assert abs(found.energy.residual) < found.energy.tolerance
    assert found.measured.x_max == pytest.approx(found.predicted.x_max, rel=5e-4)


def test_a_run_that_begins_late_and_within_a_cycle():
    """Phases count from where omega t is zero, and the predicted motion is drawn where it is."""
    rig = FRICTION.replace(force_phases=(1.3,))
    start, samples, events, end = simulated(rig, 340, after=51.7)
    found = compare_stretch(built(LoggedRig(rig, start), samples, events, end, start=51.7))
    assert found.verdict is Verdict.AGREES, found.sentence
    assert found.solver == 'boundary-value problem of its events'
    expected = [phase - 1.3 / math.tau for phase in (0.757995, 0.2697923)]
    assert found.measured.last_period.phases == pytest.approx(expected, abs=1e-6)
    predicted, motion = found.curves.predicted, found.curves.motion
    phase = (motion.time - predicted.force_zero) / predicted.cycle
    first = predicted.phase[0]
    inside = first + (phase - first) % predicted.cycles
    assert np.abs(np.interp(inside, predicted.phase, predicted.x) - motion.x).max() < 0.01
    assert first * predicted.cycle + predicted.force_zero == pytest.approx(
        found.end, abs=1.5 * predicted.cycle
    )


def test_the_energy_of_a_short_irregular_run():
    """Over the whole cycles that were recorded, of a run that began at another time than zero."""
    rig = OFF_RESONANCE.replace(gap=50.0)
    start, samples, events, end = simulated(rig, 30.5, after=200.0)
    found = compare_stretch(built(LoggedRig(rig, start), samples, events, end, start=200.0))
    energy = found.energy
    assert energy.periods == 30
    assert energy.end - energy.start == pytest.approx(30 * math.tau / 1.02, rel=1e-6)
    assert abs(energy.residual) < energy.tolerance


def test_one_sided_and_chatter():
    damped = VERTICAL.replace(damping=0.5, force_amplitudes=(1.2,), restitution_1=0.5)
    found = compared(damped, 120, None)
    assert (found.verdict, found.cycles, found.stops) == (Verdict.AGREES, 1, (1,))
    assert found.decay.measured == pytest.approx(found.decay.predicted, abs=1e-4)
    chatter = compared(damped.replace(restitution_1=0.6), 100, None)
    assert chatter.verdict is Verdict.AGREES, chatter.sentence
    # Of some thirty impacts of a chatter those count that are not next to nothing.
    assert chatter.stops == chatter.predicted.stops == (1,) * 14
    assert chatter.impacts > 25 * 80
    assert chatter.decay.measured == pytest.approx(chatter.decay.predicted, abs=1e-4)


@pytest.mark.parametrize(
    ('rig', 'cycles', 'kind'),
    [
        (OFF_RESONANCE.replace(gap=50.0), 400, MotionKind.CHAOTIC),
        (VERTICAL.replace(force_amplitudes=(2.0,)), 400, MotionKind.CHAOTIC),
        (
            SYMMETRIC.replace(
                gap=8.757, restitution_1=0.6, restitution_2=0.6, force_frequencies=(1.1,)
            ),
            400,
            MotionKind.QUASI_PERIODIC,
        ),
    ],
)
def test_motions_that_do_not_repeat(rig, cycles, kind):
    found = compared(rig, cycles, None if rig.one_sided else DISPLACED, per_cycle=20)
    assert found.kind is kind, found.evidence
    assert found.cycles == 0
    assert found.decay is None
    exponent, error = found.measures['lyapunov_exponent'], found.measures['lyapunov_error']
    if kind is MotionKind.CHAOTIC:
        assert exponent > max(0.15, 2.0 * error)
        assert found.verdict in (Verdict.PREDICTED_UNSTABLE, Verdict.NO_PREDICTION)
        # The symmetric motion of a gap of 50 is stable, and not the one the run is on.
        assert (found.verdict is Verdict.NO_PREDICTION) == (rig.gap == 50.0)
    else:
        assert abs(exponent) < max(0.01, 3.0 * error)
        assert found.verdict is Verdict.PREDICTED_UNSTABLE
        assert abs(found.predicted.multipliers[0]) == pytest.approx(1.12, abs=0.02)
    assert abs(found.energy.residual) < found.energy.tolerance


def test_a_transient_that_repeats_nearly():
    found = compared(OFF_RESONANCE.replace(gap=8.0), 150)
    assert (found.kind, found.verdict) == (MotionKind.TRANSIENT, Verdict.NOT_SETTLED)
    assert found.settled_at is None
    assert 1e-3 < found.decay.distance < 0.05
    assert found.predicted.stable
    assert 'after about' in found.sentence
    # By then it has settled.
    words = found.sentence.split('after about ')[1].split()
    later = compared(OFF_RESONANCE.replace(gap=8.0), 155 + int(words[0]))
    assert later.verdict is Verdict.AGREES
    # Two multipliers of nearly the same size beat: the distance falls in waves.
    assert 1e-5 < later.decay.distance < 1e-3


def test_a_transient_that_does_not_repeat_yet():
    found = compared(HORIZONTAL, 30)
    assert (found.kind, found.verdict) == (MotionKind.TRANSIENT, Verdict.NOT_SETTLED)
    assert found.measured.last_period is None
    assert found.predicted.stops == (1, 2)
    assert found.measures['settles_after_cycles'] == pytest.approx(120, abs=15)


def test_the_decay_is_measured_where_it_is_one():
    """Of a chatter, whose weak impacts come and go at first: later on it is the predicted one."""
    rig = BENCH.replace(one_sided=True, angle=1.5)
    found = compared(rig, 200, InitialConditions(), per_cycle=20)
    assert (found.verdict, found.kind) == (Verdict.AGREES, MotionKind.PERIODIC), found.sentence
    assert found.predicted.impacts > 8
    assert found.decay.measured == pytest.approx(found.decay.predicted, rel=1e-3)
    assert 'which is another one' not in found.sentence


def test_undamped_and_several_harmonics():
    """A free vibration that stays is named; of two harmonics the largest |X| is a bound."""
    free = BENCH.replace(gap=1.0, friction=0.0)
    found = compared(
        free.replace(damping=0.0, force_frequencies=(20.0,)), 300, InitialConditions()
    )
    assert found.verdict is Verdict.NO_PREDICTION
    assert found.sentence.endswith('of it, and stays: M is not damped')
    two = {'force_amplitudes': (1.2, 0.4), 'force_phases': (0.0, 0.3)}
    two['force_frequencies'] = (31.4, 62.8)
    found = compared(free.replace(**two), 300, InitialConditions())
    assert found.verdict is Verdict.AGREES
    bound = float(found.sentence.partition('predicted at most ')[2].split()[0])
    assert found.measured.x_max < bound < 1.01 * found.measured.x_max


def test_without_impacts():
    wide = HORIZONTAL.replace(gap=1000.0, damping=0.2)
    found = compared(wide, 60)
    assert (found.kind, found.verdict) == (MotionKind.NO_IMPACTS, Verdict.AGREES)
    assert found.measured.x_max == pytest.approx(wide.response_amplitude, rel=1e-6)
    stuck = wide.replace(friction=4.5, gravity=1.0)
    # At the end of two of these m sticks for a while
    for cycles, quiet in ((60, 30), (60.3, 30), (60.8, 30), (30, 20), (10, 10)):
        found = compared(stuck, cycles, None)
        verdict = Verdict.NO_PREDICTION if cycles > 20 else Verdict.TOO_SHORT
        assert (found.kind, found.verdict) == (MotionKind.NO_IMPACTS, verdict)
        assert found.evidence == f'm has hit no stop for {quiet} cycles'
    blown = wide.replace(one_sided=True, air_force=0.05)
    away = InitialConditions(initial_damper_offset=500.0, initial_damper_velocity=1.0)
    found = compared(blown, 60, away)
    assert (found.impacts, found.verdict) == (1, Verdict.AGREES)
    assert 'predicted 5.05 m' in found.sentence
    assert found.measured.x_max == pytest.approx(wide.response_amplitude + 0.05)
    held = compared(stuck.replace(friction=50.0), 60, None)
    assert held.verdict is Verdict.AGREES
    mass = stuck.primary_mass + stuck.damper_mass
    amplitude = 1.0 / math.hypot(stuck.stiffness - mass, stuck.damping)
    assert held.measured.x_max == pytest.approx(amplitude, rel=1e-5)
    # While it settles, |X| is largest in the last fifth
    short = replayed(wide, 3.25)
    found = compare_stretch(short)
    assert found.verdict is Verdict.NOT_SETTLED
    largest = float(found.sentence.partition('largest |X| ')[2].split()[0])
    assert largest == pytest.approx(np.abs(short.samples['x'][-26:]).max(), rel=5e-3)
    # The stop is 500 m away, less the 5 m of X.
    for speed, words in ((1.0, 'hits stop 1 after about 18.9 more'), (1e-3, 'drifts towards')):
        found = compared(wide, 60, InitialConditions(initial_damper_velocity=speed))
        assert found.verdict is Verdict.NOT_SETTLED
        assert f'; m does not keep its place, and {words}' in found.sentence


def test_at_rest_and_too_short():
    still = RigParameters(force_amplitudes=(0.0,))
    found = compared(still, 20, None)
    assert (found.kind, found.verdict) == (MotionKind.AT_REST, Verdict.NO_PREDICTION)
    found = compared(HORIZONTAL, 1)
    assert (found.kind, found.verdict) == (MotionKind.UNDECIDED, Verdict.TOO_SHORT)
    found = compared(OFF_RESONANCE.replace(gap=20.0), 9)
    assert (found.kind, found.verdict) == (MotionKind.UNDECIDED, Verdict.TOO_SHORT)
    assert 'about 30 may decide' in found.sentence


def test_a_force_without_a_period():
    rig = HORIZONTAL.replace(
        force_amplitudes=(1.0, 0.5),
        force_frequencies=(1.0, math.sqrt(2.0)),
        force_phases=(0.0, 0.0),
    )
    found = compared(rig, 200)
    assert found.kind is MotionKind.NOT_PERIODICALLY_DRIVEN
    assert found.verdict is Verdict.NO_PREDICTION
    assert 'no common period' in found.sentence
    assert found.measured.impacts > 100
    assert abs(found.energy.residual) < found.energy.tolerance
    for cycles in (LONGEST_PERIOD, LONGEST_PERIOD + 1):
        found = compared(rig.replace(force_frequencies=(1.0, 1.0 + 1.0 / cycles)), 10)
        assert ('no common period' in found.sentence) is (cycles > LONGEST_PERIOD)


@pytest.mark.parametrize('frequencies', [(0.0,), (0.0, 1.0)])
def test_a_constant_force_has_no_cycles(frequencies):
    """Phases are those of the first harmonic that is no constant force, if there is one."""
    amplitudes = (1.0, 2.0)[: len(frequencies)]
    force = {'force_amplitudes': amplitudes, 'force_frequencies': frequencies}
    rig = HORIZONTAL.replace(**force, force_phases=(1.57, 0.0)[: len(frequencies)])
    found = compared(rig, 120)
    assert found.verdict is Verdict.NO_PREDICTION
    assert 'there are no cycles to count' in found.sentence
    curves = found.curves
    if len(frequencies) == 1:
        assert curves.phases is None
    else:
        assert len(curves.phases) > 50
        assert curves.phases == pytest.approx(curves.impacts['time'] / math.tau % 1.0, abs=1e-9)


def test_curves_are_bounded_and_whole():
    stretch = replayed(FRICTION, 400)
    found = compare_stretch(stretch)
    curves = found.curves
    assert 100 < curves.envelope.shape[1] <= 2000
    assert curves.envelope[2].max() == pytest.approx(13.15, rel=0.01)
    motion = curves.motion
    assert motion.time[-1] == pytest.approx(found.end)
    assert np.all(np.diff(motion.time) >= 0.0)
    assert np.all(motion.stop_1 == pytest.approx(18.5, abs=1e-10))
    assert np.abs(motion.y).max() == pytest.approx(18.5, abs=1e-10)
    assert len(curves.impacts) == len(curves.phases) == found.impacts
    assert curves.convergence.distance[-1] < 1e-9
    assert 12_000 <= len(motion_curve(stretch, 0.0, 1.0).time) < 15_000
    spectrum = curves.spectrum
    line = spectrum.amplitude[np.abs(spectrum.frequency - 1.02 / math.tau).argmin()]
    assert line == pytest.approx(spectrum.amplitude.max())
    assert 0.7 * found.predicted.x_max < line < 1.2 * found.predicted.x_max


def test_a_motion_that_repeats_but_does_not_last():
    """From an unstable periodic motion the rig departs by a fifth per cycle, from round-off."""
    rig = SYMMETRIC.replace(gap=10.0)
    orbits = find_orbits(rig, (1, 2), simulate=False).orbits
    orbit = min(orbits, key=lambda orbit: abs(orbit.multipliers[0]))
    assert abs(orbit.multipliers[0]) == pytest.approx(1.197, abs=1e-3)
    start = InitialConditions(
        initial_primary_position=orbit.x[0],
        initial_primary_velocity=orbit.primary_velocity_after[0],
        initial_damper_offset=0.5 * rig.gap,
        initial_damper_velocity=orbit.damper_velocity_after[0],
    )
    found = compared(rig.replace(force_phases=(math.tau * orbit.phases[0],)), 30, start)
    assert found.kind is MotionKind.PERIODIC
    assert found.verdict is Verdict.PREDICTED_UNSTABLE, found.sentence
    assert 'not stable, largest multiplier 1.197' in found.sentence
