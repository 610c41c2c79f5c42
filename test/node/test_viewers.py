"""What viewers show of a running node: the frames in RViz, and the layouts of other programs."""

import json
import math
import re
import subprocess
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from running import SOURCE, until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool

from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from node.rig_client import LATCHED, LIVELY, RigParametersClient, stamp_ns

TYPES = {'joint_states': JointState, 'impacts': JointState, 'gap_control': JointState}


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
    descriptions = rig.client.listen(String, 'robot_description', LATCHED)

    def turned(*angles):
        """Return the joint states just before and after a turn, if none between were lost."""
        for angle in angles:
            assert rig.parameters.set(angle=angle) == ''
            until(lambda a=angle: rig.states[-1].position[4] == a)
        states = list(rig.states)
        at = max(i for i, s in enumerate(states) if s.position[4] != angle)
        last, state = states[at : at + 2]
        apart = stamp_ns(state.header.stamp) - stamp_ns(last.header.stamp)
        return (last, state) if apart == 5_000_000 else None

    for before, angle in pairwise((0.0, 0.3, -1.0, 1.5708)):
        last, state = until(lambda angles=(before, angle): turned(*angles))
        assert state.name[4] == 'incline'
        assert state.position[4] == angle
        assert state.velocity[4] == 0.0
        # In a sample of 5 ms nothing goes far along the axis, however far that turns.
        speed = max(map(abs, [*state.velocity, *last.velocity])) + 9.81 * 0.005
        for name in ('primary', 'damper'):
            index = state.name.index(name)
            assert abs(state.position[index] - last.position[index]) < 0.01 * speed
        urdf = ElementTree.fromstring(until(lambda: descriptions)[-1].data)
        for name in ('primary', 'damper', 'stop_1', 'stop_2'):
            along = state.position[state.name.index(name)]
            there = [along * math.cos(angle), 0.0, -along * math.sin(angle)]
            assert place_of(urdf, state, name) == pytest.approx(there, abs=1e-12)


def test_the_frames_of_a_paused_rig_follow_the_angle_too(rig):
    try:
        assert rig.client.call(SetBool, '/sim_node/pause', SetBool.Request(data=True)).success
        assert rig.parameters.set(angle=0.4) == ''
        until(lambda: rig.states[-1].position[4] == 0.4)
        assert rig.states[-1].header.frame_id == PAUSED_FRAME
    finally:
        assert rig.client.call(SetBool, '/sim_node/pause', SetBool.Request(data=False)).success


# Layouts


class Heard:
    """Messages of a node in a namespace, by the full names of their topics."""

    def __init__(self, client, namespace):
        self.topics = {
            f'{namespace}/{name}': client.listen(kind, f'{namespace}/{name}')
            for name, kind in TYPES.items()
        }
        self.topics['/diagnostics'] = client.listen(DiagnosticArray, '/diagnostics')
        self.topics[f'{namespace}/robot_description'] = client.listen(
            String, f'{namespace}/robot_description', LATCHED
        )
        self.statuses = {}

    def look(self):
        """Keep the reports; return whether all topics have come."""
        for report in list(self.topics['/diagnostics']):
            self.statuses |= {(s.hardware_id, s.name): s for s in report.status}
        return all(self.topics.values())

    def value(self, path):
        """Return what a message path of Lichtblick names."""
        topic, _, fields = path.partition('.')
        value = self.topics[topic][-1]
        for field in fields.split('.'):
            name, index = re.fullmatch(r'(\w+)(?:\[(\d+)\])?', field).groups()
            value = getattr(value, name)
            value = value if index is None else value[int(index)]
        return value

    def series(self):
        """Return the numbers by the names that PlotJuggler gives them."""
        found = {}
        for topic, messages in self.topics.items():
            if messages and isinstance(messages[-1], JointState):
                for part in ('position', 'velocity', 'effort'):
                    values = getattr(messages[-1], part)
                    found |= {
                        f'{topic}/{name}/{part}': value
                        for name, value in zip(messages[-1].name, values, strict=False)
                    }
        for (hardware, name), status in self.statuses.items():
            for pair in status.values:
                found[f'/diagnostics/{hardware}/{name}/{pair.key}'] = pair.value
        return found


