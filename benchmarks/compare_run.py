"""
What `compare_run` takes for an hour of the bench rig at 200 Hz: time, processor and memory.

The recording is made by `simulate_rig --bag`.

Run by ``python benchmarks/compare_run.py [--hours H]``.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMMANDS = 'impact_damper_ros.cli'


def timed(command: list[str]) -> tuple[float, float, float]:
    """Run a command; return wall and processor time, s, and its largest memory, MB."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    subprocess.run([sys.executable, '-m', *command], check=True, env=environment)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, spent, after.ru_maxrss / 1e3


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--hours', type=float, default=1.0)
    hours = parser.parse_args().hours
    with tempfile.TemporaryDirectory() as directory:
        bag = str(Path(directory) / 'bag')
        rig = str(ROOT / 'config' / 'bench_rig.yaml')
        words = ['--duration', str(3600.0 * hours), '--bag', bag, '--quiet']
        # The comparison first needs a recording, the memory of which counts as well.
        recorded = timed([f'{COMMANDS}.simulate_rig', rig, *words])
        compared = timed([f'{COMMANDS}.compare_run', bag, '--quiet'])
    print(f'{hours:g} h of the bench rig at 200 Hz')
    print(f'recorded   {recorded[0]:6.1f} s, processor {recorded[1]:6.1f} s')
    print(f'compared   {compared[0]:6.1f} s, processor {compared[1]:6.1f} s')
    print(f'memory     at most {max(recorded[2], compared[2]):.0f} MB, of both')


if __name__ == '__main__':
    main()
