"""Who may use the server."""

import pytest

from impact_damper_ros.page.gate import Gate, is_loopback


@pytest.fixture
def local():
    gate = Gate('127.0.0.1')
    gate.port = 8088
    return gate


@pytest.fixture
def public():
    gate = Gate('0.0.0.0', ['rig.example.org'])
    gate.port = 8088
    return gate


@pytest.mark.parametrize(
    'host', ['127.0.0.1:8088', 'localhost:8088', '[::1]:8088', 'LOCALHOST:8088']
)
def test_own_names_are_accepted(local, host):
    assert local.accepts_host(host)


@pytest.mark.parametrize(
    'host',
    [
        *('', 'attacker.example:8088', '127.0.0.1', '127.0.0.1:80', 'localhost:8089'),
        *('127.0.0.1:8088@attacker.example', '127.0.0.1:8088/', 'localhost:8088.attacker.example'),
        *('127.0.0.1.attacker.example:8088', 'a b:8088', '[::1:8088', '192.168.1.5:8088'),
        *('localhost:99999', 'localhost:-1', '127.0.0.1:8088#x'),
    ],
)
def test_foreign_hosts_are_refused(local, host):
    """A name that an attacker lets point here (DNS rebinding) shows in Host."""
    assert not local.accepts_host(host)


def test_no_name_but_the_given_ones_reaches_an_open_address(public):
    for host in ('rig.example.org:8088', '192.168.1.5:8088', '[fe80::1]:8088', 'localhost:8088'):
        assert public.accepts_host(host)
    for host in ('attacker.example:8088', 'rig.example.org.attacker.example:8088'):
        assert not public.accepts_host(host)


def test_origin_is_the_page_itself(local):
    own = 'localhost:8088'
    assert local.accepts_origin('http://localhost:8088', own)
    for origin in (
        *('http://localhost:8089', 'http://attacker.example', 'null', '', 'file://'),
        *('http://127.0.0.1:8088', 'http://localhost:8088/page', 'ws://localhost:8088'),
    ):
        assert not local.accepts_origin(origin, own), origin
    # Same Origin and Host, but of a foreign name
    assert not local.accepts_origin('http://attacker.example:8088', 'attacker.example:8088')


def test_tokens_are_asked_for_on_open_addresses_only(local, public):
    assert local.role(None) == 'steer'
    assert all(len(token) > 30 for token in public.tokens.values())
    assert not {*Gate('0.0.0.0').tokens.values()} & {*public.tokens.values()}
    for role, token in public.tokens.items():
        assert public.role(None, token) == role
        assert f'token={token}' in public.url(role)
        for wrong in ('', token[:-1], f'{token}x', 'ä', None):
            assert public.role(wrong) == ''
    assert local.url() == 'http://127.0.0.1:8088/'


def test_loopback():
    assert all(map(is_loopback, ('localhost', '127.0.0.1', '127.9.9.9', '::1')))
    assert not any(map(is_loopback, ('0.0.0.0', '::', '192.168.1.5', 'rig.example.org', '')))
