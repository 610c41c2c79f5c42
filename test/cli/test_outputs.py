"""What cannot be written is found out before the work, and what is written is whole."""

import os
import shutil
import subprocess
import tempfile
import threading
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from small_disk import mounted

from impact_damper_ros import outputs
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.report.csv_tables import open_table


@contextmanager
def bound(source, place):
    """Mount a file in the place of another; skip the test where that is not allowed."""
    mount = shutil.which('mount')
    if not mount or subprocess.run([mount, '--bind', source, place], check=False).returncode:
        pytest.skip('a file cannot be mounted here')
    try:
        yield
    finally:
        subprocess.run(['umount', '-l', place], check=True)


def write_a_part(path):
    with outputs.whole(path) as draft:
        draft.write_text('a part')
        raise RuntimeError


def write_by_text(path):
    outputs.write_text(path, 'new\n')


def write_by_table(path):
    with ExitStack() as stack:
        open_table(path, ('new',), stack)


def test_trying_changes_nothing(tmp_path):
    file, there, pipe = tmp_path / 'file', tmp_path / 'there', tmp_path / 'pipe'
    file.write_text('old')
    there.mkdir()
    os.mkfifo(pipe)
    for path in (file, pipe, tmp_path / 'new', Path('-'), Path('/dev/null')):
        outputs.check_file(path)
    for path in (there, tmp_path / 'new' / 'newer'):
        outputs.check_directory(path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'pipe', 'there']
    assert file.read_text() == 'old'
    assert list(there.iterdir()) == []


@pytest.mark.parametrize(
    ('place', 'remedy'),
    [
        ('there', 'it is a directory: give the name of a file'),
        ('no/file', 'there is no such file or directory: give a path that exists'),
        ('file/file', 'a part of the path is a file, not a directory: move that file'),
        (256 * 'x', 'the name is too long: give a shorter one'),
    ],
)
def test_places_for_a_file(tmp_path, place, remedy):
    (tmp_path / 'there').mkdir()
    (tmp_path / 'file').write_text('')
    with pytest.raises(OSError) as refused:
        outputs.check_file(tmp_path / place)
    assert outputs.output_fault(refused.value).startswith(
        f'cannot write {tmp_path / place}: {remedy}'
    )


def test_a_whole_file_or_the_old_one(tmp_path):
    with mounted(tmp_path / 'disk', 64) as disk:
        file, link = disk / 'file', disk / 'link'
        link.symlink_to(file)
        outputs.write_text(link, 'old')
        with pytest.raises(OSError) as refused:
            outputs.write_text(link, 100_000 * 'x')
        remedy = f'cannot write {link}: the disk is full: free some space there'
        assert outputs.output_fault(refused.value).startswith(remedy)
        assert file.read_text() == 'old'
        outputs.write_text(link, 'new')
        assert file.read_text() == 'new'
        assert sorted(path.name for path in disk.iterdir()) == ['file', 'link']
        assert link.is_symlink()


def test_a_file_in_memory_is_no_stream():
    """Though it is below /dev: it is written whole."""
    memory = Path('/dev/shm')
    if not memory.is_dir():
        pytest.skip('no /dev/shm here')
    with tempfile.TemporaryDirectory(dir=memory) as place:
        file = Path(place) / 'file'
        file.write_text('old')
        assert not outputs.is_stream(file)
        with pytest.raises(RuntimeError):
            write_a_part(file)
        assert (file.read_text(), len(list(Path(place).iterdir()))) == ('old', 1)
    assert all(map(outputs.is_stream, map(Path, ('/dev/null', '/dev/stdout', '/dev/fd/1'))))


def test_pipes_are_written_to(tmp_path):
    """A file in the place of /dev/null would be a calamity."""
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    writing = threading.Thread(target=outputs.write_text, args=(pipe, 'through'))
    writing.start()
    assert pipe.read_text() == 'through'
    writing.join()
    assert pipe.is_fifo()


