"""
Long runs of one rig, compiled where numba is installed: samples and events as arrays.

`LongRun` gives the motion of `Simulator`, to the last bit. Both begin and end with the same
snapshots, so that one can continue the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from importlib.util import find_spec
from math import inf
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from .event import Event, EventKind, Sample
from .forcing import SteppedSine, frequency_at
from .hybrid_motion import later_time, number_of_events, origin_at_step, step_event
from .kernels import array_by_reference, by_reference, compiling_alone, stamp
from .kernels import compiled as compile_kernels
from .mode import Mode, RigConstants, launch, rig_constants
from .origin import Origin
from .parameters import InitialConditions, RigParameters
from .quoting import shown
from .run_loop import DONE, FULL, ROWS_AT_ONCE, RUNAWAY, SPENT, Progress, run_through
from .simulator import Simulator, Snapshot

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
#: Initial rows of the table of events.
_ROWS = 512
#: Rows of 4 MB.
_LARGE = 2**22 // EVENT_TYPE.itemsize + 1
#: Most rows allotted beyond twice the size; pages that are not written to take no memory.
_MOST_AHEAD = 1_000_000
#: Most harmonics for which a loop of their own is compiled, with tuples: 4 to 7 times as fast as
#: the one with arrays for any number of them.
_MOST_IN_TUPLES = 8
#: More events than any run has.
_MOST = 2**62

Events = npt.NDArray[np.void]


class Outcome(IntEnum):
    """How an advance ended."""

    #: The requested time was reached.
    COMPLETE = DONE
    #: The rig had as many events as allowed; it may go on.
    TOO_MANY_EVENTS = SPENT
    #: The rig has events without end at one instant, and cannot go on.
    RUNAWAY = RUNAWAY

    def reason(self, happened: int, since: float, time: float, mode: str) -> str:
        """Return why an advance ended before its time, and the remedy; empty if it did not."""
        if self is Outcome.COMPLETE:
            return ''
        if self is Outcome.TOO_MANY_EVENTS:
            return (
                f'{happened} events from {since!r} s to {time!r} s, the last of them in mode '
                f'{mode}: allow more events, or make the stops less elastic'
            )
        return (
            f'events without end at {time!r} s, in mode {mode}: make the stops less elastic, '
            'or report it with the snapshot if they are not'
        )


class RunResult(NamedTuple):
    """
    Result of one advance.

    Attributes
    ----------
    outcome : Outcome
        Whether the requested time was reached.
    reason : str
        If not, why, and the remedy; else empty.
    time : float
        Time reached, s.
    samples : ndarray of SAMPLE_TYPE
        Motion at each of the requested instants that were reached.
    events : ndarray of EVENT_TYPE
        Events in order; empty if they were not recorded.
    event_count : int
        Number of transitions, recorded or not; an impact that ends in rest is one.
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
        # Ten times as fast as an index by booleans, with rows of this size
        found: Events = self.events.take(np.flatnonzero(wanted))
        return found


class EventTable:
    """The events of a run while it goes on."""

    def __init__(self, *, record: bool) -> None:
        self._record = record
        self._table = np.empty(_ROWS if record else 0, EVENT_TYPE)
        self._written = 0

    @property
    def events(self) -> Events:
        """The events so far."""
        return self._table[: self._written]

    def add(self, events: Sequence[Event], mode: int) -> None:
        """Add events, all of them followed by one mode."""
        if not self._record or not events:
            return
        rows = self._rows(len(events), 0.0)
        rows[: len(events)] = [
            (event.time, *event[3:], event.kind, event.stop, mode) for event in events
        ]
        self._written += len(events)

    def room(self, done: float) -> Events:
        """Return rows for the events of one instant at least; none if events are not kept."""
        return self._rows(ROWS_AT_ONCE, done) if self._record else self._table

    def wrote(self, count: int) -> None:
        """Count rows that have been written."""
        self._written += count

    def _rows(self, least: int, done: float) -> Events:
        if self._written + least > len(self._table):
            wanted = 1.1 * self._written / done if done > 0.0 else inf
            double = max(2 * len(self._table), self._written + least)
            size = int(min(max(wanted, double), double + _MOST_AHEAD))
            # numpy asks for large pages from 4 MB on; small ones cost as much as the run.
            if size > _LARGE // 8:
                size = max(size, _LARGE)
            larger = np.empty(size, EVENT_TYPE)
            larger[: self._written] = self.events
            self._table = larger
        return self._table[self._written :]


