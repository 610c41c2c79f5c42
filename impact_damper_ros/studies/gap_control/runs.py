"""The runs of the gap control study: which rigs run under which control, and what is measured."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from impact_damper_ros.control import Action, ControlledRig, GapControlParameters, damper_of
from impact_damper_ros.rig import Event, EventKind, RigParameters
from impact_damper_ros.rig.swing import Swing

__all__ = [
    'ANGLES',
    'BAND',
    'INCLINED',
    'LAWS',
    'RIG',
    'SENSITIVITIES',
    'Case',
    'Extent',
    'Response',
    'Shares',
    'all_cases',
    'broadband_rig',
    'ideal_amplitude',
    'ideal_ratio',
    'inclined_rig',
    'law',
    'run_case',
    'sensitivity_values',
    'sweep_frequencies',
    'tuning_cases',
]


def ideal_amplitude(rig: RigParameters) -> float:
    """
    Return the amplitude of X at resonance with both impacts where |X'| is largest, m.

    Notes
    -----
    m flies for half a cycle each way at a mean speed u in the laboratory, and loses L = friction
    g cos(angle) pi/omega of its speed on the way, whichever way it goes; weight only makes the
    two flights unequal, and to first order leaves their mean. With V the speed of M just before
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
    """Return that amplitude over the one without impacts."""
    return ideal_amplitude(rig) / rig.response_amplitude


#: Samples per natural period: the mean square of X is taken from them.
_SAMPLES = 24
#: Looks per natural period in a history.
_HISTORY_PERIODS = 1.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """
    One run.

    Attributes
    ----------
    key : tuple
        What it is to be found by.
    rig : RigParameters
        The rig; it starts at rest.
    control : GapControlParameters
        Its control.
    settle, watch : float
        Natural periods before the measurement, and of it.
    stretches : tuple of float
        If given, the ends of stretches of time, s; the peak of the latter half of each is
        measured instead of the whole.
    levels : tuple of (float, float)
        Natural period from which on the force has another amplitude, and that amplitude, N.
    history : bool
        Whether the largest |X| of each natural period is kept.
    """

    key: tuple[object, ...]
    rig: RigParameters
    control: GapControlParameters = field(default_factory=GapControlParameters)
    settle: float = 200.0
    watch: float = 60.0
    stretches: tuple[float, ...] = ()
    levels: tuple[tuple[float, float], ...] = ()
    history: bool = False


@dataclass(frozen=True, kw_only=True)
class Response:
    """
    What was measured.

    Attributes
    ----------
    rms, peak : float
        Root mean square and largest modulus of X, m.
    impacts, commands : int
        Impacts, and commands to the stops, in the measured time.
    actuator_power, impact_power, dashpot_power : float
        Mean power spent by both actuators, and taken by impacts and dashpot, W.
    peaks : tuple of float
        Largest |X| in the latter half of each stretch, or in each natural period, m.
    """

    rms: float
    peak: float
    impacts: int
    commands: int
    actuator_power: float
    impact_power: float
    dashpot_power: float
    peaks: tuple[float, ...] = ()


def _impact_loss(rig: RigParameters, events: Sequence[Event]) -> float:
    """Return the energy that impacts have taken, J."""
    reduced = rig.damper_mass / (1.0 + rig.mass_ratio)
    lost = 0.0
    for event in events:
        if event.kind is EventKind.IMPACT:
            before = event.damper_velocity_before - event.primary_velocity_before
            after = event.damper_velocity_after - event.primary_velocity_after
            lost += 0.5 * reduced * (before * before - after * after)
    return lost


class _Meter:
    """Advances a rig and measures it on the way."""

    def __init__(self, case: Case) -> None:
        self.rig = ControlledRig(case.rig, control=case.control)
        self.step = math.tau / case.rig.omega / _SAMPLES
        self.levels = [(start * _SAMPLES, amplitude) for start, amplitude in sorted(case.levels)]
        self.ticks = 0
        self.clear()

    def clear(self) -> None:
        """Begin to measure."""
        self.swing = Swing()
        self.squares = self.rates = self.lost = 0.0
        self.count = self.impacts = self.commands = 0
        self.spent = sum(self.rig.energies)

    def advance(self, ticks: int) -> None:
        """Go on by so many samples."""
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

    def response(self, peaks: Sequence[float] = ()) -> Response:
        """Return what has been measured."""
        span = self.count * self.step
        return Response(
            rms=math.sqrt(self.squares / self.count),
            peak=self.swing.largest,
            impacts=self.impacts,
            commands=self.commands,
            actuator_power=(sum(self.rig.energies) - self.spent) / span,
            impact_power=self.lost / span,
            dashpot_power=self.rig.parameters.damping * self.rates / self.count,
            peaks=tuple(peaks),
        )


