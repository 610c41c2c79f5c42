"""The layouts of viewers, as their programs read them; what they show is in test/node."""

import json
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]


def panels_of(node):
    """Return the panels of a mosaic, from the left and from above."""
    if isinstance(node, str):
        return [node]
    assert node['direction'] in ('row', 'column')
    assert 10 <= node['splitPercentage'] <= 90
    return [*panels_of(node['first']), *panels_of(node['second'])]


def test_layout_of_lichtblick():
    layout = json.loads((ROOT / 'layouts' / 'lichtblick.json').read_text(encoding='utf-8'))
    # Without these an import is refused.
    assert layout['playbackConfig'] == {'speed': 1}
    assert layout['globalVariables'] == layout['userNodes'] == {}
    panels = layout['configById']
    assert sorted(panels_of(layout['layout'])) == sorted(panels)
    assert {name.partition('!')[0] for name in panels} == {
        '3D',
        'Plot',
        'StateTransitions',
        'DiagnosticSummary',
        'DiagnosticStatusPanel',
    }
    for name, panel in panels.items():
        # Both programs, each by its own key
        assert panel.get('lichtblickPanelTitle') == panel.get('foxglovePanelTitle'), name
        for path in panel.get('paths', []):
            assert path['timestampMethod'] == 'headerStamp'
            assert path['label']
    (layer,) = panels['3D!rig']['layers'].items()
    assert layer[0] == layer[1]['instanceId']


def areas_of(splitter):
    """Return the plots of a splitter and those within it, with the shares checked."""
    assert splitter.get('orientation') in ('-', '|')
    parts = list(splitter)
    shares = [float(share) for share in splitter.get('sizes').split(';')]
    assert len(parts) == len(shares) == int(splitter.get('count'))
    assert abs(sum(shares) - 1.0) < 1e-9
    nested = [areas_of(part) if part.tag == 'DockSplitter' else [part] for part in parts]
    return list(chain.from_iterable(nested))


def test_layout_of_plotjuggler():
    root = ElementTree.parse(ROOT / 'layouts' / 'plotjuggler.xml').getroot()
    assert root.tag == 'root'
    (window,) = root.findall('tabbed_widget')
    assert (window.get('parent'), window.get('name')) == ('main_window', 'Main Window')
    tabs = window.findall('Tab')
    assert 0 <= int(window.find('currentTabIndex').get('index')) < len(tabs)
    for tab in tabs:
        containers = tab.findall('Container')
        assert len(containers) == int(tab.get('containers')) == 1
        (splitter,) = containers[0]
        for area in areas_of(splitter):
            assert area.tag == 'DockArea'
            assert area.get('name')
            (plot,) = area
            assert plot.get('mode') in ('TimeSeries', 'XYPlot')
            assert plot.get('line_width') in ('1.0', '1.5', '2.0', '3.0')
            assert plot.get('style') in ('Lines', 'LinesAndDots', 'Dots', 'Sticks', 'Steps')
            for curve in plot.findall('curve'):
                both = curve.get('curve_x') and curve.get('curve_y')
                assert bool(both) is (plot.get('mode') == 'XYPlot')
    # Header stamps, whatever the data come from
    plugins = {plugin.get('ID'): plugin for plugin in root.iter('plugin')}
    assert plugins.pop('DataLoad MCAP').find('parameters').get('use_timestamp') == '1'
    assert set(plugins) == {'DataLoad ROS2 bags', 'ROS2 Topic Subscriber'}
    for plugin in plugins.values():
        assert plugin.find('use_header_stamp').get('value') == 'true'
    assert root.find('previouslyLoaded_Streamer').get('name') in plugins
