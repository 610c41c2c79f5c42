"""The runs of the gap control study: rigs, their control, and their measurements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from impact_damper_ros.compare.measured_motion import turning_points
from impact_damper_ros.control import GapControlParameters, Rig, damper_of
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.event_budget import EndlessEventsError


def ideal_amplitude(rig: RigParameters) -> float:
    """
    Return the amplitude of X at resonance with both impacts where |X'| is largest, m.

    Notes
    -----
    m flies for half a cycle each way, and friction reduces its absolute speed u by L = friction
    g cos(angle) pi/omega in each flight; weight makes the two flights unequal, and to first order
    does not change their mean. With V the speed of M just before
    the impact, momentum and restitution give u_after = [(1 + R) V + (R - mu) u_before]/(1 + mu),
    and u_before = u_after - L. Two impulses m (u_before + u_after) per cycle at the peaks of X'
    act on the fundamental as a force of amplitude (omega/pi) times their sum, in phase with the
    dashpot's: F = C omega A + (omega/pi) 2 m (u_before + u_after). The speed of M at the passage
    is the mean of before and after: omega A = V - mu (u_before + u_after)/2.

    Without friction this is A0 zeta/(zeta + zeta_eq), zeta_eq = (2/pi) (mu/(1 + mu)) (1 + R)/(1 -
    R), with A0 the amplitude without impacts.
    """
    mu, omega = rig.mass_ratio, rig.omega
    restitution = 0.5 * (rig.restitution_1 + rig.restitution_2)
    loss = rig.friction * rig.gravity * math.cos(rig.angle) * math.pi / omega
    # s = u_before + u_after as a + b V
    share = (restitution - mu) / (1.0 + mu)
    b = 2.0 * (1.0 + restitution) / (1.0 + mu) / (1.0 - share)
    a = -loss * (1.0 + share) / (1.0 - share)
    # F = C (V - mu s/2) + (2 omega m/pi) s
    force = abs(rig.force_amplitudes[0])
    push = 2.0 * omega * rig.damper_mass / math.pi - 0.5 * mu * rig.damping
    speed = (force - push * a) / (rig.damping + push * b)
    return (speed - 0.5 * mu * (a + b * speed)) / omega


def ideal_ratio(rig: RigParameters) -> float:
    """Return the `ideal_amplitude` over the amplitude without impacts."""
    return ideal_amplitude(rig) / rig.response_amplitude


#: Samples per natural period, for the mean square of X.
_SAMPLES = 24


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run; the rig starts at rest."""

    #: Identifies its result.
    key: tuple[object, ...]
    rig: RigParameters
    control: GapControlParameters = field(default_factory=GapControlParameters)
    #: Natural periods before the measurement, and of it.
    settle: float = 200.0
    watch: float = 60.0
    #: Ends of intervals, s, if the peak in the latter half of each is measured instead.
    intervals: tuple[float, ...] = ()
    #: Natural periods at which the force takes another amplitude, N.
    levels: tuple[tuple[float, float], ...] = ()
    history: bool = False  # whether the largest |X| of each natural period is kept


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The result of a run."""

    #: Root mean square and largest modulus of X, m.
    rms: float
    peak: float
    impacts: int  # number of impacts
    #: Mean power spent by both actuators, and dissipated by impacts and dashpot, W.
    actuator_power: float
    impact_power: float
    dashpot_power: float
    #: Largest |X| in the latter half of each interval, or in each natural period, m.
    peaks: tuple[float, ...] = ()


class _Stretch:
    """What is measured of a stretch of a run."""

    def __init__(self, rig: RigParameters, samples: Any, impacts: Any) -> None:
        x, speed = samples['x'][1:], samples['primary_velocity'][1:]
        before = impacts['damper_velocity_before'] - impacts['primary_velocity_before']
        after = impacts['damper_velocity_after'] - impacts['primary_velocity_after']
        reduced = rig.damper_mass / (1.0 + rig.mass_ratio)
        self.rms = float(np.sqrt(np.mean(x * x)))
        self.peak = _largest(samples, impacts)
        self.impacts = len(impacts)
        #: J.
        self.lost = 0.5 * reduced * float(np.sum(before * before - after * after))
        #: W.
        self.dashpot_power = rig.damping * float(np.mean(speed * speed))


def _largest(samples: Any, impacts: Any) -> float:
    """Return the largest |X|, at samples and impacts and where M turns between them, m."""
    times = np.concatenate([samples['time'], impacts['time']])
    order = np.argsort(times, kind='stable')
    times = times[order]
    x = np.concatenate([samples['x'], impacts['x']])[order]
    rate = samples['primary_velocity']
    before = np.concatenate([rate, impacts['primary_velocity_before']])[order]
    after = np.concatenate([rate, impacts['primary_velocity_after']])[order]
    step = np.diff(times)
    apart = step > 0.0
    turns, out = turning_points(
        step[apart], np.diff(x)[apart], after[:-1][apart], before[1:][apart]
    )
    turned = x[:-1][apart][turns] + out
    return float(np.abs(np.concatenate([x, turned])).max())


class _Meter:
    """Advance a rig and measure it on the way."""

    def __init__(self, case: Case) -> None:
        self.rig = Rig(case.rig, control=case.control, compiled=None)
        self.step = math.tau / case.rig.omega / _SAMPLES
        self.levels = [(start * _SAMPLES, amplitude) for start, amplitude in sorted(case.levels)]
        self.ticks = 0

    def spent(self) -> float:
        """Return the energy that the actuators have spent so far, J."""
        return sum(self.rig.energies)

    def advance(self, ticks: int, *, measured: bool = True) -> _Stretch | None:
        """Advance by some sampling intervals; the force changes before the first of them only."""
        rig = self.rig
        if self.levels and self.ticks >= self.levels[0][0]:
            _, amplitude = self.levels.pop(0)
            rig.change(rig.parameters.replace(force_amplitudes=[amplitude]))
        first, self.ticks = self.ticks, self.ticks + ticks
        instants = self.step * np.arange(first, self.ticks + 1) if measured else ()
        found = rig.run(self.step * self.ticks, instants, record=measured)
        if found.reason:
            raise EndlessEventsError(found.reason)
        return _Stretch(rig.parameters, found.samples, found.impacts()) if measured else None

    def result(self, ticks: int, peaks: Sequence[float] = ()) -> Measured:
        """Advance by some sampling intervals and return the result."""
        spent = self.spent()
        found = self.advance(ticks)
        assert found is not None
        span = ticks * self.step
        return Measured(
            rms=found.rms,
            peak=found.peak,
            impacts=found.impacts,
            actuator_power=(self.spent() - spent) / span,
            impact_power=found.lost / span,
            dashpot_power=found.dashpot_power,
            peaks=(*peaks, found.peak) if peaks else (),
        )


def run_case(case: Case) -> Measured:
    """Make a run."""
    meter = _Meter(case)
    ends = case.intervals
    if ends:
        stretches = [
            (round(0.5 * (begin + end) / meter.step), round(end / meter.step))
            for begin, end in zip((0.0, *ends), ends, strict=False)
        ]
    else:
        settle, watch = round(case.settle * _SAMPLES), round(case.watch * _SAMPLES)
        stretches = [(settle, settle + watch)]
        if case.history:
            stretches = [
                (settle + k * _SAMPLES, settle + (k + 1) * _SAMPLES)
                for k in range(round(case.watch))
            ]
    peaks = []
    for begin, end in stretches:
        if begin > meter.ticks:
            meter.advance(begin - meter.ticks, measured=False)
        if end < stretches[-1][1]:
            found = meter.advance(end - begin)
            assert found is not None
            peaks.append(found.peak)
    return meter.result(stretches[-1][1] - meter.ticks, peaks)


#: What 1000 natural periods take, s of an idle core: at resonance, under broadband excitation, and
#: how many times as long with the predictive law; and what reading the compiled code takes.
_SECONDS, _SECONDS_BROADBAND, _PREDICTIVE = 0.05, 0.15, 6.0


def cost_of(case: Case) -> float:
    """Return how long a run takes on an idle core, compiled, s."""
    periods = case.settle + case.watch
    if case.intervals:
        periods = case.intervals[-1] * case.rig.omega / math.tau
    broadband = case.rig.multisine_level > 0.0
    cost = 1e-3 * periods * (_SECONDS_BROADBAND if broadband else _SECONDS)
    return cost * (_PREDICTIVE if case.control.gap_control == 'predictive' else 1.0)


#: The best fixed gap at 1 N for each angle, over the optimal gap of the ideal amplitude.
_Shares = Mapping[int, float]

#: zeta = 0.01, mu = 0.1, R = 0.5, level, no friction; at resonance 50 m/N without impacts.
RIG = RigParameters(
    damping=0.02, damper_mass=0.1, restitution_1=0.5, restitution_2=0.5, gravity=0.0, gap=20.0
)
#: The basic rig of Bapat (1995), friction 0.5, g = 1 m/s^2.
INCLINED = RigParameters(friction=0.5, gravity=1.0)
ANGLES = (15, 45)
#: Frequencies of the broadband excitation, rad/s.
_BAND = (0.5, 2.0)
_LINES = 48
LAWS = ('amplitude symmetric', 'amplitude', 'timed symmetric', 'timed', 'predictive')
#: The laws with independent stops.
INDEPENDENT_LAWS = ('amplitude', 'timed', 'predictive')
#: Speed of real stops, m/s for a force of 1 N, and mass of each, kg.
REAL_SPEED, REAL_MASS = 16.0, 0.01
#: Disturbances and their values: natural periods, m/s, relative to the amplitude, per period.
SENSITIVITIES: dict[str, tuple[float, ...]] = {
    'delay': (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
    'speed': (1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0, 64.0),
    'noise': (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2),
    'sampling': (6.0, 8.0, 12.0, 16.0, 20.0, 32.0, 64.0, 100.0),
}
#: Samples of the controller per natural period, unless they are varied.
_RATE = 32
#: Frequencies of the stepped sine, rad/s.
_STEPPED_LOW, _STEPPED_HIGH = 0.8, 1.2


@dataclass(frozen=True, kw_only=True)
class Extent:
    """The number and length of the runs; lengths are in natural periods."""

    #: Force levels at resonance, N.
    levels: tuple[float, ...] = tuple(2.0 ** (k / 2) for k in range(-4, 5))
    seeds: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7, 8)  # seeds of the broadband excitation
    #: Fixed gaps, over the optimal gap of the ideal amplitude at 1 N.
    gaps: tuple[float, ...] = tuple(k / 100 for k in range(60, 111))
    #: Fixed gaps under broadband excitation, m; finer where the best ones are.
    broadband_gaps: tuple[float, ...] = tuple(
        k / 4 for k in range(32, 153) if k % 4 == 0 or 56 < k < 100
    )
    #: Before and during the measurement at resonance.
    settle: float = 240.0
    watch: float = 80.0
    broadband: float = 200.0  # under broadband excitation
    #: Step of the stepped sine, rad/s, and time at each frequency.
    frequency_step: float = 0.01
    frequency_dwell: float = 25.0
    load_span: float = 120.0  # from one change of the load to the next

    @classmethod
    def quick(cls) -> Extent:
        """Return a few short runs of each part."""
        return cls(
            levels=(0.25, 1.0, 4.0),
            seeds=(1,),
            gaps=(0.75, 0.85),
            broadband_gaps=(14.0, 20.0),
            settle=160.0,
            watch=40.0,
            broadband=130.0,
            frequency_step=0.1,
            frequency_dwell=20.0,
        )

    def at_resonance(self, key: tuple[object, ...], rig: RigParameters, **values: Any) -> Case:
        """Return a run at resonance."""
        return Case(key=key, rig=rig, settle=self.settle, watch=self.watch, **values)

    def under_broadband(self, key: tuple[object, ...], seed: int, **values: Any) -> Case:
        """Return a run under broadband excitation."""
        given = {'rig': broadband_rig(seed), **values}
        return Case(key=key, settle=0.1 * self.broadband, watch=0.9 * self.broadband, **given)


def law(name: str, rig: RigParameters, **values: Any) -> GapControlParameters:
    """Return the control for a law named as in `LAWS`."""
    mode, _, stops = name.partition(' ')
    given: dict[str, Any] = {'gap_control_rate': _RATE * rig.omega / math.tau, **values}
    return GapControlParameters(
        gap_control=mode, gap_control_stops=stops or 'independent', **given
    )


def broadband_rig(seed: int) -> RigParameters:
    """Return the rig under a random-phase multisine of 1 N rms."""
    return RIG.replace(
        force_amplitudes=[0.0],
        multisine_level=1.0,
        multisine_low=_BAND[0],
        multisine_high=_BAND[1],
        multisine_lines=_LINES,
        multisine_seed=seed,
    )


def stepped_frequencies(extent: Extent) -> tuple[float, ...]:
    """Return the frequencies of the stepped sine, up and down, rad/s."""
    count = round((_STEPPED_HIGH - _STEPPED_LOW) / extent.frequency_step)
    up = [_STEPPED_LOW + k * extent.frequency_step for k in range(count + 1)]
    return (*up, *reversed(up[:-1]))


def optimal_gap(rig: RigParameters) -> float:
    """Return the optimal gap for the ideal amplitude, m."""
    return damper_of(rig).optimal_gap(ideal_amplitude(rig), math.inf)


def inclined_rig(angle: int) -> RigParameters:
    """Return the rig for an angle, degrees: `RIG` if level, else `INCLINED`."""
    return INCLINED.replace(angle=math.radians(angle)) if angle else RIG


def tuning_cases(extent: Extent) -> list[Case]:
    """Return the runs that find the best fixed gap at 1 N, of the level and inclined rigs."""
    rigs = {angle: inclined_rig(angle) for angle in (0, *ANGLES)}
    return [
        extent.at_resonance(('tuning', angle, share), rig.replace(gap=share * optimal_gap(rig)))
        for angle, rig in rigs.items()
        for share in extent.gaps
    ]


def _level_cases(angle: int, extent: Extent, shares: _Shares) -> Iterator[Case]:
    rig = inclined_rig(angle)
    for level in extent.levels:
        forced = rig.replace(force_amplitudes=[level])
        fixed = forced.replace(gap=shares[angle] * optimal_gap(rig))
        yield extent.at_resonance(('level', angle, 'fixed', level), fixed)
        for one in LAWS:
            yield extent.at_resonance(('level', angle, one, level), forced, control=law(one, rig))


def _broadband_cases(extent: Extent) -> Iterator[Case]:
    for seed in extent.seeds:
        for gap in extent.broadband_gaps:
            rig = broadband_rig(seed).replace(gap=gap)
            yield extent.under_broadband(('broadband', 'fixed', gap, seed), seed, rig=rig)
        for one in LAWS:
            yield extent.under_broadband(('broadband', one, seed), seed, control=law(one, RIG))


def _stepped_cases(extent: Extent, shares: _Shares) -> Iterator[Case]:
    dwell = extent.frequency_dwell * math.tau
    count = len(stepped_frequencies(extent))
    stepped = RIG.replace(
        sweep_mode='up_down',
        sweep_low=_STEPPED_LOW,
        sweep_high=_STEPPED_HIGH,
        sweep_step=extent.frequency_step,
        sweep_dwell=dwell,
        gap=shares[0] * optimal_gap(RIG),
    )
    intervals = tuple(dwell * (k + 1) for k in range(count))
    yield Case(key=('stepped', 'fixed'), rig=stepped, intervals=intervals)
    for one in INDEPENDENT_LAWS:
        yield Case(key=('stepped', one), rig=stepped, intervals=intervals, control=law(one, RIG))


def _load_cases(extent: Extent, shares: _Shares) -> Iterator[Case]:
    span = extent.load_span
    base = Case(
        key=(),
        rig=RIG.replace(gap=shares[0] * optimal_gap(RIG)),
        settle=0.0,
        watch=3.0 * span,
        levels=((span, 4.0), (2.0 * span, 0.25)),
        history=True,
    )
    yield replace(base, key=('load', 'fixed'))
    for one in INDEPENDENT_LAWS:
        yield replace(base, key=('load', one), control=law(one, RIG))


def _disturbed(what: str, value: float) -> dict[str, float]:
    """Return the parameters of control and actuators for a disturbance."""
    # Relative to X, and to its rate
    spread = value * ideal_amplitude(RIG)
    return {
        'delay': {'actuator_delay': value * math.tau},
        'speed': {'actuator_speed': value},
        'noise': {'gap_control_noise_position': spread, 'gap_control_noise_velocity': spread},
        'sampling': {'gap_control_rate': value / math.tau},
    }[what]


def _sensitivity_cases(extent: Extent) -> Iterator[Case]:
    for what, values in SENSITIVITIES.items():
        for value in values if len(extent.seeds) > 1 else values[2:4]:
            for one in INDEPENDENT_LAWS:
                control = law(one, RIG, **_disturbed(what, value))
                yield extent.at_resonance(('sensitivity', what, one, value), RIG, control=control)
                if one != 'amplitude':
                    key = ('sensitivity broadband', what, one, value)
                    yield extent.under_broadband(key, extent.seeds[0], control=control)


def _real_cases(extent: Extent) -> Iterator[Case]:
    """Return runs with stops of finite speed, which scales with the force."""
    for one in INDEPENDENT_LAWS:
        for level in extent.levels:
            control = law(one, RIG, actuator_speed=REAL_SPEED * level, actuator_mass=REAL_MASS)
            forced = RIG.replace(force_amplitudes=[level])
            yield extent.at_resonance(('real', 'level', one, level), forced, control=control)
        control = law(one, RIG, actuator_speed=REAL_SPEED, actuator_mass=REAL_MASS)
        for seed in extent.seeds:
            yield extent.under_broadband(('real', 'broadband', one, seed), seed, control=control)


def all_cases(extent: Extent, shares: _Shares) -> list[Case]:
    """Return all other runs, the longest first, given the best fixed gaps."""
    cases = [
        *_stepped_cases(extent, shares),
        *_broadband_cases(extent),
        *_sensitivity_cases(extent),
        *_real_cases(extent),
        *_load_cases(extent, shares),
    ]
    for angle in (*ANGLES, 0):
        cases += _level_cases(angle, extent, shares)
    return cases
