"""Tables of measured data: what is read alike, and what is refused with column and line."""

import math

import numpy as np
import pytest

from impact_damper_ros.parameters.measured_table import (
    ACCELERATION,
    DISPLACEMENT,
    FORCE,
    TIME,
    TableError,
    read_table,
    sampling_rate,
)


@pytest.fixture
def written(tmp_path):
    def write(text, encoding='utf-8'):
        path = tmp_path / 'run.csv'
        path.write_text(text, encoding=encoding)
        return path

    return write


@pytest.mark.parametrize(
    'text',
    [
        't [s],x [mm],force [N]\n0,1.5,2\n0.1,-2.5,3\n',
        't [ms];x [m];force [kN]\n0;0,0015;0,002\n100;-0,0025;0,003\n',
        '# made\n\n"Time (s)"\t"Position (mm)"\t"Force 1 (N)"\n0\t1.5\t2\n0.1\t-2.5\t3\n',
        'Kraft [N],zeit [s],Weg [cm],note\n2,0,0.15,a\n\n3,0.1,-0.25,b\n',
    ],
)
def test_the_same_numbers(written, text):
    table = read_table(written(text), {'time': TIME, 'x': DISPLACEMENT}, {'force': FORCE})
    assert table.columns['time'].values == pytest.approx([0.0, 0.1])
    assert table.columns['x'].values == pytest.approx([0.0015, -0.0025])
    assert table.columns['force'].values == pytest.approx([2.0, 3.0])
    assert table.columns['force'].unit == 'N'


def test_other_encodings_and_units(written):
    text = 'Zeit [s];Beschleunigung [g];Größe\n0;1;x\n1;-0,5;y\n'
    for encoding in ('utf-8-sig', 'latin-1'):
        table = read_table(written(text, encoding), {'time': TIME, 'a': ACCELERATION})
        assert table.columns['a'].values == pytest.approx([9.80665, -4.903325])
    with pytest.raises(
        TableError, match=r"no column for the x among 'Zeit \[s\]'.* x|displacement"
    ):
        read_table(written(text), {'x': DISPLACEMENT})


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', 'empty; give a header'),
        ('0,1\n1,2\n', 'line 1: numbers where the header should be'),
        ('t [s],x\n0,1\n1,2\n', "column 'x' has no unit: write it behind the name"),
        ('t [s],x [V]\n0,1\n1,2\n', "column 'x [V]' has the unit 'V': .*known for x are m, cm"),
        ('t [s],x [mm]\n0,1\n1,oops\n', "line 3, column 'x [mm]': 'oops' is no number"),
        ('t [s],x [mm]\n0,1\n', '1 rows: give at least 2'),
        ('t [s],x [mm],x 2 [mm]\n0,1,2\n1,2,3\n', 'may both be the x'),
        ('t [s],y [mm]\n0,1\n1,2\n', 'no column for the x'),
    ],
)
def test_refusals(written, text, problem):
    import re

    pattern = problem.replace('[', r'\[').replace(']', r'\]')
    with pytest.raises(TableError) as error:
        read_table(written(text), {'time': TIME, 'x': DISPLACEMENT})
    assert re.search(pattern, str(error.value))


def test_gaps_and_times_that_do_not_rise(written):
    def of(times, values='1,2,3,4,5'):
        rows = zip(times.split(','), values.split(','), strict=True)
        text = 't [s],x [mm]\n' + '\n'.join(map(','.join, rows))
        return read_table(written(text), {'time': TIME, 'x': DISPLACEMENT})

    assert sampling_rate(of('0,0.1,0.2,0.3,0.4')) == pytest.approx(10.0)
    for times, problem in (
        ('0,0.1,0.1,0.3,0.4', r"line 4, column 't \[s\]': 0.1 after 0.1: the column must rise"),
        ('0,0.1,0.05,0.3,0.4', 'line 4.*0.05 after 0.1'),
        ('0,0.1,nan,0.3,0.4', 'line 4.*no number: fill the gap'),
        ('0,0.1,0.2,0.5,0.6', 'line 5.*a step of 0.3 s where the others are 0.1 s'),
    ):
        with pytest.raises(TableError, match=problem):
            sampling_rate(of(times))
    with pytest.raises(TableError, match=r"line 3, column 'x \[mm\]': no number"):
        of('0,0.1,0.2,0.3,0.4', '1,,3,4,5').check_finite('x')


def test_a_large_file_is_read(written):
    times = np.arange(60_000) / 1000.0
    rows = '\n'.join(f'{t:.3f},{math.sin(t):.6f}' for t in times)
    table = read_table(written(f't [s],x [mm]\n{rows}'), {'time': TIME, 'x': DISPLACEMENT})
    assert sampling_rate(table) == pytest.approx(1000.0)
    assert table.columns['x'].values == pytest.approx(1e-3 * np.sin(times), abs=1e-9)
