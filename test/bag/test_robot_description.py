"""The picture of a rig: each link where it is, and as large as its proportions say."""

import math
from xml.etree import ElementTree

import pytest
from rigs import BENCH

from impact_damper_ros.bag.robot_description import picture_size, robot_description


def boxes_of(rig, gap_max=0.0):
    """Return place along the axis, height and sides of the boxes of each link, by its name."""
    found = {}
    for link in ElementTree.fromstring(robot_description(rig, gap_max)).iter('link'):
        for visual in link.iter('visual'):
            x, y, z = map(float, visual.find('origin').get('xyz').split())
            assert y == 0.0
            sides = tuple(map(float, visual.find('geometry/box').get('size').split()))
            found[link.get('name')] = x, z, *sides
    return found


def test_the_links_are_in_proportion():
    """The damper is as long as the gap; a stop touches it where its joint is at the damper's."""
    rig = BENCH.replace(angle=0.3)
    d, size = rig.gap, picture_size(rig)
    swing = rig.response_amplitude
    assert 0.25 * swing < d
    rest = rig.primary_mass * rig.gravity * math.sin(0.3) / rig.stiffness
    assert size == pytest.approx((d, 2.0 * d, 2.0 * d + swing, rest), rel=1e-6)
    boxes = boxes_of(rig)
    assert boxes == {
        'axis': pytest.approx((rest / 2, -1.25 * d, 2.0 * size.rail + rest, 1.6 * d, 0.2 * d)),
        'base': pytest.approx((0.0, -d, 0.05 * d, 1.6 * d, 0.35 * d)),
        'primary': pytest.approx((0.0, -0.575 * d, 4.0 * d, 1.2 * d, 0.15 * d)),
        'damper': pytest.approx((0.0, 0.0, d, 0.8 * d, d)),
        'stop_1': pytest.approx((0.7 * d, 0.0, 0.4 * d, 1.2 * d, d)),
        'stop_2': pytest.approx((-0.7 * d, 0.0, 0.4 * d, 1.2 * d, d)),
    }
    assert boxes_of(rig.replace(one_sided=True)).keys() == boxes.keys() - {'stop_2'}
    joints = {
        j.get('name'): j for j in ElementTree.fromstring(robot_description(rig)).iter('joint')
    }
    for name in ('base', 'primary', 'damper', 'stop_1', 'stop_2'):
        limit = joints[name].find('limit')
        ends = float(limit.get('lower')), float(limit.get('upper'))
        assert ends == pytest.approx((-1000.0 * d - rest, 1000.0 * d + rest))


@pytest.mark.parametrize(
    ('gap', 'gap_max', 'damper', 'deck'),
    [(0.1, 0.0, 0.1, 0.2), (0.1, 0.5, 0.1, 0.35), (0.1, 5.0, 0.1, 0.5), (1e-6, 0.0, None, None)],
)
def test_a_narrow_gap_and_a_wide_control(gap, gap_max, damper, deck):
    """The damper has a quarter of the swing at least, the deck room for eight gaps at most."""
    rig = BENCH.replace(gap=gap)
    size = picture_size(rig, gap_max)
    if damper is None:
        damper = 0.25 * rig.response_amplitude
        deck = 2.0 * damper
    assert size.damper == pytest.approx(damper, rel=1e-6)
    assert size.deck == pytest.approx(deck, rel=1e-6)
