"""
Instructions that a plain impact of a compiled long run takes; the same on a busy machine.

    python benchmarks/instructions.py

By valgrind's callgrind, which must be installed: the difference between a long and a short run.
It knows no AVX-512, so that the kernels are compiled for a processor without it; on one with it
they take fewer, since less has to be put aside.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from golden_cases import CASES

PROCESSOR = {'NUMBA_CPU_NAME': 'haswell', 'NUMBA_CPU_FEATURES': '+avx,+avx2,+fma,+sse4.2'}
CYCLES = 100, 20_100
RUN = """
import sys
from math import tau
from impact_damper_ros import Rig, RigParameters
rig = Rig(RigParameters(**eval(sys.argv[1])), compiled=True)
cycle = tau / rig.force_frequency
rig.run(100.0 * cycle, record=False)
stretch = rig.run((100.0 + float(sys.argv[2])) * cycle, record=False)
print(stretch.event_count)
"""


def counted(path: Path) -> Counter[str]:
    """Return the instructions of each object file in a callgrind profile."""
    names: dict[str, str] = {}
    counts: Counter[str] = Counter()
    within, called = '', False
    for line in path.read_text(errors='replace').splitlines():
        if match := re.match(r'(c?ob)=\((\d+)\)(?: (.*))?', line):
            if match[3]:
                names[match[2]] = match[3]
            if match[1] == 'ob':
                within = names[match[2]]
        elif line.startswith('calls='):
            called = True
        elif re.match(r'[\d+*-]', line):
            # After a call comes its inclusive cost, which its own lines have too.
            if not called:
                counts[within] += int(line.split()[-1])
            called = False
    return counts


def measured(changes: str, cycles: int) -> tuple[Counter[str], int]:
    """Return the instructions of each object file in one run, and how many events it had."""
    environment = {**os.environ, **PROCESSOR}
    command = [sys.executable, '-c', RUN, changes, str(cycles)]
    # Compiled beforehand, and not under the profiler
    plain = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [
                'valgrind',
                '--tool=callgrind',
                '--trace-children=yes',
                f'--callgrind-out-file={folder}/%p.out',
                *command,
            ],
            env=environment,
            check=True,
            capture_output=True,
        )
        counts = sum(map(counted, Path(folder).glob('*.out')), Counter())
    return counts, int(plain.stdout)


def main() -> int:
    """Count and print."""
    if shutil.which('valgrind') is None:
        print('valgrind is not installed; on Debian or Ubuntu: apt install valgrind')
        return 1
    for case in CASES:
        (short, few), (long, many) = (measured(repr(case.changes), n) for n in CYCLES)
        kernels, sines = (
            sum(long[name] - short[name] for name in long if part in name) / (many - few)
            for part in ('???', 'libm')
        )
        print(f'{case.name}: {kernels:.0f} instructions in the kernels, {sines:.0f} in libm')
    return 0


if __name__ == '__main__':
    sys.exit(main())
