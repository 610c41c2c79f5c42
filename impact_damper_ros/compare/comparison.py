# SPDX-License-Identifier: Apache-2.0
"""A whole recorded run, replayed and compared with theory in one pass."""

from __future__ import annotations

import dataclasses
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from impact_damper_ros import __version__
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.replay import Findings, RecordedRun, Replay

from .result import LogCheck, LogVerdict, RunComparison, StretchComparison
from .stretches import Stretches
from .verdict import compare_stretch


def _log_check(replay: Replay) -> LogCheck:
    """Return how the log of a replayed run was checked."""
    findings = replay.findings
    count = findings.difference_count
    exactly = 'within the errors of round-off' if findings.other_bits else 'bit for bit'
    how = f'replayed, with {plural(count, "difference")}' if count else f'replayed {exactly}'
    text = f'{how}: {plural(findings.samples, "sample")}, {plural(findings.impacts, "impact")}'
    if findings.gap_control:
        text += f', {plural(findings.gap_control, "act")} of the gap control'
    text += f', {plural(findings.snapshots, "snapshot")}'
    return LogCheck(text, count, findings.unchecked)


def _on_interruptions(findings: Findings) -> Iterator[str]:
    """Yield remarks on pauses and stalls."""
    for count, what in (
        (findings.pauses, 'the rig was paused {}; rig time did not advance meanwhile'),
        (findings.slips, 'the machine stalled {}, and the stamps were moved on'),
    ):
        if count:
            yield what.format('once' if count == 1 else f'{count} times')


def _with_log(
    stretches: Sequence[StretchComparison], findings: Findings
) -> Iterator[StretchComparison]:
    """Yield the stretches, each with the differences between its log and the replay."""
    ends = [stretch.end for stretch in stretches[:-1]]
    # A difference at the end of a stretch belongs to the next one, as a change does.
    places = [bisect_right(ends, difference.time) for difference in findings.differences]
    for place, stretch in enumerate(stretches):
        pairs = zip(places, findings.differences, strict=True)
        mine = tuple(difference for at, difference in pairs if at == place)
        log = LogVerdict.DIFFERS if mine else LogVerdict.REPRODUCED
        yield dataclasses.replace(stretch, log=log, differences=mine)


def compare_bag(
    path: Path,
    node: str | None = None,
    number: int = 1,
    *,
    law: OwnLaw | None = None,
    progress: Callable[[float], object] = float,
) -> RunComparison:
    """
    Compare a recorded run with theory.

    Parameters
    ----------
    path : Path
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    number : int, optional
        Number of the run, from 1 on, if the node was restarted while it was recorded.
    law : OwnLaw, optional
        The law that moved the stops, for a rig with one of the user's own.
    progress : callable, optional
        Called now and then with the share of the work that is done.

    Returns
    -------
    RunComparison
        The result.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or holds no rig.
    """
    return compare_run(
        RecordedRun(path, node, number, purpose='compare', law=law), progress=progress
    )


def compare_run(
    recorded: RecordedRun, *, progress: Callable[[float], object] = float
) -> RunComparison:
    """Compare a recorded run with theory; for the parameters see `compare_bag`."""
    reader = recorded.reader
    start = recorded.start.time
    compared: list[StretchComparison] = []
    # A wrong number may be as large as any float.
    with np.errstate(over='ignore', invalid='ignore'):
        replay = Replay(recorded)
        stretches = Stretches(replay.start.state, replay.period)
        for stretch in stretches.of(replay):
            progress(min(1.0, (stretch.end - start) / (reader.span or 1.0)))
            compared.append(compare_stretch(stretch))
    findings = replay.findings
    remarks = [*_on_interruptions(findings), *findings.remarks]
    if not recorded.topics.impacts:
        remarks.append('the topic of the impacts was not recorded: there are only samples')
    return RunComparison(
        bag=str(reader.path),
        node=recorded.topics.name,
        version=__version__,
        complete=reader.complete,
        run=recorded.number,
        run_count=recorded.run_count,
        start=stretches.start,
        end=stretches.end,
        samples=findings.samples,
        impacts=findings.recorded_impacts,
        stretches=tuple(_with_log(compared, findings)),
        log=_log_check(replay),
        faults=tuple(dict.fromkeys(findings.faults)),
        remarks=tuple(remarks),
    )
