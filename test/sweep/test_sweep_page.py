"""The Python program on the page about sweeps."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import impact_damper_ros

pytest.importorskip('matplotlib')
pytest.importorskip('pyarrow')

ROOT = Path(impact_damper_ros.__file__).parents[1]


def test_the_program_runs_as_it_stands(tmp_path):
    """With fewer gaps, of which the widest is best."""
    page = (ROOT / 'docs' / 'reference' / 'sweeps.md').read_text(encoding='utf-8')
    program = page.split('```python\n')[-1].split('```')[0]
    assert 'np.linspace(10, 60, 200)' in program
    (tmp_path / 'program.py').write_text(program.replace('(10, 60, 200)', '(24, 40, 3)'))
    (tmp_path / 'config').symlink_to(ROOT / 'config')
    done = subprocess.run(
        [sys.executable, 'program.py'],
        cwd=tmp_path,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith('(40.0,) 9.08')
    assert {path.name for path in tmp_path.iterdir()} == {
        *('program.py', 'config', 'gap.parquet', 'gap.png')
    }
