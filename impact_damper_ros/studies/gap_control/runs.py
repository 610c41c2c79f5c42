"""The runs of the gap control study: rigs, their control, and what is measured of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from impact_damper_ros.control import Action, ControlledRig, GapControlParameters, damper_of
from impact_damper_ros.rig import Event, EventKind, RigParameters
from impact_damper_ros.rig.swing import Swing


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
    #: Whether the largest |X| of each natural period is kept.
    history: bool = False


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The result of a run."""

    #: Root mean square and largest modulus of X, m.
    rms: float
    peak: float
    #: Impacts, and commands to the stops.
    impacts: int
    commands: int
    #: Mean power spent by both actuators, and dissipated by impacts and dashpot, W.
    actuator_power: float
    impact_power: float
    dashpot_power: float
    #: Largest |X| in the latter half of each interval, or in each natural period, m.
    peaks: tuple[float, ...] = ()


def _impact_loss(rig: RigParameters, events: Sequence[Event]) -> float:
    """Return the energy that impacts dissipate, J."""
    reduced = rig.damper_mass / (1.0 + rig.mass_ratio)
    lost = 0.0
    for event in events:
        if event.kind is EventKind.IMPACT:
            before = event.damper_velocity_before - event.primary_velocity_before
            after = event.damper_velocity_after - event.primary_velocity_after
            lost += 0.5 * reduced * (before * before - after * after)
    return lost


class _Meter:
    """Advance a rig and measure it on the way."""

    def __init__(self, case: Case) -> None:
        self.rig = ControlledRig(case.rig, control=case.control)
        self.step = math.tau / case.rig.omega / _SAMPLES
        self.levels = [(start * _SAMPLES, amplitude) for start, amplitude in sorted(case.levels)]
        self.ticks = 0
        self.clear()

    def clear(self) -> None:
        """Begin a measurement."""
        self.swing = Swing()
        self.squares = self.rates = self.lost = 0.0
        self.count = self.impacts = self.commands = 0
        self.spent = sum(self.rig.energies)

    def advance(self, ticks: int) -> None:
        """Advance by some sampling intervals."""
        rig = self.rig
        for _ in range(ticks):
            if self.levels and self.ticks >= self.levels[0][0]:
                _, amplitude = self.levels.pop(0)
                rig.change(rig.parameters.replace(force_amplitudes=[amplitude]))
            self.ticks += 1
            events = rig.advance(self.ticks * self.step)
            sample = rig.sample()
            self.swing.look(sample, [e for e in events if e.kind is EventKind.IMPACT])
            self.squares += sample.x * sample.x
            self.rates += sample.primary_velocity**2
            self.lost += _impact_loss(rig.parameters, events)
            self.impacts += sum(e.kind is EventKind.IMPACT for e in events)
            self.commands += sum(r.action is Action.COMMAND for r in rig.records)
            self.count += 1

    def result(self, peaks: Sequence[float] = ()) -> Measured:
        """Return the result since the last `clear`."""
        span = self.count * self.step
        return Measured(
            rms=math.sqrt(self.squares / self.count),
            peak=self.swing.largest,
            impacts=self.impacts,
            commands=self.commands,
            actuator_power=(sum(self.rig.energies) - self.spent) / span,
            impact_power=self.lost / span,
            dashpot_power=self.rig.parameters.damping * self.rates / self.count,
            peaks=tuple(peaks),
        )