@pytest.fixture
def heard(client, launch, namespace):
    """Return all that a node with a gap control publishes."""
    heard = Heard(client, namespace)
    process = launch(
        f'__ns:={namespace}', gap_control='amplitude', gap_max=0.5, predict_motion=True, **LIVELY
    )
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    until(heard.look, lambda: f'{ {k: len(v) for k, v in heard.topics.items()} }')
    # A motion is measured and predicted where the stops do not move.
    assert parameters.set(gap_control='off') == ''

    def known():
        heard.look()
        values = heard.series()
        name = f'{namespace[1:]}/sim_node'
        # A report on the motion alone may come before the first whole one.
        if (name, f'{name}: pacing') not in heard.statuses:
            return False
        share = f'/diagnostics/{name}/{name}: {{}} motion/Largest X / A'
        return all(values.get(share.format(kind)) for kind in ('measured', 'predicted'))

    until(known, lambda: process.output)
    return heard


def in_namespace(text, namespace, directory):
    """Do what the docs say for a rig in a namespace."""
    document = (SOURCE / 'docs' / 'reference' / 'viewers.md').read_text(encoding='utf-8')
    (command,) = re.findall(r'^sed -E .*$', document, re.MULTILINE)
    assert 'rig1' in command
    (directory / 'layout').write_text(text, encoding='utf-8')
    expression = re.search(r"'(.*)'", command)[1].replace('rig1', namespace[1:])
    return subprocess.run(
        ['sed', '-E', expression, str(directory / 'layout')],
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def paths_of(tree):
    """Yield the message paths of a layout of Lichtblick, and how each is stamped."""
    for panel in tree['configById'].values():
        for path in panel.get('paths', []):
            yield path['value'], path['timestampMethod']
        if 'xAxisPath' in panel:
            yield panel['xAxisPath']['value'], 'headerStamp'


def test_all_that_the_layouts_show_is_there(heard, namespace, tmp_path):
    names = Path('layouts', 'lichtblick.json'), Path('layouts', 'plotjuggler.xml')
    texts = [
        in_namespace((SOURCE / name).read_text(encoding='utf-8'), namespace, tmp_path)
        for name in names
    ]
    layout = json.loads(texts[0])
    units = {'m': 'position', 'm/s': 'velocity', 'N s': 'effort'}
    assert set(units.values()) == {'position', 'velocity', 'effort'}
    paths = list(paths_of(layout))
    assert len(paths) > 10
    for path, stamp in paths:
        assert isinstance(heard.value(path), (float, str)), path
        assert stamp == 'headerStamp'
    # An index stands for the joint that the label names.
    labels = {
        p['value']: p['label'] for c in layout['configById'].values() for p in c.get('paths', [])
    }
    for path, label in labels.items():
        if match := re.fullmatch(r'(.*/joint_states)\.\w+\[(\d)\]', path):
            name = heard.topics[match[1]][-1].name[int(match[2])]
            assert label.replace(' ', '_') == name
    panels = layout['configById']
    shown = [
        (p['selectedHardwareId'], p['selectedName'])
        for p in panels.values()
        if 'selectedName' in p
    ]
    assert len(shown) == 2
    assert set(shown) <= set(heard.statuses)
    assert panels['DiagnosticSummary!all']['hardwareIdFilter'] in {h for h, _ in heard.statuses}
    assert {p['topicToRender'] for p in panels.values() if 'topicToRender' in p} == {
        '/diagnostics'
    }
    assert set(panels['3D!rig']['topics']) == {f'{namespace}/robot_description'}
    (description,) = heard.topics[f'{namespace}/robot_description'][-1:]
    links = [e.get('name') for e in ElementTree.fromstring(description.data).findall('link')]
    assert panels['3D!rig']['followTf'] in links

    root = ElementTree.fromstring(texts[1].encode())
    series = heard.series()
    for snippet in root.iter('snippet'):
        sources = [snippet.find('linked_source'), *snippet.find('additional_sources')]
        assert all(isinstance(series[source.text], float) for source in sources)
        series[snippet.get('name')] = 0.0
    curves = list(root.iter('curve'))
    assert len(curves) > 10
    for curve in curves:
        given = [curve.get('curve_x'), curve.get('curve_y')]
        for name in given if all(given) else [curve.get('name')]:
            float(series[name])
    for plugin in root.iter('plugin'):
        (topics,) = (
            value
            for element in plugin
            for value in (element.get('selected_topics'), element.get('value'))
            if value and value.startswith('/')
        )
        assert set(topics.split(';')) <= set(heard.topics)
