# SPDX-License-Identifier: Apache-2.0
"""
Stepped sine: a schedule of timed changes of the first harmonic.

A step changes the frequency of the first line of the force, or of the base where no force acts;
a base of constant velocity or acceleration changes its displacement with it. The angle of the line
is continuous, and so are the force and the place of the base. The instants of the steps are
counted from the start, so that a long sweep does not drift; where the size of the line changes, a
step waits for the next upward zero of the line.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import chain, repeat
from math import ceil, exp, floor, inf, log, log1p, nan, pi, tau
from operator import attrgetter
from typing import Any, NamedTuple

from impact_damper_ros.motion.state import Wave
from impact_damper_ros.parameters.base_motion import angles_after
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters

# A range this little longer than a whole number of steps ends with the last of them.
_WHOLE = 1e-9
#: A phase this near to a zero is at it, in cycles.
_AT_ZERO = 1e-9
_sweep_fields = attrgetter(*(name for name in PARAMETER_SPECS if name.startswith('sweep_')))


def step_count(parameters: RigParameters) -> int:
    """Return the number of steps of a whole sweep; 0 if there is none."""
    if parameters.sweep_mode == 'off':
        return 0
    low, high, step = parameters.sweep_low, parameters.sweep_high, parameters.sweep_step
    way = (high - low) / step
    if parameters.sweep_spacing == 'logarithmic':
        way = log(high / low) / log1p(step / low)
    once = max(1, ceil(way - _WHOLE))
    return 2 * once if parameters.sweep_mode == 'up_down' else once


def step_duration(parameters: RigParameters) -> float:
    """Return the time at each frequency of a sweep, s."""
    if not parameters.sweep_rate:
        return parameters.sweep_dwell
    octaves = log1p(parameters.sweep_step / parameters.sweep_low) / log(2.0)
    return 60.0 * octaves / parameters.sweep_rate


def _frequency(parameters: RigParameters, step: int) -> float:
    """
    Return the frequency of the first harmonic after a number of steps of the sweep, rad/s.

    Up and down go through the same frequencies: from the low end on in whole steps, and the high
    end, to which the last step may be a shorter one.
    """
    steps = step_count(parameters)
    once = steps // 2 if parameters.sweep_mode == 'up_down' else steps
    place = min(max(step, 0), steps)
    if parameters.sweep_mode == 'down':
        place = steps - place
    place = min(place, 2 * once - place)
    if place == once:
        return parameters.sweep_high
    if parameters.sweep_spacing == 'logarithmic':
        ratio = log1p(parameters.sweep_step / parameters.sweep_low)
        return min(parameters.sweep_low * exp(place * ratio), parameters.sweep_high)
    return parameters.sweep_low + place * parameters.sweep_step


def _notch_factor(parameters: RigParameters, frequency: float) -> float:
    """Return the factor of the level at a frequency, a power of it between two points."""
    places, factors = parameters.sweep_notch_frequencies, parameters.sweep_notch_factors
    k = bisect_right(places, frequency)
    if k in (0, len(places)):
        return factors[min(k, len(places) - 1)]
    share = log(frequency / places[k - 1]) / log(places[k] / places[k - 1])
    return factors[k - 1] * exp(share * log(factors[k] / factors[k - 1]))


@lru_cache(maxsize=64)
def rig_at(parameters: RigParameters, step: int) -> RigParameters:
    """Return a rig as it is after a number of steps of its sweep; as it is without a sweep."""
    if parameters.sweep_mode == 'off':
        return parameters
    frequency = _frequency(parameters, step)
    return parameters.with_first_frequency(frequency, _notch_factor(parameters, frequency))


def _waits_for_zero(parameters: RigParameters) -> bool:
    """Return whether the size of the line changes from step to step."""
    if any(factor != 1.0 for factor in parameters.sweep_notch_factors):
        return True
    return parameters.swept == 'base' and parameters.base_quantity != 'displacement'


def _zero_from(parameters: RigParameters, asked: float, now: float, angle: float) -> float:
    """
    Return the first upward zero of the swept line later than now and not before `asked`, s.

    The line has the given angle now; with NaN it passes zero upwards now.
    """
    amplitude, frequency, phase = parameters.first_line
    period = tau / frequency
    way = ((0.0 if amplitude > 0.0 else pi) - angle - phase) / tau % 1.0
    zero = now if not way < 1.0 - _AT_ZERO else now + way * period
    due = zero + max(0, ceil((asked - zero) / period - _AT_ZERO)) * period
    return due if due > now else due + period


class SteppedSine(NamedTuple):
    """
    State of a sweep: its start, the steps that are done, and the instant of the next.

    Attributes
    ----------
    start : float
        When the sweep was started, s.
    step : int
        Steps done.
    due : float
        Instant of the next step, s; infinity after the last one.
    """

    start: float
    step: int = 0
    due: float = inf

    @classmethod
    def at(
        cls, parameters: RigParameters, start: float, step: int, now: float, angle: float
    ) -> SteppedSine:
        """
        Return the state of a sweep that has done some steps.

        Times are in s; `angle` is that of the swept line now, rad. A sweep that is off has no
        start.
        """
        if parameters.sweep_mode == 'off':
            return cls(0.0)
        here = cls(start, step)
        if step >= step_count(parameters):
            return here
        due = start + (step + 1) * step_duration(parameters)
        if _waits_for_zero(parameters):
            due = _zero_from(rig_at(parameters, step), due, now, angle)
        return here._replace(due=due)

    def as_dict(self) -> dict[str, float | None]:
        """Return the state for JSON, which has no infinity."""
        return {**self._asdict(), 'due': None if self.due == inf else self.due}

    @classmethod
    def of_dict(cls, stored: Mapping[str, Any]) -> SteppedSine:
        """Read what `as_dict` returned."""
        due = stored['due']
        return cls(stored['start'], stored['step'], inf if due is None else due)

    def following(self, parameters: RigParameters) -> SteppedSine:
        """Return the sweep after its next step."""
        steps, dwell = step_count(parameters), step_duration(parameters)
        if not _waits_for_zero(parameters):
            after = self._replace(step=self.step + 1)
            due = inf if after.step >= steps else self.start + (after.step + 1) * dwell
            return after._replace(due=due)
        # Steps that are shorter than a cycle are taken together.
        step = max(self.step + 1, floor((self.due - self.start) / dwell + _AT_ZERO))
        after = self._replace(step=min(step, steps))
        if after.step == steps:
            return after._replace(due=inf)
        asked = self.start + (after.step + 1) * dwell
        return after._replace(due=_zero_from(rig_at(parameters, after.step), asked, self.due, nan))


class TimedStep(NamedTuple):
    """A step of a schedule: its instant, s, and the rig from then on."""

    time: float
    parameters: RigParameters


def stepped_sine(parameters: RigParameters, sweep: SteppedSine) -> Iterator[TimedStep]:
    """Yield the steps of a sweep that are still to come."""
    while sweep.due < inf:
        due, sweep = sweep.due, sweep.following(parameters)
        yield TimedStep(due, rig_at(parameters, sweep.step))


class FirstAngle(NamedTuple):
    """
    The angle of the first harmonic until its frequency changes, in cycles.

    Phases, those of orbits too, count from its zeros, whatever the phase of the force is.
    """

    time: float  # an instant, s
    turned: float  # until then
    rate: float  # Hz

    @classmethod
    def of(cls, rig: RigParameters, time: float, angle: float) -> FirstAngle:
        """Return the angle of a rig whose first harmonic has turned by `angle`, rad."""
        return cls(time, angle / tau, rig.first_harmonic[1] / tau)

    def at(self, time: float) -> float:
        """Return the angle at an instant."""
        return self.turned + (time - self.time) * self.rate

    def after_step(self, time: float, rig: RigParameters) -> FirstAngle:
        """Return the angle from a step of the frequency on, after which the rig is that one."""
        return FirstAngle.of(rig, time, tau * self.at(time))


def sweep_of(parameters: RigParameters) -> tuple[object, ...]:
    """Return the parameters of a sweep: a change of any of them starts the sweep anew."""
    return _sweep_fields(parameters)


def waves_after(before: RigParameters, waves: Sequence[Wave], after: RigParameters) -> list[Wave]:
    """
    Return the state of each harmonic after a change of parameters.

    A harmonic keeps its angle, by its index in its group; an added harmonic begins with zero.
    Angles of the base follow from `angles_after`.
    """
    groups: dict[str, list[float]] = {}
    first = 0
    for name, (amplitudes, _, _) in before.harmonic_groups.items():
        groups[name] = [wave.angle for wave in waves[first : first + len(amplitudes)]]
        first += len(amplitudes)
    base, other = before.base_motion, after.base_motion
    if base != other:
        groups['base'] = angles_after(base, groups.get('base', []), other)
    angles = [
        angle
        for name, (amplitudes, _, _) in after.harmonic_groups.items()
        for angle, _ in zip(chain(groups.get(name, []), repeat(0.0)), amplitudes, strict=False)
    ]
    return list(map(Wave, angles))