def run_case(case: Case) -> Measured:
    """Make a run."""
    meter = _Meter(case)
    peaks: list[float] = []
    if case.intervals:
        for begin, end in zip((0.0, *case.intervals), case.intervals, strict=False):
            half = round((0.5 * (begin + end)) / meter.step) - meter.ticks
            meter.advance(half)
            meter.clear()
            meter.advance(round(end / meter.step) - meter.ticks)
            peaks.append(meter.swing.largest)
        return meter.result(peaks)
    meter.advance(round(case.settle * _SAMPLES))
    meter.clear()
    if case.history:
        for _ in range(round(case.watch)):
            meter.advance(_SAMPLES)
            peaks.append(meter.swing.largest)
            meter.swing = Swing()
        return meter.result(peaks)
    meter.advance(round(case.watch * _SAMPLES))
    return meter.result()


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
LAWS = ('amplitude symmetric', 'amplitude', 'timed symmetric', 'timed')
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
    #: Seeds of the broadband excitation.
    seeds: tuple[int, ...] = (1, 2, 3)
    #: Fixed gaps, over the optimal gap of the ideal amplitude at 1 N.
    gaps: tuple[float, ...] = (0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05)
    #: Fixed gaps under broadband excitation, m.
    broadband_gaps: tuple[float, ...] = (
        8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 28.0, 32.0, 38.0,
    )  # fmt: skip
    #: Before and during the measurement at resonance.
    settle: float = 240.0
    watch: float = 80.0
    #: Under broadband excitation.
    broadband: float = 200.0
    #: Step of the stepped sine, rad/s, and time at each frequency.
    frequency_step: float = 0.01
    frequency_dwell: float = 25.0
    #: From one change of the load to the next.
    load_span: float = 120.0

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


def _gap(rig: RigParameters, share: float) -> float:
    """Return a share of the optimal gap for the ideal amplitude, m."""
    return share * damper_of(rig).optimal_gap(ideal_amplitude(rig), math.inf)


def inclined_rig(angle: int) -> RigParameters:
    """Return the rig for an angle, degrees: `RIG` if level, else `INCLINED`."""
    return INCLINED.replace(angle=math.radians(angle)) if angle else RIG


def tuning_cases(extent: Extent) -> list[Case]:
    """Return the runs that find the best fixed gap at 1 N, of the level and inclined rigs."""
    rigs = {angle: inclined_rig(angle) for angle in (0, *ANGLES)}
    return [
        extent.at_resonance(('tuning', angle, share), rig.replace(gap=_gap(rig, share)))
        for angle, rig in rigs.items()
        for share in extent.gaps
    ]


def _level_cases(angle: int, extent: Extent, shares: _Shares) -> Iterator[Case]:
    rig = inclined_rig(angle)
    for level in extent.levels:
        forced = rig.replace(force_amplitudes=[level])
        fixed = forced.replace(gap=_gap(rig, shares[angle]))
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
        gap=_gap(RIG, shares[0]),
    )
    intervals = tuple(dwell * (k + 1) for k in range(count))
    yield Case(key=('stepped', 'fixed'), rig=stepped, intervals=intervals)
    for one in ('amplitude', 'timed'):
        yield Case(key=('stepped', one), rig=stepped, intervals=intervals, control=law(one, RIG))


def _load_cases(extent: Extent, shares: _Shares) -> Iterator[Case]:
    span = extent.load_span
    base = Case(
        key=(),
        rig=RIG.replace(gap=_gap(RIG, shares[0])),
        settle=0.0,
        watch=3.0 * span,
        levels=((span, 4.0), (2.0 * span, 0.25)),
        history=True,
    )
    yield replace(base, key=('load', 'fixed'))
    for one in ('amplitude', 'timed'):
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
            for one in ('amplitude', 'timed'):
                control = law(one, RIG, **_disturbed(what, value))
                yield extent.at_resonance(('sensitivity', what, one, value), RIG, control=control)
            key = ('sensitivity broadband', what, 'timed', value)
            yield extent.under_broadband(key, extent.seeds[0], control=control)


def _energy_cases(extent: Extent) -> Iterator[Case]:
    for one in ('amplitude', 'timed'):
        control = law(one, RIG, actuator_speed=16.0, actuator_mass=0.01)
        yield extent.at_resonance(('energy', 'resonance', one), RIG, control=control)
        key = ('energy', 'broadband', one)
        yield extent.under_broadband(key, extent.seeds[0], control=control)


def all_cases(extent: Extent, shares: _Shares) -> list[Case]:
    """Return all other runs, the longest first, given the best fixed gaps."""
    cases = [
        *_stepped_cases(extent, shares),
        *_broadband_cases(extent),
        *_sensitivity_cases(extent),
        *_energy_cases(extent),
        *_load_cases(extent, shares),
    ]
    for angle in (*ANGLES, 0):
        cases += _level_cases(angle, extent, shares)
    return cases
