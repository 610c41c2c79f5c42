# SPDX-License-Identifier: Apache-2.0
"""One rig of the ROS network, as its messages describe it; without ROS imports."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.bag import DiagnosticArray, DiagnosticStatus, ParameterEvent, String
from impact_damper_ros.bag.messages import (
    DIAGNOSTIC_ARRAY,
    PARAMETER_EVENT,
    STRING,
    CdrError,
    JointStateRows,
    decode,
)
from impact_damper_ros.bag.rig_topics import AXIS_JOINTS, IMPACT_JOINTS, JOINTS, PAUSED_FRAME
from impact_damper_ros.control.act import CONTROL_JOINTS
from impact_damper_ros.parameters.upgrades import FormatError
from impact_damper_ros.replay.command import parse_snapshot
from impact_damper_ros.replay.rows import Messages
from impact_damper_ros.rig.snapshot import Snapshot, present

from .frames import PAUSED, PageView
from .knobs import as_json, first_knobs, knobs_of, read_values
from .motion import ForcePhase, MotionHistory, Stretch
from .numbers import numbers_of
from .presets import change_between, preset_with
from .requests import RequestError
from .source import Source
from .structure import FieldError, command_of, design_of, note_on, rig_settings_of, structure_of

if TYPE_CHECKING:
    from .ros_client import RigLink

#: Samples and impacts that are kept for the traces.
_MOST_SAMPLES, _MOST_IMPACTS = 60_000, 20_000
#: Time without messages after which a node counts as gone, s; diagnostics come every second.
GONE_S = 3.5
_STATUS_PERIOD_S = 1.0
#: Time after which no more messages of an earlier stretch come, ns.
_LATE_NS = 10 * 10**9
_RETRY_S = 1.0
_LEVELS = ('ok', 'warn', 'error')
#: Largest difference from the system time of stamps that count from it, s.
_WALL_S = 3600.0
#: Speed of the rig below which the time between two samples is visible.
_SLOW = 0.5
#: Numbers that the node measures, and their keys in its report.
_MEASURED = {
    'impacts_per_cycle': 'Impacts per cycle of the force',
    'x_max_ratio': 'Largest X / A',
}
_TRIGGERS = ('reset', 'step', 'step_to_impact')
#: Most changes that a page which comes later is told of.
_MOST_CHANGES = 60
#: Time within which changes of the same parameters are one, s.
_ONE_TURN_S = 1.0
#: Time after a change within which its theory is looked for between ticks, s.
_THEORY_S = 0.3


class LiveRig(Source):
    """A rig of the network."""

    kept_s = 30.0

    def __init__(self, link: RigLink, common: Callable[[], dict[str, Any]]) -> None:
        super().__init__(common)
        self.link = link
        #: Stretch of the last snapshot
        self.state: dict[str, Any] | None = None
        self._reports: dict[str, DiagnosticStatus] = {}
        self._forget()
        # The last status that was sent, and when
        self._status_sent: tuple[str, str] = ('', '')
        self._status_at = 0.0
        self._asking: asyncio.Task[None] | None = None
        self._set_at = -math.inf

    def _forget(self) -> None:
        """Discard all messages: a run begins."""
        # Identity of the run, from its snapshots, and why snapshots of another version cannot be
        # read
        self._run, self._foreign = '', ''
        #: Present values of known parameters
        self.values: dict[str, Any] = {}
        # What was done to the rig lately
        self._changes = deque[dict[str, Any]](maxlen=_MOST_CHANGES)
        self.motion = MotionHistory(_MOST_SAMPLES, _MOST_IMPACTS)
        self._readers = {
            'joint_states': JointStateRows(JOINTS, (7, 7, 0)),
            'impacts': JointStateRows(IMPACT_JOINTS, (2, 2, 2)),
            'measurements': JointStateRows(AXIS_JOINTS, (4, 4, 0)),
            'gap_control': JointStateRows(CONTROL_JOINTS, (3, 3, 3)),
        }
        # Stretches whose messages may still come
        self._stretches: list[Stretch] = []
        self._paused = False
        self._epoch = self._came = 0.0
        # The joint states of a paused rig
        self._paused_states: Messages | None = None
        self._all_known = False

    async def close(self) -> None:
        """Leave the rig."""
        if self._asking is not None:
            self._asking.cancel()
            await asyncio.gather(self._asking, return_exceptions=True)
        self.link.close()

    # To the pages

    def hello(self) -> dict[str, Any]:
        """Return the first message."""
        return {
            **super().hello(),
            'rig': self.link.name,
            'parameters': knobs_of(self.values) if self._all_known else [],
            'preset': preset_with(self.values) if self._all_known else '',
            'changes': list(self._changes),
        }

    def news(self) -> list[dict[str, Any]]:
        """Return the present state."""
        return [self._status(), self._diagnostics(), *self._numbers(), *self.theory.values()]

    def frame(self, view: PageView) -> bytes | None:
        """Return a frame with new rows; None without any."""
        end = self._instant_to_show()
        if math.isnan(end):
            return None
        return view.frame(self.motion, end, self._epoch, PAUSED if self._paused else 0)

    def _instant_to_show(self) -> float:
        """Return the instant to show, s: of a slow rig an instant between its last two samples."""
        factor = self.values.get('real_time_factor', 1.0)
        times = self.motion.samples[-2:, 0]
        if not 0.0 < factor < _SLOW or self._paused or len(times) < 2:
            return self.motion.end
        return float(min(times[0] + factor * (time.monotonic() - self._came), times[1]))

    def _numbers(self) -> list[dict[str, Any]]:
        return [
            {**numbers_of(s.rig, self.motion, self.motion.end), **self._numbers_of_node()}
            for s in self._stretches[-1:]
        ]

    def _numbers_of_node(self) -> dict[str, Any]:
        """Return the numbers that the node measures, from `/diagnostics`."""
        report = self._reports.get('measured motion')
        values = dict(report.values) if report else {}
        return {name: _float(values.get(key, '')) for name, key in _MEASURED.items()}

    # Messages of the node

    def tick(self) -> None:
        """Take the messages that have come since the last call."""
        messages = self.link.poll()
        for content in messages['snapshot']:
            self._take_snapshot(content)
        if self._stretches:
            for stretch, table in self._tables('joint_states', messages['joint_states']):
                self.motion.add_samples(stretch.samples(table))
                self._came = time.monotonic()
            self._show_paused()
            for topic, rows, add in (
                ('impacts', Stretch.impacts, self.motion.add_impacts),
                ('measurements', Stretch.measurements, self.motion.add_measured),
                ('gap_control', Stretch.acts, self.motion.add_acts),
            ):
                for stretch, table in self._tables(topic, messages[topic]):
                    add(rows(stretch, table))
        for content in messages['parameter_events']:
            self._take_event(content)
        for content in messages['diagnostics']:
            self._take_diagnostics(content)
        for content in messages['theory']:
            self._take_theory(content)
        self._send_status()

    def hasten(self) -> bool:
        """Send the theory of a change as soon as it comes: it follows a knob."""
        if time.monotonic() > self._set_at + _THEORY_S:
            return False
        for content in self.link.poll_theory():
            self._take_theory(content)
        for client in list(self.clients):
            if client.waits:
                client.pump()
        return True

    def _show_paused(self) -> None:
        """Show the effect of a change or a reset on a paused rig."""
        states, self._paused_states = self._paused_states, None
        if states is not None:
            self.motion.correct_end(self._stretches[-1].samples(states)[0])

    def _take_snapshot(self, content: bytes) -> None:
        try:
            message = decode(STRING, content)
            assert isinstance(message, String)
            self._foreign = ''
            held = present(parse_snapshot(message.data))
            snapshot = Snapshot.from_dict(held['state'])
            offset_ns, time_ns = int(held['stamp_offset_ns']), int(held['time_ns'])
            run, reason = str(held['run']), held['reason']
            control = held['state']['gap_control']['parameters']
            values = {**snapshot.parameters.as_dict(), **control}
        except FormatError as error:
            self._foreign = str(error)
            return
        except (AttributeError, CdrError, ValueError, KeyError, TypeError, LookupError):
            return
        if run != self._run:
            if self._run:
                # Another node has the name of the old one.
                self.link.begin_again()
            self._forget()
            self._run = run
        began = not self._stretches
        self.state = held['state']
        late_ns = time_ns - _LATE_NS
        kept = [stretch for stretch, after in pairwise(self._stretches) if after.time_ns > late_ns]
        phase = ForcePhase(snapshot)
        self._stretches = [
            *(kept + self._stretches[-1:]),
            Stretch(time_ns, offset_ns, snapshot.parameters, phase),
        ]
        kind = 'reset' if reason == 'reset' else 'change'
        self._note(values, None if began else time_ns / 1e9, kind)
        if began and (self._asking is None or self._asking.done()):
            self._asking = asyncio.ensure_future(self._ask())

    def _note(self, values: Mapping[str, Any], time_: float | None, kind: str = 'change') -> None:
        """Store values, and report those that have changed, or a reset."""
        plain = as_json(dict(values))
        change = change_between(self.values, plain, time_, kind)
        self.values |= plain
        if change is not None:
            self.send({'type': 'parameters', **change})
            if time_ is not None:
                self._keep(change)

    def _keep(self, change: dict[str, Any]) -> None:
        """Keep a change for pages that come later; a knob that is dragged is turned once."""
        last = self._changes[-1] if self._changes else None
        if (
            last is not None
            and (last['kind'], last['values'].keys()) == (change['kind'], change['values'].keys())
            and change['time'] < last['time'] + _ONE_TURN_S
        ):
            self._changes.pop()
        self._changes.append(change)

    def _tables(self, topic: str, contents: list[bytes]) -> Iterable[tuple[Stretch, Messages]]:
        """Return messages of a topic by stretch."""
        if not contents:
            return []
        rows, readable = self._readers[topic].read(contents)
        rows = rows[readable]
        if topic == 'joint_states' and len(rows):
            self._paused = bool(rows['frame'][-1] == PAUSED_FRAME)
            stamp, now = rows['stamp_ns'][-1] / 1e9, time.time()
            self._epoch = stamp if abs(stamp - now) < _WALL_S else now
            self._paused_states = rows[-1:] if self._paused else None
            # A paused rig repeats its last sample.
            rows = rows[rows['frame'] != PAUSED_FRAME]
        if len(self._stretches) == 1:
            return [(self._stretches[0], rows)]
        places = self._places(rows['stamp_ns'].tolist())
        return [(self._stretches[n], rows[places == n]) for n in np.unique(places)]

    def _places(self, stamps_ns: list[int]) -> np.ndarray[Any, np.dtype[np.int64]]:
        """
        Return the number of the stretch of each message.

        Topics may overtake each other, and after a step of the system clock a stamp may lie in two
        stretches: the message belongs to the stretch whose last message is nearest.
        """
        end = self.motion.end
        last_ns = self._stretches[0].time_ns if math.isnan(end) else round(end * 1e9)
        begins = [stretch.time_ns for stretch in self._stretches]
        ends = [*begins[1:], math.inf]
        places = []
        for stamp_ns in stamps_ns:
            times = [stamp_ns - stretch.offset_ns for stretch in self._stretches]
            spans = zip(begins, times, ends, strict=True)
            there = [n for n, (begin, at, end_ns) in enumerate(spans) if begin <= at <= end_ns]
            # At the instant of a change the later stretch is taken.
            far = [(abs(times[n] - last_ns), -n) for n in there or range(len(times))]
            place = -min(far)[1]
            places.append(place)
            last_ns = times[place]
        return np.array(places, dtype=np.int64)

    def _take_event(self, content: bytes) -> None:
        """Process parameters that no snapshot holds: settings of the node."""
        try:
            event = decode(PARAMETER_EVENT, content)
        except CdrError:
            return
        assert isinstance(event, ParameterEvent)
        if event.node != self.link.name or self.state is None:
            return
        held = {**self.state['parameters'], **self.state['gap_control']['parameters']}
        changed = {parameter.name: parameter.value for parameter in event.changed_parameters}
        self._note({n: v for n, v in changed.items() if n not in held}, None)

    def _take_theory(self, content: bytes) -> None:
        try:
            message = decode(STRING, content)
            assert isinstance(message, String)
            self.send_theory(parse_snapshot(message.data))
        except ValueError:
            return

    # Reports

    def _take_diagnostics(self, content: bytes) -> None:
        try:
            array = decode(DIAGNOSTIC_ARRAY, content)
        except CdrError:
            return
        assert isinstance(array, DiagnosticArray)
        own = f'{self.link.name.removeprefix("/")}: '
        found = {s.name.removeprefix(own): s for s in array.status if s.name.startswith(own)}
        if found:
            self.link.silence = 0.0
            self._reports |= found
            self.send(self._diagnostics())

    def _diagnostics(self) -> dict[str, Any]:
        """Return the last report of the node, as far as the page shows it."""
        measured, predicted = (
            self._reports.get(f'{name} motion') for name in ('measured', 'predicted')
        )
        motions = [report for report in (measured, predicted) if report is not None]
        return {
            'type': 'diagnostics',
            'level': _level(motions),
            'kind': dict(measured.values).get('State', '') if measured else '',
            'message': measured.message if measured else '',
            'verdict': predicted.message if predicted else '',
            'agreement': dict(predicted.values).get('Agreement', '') if predicted else '',
            'controller': self._controller(),
        }

    def _controller(self) -> dict[str, Any] | None:
        """Return the report of the node on an external controller, if it waits for one."""
        report = self._reports.get('controller')
        if report is None or self.values.get('gap_control') != 'external':
            return None
        age = _float(dict(report.values).get('Age of the last command [s]', ''))
        return {'level': _level([report]), 'text': report.message, 'age': age}

    def _status(self) -> dict[str, Any]:
        """Return whether the rig runs."""
        state, text = self._judge()
        return {'type': 'status', 'state': state, 'text': text, 'time': as_json(self.motion.end)}

    def _judge(self) -> tuple[str, str]:
        silence = self.link.silence
        if self._foreign:
            return 'other_version', (
                f'the snapshots of {self.link.name} are {self._foreign}: install the version of '
                'the node, or a later one, where the page runs'
            )
        if silence > GONE_S or not self._stretches:
            return 'gone', f'no message from {self.link.name} for {max(1, round(silence))} s'
        network = self._reports.get('network')
        if network is not None and int(dict(network.values)['Nodes of this name']) > 1:
            return 'doubled', (
                f'Several nodes are called {self.link.name}, and are shown as if they were one: '
                'end the others, or start them in namespaces.'
            )
        if self._paused:
            return 'paused', 'paused'
        for task in ('rig', 'pacing'):
            report = self._reports.get(task)
            if report is not None and report.level:
                return 'lagging', report.message
        return 'running', ''

    def _send_status(self) -> None:
        now, judged = time.monotonic(), self._judge()
        # A longer silence alone is not reported again.
        sent = self._status_sent
        news = judged[0] != sent[0] or (judged[0] != 'gone' and judged != sent)
        if news or now >= self._status_at + _STATUS_PERIOD_S:
            self._status_sent, self._status_at = judged, now
            self.link.match()
            self.send(self._status())
            for numbers in self._numbers():
                self.send(numbers)

    # The node

    async def _ask(self) -> None:
        """Request the parameters until they are known; then send them to the pages."""
        while not self._all_known:
            try:
                self.values = as_json(await self.link.parameters()) | self.values
                self._all_known = True
            except TimeoutError:
                await asyncio.sleep(_RETRY_S)
        for client in list(self.clients):
            client.show(self)

    async def handle(self, message: dict[str, Any]) -> dict[str, Any] | None:
        """Process a request."""
        kind = message['type']
        try:
            if kind == 'set':
                values = read_values(message['values'])
                self._set_at = time.monotonic()
                reason = await self.link.set(values)
                return {'ok': not reason, 'reason': reason, 'values': values}
            if kind == 'begin':
                return await self._begin(read_values(message['values']))
            if kind == 'structure':
                return await self._design(message['values'])
            if kind == 'service':
                return await self._serve(message['name'])
        except TimeoutError as error:
            raise RequestError(str(error)) from error
        raise RequestError(f'{kind[:80]} is not a request for a live rig')

    async def _serve(self, name: str) -> dict[str, Any]:
        if name == 'pause':
            ok, text = await self.link.pause(not self._paused)
        elif name in _TRIGGERS:
            ok, text = await self.link.trigger(name)
        else:
            raise RequestError(f'{str(name)[:80]} is not a service of a rig')
        return {'ok': ok, 'reason': text}

    async def _begin(self, values: dict[str, Any]) -> dict[str, Any]:
        """Set parameters, all at once, and reset the rig."""
        before = first_knobs(self.values)
        if reason := await self.link.set(values):
            return {'ok': False, 'reason': reason}
        answer = await self._serve('reset')
        self.values |= as_json(values)
        if self._all_known and first_knobs(self.values) != before:
            for client in list(self.clients):
                client.show(self)
        return {**answer, 'values': values}

    async def _design(self, typed: Mapping[str, Any]) -> dict[str, Any]:
        """Return the best damper of a structure, and the parameters of both."""
        try:
            rig = structure_of(typed)
            answer = await asyncio.to_thread(design_of, rig)
        except FieldError as error:
            return {'ok': False, 'reason': str(error), 'field': error.field}
        note = note_on(rig, self.values.get('state_rate', math.inf))
        values = as_json(rig_settings_of(rig, answer['gap']))
        words = {'note': note, 'command': command_of(typed, rig)}
        return {'ok': True, 'reason': '', 'values': values, 'design': {**as_json(answer), **words}}


def _level(reports: Iterable[DiagnosticStatus]) -> str:
    worst = max((report.level for report in reports), default=0)
    return _LEVELS[min(worst, 2)]


def _float(text: str) -> float | None:
    """Return the number in a report; None if there is none."""
    return float(text) if text else None
