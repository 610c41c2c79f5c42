"""What a session of Python shows of results: a line, not all that they hold."""

import pickle
import re

import numpy as np
import pytest

from impact_damper_ros import (
    GapControlParameters,
    Rig,
    RigParameters,
    find_orbits,
    follow,
    ring_down,
    run_ensemble,
    run_flights,
    settle,
)
from impact_damper_ros.sweep import Grid

PAPER = RigParameters(gravity=0.0)


@pytest.fixture(scope='module')
def search():
    return find_orbits(PAPER, (1, 2))


@pytest.fixture(scope='module')
def branch(search):
    return follow(search.orbits[0], 'gap', '30 m', '6000 cm')


def test_results_are_lines(search, branch):
    settled = settle(Rig(PAPER))
    ensemble = run_ensemble(PAPER, {'gap': [10.0, 20.0]}, 20.0, [1.0, 2.0])
    shown = {
        repr(Rig(PAPER)): '<Rig at 0 s: X = 0 m',
        repr(settled): '<SettledMotion: periodic, 2 impacts in 1 cycle after',
        repr(settled.period): '<Period: 1 cycles',
        repr(search.orbits[0]): '<PeriodicOrbit: stops 1,2 in 1 cycle, stable, viable; largest',
        repr(branch): '<Branch: ',
        repr(branch.best()): 'BranchPoint(value=58.1',
        repr(run_flights(Rig(PAPER), 50.0)): '<Flights: ',
        repr(Rig(PAPER).run(50.0, np.linspace(0.0, 50.0, 1000))): '<RunResult: complete at 50 s',
        repr(ring_down(PAPER, 20.0, releases=1)): '<RingDown: ',
        repr(Grid(PAPER, gap=np.linspace(10.0, 50.0, 400))): '<Grid: 400 rigs; gap 10 to 50',
        repr(ensemble): '<EnsembleResult: 2 rigs, 2 complete, 2 samples each>',
        repr(PAPER): 'RigParameters(gravity=0.0)',
    }
    for text, begins in shown.items():
        assert text.startswith(begins)
        assert len(text) < 300
        assert '\n' not in text


def test_parameters_are_shown_as_they_are_given():
    rig = RigParameters(
        gap=12.0,
        force_amplitudes=(1.0, 2.0),
        force_frequencies=(1.0, 2.0),
        force_phases=(0.0, 0.1),
        one_sided=True,
    )
    assert eval(repr(rig)) == rig
    assert pickle.loads(pickle.dumps(rig)) == rig
    assert repr(RigParameters()) == 'RigParameters()'


def test_values_with_units(search, branch):
    assert branch.values[0] == pytest.approx(30.0)
    assert branch.values[-1] == pytest.approx(60.0)
    ((one,),), ((other,),) = branch.at(['40 m']), branch.at([40.0])
    assert one.x_max == other.x_max
    assert Grid(PAPER, gap=['5 mm', '1 cm']).axes[0].values == (0.005, 0.01)
    turned = follow(search.orbits[0], 'force_frequencies', '0.157 Hz', 1.05)
    assert turned.values[0] == pytest.approx(0.157 * 2.0 * np.pi)


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        (lambda _: RigParameters(gapp=1), 'gapp is not a parameter of the rig: did you mean gap?'),
        (lambda _: RigParameters(natural_frequency=3.0), 'RigParameters.of_structure'),
        (lambda _: PAPER.replace(gaap=1), 'did you mean gap?'),
        (lambda _: GapControlParameters(gap_contol='off'), 'did you mean gap_control?'),
        (lambda branch: branch.best('xmax'), "measure is 'xmax': did you mean x_max?"),
        (lambda branch: branch.best('parameters'), 'give one of x_max, x_max_ratio'),
        (lambda branch: follow(branch.orbits[0], 'gaap', 1, 2), 'did you mean gap?'),
        (lambda branch: follow(branch.orbits[0], 'gap', '1 kg', 2), "'kg' is no unit of it"),
        (lambda branch: follow(branch.orbits[0], 3, 1, 2), 'give a name, or a function'),
        (lambda branch: branch.at(['4 kg']), "'kg' is no unit of it"),
        (lambda _: Grid(PAPER, gap=['5 kg']), "'kg' is no unit of it"),
    ],
)
def test_wrong_names_and_units(wrong, words, branch):
    with pytest.raises(ValueError, match=re.escape(words)):
        wrong(branch)
