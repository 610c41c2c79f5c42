"""What `rig_page` refuses before it starts."""

import socket

import pytest

from impact_damper_ros.cli.rig_page import main

pytest.importorskip('tornado')


def test_a_bag_of_something_else_is_refused(tmp_path, capsys):
    broken = tmp_path / 'm.mcap'
    broken.write_text('time,x\n')
    assert main(['--bag', str(broken)]) == 2
    printed = capsys.readouterr()
    assert str(broken) in printed.err
    assert len(printed.err.splitlines()) == 1
    assert 'http' not in printed.out


def test_a_port_in_use_is_the_last_word_and_nothing_has_started(capsys):
    """Not after the lines of a node that has to be ended again."""
    pytest.importorskip('rclpy')
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(['--start', 'bench_rig', '--port', str(port)]) == 1
    printed = capsys.readouterr()
    assert printed.out == ''
    (line,) = [line for line in printed.err.splitlines() if line.startswith('rig_page: ')]
    assert f'cannot listen on 127.0.0.1, port {port}' in line
    assert line.endswith(f'as in: make page ARGS="--port {port % 65535 + 1}"')
