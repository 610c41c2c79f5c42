"""
Measurements of a stretch: swing, impacts, energy, and the motion in detail.

Between two recorded knots (joint states and impacts) X and Y are the cubics through the recorded
positions and velocities. The equation of motion does not enter, so that the residual of the energy
balance tests it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters

from .recorded_stretch import ForceClock, Knots, RecordedImpacts, RecordedStates, RecordedStretch
from .result import (
    Array,
    EnergyBalance,
    ImpactCurve,
    ImpactStates,
    MeasuredMotion,
    MotionCurve,
    Overall,
    Spectrum,
)

# Gauss points on [0, 1] that integrate the square of a cubic exactly
_NODES, _GAUSS = np.polynomial.legendre.leggauss(4)
_PLACES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _GAUSS


def cubic_rates(step: Array, rise: Array, begin: Array, end: Array) -> tuple[Array, Array]:
    """
    Return b and a of the velocity begin + b s + a s^2 along cubics, with s from 0 to 1.

    Given are the duration and the displacement from one knot to the next, and the velocities
    there.
    """
    mean = rise / step
    return 2.0 * (3.0 * mean - 2.0 * begin - end), 3.0 * (begin + end - 2.0 * mean)


def turning_points(
    step: Array, rise: Array, begin: Array, end: Array
) -> tuple[NDArray[np.intp], Array]:
    """Return in which intervals the velocity changes sign, and the displacement until there."""
    turns = np.flatnonzero(begin * end < 0.0)
    step, v_0 = step[turns], begin[turns]
    b, a = cubic_rates(step, rise[turns], v_0, end[turns])
    # Between velocities of different signs there is one root.
    root = np.sqrt(np.maximum(b * b - 4.0 * a * v_0, 0.0))
    s = 2.0 * v_0 / (-b + np.copysign(root, v_0))
    out: Array = step * s * (v_0 + s * (b / 2.0 + s * a / 3.0))
    return turns, out


class CubicSwing(NamedTuple):
    """Displacement along cubics, between their ends."""

    largest: float  # |X| where X turns between two ends, m; 0 if it does not turn
    total: float  # integral of X, m s
    squares: float  # and of its square, m^2 s


def cubic_swing(span: Array, start: Array, end: Array, v_0: Array, v_1: Array) -> CubicSwing:
    """
    Measure the swing of X along the cubics between knots.

    Given are durations, X at both ends, and X' there times the duration, m.
    `scipy.interpolate.PPoly` takes three times as long for the turning points of 200,000 of them.
    """
    rise = end - start
    square, cube = 3.0 * rise - 2.0 * v_0 - v_1, v_0 + v_1 - 2.0 * rise

    def at(s: Array) -> Array:
        value: Array = start + s * (v_0 + s * (square + s * cube))
        return value

    largest = 0.0
    # X' = v_0 + 2 square s + 3 cube s^2, its two roots in the form that does not cancel
    root = np.sqrt(np.maximum(square * square - 3.0 * cube * v_0, 0.0))
    half = -(square + np.copysign(root, square))
    with np.errstate(divide='ignore', invalid='ignore'):
        for s in (half / (3.0 * cube), v_0 / half):
            inside = (s > 0.0) & (s < 1.0)
            if inside.any():
                largest = max(largest, float(np.abs(at(np.where(inside, s, 0.0))).max()))
    total = squares = 0.0
    # Sums and not products of vectors, whose bits depend on the number of threads
    for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
        value = at(np.full_like(start, place))
        total += weight * float(np.sum(value * span))
        squares += weight * float(np.sum(value * value * span))
    return CubicSwing(largest, total, squares)


def _swing_between(begin: Knots, end: Knots) -> CubicSwing:
    step = end.time - begin.time
    return cubic_swing(step, begin.x, end.x, begin.velocity * step, end.velocity_before * step)


# Energy


class ImpactEnergies(NamedTuple):
    """What impacts do to the kinetic energy, J."""

    both: float  # lost by M and m together
    primary: float  # taken from M; part of it is given to m


def energies_of_impacts(impacts: RecordedImpacts, rig: RigParameters) -> ImpactEnergies:
    """Return what impacts do to the energy."""
    before, after = impacts.velocity_before(rig), impacts.velocity_after
    damper_before, damper_after = (
        impacts.damper_velocity_before(rig),
        impacts.damper_velocity_after,
    )
    # The impulses times mean velocities: differences of squares without their cancellation
    on_m = 0.5 * impacts.primary_impulse
    taken = -float((on_m * (before + after)).sum())
    given = -float((on_m * (damper_before + damper_after)).sum())
    return ImpactEnergies(taken - given, taken)


def _stored_energy(
    rig: RigParameters, x: Array, velocity: Array, z: Array, damper_velocity: Array
) -> Array:
    """Return kinetic and potential energy of both masses, J; X from the static equilibrium."""
    slope = rig.gravity * math.sin(rig.angle)
    primary = 0.5 * rig.primary_mass * velocity**2 + 0.5 * rig.stiffness * x**2
    energy: Array = primary + rig.damper_mass * (0.5 * damper_velocity**2 - slope * z)
    return energy


def _work_between(
    rig: RigParameters, clock: ForceClock | None, begin: Knots, end: Knots
) -> tuple[float, float, float]:
    """Return the work of the force on M, the sum of its moduli, and the dashpot's loss, J."""
    step = end.time - begin.time
    v_0 = begin.velocity
    b, a = cubic_rates(step, end.x - begin.x, v_0, end.velocity_before)
    force = dashpot = there_and_back = 0.0
    for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
        velocity = v_0 + place * (b + place * a)
        if clock is not None:
            work = clock.force(begin.time + place * step) * velocity * step
            force += weight * float(np.sum(work))
            there_and_back += weight * float(np.sum(np.abs(work)))
        dashpot += weight * rig.damping * float(np.sum(velocity**2 * step))
    if clock is None:
        force = there_and_back = math.nan
    return force, there_and_back, dashpot


