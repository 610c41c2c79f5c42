"""What `rig_page` refuses before it starts."""

import pytest

from impact_damper_ros.cli.rig_page import main

pytest.importorskip('tornado')


def test_a_file_that_is_no_bag_is_refused(tmp_path, capsys):
    table = tmp_path / 'm.csv'
    table.write_text('time,x\n')
    assert main(['--bag', str(table)]) == 2
    printed = capsys.readouterr()
    assert f'{table} is no bag: give a file .mcap or .db3' in printed.err
    assert 'http' not in printed.out


@pytest.mark.parametrize('port', ['abc', '-1', '65536', '80.0', ''])
def test_a_port_is_a_whole_number(port, capsys):
    with pytest.raises(SystemExit, match='2'):
        main([f'--port={port}'])
    assert f'{port!r}: give a whole number from 0 to 65535' in capsys.readouterr().err
