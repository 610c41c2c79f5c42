"""Tables of measured data: what is read alike, and what is refused with column and line."""

import math
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import impact_damper_ros
from impact_damper_ros.measured.formats import read_sheet
from impact_damper_ros.measured.sheet import (
    ACCELERATION,
    DISPLACEMENT,
    FORCE,
    TIME,
    TableError,
    choose,
)
from impact_damper_ros.measured.table import check_whole, chosen_columns, read_measured_table


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
        # Of two clocks the one before the motion
        't [s],y [V],t [s],x [mm],force [N]\n9,0,0,1.5,2\n8,0,0.1,-2.5,3\n',
    ],
)
def test_the_same_numbers(written, text):
    table = read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT}, {'force': FORCE})
    assert table.columns['time'].values == pytest.approx([0.0, 0.1])
    assert table.columns['x'].values == pytest.approx([0.0015, -0.0025])
    assert table.columns['force'].values == pytest.approx([2.0, 3.0])
    assert table.columns['force'].unit == 'N'


def test_other_encodings_and_units(written):
    text = 'Zeit [s];Beschleunigung [g];Größe\n0;1;x\n1;-0,5;y\n'
    for encoding in ('utf-8-sig', 'latin-1'):
        table = read_measured_table(written(text, encoding), {'time': TIME, 'a': ACCELERATION})
        assert table.columns['a'].values == pytest.approx([9.80665, -4.903325])
    with pytest.raises(
        TableError, match=r"no column for the x among 'Zeit \[s\]'.* x|displacement"
    ):
        read_measured_table(written(text), {'x': DISPLACEMENT})


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', 'empty; give a header'),
        ('0,1\n1,2\n', 'line 1: numbers where the header should be'),
        ('0 1\n1 2\n', 'line 1: numbers where the header should be'),
        ('t [s],x\n0,1\n1,2\n', "column 'x' has no unit: write it behind the name"),
        ('t [s],x [V]\n0,1\n1,2\n', "column 'x [V]' has the unit 'V': .*known for x are m, cm"),
        (
            't [s],x [mm]\n2026-11-26T14:00:00.000,1\nlater,2\n',
            "line 3, column 't [s]': 'later' is no date and time of day",
        ),
        ('t [s],x [mm]\n2026-13-26 14:00:00,1\n2026-13-26 14:00:01,2\n', "00' is no date"),
        ('t [s],x [mm]\n0,1\n1,oops\n', "line 3, column 'x [mm]': 'oops' is no number"),
        ('t [s],x [mm]\n0,1\n', '1 rows: give at least 2'),
        ('t [s],x [mm],x 2 [mm]\n0,1,2\n1,2,3\n', "'x 2 [mm]' may each be the x: name one"),
        (
            't [s],x [mm],x [mm]\n0,1,2\n1,2,3\n',
            r"x [mm]' \(column 2\) and 'x [mm]' \(column 3\) .*: give the number of one",
        ),
        ('t [s],y [V]\n0,1\n1,2\n', 'no column for the x'),
    ],
)
def test_refusals(written, text, problem):
    import re

    pattern = problem.replace('[', r'\[').replace(']', r'\]')
    with pytest.raises(TableError) as error:
        read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT})
    assert re.search(pattern, str(error.value))


@pytest.mark.parametrize(
    ('text', 'encoding'),
    [
        ('sep=;\nt [s];x [mm]\n0;1,5\n0,1;-2,25\n', 'utf-8-sig'),
        ('t [s]\tx [mm]\n0\t1,5\n0,1\t-2,25\n', 'utf-16'),
        ('Zeit [s];Weg [µm]\n0;1500,0\n0,1;-2250,0\n', 'cp1252'),
        ('Run 3\nRate,200\n\nt [s],x [μm]\n0,"1500.0"\n0.1,"-2250.0"\n', 'utf-8'),
        ('Messung 3; Labor\nt;x\ns;mm\n0;1,5\n0,1;-2,25\n', 'utf-8'),
        ('t / s,x / µm\n0,1500\n0.1,-2250\n', 'utf-8'),
        ('t in s,x_mm\n0,1.5\n0.1,−2.25\n', 'utf-8'),
        ('time[s]  x[mm]\n 0    1.5\n 0.1 -2.25\n', 'utf-8'),
        ('t [s],x [mm]\n"0","1,5"\n"0,1","-2,25"\n', 'utf-8'),
        (',t [s],x [mm]\n0,0,1.5\n1,0.1,-2.25\n', 'utf-8'),
        ('t [s],x [mm]\nLaser 1,Laser 2\n0,1.5\n0.1,-2.25\n', 'utf-8'),
        ('t [s],x [mm]\ns,Laser 2\n0,1.5\n0.1,-2.25\n', 'utf-8'),
        ('t [s];x [mm]\nLaser 1;Laser 2\n0;1,5;\n0,1;-2,25;\n', 'utf-8'),
        ('[s] t,[mm] x\n0,1.5\n0.1,-2.25\n', 'utf-8'),
        ('t [s];x [mm];note\n0;1.5;"a"\n0.1;-2.250;"b"\n', 'utf-8'),
        ('t [ms],x [in]\n0,0.0590551181\n100,-0.0885826772\n', 'utf-8'),
    ],
)
def test_what_spreadsheets_and_programs_export(written, text, encoding):
    table = read_measured_table(written(text, encoding), {'time': TIME, 'x': DISPLACEMENT})
    assert table.columns['time'].values == pytest.approx([0.0, 0.1])
    assert table.columns['x'].values == pytest.approx([1.5e-3, -2.25e-3])


