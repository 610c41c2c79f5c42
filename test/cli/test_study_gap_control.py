"""The command that writes docs/gap_control."""

from dataclasses import replace
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros.cli.study_gap_control import main
from impact_damper_ros.studies.gap_control import runs as gap_study_plan

DOCS = Path(impact_damper_ros.__file__).parents[1] / 'docs' / 'gap_control'
FIGURES = {'level', 'broadband', 'stepped_sine', 'load', 'incline', 'sensitivity'}


def test_the_whole_study_in_small(tmp_path, monkeypatch, capsys):
    """Every run, table and figure, but short."""
    pytest.importorskip('matplotlib')
    small = replace(
        gap_study_plan.Extent.quick(), levels=(0.5, 1.0), gaps=(0.8,), broadband_gaps=(16.0,),
        settle=4.0, watch=4.0, broadband=8.0, frequency_step=0.2, frequency_dwell=2.0,
        load_span=4.0,
    )  # fmt: skip
    monkeypatch.setattr(gap_study_plan.Extent, 'quick', classmethod(lambda _: small))
    assert main(['--quick', '--output', str(tmp_path / 'study'), '--jobs', '1']) == 0
    files = {path.name for path in (tmp_path / 'study').iterdir()}
    assert files == {'README.md', *(f'{figure}.png' for figure in FIGURES)}
    text = (tmp_path / 'study' / 'README.md').read_text(encoding='utf-8')
    assert text.count('\n| ') > 60
    assert all(f'({figure}.png)' in text for figure in FIGURES)
    assert ' nan' not in text
    for law in ('amplitude', 'timed', 'predictive'):
        # Levels of three angles, broadband, stepped sine, energy twice, and the sensitivities
        assert text.count(f'\n| {law}') > 10
    printed = capsys.readouterr().out
    assert printed.count('at most') == 4
    assert printed.count('with stops at finite speed') == 4


def test_the_page_in_the_repository_is_whole():
    text = (DOCS / 'README.md').read_text(encoding='utf-8')
    for figure in FIGURES:
        assert f'({figure}.png)' in text
        assert (DOCS / f'{figure}.png').stat().st_size > 20_000
    assert text.count('| met |') == 4
    targets = [line.split(' | ') for line in text.splitlines() if '| met |' in line]
    # What the actuators spend is beside every number
    assert [cells[-1].rstrip(' |')[-1] for cells in targets] == ['%'] * 4
    # The mean and the largest of at least eight seeds, each with its own best gap
    assert '(1 to 8)' in text
    mean, largest = (float(cells[2]) for cells in targets[2:])
    assert 0.70 < mean < largest < 0.80


def test_what_cannot_be_written(tmp_path, capsys):
    blocker = tmp_path / 'file'
    blocker.write_text('in the way')
    assert main(['--quick', '--output', str(blocker / 'docs')]) == 1
    assert 'give a directory that can be written' in capsys.readouterr().err


def test_arguments(capsys):
    for words in (['--jobs', '0'], ['--jobs', 'many']):
        with pytest.raises(SystemExit) as exit_:
            main(words)
        assert exit_.value.code == 2
    assert 'whole number from 1 to 64' in capsys.readouterr().err
