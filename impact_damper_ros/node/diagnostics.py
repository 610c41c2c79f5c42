# SPDX-License-Identifier: Apache-2.0
"""
The node's report on /diagnostics: pacing, rig, recording, gap control and motion.

The topic is absolute, as REP 107 asks: one aggregator receives the reports of every node of the
system, in whatever namespace (`-r /diagnostics:=...` moves the topic). Status names begin with the
fully qualified node name, so that the reports of two rigs are distinguished.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping

from impact_damper_ros.bag.messages import DiagnosticArray, DiagnosticStatus
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.report.formatting import mode_words

from .engine_state import EngineStatus
from .motion_report import MotionReport
from .network import NetworkReport
from .pacing import CATCH_UP_NS
from .recording import RecordingStatus

#: Remedy for a rig that takes too long.
SLOWER = 'give a lower real_time_factor, or a rig with a slower force or softer spring'
#: A rig without a tick for this time, s, and for this number of periods is in error.
SILENT_S, SILENT_TICKS = 5.0, 5
#: Relative deviation from the requested rate that is acceptable.
TOLERANCE = 0.9, 1.1
# Levels of diagnostic_msgs/DiagnosticStatus
OK, WARN, ERROR = 0, 1, 2


class Diagnostics:
    """Makes reports of the state of the engine, the recording and the motion."""

    def __init__(
        self,
        node_name: str,
        state_rate: float,
        real_time_factor: float,
        clock: Callable[[], float] = time.monotonic,
        *,
        measurement_rate: float = 0.0,
    ) -> None:
        self._node_name = node_name.removeprefix('/')
        self._state_rate, self._measurement_rate = state_rate, measurement_rate
        self.factor = real_time_factor
        self._clock = clock
        self._last_report = clock()
        self._last: EngineStatus | None = None
        # Time without a tick of a rig that should run, s
        self._silent_s = 0.0

    def report(
        self,
        stamp_ns: int,
        engine: EngineStatus,
        recording: RecordingStatus,
        motion: Iterable[MotionReport] = (),
        network: NetworkReport | None = None,
    ) -> DiagnosticArray:
        """Return the report since the last one."""
        now = self._clock()
        elapsed = max(now - self._last_report, 1e-9)
        statuses = [
            self._pacing(engine, elapsed),
            self._rig(engine, elapsed),
            self._recording(recording),
            self._control(engine),
            self._controller(engine),
            self._network(network or NetworkReport()),
        ]
        self._last_report, self._last = now, engine
        return self._array(stamp_ns, [*statuses, *self._motion(motion)])

    def motion_report(self, stamp_ns: int, motion: Iterable[MotionReport]) -> DiagnosticArray:
        """Return a report on the motion alone."""
        return self._array(stamp_ns, self._motion(motion))

    def _motion(self, motion: Iterable[MotionReport]) -> list[DiagnosticStatus]:
        return [
            self._status(task, WARN if warning else OK, message, values)
            for task, warning, message, values in motion
        ]

    def _array(self, stamp_ns: int, statuses: list[DiagnosticStatus]) -> DiagnosticArray:
        return DiagnosticArray(stamp_ns, '', tuple(statuses))

    def _pacing(self, engine: EngineStatus, elapsed: float) -> DiagnosticStatus:
        counts = engine.pacing
        last = self._last
        ticks, overruns, slips, slipped_ns = (
            (new - old)
            for new, old in zip(counts[:4], last.pacing[:4] if last else (0,) * 4, strict=True)
        )
        rig_time = (engine.time_ns - (last.time_ns if last else 0)) * 1e-9
        asked = self._state_rate * self.factor
        worst_ms = counts.worst_lateness_ns * 1e-6
        if ticks or engine.held or engine.paused or engine.controller.awaited:
            self._silent_s = 0.0
        else:
            self._silent_s += elapsed
        silent = self._silent_s
        if engine.held:
            level, message = ERROR, 'held: the rig cannot go on'
        elif engine.paused:
            level, message = OK, 'paused'
        elif ticks == 0 and engine.controller.awaited:
            level, message = WARN, 'stands still: lock-step waits for a command'
        elif silent > SILENT_S and (not asked or asked * silent > SILENT_TICKS):
            level = ERROR
            message = f'no tick for {silent:.1f} s: the rig takes too long to compute; {SLOWER}'
        elif ticks == 0:
            level, message = OK, f'no tick for {silent:.1f} s'
        elif slips:
            level = ERROR
            skipped = f'skipped {slipped_ns * 1e-9:.3f} s of wall time'
            rates = self._rates(engine)
            message = f'cannot hold {asked:g} Hz: {skipped}; lower {rates}, or {SLOWER}'
        elif overruns:
            level = WARN
            message = f'{overruns} of {ticks} ticks late by more than a period; no sample lost'
        elif not self.factor:
            level, message = OK, f'runs {rig_time / elapsed:.3g} times as fast as real time'
        else:
            level, message = OK, f'holds {asked:g} Hz'
        values = {
            # The keys of FrequencyStatus of diagnostic_updater
            'Events in window': ticks,
            'Events since startup': counts.ticks,
            'Duration of window (s)': f'{elapsed:.3f}',
            'Actual frequency (Hz)': f'{ticks / elapsed:.2f}',
            'Target frequency (Hz)': f'{asked:g}' if asked else '',
            'Minimum acceptable frequency (Hz)': f'{TOLERANCE[0] * asked:g}' if asked else '',
            'Maximum acceptable frequency (Hz)': f'{TOLERANCE[1] * asked:g}' if asked else '',
            'State rate [Hz]': f'{self._state_rate:g}',
            'Real-time factor': f'{self.factor:g}',
            'Achieved real-time factor': f'{rig_time / elapsed:.4f}',
            'Overruns': counts.overruns,
            'Overruns since the last report': overruns,
            'Worst lateness since the last report [ms]': f'{worst_ms:.3f}',
            f'Slips (late by more than {CATCH_UP_NS * 1e-6:g} ms)': counts.slips,
            'Wall time given up in slips [s]': f'{counts.slipped_ns * 1e-9:.3f}',
            'Scheduling': engine.scheduling,
        }
        return self._status('pacing', level, message, values)

    def _network(self, network: NetworkReport) -> DiagnosticStatus:
        message = network.text or 'no other node interferes'
        return self._status('network', WARN if network.text else OK, message, network.values)

    def _rates(self, engine: EngineStatus) -> str:
        """Return the rates that can be lowered, those above the state rate first."""
        others = {'measurement_rate': self._measurement_rate}
        if engine.control.active:
            others['gap_control_rate'] = engine.control.gap_control_rate
        higher = {name: rate for name, rate in others.items() if rate > self._state_rate}
        names = sorted(higher, key=lambda name: -higher[name])
        return ' and '.join([*(f'{name} ({higher[name]:g} Hz)' for name in names), 'state_rate'])

    def _rig(self, engine: EngineStatus, elapsed: float) -> DiagnosticStatus:
        impacts = engine.impacts - (self._last.impacts if self._last else 0)
        level = ERROR if engine.held else OK
        message = f'{"paused, " if engine.paused else ""}{mode_words(engine.mode)}'
        if engine.held:
            message = f'held: {engine.held}; it waits for a changed parameter or ~/reset'
        values = {
            'Mode': engine.mode,
            'Time [s]': f'{engine.time_ns * 1e-9:.3f}',
            'Paused': engine.paused,
            'Held': bool(engine.held),
            'Events': engine.events,
            'Impacts': engine.impacts,
            'Impacts per wall second': f'{impacts / elapsed:.2f}',
        }
        return self._status('rig', level, message, values)

    def _control(self, engine: EngineStatus) -> DiagnosticStatus:
        law, last = engine.control.gap_control, engine.last_act
        values = {
            'Law': law,
            'Stops': engine.control.gap_control_stops,
            'Amplitude of X [m]': f'{last.amplitude:.6g}' if last else '',
            'Stop 1 to Y [m]': f'{last.target_1:.6g}' if last else '',
            'Stop 2 to Y [m]': f'{last.target_2:.6g}' if last else '',
            'Energy spent on stop 1 [J]': f'{last.energy_1:.6g}' if last else '',
            'Energy spent on stop 2 [J]': f'{last.energy_2:.6g}' if last else '',
            'Commands': engine.commands,
        }
        return self._status('gap control', OK, law, values)

    def _controller(self, engine: EngineStatus) -> DiagnosticStatus:
        """Report the commands of a controller outside the node."""
        now, last = engine.controller, self._last
        refused = now.refused - (last.controller.refused if last else 0)
        age = '' if now.age_ns is None else f'{now.age_ns * 1e-9:.4f}'
        level, message = OK, 'no commands' if now.age_ns is None else 'commands are carried out'
        if refused:
            level, message = WARN, f'{plural(refused, "command")} refused: {now.reason}'
        elif now.awaited and not engine.paused and engine.time_ns == (last.time_ns if last else 0):
            level, message = WARN, f'lock-step waits for a command on {now.awaited}'
        elif now.missed > (last.controller.missed if last else 0):
            level, message = WARN, 'no command has come in lock-step: the rig continues without it'
        elif now.parked:
            level, message = WARN, f'no command for {age} s: the stops are parked'
        values = {
            'Age of the last command [s]': age,
            'Commands accepted': now.accepted,
            'Commands refused': now.refused,
            'Last refusal': now.reason,
            'Stops parked': now.parked,
            'Forces limited': now.limited,
            'Measurements without a command in lock-step': now.missed,
        }
        return self._status('controller', level, message, values)

    def _recording(self, recording: RecordingStatus) -> DiagnosticStatus:
        if recording.error:
            level, message = ERROR, f'stopped: {recording.error}'
        elif recording.dropped:
            level, message = WARN, f'{recording.dropped} messages dropped'
        else:
            level, message = OK, 'recording' if recording.path else 'off'
        values = {
            'File': recording.path,
            'Messages': recording.messages,
            'Bytes': recording.size,
            'Messages waiting': recording.backlog,
            'Messages dropped': recording.dropped,
            'Error': recording.error,
        }
        return self._status('recording', level, message, values)

    def _status(
        self, task: str, level: int, message: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f'{self._node_name}: {task}',
            message=message,
            hardware_id=self._node_name,
            values=tuple((key, str(value)) for key, value in values.items()),
        )