def test_cells_without_a_number_are_missing(written):
    text = 't [s],x [mm]\n0,1\n1,-\n2,#N/A\n3,nan\n4,\n5,6\n'
    values = (
        read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT}).columns['x'].values
    )
    assert np.isnan(values).tolist() == [False, *[True] * 4, False]


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('t [s],x [mm]\n0,005,1,5\n0,010,2,5\n', r'line 2: 4 cells below a header of 2: sep'),
        ('t [s],x [µm]\n0,998\n1,"1,016"\n', r"'1,016' may be 1\.016 or 1016: write it without"),
        ('t [s];x [µm]\n0;998\n1;1.016\n', r"line 3, .*'1\.016' may be 1\.016 or 1016"),
        ('t [s],x [µm]\n0,998.5\n1,"1,016"\n', r"'1,016' may be 1\.016 or 1016"),
        ('\x89PNG\0\1', 'no text: export the data as CSV'),
        ('t [s];x [µm]\n0;1.500,0\n1;2\n', r"line 2, .*'1\.500,0' has a separator of thousands"),
        ('t [s],x [µm]\n0,"1,500.0"\n1,2\n', r"'1,500\.0' has a separator of thousands"),
        ("t [s],x [µm]\n0,1'500\n1,2\n", r"1'500.* is no number"),
        ('t [s],x [mm]\n0,abc\n1,2\n', "line 2, column .*'abc' is no number"),
    ],
)
def test_numbers_that_may_be_read_in_two_ways(written, text, problem):
    with pytest.raises(TableError, match=problem):
        read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT})


def test_a_number_beside_one_that_has_other_digits_is_clear(written):
    text = 't [s];x [µm]\n0;998\n1;1.5\n2;1.016\n'
    table = read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT})
    assert table.columns['x'].values == pytest.approx([998e-6, 1.5e-6, 1.016e-6])
    # Both ends count
    assert table.between(1.0, 2.0).columns['time'].values.tolist() == [1.0, 2.0]


def test_gaps_and_times_that_do_not_rise(written):
    def of(times, values='1,2,3,4,5'):
        rows = zip(times.split(','), values.split(','), strict=True)
        text = 't [s],x [mm]\n' + '\n'.join(map(','.join, rows))
        return read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT})

    check_whole(*of('0,0.1,0.2,0.3,0.4').on_a_clock())
    for times, problem in (
        ('0,0.1,0.1,0.3,0.4', r"line 4, column 't \[s\]': 0.1 after 0.1: the column must rise"),
        ('0,0.1,0.05,0.3,0.4', 'line 4.*0.05 after 0.1'),
        ('0,0.1,nan,0.3,0.4', 'line 4.*no number: fill the gap'),
        ('0,0.1,0.2,0.5,0.6', 'line 5.*a step of 0.3 s where the others are 0.1 s'),
    ):
        with pytest.raises(TableError, match=problem):
            check_whole(*of(times).on_a_clock())
    with pytest.raises(TableError, match=r"line 3, column 'x \[mm\]': no number"):
        of('0,0.1,0.2,0.3,0.4', '1,,3,4,5').check_finite('x')


def test_a_large_file_is_read(written):
    times = np.arange(60_000) / 1000.0
    rows = '\n'.join(f'{t:.3f},{math.sin(t):.6f}' for t in times)
    table = read_measured_table(
        written(f't [s],x [mm]\n{rows}'), {'time': TIME, 'x': DISPLACEMENT}
    )
    check_whole(*table.on_a_clock())
    assert table.columns['x'].values == pytest.approx(1e-3 * np.sin(times), abs=1e-9)


def test_the_export_of_a_phone(tmp_path):
    """phyphox: each axis has a column, and the .zip a folder with facts of the phone."""
    axes = (f'"Linear Acceleration {axis} (m/s^2)"' for axis in 'xyz')
    header = ','.join(['"Time (s)"', *axes, '"Absolute acceleration (m/s^2)"'])
    text = f'{header}\n0.000000000E0,1.5E-1,2E-1,3E-1,4E-1\n1.0E-2,-1.5E-1,0,0,0.1\n'
    path = tmp_path / 'run.zip'
    with zipfile.ZipFile(path, 'w') as archive:
        archive.writestr('Raw Data.csv', text)
        archive.writestr('meta/time.csv', '"event","experiment time"\n"START",0\n')
        archive.writestr('meta/device.csv', '"property","value"\n"version","1.1.16"\n')
    with pytest.raises(TableError, match=r"Acceleration x \(m/s\^2\)' and .* may each be the a"):
        read_measured_table(path, {'time': TIME, 'a': ACCELERATION})
    sheet = read_sheet(path)
    for name in ('linear acceleration x', 'Linear Acceleration x (m/s^2)', '2'):
        choice = choose(sheet, 'a', ACCELERATION, column=name)
        values = chosen_columns(sheet, {'a': choice}).columns['a'].values
        assert values == pytest.approx([0.15, -0.15])
    with pytest.raises(TableError, match="no column 'force' for the a among 'Time"):
        choose(sheet, 'a', ACCELERATION, column='force')
    (tmp_path / 'bad.zip').write_text(text)
    with pytest.raises(TableError, match=r'no \.zip file'):
        read_measured_table(tmp_path / 'bad.zip', {'a': ACCELERATION})


