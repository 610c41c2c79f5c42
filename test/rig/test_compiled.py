"""Compiled kernels do the same arithmetic as the plain ones, to the last bit."""

import ast
import errno
import inspect
import random
import textwrap
from math import cos, inf, pi, sin

import numpy as np
import pytest

from impact_damper_ros.rig import Simulator, kernels
from impact_damper_ros.rig.contact import chatter_end, flight_end
from impact_damper_ros.rig.crossing import first_crossing, starting_side
from impact_damper_ros.rig.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
    motion_at,
)
from impact_damper_ros.rig.forcing import sines_and_cosines_of
from impact_damper_ros.rig.kernels import compiling_alone
from impact_damper_ros.rig.mode import CHATTER_1, launch
from impact_damper_ros.rig.transition import resolve
from rig.random_rigs import random_command, random_rig

PLAIN = {
    kernel.__name__: kernel for kernel in (chatter_end, flight_end, launch, motion_at, resolve)
}

# Kernels compile anew for every number of harmonics; this one stands for all.
HARMONICS = 2
DRIVE = {
    'force_amplitudes': [0.4 + 0.3 * k for k in range(HARMONICS)],
    'force_frequencies': [0.7 + 0.6 * k for k in range(HARMONICS)],
    'force_phases': [0.1 * k for k in range(HARMONICS)],
}


@pytest.fixture(scope='module')
def compiled():
    pytest.importorskip('numba')
    names = (*PLAIN, 'first_crossing', 'safe_step', 'starting_side')
    return dict(zip(names, kernels.compiled(*names), strict=True))


def flights(kernel, machine, origin, until, most):
    """Yield origins, flights and motions, the way the simulator goes from one to the next."""
    launch, resolve = kernel['launch'], kernel['resolve']
    while most > 0:
        flight = launch(machine, origin)
        limit = until - origin.time
        if origin.mode >= CHATTER_1:
            end = kernel['chatter_end'](flight, origin.chatter_left)
            tau = end.tau
        else:
            end = kernel['flight_end'](flight, 0.0, limit)
            tau = inf if end.kind == NO_EVENT else end.tau
        motion = kernel['motion_at'](flight, min(tau, limit) / 3)
        yield tuple(origin), tuple(motion), end.kind, tau
        if tau > limit:
            return
        transition = resolve(machine, origin, flight, end)
        yield tuple(transition)
        origin = transition.origin
        most -= 1


def test_bit_for_bit(compiled):
    """Every number of every flight and transition, over random rigs in all modes."""
    modes, steps = set(), 0
    for seed in range(60):
        parameters, initial = random_rig(f'compiled {seed}', **DRIVE)
        rig = Simulator(parameters, initial)
        if seed % 2:
            # Their movements end in contacts and arrivals, and are repeated now and then.
            rig.move_stops(*random_command(random.Random(seed), rig)[:2], 0.3)
        machine, origin = rig._constants, rig._origin
        plain = flights(PLAIN, machine, origin, 60.0, 150)
        fast = flights(compiled, machine, origin, 60.0, 150)
        for a, b in zip(plain, fast, strict=True):
            assert a == b
            steps += 1
            if len(a) == 4:
                modes.add(a[0][2])
    assert steps > 2000
    assert modes >= {0, 1, 2, 3, 4, 5}


def test_moving_stops_bit_for_bit(compiled):
    """Contacts with moving stops and their arrivals, one command after the other."""
    kinds = set()
    for seed in range(150):
        rng = random.Random(seed)
        parameters, initial = random_rig(f'compiled {seed}', **DRIVE)
        rig = Simulator(parameters, initial)
        for _ in range(4):
            rig.move_stops(*random_command(rng, rig)[:2], 10 ** rng.uniform(-1, 1))
            machine, origin = rig._constants, rig._origin
            plain = flights(PLAIN, machine, origin, rig.time + 3.0, 4)
            fast = flights(compiled, machine, origin, rig.time + 3.0, 4)
            for a, b in zip(plain, fast, strict=True):
                assert a == b
                if len(a) == 4:
                    kinds.add((a[2], a[0][2]))
            rig.advance(rig.time + rng.uniform(0.0, 1.0))
    moving = {kind for kind, _ in kinds}
    assert moving >= {NO_EVENT, CONTACT_1, CONTACT_2, STOP_ARRIVED_1, STOP_ARRIVED_2}
    # In joint motion, too
    assert {(CONTACT_1, 3), (CONTACT_2, 3), (STOP_ARRIVED_1, 3), (STOP_ARRIVED_2, 3)} <= kinds


def test_crossings_bit_for_bit(compiled):
    found = 0
    for seed in range(60):
        rig = Simulator(*random_rig(f'compiled {seed}', **DRIVE))
        flight = rig._flight
        node, side = 0.0, starting_side(flight, 0)
        assert compiled['starting_side'](flight, 0) == side
        for _ in range(5):
            plain = first_crossing(flight, side, node, 20.0)
            assert compiled['first_crossing'](flight, side, node, 20.0) == plain
            crossed, _, node = plain
            if not crossed:
                break
            found, side = found + 1, -side
    assert found > 100


def test_two_results_along_tuples_and_arrays(compiled):
    numba = pytest.importorskip('numba')
    along = compiled['launch'].py_func.__globals__['sines_and_cosines_of']
    together = numba.njit(lambda phases, angles: along(phases, angles))
    rng = np.random.default_rng(8)
    for scale in (1e-300, 1e-9, 1.0, 1e3, 1e9, 1e300):
        phases, angles = scale * rng.uniform(-1.0, 1.0, 200), rng.uniform(0.0, 2.0 * pi, 200)
        expected = sines_and_cosines_of(tuple(phases), tuple(angles))
        each = list(angles + phases)
        assert expected == (tuple(map(sin, each)), tuple(map(cos, each)))
        for result in (
            together(phases, angles),
            zip(*(together((p,), (a,)) for p, a in zip(phases, angles, strict=True)), strict=True),
        ):
            for numbers, as_plain in zip(result, expected, strict=True):
                assert tuple(np.ravel(numbers)) == as_plain
    assert sines_and_cosines_of((), ()) == together((), ()) == ((), ())


def test_a_kernel_of_numbers_alone(compiled):
    assert compiled['safe_step'](1.0, -1.0, 0.0, 0.0, 7.0) == pytest.approx(1.0, rel=2e-12)


def test_the_kernels_of_each_form_have_names_of_their_own():
    """Of two functions of one name, compiled by two processes, LLVM runs the first for both."""
    pytest.importorskip('numba')

    def names(form):
        (kernel,) = kernels.compiled('flight_end', form=form)
        held = kernel.py_func.__globals__
        return {held[name].py_func.__qualname__ for name in PLAIN}

    assert len(names('one') | names('other')) == 2 * len(PLAIN)


def test_compiled_code_that_cannot_be_kept_serves_this_process(caplog):
    """As on a full disk: numba saves after it has compiled."""
    with compiling_alone(None, 'any'):
        raise OSError(errno.EFBIG, 'File too large')
    assert 'cannot be kept (File too large)' in caplog.text


def test_names_are_unique():
    with pytest.raises(ValueError, match='two kernels named motion_at'):
        kernels.kernel(motion_at)


@pytest.mark.parametrize('name', sorted(kernels._KERNELS))
def test_kernels_raise_nothing_to_a_power(name):
    """Compiled, that is a product; otherwise it is libm's `pow`, which may differ from it."""
    code = ast.parse(textwrap.dedent(inspect.getsource(kernels._KERNELS[name])))
    assert not [node for node in ast.walk(code) if isinstance(node, ast.Pow)]
