"""The figure of what a file was read as."""

import numpy as np
import pytest

from impact_damper_ros.cli.fit_rig import main as fit_rig
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.fit.measured_motion import ReadingOptions, read_table_motion
from impact_damper_ros.fit.recorded_motion import bag_messages, motion_of_messages
from impact_damper_ros.report.look_figure import look_figure, message_columns, raw_columns

TIME = np.arange(200) / 200.0
HEAD = 't [s],shaker [g],x [mm],temperature [°C],note\n'


@pytest.fixture
def path(tmp_path):
    motion = np.clip(12.0 * np.cos(31.0 * TIME), -8.0, 8.0)
    motion[50] = 9999.0
    lines = [f'{t:.3f},{t:.3f},{x:.3f},20,a\n' for t, x in zip(TIME, motion, strict=True)]
    del lines[100:105]
    path = tmp_path / 'run.csv'
    path.write_text(HEAD + ''.join(lines), encoding='utf-8')
    return path


def test_each_column_is_drawn(path):
    data = read_table_motion(path)
    figure = look_figure(raw_columns(path), data)
    titles = [axes.get_title(loc='right') for axes in figure.axes]
    count = int((~data.used).sum())
    assert titles == [f'motion; {count} of 200 samples not used', 'base', 'not used']
    assert [axes.get_ylabel() for axes in figure.axes] == [
        *('x [mm]', 'shaker [g]', 'temperature [°C]')
    ]
    line, unused = figure.axes[0].lines
    assert len(line.get_xdata()) == 195
    assert len(unused.get_xdata()) == count > 80
    # Not by the number that stands for a missing sample
    assert figure.axes[0].get_ylim()[1] < 12.0


def test_the_command_draws_and_fits_nothing(path, tmp_path, capsys):
    target = tmp_path / 'look.svg'
    assert fit_rig([str(path), '--look', str(target)]) == 0
    said = capsys.readouterr()
    assert said.out == ''
    assert "reads time 't [s]', base 'shaker [g]', motion 'x [mm]'; not used: 'temp" in said.err
    assert target.read_text().startswith('<?xml')
    # What cannot be used is drawn as well, and why it cannot be used is reported
    path.write_text(path.read_text(encoding='utf-8').replace('\n0.9', '\n0.1', 1), 'utf-8')
    target.unlink()
    assert fit_rig([str(path), '--look', str(target)]) == 2
    assert 'the times go back' in capsys.readouterr().err
    assert target.exists()
    with pytest.raises(SystemExit):
        fit_rig([str(path), '--look', str(target), '--json', '-'])


def test_a_topic_of_a_bag_is_drawn(tmp_path, capsys):
    """Every joint, over rig time; of a rig on an incline X counts from its equilibrium."""
    bag, target = tmp_path / 'run', tmp_path / 'look.svg'
    given = ['--set', 'angle=30 deg', '--duration', '3', '--bag', str(bag), '--quiet']
    assert simulate_rig(['bench_rig', *given, '--change', '2:gap=0.03']) == 0
    options = ReadingOptions(joint='primary')
    messages = bag_messages(bag, options)
    columns, data = message_columns(messages, options), motion_of_messages(messages, options)
    assert [column.role for column in columns] == ['motion', '', '', '', '', 'base', '']
    assert columns[0].time[-1] == 3.0
    assert columns[0].values[: len(data.motion)].tolist() == data.motion.tolist()
    title, *others = (a.get_title(loc='right') for a in look_figure(columns, data).axes)
    assert title == f'motion; {len(data.impact_times)} impacts'
    assert others == ['base', *['not used'] * 5]
    capsys.readouterr()
    assert fit_rig([str(bag), '--look', str(target)]) == 0
    assert target.read_text().startswith('<?xml')
