# SPDX-License-Identifier: Apache-2.0
"""A whole recorded run, replayed and compared with theory in one pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from impact_damper_ros import __version__
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.parameters.quoting import counted
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay import Difference, Findings, RecordedRun, Replay

from .result import Finding, LogCheck, LogVerdict, RunComparison, StretchComparison
from .stretches import RecordedPieces, Stretches
from .verdict import compare_stretch

#: Estimated error of X between joint states, as a share, that is remarked on.
_COARSE = 0.01

Progress = Callable[[float], object]


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


def _log_check(replay: Replay) -> LogCheck:
    """Return how the log of a replayed run was checked."""
    findings = replay.findings
    count = findings.difference_count
    exactly = 'within the errors of round-off' if findings.other_bits else 'bit for bit'
    how = f'replayed, with {counted(count, "difference")}' if count else f'replayed {exactly}'
    said = f'{how}: {counted(findings.samples, "sample")}, {counted(findings.impacts, "impact")}'
    if findings.control:
        said += f', {counted(findings.control, "act")} of the gap control'
    said += f', {counted(findings.snapshots, "snapshot")}'
    return LogCheck(True, said, count, _unchecked(replay))


def _on_interruptions(findings: Findings) -> Iterator[str]:
    """Yield remarks on pauses and stalls."""
    for count, what in (
        (findings.pauses, 'the rig was paused {}; rig time did not advance meanwhile'),
        (findings.slips, 'the machine stalled {}, and the stamps were moved on'),
    ):
        if count:
            yield what.format('once' if count == 1 else f'{count} times')


def _unchecked(replay: Replay) -> tuple[str, ...]:
    """Return what the replay does not check."""
    topics = replay.recorded.topics
    checked = {topics.joint_states, topics.impacts, topics.gap_control, topics.snapshot}
    found = [
        name
        for name in sorted({name for name, _ in replay.recorded.reader.topics})
        if name not in checked and name != topics.parameter_events
    ]
    if topics.parameter_events:
        found.append(f'{topics.parameter_events}: settings of the node')
    if replay.findings.other_bits and topics.gap_control:
        found.append(topics.gap_control)
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
    law: OwnLaw | None = None,
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
    law : OwnLaw, optional
        The law that moved the stops, for a rig with one of the user's own.
    progress : callable, optional
        Called at the begin with ``'compared'`` and the length of the run in s; what it returns is
        called now and then with the rig time reached, s.

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
    recorded = RecordedRun(path, node, purpose='compare', snapshot_needed=False, law=law)
    reader = recorded.reader
    span = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9
    reached = progress('compared', span)
    stretches: list[StretchComparison] = []
    remarks: list[str] = []
    # A wrong number may be as large as numbers are.
    with np.errstate(over='ignore', invalid='ignore'):
        if recorded.start is not None:
            replay = Replay(recorded)
            found = Stretches(replay)
            said = 0
            for stretch in found:
                reached(stretch.end)
                kept = replay.findings.differences
                mine = [d for d in kept[said:] if d.time < stretch.end or stretch.last]
                said += len(mine)
                log = LogVerdict.DIFFERS if mine else LogVerdict.REPRODUCED
                stretches.append(compare_stretch(stretch, log, [_finding(d) for d in mine]))
            findings, check = replay.findings, _log_check(replay)
            faults, remarks = findings.faults, [*_on_interruptions(findings), *findings.remarks]
            counts = findings.samples, findings.recorded_impacts
            if parameters is not None:
                remarks.append('the bag holds the parameters of its rig: --params was not used')
        else:
            pieces = RecordedPieces(recorded, parameters)
            found = Stretches(pieces)
            for stretch in found:
                reached(stretch.end)
                if stretch.drive is not None:
                    remarks.append(
                        f'the phase of the force in stretch {stretch.number} is not in the bag; '
                        'it was found from the motion'
                    )
                stretches.append(compare_stretch(stretch))
            if pieces.rig is None:
                cause = 'it does not hold the parameters of the rig: no snapshot, no list of all'
                remedy = 'record the topic snapshot too, or give the rig with --params FILE.yaml'
                raise RecordingError('compare', path, cause, remedy)
            check = LogCheck(False, 'not checked: without a snapshot the run cannot be replayed')
            faults = [*recorded.faults(), *pieces.faults]
            remarks = [*recorded.remarks(), *remarks]
            counts = pieces.samples, pieces.impacts
            if pieces.early:
                remarks.append(
                    f'{pieces.early} messages from before the parameters are known were left out'
                )
        if not recorded.topics.impacts:
            remarks.append('the topic of the impacts was not recorded: there are only samples')
        remarks += _on_coarse_samples(stretches)
    return RunComparison(
        bag=str(path),
        node=recorded.topics.name,
        version=__version__,
        complete=reader.complete,
        stamps='rig time' if recorded.stamped else 'times of arrival',
        start=found.start,
        end=found.end,
        samples=counts[0],
        impacts=counts[1],
        stretches=tuple(stretches),
        log=check,
        faults=tuple(dict.fromkeys(faults)),
        remarks=tuple(remarks),
    )
