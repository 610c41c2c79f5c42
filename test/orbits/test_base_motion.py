"""Periodic motions of rigs on a moving base: those of the same rig under the equivalent force."""

import pytest
from rigs import TABLE

from impact_damper_ros import OrbitError, Rig, find_orbits, follow, settle
from impact_damper_ros.parameters.base_motion import QUANTITIES

ON_TABLE = TABLE.replace(gap=0.016, base_amplitudes=2.0)


def forced(rig):
    """Return a rig with the force that stands for the motion of its base, and no base."""
    amplitude, frequency, phase = rig.first_harmonic
    return rig.replace(
        base_amplitudes=0.0,
        force_amplitudes=amplitude,
        force_frequencies=frequency,
        force_phases=phase,
    )


def test_motions_are_those_under_the_equivalent_force():
    on_table, under_force = (find_orbits(p, (1, 2)).orbits for p in (ON_TABLE, forced(ON_TABLE)))
    assert len(on_table) == len(under_force) >= 2
    for one, other in zip(on_table, under_force, strict=True):
        assert one.x_max == pytest.approx(other.x_max, rel=1e-12)
        assert one.phases == pytest.approx(other.phases, abs=1e-12)
        assert one.stable == other.stable
    settled = settle(Rig(ON_TABLE))
    stable = [orbit.x_max for orbit in on_table if orbit.stable and orbit.viable]
    assert min(abs(settled.x_max / x - 1.0) for x in stable) < 1e-6


@pytest.mark.parametrize(('order', 'quantity'), [*enumerate(QUANTITIES)])
@pytest.mark.parametrize('name', ['base_amplitudes', 'base_frequencies', 'stiffness', 'damping'])
def test_branches_pass_through_the_motions_of_other_rigs(name, order, quantity):
    """The force on M depends on the frequency of the base and on spring and dashpot."""
    place, (rate,) = ON_TABLE.base_motion.amplitudes[0], ON_TABLE.base_frequencies
    on_table = ON_TABLE.replace(base_quantity=quantity, base_amplitudes=abs(place) * rate**order)
    start = next(o for o in find_orbits(on_table, (1, 2)).orbits if o.stable and o.viable)
    value = getattr(on_table, name)
    value = value[0] if isinstance(value, tuple) else value
    branch = follow(start, name, 0.97 * value, 1.03 * value)
    for share in (0.98, 1.02):
        there = on_table.replace(**{name: share * value})
        expected = {round(o.x_max, 9) for o in find_orbits(forced(there), (1, 2)).orbits}
        found = [orbit.x_max for orbit in branch.at([share * value])[0]]
        assert found
        assert all(min(abs(x - e) for e in expected) < 2e-9 for x in found)


def test_a_force_that_is_off_is_not_followed():
    start = find_orbits(ON_TABLE, (1, 2)).orbits[0]
    with pytest.raises(OrbitError, match='the base shakes the rig: follow base_frequencies'):
        follow(start, 'force_frequencies', 0.5, 2.0)
