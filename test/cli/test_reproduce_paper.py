"""`reproduce_paper`: files, errors, interruption."""

import csv
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip('matplotlib')

from impact_damper_ros.cli.reproduce_paper import main


def test_quick_figures_are_whole_and_the_same_each_time(tmp_path, capsys):
    from matplotlib.image import imread

    first, second = tmp_path / 'first', tmp_path / 'second'
    assert main(['--quick', '--only', '4', '--output', str(first)]) == 0
    assert main(['--quick', '--only', '4', '--output', str(second), '--jobs', '1']) == 0
    assert sorted(p.name for p in first.iterdir()) == ['figure_4.csv', 'figure_4.png']
    for name in ('figure_4.csv', 'figure_4.png'):
        assert (first / name).read_bytes() == (second / name).read_bytes()
    picture = imread(first / 'figure_4.png')
    assert picture.shape[0] > 500
    assert picture.shape[1] > 800
    assert picture.std() > 0.01
    out = capsys.readouterr().out
    assert 'reproduced' in out
    with (first / 'figure_4.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert {row['kind'] for row in rows} >= {'stable', 'unstable', 'simulated'}
    tilted = [r for r in rows if r['series'] == '4 ζ=0.005' and r['kind'] == 'stable']
    assert float(tilted[-1]['xmax_over_a']) == pytest.approx(0.0475, abs=2e-4)


@pytest.mark.parametrize('only', ['7', '2g', '', '3a,x'])
def test_unknown_figures_are_named(only, capsys):
    assert main(['--only', only]) == 2
    assert 'is not a figure' in capsys.readouterr().err


def test_output_that_cannot_be_written(tmp_path, capsys):
    file = tmp_path / 'file'
    file.write_text('')
    assert main(['--quick', '--only', '4', '--output', str(file / 'inside')]) == 1
    assert 'cannot write' in capsys.readouterr().err


def test_ctrl_c_leaves_nothing_half_written(tmp_path):
    command = [sys.executable, '-m', 'impact_damper_ros.cli.reproduce_paper']
    process = subprocess.Popen(
        [*command, '--only', '2', '--output', str(tmp_path)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    time.sleep(3.0)
    os.killpg(process.pid, signal.SIGINT)
    err = process.communicate(timeout=20)[1]
    assert process.returncode == 130
    assert 'interrupted' in err
    assert 'Traceback' not in err
    assert list(tmp_path.iterdir()) == []
