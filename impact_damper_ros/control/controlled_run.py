"""
Long runs of a rig under gap control, compiled where numba is installed.

`ControlledRun` gives the motion of `ControlledRig`, to the last bit. Both begin and end with the
same snapshots, so that one can continue the other.
"""

from __future__ import annotations

from functools import cache
from math import inf
from typing import Any, Self

import numpy as np

from impact_damper_ros.rig import GapControlParameters
from impact_damper_ros.rig.event import Event
from impact_damper_ros.rig.kernels import compiled as compile_kernels
from impact_damper_ros.rig.long_run import (
    EVENT_TYPE,
    Events,
    LongRun,
    Loop,
    constants_at,
    has_numba,
    tables,
)
from impact_damper_ros.rig.mode import RigConstants
from impact_damper_ros.rig.parameters import InitialConditions, RigParameters
from impact_damper_ros.rig.run_loop import ROWS_AT_ONCE, Progress
from impact_damper_ros.rig.simulator import Snapshot

from .control_loop import COMMANDS_FULL, LAW_FAILED, run_controlled
from .controlled_rig import ControlledRig, own_law_of, restored, stored
from .controller import LAW_NUMBERS, Control
from .own_law import Law, OwnLaw, call_by_address, call_law
from .predictive_law import predictive_law_crosses


class _ControlLoop(Loop):
    """The run loop under control; each has its own copy of the state of the control."""

    _name = run_controlled.__name__
    _plain = staticmethod(run_controlled)
    _uncounted = True

    def __init__(
        self, constants: RigConstants, damper_mass: float, control: Control, *, compiled: bool
    ) -> None:
        self._control = control
        if self._is_predictive:
            self._name = f'{self._name}_{_FORM}'
        super().__init__(constants, damper_mass, compiled=compiled)
        self._records = control.packed() if compiled else control.copied()
        self._scratch = tables(np.empty(4 * ROWS_AT_ONCE, EVENT_TYPE))

    def _compile(self) -> Any:
        """Return the compiled loop, or one about to be."""
        return _loop_for(predictive=self._is_predictive)

    @property
    def _is_predictive(self) -> bool:
        return self._control.settings.law == _PREDICTIVE

    def begun(self) -> Self:
        """Return the loop for one advance, with a state of its own."""
        return self.turned_to(self.constants)

    def turned_to(self, constants: RigConstants) -> Self:
        """Return the loop of the same rig and control at other frequencies."""
        return type(self)(constants, self._damper_mass, self.control, compiled=self.compiled)

    @property
    def control(self) -> Control:
        """The control in its present state."""
        if self.compiled:
            return self._control.copied().unpacked(self._records)
        return self._records.copied()

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
        """Run until the end or until the loop stops; see `run_controlled`."""
        keep = len(table) > 0
        rows = tables(table) if keep else self._scratch
        progress = progress._replace(written=0, happened=0)
        happened = 0
        while True:
            progress = self._call(
                self._packed,
                self._damper_mass,
                self._records,
                progress.origin,
                progress.time,
                end,
                step_due,
                instants,
                progress.sampled,
                samples,
                *rows,
                progress.written,
                keep,
                most - happened,
                in_mode,
            )
            happened += progress.happened
            if progress.status == LAW_FAILED:
                assert self._control.law is not None
                raise self._control.law.refused(self.control)
            if progress.status != COMMANDS_FULL:
                written = progress.written if keep else 0
                return progress._replace(written=written, happened=happened)
            self._records = self._records.enlarged()


_PREDICTIVE = LAW_NUMBERS['predictive']
#: Name of the form of the loop that holds the model of the predictive law.
_FORM = 'predictive'


def _without_model(_control: Any, _seen: Any, _rig: Any, _origin: Any) -> None:
    """Take the place of the predictive law, whose model of the rig takes long to compile."""


@cache
def _loop_for(*, predictive: bool) -> Any:
    """Return the compiled run loop with the built-in laws, the predictive one if it is needed."""
    given: dict[str, Any] = {call_law.__name__: call_by_address()}
    if not predictive:
        given[predictive_law_crosses.__name__] = _without_model
    form = _FORM if predictive else ''
    (loop,) = compile_kernels(run_controlled.__name__, given=given, form=form)
    return loop


class ControlledRun(LongRun):
    """
    One rig under gap control for long runs.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts; at rest with m in the middle of the gap, if not given.
    control : GapControlParameters, optional
        The control; off, if not given.
    law : callable, optional
        A law of one's own, as of a `ControlledRig`. One that numba has compiled is called by the
        compiled run loop; with any other the loop is not compiled.
    compiled : bool, optional
        Whether to run compiled code; if not given, whether numba is installed. The results are
        the same, to the last bit.

    Raises
    ------
    ParameterError
        If m would not start between the stops.
    ImportError
        If `compiled` without numba (extra ``compiled``).
    """

    _loop: _ControlLoop

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        control: GapControlParameters | None = None,
        law: Law | None = None,
        *,
        compiled: bool | None = None,
    ) -> None:
        """Start the rig."""
        rig = ControlledRig(parameters, initial, control=control, law=law)
        self._compiled = _may_compile(rig.own_law) if compiled is None else compiled
        self._take_rig(rig)

    def _take_rig(self, rig: ControlledRig) -> None:
        self._gap_control, self._law = rig.control, rig.own_law
        self._start = rig.control_state
        self._take(rig.state())

    def _loop_of(self, state: Snapshot) -> _ControlLoop:
        """Return the run loop of the rig."""
        constants = constants_at(state.parameters, state.sweep)
        mass = state.parameters.damper_mass
        return _ControlLoop(constants, mass, self._start, compiled=self._compiled)

    @classmethod
    def restore(
        cls, snapshot: dict[str, Any], law: Law | None = None, *, compiled: bool | None = None
    ) -> Self:
        """
        Continue from a snapshot of a `ControlledRig`, bit for bit.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something, or is of a rig with a law of
            the user's own that is not given.
        """
        run = cls.__new__(cls)
        run._law = own_law_of(law)
        run._compiled = _may_compile(run._law) if compiled is None else compiled
        plain = {name: value for name, value in snapshot.items() if name != 'gap_control'}
        state = Snapshot.from_dict(plain)
        run._gap_control, run._start = restored(snapshot, state.parameters, run._law)
        run._take(state)
        return run

    def snapshot(self) -> dict[str, Any]:
        """Return all that the rig's future depends on, as `ControlledRig.snapshot` does."""
        return {**super().snapshot(), 'gap_control': stored(self._gap_control, self._loop.control)}

    def simulator(self) -> ControlledRig:
        """Return a live rig that goes on from here, bit for bit."""
        return ControlledRig.restore(self.snapshot(), self._law)

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the control."""
        return self._gap_control

    def change(
        self, parameters: RigParameters, control: GapControlParameters | None = None
    ) -> list[Event]:
        """
        Let new parameters take effect at the present time, as `ControlledRig.change` does.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.
        """
        rig = self.simulator()
        events = rig.change(parameters, control)
        self._take_rig(rig)
        return events


def _may_compile(law: OwnLaw | None) -> bool:
    """Return whether the loop with a law can be compiled."""
    return has_numba() and (law is None or hasattr(law.function, 'py_func'))
