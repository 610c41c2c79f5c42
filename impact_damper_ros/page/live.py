"""One rig of the ROS network, as its messages describe it; without ROS imports."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from impact_damper_ros.bag import DiagnosticArray, DiagnosticStatus, ParameterEvent, String
from impact_damper_ros.bag.messages import CdrError, JointStateDecoder, decode
from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from impact_damper_ros.bag.snapshots import FORMAT
from impact_damper_ros.replay.command import parsed
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

from .frames import PAUSED
from .knobs import Knob, as_json
from .measures import RigNumbers
from .motion import ForcePhase, MotionHistory, Rows, impact_rows
from .presets import preset_with

#: Samples and impacts that are kept for the traces.
_MOST_SAMPLES, _MOST_IMPACTS = 60_000, 20_000
#: Time without messages after which a node counts as gone, s; diagnostics come every second.
GONE_S = 3.5
_STATUS_PERIOD_S = 1.0
#: Time for which several nodes of a name are tolerated, s: a killed one stays listed for 20 s.
_NAMESAKE_S = 30.0
_LEVELS = ('ok', 'warn', 'error')
#: Largest difference from the system time of stamps that count from it, s.
_WALL_S = 3600.0
#: Reasons of snapshots after which stamps count from another instant, and of those after which the
#: motion of the rig is the same.
_MOVING = ('slip', 'resume')
_SAME_COURSE = (*_MOVING, 'record')


class Messages(Protocol):
    """Messages of a rig that have come in, in CDR; see `ros_client.Polled`."""

    states: list[bytes]
    impacts: list[bytes]
    snapshots: list[bytes]
    diagnostics: list[bytes]
    events: list[bytes]


class Link(Protocol):
    """The connection to a node; see `ros_client.RigLink`."""

    name: str

    def poll(self) -> Messages:
        """Return the messages since the last call."""

    def count(self) -> int:
        """Return how many nodes have the name."""

    async def knobs(self) -> list[Knob]:
        """Return all parameters."""

    async def set(self, values: Mapping[str, Any]) -> str:
        """Set parameters; return why they are rejected, or an empty text."""

    async def pause(self, hold: bool) -> tuple[bool, str]:
        """Pause the rig, or resume it."""

    async def trigger(self, service: str) -> tuple[bool, str]:
        """Call `reset`, `step` or `step_to_impact`."""

    def close(self) -> None:
        """Close the connection."""


class _Era(NamedTuple):
    """The rig from a snapshot on, and the origins of its stamps and positions."""

    stamp_ns: int
    offset_ns: int
    rest: float
    rig: RigParameters
    phase: ForcePhase


class LiveRig:
    """
    The state of a rig, reconstructed from its messages.

    Parameters
    ----------
    link : Link
        The connection to its node.
    tell : callable
        Called with each message for the pages.

    Attributes
    ----------
    motion : MotionHistory
        The last minutes.
    knobs : list of Knob
        Its parameters; empty until they are known.
    values : dict
        Their present values.
    state : dict or None
        Of the last snapshot.
    """

    def __init__(self, link: Link, tell: Callable[[dict[str, Any]], None]) -> None:
        self.link = link
        self._tell = tell
        self.knobs: list[Knob] = []
        self.values: dict[str, Any] = {}
        self.state: dict[str, Any] | None = None
        self.reports: dict[str, DiagnosticStatus] = {}
        self._forget()
        self._heard = time.monotonic()
        self._said: tuple[str, str] = ('', '')
        self._said_at = 0.0
        self._was_gone = False
        # Since when there are several nodes of this name
        self._namesakes_since = 0.0
        #: Called when the rig has other parameters, or is another one.
        self.on_course: Callable[[], None] = lambda: None
        #: Called when the parameters have to be requested.
        self.on_restart: Callable[[], None] = lambda: None

    def _forget(self) -> None:
        """Discard all messages: the node was restarted."""
        self.motion = MotionHistory(_MOST_SAMPLES, _MOST_IMPACTS)
        self._states, self._impacts = JointStateDecoder(), JointStateDecoder()
        self._eras: list[_Era] = []
        self._paused = False
        self._epoch = 0.0

    @property
    def rig(self) -> RigParameters | None:
        """The rig, as the last snapshot has it."""
        return self._eras[-1].rig if self._eras else None

    @property
    def flags(self) -> int:
        """Of the frames."""
        return PAUSED if self._paused else 0

    @property
    def epoch(self) -> float:
        """Wall time of the newest sample, s."""
        return self._epoch

    # Messages

    def look(self) -> None:
        """Process the messages that have come since the last call."""
        messages = self.link.poll()
        # /diagnostics are of all nodes; see below.
        if messages.states or messages.snapshots or messages.impacts:
            self._heard = time.monotonic()
        for content in messages.snapshots:
            self._take_snapshot(content)
        self._take_states(messages.states)
        self._take_impacts(messages.impacts)
        for content in messages.events:
            self._take_event(content)
        for content in messages.diagnostics:
            self._take_diagnostics(content)
        self._say_status()

    def _take_snapshot(self, content: bytes) -> None:
        try:
            message = decode('std_msgs/msg/String', content)
            assert isinstance(message, String)
            held = parsed(message.data)
            if held['format'] != FORMAT:
                return
            snapshot = Snapshot.from_dict(held['state'])
            offset_ns, time_ns = int(held['stamp_offset_ns']), int(held['time_ns'])
            control = dict(held['state']['gap_control']['parameters'])
        except (CdrError, ValueError, KeyError, TypeError, LookupError):
            return
        time_ = time_ns / 1e9
        if self._eras and self._is_another_run(held['reason'], offset_ns, time_):
            self._forget()
            self.knobs = []
        self._was_gone = False
        began = not self._eras
        rig = snapshot.parameters
        before = (self.rig, self.state and self.state['gap_control']['parameters'])
        self.state = held['state']
        self._eras = [
            *self._eras[-1:],
            _Era(offset_ns + time_ns, offset_ns, rig.static_deflection, rig, ForcePhase(snapshot)),
        ]
        kind = 'reset' if held['reason'] == 'reset' else 'change'
        self._note({**rig.as_dict(), **control}, None if began else time_, kind)
        if began:
            self.on_restart()
        if began or held['reason'] not in _SAME_COURSE or before != (rig, control):
            self.on_course()

    def _is_another_run(self, reason: str, offset_ns: int, time_: float) -> bool:
        """
        Return whether a snapshot is from a restarted node.

        Its first snapshot may be lost: only the last one is latched. Within a run, only a slip
        and the end of a pause, or of being held, change the stamp of rig time 0; it is 0 for all
        runs in simulated time.
        """
        moved = offset_ns != self._eras[-1].offset_ns
        return (
            reason == 'start'
            or time_ < self.motion.end - 1.0
            or (moved and reason not in _MOVING and not self._paused)
            or (self._was_gone and (moved or offset_ns == 0))
        )

    def _note(self, values: Mapping[str, Any], time_: float | None, kind: str = 'change') -> None:
        """Store values, and report those that have changed, or a reset."""
        plain = {name: as_json(value) for name, value in values.items()}
        changed = {
            name: value
            for name, value in plain.items()
            if name in self.values and self.values[name] != value
        }
        self.values |= plain
        if changed or kind == 'reset':
            self._tell(
                {
                    'type': 'parameters',
                    'time': time_,
                    'kind': kind,
                    'values': changed,
                    'preset': preset_with(self.values),
                }
            )

    def _era(self, stamp_ns: int, end: float) -> _Era:
        """Return the era of a message from about `end`; a change comes with its snapshot."""
        first, last = self._eras[0], self._eras[-1]
        back_ns = first.offset_ns - last.offset_ns
        if back_ns > 0:
            # The system clock was set back: earlier messages have later stamps.
            ahead_s = (stamp_ns - last.offset_ns) / 1e9 - end
            return first if ahead_s > 0.5e-9 * back_ns else last
        return last if stamp_ns >= last.stamp_ns else first

    def _take_states(self, contents: list[bytes]) -> None:
        if not self._eras:
            return
        rows, groups, time_ = [], [], self.motion.end
        for content in contents:
            try:
                message = self._states.decode(content)
            except CdrError:
                continue
            self._paused = message.frame_id == PAUSED_FRAME
            if self._paused or len(message.position) < 4 or len(message.velocity) < 4:
                continue
            era = self._era(message.stamp_ns, time_)
            x, z, stop_1, stop_2 = (place - era.rest for place in message.position[:4])
            primary, damper, velocity_1, velocity_2 = message.velocity[:4]
            time_ = (message.stamp_ns - era.offset_ns) / 1e9
            angle = era.rig.angle
            rows.append(
                (
                    *(time_, x, primary, z, damper),
                    *(stop_1, velocity_1, stop_2, velocity_2, angle, 0.0),
                )
            )
            groups.append(era)
            now = time.time()
            stamp = message.stamp_ns / 1e9
            self._epoch = stamp if abs(stamp - now) < _WALL_S else now
        if rows:
            self.motion.add_samples(self._completed(np.array(rows), groups))

    def _completed(self, rows: Rows, eras: list[_Era]) -> Rows:
        """Return samples with the phase of the force, later than the last known one."""
        for era in {id(era): era for era in eras}.values():
            own = np.array([other is era for other in eras])
            rows[own, -1] = era.phase.at(rows[own, 0])
            if era.rig.one_sided:
                rows[own, 7:9] = np.nan
        end = self.motion.end
        later = np.maximum.accumulate(rows[:, 0])
        keep = (rows[:, 0] > (end if end == end else -math.inf)) & (
            np.diff(later, prepend=-math.inf) > 0.0
        )
        rows = rows[keep]
        rows[:, :9][np.isinf(rows[:, :9])] = np.nan
        return rows

    def _take_impacts(self, contents: list[bytes]) -> None:
        if not self._eras:
            return
        # A change comes between two impacts: those of the era before it are the first ones.
        rows: dict[int, list[tuple[float, ...]]] = {}
        impacts = self.motion.impacts
        end = float(impacts[-1, 0]) if len(impacts) else -math.inf
        for content in contents:
            try:
                message = self._impacts.decode(content)
            except CdrError:
                continue
            stop = {'stop_1': 1.0, 'stop_2': 2.0}.get(message.frame_id)
            numbers = (*message.position, *message.velocity, *message.effort)
            if stop is None or len(numbers) != 6 or not all(map(math.isfinite, numbers)):
                continue
            era = self._era(message.stamp_ns, self.motion.end)
            time_ = (message.stamp_ns - era.offset_ns) / 1e9
            if time_ >= end:
                end = time_
                rows.setdefault(self._eras.index(era), []).append((time_, stop, *numbers))
        for index, group in sorted(rows.items()):
            era, table = self._eras[index], np.array(group)
            self.motion.add_impacts(
                impact_rows(table, era.rig, era.phase.at(table[:, 0]), era.rest)
            )

    def _take_event(self, content: bytes) -> None:
        """Process parameters that no snapshot holds: settings of the node."""
        try:
            event = decode('rcl_interfaces/msg/ParameterEvent', content)
        except CdrError:
            return
        assert isinstance(event, ParameterEvent)
        if event.node != self.link.name or self.state is None:
            return
        held = {**self.state['parameters'], **self.state['gap_control']['parameters']}
        changed = {parameter.name: parameter.value for parameter in event.changed_parameters}
        self._note({n: v for n, v in changed.items() if n not in held}, None)

    # Reports

    def _take_diagnostics(self, content: bytes) -> None:
        try:
            array = decode('diagnostic_msgs/msg/DiagnosticArray', content)
        except CdrError:
            return
        assert isinstance(array, DiagnosticArray)
        own = f'{self.link.name.removeprefix("/")}: '
        found = {s.name.removeprefix(own): s for s in array.status if s.name.startswith(own)}
        if found:
            self._heard = time.monotonic()
            self.reports |= found
            self._tell(self.diagnostics())

    def diagnostics(self) -> dict[str, Any]:
        """Return the last report of the node."""
        measured, predicted = (
            self.reports.get(f'{name} motion') for name in ('measured', 'predicted')
        )
        values = {
            f'{prefix}: {key}': value
            for prefix, report in (('measured', measured), ('predicted', predicted))
            if report is not None
            for key, value in report.values
        }
        return {
            'type': 'diagnostics',
            'level': _level(self.reports.values()),
            'message': measured.message if measured else '',
            'verdict': predicted.message if predicted else '',
            'agreement': values.get('predicted: Agreement', ''),
            'values': values,
            'statuses': [
                {
                    'task': task,
                    'level': _level([report]),
                    'message': report.message,
                    'values': dict(report.values),
                }
                for task, report in self.reports.items()
            ],
        }

    def numbers(self) -> RigNumbers:
        """Return the key numbers, as far as they are measured."""
        report = self.reports.get('measured motion')
        values = dict(report.values) if report is not None else {}
        return RigNumbers(
            self.rig,
            self.motion,
            self.motion.end,
            _number(values.get('Largest X [m]', '')),
            _number(values.get('Impacts per cycle of the force', '')),
        )

    def status(self) -> dict[str, Any]:
        """Return whether the rig runs."""
        state, text = self._judged()
        pacing = self.reports.get('pacing')
        values = dict(pacing.values) if pacing is not None else {}
        return {
            'type': 'status',
            'state': state,
            'text': text,
            'time': as_json(self.motion.end),
            'rate': _number(values.get('Achieved rate [Hz]', '')),
            'overruns': _number(values.get('Overruns', '')),
        }

    def _judged(self) -> tuple[str, str]:
        now = time.monotonic()
        silent = now - self._heard
        if silent > GONE_S or not self._eras:
            return 'gone', f'no message from {self.link.name} for {max(1, round(silent))} s'
        if self._namesakes_since and now > self._namesakes_since + _NAMESAKE_S:
            return 'lagging', (
                f'several nodes are called {self.link.name}, and shown as if they were one: end '
                'the others, or start them in namespaces'
            )
        if self._paused:
            return 'paused', 'paused'
        for task in ('rig', 'pacing'):
            report = self.reports.get(task)
            if report is not None and report.level:
                return 'lagging', report.message
        return 'running', ''

    def _look_for_namesakes(self, now: float) -> None:
        if self.link.count() < 2:
            self._namesakes_since = 0.0
        elif not self._namesakes_since:
            self._namesakes_since = now

    def _say_status(self) -> None:
        now, judged = time.monotonic(), self._judged()
        # A longer silence alone is not reported again.
        news = judged[0] != self._said[0] or (judged[0] != 'gone' and judged != self._said)
        if news or now >= self._said_at + _STATUS_PERIOD_S:
            self._said, self._said_at = judged, now
            self._was_gone |= judged[0] == 'gone'
            self._look_for_namesakes(now)
            self._tell(self.status())


def _level(reports: Iterable[DiagnosticStatus]) -> str:
    worst = max((report.level for report in reports), default=0)
    return _LEVELS[min(worst, 2)]


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
