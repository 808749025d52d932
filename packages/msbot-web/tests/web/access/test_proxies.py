"""Whose word about a request counts: that of proxies which were named, and nobody else's."""

from __future__ import annotations

import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from msbot_web.access.reverse_proxies import UNTRUSTED, ProxyHeadersMiddleware, TrustedProxies
from msbot_web.html import render
from msbot_web.language import PLAIN
from msbot_web.root_path import base_of, root
from msbot_xrce.errors import ConfigError

TOLD = {
    "x-forwarded-for": "192.0.2.7",
    "x-forwarded-proto": "https",
    "x-forwarded-host": "robots.school:8443",
    "x-forwarded-prefix": "/rex",
}


class Seen:
    """What a request is like behind the proxies."""

    def __init__(self, *proxies: str) -> None:
        self.app = ProxyHeadersMiddleware(self.answer, TrustedProxies(proxies))
        self.location = "/login"

    async def answer(self, scope: Scope, _receive: Receive, send: Send) -> None:
        self.scope = scope
        self.root = root()
        about = {"language": PLAIN, "say": PLAIN.translate, "title": "", "robot": "", "stop": "", "why": ""}
        self.html = str(render("refused", **about, comes_back=True, ways=()))
        if scope["type"] == "http":
            self.base = base_of(Request(scope))
        head = [(b"location", self.location.encode())]
        await send({"type": "http.response.start", "status": 303, "headers": head})

    async def ask(self, peer: str, kind: str = "http", **headers: str) -> dict[str, str]:
        sent: list[Message] = []

        async def send(message: Message) -> None:
            sent.append(message)

        async def receive() -> Message:
            raise AssertionError("nothing is read")

        given = {"host": "127.0.0.1:8080", **{name.replace("_", "-"): value for name, value in headers.items()}}
        scope: Scope = {
            "type": kind,
            "client": (peer, 4711),
            "scheme": "http" if kind == "http" else "ws",
            "path": "/",
            "headers": [(name.encode(), value.encode("latin-1")) for name, value in given.items()],
            "query_string": b"",
            "method": "GET",
            "server": ("127.0.0.1", 8080),
        }
        await self.app(scope, receive, send)
        return {name.decode(): value.decode() for name, value in sent[0]["headers"]}

    @property
    def headers(self) -> dict[str, str]:
        return {name.decode(): value.decode() for name, value in self.scope["headers"]}


async def test_a_trusted_proxy_says_how_the_browser_has_asked() -> None:
    seen = Seen("127.0.0.1", "10.0.3.0/24")
    for proxy in ("127.0.0.1", "10.0.3.9", "::ffff:10.0.3.9"):
        answer = await seen.ask(proxy, **TOLD)
        assert seen.scope["client"] == ("192.0.2.7", 0)
        assert seen.base == "https://robots.school:8443/rex/"
        assert answer["location"] == "/rex/login"
        assert 'href="/rex/"' in seen.html
    await seen.ask("127.0.0.1", "websocket", **TOLD)
    assert seen.scope["scheme"] == "wss"
    assert root() == "", "the next request is another one"


async def test_nobody_else_says_anything(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    for seen, peer in ((Seen(), "127.0.0.1"), (Seen("127.0.0.1"), "192.0.2.66"), (Seen("127.0.0.1"), "")):
        answer = await seen.ask(peer, **TOLD, forwarded="for=1.2.3.4", x_real_ip="1.2.3.4")
        assert seen.scope["client"] == (peer, 4711)
        assert seen.base == "http://127.0.0.1:8080/"
        assert seen.headers == {"host": "127.0.0.1:8080"}, "nothing behind it reads them, NiceGUI neither"
        assert answer["location"] == "/login"
        assert 'href="/"' in seen.html
        assert seen.scope["state"][UNTRUSTED] == peer
    assert "--trusted-proxy 192.0.2.66" in caplog.text
    said = len(caplog.records)
    seen = Seen()
    for number in range(100):
        await seen.ask(f"192.0.2.{number}", **TOLD)
        await seen.ask(f"192.0.2.{number}", **TOLD)
    assert len(caplog.records) - said == 16, "each once, and not without end"


async def test_addresses_are_believed_as_far_as_the_proxies_reach() -> None:
    seen = Seen("127.0.0.1", "10.0.0.0/8")
    for told, address in (
        ("6.6.6.6, 192.0.2.7", "192.0.2.7"),  # what the browser itself wrote comes first
        ("6.6.6.6, 192.0.2.7, 10.1.1.1", "192.0.2.7"),  # two proxies
        ("6.6.6.6, nonsense", "127.0.0.1"),
        ("10.1.1.1", "10.1.1.1"),
        ("", "127.0.0.1"),
        ("2001:db8::7", "2001:db8::7"),
    ):
        await seen.ask("127.0.0.1", x_forwarded_for=told)
        assert seen.scope["client"][0] == address, told


@pytest.mark.parametrize(
    "prefix", ["rex", "//evil.example", "/a b", '/"><script>', "/a/../b", "/.", "/a//b", "/" + "a" * 300, "/é", "/\\x"]
)
async def test_a_folder_that_is_none_counts_as_not_said(prefix: str) -> None:
    seen = Seen("127.0.0.1")
    await seen.ask("127.0.0.1", x_forwarded_prefix=prefix)
    assert seen.root == ""
    assert "x-forwarded-prefix" not in seen.headers


async def test_redirects_stay_in_the_folder() -> None:
    seen = Seen("127.0.0.1")
    for location, led in (
        ("/rex", "/rex/rex"),
        ("http://robots.school:8443/library?x=1", "/rex/library?x=1"),
        ("https://elsewhere.example/x", "https://elsewhere.example/x"),
        ("next", "next"),
    ):
        seen.location = location
        assert (await seen.ask("127.0.0.1", **TOLD))["location"] == led


@given(st.lists(st.tuples(st.sampled_from(sorted(TOLD)), st.text(max_size=40)), max_size=6))
def test_whatever_a_proxy_passes_on_is_a_request(headers: list[tuple[str, str]]) -> None:
    octets = [(name.encode(), value.encode("utf-8", "replace")) for name, value in headers]
    asked = TrustedProxies(["127.0.0.1"]).as_asked("127.0.0.1", octets)
    assert asked.scheme in ("", "http", "https")
    assert not set("\r\n\"'<> ") & set(asked.prefix + asked.host + asked.address)


def test_what_is_no_address_is_said_at_the_start() -> None:
    for named in ("robots.school", "", "10.0.0.0/99"):
        with pytest.raises(ConfigError, match="neither an address nor a network"):
            TrustedProxies([named])