def run_case(case: Case) -> Response:
    """Carry out a run."""
    meter = _Meter(case)
    peaks: list[float] = []
    if case.stretches:
        for begin, end in zip((0.0, *case.stretches), case.stretches, strict=False):
            half = round((0.5 * (begin + end)) / meter.step) - meter.ticks
            meter.advance(half)
            meter.clear()
            meter.advance(round(end / meter.step) - meter.ticks)
            peaks.append(meter.swing.largest)
        return meter.response(peaks)
    meter.advance(round(case.settle * _SAMPLES))
    meter.clear()
    if case.history:
        for _ in range(round(case.watch / _HISTORY_PERIODS)):
            meter.advance(round(_HISTORY_PERIODS * _SAMPLES))
            peaks.append(meter.swing.largest)
            meter.swing = Swing()
        return meter.response(peaks)
    meter.advance(round(case.watch * _SAMPLES))
    return meter.response()


#: By angle, the best fixed gap at level 1, over the optimal gap of the ideal amplitude.
Shares = Mapping[int, float]

#: zeta = 0.01, mu = 0.1, R = 0.5, level, without friction; at resonance, X = 50 m per N if alone.
RIG = RigParameters(
    damping=0.02, damper_mass=0.1, restitution_1=0.5, restitution_2=0.5, gravity=0.0, gap=20.0
)
#: The basic rig of Bapat (1995), friction 0.5, g = 1 m/s^2.
INCLINED = RigParameters(friction=0.5, gravity=1.0)
ANGLES = (15, 45)
#: Of the broadband excitation, rad/s.
BAND = (0.5, 2.0)
_LINES = 48
LAWS = ('amplitude symmetric', 'amplitude', 'timed symmetric', 'timed')
SENSITIVITIES = ('delay', 'speed', 'noise', 'sampling')
#: Samples of the controller per natural period, unless that is what is varied.
_RATE = 32
_SWEEP_LOW, _SWEEP_HIGH = 0.8, 1.2


@dataclass(frozen=True, kw_only=True)
class Extent:
    """
    How much is run.

    Attributes
    ----------
    levels : tuple of float
        Force levels at resonance, N.
    seeds : tuple of int
        Of the broadband excitation.
    gaps : tuple of float
        Fixed gaps, over the optimal gap of the ideal amplitude at level 1.
    broadband_gaps : tuple of float
        Fixed gaps under broadband excitation, m.
    settle, watch, broadband : float
        Natural periods at resonance before and during the measurement, and under broadband.
    sweep_step, sweep_dwell : float
        Of the stepped sine: rad/s and natural periods.
    load_span : float
        Natural periods from one change of the load to the next.
    """

    levels: tuple[float, ...] = tuple(2.0 ** (k / 2) for k in range(-4, 5))
    seeds: tuple[int, ...] = (1, 2, 3)
    gaps: tuple[float, ...] = (0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05)
    broadband_gaps: tuple[float, ...] = (
        8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 28.0, 32.0, 38.0,
    )  # fmt: skip
    settle: float = 240.0
    watch: float = 80.0
    broadband: float = 200.0
    sweep_step: float = 0.01
    sweep_dwell: float = 25.0
    load_span: float = 120.0

    @classmethod
    def quick(cls) -> Extent:
        """Return a look at each part, in a few seconds."""
        return cls(
            levels=(0.25, 1.0, 4.0),
            seeds=(1,),
            gaps=(0.75, 0.85),
            broadband_gaps=(14.0, 20.0),
            settle=160.0,
            watch=40.0,
            broadband=130.0,
            sweep_step=0.1,
            sweep_dwell=20.0,
        )


def law(name: str, rig: RigParameters, **values: Any) -> GapControlParameters:
    """Return the control of a law named as in `LAWS`, for the study's rigs."""
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
        multisine_low=BAND[0],
        multisine_high=BAND[1],
        multisine_lines=_LINES,
        multisine_seed=seed,
    )


def sweep_frequencies(extent: Extent) -> tuple[float, ...]:
    """Return the frequencies of the stepped sine, up and down, rad/s."""
    count = round((_SWEEP_HIGH - _SWEEP_LOW) / extent.sweep_step)
    up = [_SWEEP_LOW + k * extent.sweep_step for k in range(count + 1)]
    return (*up, *reversed(up[:-1]))


def _tuned(rig: RigParameters, share: float) -> float:
    """Return a share of the optimal gap of the ideal amplitude, m."""
    return share * damper_of(rig).optimal_gap(ideal_amplitude(rig), math.inf)


def inclined_rig(angle: int) -> RigParameters:
    """Return the rig of an angle, degrees: the level one, or that with weight and friction."""
    return INCLINED.replace(angle=math.radians(angle)) if angle else RIG


def tuning_cases(extent: Extent) -> list[Case]:
    """Return the runs that find the best fixed gap at level 1, of the level and inclined rigs."""
    return [
        Case(
            key=('tuning', angle, share),
            rig=rig.replace(gap=_tuned(rig, share)),
            settle=extent.settle,
            watch=extent.watch,
        )
        for angle in (0, *ANGLES)
        for rig in (inclined_rig(angle),)
        for share in extent.gaps
    ]


