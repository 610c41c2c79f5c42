# SPDX-License-Identifier: Apache-2.0
"""
Flights of a rig as arrays: the motion between events in closed form, many flights at once.

A row is the state just after an event. From there M is a driven oscillator, and m moves under its
weight, friction and air, or with M, until the next row. Integrals are those of Gauss, exact to
round-off; extremes are turning points. Where a bag has no snapshot, its samples are rows, too, and
each recorded state begins a flight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EVENT_TYPE, EventKind
from impact_damper_ros.motion.kernels import call_kernel
from impact_damper_ros.parameters.parameter_spec import check_kind
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Events, Outcome, one_table
from impact_damper_ros.rig.runaway import RunawayError

from .flight_integrals import (
    EQUATION_COLUMNS,
    EQUATION_SLIDE,
    FLIGHT_COLUMNS,
    NO_POINTS,
    NO_SERIES,
    SUM_BASE,
    SUM_FORCE,
    SUM_LARGEST,
    Integrals,
    integrate_flights,
    trace_flights,
    write_flights,
)
from .flights import machine_of, packed_constants
from .response import Array, forced_response, unit_response
from .transmissibility import Moments

Mask = NDArray[np.bool_]

#: Kind of rows that are no events: the state at some instant.
STATE = 0
#: Direction in which the air drives m, by the stop hit last.
_AWAY: Array = np.array([0.0, -1.0, 1.0])


def rows_of_samples(samples: NDArray[np.void]) -> Events:
    """Return samples as rows."""
    rows = np.zeros(len(samples), EVENT_TYPE)
    rows['time'], rows['x'], rows['kind'] = samples['time'], samples['x'], STATE
    rows['y'] = np.subtract(samples['z'], samples['x'])
    for side in ('before', 'after'):
        rows[f'primary_velocity_{side}'] = samples['primary_velocity']
        rows[f'damper_velocity_{side}'] = samples['damper_velocity']
    return rows


def number_points(counts: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Return for each of some points in flights the flight, and the number of the point in it."""
    index: NDArray[np.intp] = np.repeat(np.arange(len(counts), dtype=np.intp), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


class Drive(NamedTuple):
    """The force at an instant."""

    time: float  # rig time, s
    angles: tuple[float, ...]  # angles turned by the harmonics, without their phases, rad
    frequencies: tuple[float, ...]  # frequencies of the harmonics, rad/s

    @property
    def cycle(self) -> float:
        """Duration of a cycle of the first harmonic that turns, s; infinity if none does."""
        rate = self._turning[1]
        return math.tau / rate if rate else math.inf

    @property
    def zero(self) -> float:
        """The last instant not after `time` at which that harmonic's angle was zero, s."""
        angle, frequency = self._turning
        return self.time - (angle % math.tau) / (frequency or math.inf)

    def phase(self, time: Array) -> Array:
        """Return the cycles of that harmonic since `zero`."""
        return (time - self.zero) / self.cycle

    @property
    def _turning(self) -> tuple[float, float]:
        """Angle, rad, and frequency, rad/s, of the first harmonic that is no constant force."""
        pairs = zip(self.angles, self.frequencies, strict=True)
        return next(((angle, rate) for angle, rate in pairs if rate), (0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Flights:
    """
    Consecutive flights of a rig with constant parameters.

    Without the phase of the force the motion between the rows is unknown.

    Attributes
    ----------
    rig : RigParameters
        The rig.
    rows : ndarray of EVENT_TYPE, shape (n + 1,)
        State just after the events that begin the flights, and at the end of the last one.
    drive : Drive or None
        The force at an instant, if its phase is known.
    together : ndarray of bool, shape (n + 1,)
        Whether M and m move as one after each row.
    stop : ndarray of int, shape (n + 1,)
        The stop hit last, 0 for none.
    first : ndarray, shape (n + 1, 3)
        Amplitude (N), frequency (rad/s) and phase (rad) of the force's first harmonic.
    angle : ndarray, shape (n + 1,)
        Angle turned by the first harmonic, rad.
    active : ndarray, shape (n + 1,)
        Active force on M, N.

    Examples
    --------
    >>> from impact_damper_ros.rig.rig import Rig
    >>> flights = run_flights(Rig(RigParameters(gravity=0.0)), 60.0)
    >>> flights
    <Flights: 8 from 0 to 60 s, 7 impacts>
    >>> bool(flights.integrals()[0].total > 0.0)
    True
    """

    rig: RigParameters
    rows: Events
    drive: Drive | None
    together: Mask
    stop: NDArray[np.int64]
    first: Array
    angle: Array
    active: Array

    @classmethod
    def between(
        cls,
        rig: RigParameters,
        rows: Events,
        drive: Drive | None,
        steps: Array | None = None,
        active: float = 0.0,
    ) -> Flights:
        """
        Return the flights between rows.

        The first row has the mode and the stop hit last; `drive` is the force there, and `active`
        the active force, N. `steps` are the first harmonics, as rows of `first`, before and after
        each of the frequency steps among the rows.
        """
        count = len(rows)
        together, stop = np.empty(count, np.bool_), np.empty(count, np.int64)
        force = np.full(count, active)
        call_kernel(trace_flights, rows, together, stop, force)
        first: Array = np.broadcast_to(rig.first_harmonic, (len(rows), 3))
        angle = np.full(len(rows), np.nan)
        if drive is not None:
            if steps is not None:
                begins: Mask = rows['kind'] == EventKind.FREQUENCY_STEP
                first = steps[np.cumsum(begins)]
                rates = np.append(first[:1, 1], first[:-1, 1])
                spans = np.diff(rows['time'], prepend=drive.time)
                angle = drive.angles[0] + np.cumsum(rates * spans)
            else:
                angle = drive.angles[0] + drive.frequencies[0] * (rows['time'] - drive.time)
        return cls(rig, rows, drive, together, stop, first, angle, force)

    @classmethod
    def join(cls, parts: Sequence[Flights]) -> Flights:
        """Return the flights of parts, each of which begins where the one before ends."""
        first = parts[0]
        if len(parts) == 1:
            return first
        names = ('rows', 'together', 'stop', 'first', 'angle', 'active')
        columns = {
            name: np.concatenate(
                [getattr(first, name), *(getattr(part, name)[1:] for part in parts[1:])]
            )
            for name in names
        }
        return cls(first.rig, drive=first.drive, **columns)

    def __len__(self) -> int:
        return len(self.rows) - 1

    def __repr__(self) -> str:
        """Return the times of the flights and the number of their impacts in a line."""
        start, end = self.rows['time'][[0, -1]] if len(self.rows) else (0.0, 0.0)
        return (
            f'<Flights: {len(self)} from {start:.6g} to {end:.6g} s, '
            f'{plural(len(self.impacts), "impact")}>'
        )

    def __getitem__(self, chosen: slice) -> Flights:
        begin, end, _ = chosen.indices(len(self))
        columns = (getattr(self, f.name)[begin : end + 1] for f in fields(self)[3:])
        return Flights(self.rig, self.rows[begin : end + 1], self.drive, *columns)

    @property
    def starts(self) -> Array:
        """Instants at which the flights begin, s."""
        starts: Array = self.rows['time'][:-1]
        return starts

    @cached_property
    def spans(self) -> Array:
        """Durations of the flights, s."""
        return np.diff(self.rows['time'])

    @cached_property
    def _written(self) -> tuple[Array, Array]:
        equations, columns = (
            np.empty((len(self), count)) for count in (EQUATION_COLUMNS, FLIGHT_COLUMNS)
        )
        start = 0.0 if self.drive is None else float(self.drive.time)
        call_kernel(
            *(write_flights, self.rows, self.together, self.stop, self.active),
            *(np.array(self.first, order='C'), self.angle, start),
            *(packed_constants(self.rig), equations, columns),
        )
        return equations, columns

    @property
    def equations(self) -> Array:
        """The equations of motion without the active force, by `EQUATION_` columns."""
        return self._written[0]

    @property
    def columns(self) -> Array:
        """Columns of the flights for kernels, beside the equations, where the force is known."""
        return self._written[1]

    def drive_after(self) -> Drive | None:
        """Return the force at the last row."""
        if self.drive is None:
            return None
        time = float(self.rows['time'][-1])
        pairs = zip(self.drive.angles, self.drive.frequencies, strict=True)
        angles = [angle + rate * (time - self.drive.time) for angle, rate in pairs]
        rates = (float(self.first[-1, 1]), *self.drive.frequencies[1:])
        return Drive(time, (float(self.angle[-1]), *angles[1:]), rates)

    @property
    def impacts(self) -> Events:
        """The impacts among the rows."""
        hits: Events = self.rows[self.rows['kind'] == EventKind.IMPACT]
        return hits

    @cached_property
    def _harmonics(self) -> tuple[tuple[float, ...], ...]:
        return self.rig.harmonics

    def line(self, number: int, index: NDArray[np.intp]) -> tuple[NDArray[np.complex128], Array]:
        """Return the phasor of a harmonic where flights begin, N, and its frequency, rad/s."""
        assert self.drive is not None
        amplitude: Any
        phase: Any
        if number:
            amplitudes, _, phases = self._harmonics
            amplitude, phase = amplitudes[number], phases[number]
            driven = np.full(len(index), self.drive.frequencies[number])
            begin = self.rows['time'][index] - self.drive.time
            angle = self.drive.angles[number] + driven * begin
        else:
            (amplitude, driven, phase), angle = self.first[index].T, self.angle[index]
        return amplitude * np.exp(1j * (np.remainder(angle, math.tau) + phase)), driven

    def base(self, index: NDArray[np.intp], tau: Array) -> tuple[Array, Array, Array]:
        """Return b, b' and b'' in flights, times (s) after their beginnings."""
        base = np.zeros((3, len(index)))
        for number in range(*self.rig.base_rows.indices(len(self._harmonics[0]))):
            force, driven = self.line(number, index)
            # The force is K b + C b'
            line = force / (self.rig.stiffness + 1j * self.rig.damping * driven)
            line *= np.exp(1j * driven * tau)
            base += [line.imag, driven * line.real, -driven * driven * line.imag]
        return base[0], base[1], base[2]

    def motion(self, index: NDArray[np.intp], tau: Array) -> tuple[Array, Array, Array, Array]:
        """Return X, X', X'' and the force (N) in flights, times (s) after their beginnings."""
        assert self.drive is not None
        begin = self.rows[:-1][index]
        decay, damped, stiffness, push, share, _, _ = self.equations[index].T
        push = push + share * self.active[index]
        less, impulse, slope = unit_response(decay, damped, tau)
        x_0, v_0 = begin['x'] - push / stiffness, begin['primary_velocity_after']
        x = begin['x'] + x_0 * less + v_0 * impulse
        velocity = slope * v_0 - stiffness * impulse * x_0
        force = np.zeros_like(tau)
        for j, amplitude in enumerate(self._harmonics[0]):
            if amplitude == 0.0:
                continue
            turned, driven = self.line(j, index)
            place, speed = forced_response(decay, damped, driven, tau)
            x = x + share * (turned * place).imag
            velocity = velocity + share * (turned * speed).imag
            force += np.imag(turned * np.exp(1j * driven * tau))
        rate = push + share * force
        acceleration = rate - 2.0 * decay * velocity - stiffness * x
        return x, velocity, acceleration, force + self.active[index]

    def damper(
        self, index: NDArray[np.intp], tau: Array, x: Array, velocity: Array
    ) -> tuple[Array, Array]:
        """Return Y and Y' at times in flights, from X and X' at these times."""
        begin, fall = self.rows[:-1][index], self.equations[index, EQUATION_SLIDE]
        speed: Array = begin['damper_velocity_after']
        relative = np.subtract(speed, begin['primary_velocity_after'])
        z = np.add(begin['x'], begin['y']) + tau * (speed + 0.5 * tau * fall)
        # In bounces that are not resolved m is on the stop.
        held = np.where(begin['kind'] == EventKind.IMPACT, 0.0, relative)
        joint = self.together[index]
        return (
            np.where(joint, begin['y'] + held * tau, z - x),
            np.where(joint, held, speed + fall * tau - velocity),
        )

    def state_at(self, place: int, time: float) -> Events:
        """Return the state in a flight at an instant, s, as a row."""
        index, tau = np.array([place]), np.array([time - float(self.starts[place])])
        x, velocity, _, _ = self.motion(index, tau)
        y, relative = self.damper(index, tau, x, velocity)
        row = self.rows[place : place + 1].copy()
        for side in ('before', 'after'):
            row[f'primary_velocity_{side}'] = velocity
            row[f'damper_velocity_{side}'] = velocity + relative
        row['time'], row['x'], row['y'], row['kind'], row['stop'] = time, x, y, STATE, 0
        return row

    def cut(self, start: float, end: float) -> Flights:
        """Return the motion from one instant to another, as far as it is known, s."""
        times = self.rows['time']
        first = max(0, int(np.searchsorted(times, start, side='right')) - 1)
        last = max(first, int(np.searchsorted(times, end, side='left')))
        inside = self[first : min(last, len(self))]
        if self.drive is None or not len(inside):
            return inside
        rows = inside.rows.copy()
        for place, at, row in ((0, start, 0), (len(inside) - 1, end, -1)):
            if 0.0 < at - float(inside.starts[place]) < inside.spans[place]:
                rows[row] = inside.state_at(place, at)
        angle = inside.angle.copy()
        angle[0] += inside.first[0, 1] * (rows['time'][0] - inside.starts[0])
        columns = (inside.together, inside.stop, inside.first, angle, inside.active)
        return Flights(self.rig, rows, self.drive, *columns)

    @property
    def lines(self) -> Array:
        """The harmonics, with the angles that they have turned at the force's time 0."""
        assert self.drive is not None
        sizes, _, phases = self._harmonics
        turned, of_base = np.add(phases, self.drive.angles), np.zeros(len(sizes))
        of_base[self.rig.base_rows] = 1.0
        return np.column_stack([sizes, self.drive.frequencies, turned, of_base])

    @cached_property
    def _sums(self) -> list[float]:
        """Sums over the flights, in the order of `SUM_TIME` and so on."""
        rows, rig = self.rows, self.rig
        sums = np.zeros(SUM_LARGEST + 1)
        sums[SUM_LARGEST] = np.abs(rows['x']).max(initial=0.0) if len(rows) else math.nan
        if self.drive is not None:
            rates = [rig.omega, *rig.harmonics[1]]
            fastest = max(rates + ([rig.sweep_high] if rig.sweep_mode != 'off' else []))
            arrays = rows, self.equations, self.columns, self.lines, NO_POINTS.copy()
            numbers = fastest, rig.stiffness, rig.damping, rig.base_motion.moves
            call_kernel(integrate_flights, *arrays, *numbers, NO_SERIES.copy(), sums)
        else:
            sums[SUM_FORCE:SUM_BASE] = math.nan
        found: list[float] = sums.tolist()
        return found

    def moments(self) -> tuple[Moments, float]:
        """Return the sums of which mean squares are made, and the largest |X|, as `integrals`."""
        sums = self._sums
        return Moments(*sums[:SUM_FORCE], *sums[SUM_BASE:SUM_LARGEST]), sums[SUM_LARGEST]

    def integrals(self) -> tuple[Integrals, float]:
        """
        Return integrals, and the largest |X|.

        Returns
        -------
        Integrals
            Integrals over the flights.
        float
            The largest |X|, m; NaN without any row.
        """
        rows, rig = self.rows, self.rig
        shaken = rig.base_motion.moves
        covered, total, squares, force, active, dashpot, *based, largest = self._sums
        if shaken and self.drive is not None and len(self):
            force += float(np.diff(self._spring_energy())[0])
        rise = np.diff(rows['y'])
        grip = machine_of(rig).constants.grip * rig.damper_mass
        friction = grip * float(np.abs(rise[~self.together[:-1]]).sum())
        air = rig.air_force * float(np.sum(_AWAY[self.stop[:-1]] * rise))
        hits = rows[1:]
        primary = _loss_of(hits, 'primary', rig.primary_mass)
        both = primary + _loss_of(hits, 'damper', rig.damper_mass)
        impact = hits['kind'] == EventKind.IMPACT
        integrals = Integrals(
            covered,
            total,
            squares,
            force,
            active,
            dashpot,
            friction,
            air,
            float(both.sum()),
            float(primary[impact].sum()),
            float(both[impact].sum()),
            *based,
        )
        return integrals, largest

    def _spring_energy(self) -> Array:
        """Return the energy of the spring at both ends, beyond that without the base, J."""
        if self.drive is None or not self.rig.base_motion.moves:
            return np.zeros(2)
        index, tau = np.array([0, len(self) - 1]), np.array([0.0, self.spans[-1]])
        base, x = self.base(index, tau)[0], self.rows['x'][[0, -1]]
        energy: Array = self.rig.stiffness * base * (0.5 * base - x)
        return energy

    def stored_energy(self) -> float:
        """Return the change of kinetic and potential energy, J."""
        rig, ends = self.rig, self.rows[[0, -1]]
        speed, damper = ends['primary_velocity_after'], ends['damper_velocity_after']
        slope = rig.gravity * math.sin(rig.angle)
        energy = 0.5 * (rig.primary_mass * speed**2 + rig.stiffness * ends['x'] ** 2)
        energy += self._spring_energy()
        energy += rig.damper_mass * (0.5 * damper**2 - slope * (ends['x'] + ends['y']))
        return float(energy[1] - energy[0])

    def curve(self, per_second: float) -> tuple[Array, Array, Array, Array, Array]:
        """
        Return instants, X, X', Y and Y', with both sides of each event.

        Without a known force only the rows are returned.
        """
        if self.drive is None:
            rows = np.repeat(self.rows, 2)
            late = np.arange(len(rows)) % 2 == 1
            speed, damper = (
                np.where(late, rows[f'{mass}_velocity_after'], rows[f'{mass}_velocity_before'])
                for mass in ('primary', 'damper')
            )
            return rows['time'], rows['x'], speed, rows['y'], damper - speed
        # Round-off does not add a point.
        count = np.ceil(self.spans * per_second - 1e-9).astype(np.int64) + 1
        index, number = number_points(count)
        tau = np.repeat(self.spans / np.maximum(count - 1, 1), count) * number
        x, velocity, _, _ = self.motion(index, tau)
        return self.starts[index] + tau, x, velocity, *self.damper(index, tau, x, velocity)


def _loss_of(rows: Events, mass_name: str, mass: float) -> Array:
    """Return the kinetic energy that a mass lost in each of some events, J."""
    before, after = rows[f'{mass_name}_velocity_before'], rows[f'{mass_name}_velocity_after']
    # A difference of squares, without cancellation
    lost: Array = 0.5 * mass * (before - after) * (before + after)
    return lost


class FlightStart(NamedTuple):
    """A state of a rig from which flights are recorded, as long as its parameters stay."""

    row: Events
    drive: Drive
    active: float  # force of a controller, N

    @classmethod
    def of(cls, rig: Rig) -> FlightStart:
        """Return the present state of a rig, its row with its mode and the stop hit last."""
        here, state, row = rig.sample(), rig.state(), np.empty(1, EVENT_TYPE)
        speeds = (here.primary_velocity,) * 2 + (here.damper_velocity,) * 2
        last = state.run.last_stop, state.run.mode
        row[0] = (here.time, here.x, here.z - here.x, *speeds, 0.0, STATE, *last)
        drive = Drive(state.run.time, tuple(state.angles), rig.parameters.harmonics[1])
        return cls(row, drive, state.run.force)

    def flights(
        self,
        parameters: RigParameters,
        events: Events,
        last: Events,
        steps: Array | None = None,
    ) -> Flights:
        """Return the flights to a last row, given all events on the way; see `Flights.between`."""
        rows = one_table(self.row, events, last)
        return Flights.between(parameters, rows, self.drive, steps, self.active)


def run_flights(rig: Rig, end: float) -> Flights:
    """
    Run a rig to a time, and return its flights on the way.

    Parameters
    ----------
    rig : Rig
        The rig, which is run on. Its force must not be swept.
    end : float
        The time, s.

    Returns
    -------
    Flights
        The motion on the way, whose energies and mean squares are exact (`measured`).

    Raises
    ------
    TypeError
        If the rig is no `Rig`.
    RunawayError
        If the rig has too many events; it then stays at the last one.

    Examples
    --------
    >>> flights = run_flights(Rig(RigParameters(gravity=0.0)), 60.0)
    >>> flights
    <Flights: 8 from 0 to 60 s, 7 impacts>
    """
    check_kind('rig', rig, Rig, 'a Rig, such as Rig(parameters)')
    begin = FlightStart.of(rig)
    run = rig.run(end)
    if run.outcome is not Outcome.COMPLETE:
        raise RunawayError(run.reason)
    return begin.flights(rig.parameters, run.events, FlightStart.of(rig).row)
