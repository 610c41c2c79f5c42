"""Runs of the gap control study: a rig under a control, and what is measured of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from impact_damper_ros.control import Action, ControlledRig, GapControlParameters
from impact_damper_ros.rig import Event, EventKind, RigParameters

from .swing import Swing

__all__ = ['Case', 'Response', 'run_case']

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