def _level_cases(angle: int, extent: Extent, shares: Shares) -> Iterator[Case]:
    rig = inclined_rig(angle)
    base = Case(key=(), rig=rig, settle=extent.settle, watch=extent.watch)
    for level in extent.levels:
        forced = rig.replace(force_amplitudes=[level])
        fixed = forced.replace(gap=_tuned(rig, shares[angle]))
        yield replace(base, key=('level', angle, 'fixed', level), rig=fixed)
        for one in LAWS:
            key = ('level', angle, one, level)
            yield replace(base, key=key, rig=forced, control=law(one, rig))


def _broadband_case(seed: int, extent: Extent, **values: Any) -> Case:
    return Case(
        **{
            'key': (),
            'rig': broadband_rig(seed),
            'settle': 0.1 * extent.broadband,
            'watch': 0.9 * extent.broadband,
            **values,
        }
    )


def _broadband_cases(extent: Extent) -> Iterator[Case]:
    for seed in extent.seeds:
        rig = broadband_rig(seed)
        for gap in extent.broadband_gaps:
            key = ('broadband', 'fixed', gap, seed)
            yield _broadband_case(seed, extent, key=key, rig=rig.replace(gap=gap))
        for one in LAWS:
            key_2 = ('broadband', one, seed)
            yield _broadband_case(seed, extent, key=key_2, control=law(one, RIG))


def _sweep_cases(extent: Extent, shares: Shares) -> Iterator[Case]:
    dwell = extent.sweep_dwell * math.tau
    count = len(sweep_frequencies(extent))
    swept = RIG.replace(
        sweep_mode='up_down',
        sweep_low=_SWEEP_LOW,
        sweep_high=_SWEEP_HIGH,
        sweep_step=extent.sweep_step,
        sweep_dwell=dwell,
        gap=_tuned(RIG, shares[0]),
    )
    stretches = tuple(dwell * (k + 1) for k in range(count))
    yield Case(key=('sweep', 'fixed'), rig=swept, stretches=stretches)
    for one in ('amplitude', 'timed'):
        yield Case(key=('sweep', one), rig=swept, stretches=stretches, control=law(one, RIG))


def _load_cases(extent: Extent, shares: Shares) -> Iterator[Case]:
    span = extent.load_span
    base = Case(
        key=(),
        rig=RIG.replace(gap=_tuned(RIG, shares[0])),
        settle=0.0,
        watch=3.0 * span,
        levels=((span, 4.0), (2.0 * span, 0.25)),
        history=True,
    )
    yield replace(base, key=('load', 'fixed'))
    for one in ('amplitude', 'timed'):
        yield replace(base, key=('load', one), control=law(one, RIG))


def sensitivity_values(what: str) -> tuple[float, ...]:
    """Return the values of a sensitivity: natural periods, m/s, part of the amplitude, 1."""
    return {
        'delay': (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
        'speed': (1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0, 64.0),
        'noise': (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2),
        'sampling': (6.0, 8.0, 12.0, 16.0, 20.0, 32.0, 64.0, 100.0),
    }[what]


def _disturbed(what: str, value: float) -> dict[str, Any]:
    if what == 'delay':
        return {'actuator_delay': value * math.tau}
    if what == 'speed':
        return {'actuator_speed': value}
    if what == 'noise':
        # Of X over its amplitude, and of X' over that of X', at the ideal
        spread = value * ideal_amplitude(RIG)
        return {'gap_control_noise_position': spread, 'gap_control_noise_velocity': spread}
    return {'gap_control_rate': value / math.tau}


def _sensitivity_cases(extent: Extent) -> Iterator[Case]:
    for what in SENSITIVITIES:
        values = sensitivity_values(what)
        for value in values if len(extent.seeds) > 1 else values[2:4]:
            for one in ('amplitude', 'timed'):
                control = law(one, RIG, **_disturbed(what, value))
                yield Case(
                    key=('sensitivity', what, one, value),
                    rig=RIG,
                    control=control,
                    settle=extent.settle,
                    watch=extent.watch,
                )
                if one == 'timed':
                    key = ('sensitivity broadband', what, one, value)
                    yield _broadband_case(extent.seeds[0], extent, key=key, control=control)


def _energy_cases(extent: Extent) -> Iterator[Case]:
    for one in ('amplitude', 'timed'):
        control = law(one, RIG, actuator_speed=16.0, actuator_mass=0.01)
        yield Case(
            key=('energy', 'resonance', one),
            rig=RIG,
            control=control,
            settle=extent.settle,
            watch=extent.watch,
        )
        key = ('energy', 'broadband', one)
        yield _broadband_case(extent.seeds[0], extent, key=key, control=control)


def all_cases(extent: Extent, shares: Shares) -> list[Case]:
    """
    Return all other runs, those that take longest first.

    Parameters
    ----------
    extent : Extent
        How much.
    shares : mapping of int to float
        Result of the `tuning_cases`.
    """
    cases = [
        *_sweep_cases(extent, shares),
        *_broadband_cases(extent),
        *_sensitivity_cases(extent),
        *_energy_cases(extent),
        *_load_cases(extent, shares),
    ]
    for angle in (*ANGLES, 0):
        cases += _level_cases(angle, extent, shares)
    return cases
