from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from msbot_agent.link import open_link
from msbot_agent.link.can import (
    CanFdEprosimaLink,
    CanLegacyLink,
    CanMasterLink,
    CanPartLink,
    CanSettings,
    Codec,
    can_address,
    open_can_bus,
)
from msbot_agent.link.can.adapters.interface import CanInterface
from msbot_agent.link.can.adapters.remedies import Wanted
from msbot_agent.link.can.can_address import parse_target
from msbot_agent.link.can.filters import legacy_filters, master_filters, part_filters
from msbot_agent.link.can.protocol import MemoryNodeIds, NodeIds
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_xrce.errors import ConfigError

CODEC = Codec(bytes, bytes)
SETTINGS = CanSettings(codec=CODEC, is_whole=bool, uid=b"\1\2\3\4\5\6\7\x08", profile_hash=77, random=Random(1))
INTERFACES = {
    "can0": CanInterface("can0", 3, is_can=True, is_up=True, mtu=16, kind="can", bitrate=250_000),
    "can1": CanInterface(
        "can1", 4, is_can=True, is_up=True, mtu=72, kind="can", bitrate=500_000, data_bitrate=2_000_000
    ),
    "vcan0": CanInterface("vcan0", 5, is_can=True, is_up=True, mtu=72, kind="vcan"),
}


@pytest.fixture(autouse=True)
def interfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_address, "find_interface", INTERFACES.get)


def test_a_master_and_a_part_on_an_interface_of_linux() -> None:
    master = open_link("can:can0", serve=True, can=SETTINGS)
    part = open_link(" CAN:can0 ", can=SETTINGS)
    assert isinstance(master, CanMasterLink)
    assert isinstance(part, CanPartLink)
    assert master.info.name == part.info.name == "can:can0"
    assert master.info.bits_per_second == part.info.bits_per_second == 250_000
    assert master.info.compresses
    assert part.info.compresses
    assert not master._port.bus.info.fd
    assert not part._port.bus.info.fd


@pytest.mark.parametrize(
    ("address", "serve", "fd", "fast"),
    [
        ("can:can1", True, False, None),
        ("can:can1", False, True, 2_000_000),
        ("can:can1?fd=0", False, False, None),
        ("can:can1?fd=1", True, True, 2_000_000),
        ("can:can1?fd=1&dbitrate=5000000", True, True, 5_000_000),
        ("can:can0?fd=1", False, True, None),
        ("can:vcan0", False, True, None),
        ("can:vcan0", True, False, None),
        ("can:absent?fd=1", True, True, None),
        ("can:absent", False, False, None),
        ("can:pcan:PCAN_USBBUS1?fd=1&bitrate=500000&dbitrate=2000000", True, True, 2_000_000),
        ("can:pcan:PCAN_USBBUS1?bitrate=500000", False, False, None),
        ("canfd:vcan0", True, True, None),
        ("can-legacy:vcan0", True, False, None),
    ],
)
def test_the_master_is_told_of_fd_and_a_part_offers_it_where_it_can(
    address: str, serve: bool, fd: bool, fast: int | None
) -> None:
    link = open_link(address, serve=serve, can=SETTINGS)
    assert isinstance(link, CanMasterLink | CanPartLink | CanFdEprosimaLink | CanLegacyLink)
    info = link._port.bus.info
    assert (info.fd, info.data_bits_per_second) == (fd, fast)


@pytest.mark.parametrize("serve", [False, True])
@pytest.mark.parametrize(("query", "compresses"), [("", True), ("?compression=1", True), ("?compression=0", False)])
def test_headers_are_short_unless_the_address_says_otherwise(serve: bool, query: str, compresses: bool) -> None:
    assert open_link(f"can:can0{query}", serve=serve, can=SETTINGS).info.compresses is compresses
    assert not open_link(f"can:can0{query}", serve=serve).info.compresses  # nobody has given a codec


def test_a_master_keeps_addresses_where_it_is_told() -> None:
    asked: list[str] = []

    def node_ids(name: str) -> NodeIds:
        asked.append(name)
        return MemoryNodeIds()

    settings = CanSettings(node_ids=node_ids)
    open_link("can:can0?bitrate=500000", serve=True, can=settings)
    open_link("can:slcan:/dev/ttyACM0?bitrate=500000", serve=True, can=settings)
    open_link("can:can0", can=settings)
    assert asked == ["can:can0", "can:slcan:/dev/ttyACM0"]


def test_what_a_link_counts_has_the_drivers_counts_in_it() -> None:
    for scheme in ("can", "canfd", "can-legacy"):
        link = open_link(f"{scheme}:vcan0", serve=True, can=SETTINGS)
        bus = link._port.bus  # type: ignore[attr-defined]  # every link on CAN has a port
        bus.events(("bit error",), 0.0)
        assert link.counters.dropped == {"bit error": 1}


def test_the_ends_of_eprosimas_framing() -> None:
    agent = open_link("canfd:vcan0", serve=True, can=SETTINGS)
    client = open_link("canfd:vcan0?id=0xAB1", can=SETTINGS)
    assert (agent.info.name, agent.remote) == ("canfd:vcan0", None)
    assert client.remote == 0xAB1
    drawn = open_link("canfd:vcan0", can=SETTINGS).remote
    assert drawn == open_link("canfd:vcan0", can=SETTINGS).remote  # by its UID
    assert isinstance(drawn, int)
    assert 0 <= drawn < 1 << 29