@cache
def has_numba() -> bool:
    """Return whether there is a compiler."""
    return find_spec('numba') is not None


@cache
def _compiled_loop() -> Any:
    """Return the run loop, compiled or about to be."""
    (loop,) = compile_kernels(run_through.__name__, form='')
    return loop


#: Forms of loops that are compiled in this process.
_READY: set[str] = set()


class Loop:
    """The run loop."""

    _name = run_through.__name__
    _plain: Any = staticmethod(run_through)
    #: Whether arrays are passed by pointer, which numba does not count; calling then takes longer.
    _uncounted = False

    def __init__(self, constants: RigConstants, damper_mass: float, *, compiled: bool) -> None:
        self.constants = constants
        self.compiled = compiled
        self._damper_mass = damper_mass
        self._loop = self._compile() if compiled else self._plain
        self._harmonics = len(constants.phases)
        self._arrays = compiled and self._harmonics > _MOST_IN_TUPLES
        self._packed = by_reference(constants) if compiled else constants

    def _compile(self) -> Any:
        """Return the compiled loop, or one about to be."""
        return _compiled_loop()

    def turned_to(self, constants: RigConstants) -> Self:
        """Return the loop of the same rig at other frequencies."""
        return type(self)(constants, self._damper_mass, compiled=self.compiled)

    def begun(self) -> Self:
        """Return the loop for one advance, which may be given up."""
        return self

    def packed(self, origin: Origin) -> Any:
        """Return an origin in the form of the loop."""
        angles: Any = np.array(origin.angles)
        return origin._replace(angles=angles) if self._arrays else origin

    @staticmethod
    def unpacked(origin: Any) -> Origin:
        """Return an origin of the loop in the form of all other code."""
        plain: Origin = origin._replace(angles=tuple(map(float, origin.angles)))
        return plain

    def run(
        self,
        progress: Progress,
        end: float,
        instants: Any,
        samples: Any,
        table: Events,
        most: int,
        in_mode: Any,
        step_due: float = inf,
    ) -> Progress:
        """Run until the end or until the loop stops; see `run_through`."""
        del step_due  # no end is after it
        return self._call(
            self._packed,
            self._damper_mass,
            progress.origin,
            progress.time,
            end,
            instants,
            progress.sampled,
            samples,
            *tables(table),
            0,
            most,
            in_mode,
        )

    def _call(self, *arguments: Any) -> Progress:
        """Call the loop, alone if it may have to be compiled."""
        if self.compiled and self._uncounted:
            arguments = tuple(
                array_by_reference(a) if isinstance(a, np.ndarray) else a for a in arguments
            )
        form = f'{self._name}_{"arrays" if self._arrays else self._harmonics}'
        if self.compiled and form not in _READY:
            with compiling_alone(stamp(), form):
                self._loop.compile(tuple(map(self._loop.typeof_pyval, arguments)))
            _READY.add(form)
        try:
            reached = self._loop(*arguments)
        except SystemError as error:
            # What a signal raises just as compiled code returns
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise error.__cause__ from None
            raise
        status, origin, *others = reached
        return Progress(status, Origin(*origin), *others)


