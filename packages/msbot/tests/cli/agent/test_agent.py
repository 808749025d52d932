"""`msbot agent`: the options of MicroXRCEAgent, and what they lead to."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from msbot_agent.cli.agent import agent
from msbot_agent.cli.agent.agent import command
from msbot_agent.cli.agent.serving import Discovery, ServingOptions
from msbot_agent.link import Link
from msbot_agent.link.can import CanFdEprosimaLink, CanLegacyLink, CanMasterLink
from msbot_agent.link.net import TcpServerLink, UdpServerLink
from msbot_agent.link.serial import PtyServerLink, SerialServerLink
from msbot_xrce.errors import ConfigError


class Served:
    """What `serve` was called with."""

    link: Link
    wishes: ServingOptions
    discovery: Discovery | None
    hint: str
    open_for: Callable[[int], Link] | None

    def __call__(
        self,
        link: Link,
        wishes: ServingOptions,
        discovery: Discovery | None = None,
        *,
        hint: str = "",
        open_for: Callable[[int], Link] | None = None,
    ) -> None:
        self.link, self.wishes, self.discovery, self.hint, self.open_for = link, wishes, discovery, hint, open_for


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Served:
    served = Served()
    monkeypatch.setattr(agent, "serve", served)
    return served


def run(*arguments: str) -> Result:
    done = CliRunner().invoke(command, arguments)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.mark.parametrize(
    ("transport", "kind", "name"),
    [
        ("udp4", UdpServerLink, "udp:127.0.0.1:2019"),
        ("udp6", UdpServerLink, "udp:[::1]:2019"),
        ("tcp4", TcpServerLink, "tcp:127.0.0.1:2019"),
        ("tcp6", TcpServerLink, "tcp:[::1]:2019"),
    ],
)
def test_transports_over_ip_serve_this_computer_unless_told_otherwise(
    served: Served, transport: str, kind: type[Link], name: str
) -> None:
    assert run(transport, "-p", "2019").exit_code == 0
    assert isinstance(served.link, kind)
    assert served.link.info.name == name
    assert "for this computer only (--host" in served.hint
    assert served.discovery is None
    assert served.wishes == ServingOptions(verbose=4, middleware=None, refs=None, dead_after_s=math.inf)
    everywhere = "0.0.0.0" if transport.endswith("4") else "::"
    run(transport, "-p2019", "--host", everywhere)
    assert served.hint == ""


def test_the_options_of_a_start_script_are_taken_as_they_are(served: Served, tmp_path: Path) -> None:
    assert run("udp4", "-p", "8888", "-m", "dds", "-r", "refs.xml", "-v", "6", "-d", "7401").exit_code == 0
    assert served.wishes == ServingOptions(6, "dds", Path("refs.xml"), math.inf)
    assert served.discovery == Discovery(7401, "127.0.0.1")
    run("udp4", "--port", "8888", "--middleware", "rtps", "--refs", "x", "--verbose", "5", "--dead-after", "2.5")
    assert served.wishes == ServingOptions(5, "rtps", Path("x"), 2.5)


@pytest.mark.parametrize("arguments", [("-d", "-v", "6"), ("-v6", "-d"), ("--discovery", "--verbose", "6")])
def test_discovery_and_verbosity_may_stand_without_a_value(served: Served, arguments: tuple[str, ...]) -> None:
    assert run("udp4", "-p", "8888", *arguments).exit_code == 0
    assert served.discovery == Discovery(7400, "127.0.0.1")
    assert served.wishes.verbose == 6
    run("udp4", "-p", "8888", "-v", "-d")
    assert served.wishes.verbose == 4


@pytest.mark.parametrize(
    ("transport", "host", "interface"),
    [
        ("udp4", "0.0.0.0", None),
        ("udp6", "::", None),
        ("udp4", "192.168.1.5", "192.168.1.5"),
        ("udp4", "localhost", "127.0.0.1"),
    ],
)
def test_discovery_is_on_the_interfaces_that_are_served(
    served: Served, transport: str, host: str, interface: str | None
) -> None:
    run(transport, "-p", "1", "--host", host, "-d")
    assert served.discovery == Discovery(7400, interface, ip=6 if host == "::" else 4)


def test_an_agent_on_ipv6_tells_its_ipv6_address(served: Served) -> None:
    run("udp6", "-p", "1", "-d")
    assert served.discovery == Discovery(7400, "127.0.0.1", told="::1", ip=6)
    assert served.hint.endswith("discovery answers this computer only, too")
    run("udp6", "-p", "1", "--host", "2001:db8::7", "-d")
    assert served.discovery == Discovery(7400, None, told="2001:db8::7", ip=6)
    assert served.hint == ""


def test_the_genuine_agents_identifier_option_is_taken(served: Served) -> None:
    assert run("can", "-D", "can0", "-I", "1").exit_code == 2
    assert run("canfd", "-D", "can0?fd=1", "-I", "0x00001").exit_code == 0


def test_discovery_needs_an_address_to_tell(served: Served) -> None:
    with pytest.raises(ConfigError, match=r"--host robot\.local is a name: give the address"):
        run("tcp6", "-p", "1", "--host", "robot.local", "-d")


@pytest.mark.parametrize(
    ("transport", "host", "words"),
    [
        ("udp4", "::1", "an address of IPv6: use `msbot agent udp6`"),
        ("tcp6", "127.0.0.1", "an address of IPv4: use `msbot agent tcp4`"),
        ("udp4", "fe80::1%eth0", "use `msbot agent udp6`"),
        ("tcp4", "", "--host is empty"),
    ],
)
def test_an_address_of_the_other_kind_is_a_mistake(served: Served, transport: str, host: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        run(transport, "-p", "1", "--host", host)


@pytest.mark.parametrize(
    ("arguments", "name", "baudrate"),
    [
        (("serial", "--dev", "/dev/ttyACM0", "-b", "921600"), "serial:/dev/ttyACM0", 921600),
        (("serial", "-D", "/dev/ttyUSB0"), "serial:/dev/ttyUSB0", 115200),
        (("serial", "-D", "auto"), "serial:auto", 115200),
        (("multiserial", "--devs", "/dev/a /dev/b", "-fc", "-b", "6000000"), "serial:/dev/a,/dev/b", 6000000),
        (("multiserial", "-D", "/dev/a", "-D", "/dev/b"), "serial:/dev/a,/dev/b", 115200),
        (("multiserial", "-D", "auto"), "serial:auto", 115200),
    ],
)
def test_serial_ports_are_named_as_before_or_all_of_them(
    served: Served, arguments: tuple[str, ...], name: str, baudrate: int
) -> None:
    assert run(*arguments).exit_code == 0
    assert isinstance(served.link, SerialServerLink)
    assert (served.link.info.name, served.link.info.bits_per_second) == (name, baudrate)


def test_ports_may_stand_in_a_file(served: Served, tmp_path: Path) -> None:
    (tmp_path / "ports").write_text("/dev/a\n/dev/b\n")
    run("multiserial", "-f", str(tmp_path / "ports"))
    assert served.link.info.name == "serial:/dev/a,/dev/b"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("serial",), "name the serial ports with --dev or in a --file"),
        (("serial", "-D", "a", "-f", "b"), "one of the two; --dev auto takes all"),
        (("serial", "-D", "a b"), "2 serial ports are named: use `msbot agent multiserial`"),
        (("multiserial", "-f", "/no/such/file"), "cannot read the names of serial ports in /no/such/file"),
        (("multiserial", "-D", " "), "no serial port is named"),
        (("serial", "-D", "a", "-b", "7"), "baud rate 7 is not from 50"),
    ],
)
def test_mistakes_about_serial_ports_are_one_sentence(served: Served, arguments: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        run(*arguments)


def test_a_pseudo_terminal_may_have_a_name(served: Served) -> None:
    assert run("pseudoterminal", "-b", "115200", "-v", "4").exit_code == 0
    assert isinstance(served.link, PtyServerLink)
    assert served.link.info.name == "pty:"
    run("pseudoterminal", "--dev", "/tmp/robot.tty")
    assert served.link.info.name == "pty:/tmp/robot.tty"


@pytest.mark.parametrize(
    "arguments",
    [
        ("udp4",),
        ("udp4", "-p", "65536"),
        ("udp4", "-p", "1", "-v", "7"),
        ("udp4", "-p", "1", "-m", "zenoh"),
        ("udp4", "-p", "1", "--dead-after", "0"),
        ("udp5", "-p", "1"),
    ],
)
def test_values_that_cannot_be_are_refused(arguments: tuple[str, ...]) -> None:
    assert run(*arguments).exit_code == 2


@pytest.mark.parametrize(
    ("arguments", "kind", "name"),
    [
        (("can", "-D", "can0"), CanMasterLink, "can:can0"),
        (("can", "--dev", "can0?bitrate=250000"), CanMasterLink, "can:can0"),
        (("can", "-D", "slcan:/dev/ttyACM0?bitrate=500000"), CanMasterLink, "can:slcan:/dev/ttyACM0"),
        (("canfd", "-D", "can0"), CanFdEprosimaLink, "canfd:can0"),
        (("can-legacy", "-D", "can0"), CanLegacyLink, "can-legacy:can0"),
    ],
)
def test_a_bus_is_served_by_its_interface(
    served: Served, arguments: tuple[str, ...], kind: type[Link], name: str
) -> None:
    assert run(*arguments).exit_code == 0
    assert isinstance(served.link, kind)
    assert served.link.info.name == name
    assert served.link.info.compresses == (arguments[0] == "can")


def test_a_wrong_bus_is_told_with_a_right_one() -> None:
    with pytest.raises(ConfigError, match=r"link 'can:can0.bitrate=fast'.*5000 to 1000000.*write it like `can:can0"):
        run("can", "-D", "can0?bitrate=fast")