#: Error of the work along a cubic, in (W h)^4 of the work there and back.
_CUBIC = 0.001
#: The same of the friction where m turns or stops, in the speeds there times the interval.
_BROKEN = 0.1
_ROUND_OFF = 1e-12


def energy_balance(clock: ForceClock, knots: Knots, periods: int) -> EnergyBalance | None:
    """Balance the energy from the first knot to the last one, both after their impact, if any."""
    if len(knots) < 2:
        return None
    rig = clock.parameters
    begin, end = knots[:-1], knots[1:]
    step = end.time - begin.time
    moved = step > 0.0
    begin, end, step = begin[moved], end[moved], step[moved]
    force, there_and_back, dashpot = _work_between(rig, clock, begin, end)
    rise = (end.z - end.x) - (begin.z - begin.x)
    grip = rig.friction * rig.damper_mass * rig.gravity * math.cos(rig.angle)
    relative = begin.damper_velocity - begin.velocity
    later = end.damper_velocity_before - end.velocity_before
    path = np.abs(rise)
    turns, out = turning_points(step, rise, relative, later)
    path[turns] = np.abs(out) + np.abs(rise[turns] - out)
    friction = grip * float(path.sum())
    # Where m starts or stops moving relative to M, or turns, Y is not a cubic.
    broken = (relative * later <= 0.0) & ((relative != 0.0) | (later != 0.0))
    doubt = grip * float(((np.abs(relative) + np.abs(later)) * step)[broken].sum())
    hits = knots[1:]
    before = _stored_energy(rig, hits.x, hits.velocity_before, hits.z, hits.damper_velocity_before)
    after = _stored_energy(rig, hits.x, hits.velocity, hits.z, hits.damper_velocity)
    impacts = float((before - after)[hits.stop > 0.0].sum())
    air_work = rig.air_force * float(begin.air_direction @ rise)
    ends = knots[np.array([0, len(knots) - 1])]
    energy = _stored_energy(rig, ends.x, ends.velocity, ends.z, ends.damper_velocity)
    stored = float(energy[1] - energy[0])
    turned = max([rig.omega, *rig.harmonics[1]]) * float(step.max(initial=0.0))
    scale = there_and_back + dashpot + friction + abs(impacts) + float(np.abs(energy).max())
    return EnergyBalance(
        start=float(knots.time[0]),
        end=float(knots.time[-1]),
        periods=periods,
        force=force,
        air=air_work,
        dashpot=dashpot,
        friction=friction,
        impacts=impacts,
        stored=stored,
        residual=force + air_work - dashpot - friction - impacts - stored,
        tolerance=(_CUBIC * turned**4 + _ROUND_OFF) * scale + _BROKEN * doubt,
    )


#: Knots after a joint state that are kept until the next one comes; if more come, it is missing.
_MOST_HELD = 20_000
#: Errors of the cubics: of a smooth motion, in (W h)^4, and by steps of the friction, in (W h)^3.
_SMOOTH, _STEPS = 1.0 / 200.0, 1.0 / 50.0