def tables(rows: Events) -> tuple[Any, Any]:
    """Return rows of events as kernels write them: as floats and as codes."""
    shape = len(rows), len(EVENT_TYPE.names or ())
    return rows.view('f8').reshape(shape), rows.view('i8').reshape(shape)


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
        If m would not start between the stops.
    ImportError
        If `compiled` without numba (extra ``compiled``).

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
        self._compiled = has_numba() if compiled is None else compiled
        self._take(Simulator(parameters, initial, time).state())

    def _take(self, state: Snapshot) -> None:
        self._state = state
        self._loop = self._loop_of(state)

    def _loop_of(self, state: Snapshot) -> Loop:
        """Return the run loop of the rig."""
        constants = constants_at(state.parameters, state.sweep)
        return Loop(constants, state.parameters.damper_mass, compiled=self._compiled)

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
        run._compiled = has_numba() if compiled is None else compiled
        run._take(Snapshot.from_dict(snapshot))
        return run

    def snapshot(self) -> dict[str, Any]:
        """Return all that the rig's future depends on, as `Simulator.snapshot` does."""
        return self._state.as_dict()

    def simulator(self) -> Simulator:
        """Return a simulator that goes on from here, bit for bit."""
        return Simulator.resume(self._state)

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
    def force_frequency(self) -> float:
        """Present circular frequency of the first harmonic, rad/s; a sweep changes it."""
        return self._loop.constants.free.harmonics[0].frequency

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
        self._take(rig.state())
        return events

    def advance(
        self,
        time: float,
        instants: npt.ArrayLike = (),
        *,
        record: bool = True,
        most_events: float = 1_000_000,
    ) -> RunResult:
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
        most_events : float, optional
            Most events (rounded up), the steps of a stepped sine among them. With elastic stops
            to which m is pressed they may have no end; the advance then ends here, as the
            outcome says.

        Returns
        -------
        RunResult
            Samples and events, and whether the time was reached.

        Raises
        ------
        ValueError
            If a time is before the present one, not finite, or not in order, or the number of
            events is negative or NaN.
        """
        state = self._state
        most = int(min(number_of_events(most_events), _MOST))
        time = later_time(time, state.time)
        try:
            when = np.array(instants, dtype=float).reshape(-1)
        except (OverflowError, TypeError, ValueError) as error:
            raise ValueError(f'instants are {shown(instants)}: give a list of times, s') from error
        in_order = bool(np.all(when[1:] >= when[:-1]))
        if len(when) and not (in_order and when[0] >= state.time and when[-1] <= time):
            raise ValueError(
                f'instants must ascend from {state.time!r} s to {time!r} s: sort them, and leave '
                'out those before and after'
            )
        samples = np.empty((len(when), len(Sample._fields)))
        in_mode = np.zeros(len(Mode))
        table = EventTable(record=record)
        table.add(state.unreported, self.mode)
        happened = 0
        origin, sweep, reached, sampled = state.origin, state.sweep, state.time, 0
        loop = self._loop.begun()
        while True:
            due = sweep.due(state.parameters)
            end, count = time, len(when)
            if due <= time:
                # A sample at the instant of a step shows what comes after it
                end, count = due, int(np.searchsorted(when, due))
            progress = Progress(FULL, loop.packed(origin), reached, sampled, 0, 0)
            while progress.status == FULL:
                done = (progress.time - state.time) / (time - state.time or 1.0)
                progress = loop.run(
                    progress,
                    end,
                    when[:count],
                    samples,
                    table.room(done),
                    most - happened,
                    in_mode,
                    due,
                )
                happened += progress.happened
                table.wrote(progress.written)
            origin, reached = loop.unpacked(progress.origin), progress.time
            status, sampled = progress.status, progress.sampled
            if status == DONE and due <= time and happened >= most:
                status = SPENT
            if status != DONE or due > time:
                break
            origin = origin_at_step(loop.constants, origin, launch(loop.constants, origin), due)
            sweep = SteppedSine(sweep.start, sweep.step + 1)
            loop = loop.turned_to(constants_at(state.parameters, sweep))
            table.add([step_event(origin)], origin.mode)
            happened += 1
        # In one statement: an exception from a signal leaves the rig as it was
        self._state, self._loop = Snapshot(state.parameters, origin, reached, (), sweep), loop
        outcome = Outcome(status)
        return RunResult(
            outcome,
            outcome.reason(happened, state.time, reached, self.mode.name.lower()),
            reached,
            samples[:sampled].view(SAMPLE_TYPE).reshape(-1),
            table.events,
            happened,
            in_mode,
        )


def constants_at(parameters: RigParameters, sweep: SteppedSine) -> RigConstants:
    """Return the rig at its present frequency."""
    return rig_constants(parameters, frequency_at(parameters, sweep.step))
