"""The simulator: a rig in motion, its snapshots, and changes to it."""

from __future__ import annotations

from math import inf, nan, ulp
from typing import Any, NamedTuple, Self

from .arguments import as_float, need
from .changes import changed, check_command, kept_angles
from .crossing import sided
from .event import Event, EventKind, EventRows
from .forcing import SWEEP_FIELDS, SteppedSine, frequency_at, frequency_steps
from .hybrid_motion import HybridMotion, starting_time
from .mode import STICK, RigConstants, launch, rig_constants
from .origin import Origin
from .parameters import InitialConditions, RigParameters
from .quoting import shown
from .run_loop import first_end, stops_moved
from .state_checks import LATEST, SAME_TIME, check_number, check_origin, check_whole

_FORMAT = 2
#: Formats that can be read. The first had neither moving stops nor a stepped sine.
FORMATS = (1, 2)
#: Raised when the same motion gets other last bits: older runs then agree to round-off only.
#: 1 polished roots by certified steps alone, 2 by the closed form, 3 completed a chatter however
#: high its bounces were, 4 polished the passages of X through zero by bisection and took the
#: measured Y from the difference of Z and X, 5 looked for these passages by certified steps alone,
#: 6 summed short flights harmonic by harmonic and polished passages by the closed form, 7 rounded
#: the sine of a harmonic's turn in a step twice, took the nominal gap for the bound of a chatter,
#: and began the estimate of the amplitude at 0.
ARITHMETIC = 8
#: Longest flight that is searched anew when a rig is restored, as an angle of the fastest of
#: spring and harmonics, rad: a minute or two.
_LONGEST = 1e7
#: Most steps of a search after which a longer flight must be known to go on, as where m sticks.
_STEPS = 256
#: Largest angle that these turn by from one float to the next, rad.
_COARSEST = 1e3


class Snapshot(NamedTuple):
    """
    A rig at one instant.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    origin : Origin
        Origin of the present flight, after the event that began it.
    time : float
        Time reached, s; the flight's origin may be earlier.
    unreported : tuple of Event
        Events at the start that have not been reported yet.
    sweep : SteppedSine
        State of the stepped sine.
    """

    parameters: RigParameters
    origin: Origin
    time: float
    unreported: tuple[Event, ...]
    sweep: SteppedSine

    def as_dict(self) -> dict[str, Any]:
        """Return the snapshot as numbers, texts, lists and dictionaries."""
        origin = {
            name: None if value in (inf, -inf) else value
            for name, value in self.origin._asdict().items()
        }
        return {
            'format': _FORMAT,
            'arithmetic': ARITHMETIC,
            'time': self.time,
            'origin': {**origin, 'angles': list(self.origin.angles)},
            'unreported': [list(event) for event in self.unreported],
            'sweep': self.sweep._asdict(),
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in self.parameters.as_dict().items()
            },
        }

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Snapshot:
        """
        Read a snapshot written by `as_dict`.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something, or no rig can be in that
            state.
        """
        if not isinstance(stored, dict):
            raise ValueError(f'snapshot is {shown(stored)}: give a dictionary, as it was taken')
        version = stored.get('format')
        if version not in FORMATS:
            known = ' and '.join(map(str, FORMATS))
            raise ValueError(f'snapshot of format {shown(version)}: this version reads {known}')
        try:
            parameters = RigParameters(**stored['parameters'])
            check_number('time', stored['time'], LATEST)
            held = dict(stored['origin'])
            if version == 1:
                half = 0.5 * parameters.gap
                held |= {'target_1': half, 'target_2': -half}
            check_origin(held, stored['time'], len(parameters.harmonics[0]))
            values: dict[str, Any] = {n: inf if v is None else v for n, v in held.items()}
            # The first format had no stepped sine; one that is off starts at 0.
            sweep = SteppedSine(**stored.get('sweep', {'start': 0.0}))
            _check_sweep(sweep, parameters, stored['time'])
            origin = Origin(**{**values, 'angles': tuple(map(float, values['angles']))})
            _check_search(parameters, sweep, origin, stored['time'])
            return cls(
                parameters=parameters,
                origin=origin,
                time=float(stored['time']),
                unreported=tuple(
                    Event(event[0], EventKind(event[1]), *event[2:])
                    for event in stored.get('unreported', [])
                ),
                sweep=sweep,
            )
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            raise ValueError(f'snapshot is not complete: {error}') from error


