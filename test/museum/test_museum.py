"""What earlier versions have written is read, judged as it was, and written with the same keys."""

import json
import math
import shutil
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros.bag.snapshots import mathematics
from impact_damper_ros.rig.snapshot import ARITHMETIC
from impact_damper_ros.sweep import (
    Grid,
    MetadataError,
    draw_sweep,
    find_optimum,
    read_table,
    summary_of,
    sweep,
)

from . import make

HERE = Path(__file__).parent
VERSIONS = sorted(path for path in HERE.glob('[0-9]*') if path.is_dir())
BAGS = [path for version in VERSIONS for path in sorted(version.glob('bags/*')) if path.is_dir()]
#: Of a run that is not the same to the last bit: how far numbers of it may be off, relatively
CLOSE = 1e-6
#: What replay_run says of each where it was made; of all others, identical
VERDICTS = {'cut': 'partial', **dict.fromkeys(make.ELSEWHERE, 'within_round_off')}
#: What is of another version, machine or folder, and how a solver came to its solution
OWN = ('bag', 'version', 'remarks', 'residual_history')


def same_bits(version):
    """Return whether the museum of a version was made with the arithmetic at hand."""
    made = json.loads((version / 'made_with.json').read_text())
    return made == {'arithmetic': ARITHMETIC, 'mathematics': mathematics()}


def differing(kept, now, place=''):
    """Yield where a document does not say what the kept one says; it may say more."""
    if isinstance(kept, dict):
        if not isinstance(now, dict):
            yield f'{place}: {now!r} is no object'
            return
        for name, value in kept.items():
            if name in OWN:
                continue
            if name not in now:
                yield f'{place}.{name} is gone'
            else:
                yield from differing(value, now[name], f'{place}.{name}')
    elif isinstance(kept, list):
        if not isinstance(now, list) or len(kept) != len(now):
            yield f'{place}: {now!r}, not {kept!r}'
            return
        for number, pair in enumerate(zip(kept, now, strict=True)):
            yield from differing(*pair, f'{place}[{number}]')
    elif isinstance(kept, float) and isinstance(now, float | int):
        if not math.isclose(kept, now, rel_tol=CLOSE, abs_tol=1e-9):
            yield f'{place}: {now!r}, not {kept!r}'
    elif kept != now:
        yield f'{place}: {now!r}, not {kept!r}'


@pytest.mark.parametrize('bag', BAGS, ids=lambda bag: f'{bag.parents[1].name}-{bag.name}')
def test_a_bag_is_judged_as_it_was(bag):
    kept, now = json.loads(bag.with_suffix('.json').read_text()), make.said_of(bag)
    replayed = kept['replay_run']
    assert replayed['verdict'] == VERDICTS.get(bag.name, 'identical')
    assert now['replay_run']['exit_code'] == replayed['exit_code']
    if same_bits(bag.parents[1]):
        assert [*differing(kept, now)] == []
        return
    # Another arithmetic or C library: within round-off, which is no difference
    expected = ('partial',) if bag.name == 'cut' else ('identical', 'within_round_off')
    assert now['replay_run']['verdict'] in expected
    assert now['replay_run']['difference_count'] == 0
    assert [*differing(replayed['compared'], now['replay_run']['compared'])] == []
    said = [
        [stretch['verdict'] for stretch in document['compare_run']['stretches']]
        for document in (kept, now)
    ]
    assert said[0] == said[1]


def test_this_version_has_its_own():
    assert make.PLACE in VERSIONS
    assert impact_damper_ros.__version__.startswith(f'{make.VERSION}.')


def test_no_bag_is_large():
    for bag in BAGS:
        assert sum(path.stat().st_size for path in bag.iterdir()) <= make.LARGEST, bag


def shape(document):
    """Return the keys of a document, in which entries of a list are alike."""
    if isinstance(document, dict):
        return {name: shape(value) for name, value in document.items()}
    return [shape(document[0])] if isinstance(document, list) and document else None


def lost(kept, now, place=''):
    """Yield keys that are gone."""
    if isinstance(kept, dict) and isinstance(now, dict):
        for name in kept:
            if name not in now:
                yield f'{place}.{name}'
            else:
                yield from lost(kept[name], now[name], f'{place}.{name}')
    elif isinstance(kept, list) and isinstance(now, list):
        yield from lost(kept[0], now[0], f'{place}[]')


@pytest.mark.parametrize('version', VERSIONS, ids=lambda version: version.name)
@pytest.mark.parametrize('name', make.OUTPUTS)
def test_commands_write_the_same_keys_and_columns(name, version, tmp_path):
    kept = version / 'outputs' / name
    if not kept.exists():
        pytest.skip(f'{name} is later than {version.name}')
    now = tmp_path / name
    make.write_output(name, now, tmp_path, version / 'bags' / 'free')
    if name.endswith('.json'):
        documents = [shape(json.loads(path.read_text())) for path in (kept, now)]
        assert [*lost(*documents)] == []
        return
    heads = [
        next(line for line in path.read_text().splitlines() if not line.startswith('#'))
        for path in (kept, now)
    ]
    columns = [head.split(',') for head in heads]
    assert columns[1][: len(columns[0])] == columns[0]


@pytest.mark.parametrize('version', VERSIONS, ids=lambda version: version.name)
def test_tables_of_sweeps_are_read_drawn_and_resumed(version, tmp_path):
    pytest.importorskip('pyarrow')

    tables = [read_table(version / 'sweeps' / f'gap.{suffix}') for suffix in ('csv', 'parquet')]
    for table in tables:
        assert list(table.gap) == [0.02, 0.024]
        assert list(table.impacts_per_cycle) == [2.0, 2.0]
        optimum = find_optimum(table, 'x_max')
        assert summary_of(table, optimum)['optimum']['value'] == table.x_max.min()
        picture = tmp_path / 'picture.svg'
        draw_sweep(table, 'x_max', optimum, picture)
        assert picture.stat().st_size > 1000
    half = shutil.copy(version / 'sweeps' / 'half.csv.part', tmp_path)
    inputs = json.loads(Path(half).read_text().partition('\n')[0])
    grid, path = Grid.from_inputs(inputs), tmp_path / 'half.csv'
    if inputs['version'] == impact_damper_ros.__version__:
        assert len(sweep(grid, path)) == 3
        return
    # The rows of two versions make no table.
    with pytest.raises(MetadataError, match=r'version: .* there, .* here'):
        sweep(grid, path)


@pytest.mark.parametrize('version', VERSIONS, ids=lambda version: version.name)
def test_a_fitted_rig_is_simulated_and_its_result_designs_a_damper(version, tmp_path):
    twin, impacts = version / 'twin.yaml', tmp_path / 'impacts.csv'
    code, text = make.command('simulate_rig', twin, '--duration', 2, '--impacts', impacts)
    assert (code, len(impacts.read_text().splitlines()) > 5) == (0, True), text
    fitted = version / 'outputs' / 'fit_rig.json'
    few = '--base', '0.2g', '--mass-ratio', '5%', '--levels', '1:1'
    code, text = make.command('design_damper', '--fitted', fitted, *few)
    assert (code, 'gap' in text) == (0, True), text
