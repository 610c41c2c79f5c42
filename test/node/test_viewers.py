"""What viewers show of a running node: the frames in RViz, and the layouts of other programs."""

import json
import math
import re
import subprocess
from itertools import pairwise
from xml.etree import ElementTree

import pytest
from running import SOURCE
from std_msgs.msg import String

from node.rig_client import LATCHED, stamp_ns
from node.test_motion_reports import INCLINED


def vector(text):
    return [float(word) for word in (text or '0 0 0').split()]


def place_of(urdf, state, link):
    """Return where a link is in the frame of the base: what robot_state_publisher makes of it."""
    place = [0.0, 0.0, 0.0]
    positions = dict(zip(state.name, state.position, strict=True))
    while link != 'base_link':
        (joint,) = (j for j in urdf.findall('joint') if j.find('child').get('link') == link)
        # A joint without an origin is in its parent's frame.
        assert joint.find('origin') is None
        axis, value = vector(joint.find('axis').get('xyz')), positions[joint.get('name')]
        if joint.get('type') == 'prismatic':
            place = [p + value * a for p, a in zip(place, axis, strict=True)]
        else:
            assert (joint.get('type'), axis) == ('revolute', [0.0, 1.0, 0.0])
            (x, y, z), sine, cosine = place, math.sin(value), math.cos(value)
            place = [cosine * x + sine * z, y, cosine * z - sine * x]
        link = joint.find('parent').get('link')
    return place


def test_the_frames_follow_a_live_angle(rig):
    """As RViz shows it: the parts go on where they are, and turn with the axis."""
    descriptions = rig.listen(String, 'robot_description', LATCHED)
    states = rig.states

    def turned(*angles):
        """Return the joint states just before and after a turn, if none between were lost."""
        for angle in angles:
            rig.change(angle=angle)
            rig.until(lambda a=angle: states[-1].position[4] == a)
        at = max(i for i, s in enumerate(list(states)) if s.position[4] != angle)
        last, state = states[at : at + 2]
        apart = stamp_ns(state.header.stamp) - stamp_ns(last.header.stamp)
        return (last, state) if apart == 5_000_000 else None

    for before, angle in pairwise((0.0, 0.3, -1.0, 1.5708)):
        last, state = rig.until(lambda angles=(before, angle): turned(*angles))
        assert (state.name[4], state.position[4], state.velocity[4]) == ('incline', angle, 0.0)
        # In a sample of 5 ms nothing goes far along the axis, however far that turns.
        speed = max(map(abs, [*state.velocity, *last.velocity])) + 9.81 * 0.005
        for name in ('primary', 'damper'):
            index = state.name.index(name)
            assert abs(state.position[index] - last.position[index]) < 0.01 * speed
        urdf = ElementTree.fromstring(rig.until(lambda: descriptions)[-1].data)
        for name in ('primary', 'damper', 'stop_1', 'stop_2'):
            along = state.position[state.name.index(name)]
            there = [along * math.cos(angle), 0.0, -along * math.sin(angle)]
            assert place_of(urdf, state, name) == pytest.approx(there, abs=1e-12)
    # Also those of a paused rig
    rig.pause()
    rig.change(angle=0.4)
    rig.until(lambda: states[-1].position[4] == 0.4)
    assert rig.stands_still


# Layouts


@pytest.fixture
def heard(start):
    """Return a node with a gap control, and all that it publishes by topic."""
    values = {**INCLINED, 'real_time_factor': 100.0, 'gap_control': 'amplitude'}
    rig = start(**values, predict_motion=True)
    topics = {'joint_states': rig.states, 'impacts': rig.impacts, 'gap_control': rig.acts}
    topics['robot_description'] = rig.listen(String, 'robot_description', LATCHED)
    rig.until(lambda: all(topics.values()))
    # A motion is measured and predicted where the stops do not move.
    rig.change(gap_control='off')

    def known(task):
        values = rig.report(f'{task} motion').values
        return values.get('Largest X / A') or values.get('Agreement')

    # A report on the motion alone may come before the first whole one.
    rig.until(lambda: known('measured') and known('predicted') and rig.reports('pacing'))
    return rig, {f'{rig.space}/{name}': messages for name, messages in topics.items()}


def value_of(topics, path):
    """Return what a message path of Lichtblick names."""
    topic, _, fields = path.partition('.')
    value = topics[topic][-1]
    for field in fields.split('.'):
        name, index = re.fullmatch(r'(\w+)(?:\[(\d+)\])?', field).groups()
        value = getattr(value, name)
        value = value if index is None else value[int(index)]
    return value


def in_namespace(name, namespace, directory):
    """Return a layout after what the docs say for a rig in a namespace."""
    document = (SOURCE / 'docs' / 'node' / 'viewers.md').read_text(encoding='utf-8')
    (command,) = re.findall(r'^sed -E .*$', document, re.MULTILINE)
    assert 'rig1' in command
    expression = re.search(r"'(.*)'", command)[1].replace('rig1', namespace[1:])
    (directory / name).write_bytes((SOURCE / 'layouts' / name).read_bytes())
    words = ['sed', '-E', expression, str(directory / name)]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


def panels_of(part):
    """Return the panels of a mosaic, from the left and from above."""
    return (
        [part]
        if isinstance(part, str)
        else [*panels_of(part['first']), *panels_of(part['second'])]
    )


def test_all_that_the_layouts_show_is_there(heard, tmp_path):
    rig, topics = heard
    node = rig.name[1:]
    layout = json.loads(in_namespace('lichtblick.json', rig.space, tmp_path))
    panels = layout['configById']
    assert sorted(panels_of(layout['layout'])) == sorted(panels)
    # Without these an import is refused; each program reads the title by its own key.
    assert layout['playbackConfig'] == {'speed': 1}
    assert layout['globalVariables'] == layout['userNodes'] == {}
    for panel in panels.values():
        assert panel.get('lichtblickPanelTitle') == panel.get('foxglovePanelTitle')
    paths = [path for panel in panels.values() for path in panel.get('paths', [])]
    assert len(paths) > 10
    for path in paths:
        assert isinstance(value_of(topics, path['value']), (float, str)), path
        assert path['timestampMethod'] == 'headerStamp'
        # An index stands for the joint that the label names.
        if match := re.fullmatch(r'(.*/joint_states)\.\w+\[(\d)\]', path['value']):
            name = topics[match[1]][-1].name[int(match[2])]
            assert path['label'].replace(' ', '_') == name
    across = [panel['xAxisPath']['value'] for panel in panels.values() if 'xAxisPath' in panel]
    assert all(isinstance(value_of(topics, path), (float, str)) for path in across)
    shown = [
        (p['selectedHardwareId'], p['selectedName'])
        for p in panels.values()
        if 'selectedName' in p
    ]
    assert len(shown) == 2
    tasks = {task for report in rig.reports() for task in report}
    assert set(shown) <= {(node, f'{node}: {task}') for task in tasks}
    assert panels['DiagnosticSummary!all']['hardwareIdFilter'] == node
    rendered = {p['topicToRender'] for p in panels.values() if 'topicToRender' in p}
    assert rendered == {'/diagnostics'}
    description = f'{rig.space}/robot_description'
    assert set(panels['3D!rig']['topics']) == {description}
    links = ElementTree.fromstring(topics[description][-1].data).findall('link')
    assert panels['3D!rig']['followTf'] in [link.get('name') for link in links]