class SwingAndEnergy:
    """Adds up what `Overall` has; between the parts it keeps the last joint state."""

    def __init__(self, parameters: RigParameters, clock: ForceClock | None) -> None:
        self._rig, self._clock = parameters, clock
        self._held: Knots | None = None
        self._largest = math.nan
        self._covered = self._squares = self._dashpot = self._taken = self._lost = (
            self._longest
        ) = 0.0
        self._force = 0.0 if clock is not None else math.nan
        self._impacts = [0, 0]

    def take(self, knots: Knots, impacts: RecordedImpacts, longest: float) -> None:
        """Take the next part; longer intervals than `longest`, in s, have missing samples."""
        # A log may hold any number; what overflows is no number in the result.
        with np.errstate(over='ignore', invalid='ignore'):
            for stop in (1, 2):
                self._impacts[stop - 1] += int((impacts.stop == stop).sum())
            energies = energies_of_impacts(impacts, self._rig)
            self._taken += energies.primary
            self._lost += energies.both
            if len(knots):
                size = float(np.abs(knots.x).max())
                self._largest = size if math.isnan(self._largest) else max(self._largest, size)
            if self._held is not None:
                knots = Knots.joined([self._held, knots])
            samples = np.flatnonzero(knots.stop == 0.0)
            if len(samples) > 1:
                self._integrate(knots[samples[0] : samples[-1] + 1], longest)
            begin = int(samples[-1]) if len(samples) else len(knots)
            self._held = knots[begin:] if 0 < len(knots) - begin <= _MOST_HELD else None

    def _integrate(self, knots: Knots, longest: float) -> None:
        """Add the integrals from the first knot to the last one, both joint states."""
        samples = np.flatnonzero(knots.stop == 0.0)
        sampled = np.diff(knots.time[samples]) <= longest
        within = np.repeat(sampled, np.diff(samples))
        step = np.diff(knots.time)
        used = within & (step > 0.0)
        if not used.any():
            return
        begin, end, step = knots[:-1][used], knots[1:][used], step[used]
        swing = _swing_between(begin, end)
        force, _, dashpot = _work_between(self._rig, self._clock, begin, end)
        self._covered += float(step.sum())
        self._squares += swing.squares
        self._largest = max(self._largest, swing.largest)
        self._force += force
        self._dashpot += dashpot
        self._longest = max(self._longest, float(step.max()))

    def overall(self, duration: float) -> Overall:
        """Return the numbers of a stretch of a length in s."""
        rig = self._rig
        frequencies = [rig.omega, *rig.harmonics[1]]
        if rig.sweep_mode != 'off':
            frequencies.append(rig.sweep_high)
        turned = max(frequencies) * self._longest
        steps = rig.damper_mass / rig.primary_mass if rig.friction * rig.gravity > 0.0 else 0.0
        return Overall(
            duration=duration,
            covered=self._covered,
            x_max=self._largest,
            x_rms=math.sqrt(self._squares / self._covered) if self._covered > 0.0 else math.nan,
            impacts=sum(self._impacts),
            impacts_on_stop_1=self._impacts[0],
            impacts_on_stop_2=self._impacts[1],
            impact_energy=self._taken,
            impact_loss=self._lost,
            dashpot_energy=self._dashpot,
            force_work=self._force,
            accuracy=_SMOOTH * turned**4 + _STEPS * steps * turned**3,
        )


# The steady part


def _swing(stretch: RecordedStretch, knots: Knots) -> tuple[float, float]:
    """Return the largest |X|, and the rms of X over the intervals without missing samples."""
    largest = float(np.abs(knots.x).max(initial=0.0))
    begin, end = knots[:-1], knots[1:]
    starts, ends = np.array(stretch.gaps).reshape(-1, 2).T
    # Before the first gap the index is -1, that of an end before all times.
    last = np.searchsorted(starts, begin.time, side='right') - 1
    missing = end.time <= np.append(ends, -math.inf)[last]
    used = (end.time > begin.time) & ~missing
    begin, end = begin[used], end[used]
    swing = _swing_between(begin, end)
    covered = float((end.time - begin.time).sum())
    known = len(stretch.states) > 0 and covered > 0.0
    rms = math.sqrt(swing.squares / covered) if known else math.nan
    return max(largest, swing.largest), rms


