# SPDX-License-Identifier: Apache-2.0
"""
Access control of the server: Host, Origin, and the right to steer.

Pages on this machine steer, and pages with the token; all other pages watch.

A page of a foreign site can make a browser connect to a server of this machine. It cannot forge
the Host and Origin that the browser sends: a name that an attacker lets point to this machine (DNS
rebinding) shows in both. Addresses written as numbers cannot be rebound.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from urllib.parse import urlsplit

_LOOPBACK_NAMES = ('localhost', '127.0.0.1', '::1')


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _split(netloc: str) -> tuple[str, int | None] | None:
    """Return host and port of a Host header; None if it is malformed."""
    if not netloc or any(sign in netloc for sign in '/\\@?# \t'):
        return None
    try:
        parts = urlsplit(f'//{netloc}')
        return (parts.hostname or '').rstrip('.'), parts.port
    except ValueError:
        return None


@dataclass
class Gate:
    """The checks that a request must pass."""

    host: str  # the address on which the server listens
    names: Sequence[str] = ()  # further host names of the server
    #: Token with which another machine may steer; empty where no other machine can reach the
    #: server
    token: str = field(default='', init=False)
    port: int = field(default=0, init=False)  # set once the server listens

    def __post_init__(self) -> None:
        """Make a token where one is needed."""
        if not is_loopback(self.host):
            self.token = secrets.token_urlsafe(24)

    @property
    def cookie(self) -> str:
        """Name of the cookie, with the port, since cookies are shared between ports."""
        return f'rig_page_{self.port}'

    def accepts_host(self, netloc: str) -> bool:
        """Return whether a Host header names this server."""
        found = _split(netloc)
        if found is None or (found[1] or 80) != self.port:
            return False
        name = found[0].lower()
        if name in {self.host.lower(), *(own.lower() for own in self.names)}:
            return True
        if is_loopback(self.host):
            return name in _LOOPBACK_NAMES
        try:
            ipaddress.ip_address(name)
        except ValueError:
            own = socket.gethostname().lower()
            return name in (own, f'{own}.local', *_LOOPBACK_NAMES)
        return True

    def accepts_origin(self, origin: str, netloc: str) -> bool:
        """Return whether an Origin is that of the pages of this server at that Host."""
        scheme, _, rest = origin.partition('://')
        own = _split(rest) == _split(netloc)
        return scheme in ('http', 'https') and own and self.accepts_host(rest)

    def steers(self, peer: str, own: str, *tokens: str | None) -> bool:
        """Return whether a request may steer, by its two addresses and its tokens."""
        # A connection with one address at both ends does not leave the machine.
        return is_loopback(peer) or peer == own or any(map(self.accepts_token, tokens))

    def accepts_token(self, token: str | None) -> bool:
        """Return whether a token is the right one."""
        given = (token or '').encode()
        return bool(self.token) and hmac.compare_digest(self.token.encode(), given)

    def url(self, token: str = '') -> str:
        """Return the address to open."""
        host = self.host if self.host not in ('0.0.0.0', '::', '') else socket.gethostname()
        host = f'[{host}]' if ':' in host else host
        return f'http://{host}:{self.port}/' + (f'?token={token}' if token else '')