def test_a_new_file_has_the_mode_of_the_old_one(tmp_path):
    for mode in (0o664, 0o600):
        for number, name in enumerate(('short.json', f'{247 * "x"}.json')):
            file = tmp_path / name
            outputs.write_text(file, 'old')
            assert file.stat().st_mode & 0o777 == (0o644 if mode == 0o664 else 0o664)
            file.chmod(mode)
            outputs.write_text(file, str(number))
            assert (file.stat().st_mode & 0o777, file.read_text()) == (mode, str(number))
            file.chmod(0o664)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize('command', [write_by_text, write_by_table])
def test_a_file_that_is_mounted_by_itself(tmp_path, command):
    """As Docker mounts one into a container: nothing can take its place."""
    outside, file = tmp_path / 'outside.csv', tmp_path / 'inside.csv'
    outside.write_text('old')
    file.write_text('')
    with bound(outside, file):
        command(file)
    assert outside.read_text() == 'new\n'
    assert sorted(path.name for path in tmp_path.iterdir()) == ['inside.csv', 'outside.csv']


@pytest.mark.parametrize('kilobytes', [16, 20, 64])
def test_a_table_on_a_full_disk_ends_with_a_whole_row(tmp_path, capsys, kilobytes):
    words = ['bench_rig', '--duration', '5', '--quiet', '--states']
    assert simulate_rig([*words, str(tmp_path / 'whole.csv')]) == 0
    with mounted(tmp_path / 'disk', kilobytes) as disk:
        table = disk / 'states.csv'
        assert simulate_rig([*words, str(table)]) == 1
        rows = (disk / 'states.csv.part').read_text()
        assert not table.exists()
    said = capsys.readouterr().err
    assert f'simulate_rig: cannot write {table}: the disk is full: free some' in said
    assert rows.endswith('\n')
    assert (tmp_path / 'whole.csv').read_text().startswith(rows)
    assert len(rows) > 1000 * (kilobytes - 4) - 200


def test_a_table_that_is_there_is_kept_if_the_new_one_cannot_be_written(tmp_path, capsys):
    with mounted(tmp_path / 'disk', 64) as disk:
        table = disk / 'states.csv'
        words = ['bench_rig', '--states', str(table), '--quiet', '--duration']
        assert simulate_rig([*words, '0.2']) == 0
        first = table.read_bytes()
        assert simulate_rig([*words, '100']) == 1
        assert 'the disk is full' in capsys.readouterr().err
        assert table.read_bytes() == first
        assert simulate_rig([*words, '0.1']) == 0
        assert first.startswith(table.read_bytes())
        assert [path.name for path in disk.iterdir()] == ['states.csv']


def test_a_table_that_is_there_is_kept_if_the_run_ends_early(tmp_path, capsys):
    """By more events than allowed; by a signal in test_interruption."""
    table = tmp_path / 'events.csv'
    words = ['paper', '--duration', '1000', '--quiet', '--events', str(table)]
    assert simulate_rig(words) == 0
    first = table.read_bytes()
    assert simulate_rig([*words, '--set', 'gap=1e-4', '--most-events', '50']) == 1
    assert f'the output so far is in {table}.part' in capsys.readouterr().err
    assert table.read_bytes() == first
    part = (tmp_path / 'events.csv.part').read_text().splitlines()
    assert part[0] == first.decode().splitlines()[0]
    assert len(part) > 50


def test_a_present_directory_that_is_gone(tmp_path, monkeypatch, capsys):
    gone = tmp_path / 'gone'
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    for words in (['--bag', 'bag'], ['--impacts', 'impacts.csv', '--law', 'mine:law']):
        assert simulate_rig(['bench_rig', '--duration', '1', '--quiet', *words]) == 1
        said = capsys.readouterr().err
        assert (
            said
            == 'simulate_rig: the current directory no longer exists: change to one that does\n'
        )
