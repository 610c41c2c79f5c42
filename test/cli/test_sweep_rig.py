"""The command, as users run it: killed, interrupted, on a full disk, with wrong inputs."""

import json
import signal
from pathlib import Path

import pandas as pd
import pytest
from running import Running

import impact_damper_ros
from impact_damper_ros.cli.sweep_rig import main

pytest.importorskip('pyarrow')

ROOT = Path(impact_damper_ros.__file__).parents[1]
PAPER = ROOT / 'config' / 'paper.yaml'
AT_102 = ('--set', 'gravity=0', '--set', 'force_frequencies=[1.02]')
#: Mostly chaotic: long enough to be cut short.
LONG = (*AT_102, '--vary', 'gap=3:13:36', '--cycles', '600', '--watch', '60')
BRIEF = (*AT_102, '--vary', 'gap=24:37:4', '--jobs', '1')


def run(*arguments, params=PAPER):
    return main([str(params), *map(str, arguments)])


def started(directory, *arguments):
    """Start the command in a process of its own."""
    directory.mkdir(exist_ok=True)
    words = ('-m', 'impact_damper_ros.cli.sweep_rig', PAPER, *arguments)
    return Running(directory, *words, errors=True)


def rigs_in(part):
    """Return how many rigs are on disk, whoever writes there now."""
    whole = part.read_text().split('\n')[1:-1]
    return sum(len(rows) for rows, _ in map(json.loads, whole))


def wait_for_rigs(process, journal, count):
    """Wait until some rigs are on disk; return how many are."""
    process.until(lambda: journal.exists() and rigs_in(journal) >= count)
    return rigs_in(journal)


def test_sweep_with_figure_and_findings(tmp_path, capsys):
    pytest.importorskip('matplotlib')
    table, figure, found = (tmp_path / name for name in ('a.parquet', 'a.svg', 'a.json'))
    words = (*BRIEF, '-o', table, '--figure', figure, '--json', found)
    assert run(*words, '--measure', 'x_max') == 0
    rows = pd.read_parquet(table)
    assert list(rows.impacts_per_cycle) == [2.0] * 4
    assert figure.read_text().startswith('<?xml')
    summary = json.loads(found.read_text())
    assert summary['kinds'] == {'periodic': 4}
    assert summary['optimum']['at_edge'] is True
    assert summary['optimum']['values'] == [37.0]
    said = capsys.readouterr().err
    assert f'{table}: 4 rigs: 4 periodic' in said
    assert 'least x_max: 4.8' in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a.json', 'a.parquet', 'a.svg']
    # Again: nothing is run, and another measure may be asked for
    written = table.stat().st_mtime_ns
    assert run(*words, '--measure', 'x_rms') == 0
    assert table.stat().st_mtime_ns == written
    assert json.loads(found.read_text())['optimum']['measure'] == 'x_rms'


def test_rigs_under_gap_control(tmp_path):
    """By the parameters file, with a parameter of the control varied."""
    params = tmp_path / 'controlled.yaml'
    params.write_text(
        '/**:\n  ros__parameters:\n    gravity: 0.0\n    gap_control: timed\n'
        '    gap_control_rate: 4.0\n'
    )
    few = ('--cycles', 60, '--watch', 21, '--jobs', 1, '--quiet', '--measure', 'x_max')
    table, figure, found = (tmp_path / name for name in ('a.parquet', 'a.svg', 'a.json'))
    words = ('--vary', 'gap_control_park=1.2,1.8', *few)
    assert run(*words, '-o', table, '--figure', figure, '--json', found, params=params) == 0
    rows = pd.read_parquet(table)
    assert list(rows.gap_control_park) == [1.2, 1.8]
    assert list(rows.impacts_per_cycle) == pytest.approx([2.0, 2.0], abs=0.1)
    assert (rows.x_max < 10.0).all()
    assert rows.lyapunov_exponent.isna().all()
    assert json.loads(found.read_text())['optimum']['value'] == rows.x_max.min()
    assert 'gap control: timed' in figure.read_text()
    assert 'Lyapunov' not in figure.read_text()
    # Off by --set, the stops of the same file stay where they are
    assert run('--set', 'gap_control=off', *words, '-o', table, params=params) == 2


def test_rigs_that_wait_for_an_external_controller(tmp_path, capsys):
    """They once ended the command, and no row was written."""
    words = ['--set', 'gap_control=external', '--cycles', 30, '--watch', 21, '--vary', 'gap=24,37']
    words += ['--measure', 'lyapunov_exponent', '--jobs', 1, '-o', tmp_path / 'external.csv']
    assert run(*AT_102, *words) == 0
    table = pd.read_csv(tmp_path / 'external.csv', comment='#')
    assert table.ok.all()
    assert set(table.kind) <= {'periodic', 'undecided'}
    assert table.lyapunov_exponent.isna().all()
    assert 'exponents and multipliers are not measured' in capsys.readouterr().err


