# SPDX-License-Identifier: Apache-2.0
"""
The engine: the thread that moves the rig from tick to tick and publishes its messages.

As soon as a tick is published, the rig is moved to the next one: the search for the next impact,
which takes many times as long as a sample, must not delay a tick. Impacts on the way are sent at
their own instants. At a tick, the waiting requests are carried out before the joint states are
published. The joint states of a tick therefore show a change that took effect at that tick.

All requests to the engine go through a queue and take effect at the tick the rig is at, a whole
number of nanoseconds. Where ticks are far apart the rig is moved in strides, and where the motion
from tick to tick takes long in slices (`rig_motion`); requests take effect between these, at whole
nanoseconds, too. A rig that cannot continue, or has too many events on the way, is held until a
change or a reset. Everything in a recording is written by this thread, in order.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from math import tau
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from impact_damper_ros.bag.messages import String, clock_message, encode, with_stamp
from impact_damper_ros.bag.rig_topics import PAUSED_RATE, RIG_TOPICS
from impact_damper_ros.bag.snapshots import Snapshots
from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.measured.record import read_records
from impact_damper_ros.motion.event import Event
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import RunawayError
from impact_damper_ros.rig.tick_grid import TickGrid
from impact_damper_ros.rig.waiting_change import made_at_once, waiting_values

from .commands import CommandInbox
from .engine_state import (
    ON,
    PAUSED,
    Done,
    EngineStatus,
    NotNowError,
    Request,
    Running,
    State,
    Step,
)
from .external_control import ExternalControl
from .motion_trace import MotionTrace
from .pacing import ORDINARY, Pacer, StampClock, WallTime, take_priority
from .parameters import NodeParameters
from .publishing import Emitter, RigPublishers
from .rig_motion import RIG_FAILURES, RigMotion

if TYPE_CHECKING:
    from impact_damper_ros.bag import RunWriter


_Arguments = ParamSpec('_Arguments')
_Result = TypeVar('_Result')


PAUSED_NAP_S = 0.02
PAUSED_PERIOD_NS = round(1e9 / PAUSED_RATE)
#: Longest stride in wall time: impacts are sent, and requests served, at least this often.
STRIDE_NS = 20_000_000
#: Wall time in lock-step after which a measurement is sent again, and between two checks for
#: requests.
SEND_AGAIN_S, LOCK_STEP_NAP_S = 0.2, 0.02
#: Waiting messages of a recording with which a free-running rig waits for the disk.
LOG_BACKLOG = 20_000


class Engine:
    """Runs a rig in a thread of its own; ParameterError if the rig cannot start."""

    def __init__(
        self,
        parameters: NodeParameters,
        publishers: RigPublishers,
        *,
        node: str = '',
        inbox: CommandInbox | None = None,
        alive: Callable[[], bool] = lambda: True,
        on_new_motion: Callable[[dict[str, Any]], object] = lambda _: None,
        on_trouble: Callable[[str, str], object] = lambda *_: None,
        wall: WallTime = time,
    ) -> None:
        """
        Make an engine that does not run yet.

        The engine calls the functions from its own thread; each must return at once. `alive`
        returns whether ROS still runs: publishing fails afterwards. `on_new_motion` is called at
        the start and after every change and reset, with the state of the rig; `on_trouble` with a
        kind and a text, if the rig falls behind or cannot continue. `wall` is the time outside.
        """
        self.failure: Exception | None = None
        #: The present parameters; only `change` replaces them
        self.parameters = parameters
        law = parameters.control_law
        self._rig = Rig(
            parameters.rig,
            parameters.initial,
            control=parameters.control,
            law=None if law == 'none' else OwnLaw.from_text(law),
            records=read_records(parameters.as_dict(), tau / parameters.rig.omega),
        )
        #: The measurements for a controller outside the node, and its commands
        self.controller = ExternalControl(self._rig, inbox or CommandInbox(), parameters)
        self._publishers = publishers
        self._on_new_motion, self._on_trouble = on_new_motion, on_trouble
        rate = RIG_TOPICS['joint_states'].rate_of(parameters)
        self._grid = TickGrid(rate)
        self._scheduling = ORDINARY
        self._wall = wall
        self._pacer = Pacer(self._grid.instant(1), parameters.real_time_factor, wall=wall)
        self._stamps = StampClock(simulated=parameters.simulated_time, wall=wall)
        topics = {key: publisher.topic for key, publisher in publishers.items()}
        self._snapshots = Snapshots(node, topics, parameters.initial.as_dict(), rate)
        self._time_ns = 0
        self._tick = 0
        # Between a tick and its joint states
        self._within_tick = True
        self._state = ON
        # Rig time of the change of the base that waits for its next upward zero
        self._waiting_ns: int | None = None
        # The reason of the snapshot that is due, and whether the rig has another motion since the
        # last one
        self._snapshot_reason, self._is_new_motion = 'start', True
        trace = MotionTrace.at(parameters.rig, self._rig.snapshot())
        self._motion = RigMotion(self._rig, publishers, trace)
        # All parameters, as an encoded ParameterEvent, while there is a recording
        self._listing = b''
        # Requests in the order in which they were made
        self._requests: deque[tuple[Request, Callable[[], Any]]] = deque()
        self._closed = threading.Event()
        self._stopping = threading.Event()
        self._out = Emitter(alive, self._stopping.set)
        self._thread = threading.Thread(target=self._run, name='engine', daemon=True)

    # Called from other threads

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self, timeout: float = 20.0) -> None:
        """End the thread after its present tick; safe to call twice, or before `start`."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def trace(self) -> MotionTrace:
        """Return the motion of the rig since its last change or reset."""
        return self._motion.trace

    def stamp_ns(self) -> int:
        """Return the stamp of the tick the rig is at."""
        return self._stamps.offset_ns + self._time_ns

    def status(self) -> EngineStatus:
        """Return the state of the engine, and reset the worst lateness."""
        rig, motion, state = self._rig, self._motion, self._state
        return EngineStatus(
            time_ns=self._time_ns,
            paused=state.paused,
            mode=rig.mode.name,
            impacts=motion.impacts,
            recorded=self._out.recorded,
            pacing=self._pacer.counts(),
            control=rig.control,
            commands=motion.commands,
            last_act=motion.last_act,
            scheduling=self._scheduling,
            held=state.held,
            events=motion.events,
            controller=self.controller.status(self._time_ns),
        )

    def ask(
        self, act: Callable[_Arguments, Any], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Request:
        """
        Request that the engine's thread runs `act`, one of the methods below.

        It runs at the next instant at which the rig may be changed, in the order of the requests,
        unless the request is cancelled before.
        """
        request: Request = Future()
        self._requests.append((request, partial(act, *args, **kwargs)))
        if self._closed.is_set():
            self._reject_requests()
        return request

    def _reject_requests(self) -> None:
        """Reject all waiting requests."""
        # Another thread may empty the queue at the same time.
        with contextlib.suppress(IndexError):
            while True:
                request, _ = self._requests.popleft()
                if request.set_running_or_notify_cancel():
                    request.set_exception(NotNowError('the rig is shutting down'))

    # Requested by other threads, run by the engine's

    def check(self, after: NodeParameters) -> None:
        """Raise an error if the rig cannot take other parameters now; nothing changes."""
        if (after.rig, after.control) != (self._rig.parameters, self._rig.control):
            self._rig.check_change(self._due(after)[0], after.control)

    def _due(self, after: NodeParameters) -> tuple[RigParameters, int | None]:
        """Return the rig of other parameters now, and the rig time at which the rest acts."""
        if self._state.held:  # which would wait for ever
            return after.rig, None
        return made_at_once(self._rig, after.rig)

    def change(self, after: NodeParameters, event: bytes, listing: bytes = b'') -> str:
        """
        Change parameters, all at once, and record the event.

        Another motion of the base begins at the next upward zero of the present one. The result
        names in words the parameters that wait for it; empty if none does. A rig that cannot take
        a change which it accepted is held; a reset then makes the change.

        `listing` is the event that lists all parameters, if there is a recording that splits.
        """
        before, rig = self.parameters, self._rig
        now, self._waiting_ns = self._due(after)
        self.parameters = self.controller.settings = after
        self._listing = listing or self._listing
        # First the cause, then its effects
        self._record_event(event)
        if self._snapshots.change(before.initial.as_dict(), after.initial.as_dict()):
            self._snapshot_reason = self._snapshot_reason or 'change'
        try:
            self._change_rig(now, after.control)
        except RIG_FAILURES as error:
            self._give_up(error)
        if after.real_time_factor != before.real_time_factor:
            self._set_pace(after.real_time_factor)
        if self._waiting_ns is None:
            return ''
        names = ', '.join(waiting_values(rig.parameters, after.rig))
        wait = (self._waiting_ns - self._time_ns) / 1e9
        return (
            f'{names}: in {wait:.4g} s, at rig time {self._waiting_ns / 1e9:.9g} s, when the base '
            'next passes zero upwards'
        )

    def _change_rig(self, now: RigParameters, control: GapControlParameters) -> None:
        """Change the rig, if the parameters differ, and send the events of the change."""
        rig = self._rig
        if (now, control) == (rig.parameters, rig.control):
            return
        was = {**rig.parameters.as_dict(), **rig.control.as_dict()}
        events = self._alter(lambda: rig.change(now, control))
        self._snapshots.move_stamps(self._stamps.offset_ns)
        self._send(events, rig.acts)
        self._snapshots.change(was, {**now.as_dict(), **control.as_dict()})
        self._release()
        self._is_new_motion, self._snapshot_reason = True, self._snapshot_reason or 'change'

    def _make_rest(self) -> None:
        """Make the change that has waited for the base, or for a rig that can take it."""
        self._waiting_ns = None
        self._change_rig(self.parameters.rig, self.parameters.control)

    def reset(self) -> None:
        """Reset the rig to the initial conditions; rig time continues."""
        initial = self.parameters.initial
        if self._waiting_ns is not None:
            # The base begins anew.
            self._make_rest()
        self._alter(lambda: self._rig.reset(initial))
        self._snapshots.reset(initial.as_dict())
        self._send([], [])
        self._motion.last_act = None
        self._make_rest()
        self._release()
        self._snapshot_reason = 'reset'
        self._is_new_motion = True

    def pause(self, paused: bool) -> bool:
        """Pause the rig, or resume it; return whether that changed anything."""
        before = self._state
        after = PAUSED if paused else ON
        if before.running is Running.HELD:
            after = before._replace(after=after.running)
        if after == before:
            return False
        self._enter(after, 'the step was ended by a pause or by running on')
        if after.moves and not before.moves:
            self._snapshot_reason = 'resume'
        return True

    def _set_pace(self, real_time_factor: float) -> None:
        """Run at another pace; stamps that count from the system time do not go back."""
        self._pacer.set_pace(self._grid.instant(1), real_time_factor)
        if self._state.moves and self._resume():
            self._snapshot_reason = self._snapshot_reason or 'slip'

    def step(self, *, to_impact: bool = False) -> Request:
        """
        Let a paused rig run on to its next joint states, at its pace, and pause it again there.

        With `to_impact` it runs to the first joint states after its next impact. The rig runs on
        as after a pause, so that the motion does not depend on the steps. Returns another request,
        done when the rig is paused again.
        """
        state, motion, tick, impacts = self._state, self._motion, self._tick, self._motion.impacts
        if state.running is Running.STEP:
            raise NotNowError('a step is under way')
        if state.held:
            raise NotNowError(f'the rig is held: {state.held}')
        if not state.paused:
            raise NotNowError('only a paused rig makes single steps: pause it first')
        ended: Request = Future()
        step = Step(lambda: motion.impacts > impacts if to_impact else self._tick > tick, ended)
        self._enter(State(Running.STEP, step=step))
        self._snapshot_reason = 'resume'
        return ended

    def record_to(self, log: RunWriter, event: bytes) -> None:
        """
        Record from now on; `event` is an encoded ParameterEvent with all parameters.

        The log may request a new file, which begins with a tick as the recording did.
        """
        self._out.log, self._out.recorded, self._listing = log, 0, event
        self._publish_snapshot('record')
        self._record_event(event)

    def stop_recording(self) -> RunWriter | None:
        """End the recording; return its log, if any."""
        # The log has all commands so far, and ends with a whole tick.
        self._publish_due_snapshot()
        if self._within_tick:
            stamp_ns = self.stamp_ns()
            data = self._motion.states(stamp_ns)
            self._out.record(self._publishers['joint_states'].topic, data, stamp_ns)
        log, self._out.log = self._out.log, None
        return log

    def record(self, topic: str, data: bytes) -> None:
        """Record an encoded message that another thread has published."""
        self._out.record(topic, data, self.stamp_ns())

    # The engine's thread

    def _run(self) -> None:
        try:
            self._scheduling = take_priority(self.parameters.priority)
            self._run_ticks()
        except Exception as error:
            self.failure = error
        finally:
            self._closed.set()
            self._reject_requests()
            self._enter(self._state._replace(step=None), 'the rig is shutting down')

    def _run_ticks(self) -> None:
        self._stamps.catch_up(0)
        self._pacer.anchor(0)
        self._run_requests()
        self._exchange_with_controller()
        self._publish_states()
        while not self._stopping.is_set():
            if not self._state.moves:
                self._idle()
                continue
            due_ns = self._grid.instant(self._tick + 1)
            if not self._move_to(due_ns):
                continue
            # From here on no request is served before the tick.
            self._tick += 1
            self._pacer.wait(due_ns)
            self._time_ns, self._within_tick = due_ns, True
            self._align_stamps()
            self._run_requests()
            self._exchange_with_controller()
            self._publish_states()
            step = self._state.step
            if step is not None and step.reached():
                self._enter(PAUSED)
                step.ended.set_result(Done(self._time_ns))
            if not self._pacer.factor:
                self._wait_for_log()

    def _move_to(self, due_ns: int) -> bool:
        """
        Move the rig to the next tick, or by a stride, and send the events on the way.

        Returns whether that tick is reached.
        """
        target_ns = due_ns
        if self._pacer.factor:
            stride_ns = max(1, round(STRIDE_NS * self._pacer.factor))
            target_ns = min(due_ns, self._time_ns + stride_ns)
        if (next_ns := self.controller.next_ns()) is not None:
            target_ns = min(target_ns, max(next_ns, self._time_ns + 1))
        if self._waiting_ns is not None:
            target_ns = min(target_ns, self._waiting_ns)
        offset_ns = self._stamps.offset_ns
        try:
            reached_ns, messages = self._motion.move_to(self._time_ns, target_ns, offset_ns)
        except RIG_FAILURES as error:
            self._give_up(error)
            return False
        for message in messages:
            self._pacer.pause_until(message.stamp_ns - offset_ns)
            self._out.emit(*message)
        if reached_ns == due_ns:
            return True
        self._pacer.pause_until(reached_ns)
        self._time_ns = reached_ns
        self._run_requests()
        self._exchange_with_controller()
        return False

    def _idle(self) -> None:
        """
        Wait while the rig is paused or held.

        Clock and joint states are still published, for nodes that join meanwhile and for
        transforms that are looked up now. They are no samples of the motion and not recorded.
        """
        due_ns = self._wall.monotonic_ns()
        while not self._state.moves and not self._stopping.is_set():
            if self._wall.monotonic_ns() >= due_ns:
                self._publish_clock()
                data = self._motion.paused_states(self._stamps.now(self._time_ns))
                self._out.publish(self._publishers['joint_states'], data)
                # Deadlines missed while the process was stopped are left out.
                due_ns = max(due_ns + PAUSED_PERIOD_NS, self._wall.monotonic_ns())
            self._wall.sleep(PAUSED_NAP_S)
            self._run_requests()
            self.controller.refuse_all('the rig is paused')

    def _enter(self, state: State, why: str = '') -> None:
        """Change the state; a step that is under way fails with a reason, if there is one."""
        before, self._state = self._state, state
        if why and before.step is not None:
            before.step.ended.set_exception(NotNowError(why))
        if state.moves and not before.moves:
            self._resume()

    def _give_up(self, error: Exception) -> None:
        """Hold a rig that cannot continue."""
        held = str(error)
        if not isinstance(error, RunawayError):
            held = f'{type(error).__name__}: {held}'
        after = Running.ON if self._state.running is Running.ON else Running.PAUSED
        self._enter(State(Running.HELD, held, after), f'the rig is held: {held}')
        self._on_trouble('held', f'the rig is held: {held}; it waits for a change or a reset')

    def _release(self) -> None:
        """Resume a rig that was held, once its motion has changed."""
        if self._state.held:
            self._enter(State(self._state.after))

    def _resume(self) -> bool:
        """Resume a rig with new stamps and deadlines; return whether the stamps have moved."""
        moved = self._stamps.catch_up(self._time_ns)
        # In this order no deadline is before its stamp, however late this thread comes here.
        self._pacer.anchor(self._time_ns)
        return moved

    def _align_stamps(self) -> None:
        """Keep the stamps by the system time; those of a recording only increase."""
        if self._pacer.factor != 1.0:
            return
        moved_ns = self._stamps.follow(self._time_ns, back=self._out.log is None)
        if not moved_ns:
            return
        # Deadlines are not before the stamps, however late this thread comes here.
        self._pacer.anchor(self._time_ns)
        self._snapshot_reason = self._snapshot_reason or 'slip'
        apart, way = ('behind', 'on') if moved_ns > 0 else ('ahead of', 'back')
        self._on_trouble(
            f'stamps {way}',
            f'the stamps were {abs(moved_ns) * 1e-9:.3f} s {apart} the system time, as the rig '
            f'was late or the clock was set: they are moved {way} by as much',
        )

    def _wait_for_log(self) -> None:
        while self._out.log is not None and self._out.log.backlog > LOG_BACKLOG:
            self._wall.sleep(PAUSED_NAP_S)
            self._run_requests()
            if not self._state.moves or self._stopping.is_set():
                break

    def _run_requests(self) -> None:
        if self._waiting_ns is not None and self._time_ns >= self._waiting_ns:
            try:
                self._make_rest()
            except RIG_FAILURES as error:
                self._give_up(error)
        # Requests that arrive meanwhile wait: a flood of them must not stop the rig.
        for _ in range(len(self._requests)):
            request, action = self._requests.popleft()
            if not request.set_running_or_notify_cancel():
                continue
            try:
                request.set_result(Done(self._time_ns, action()))
            except (NotNowError, *RIG_FAILURES) as error:
                request.set_exception(error)
            except Exception as error:
                request.set_exception(error)
                raise
        self._publish_due_snapshot()

    def _alter(self, alter: Callable[[], _Result]) -> _Result:
        """Alter the rig; a failure leaves the rig as it was."""
        mark = self._rig.mark()
        try:
            return alter()
        except RIG_FAILURES:
            self._rig.go_back(mark)
            raise

    def _send(self, events: Sequence[Event], acts: Sequence[ControlAct]) -> None:
        """Send the events that a change of the rig has caused."""
        for message in self._motion.messages_of(events, acts, self._stamps.offset_ns):
            self._out.emit(*message)

    def _exchange_with_controller(self) -> None:
        """Publish the measurements that are due, and carry out the commands that have come."""
        try:
            for sent in self.controller.measurements(self._time_ns, self._stamps.offset_ns):
                self._out.emit(self._publishers['measurements'], sent.content, self.stamp_ns())
                if self.controller.waits:
                    self._await_command(sent.content)
            self._carry_out_commands()
        except RIG_FAILURES as error:
            self._give_up(error)

    def _await_command(self, measurement: bytes) -> None:
        """Wait in lock-step for the command to a measurement."""
        begun = since = self._wall.monotonic()
        again = begun + SEND_AGAIN_S
        self._carry_out_commands()
        while self.controller.waits and not self._stopping.is_set():
            if not self._state.moves:
                self._idle()
                since = self._wall.monotonic()
            self.controller.wait(LOCK_STEP_NAP_S)
            self._run_requests()
            self._carry_out_commands()
            now = self._wall.monotonic()
            if now >= again:
                self._out.publish(self._publishers['measurements'], measurement)
                again = now + SEND_AGAIN_S
            waited = now - since
            if self.controller.waits and waited >= self.controller.settings.lock_step_timeout:
                refused = self.controller.give_up()
                text = (
                    f'no command has come for {waited:.3f} s{refused}: the rig in lock-step '
                    'continues without it'
                )
                self._on_trouble('lock-step', text)
        if self._wall.monotonic() - begun > SEND_AGAIN_S:
            # Rig time does not make up for the wait.
            self._pacer.anchor(self._time_ns)

    def _carry_out_commands(self) -> None:
        """Carry out the commands of a controller that have come."""
        for events, acts in self.controller.obey(self._time_ns, self.stamp_ns()):
            self._send(events, acts)

    def _split(self, log: RunWriter) -> None:
        """Begin a new file of the recording, with everything that its reader needs."""
        if log.split(self.stamp_ns()):
            self._publish_snapshot('record')
            self._record_event(self._listing)

    # Publishing

    def _publish_states(self) -> None:
        stamp_ns = self.stamp_ns()
        data = self._motion.states(stamp_ns)
        self._within_tick = False
        self._publish_clock()
        self._out.emit(self._publishers['joint_states'], data, stamp_ns)
        if (log := self._out.log) is not None and log.split_due(stamp_ns):
            self._split(log)

    def _publish_clock(self) -> None:
        if (clock := self._publishers.get('clock')) is not None:
            self._out.publish(clock, clock_message(self.stamp_ns()))

    def _publish_due_snapshot(self) -> None:
        if self._snapshot_reason:
            self._publish_snapshot(self._snapshot_reason)
            self._snapshot_reason = ''

    def _publish_snapshot(self, reason: str) -> None:
        """Publish a snapshot: all that a bit-for-bit continuation needs."""
        state = self._rig.snapshot()
        self._snapshots.move_stamps(self._stamps.offset_ns)
        text = self._snapshots.text(self._time_ns, reason, state)
        self._out.emit(self._publishers['snapshot'], encode(String(text)), self.stamp_ns())
        if self._is_new_motion:
            self._is_new_motion = False
            self._motion.trace = MotionTrace.at(self._rig.parameters, state)
            self._on_new_motion(state)

    def _record_event(self, event: bytes) -> None:
        stamp_ns = self.stamp_ns()
        topic = self._publishers['parameter_events'].topic
        self._out.record(topic, with_stamp(event, stamp_ns), stamp_ns)