def _check_sweep(sweep: SteppedSine, parameters: RigParameters, time: float) -> None:
    """Check a stored sweep of a rig at a time, s: the steps due by then, and no more, are done."""
    check_number('sweep.start', sweep.start, LATEST)
    check_whole('sweep.step', sweep.step, 0, frequency_steps(parameters))
    done = sweep.start + sweep.step * parameters.sweep_dwell
    due = sweep.due(parameters)
    if parameters.sweep_mode != 'off' and not done - SAME_TIME <= time <= due + SAME_TIME:
        raise ValueError(
            f'sweep.step is {sweep.step}, from {done!r} s to {due!r} s: it must be the one at '
            f'time, {time!r} s'
        )


def _check_search(
    parameters: RigParameters, sweep: SteppedSine, origin: Origin, time: float
) -> None:
    """Check that the flight of an origin can be searched up to a time, s, and beyond it."""
    constants = rig_constants(parameters, frequency_at(parameters, sweep.step))
    fastest, spacing = constants.free.fastest, ulp(time)
    if spacing * fastest > _COARSEST:
        raise ValueError(
            f'time is {time!r} s, where floats are {spacing:.3g} s apart, and the rig vibrates at '
            f'{fastest:.3g} rad/s: up to {_COARSEST / fastest * 2.0**52:.3g} s it can be followed'
        )
    since = time - origin.time
    if since * fastest <= _LONGEST:
        return
    flight = launch(constants, origin)
    ended, ending = first_end(origin, flight, since, _STEPS)
    if ended and ending.tau < since - SAME_TIME:
        raise ValueError(
            f'the flight from origin.time ends at {origin.time + ending.tau!r} s, before time, '
            f'{time!r} s'
        )
    if ending.tau <= since:
        raise ValueError(
            f'origin.time is {origin.time!r} s, {since:.6g} s before time, in which the rig '
            f'vibrates at {fastest:.3g} rad/s: a flight of up to {_LONGEST / fastest:.3g} s can '
            'be searched anew'
        )


def upgraded(stored: dict[str, Any]) -> dict[str, Any]:
    """
    Return a stored snapshot in the present format, with whatever else it holds.

    Raises
    ------
    ValueError
        If it is of another format or lacks something.
    """
    return {**stored, **Snapshot.from_dict(stored).as_dict()}


