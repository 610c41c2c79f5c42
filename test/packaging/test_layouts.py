"""The layout for Lichtblick and Foxglove, as they read it; what it shows is in test/node."""

import json
from pathlib import Path

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
