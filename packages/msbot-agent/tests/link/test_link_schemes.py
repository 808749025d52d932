from __future__ import annotations

import asyncio

import pytest

from msbot_agent.link import LinkInfo, bound_name, open_link
from msbot_agent.link.link_schemes import parse_host_and_port
from msbot_agent.link.net import TcpClientLink, TcpServerLink, UdpClientLink, UdpServerLink, WebSocketClientLink
from msbot_agent.link.serial import PtyServerLink, SerialClientLink, SerialServerLink
from msbot_xrce.errors import ConfigError


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
    "address",
    ["tcp:127.0.0.1:8888", "tcp:[::1]:2018"],
)
def test_tcp_addresses_name_a_host_and_a_port(address: str) -> None:
    client, server = open_link(address), open_link(address, serve=True)
    assert isinstance(client, TcpClientLink)
    assert isinstance(server, TcpServerLink)
    assert client.info.name == server.info.name == address


@pytest.mark.parametrize(
    ("address", "name", "baudrate"),
    [
        ("serial:/dev/ttyUSB0", "serial:/dev/ttyUSB0", 115200),
        ("serial:COM3?baudrate=9600", "serial:COM3", 9600),
        ("serial:/dev/serial/by-path/pci-0:1.0", "serial:/dev/serial/by-path/pci-0:1.0", 115200),
    ],
)
def test_serial_addresses_name_a_port(address: str, name: str, baudrate: int) -> None:
    client, server = open_link(address), open_link(address, serve=True)
    assert isinstance(client, SerialClientLink)
    assert isinstance(server, SerialServerLink)
    for link in (client, server):
        assert (link.info.name, link.info.bits_per_second) == (name, baudrate)


def test_a_client_on_a_shared_line_has_an_address_of_its_own() -> None:
    link = open_link("serial:/dev/ttyUSB0?address=7&baudrate=57600")
    assert isinstance(link, SerialClientLink)
    assert link.address == 7


def test_a_server_takes_several_serial_ports_or_all() -> None:
    assert open_link("serial:/dev/a, /dev/b", serve=True).info.name == "serial:/dev/a,/dev/b"
    assert open_link("serial:auto", serve=True).info.name == "serial:auto"


def test_a_pseudo_terminal_has_a_name() -> None:
    assert isinstance(open_link("pty:/tmp/robot.tty", serve=True), PtyServerLink)


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
        ("udp::1:8888", "an IPv6 address needs brackets"),
        ("udp:[127.0.0.1]:8888", "'127.0.0.1' is no IPv6 address"),
        ("udp:127.0.0.1:0", "port 0 is not from 1 to 65535"),
        ("udp:127.0.0.1:65536", "port 65536 is not from 1 to 65535"),
        ("tcp:8888", "it needs a host and a port; write it like `tcp:127.0.0.1:8888`"),
        ("serial:", "it needs the one port that leads to the master; write it like `serial:/dev/ttyUSB0?baudrate"),
        ("serial:auto", "it needs the one port"),
        ("serial:/dev/a,/dev/b", "it needs the one port"),
        ("serial:/dev/a?speed=1", "there is no option 'speed'; there are baudrate, address"),
        ("serial:/dev/a?baudrate=fast", "option baudrate is 'fast', not a number"),
        ("serial:/dev/a?baudrate", "option baudrate is '', not a number"),
        ("serial:/dev/a?baudrate=1", "baud rate 1 is not from 50 to 20000000"),
        ("serial:/dev/a?address=256", "serial address 256 is not from 0 to 255"),
        ("pty:/tmp/robot.tty", "a part opens the other end, as a serial port: `serial:/tmp/robot.tty`"),
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


