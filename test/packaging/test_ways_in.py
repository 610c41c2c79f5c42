"""The issue forms are what their host reads."""

from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]


def test_issue_forms_have_what_a_form_needs():
    for form in (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('*.yml'):
        stated = yaml.safe_load(form.read_text(encoding='utf-8'))
        assert stated.keys() >= {'name', 'description', 'body'}
        identifiers = [part['id'] for part in stated['body']]
        assert len(set(identifiers)) == len(identifiers)
        assert all(part['attributes']['label'] for part in stated['body'])
