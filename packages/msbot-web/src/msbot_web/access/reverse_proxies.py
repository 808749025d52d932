"""Reverse proxies in front of the page: whose word about a request counts, and what it says.

A proxy passes requests on as its own. What the browser asked for stands in headers: `X-Forwarded-For` (whose address),
`X-Forwarded-Proto` (http or https), `X-Forwarded-Host` (the name) and `X-Forwarded-Prefix` (the folder in which the
proxy has put the page, and which it has taken off the path). Anybody can write them, so they count only from proxies
that were named; from everybody else they are dropped before anything reads them.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, MutableMapping
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

from msbot_web.root_path import ROOT
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

FOR, PROTO, HOST, PREFIX = b"x-forwarded-for", b"x-forwarded-proto", b"x-forwarded-host", b"x-forwarded-prefix"
UNTRUSTED = "untrusted_proxy"
"""In a request's state: the address of who passed it on without being trusted."""
LONGEST = 200
"""Characters of a name or folder."""
MOST_SAID = 16
_DROPPED = (FOR, PROTO, HOST, PREFIX, b"forwarded", b"x-forwarded-port", b"x-real-ip", b"x-forwarded-server")
_PREFIX = re.compile(r"(/[A-Za-z0-9._~-]+)+")
_HOST = re.compile(r"[A-Za-z0-9.-]+(:[0-9]{1,5})?|\[[0-9A-Fa-f:.]+\](:[0-9]{1,5})?")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class OriginalRequest:
    """How a browser asked, as far as the proxies say."""

    address: str
    """Of the browser, or of what is between it and the last trusted proxy."""
    scheme: str
    """`http` or `https`; empty: nobody says."""
    host: str
    """Name and port; empty: nobody says."""
    prefix: str
    """The folder, without a slash at its end."""


class TrustedProxies:
    """The proxies that are trusted.

    Args:
        named: their addresses, or networks of them: `127.0.0.1`, `10.0.3.0/24`.

    Raises:
        ConfigError: one is neither.
    """

    def __init__(self, named: Iterable[str] = ()) -> None:
        self._networks = [_network(one) for one in named]

    def trusts(self, address: str) -> bool:
        """Whether what comes from that address may say for whom it asks."""
        try:
            found = ip_address(address)
        except ValueError:
            return False
        mapped = getattr(found, "ipv4_mapped", None)
        return any((mapped or found) in network for network in self._networks)

    def as_asked(self, peer: str, headers: Iterable[tuple[bytes, bytes]]) -> OriginalRequest:
        """What a trusted proxy says; what is malformed counts as not said.

        Each proxy adds to the end of a list, so the last word is that of the nearest, and of the addresses the last that
        is no trusted proxy is the browser's.
        """
        said: dict[bytes, list[str]] = {}
        for name, value in headers:
            said.setdefault(name.lower(), []).extend(one.strip() for one in value.decode("latin-1").split(","))
        scheme, host, prefix = (said.get(name, [""])[-1][: LONGEST + 1] for name in (PROTO, HOST, PREFIX))
        address = peer
        for one in reversed(said.get(FOR, [])):
            if not self.trusts(address) or not _is_address(one):
                break
            address = one
        prefix = prefix.rstrip("/")
        return OriginalRequest(
            address=address,
            scheme=scheme.lower() if scheme.lower() in ("http", "https") else "",
            host=host if len(host) <= LONGEST and _HOST.fullmatch(host) else "",
            prefix=prefix if len(prefix) <= LONGEST and _PREFIX.fullmatch(prefix) and "/." not in prefix else "",
        )


class ProxyHeadersMiddleware:
    """ASGI middleware in front of everything: from here on a request is as the browser has asked.

    Args:
        app: everything behind it.
        proxies: whom to trust.
    """

    def __init__(self, app: ASGIApp, proxies: TrustedProxies) -> None:
        self._app = app
        self._proxies = proxies
        self._said: set[str] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        peer = (scope.get("client") or ("", 0))[0]
        given: list[tuple[bytes, bytes]] = list(scope["headers"])
        kept = [pair for pair in given if pair[0].lower() not in _DROPPED]
        state = scope.setdefault("state", {})
        prefix = ""
        if self._proxies.trusts(peer):
            asked = self._proxies.as_asked(peer, given)
            prefix = asked.prefix
            scope["client"] = (asked.address, 0)
            if asked.scheme:
                scope["scheme"] = _SCHEMES[scope["type"], asked.scheme]
            if asked.host:
                kept = [pair for pair in kept if pair[0].lower() != b"host"]
                kept.append((b"host", asked.host.encode("latin-1")))
            if prefix:
                kept.append((PREFIX, prefix.encode("latin-1")))  # NiceGUI reads it there
        elif len(kept) < len(given):
            state[UNTRUSTED] = peer
            self._say(peer)
        scope["headers"] = kept
        token = ROOT.set(prefix)
        try:
            await self._app(scope, receive, _led(send, scope, prefix) if prefix else send)
        finally:
            ROOT.reset(token)

    def _say(self, peer: str) -> None:
        if peer not in self._said and len(self._said) < MOST_SAID:
            self._said.add(peer)
            _log.warning(
                "%s passes on requests of others to the page and is not trusted: what it says of them is dropped. If it "
                "is your proxy, start the robot with --trusted-proxy %s",
                peer,
                peer,
            )


_SCHEMES = {
    ("http", "http"): "http",
    ("http", "https"): "https",
    ("websocket", "http"): "ws",
    ("websocket", "https"): "wss",
}


def _led(send: Send, scope: Scope, prefix: str) -> Send:
    """Lead redirects into the folder."""
    hosts = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]

    def led(value: str) -> str:
        place = urlsplit(value)
        is_own = not place.netloc or place.netloc in hosts
        if not is_own or not place.path.startswith("/"):
            return value
        return prefix + place._replace(scheme="", netloc="").geturl()

    async def lead(message: MutableMapping[str, object]) -> None:
        if message["type"] == "http.response.start":
            headers: list[tuple[bytes, bytes]] = list(message.get("headers", ()))  # type: ignore[call-overload]
            message["headers"] = [
                (name, led(value.decode("latin-1")).encode("latin-1") if name.lower() == b"location" else value)
                for name, value in headers
            ]
        await send(message)

    return lead


def _network(named: str) -> IPv4Network | IPv6Network:
    try:
        return ip_network(named, strict=False)
    except ValueError:
        raise ConfigError(
            f"--trusted-proxy {named}: that is neither an address nor a network: write 127.0.0.1, or 10.0.3.0/24"
        ) from None


def _is_address(word: str) -> bool:
    try:
        ip_address(word)
    except ValueError:
        return False
    return True