class Simulator(HybridMotion):
    """
    The hybrid motion of one rig.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts; at rest with m in the middle of the gap, if not given.
    time : float, optional
        Time at the start, s; from -1e13 to 1e13.

    Raises
    ------
    ParameterError
        If m would not start between the stops.
    ValueError
        If the time is out of range.

    Examples
    --------
    >>> rig = Simulator(RigParameters(gravity=0.0))
    >>> first = rig.advance(45.0)[0]
    >>> first.stop, round(first.time, 9)
    (1, 43.622660097)
    """

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
    ) -> None:
        """Start the rig."""
        need(RigParameters, parameters=parameters)
        need(InitialConditions, or_none=True, initial=initial)
        constants = rig_constants(parameters, frequency_at(parameters, 0))
        self._start(parameters, constants, initial or InitialConditions(), starting_time(time))

    def _start(
        self,
        parameters: RigParameters,
        constants: RigConstants,
        initial: InitialConditions,
        time: float,
    ) -> None:
        initial.check_within(parameters)
        half = constants.stop
        offset = initial.initial_damper_offset
        origin = Origin(
            time=time,
            time_low=0.0,
            mode=STICK,
            x=initial.initial_primary_position,
            velocity=initial.initial_primary_velocity,
            relative_velocity=initial.initial_damper_velocity - initial.initial_primary_velocity,
            clearance_1=half - offset,
            clearance_2=inf if constants.one_sided else half + offset,
            stop_1=half,
            stop_2=-half,
            angles=(0.0,) * len(constants.phases),
            last_stop=0,
            released=False,
            chatter_left=0.0,
            target_1=half,
            target_2=-half,
        )
        self._parameters = parameters
        self._constants = constants
        self._time = time
        self._sweep = SteppedSine.begun(parameters, time)
        self._step_due = self._sweep.due(parameters)
        # An impact at the very start, of m that moves into the stop it is on
        self._unreported = self._begin_all(origin)

    def change(self, parameters: RigParameters) -> list[Event]:
        """
        Let new parameters take effect at the present time, exactly.

        Parameters
        ----------
        parameters : RigParameters
            The new rig.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.

        Notes
        -----
        The angle turned by each harmonic is continuous, so that a change of frequency does not
        jump the force; an added harmonic starts at its phase. A change of a parameter of the
        stepped sine starts it anew, any other change leaves it alone. The position of M in the
        laboratory is continuous where its static deflection changes.

        Another `gap` or `one_sided` places both stops at half the gap from the middle, at once,
        and ends their movements. A stop that would pass m is placed at m instead; m hits it if m
        moves outwards, and the stop follows if m moves inwards.
        """
        need(RigParameters, parameters=parameters)
        if parameters == self._parameters:
            return []
        before = self._parameters
        if any(getattr(parameters, name) != getattr(before, name) for name in SWEEP_FIELDS):
            self._sweep = SteppedSine.begun(parameters, self._time)
        constants = rig_constants(parameters, frequency_at(parameters, self._sweep.step))
        shift = before.static_deflection - parameters.static_deflection
        here = self._present()
        if shift == 0.0:
            here = sided(self._constants.free, self._origin, self._flight, here)
        own = len(before.force_phases), len(parameters.force_phases)
        lines = len(self._constants.phases) - own[0], len(constants.phases) - own[1]
        angles = kept_angles(here.angles, own, lines)
        # An impact of the last reset is reported later, with X from the new equilibrium.
        self._unreported = [event._replace(x=event.x + shift) for event in self._unreported]
        origin = changed(here, self._constants, constants, shift, angles)
        self._parameters = parameters
        self._constants = constants
        self._step_due = self._sweep.due(parameters)
        return self._begin_all(origin)

    def move_stops(
        self, stop_1: float | None, stop_2: float | None, speed: float = inf
    ) -> list[Event]:
        """
        Move stops to other places in M, from the present time on.

        Parameters
        ----------
        stop_1, stop_2 : float or None
            Target Y of each stop, m; None leaves the stop as it is, or moving.
        speed : float, optional
            Speed relative to M, m/s; if infinite, the stops are there at once.

        Returns
        -------
        list of Event
            Events at the present time. Each movement ends with one event, now or later, unless
            another command comes before: `STOP_ARRIVED` at its target, or `STOP_TOUCHED` at m.

        Raises
        ------
        ParameterError
            If there is no such stop or a number is not admissible; nothing changes then.

        Notes
        -----
        A moving stop never does work. Where it meets m it stays until its next command
        (`STOP_TOUCHED`); if m moves outwards, m then hits the standing stop (`IMPACT`). A stop
        whose target is beyond m and that moves at once is placed at m. A stop that moves away
        from m at rest on it leaves m without support: friction holds m, or m leaves (`RELEASE`)
        and may catch up with the stop. Between two stops that both touch it, m cannot move in M,
        and the impact that ends its motion there is plastic.
        """
        constants = self._constants
        speed = as_float(speed)
        for stop, target in ((1, stop_1), (2, stop_2)):
            if target is not None:
                check_command(constants.one_sided, stop, target, speed)
        rows = EventRows()
        origin, written = stops_moved(
            constants,
            self._parameters.damper_mass,
            self._here,
            self._time,
            False,
            nan if stop_1 is None else float(stop_1),
            nan if stop_2 is None else float(stop_2),
            float(speed),
            rows,
            rows,
            0,
        )
        self._begin(origin)
        return rows.events(written)

    def reset(self, initial: InitialConditions | None = None) -> None:
        """
        Put the rig back to its initial conditions; the force starts anew, time goes on.

        Raises
        ------
        ParameterError
            If m would not start between the stops; the rig then runs on as before.
        """
        parameters = self._parameters
        constants = rig_constants(parameters, frequency_at(parameters, 0))
        self._start(parameters, constants, initial or InitialConditions(), self._time)

    def snapshot(self) -> dict[str, Any]:
        """
        Return all that the rig's future depends on.

        Returns
        -------
        dict
            The origin of the present flight, the parameters and the time reached; JSON keeps it
            exactly.
        """
        return self.state().as_dict()

    def state(self) -> Snapshot:
        """Return the snapshot as a record."""
        return Snapshot(
            self._parameters, self._origin, self._time, tuple(self._unreported), self._sweep
        )

    def state_here(self) -> Snapshot:
        """Return the snapshot with a flight that begins now: the same motion, to round-off."""
        return self.state()._replace(origin=self._present())

    @classmethod
    def restore(cls, snapshot: dict[str, Any]) -> Self:
        """
        Continue from a snapshot, bit for bit.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something, or no rig can be in that
            state.
        """
        return cls.resume(Snapshot.from_dict(snapshot))

    @classmethod
    def resume(cls, state: Snapshot) -> Self:
        """Continue from a result of `state`, bit for bit."""
        rig = cls.__new__(cls)
        rig._parameters = state.parameters
        rig._sweep = state.sweep
        rig._step_due = state.sweep.due(state.parameters)
        frequency = frequency_at(state.parameters, state.sweep.step)
        rig._constants = rig_constants(state.parameters, frequency)
        rig._time = state.time
        rig._unreported = list(state.unreported)
        rig._begin(state.origin)
        return rig
