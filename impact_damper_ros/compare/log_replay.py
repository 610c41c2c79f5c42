"""What a bit-for-bit replay says of the log of a run, stretch by stretch."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay.findings import Difference
from impact_damper_ros.replay.recorded_run import RecordedRun
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.rig.simulator import ARITHMETIC

from .bag_stretches import MeteredStretch
from .run_comparison import Finding, LogCheck

__all__ = ['LogReplay', 'replayed_log']


_FROM_MOTION = 'the recorded motion was checked against the equations of motion to round-off'


@dataclass(frozen=True)
class LogReplay:
    """
    What the replay of a bag found.

    Attributes
    ----------
    check : LogCheck
        How the log was checked.
    differences : tuple of Difference
        The first ones after each change of the rig; empty if the log was not replayed exactly.
    faults : tuple of str
        Why the replay is of part of the bag only.
    """

    check: LogCheck
    differences: tuple[Difference, ...] = ()
    faults: tuple[str, ...] = ()

    def judged(
        self, stretches: Iterable[MeteredStretch]
    ) -> Iterator[tuple[MeteredStretch, list[Finding] | None]]:
        """
        Yield stretches with what differs in each of them; None if nothing was replayed.

        A difference at the instant of a change belongs to the stretch that begins there, one
        outside of all stretches to the nearest.
        """
        left = deque(sorted(self.differences, key=lambda difference: difference.time))
        before: MeteredStretch | None = None
        for metered in itertools.chain(stretches, [None]):
            if before is not None:
                end = math.inf if metered is None else metered.stretch.start
                found = []
                while left and left[0].time < end:
                    found.append(_finding(left.popleft()))
                yield before, found if self.check.replayed else None
            before = metered


def _finding(difference: Difference) -> Finding:
    recorded, replayed = difference.recorded, difference.replayed
    unit = f' {difference.unit}' if difference.unit else ''
    where = f'{difference.quantity} on {difference.topic} at {difference.time:.9g} s'
    if recorded is None and difference.quantity in ('impact', 'act of the gap control'):
        text = f'{where} is missing in the log ({replayed})'
    elif difference.quantity == 'state_rate':
        text = f'{where} is {_shown(recorded)} in the log, at which its joint states do not lie'
    elif replayed is None:
        text = f'{where} is in the log, but did not happen ({recorded})'
    else:
        text = (
            f'{where} is {_shown(recorded)}{unit} in the log, and {_shown(replayed)}{unit} when '
            'the log is replayed'
        )
    return Finding(
        quantity=f'{difference.quantity} on {difference.topic}',
        unit=difference.unit,
        time=difference.time,
        measured=_number(recorded),
        expected=_number(replayed),
        tolerance=0.0,
        text=text,
    )


def _shown(value: object) -> str:
    if value is None:
        return 'not given'
    return f'{value:.9g}' if isinstance(value, float) else str(value)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def replayed_log(
    path: Path, node: str | None, progress: Callable[[float], object] = float
) -> LogReplay:
    """
    Replay a bag, and return what differs.

    Parameters
    ----------
    path : Path
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    progress : callable, optional
        Called now and then with the rig time reached, s.
    """
    try:
        replay = Replay(RecordedRun(path, node, purpose='compare'), adopt=True)
    except RecordingError as error:
        return LogReplay(LogCheck(False, f'{_FROM_MOTION}; it could not be replayed: {error}'))
    arithmetic = replay.recorded.start.arithmetic
    if arithmetic > ARITHMETIC:
        newer = (
            f'it was recorded with arithmetic {arithmetic}, later than that of this version, '
            f'{ARITHMETIC}: use the version of impact_damper_ros that recorded it'
        )
        return LogReplay(LogCheck(False, f'{_FROM_MOTION}; {newer}'), faults=(newer,))
    findings = replay.run(progress)
    if arithmetic != ARITHMETIC and findings.by_topic.keys() & {
        replay.recorded.topics.joint_states,
        replay.recorded.topics.impacts,
    }:
        why = f'it was recorded with arithmetic {arithmetic}, this version has {ARITHMETIC}'
    elif findings.by_another_library:
        why = 'it was recorded where the mathematical functions round otherwise'
    elif not findings.samples:
        why = 'no sample could be compared'
    else:
        count = findings.difference_count
        how = f'replayed, with {count} difference{"" if count == 1 else "s"}'
        said = f'{how if count else "replayed bit for bit"}: {findings.samples} samples, '
        said += f'{findings.impacts} impacts'
        if findings.control:
            said += f', {findings.control} acts of the gap control'
        said += f', {findings.snapshots} snapshots'
        check = LogCheck(True, said, count, _unchecked(replay))
        return LogReplay(check, tuple(findings.kept), tuple(findings.faults))
    check = LogCheck(False, f'{_FROM_MOTION}; not bit for bit, since {why}')
    return LogReplay(check, faults=tuple(findings.faults))


def _unchecked(replay: Replay) -> tuple[str, ...]:
    """Return what the replay does not look at."""
    topics = replay.recorded.topics
    checked = {topics.joint_states, topics.impacts, topics.gap_control, topics.snapshot}
    found = [
        name
        for name in sorted(replay.recorded.reader.topics)
        if name not in checked and name != topics.parameter_events
    ]
    if topics.parameter_events:
        what = 'settings of the node'
        if replay.recorded.start.time_ns:
            what += ', initial_* up to the first reset'
        found.append(f'{topics.parameter_events}: {what}')
    return tuple(found)