def measured_motion(
    stretch: RecordedStretch,
    start: float,
    end: float,
    period: ImpactStates | None = None,
    per_cycle: float = math.nan,
) -> MeasuredMotion:
    """
    Measure a part of a stretch, as far as it was kept.

    The last period of a periodic motion and its impacts per cycle are passed on; by default the
    impacts are counted.
    """
    knots = stretch.knots(start, end)
    if len(knots):
        start, end = float(knots.time[0]), float(knots.time[-1])
    hits = knots[knots.stop > 0.0]
    impulse = stretch.parameters.primary_mass * np.abs(hits.velocity - hits.velocity_before)
    largest, rms = _swing(stretch, knots)
    amplitude = stretch.parameters.response_amplitude
    steady = stretch.parameters.sweep_mode == 'off'
    known = steady and 0.0 < amplitude < math.inf
    cycles = (end - start) * stretch.parameters.force_frequencies[0] / math.tau * steady
    if math.isnan(per_cycle) and cycles > 0.0:
        per_cycle = len(hits) / cycles
    return MeasuredMotion(
        start=start,
        end=end,
        x_max=largest,
        x_rms=rms,
        amplitude_ratio=largest / amplitude if known else math.nan,
        impacts=len(hits),
        impacts_per_cycle=per_cycle,
        mean_impulse=float(impulse.mean()) if len(hits) else 0.0,
        largest_impulse=float(impulse.max(initial=0.0)),
        last_period=period,
    )


# The arrays for plots


_MOST_ROWS = 6000
_MOST_IMPACTS = 20_000
_MOST_LINES = 4096
_MOST_SPECTRUM_STATES = 2**17
_HIGHEST_HARMONIC = 12.0


def motion_curve(stretch: RecordedStretch, start: float) -> MotionCurve | None:
    """Return the motion from an instant on, or as much of its end as may be shown."""
    knots = stretch.knots(start, stretch.end)[-_MOST_ROWS:]
    if not len(knots):
        return None
    twice = np.repeat(np.arange(len(knots)), np.where(knots.stop > 0.0, 2, 1))
    first = np.append(twice[1:] == twice[:-1], False)
    velocity = np.where(first, knots.velocity_before[twice], knots.velocity[twice])
    damper = np.where(first, knots.damper_velocity_before[twice], knots.damper_velocity[twice])
    time = knots.time[twice]
    states = stretch.states
    at = np.clip(np.searchsorted(states.time, time, side='right') - 1, 0, None)
    nothing = np.full(len(time), np.nan)
    stop_1 = (states.stop_1 - states.x)[at] if len(states) else nothing
    stop_2 = (states.stop_2 - states.x)[at] if len(states) else nothing
    return MotionCurve(
        time=time,
        x=knots.x[twice],
        velocity=velocity,
        y=(knots.z - knots.x)[twice],
        relative_velocity=damper - velocity,
        stop_1=stop_1,
        stop_2=nothing if stretch.parameters.one_sided else stop_2,
    )


def impact_curve(stretch: RecordedStretch) -> ImpactCurve | None:
    """Return the latest impacts."""
    impacts = stretch.impacts[-_MOST_IMPACTS:]
    if not len(impacts):
        return None
    rig, clock = stretch.parameters, stretch.clock
    phase = np.full(len(impacts), np.nan)
    if clock is not None and clock.frequency > 0.0:
        phase = clock.phase(impacts.time) % 1.0
    return ImpactCurve(
        time=impacts.time,
        phase=phase,
        stop=impacts.stop.astype(np.int64),
        x=impacts.x,
        primary_velocity_before=impacts.velocity_before(rig),
        primary_velocity_after=impacts.velocity_after,
        damper_velocity_before=impacts.damper_velocity_before(rig),
        damper_velocity_after=impacts.damper_velocity_after,
        impulse=np.abs(impacts.primary_impulse),
    )


def spectrum(states: RecordedStates, force_frequency: float) -> Spectrum | None:
    """Return the amplitude spectrum of X at the end of some evenly spaced joint states."""
    steps = np.diff(states.time)
    if len(steps) < 16:
        return None
    step = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - step) > 1e-3 * step)
    begin = int(uneven[-1]) + 1 if len(uneven) else 0
    highest = 0.5 / step
    if force_frequency > 0.0:
        highest = min(highest, _HIGHEST_HARMONIC * force_frequency)
    most = min(_MOST_SPECTRUM_STATES, int(_MOST_LINES / (highest * step)))
    x = states.x[begin:][-most:]
    if len(x) < 16:
        return None
    window = np.hanning(len(x) + 1)[:-1]
    amplitude: Array = np.abs(np.fft.rfft((x - x.mean()) * window)) * (2.0 / window.sum())
    frequency: Array = np.arange(len(amplitude)) / (len(x) * step)
    shown = frequency <= highest
    return Spectrum(
        frequency=frequency[shown][:_MOST_LINES],
        amplitude=amplitude[shown][:_MOST_LINES],
        force_frequency=force_frequency,
        resolution=float(frequency[1]),
        window='Hann',
    )
