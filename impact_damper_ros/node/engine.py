# SPDX-License-Identifier: Apache-2.0
"""
The engine: the thread that moves the rig from tick to tick and publishes its messages.

As soon as a tick is published, the rig is moved to the next one and the messages are encoded: the
search for the next impact, which takes many times as long as a sample, must not delay a tick. At
the tick they only have to be sent. Impacts on the way are sent at their own instants. At a tick,
the waiting requests are carried out before the joint states are published. So the joint states of
a tick show a change that took effect at it.

All requests to the engine go through a queue and take effect at the tick the rig is at, a whole
number of nanoseconds. Where ticks are far apart the rig is moved in strides, and where it takes
long from one tick to the next in slices (`motion_ahead`); requests take effect between these, at
whole nanoseconds, too. A rig that cannot continue, or has too many events on the way, is held
until a change or a reset. Everything in a recording is written by this thread, in order.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeAlias

from impact_damper_ros.bag.messages import String, clock_message, encode, restamped
from impact_damper_ros.bag.snapshots import Snapshots
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.control.record import ControlRecord
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import (
    GapControlParameters,
    InitialConditions,
    RigParameters,
)
from impact_damper_ros.rig.event_budget import RunawayError, fastest_rate
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.tick_grid import TickGrid

from .commands import CommandInbox
from .external_control import ControllerStatus, ExternalControl
from .motion_ahead import RIG_FAILURES, MotionAhead, MotionTrace, ticks_ahead
from .pacing import ORDINARY, Pacer, PacingCounts, StampClock, take_priority
from .parameters import NodeParameters
from .publishing import Emitter, RigPublishers

if TYPE_CHECKING:
    from impact_damper_ros.bag import RunWriter


class EngineStatus(NamedTuple):
    """State of the engine, for other threads; all numbers are counted from its start."""

    time_ns: int
    paused: bool
    mode: str
    impacts: int
    recorded: int  # messages given to the recording
    pacing: PacingCounts
    control: GapControlParameters = GapControlParameters()
    commands: int = 0  # of the gap control
    last_act: ControlRecord | None = None
    scheduling: str = ORDINARY
    held: str = ''  # the reason why the rig cannot continue
    events: int = 0  # impacts among them
    busy_ns: int = 0  # computing time of the engine's thread
    fastest: float = 0.0  # circular frequency of the fastest of spring and harmonics, rad/s
    harmonics: int = 1  # how many the force has
    controller: ControllerStatus = ControllerStatus()


class EngineCallbacks(NamedTuple):
    """What an engine calls, from its own thread; each must return at once."""

    alive: Callable[[], bool]  # whether ROS still runs; publishing fails once it does not
    on_failure: Callable[[], object]  # if the engine fails; its `failure` is set then
    #: At the start and after every change and reset, with the state of the rig
    on_course: Callable[[dict[str, Any]], object] = lambda _: None
    #: With its kind and a text, if the rig falls behind or cannot continue, if the system clock
    #: was set, or if no command came in lock-step
    on_trouble: Callable[[str, str], object] = lambda *_: None
    #: If the system clock was set back during a recording. As stamps of a recording only increase,
    #: they follow once it has ended.
    on_set_back: Callable[[], object] = lambda: None


class NotNowError(Exception):
    """A request that the engine cannot carry out as things are."""


class Done(NamedTuple):
    """A request that was carried out: rig time at which it took effect, and its result."""

    time_ns: int
    result: Any = None


#: A request to the engine; it fails with the reason why it had no effect.
Request: TypeAlias = 'Future[Done]'
_Arguments = ParamSpec('_Arguments')


PAUSED_NAP_S = 0.02
PAUSED_PERIOD_NS = 100_000_000
#: Longest stride in wall time: impacts are sent, and requests served, at least so often.
STRIDE_NS = 20_000_000
#: Wall time in lock-step after which a measurement is sent again, and between looks at requests.
SEND_AGAIN_S, LOCK_STEP_NAP_S = 0.2, 0.02
#: Messages by which a recording may be behind before a free-running rig waits for it.
LOG_BACKLOG = 20_000


class Engine:
    """Run a rig in a thread of its own; ParameterError if it cannot start where it is put."""

    def __init__(
        self,
        parameters: NodeParameters,
        publishers: RigPublishers,
        callbacks: EngineCallbacks,
        node: str = '',
        inbox: CommandInbox | None = None,
    ) -> None:
        self.failure: Exception | None = None
        law = parameters.control_law
        self._rig = Rig(
            parameters.rig,
            parameters.initial,
            control=parameters.control,
            law=None if law == 'none' else OwnLaw.from_text(law),
        )
        #: What a controller outside the node sees and commands
        self.controller = ExternalControl(self._rig, inbox or CommandInbox(), parameters)
        self._publishers = publishers
        self._callbacks = callbacks
        rate, factor = parameters.state_rate, parameters.real_time_factor
        self._grid = TickGrid(rate)
        self._priority = parameters.priority
        self._scheduling = ORDINARY
        self._pacer = Pacer(self._grid.instant(1), factor, on_slip=self._slip)
        self._stamps = StampClock(simulated=parameters.simulated_time)
        topics = {key: publisher.topic for key, publisher in publishers.items()}
        self._snapshots = Snapshots(node, topics, parameters.initial.as_dict(), rate)
        self._time_ns = 0
        self._tick = 0
        # Between a tick and its joint states
        self._within_tick = True
        self._paused = False
        # A step of the paused rig that is under way: whether it is done, and who waits for it
        self._step_done: Callable[[], bool] | None = None
        self._stepping: Request = Future()
        # Why the rig cannot continue
        self._held = ''
        self._slipped = False
        # Whether the system clock was set back and the recording has yet to end
        self._set_back = False
        self._news = 'start'
        self._motion = MotionAhead(
            self._rig,
            publishers,
            self._grid,
            MotionTrace.at(parameters.rig, self._rig.snapshot()),
            most=1,
        )
        self._run_at(factor)
        # Whether the rig has another motion since the last snapshot; also at the start
        self._new_course = True
        # All parameters, as an encoded ParameterEvent, while there is a recording
        self._listing = b''
        # In the order in which they were made
        self._requests: deque[tuple[Request, Callable[[], Any]]] = deque()
        self._closed = threading.Event()
        self._stopping = threading.Event()
        self._out = Emitter(callbacks.alive, self._stopping.set)
        self._thread = threading.Thread(target=self._run, name='engine', daemon=True)

    # Called from other threads

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread after its present tick; safe to call twice, or before `start`."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    @property
    def paused(self) -> bool:
        """Whether the rig is paused."""
        return self._paused

    def trace(self) -> MotionTrace:
        """Return the motion of the rig since its last change or reset."""
        return self._motion.trace

    def stamp_ns(self) -> int:
        """Return the stamp of the tick the rig is at."""
        return self._stamps.offset_ns + self._time_ns

    def status(self) -> EngineStatus:
        """Return the state of the engine, and restart the search for the worst lateness."""
        rig, motion = self._rig, self._motion
        amplitudes, _, _ = rig.parameters.harmonics
        return EngineStatus(
            time_ns=self._time_ns,
            paused=self._paused,
            mode=rig.mode.name,
            impacts=motion.impacts,
            recorded=self._out.recorded,
            pacing=self._pacer.counts(),
            control=rig.control,
            commands=motion.commands,
            last_act=motion.last_act,
            scheduling=self._scheduling,
            held=self._held,
            events=motion.events,
            busy_ns=self._busy_ns(),
            fastest=fastest_rate(rig.parameters),
            harmonics=sum(amplitude != 0.0 for amplitude in amplitudes),
            controller=self.controller.status(self._time_ns),
        )

    def _busy_ns(self) -> int:
        """Return the computing time of the engine's thread so far."""
        if self._thread.ident is None or not self._thread.is_alive():
            return 0
        return time.clock_gettime_ns(time.pthread_getcpuclockid(self._thread.ident))

    def ask(
        self, act: Callable[_Arguments, Any], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Request:
        """
        Ask for something that the engine's thread has to do, one of the methods below.

        It does so at the next instant at which the rig may be changed, in the order of asking.
        """
        request: Request = Future()
        self._requests.append((request, partial(act, *args, **kwargs)))
        if self._closed.is_set():
            self._turn_away()
        return request

    def _turn_away(self) -> None:
        """Reject all waiting requests."""
        # Another thread may do so at the same time.
        with contextlib.suppress(IndexError):
            while True:
                request, _ = self._requests.popleft()
                request.set_exception(NotNowError('the rig is shutting down'))

    # Asked for by other threads, carried out by the engine's

    def change(
        self,
        parameters: RigParameters | None,
        event: bytes,
        control: GapControlParameters | None = None,
        initial: InitialConditions | None = None,
        listing: bytes = b'',
    ) -> None:
        """
        Change the rig, its control or the conditions of a reset, and record the event.

        What is not given stays as it is.
        """
        self._listing = listing or self._listing
        # First the cause, then its effects
        self._record_event(event)
        self._snapshots.move_stamps(self._stamps.offset_ns)
        rig = self._rig
        before = {**rig.parameters.as_dict(), **rig.control.as_dict()}
        if parameters is not None or control is not None:
            self._motion.discard()
            events = rig.change(parameters or rig.parameters, control)
            for message in self._motion.passed(events, rig.records, self._stamps.offset_ns):
                self._out.emit(*message)
            self._release()
            self._news = self._news or 'change'
            self._new_course = True
        after = {**rig.parameters.as_dict(), **rig.control.as_dict()}
        if initial is not None:
            after |= initial.as_dict()
        if self._snapshots.change(before, after):
            self._news = self._news or 'change'

    def reset(self, initial: InitialConditions) -> None:
        """Reset the rig to initial conditions; rig time continues."""
        self._motion.discard()
        self._rig.reset(initial)
        self._snapshots.reset(initial.as_dict())
        self._motion.last_act = None
        self._release()
        self._news = 'reset'
        self._new_course = True

    def pause(self, paused: bool) -> bool:
        """Pause the rig, or resume it; return whether that changed anything."""
        stepping, self._step_done = self._step_done, None
        if stepping is not None:
            self._stepping.set_exception(
                NotNowError('the step was ended by a pause or by running on')
            )
        if paused == self._paused:
            return stepping is not None
        # The messages made ahead have other stamps.
        self._motion.discard()
        self._paused = paused
        if not paused:
            if not self._held:
                self._go_on()
            self._news = 'resume'
        return True

    def set_pace(self, real_time_factor: float) -> None:
        """Run at another pace; stamps that count from the system time do not go back for it."""
        # The messages made ahead may have other stamps.
        self._motion.discard()
        self._run_at(real_time_factor)
        if not self._paused and not self._held:
            before_ns = self._stamps.offset_ns
            self._go_on()
            if self._stamps.offset_ns != before_ns:
                self._news = self._news or 'slip'

    def step(self, *, to_impact: bool = False) -> Request:
        """
        Let a paused rig run on to its next joint states, at its pace, and pause it again there.

        With `to_impact`, to the first joint states after its next impact. The rig runs on as
        after a pause, so that nothing of the motion depends on the steps. Returns another
        request, done when the rig is paused again.
        """
        if self._step_done is not None:
            raise NotNowError('a step is under way')
        if self._held:
            raise NotNowError(f'the rig is held: {self._held}')
        if not self._paused:
            raise NotNowError('only a paused rig makes single steps: pause it first')
        self.pause(False)
        motion, tick, impacts = self._motion, self._tick, self._motion.impacts
        self._step_done = lambda: motion.impacts > impacts if to_impact else self._tick > tick
        self._stepping = Future()
        return self._stepping

    def record_to(self, log: RunWriter, event: bytes) -> None:
        """
        Record from now on; `event` is an encoded ParameterEvent with all parameters.

        The log may ask for a new file. That begins with a tick, as the recording did.
        """
        self._out.log, self._out.recorded, self._listing = log, 0, event
        self._announce('record')
        self._record_event(event)

    def stop_recording(self) -> RunWriter | None:
        """End the recording; return its log, if any."""
        if self._within_tick:
            # A bag ends with a whole tick.
            data = self._motion.states(self._time_ns, self._stamps.offset_ns)
            self._out.record(self._publishers['joint_states'].topic, data, self.stamp_ns())
        log, self._out.log = self._out.log, None
        self._follow_clock()
        return log

    def record(self, topic: str, data: bytes) -> None:
        """Record an encoded message that another thread has published."""
        self._out.record(topic, data, self.stamp_ns())

    # The engine's thread

    def _run(self) -> None:
        try:
            self._scheduling = take_priority(self._priority)
            self._run_ticks()
        except Exception as error:
            self.failure = error
        finally:
            self._closed.set()
            self._turn_away()
            self._end_step('the rig is shutting down')
        if self.failure is not None:
            self._callbacks.on_failure()

    def _run_ticks(self) -> None:
        self._stamps.begin()
        self._pacer.anchor(0)
        self._serve()
        self._attend()
        self._publish_states()
        while not self._stopping.is_set():
            if self._paused or self._held:
                self._hold()
                continue
            due_ns = self._grid.instant(self._tick + 1)
            if not self._motion.known and not self._move_to(due_ns):
                continue
            # From here on no request is served before the tick.
            self._tick += 1
            self._pacer.wait(due_ns)
            self._time_ns, self._within_tick = due_ns, True
            self._follow_clock()
            if self._slipped:
                self._catch_up()
            self._serve()
            self._attend()
            self._publish_states()
            if self._step_done is not None and self._step_done():
                self._end_step()
            if self._free_running:
                self._wait_for_log()

    def _move_to(self, due_ns: int) -> bool:
        """
        Move the rig to the next tick, or by a stride, and send what happens on the way.

        Returns whether that tick is reached.
        """
        target_ns = due_ns
        if not self._free_running:
            target_ns = min(due_ns, self._time_ns + self._stride_ns)
        if (next_ns := self.controller.next_ns()) is not None:
            target_ns = min(target_ns, max(next_ns, self._time_ns + 1))
        offset_ns = self._stamps.offset_ns
        try:
            reached_ns, messages = self._motion.move_to(
                self._time_ns, target_ns, self._tick + 1, offset_ns
            )
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
        self._serve()
        self._attend()
        return False

    def _hold(self) -> None:
        """
        Wait while the rig is paused or held.

        Clock and joint states are still published, for nodes that join meanwhile and for
        transforms that are looked up now. They are no samples of the motion and not recorded.
        """
        due_ns = time.monotonic_ns()
        while (self._paused or self._held) and not self._stopping.is_set():
            if time.monotonic_ns() >= due_ns:
                self._follow_clock()
                self._publish_clock()
                data = self._motion.paused_states(self._stamps.now(self._time_ns))
                self._out.publish(self._publishers['joint_states'], data)
                # Not what was missed while the process was stopped
                due_ns = max(due_ns + PAUSED_PERIOD_NS, time.monotonic_ns())
            time.sleep(PAUSED_NAP_S)
            self._serve()
            self.controller.refuse_all('the rig is paused')

    def _give_up(self, error: Exception) -> None:
        """Hold a rig that cannot continue."""
        kind = '' if isinstance(error, RunawayError) else f'{type(error).__name__}: '
        self._held = f'{kind}{error}'
        self._motion.stand_at(self._time_ns)
        self._end_step(f'the rig is held: {self._held}')
        self._callbacks.on_trouble(
            'held', f'the rig is held: {self._held}; it waits for a change or a reset'
        )

    def _go_on(self) -> None:
        """Resume a rig with new stamps and deadlines."""
        self._stamps.catch_up(self._time_ns)
        self._pacer.anchor(self._time_ns)

    def _release(self) -> None:
        """Resume a rig that was held, once its motion has changed."""
        if self._held:
            self._held = ''
            if not self._paused:
                self._go_on()

    def _slip(self) -> None:
        self._slipped = True

    def _follow_clock(self) -> None:
        """Move the stamps with a step of the system clock."""
        step_ns = self._stamps.step_ns()
        if not step_ns:
            return
        if step_ns < 0 and self._out.log is not None:
            if not self._set_back:
                self._set_back = True
                self._callbacks.on_set_back()
            return
        self._set_back = False
        # The messages made ahead have other stamps.
        self._motion.stand_at(self._time_ns)
        self._motion.discard()
        self._stamps.follow(step_ns)
        self._news = self._news or 'slip'
        way = 'on' if step_ns > 0 else 'back'
        self._callbacks.on_trouble(
            'clock',
            f'the system clock was set {way} by {abs(step_ns) * 1e-9:.3f} s: its stamps are moved '
            f'{way} by as much',
        )

    def _catch_up(self) -> None:
        """Move the stamps on, so that the present tick is now, after a slip."""
        self._slipped = False
        before_ns = self._stamps.offset_ns
        if self._stamps.catch_up(self._time_ns):
            # Deadlines are not before the stamps, however late this thread comes here.
            self._pacer.anchor(self._time_ns)
            # The messages made ahead have other stamps.
            self._motion.stand_at(self._time_ns)
            self._motion.discard()
            self._news = self._news or 'slip'
            late_s = (self._stamps.offset_ns - before_ns) * 1e-9
            self._callbacks.on_trouble(
                'late',
                f'the rig was {late_s:.3f} s late and skips that time: its stamps are moved on by '
                'as much',
            )

    def _wait_for_log(self) -> None:
        while self._out.log is not None and self._out.log.backlog > LOG_BACKLOG:
            time.sleep(PAUSED_NAP_S)
            self._serve()
            if self._paused or self._stopping.is_set():
                break

    def _serve(self) -> None:
        if self._requests:
            self._motion.stand_at(self._time_ns)
        # Not those that arrive meanwhile: a flood of requests must not stop the rig.
        for _ in range(len(self._requests)):
            request, action = self._requests.popleft()
            try:
                request.set_result(Done(self._time_ns, action()))
            except (NotNowError, ParameterError) as error:
                request.set_exception(error)
            except Exception as error:
                request.set_exception(error)
                raise
        if self._news:
            self._announce(self._news)
            self._news = ''

    def _attend(self) -> None:
        """Show a controller what is due, and carry out its commands that have come."""
        for sent in self.controller.measurements(self._time_ns, self._stamps.offset_ns):
            self._out.emit(self._publishers['measurements'], sent.content, self.stamp_ns())
            if self.controller.waits:
                self._await_command(sent.content)
        self._obey()

    def _await_command(self, measurement: bytes) -> None:
        """Wait in lock-step for the command to a measurement."""
        begun = since = time.monotonic()
        again = begun + SEND_AGAIN_S
        self._obey()
        while self.controller.waits and not self._stopping.is_set():
            if self._paused or self._held:
                self._hold()
                since = time.monotonic()
            self.controller.wait(LOCK_STEP_NAP_S)
            self._serve()
            self._obey()
            now = time.monotonic()
            if now >= again:
                self._out.publish(self._publishers['measurements'], measurement)
                again = now + SEND_AGAIN_S
            waited = now - since
            if self.controller.waits and waited >= self.controller.settings.lock_step_timeout:
                self.controller.give_up()
                text = (
                    f'no command has come for {waited:.3f} s: the rig in lock-step goes on without'
                )
                self._callbacks.on_trouble('lock-step', text)
        if time.monotonic() - begun > SEND_AGAIN_S:
            # Rig time does not make up for it.
            self._pacer.anchor(self._time_ns)

    def _obey(self) -> None:
        """Carry out the commands of a controller that have come."""
        for events, records in self.controller.obey(self._time_ns, self.stamp_ns()):
            self._motion.discard()
            for message in self._motion.passed(events, records, self._stamps.offset_ns):
                self._out.emit(*message)

    def _run_at(self, real_time_factor: float) -> None:
        period_ns = self._grid.instant(1)
        self._pacer.set_pace(period_ns, real_time_factor)
        self._free_running = not real_time_factor
        self._stride_ns = max(1, round(STRIDE_NS * real_time_factor))
        # A rig that is measured stops at the instants of that, too.
        measured = self.controller.settings.measurement_rate > 0.0
        self._motion.most = 1 if measured else ticks_ahead(period_ns, real_time_factor)

    def _end_step(self, failure: str = '') -> None:
        """Pause the rig at the end of its step."""
        if self._step_done is None:
            return
        self._step_done = None
        self._motion.stand_at(self._time_ns)
        self.pause(True)
        if failure:
            self._stepping.set_exception(NotNowError(failure))
        else:
            self._stepping.set_result(Done(self._time_ns))

    def _split(self, log: RunWriter) -> None:
        """Begin a new file of the recording, with all that a reader of it alone needs."""
        if log.split(self.stamp_ns()):
            self._motion.stand_at(self._time_ns)
            self._announce('record')
            self._record_event(self._listing)

    # Publishing

    def _publish_states(self) -> None:
        data = self._motion.take_states(self._time_ns, self._stamps.offset_ns)
        self._within_tick = False
        self._publish_clock()
        stamp_ns = self.stamp_ns()
        self._out.emit(self._publishers['joint_states'], data, stamp_ns)
        if (log := self._out.log) is not None and log.split_due(stamp_ns):
            self._split(log)

    def _publish_clock(self) -> None:
        if (clock := self._publishers.get('clock')) is not None:
            self._out.publish(clock, clock_message(self.stamp_ns()))

    def _announce(self, reason: str) -> None:
        """Publish a snapshot: all that a bit-for-bit continuation needs."""
        state = self._rig.snapshot()
        self._snapshots.move_stamps(self._stamps.offset_ns)
        text = self._snapshots.text(self._time_ns, reason, state)
        self._out.emit(self._publishers['snapshot'], encode(String(text)), self.stamp_ns())
        if self._new_course:
            self._new_course = False
            self._motion.trace = MotionTrace.at(self._rig.parameters, state)
            self._callbacks.on_course(state)

    def _record_event(self, event: bytes) -> None:
        stamp_ns = self.stamp_ns()
        topic = self._publishers['parameter_events'].topic
        self._out.record(topic, restamped(event, stamp_ns), stamp_ns)
