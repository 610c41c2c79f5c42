# SPDX-License-Identifier: Apache-2.0
"""
Access control of the server: Host, Origin and token.

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

    host: str  # the address that the server listens on
    names: Sequence[str] = ()  # further host names of the server
    #: The token to require by what it allows, ``'steer'`` or ``'watch'``; empty on the loopback
    #: interface, where everyone may steer
    tokens: dict[str, str] = field(default_factory=dict, init=False)
    port: int = field(default=0, init=False)  # set once the server listens

    def __post_init__(self) -> None:
        """Make tokens where they are needed."""
        if not is_loopback(self.host):
            self.tokens = {role: secrets.token_urlsafe(24) for role in ('steer', 'watch')}

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

    def role(self, *given: str | None) -> str:
        """Return what the first known one of the given tokens allows; empty for none of them."""
        if not self.tokens:
            return 'steer'
        for text in given:
            for role, token in self.tokens.items():
                if hmac.compare_digest(token.encode(), (text or '').encode()):
                    return role
        return ''

    def url(self, role: str = 'steer') -> str:
        """Return the address to open."""
        host = self.host if self.host not in ('0.0.0.0', '::', '') else socket.gethostname()
        host = f'[{host}]' if ':' in host else host
        query = f'?token={self.tokens[role]}' if self.tokens else ''
        return f'http://{host}:{self.port}/{query}'
