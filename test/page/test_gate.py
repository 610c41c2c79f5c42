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


def test_this_machine_steers_and_who_has_the_token(local, public):
    assert (local.token, local.url()) == ('', 'http://127.0.0.1:8088/')
    assert len(public.token) > 30
    assert public.token != Gate('0.0.0.0').token
    for peer, own in (('127.0.0.1', '127.0.0.1'), ('::1', '::1'), ('10.0.0.4', '10.0.0.4')):
        assert public.steers(peer, own)
    assert local.steers('127.0.0.1', '127.0.0.1')
    elsewhere = '10.0.0.5', '10.0.0.4'
    assert public.steers(*elsewhere, None, public.token)
    assert public.steers(*elsewhere, 'wrong', public.token)
    for wrong in ('', public.token[:-1], f'{public.token}x', 'ä', None):
        assert not public.steers(*elsewhere, wrong, wrong)
        assert not local.steers(*elsewhere, wrong)
    assert public.url(public.token).endswith(f':8088/?token={public.token}')
    assert public.token not in public.url()


def test_loopback():
    assert all(map(is_loopback, ('localhost', '127.0.0.1', '127.9.9.9', '::1')))
    assert not any(map(is_loopback, ('0.0.0.0', '::', '192.168.1.5', 'rig.example.org', '')))
