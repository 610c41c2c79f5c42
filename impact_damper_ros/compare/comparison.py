"""The comparison of a whole recorded run: its log replayed, its stretches compared."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impact_damper_ros import __version__
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay.findings import Difference
from impact_damper_ros.replay.recorded_run import RecordedRun
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.quoting import counted
from impact_damper_ros.rig.snapshot import ARITHMETIC

from .bag_stretches import BagStretches, CheckedStretch
from .log_findings import with_fitted_clock
from .result import Finding, LogCheck, RunComparison, StretchComparison
from .verdict import compare_stretch

_FROM_MOTION = 'the recorded motion was checked against the equations of motion, to round-off'

#: Estimated error of X between joint states, as a share, that is remarked on.
_COARSE = 0.01

Progress = Callable[[float], object]


@dataclass(frozen=True)
class LogReplay:
    """The result of the replay of a bag."""

    check: LogCheck  # how the log was checked
    #: The first ones after each change of the rig; empty if the log was not replayed exactly.
    differences: tuple[Difference, ...] = ()
    faults: tuple[str, ...] = ()  # why only a part of the bag was replayed

    def by_stretch(
        self, bag: BagStretches
    ) -> Iterator[tuple[CheckedStretch, list[Finding] | None]]:
        """
        Yield stretches with the differences in each of them; None if nothing was replayed.

        A difference at the instant of a change belongs to the stretch that begins there, one
        outside of all stretches to the nearest. What a replay has reproduced bit for bit is not
        checked again.
        """
        bag.checks = not self.check.replayed or bool(self.differences)
        left = deque(sorted(self.differences, key=lambda difference: difference.time))
        before: CheckedStretch | None = None
        for checked in itertools.chain(bag, [None]):
            if before is not None:
                end = math.inf if checked is None else checked.stretch.start
                found = []
                while left and left[0].time < end:
                    found.append(_finding(left.popleft()))
                yield before, found if self.check.replayed else None
            before = checked


def _finding(difference: Difference) -> Finding:
    recorded, replayed = difference.recorded, difference.replayed
    unit = f' {difference.unit}' if difference.unit else ''
    where = f'{difference.quantity} on {difference.topic} at {difference.time:.9g} s'
    if recorded is None and difference.quantity in ('impact', 'act of the gap control'):
        text = f'{where} is missing in the log ({replayed})'
    elif difference.quantity == 'state_rate':
        text = f'{where} is {_shown(recorded)} in the log; the joint states have a different rate'
    elif replayed is None:
        text = f'{where} is in the log, but did not happen ({recorded})'
    else:
        there, here = _shown(recorded), _shown(replayed)
        if there == here:
            there, here = str(recorded), str(replayed)
        text = f'{where} is {there}{unit} in the log, and {here}{unit} when the log is replayed'
    quantity = f'{difference.quantity} on {difference.topic}'
    numbers = (difference.time, _number(recorded), _number(replayed), 0.0)
    return Finding(quantity, difference.unit, *numbers, text)


def _shown(value: object) -> str:
    if value is None:
        return 'not given'
    return f'{value:.9g}' if isinstance(value, float) else str(value)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def replay_log(path: Path, node: str | None, progress: Progress = float) -> LogReplay:
    """
    Replay a bag, and return what differs.

    `progress` is called now and then with the rig time reached, s.
    """
    try:
        replay = Replay(RecordedRun(path, node, purpose='compare'), adopt=True)
    except RecordingError as error:
        return LogReplay(LogCheck(False, f'{_FROM_MOTION}; it could not be replayed: {error}'))
    arithmetic = replay.recorded.start.arithmetic
    if arithmetic > ARITHMETIC:
        newer = (
            f'it was recorded with arithmetic {arithmetic}, newer than arithmetic {ARITHMETIC} of '
            f'this version: use the version of impact_damper_ros that recorded it'
        )
        return LogReplay(LogCheck(False, f'{_FROM_MOTION}; {newer}'), faults=(newer,))
    findings = replay.run(progress)
    if arithmetic != ARITHMETIC and findings.by_topic.keys() & {
        replay.recorded.topics.joint_states,
        replay.recorded.topics.impacts,
    }:
        why = f'it was recorded with arithmetic {arithmetic}, this version has {ARITHMETIC}'
    elif findings.by_another_library:
        why = 'it was recorded on a machine whose mathematical functions round differently'
    elif not findings.samples:
        why = 'no sample could be compared'
    else:
        count = findings.difference_count
        how = f'replayed, with {counted(count, "difference")}' if count else 'replayed bit for bit'
        said = f'{how}: {counted(findings.samples, "sample")}, '
        said += counted(findings.impacts, 'impact')
        if findings.control:
            said += f', {counted(findings.control, "act")} of the gap control'
        said += f', {counted(findings.snapshots, "snapshot")}'
        check = LogCheck(True, said, count, _unchecked(replay))
        return LogReplay(check, tuple(findings.kept), tuple(findings.faults))
    check = LogCheck(False, f'{_FROM_MOTION}; not bit for bit, since {why}')
    return LogReplay(check, faults=tuple(findings.faults))


def _unchecked(replay: Replay) -> tuple[str, ...]:
    """Return what the replay does not check."""
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


def _on_coarse_samples(stretches: Sequence[StretchComparison]) -> Iterator[str]:
    """Yield a remark if the joint states are too far apart for X between them."""
    doubts = [(s.overall.accuracy, s.number) for s in stretches if s.overall is not None]
    worst, number = max(doubts, default=(0.0, 0))
    if worst > _COARSE:
        size = f'may be off by about {100.0 * worst:.2g} %' if worst < 1.0 else 'are not known'
        yield (
            'the joint states are too far apart: largest |X|, rms X and the energies of force and '
            f'dashpot {size} in stretch {number}; record more a second (state_rate, --rate)'
        )


def _unseen(_what: str, _span: float) -> Progress:
    return float


def compare_bag(
    path: Path,
    node: str | None = None,
    parameters: RigParameters | None = None,
    *,
    progress: Callable[[str, float], Progress] = _unseen,
) -> RunComparison:
    """
    Compare a recorded run with theory.

    Parameters
    ----------
    path : Path
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    parameters : RigParameters, optional
        The rig, for a bag that does not name its parameters.
    progress : callable, optional
        Called at the begin of ``'replayed'`` and ``'compared'`` with the length of the run in s;
        what it returns is called now and then with the rig time reached, s.

    Returns
    -------
    RunComparison
        The result.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or holds no rig.
    """
    path = Path(path)
    # A wrong number may be as large as numbers are.
    with np.errstate(over='ignore', invalid='ignore'):
        bag = BagStretches(path, node, parameters)
        reader = bag.recorded.reader
        span = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9
        log = replay_log(path, node, progress('replayed', span))
        bag.progress = progress('compared', span)
        stretches: list[StretchComparison] = []
        remarks: list[str] = []
        for (stretch, search), replayed in log.by_stretch(bag):
            if stretch.clock is None:
                stretch, search = with_fitted_clock(stretch)
                if stretch.clock is not None:
                    remarks.append(
                        f'the phase of the force in stretch {stretch.number} is not in the bag; '
                        'it was found from the motion'
                    )
            stretches.append(compare_stretch(stretch, search, replayed))
        remarks += _on_coarse_samples(stretches)
    return RunComparison(
        bag=str(path),
        node=bag.recorded.topics.name,
        version=__version__,
        complete=reader.complete,
        stamps='rig time' if bag.recorded.stamped else 'times of arrival',
        start=(bag.start_ns or 0) / 1e9,
        end=(bag.end_ns or 0) / 1e9,
        samples=bag.samples,
        impacts=bag.impacts,
        stretches=tuple(stretches),
        log=log.check,
        faults=tuple(dict.fromkeys([*bag.faults(), *log.faults])),
        remarks=(*bag.remarks(), *remarks),
    )