def test_the_ends_of_the_legacy_framing() -> None:
    master = open_link("can-legacy:can0", serve=True, can=SETTINGS)
    component = open_link("can-legacy:can0", can=SETTINGS)
    assert (master.remote, component.remote) == (None, 0)
    with pytest.raises(ConfigError, match="does not tell where a message ends"):
        open_link("can-legacy:can0")


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("can:", "it needs an interface of Linux, or an interface of python-can and its channel"),
        ("can:slcan:", "it needs an interface"),
        ("can::COM3", "it needs an interface"),
        ("can:can0?bitrate", "option 'bitrate' is not of the form name=value"),
        ("can:can0?=5", "option '=5' is not of the form"),
        ("can:can0?bitrate=0", "option bitrate is '0': a bit rate from 5000 to 1000000"),
        ("can:can0?bitrate=2000000", "a bit rate from 5000 to 1000000"),
        ("can:can0?dbitrate=9000000", "a bit rate from 5000 to 8000000"),
        ("can:can0?fd=yes", "option fd is 'yes': 1 means yes, 0 no"),
        ("can:can0?compression=2", "option compression is '2'"),
        ("can:can0?speed=5", "there is no option 'speed'"),
        ("can:can0?id=5", "there is no option 'id'"),
        ("canfd:can0?fd=0", "needs CAN FD"),
        ("canfd:can0?id=x", "option id is 'x': an identifier such as 0xAB1 is needed"),
        ("canfd:can0?id=0x20000000", "CAN identifier 0x20000000 is not from 0 to"),
        ("can-legacy:can0?fd=1", "classic CAN"),
    ],
)
def test_a_wrong_address_is_told_with_a_right_one(address: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        open_link(address, can=SETTINGS)
    assert str(caught.value).startswith(f"link {address!r}: ")
    assert words in str(caught.value)
    assert f"write it like `{address.partition(':')[0]}:can0" in str(caught.value)


def test_the_lowest_and_the_highest_bit_rate() -> None:
    for rate, is_right in ((4_999, False), (5_000, True), (1_000_000, True), (1_000_001, False)):
        if is_right:
            assert open_link(f"can:can9?bitrate={rate}", can=SETTINGS).info.bits_per_second == rate
        else:
            with pytest.raises(ConfigError, match="a bit rate from 5000 to 1000000"):
                open_link(f"can:can9?bitrate={rate}", can=SETTINGS)


def test_options_of_python_can_go_through_as_they_are() -> None:
    target = parse_target("vector:0?bitrate=500000&app_name=MsBOT&rx_queue_size=0x100&listen_only=false&x=1.5")
    assert (target.interface, target.channel, target.bitrate) == ("vector", "0", 500_000)
    driver = open_can_bus("can:vector:0?app_name=MsBOT&rx_queue_size=0x100&listen_only=false&x=1.5")
    settings = driver._adapter._settings  # type: ignore[attr-defined]  # python-can's adapter
    assert settings == {"app_name": "MsBOT", "rx_queue_size": 256, "listen_only": False, "x": 1.5}


def test_tools_get_the_controller_alone() -> None:
    driver = open_can_bus("can:can1")
    assert driver.info.fd  # a tool shows whatever the bus bears
    assert driver.info.bits_per_second == 500_000
    assert not open_can_bus("can:can1?fd=0").info.fd
    with pytest.raises(ConfigError, match=r"'udp:127.0.0.1:1' is no CAN bus: write it like `can:can0"):
        open_can_bus("udp:127.0.0.1:1")
    with pytest.raises(ConfigError, match=r"'can:can0\?fd=x': option fd is 'x'.*write it like `can:can0"):
        open_can_bus("can:can0?fd=x")


def test_systems_without_socketcan_can_still_make_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: str) -> CanInterface | None:
        raise OSError(97, "Address family not supported by protocol")

    finder: Callable[[str], CanInterface | None] = refuse
    monkeypatch.setattr(can_address, "find_interface", finder)
    assert open_link("can:can0?bitrate=500000", can=SETTINGS).info.bits_per_second == 500_000


def test_the_kernel_is_asked_for_the_frames_of_that_side_alone() -> None:
    ids = CanIds()
    expected = {
        ("can", True): master_filters(ids),
        ("can", False): part_filters(ids),
        ("can-legacy", True): legacy_filters(ids, 0x123),
        ("can-legacy", False): legacy_filters(ids, 0x120),
    }
    for (scheme, serve), filters in expected.items():
        for fd in (0, 1) if scheme == "can" else (0,):
            link: Any = open_link(f"{scheme}:can0?fd={fd}&bitrate=250000", serve=serve, can=SETTINGS)
            adapter = link._port.bus._adapter
            assert tuple(adapter._filters) == tuple(filters)
            assert adapter.wanted == Wanted("can0", bool(fd), 250_000, None)
            assert not adapter.error_frames
    link = open_link("can:can0?fd=1&bitrate=250000&dbitrate=2000000", can=SETTINGS)
    assert link._port.bus._adapter.wanted == Wanted("can0", True, 250_000, 2_000_000)
