"""
Long runs of one rig, in compiled code if there is any: samples and events as arrays.

`LongRun` is to `Simulator` what a drive is to a walk: the same way, to the last bit, without the
stops. Both begin and end with the same snapshots, so that one can take over from the other.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import numpy.typing as npt

from .event import Event, Sample
from .frequency_step import origin_at_step, step_event
from .loop import Loop, has_numba
from .mode import Machine, Mode, launch, make_machine
from .parameters import InitialConditions, RigParameters
from .run_loop import DONE, FULL, SPENT, Progress
from .simulator import Simulator
from .snapshot import Snapshot
from .stretch import EVENT_TYPE, SAMPLE_TYPE, Events, EventTable, Outcome, Stretch
from .sweep import Sweep, frequency_at

__all__ = ['EVENT_TYPE', 'SAMPLE_TYPE', 'Events', 'LongRun', 'Outcome', 'Stretch']


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
        self._compiled = has_numba() if compiled is None else compiled
        self._take(Simulator(parameters, initial, time).state())

    def _take(self, state: Snapshot) -> None:
        self._state = state
        machine = _machine_of(state.parameters, state.sweep)
        self._loop = Loop(machine, state.parameters.damper_mass, compiled=self._compiled)

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
        """Return what the rig's future depends on, as `Simulator.snapshot` does."""
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
        return self._loop.machine.free.frequencies[0]

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
            How many events the rig may have on the way, the steps of a sweep among them. Elastic
            stops to which m is pressed can have any number of them; then this ends the advance,
            and the outcome says so.

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
        table = EventTable(record=record)
        table.add(state.unreported, self.mode)
        happened = 0
        origin, sweep, reached, sampled = state.origin, state.sweep, state.time, 0
        loop = self._loop
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
                    most_events - happened,
                    in_mode,
                )
                happened += progress.happened
                table.wrote(progress.written)
            origin, reached = loop.unpacked(progress.origin), progress.time
            status, sampled = progress.status, progress.sampled
            if status == DONE and due <= time and happened >= most_events:
                status = SPENT
            if status != DONE or due > time:
                break
            origin = origin_at_step(loop.machine, origin, launch(loop.machine, origin), due)
            sweep = Sweep(sweep.start, sweep.step + 1)
            loop = loop.turned_to(_machine_of(state.parameters, sweep))
            table.add([step_event(origin)], origin.mode)
            happened += 1
        # At once: an exception from a signal leaves the rig where it was
        self._state, self._loop = Snapshot(state.parameters, origin, reached, (), sweep), loop
        outcome = Outcome(status)
        return Stretch(
            outcome,
            outcome.reason(happened, state.time, reached, self.mode.name.lower()),
            reached,
            samples[:sampled].view(SAMPLE_TYPE).reshape(-1),
            table.events,
            happened,
            in_mode,
        )


def _machine_of(parameters: RigParameters, sweep: Sweep) -> Machine:
    """Return the rig at its present frequency."""
    return make_machine(parameters, frequency_at(parameters, sweep.step))