@pytest.mark.parametrize("kind", ["udp", "tcp"])
async def test_a_port_that_was_got_is_told(kind: str) -> None:
    link = open_link(f"{kind}:127.0.0.1:0", serve=True)
    assert isinstance(link, UdpServerLink | TcpServerLink)
    up = asyncio.Event()
    link.attach(signal=lambda *_: up.set())
    assert bound_name(link) == f"{kind}:127.0.0.1:0"
    async with asyncio.timeout(20), asyncio.TaskGroup() as group:
        serving = group.create_task(link.run())
        await up.wait()
        assert bound_name(link) == f"{kind}:127.0.0.1:{link.port}"
        serving.cancel()


def test_a_link_without_ports_has_one_name() -> None:
    assert bound_name(open_link("sim:test", serve=True)) == "sim:test"


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("serial:", "it needs a port, or `auto` for every USB serial port"),
        ("serial:/dev/a,,/dev/b", "it needs a port"),
        ("serial:/dev/a?address=1", "there is no option 'address'"),
        ("pty:", "it needs a name for the terminal; write it like `pty:/tmp/robot.tty`"),
    ],
)
def test_a_wrong_address_of_a_server_is_answered_with_a_right_one(address: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        open_link(address, serve=True)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("address", "name"),
    [
        ("ws://127.0.0.1:8080", "ws://127.0.0.1:8080"),
        ("WSS://robot.school", "wss://robot.school"),
        ("ws://[::1]:8080/robots/one/api/link", "ws://[::1]:8080"),
    ],
)
def test_a_page_is_named_by_its_address(address: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSBOT_TOKEN", "msbot_x")
    link = open_link(address)
    assert isinstance(link, WebSocketClientLink)
    assert link.info.name == name


@pytest.mark.parametrize(
    ("address", "token", "words"),
    [
        ("ws:127.0.0.1:8080", "msbot_x", "it needs // and the page's host and port; write it like `ws://127.0.0.1:"),
        ("ws://:8080", "msbot_x", "it needs // and the page's host"),
        ("ws://host:99999", "msbot_x", "it needs // and the page's host"),
        ("ws://[::1:8080", "msbot_x", "it needs // and the page's host"),
        ("ws://ann:secret@host:80", "msbot_x", "it has a host, a port and perhaps a path, and nothing else"),
        ("ws://host:80?token=x", "msbot_x", "it has a host, a port and perhaps a path, and nothing else"),
        ("ws://host:80", "", r"\$MSBOT_TOKEN has to hold an API token"),
        ("ws://host:80", "a\nb", r"\$MSBOT_TOKEN has to hold an API token"),
    ],
)
def test_an_address_of_a_page_that_makes_no_sense_is_refused(
    address: str, token: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MSBOT_TOKEN", token)
    with pytest.raises(ConfigError, match=words):
        open_link(address)


def test_the_page_serves_parts_by_itself() -> None:
    with pytest.raises(ConfigError, match="the page serves parts by itself wherever it is served"):
        open_link("ws://127.0.0.1:8080", serve=True)


@pytest.mark.parametrize(
    ("address", "serve", "info"),
    [
        ("udp:h:1", False, LinkInfo("udp:h:1", 65_507, None, False, False, False, True)),
        ("udp:h:1", True, LinkInfo("udp:h:1", 65_507, None, False, False, False, True)),
        ("tcp:h:1", False, LinkInfo("tcp:h:1", 65_535, None, False, False, True, False)),
        ("tcp:h:1", True, LinkInfo("tcp:h:1", 65_535, None, False, False, True, False)),
        ("ws://h:1", False, LinkInfo("ws://h:1", 65_535, None, False, False, True, False, True)),
        ("serial:/dev/a", False, LinkInfo("serial:/dev/a", 65_535, 115_200, False, False, True, False)),
        ("serial:/dev/a?baudrate=9600", True, LinkInfo("serial:/dev/a", 65_535, 9_600, False, False, True, False)),
        ("sim:x", True, LinkInfo("sim:x", 4_096, 500_000, True, False, True, False)),
    ],
)
def test_what_a_link_says_of_itself(address: str, serve: bool, info: LinkInfo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSBOT_TOKEN", "msbot_x")
    assert open_link(address, serve=serve).info == info
