from __future__ import annotations

import pytest

from msbot.errors import ConfigError
from msbot.link import UdpClientLink, UdpServerLink, open_link
from msbot.link.address import parse_host_and_port


@pytest.mark.parametrize(
    ("address", "name"),
    [
        ("udp:127.0.0.1:8888", "udp:127.0.0.1:8888"),
        (" UDP:localhost:1 ", "udp:localhost:1"),
        ("udp:[::1]:65535", "udp:[::1]:65535"),
        ("udp:[fe80::1%eth0]:2018", "udp:[fe80::1%eth0]:2018"),
    ],
)
def test_udp_addresses_name_a_host_and_a_port(address: str, name: str) -> None:
    client, server = open_link(address), open_link(address, serve=True)
    assert isinstance(client, UdpClientLink)
    assert isinstance(server, UdpServerLink)
    assert client.info.name == server.info.name == name
    assert client.remote is not None
    assert client.describe(client.remote) == name.removeprefix("udp:")
    assert server.remote is None


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("", "unknown kind of link ''; there are `udp:127.0.0.1:8888`"),
        ("udp", "unknown kind of link 'udp'"),
        ("tokenring:7", "link 'tokenring:7': unknown kind of link 'tokenring'"),
        ("127.0.0.1:8888", "unknown kind of link '127.0.0.1'"),
        ("udp:", "it needs a host and a port; write it like `udp:127.0.0.1:8888`"),
        ("udp:127.0.0.1", "it needs a host and a port"),
        ("udp:127.0.0.1:port", "it needs a host and a port"),
        ("udp::1:8888", "an IPv6 address stands in brackets"),
        ("udp:[127.0.0.1]:8888", "'127.0.0.1' is no IPv6 address"),
        ("udp:127.0.0.1:0", "port 0 is not from 1 to 65535"),
        ("udp:127.0.0.1:65536", "port 65536 is not from 1 to 65535"),
    ],
)
def test_a_wrong_address_is_answered_with_a_right_one(address: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        open_link(address)
    assert words in str(caught.value)


def test_a_server_may_ask_for_any_free_port() -> None:
    assert open_link("udp:127.0.0.1:0", serve=True).info.name == "udp:127.0.0.1:0"
    assert parse_host_and_port("[::]:0", any_port=True) == ("::", 0)
    with pytest.raises(ConfigError, match="port 65536 is not from 0 to 65535"):
        open_link("udp:127.0.0.1:65536", serve=True)