def test_interrupted_and_killed_sweeps_lose_nothing_and_go_on(tmp_path):
    """Ctrl-C, then kill -9: the same command completes the table."""
    place = tmp_path / 'place'
    place.mkdir()
    table, whole = place / 'cut.parquet', tmp_path / 'whole.parquet'
    journal = place / 'cut.parquet.part'
    words = (*LONG, '--jobs', '2', '-o', table)
    with started(tmp_path / 'output', *words) as process:
        done = wait_for_rigs(process, journal, 1)
        assert process.stop() == 128 + signal.SIGINT
    for text in ('interrupted', 'of 36 rigs are in', 'give the same command again to resume'):
        assert text in process.errors
    assert 'Traceback' not in process.errors
    assert list(place.iterdir()) == [journal]
    assert rigs_in(journal) >= done
    with started(tmp_path / 'output', *words) as process:
        done = wait_for_rigs(process, journal, rigs_in(journal) + 3)
    assert not table.exists()
    assert done <= rigs_in(journal) < 36
    for path in (table, whole):
        assert run(*LONG, '--jobs', 1, '-o', path, '--quiet') == 0
    assert not journal.exists()
    assert table.read_bytes() == whole.read_bytes()


def test_what_is_there_is_not_replaced_unasked(tmp_path, capsys):
    """The table of another sweep, a CSV file, which is not read back, and what is no table."""
    few = ('--cycles', 50, '--watch', 21, '--jobs', 1, '--quiet')
    words = (*AT_102, '--vary', 'gap=24,37', *few, '-o')
    table, listed = tmp_path / 'a.parquet', tmp_path / 'a.csv'

    def refused(path, *reasons, more=()):
        """See that a sweep is refused, and that it replaces the file when it may."""
        before = path.read_bytes()
        assert run(*words, path, *more) == 2
        said = capsys.readouterr().err
        assert all(reason in said for reason in (*reasons, '--overwrite')), said
        assert path.read_bytes() == before
        assert run(*words, path, *more, '--overwrite') == 0
        assert path.read_bytes() != before

    assert run(*words, table) == run(*words, listed) == 0
    whole, written = table.read_bytes(), table.stat().st_mtime_ns
    # Nothing is run again for the same sweep.
    assert run(*words, table) == 0
    assert table.stat().st_mtime_ns == written
    other = 'parameters.damping: 0.01 there, 0.02 here'
    inputs = f'{table} is the table of a sweep with other inputs'
    refused(table, inputs, other, more=('--set', 'damping=0.02'))
    listed.write_text('mine')
    refused(listed, 'a.csv is not the table of a sweep')
    for lost in (5, 300):
        table.write_bytes(whole[:-lost])
        refused(table, 'is not')
        assert table.read_bytes() == whole
    table.write_text('mine')
    refused(table, 'a.parquet is not the table of a sweep')


def test_a_motion_that_settles_while_it_is_watched_is_periodic(tmp_path):
    incline = ('--set', 'angle=0.7854', '--set', 'gravity=1', '--set', 'force_frequencies=[1.02]')
    words = (*incline, '--vary', 'gap=36,37', '--jobs', 1, '--quiet', '-o', tmp_path / 'a.csv')
    assert run(*words, '--cycles', 100, '--watch', 300) == 0
    rows = pd.read_csv(tmp_path / 'a.csv', comment='#')
    assert list(rows.kind) == ['periodic'] * 2
    assert list(rows.stops) == ['1,2'] * 2
    assert rows.largest_multiplier[1] == pytest.approx(0.94121, abs=1e-5)
    assert (rows.settling_cycles == 400).all()


def test_a_force_too_slow_to_be_run_is_a_row(tmp_path, capsys):
    words = ('--vary', 'force_frequencies=1e-12,1', '--cycles', 60, '--watch', 21)
    assert run(*words, '--jobs', 1, '-o', tmp_path / 'a.csv') == 0
    assert 'such a slow motion is no vibration' in capsys.readouterr().err


def test_every_rig_failed(tmp_path, capsys):
    assert run('--vary', 'damping=2,3', '--jobs', 1, '-o', tmp_path / 'a.parquet') == 4
    assert '1 failed: damping is 3.0 N s/m, a damping ratio of 1.5' in capsys.readouterr().err


def test_no_optimum_says_why(tmp_path, capsys):
    """Chaotic, or not settled yet."""
    words = ('--vary', 'gap=12,12.5', '--set', 'gravity=0', '--cycles', 50, '--watch', 21)
    assert run(*words, '--jobs', 1, '-o', tmp_path / 'a.parquet') == 0
    assert 'no optimum, since no motion repeats: give more --cycles' in capsys.readouterr().err