def test_units_in_a_row_below_the_names(written):
    table = read_measured_table(
        written('time;x;F\ns;mm;N\n0;1,5;2\n0,1;-2,5;3\n'),
        {'time': TIME, 'x': DISPLACEMENT},
        {'force': FORCE},
    )
    assert table.columns['x'].values == pytest.approx([0.0015, -0.0025])
    assert table.columns['force'].values == pytest.approx([2.0, 3.0])
    assert table.lines.tolist() == [3, 4]


def test_a_short_name_with_the_unit_of_something_else_is_another_column(written):
    text = 't [s],f [Hz],x [mm]\n0,5,1\n1,6,2\n'
    table = read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT}, {'force': FORCE})
    assert sorted(table.columns) == ['time', 'x']
    volts = read_sheet(written('t [s],force [V]\n0,1\n1,2\n'))
    with pytest.raises(TableError, match=r"column 'force \[V\]' has the unit 'V'"):
        choose(volts, 'force', FORCE, needed=False)
    assert choose(volts, 'force', FORCE, needed=False, strict=False) is None
    none = read_sheet(written('t [s],force\n0,1\n1,2\n'))
    assert choose(none, 'force', FORCE, needed=False) is None


LABVIEW = """\
LabVIEW Measurement
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t{point}
Multi_Headings\tNo
X_Columns\t{columns}
Time_Pref\tRelative
***End_of_Header***
\t
Channels\t2\t
Samples\t3\t3\t
Y_Unit_Label\tmm\tN\t
X_Dimension\tTime\tTime\t
X0\t0{point}0E+0\t0{point}0E+0\t
Delta_X\t0{point}1\t0{point}1\t
***End_of_Header***\t\t
X_Value\tDisplacement\tForce\tComment
"""


@pytest.mark.parametrize(('columns', 'point'), [('One', '.'), ('One', ','), ('No', '.')])
def test_labview_files(tmp_path, columns, point):
    rows = [(0.0, 1.5, 2.0), (0.1, -2.5, 3.0), (0.2, 0.5, 1.0)]
    text = LABVIEW.format(point=point, columns=columns)
    for time, *values in rows:
        cells = ['' if columns == 'No' else f'{time}', *map(str, values)]
        text += '\t'.join(cells).replace('.', point) + '\t\n'
    path = tmp_path / 'run.lvm'
    path.write_text(text)
    table = read_measured_table(path, {'time': TIME, 'x': DISPLACEMENT}, {'force': FORCE})
    assert table.columns['time'].values == pytest.approx([0.0, 0.1, 0.2])
    assert table.columns['x'].values == pytest.approx([0.0015, -0.0025, 0.0005])
    assert table.columns['force'].values == pytest.approx([2.0, 3.0, 1.0])
    assert list(tmp_path.iterdir()) == [path]
    path.write_text('LabVIEW Measurement\n')
    with pytest.raises(TableError, match='no LabVIEW file'):
        read_measured_table(path, {'time': TIME})


def test_a_library_that_is_not_installed(tmp_path):
    name, library = 'run.uff', 'pyuff'
    (tmp_path / name).write_text('text\n')
    blocked = f'import sys; sys.modules[{library!r}] = None\n'
    program = (
        'from pathlib import Path\n'
        'from impact_damper_ros.measured.sheet import TIME\n'
        'from impact_damper_ros.measured.table import read_measured_table\n'
        f'read_measured_table(Path({name!r}), {{"time": TIME}})'
    )
    done = subprocess.run(
        [sys.executable, '-c', blocked + program],
        cwd=tmp_path,
        env={**os.environ, 'PYTHONPATH': str(Path(impact_damper_ros.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert f'pip install {library}, or the package with its extra [uff]' in done.stderr


def test_a_time_of_day_may_be_missing(written):
    rows = ''.join(f'10:00:{k // 10:02d}.{k % 10},{k}\n' for k in range(100))
    text = 'time,x [mm]\n' + rows.replace('10:00:03.0,', ',')
    values = (
        read_measured_table(written(text), {'time': TIME, 'x': DISPLACEMENT})
        .columns['time']
        .values
    )
    assert np.flatnonzero(np.isnan(values)).tolist() == [30]
    assert values[-1] - values[0] == pytest.approx(9.9)
