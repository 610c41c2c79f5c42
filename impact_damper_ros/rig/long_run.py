"""
Long runs of one rig, in compiled code if there is any: samples and events as arrays.

`LongRun` is to `Simulator` what a drive is to a walk: the same way, to the last bit, without the
stops. Both begin and end with the same snapshots, so that one can take over from the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from importlib.util import find_spec
from math import inf
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .event import Event, EventKind, Sample
from .kernel_cache import compiling_alone
from .kernels import compiled as compile_kernels
from .kernels import stamp
from .mode import Mode, Origin, make_machine
from .parameters import InitialConditions, ParameterError, RigParameters
from .run_loop import DONE, FULL, MOST_ROWS, RUNAWAY, SPENT, Progress, run_through
from .simulator import Simulator
from .snapshot import Snapshot

__all__ = ['EVENT_TYPE', 'SAMPLE_TYPE', 'LongRun', 'Outcome', 'Stretch']

#: One event, as `Event`, and the mode after it.
EVENT_TYPE = np.dtype(
    [
        ('time', 'f8'),
        ('x', 'f8'),
        ('y', 'f8'),
        ('primary_velocity_before', 'f8'),
        ('primary_velocity_after', 'f8'),
        ('damper_velocity_before', 'f8'),
        ('damper_velocity_after', 'f8'),
        ('impulse', 'f8'),
        ('kind', 'i8'),
        ('stop', 'i8'),
        ('mode', 'i8'),
    ]
)
#: One sample, as `Sample`.
SAMPLE_TYPE = np.dtype([(name, 'f8') for name in Sample._fields])
#: Rows that the table of events begins with.
_ROWS = 512
#: Rows that it may be given beyond its double; memory that nothing is written to takes none.
_MOST_AHEAD = 1_000_000

Events = npt.NDArray[np.void]


class Outcome(IntEnum):
    """How an advance ended."""

    #: The time asked for was reached.
    COMPLETE = DONE
    #: The rig had as many events as it was allowed; it may go on.
    TOO_MANY_EVENTS = SPENT
    #: The rig has events without end at one instant, and cannot go on.
    RUNAWAY = RUNAWAY


class Stretch(NamedTuple):
    """
    What happened in one advance.

    Attributes
    ----------
    outcome : Outcome
        Whether the time asked for was reached.
    reason : str
        If not, why not and what helps; else empty.
    time : float
        Time reached, s.
    samples : ndarray of SAMPLE_TYPE
        Motion at each of the instants asked for, as far as they were reached.
    events : ndarray of EVENT_TYPE
        Events in order; empty if they were not to be recorded.
    event_count : int
        How many times the motion changed, recorded or not; an impact that ends in rest counts
        once.
    time_in_mode : ndarray of float, shape (8,)
        Time spent in each `Mode`, s.
    """

    outcome: Outcome
    reason: str
    time: float
    samples: npt.NDArray[np.void]
    events: Events
    event_count: int
    time_in_mode: npt.NDArray[np.float64]

    def impacts(self, stop: int = 0) -> Events:
        """Return the impacts among the events; those with one stop, if one is given."""
        wanted = self.events['kind'] == EventKind.IMPACT
        if stop:
            wanted &= self.events['stop'] == stop
        if wanted.all():
            return self.events
        found: Events = self.events[wanted]
        return found


@cache
def _compiled_loop() -> Any:
    """Return the compiled run loop."""
    return compile_kernels(cached=('run_through',))['run_through']


def _progress(reached: Any) -> Progress:
    """Return what the run loop has returned, by its names."""
    status, origin, *others = reached
    return Progress(status, Origin(*origin), *others)


def _table(events: Sequence[Event], mode: int) -> Events:
    """Return events as an array."""
    table = np.empty(len(events), EVENT_TYPE)
    for row, event in enumerate(events):
        for name, value in event._asdict().items():
            table[name][row] = value
    table['mode'] = mode
    return table


def _enlarged(table: Events, written: int, done: float) -> Events:
    """Return a full table with room for all the events, as far as one can tell from those yet."""
    wanted = 1.1 * written / done if done > 0.0 else inf
    double = 2 * len(table)
    larger = np.empty(int(min(max(wanted, double), double + _MOST_AHEAD)), EVENT_TYPE)
    larger[:written] = table[:written]
    return larger


class LongRun:
    """
    One rig for long runs.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts; at rest with m in the middle of the gap, if not given.
    time : float, optional
        Time at the start, s.
    compiled : bool, optional
        Whether to run compiled code; if not given, whether numba is installed. The results are
        the same, to the last bit.

    Raises
    ------
    ParameterError
        If m would not start between the stops, or the frequency is to be swept.
    ImportError
        If compiled code is asked for without numba (extra ``compiled``).

    Examples
    --------
    >>> run = LongRun(RigParameters(gravity=0.0))
    >>> settled = run.advance(2000.0, record=False)
    >>> stretch = run.advance(2100.0, instants=np.arange(2000.0, 2100.0))
    >>> len(stretch.samples), len(stretch.impacts(stop=1))
    (100, 16)
    """

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
        *,
        compiled: bool | None = None,
    ) -> None:
        """Start the rig."""
        self._compiled = _has_numba() if compiled is None else compiled
        if self._compiled:
            _compiled_loop()
        self._take(Simulator(parameters, initial, time).snapshot())

    def _take(self, snapshot: dict[str, Any]) -> None:
        self._state = Snapshot.from_dict(snapshot)
        if self._state.parameters.sweep_mode != 'off':
            raise ParameterError(
                'sweep_mode',
                f'sweep_mode is {self._state.parameters.sweep_mode!r}: a long run keeps its '
                'frequencies, give off, or let Simulator run the sweep',
            )
        machine: Any = make_machine(self._state.parameters)
        # One harmonic is compiled as such; any other number of them as arrays, once for all.
        self._arrays = self._compiled and len(machine.phases) != 1
        if self._arrays:
            machine = _with_arrays(machine)
        self._machine = machine

    @classmethod
    def restore(cls, snapshot: dict[str, Any], *, compiled: bool | None = None) -> LongRun:
        """
        Continue from a snapshot of a `LongRun` or a `Simulator`, bit for bit.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        run = cls.__new__(cls)
        run._compiled = _has_numba() if compiled is None else compiled
        run._take(snapshot)
        return run

    def snapshot(self) -> dict[str, Any]:
        """Return what the rig's future depends on, as `Simulator.snapshot` does."""
        return self._state.as_dict()

    def simulator(self) -> Simulator:
        """Return a simulator that goes on from here, bit for bit."""
        return Simulator.restore(self.snapshot())

    @property
    def time(self) -> float:
        """Time reached, s."""
        return self._state.time

    @property
    def parameters(self) -> RigParameters:
        """The rig's present parameters."""
        return self._state.parameters

    @property
    def mode(self) -> Mode:
        """Present mode, after any event at the present time."""
        return Mode(self._state.origin.mode)

    @property
    def compiled(self) -> bool:
        """Whether compiled code runs."""
        return self._compiled

    def change(self, parameters: RigParameters) -> list[Event]:
        """
        Let new parameters take effect at the present time, exactly, as `Simulator.change` does.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.
        """
        rig = self.simulator()
        events = rig.change(parameters)
        self._take(rig.snapshot())
        return events

    def advance(
        self,
        time: float,
        instants: npt.ArrayLike = (),
        *,
        record: bool = True,
        most_events: int = 1_000_000,
    ) -> Stretch:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s; not before the present one.
        instants : array_like of float, optional
            Instants at which to sample, s: ascending, from the present time to the one to reach.
        record : bool, optional
            Whether to return the events.
        most_events : int, optional
            How many events the rig may have on the way. Elastic stops to which m is pressed can
            have any number of them; then this ends the advance, and the outcome says so.

        Returns
        -------
        Stretch
            Samples and events, and whether the time was reached.

        Raises
        ------
        ValueError
            If a time is before the present one, not finite, or not in order.
        """
        state = self._state
        if not state.time <= time < inf:
            raise ValueError(
                f'cannot advance to {time!r} s: give a finite time not before {state.time!r} s'
            )
        when = np.array(instants, dtype=float).reshape(-1)
        in_order = bool(np.all(when[1:] >= when[:-1]))
        if len(when) and not (in_order and when[0] >= state.time and when[-1] <= time):
            raise ValueError(
                f'instants must ascend from {state.time!r} s to {time!r} s: sort them, and leave '
                'out those before and after'
            )
        samples = np.empty((len(when), len(Sample._fields)))
        in_mode = np.zeros(len(Mode))
        table = np.empty(_ROWS if record else 0, EVENT_TYPE)
        written = 0
        if record and state.unreported:
            unreported = _table(state.unreported, self.mode)
            written = len(unreported)
            table[:written] = unreported
        happened = 0
        progress = Progress(FULL, self._packed(state.origin), state.time, 0, 0, 0)
        while progress.status == FULL:
            if record and written + MOST_ROWS > len(table):
                done = (progress.time - state.time) / (time - state.time)
                table = _enlarged(table, written, done)
            progress = self._run(
                progress, time, when, samples, table[written:], most_events - happened, in_mode
            )
            happened += progress.happened
            written += progress.written
        table = table[:written]
        outcome = Outcome(progress.status)
        origin = progress.origin._replace(angles=tuple(map(float, progress.origin.angles)))
        self._state = Snapshot(state.parameters, origin, progress.time, (), state.sweep)
        return Stretch(
            outcome,
            self._reason(outcome, happened, state.time),
            progress.time,
            samples[: progress.sampled].view(SAMPLE_TYPE).reshape(-1),
            table,
            happened,
            in_mode,
        )

    def _packed(self, origin: Origin) -> Any:
        """Return an origin as the loop in use takes it."""
        angles: Any = np.array(origin.angles)
        return origin._replace(angles=angles) if self._arrays else origin

    def _run(
        self,
        progress: Progress,
        end: float,
        when: Any,
        samples: Any,
        table: Events,
        most: int,
        in_mode: Any,
    ) -> Progress:
        """Call the run loop, compiled or plain."""
        shape = len(table), len(EVENT_TYPE.names or ())
        arguments = (
            self._machine,
            self.parameters.damper_mass,
            progress.origin,
            progress.time,
            end,
            when,
            progress.sampled,
            samples,
            table.view('f8').reshape(shape),
            table.view('i8').reshape(shape),
            most,
            in_mode,
        )
        if not self._compiled:
            return _progress(run_through(*arguments))
        loop = _compiled_loop()
        if self._arrays in _READY:
            reached = loop(*arguments)
        else:
            with compiling_alone(stamp()):
                reached = loop(*arguments)
            _READY.add(self._arrays)
        return _progress(reached)

    def _reason(self, outcome: Outcome, happened: int, since: float) -> str:
        """Return why an advance ended before its time."""
        if outcome == Outcome.COMPLETE:
            return ''
        mode = self.mode.name.lower()
        if outcome == Outcome.TOO_MANY_EVENTS:
            return (
                f'{happened} events from {since!r} s to {self.time!r} s, the last of them in mode '
                f'{mode}: allow more events, or make the stops less elastic'
            )
        return (
            f'events without end at {self.time!r} s, in mode {mode}: make the stops less elastic, '
            'or report it with the snapshot if they are not'
        )


#: Kinds of rigs, with arrays or without, for which the loop is compiled in this process.
_READY: set[bool] = set()


@cache
def _has_numba() -> bool:
    return find_spec('numba') is not None


def _with_arrays(values: Any) -> Any:
    """Return a named tuple with arrays in place of tuples, within it too."""
    arrays = {}
    for name, value in values._asdict().items():
        if hasattr(value, '_asdict'):
            arrays[name] = _with_arrays(value)
        elif isinstance(value, tuple):
            arrays[name] = np.array(value)
    return values._replace(**arrays)
