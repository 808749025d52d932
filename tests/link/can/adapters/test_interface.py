from __future__ import annotations

import errno
import socket
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.link.can.adapters.interface import (
    CanInterface,
    CanTotals,
    can_interfaces,
    find_interface,
    parse_interface,
    restart_controller,
)
from msbot.link.can.controller import BusState

ANSWERS = [
    bytes.fromhex(line.split()[1])
    for line in (Path(__file__).parent.parent.parent.parent / "vectors" / "can_interfaces.txt").read_text().splitlines()
    if not line.startswith("#")
]
LOOPBACK, VIRTUAL, ADAPTER, BUS_OFF = ANSWERS


def test_answers_of_a_real_kernel() -> None:
    adapter = CanInterface(
        "can0", 4, is_can=True, is_up=True, mtu=16, kind="can", bitrate=250_000, state=BusState.ACTIVE,
        totals=CanTotals(),
    )  # fmt: skip
    assert parse_interface(LOOPBACK) == CanInterface("lo", 1, is_can=False, is_up=True, mtu=65536)
    assert parse_interface(VIRTUAL) == CanInterface("vcan0", 2, is_can=True, is_up=True, mtu=72, kind="vcan")
    assert parse_interface(ADAPTER) == adapter
    off = parse_interface(BUS_OFF)
    assert off is not None
    assert off.state is BusState.OFF
    assert off.totals is not None
    assert off.totals.bus_offs == 1
    assert [one is not None and one.fd for one in map(parse_interface, ANSWERS)] == [True, True, False, False]


def attribute(kind: int, content: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(content), kind) + content + bytes(-len(content) % 4)


def answer(*attributes: bytes, link_type: int = 280, flags: int = 0) -> bytes:
    body = struct.pack("=BxHiII", 0, link_type, 9, flags, 0) + b"".join(attributes)
    return struct.pack("=IHHII", 16 + len(body), 16, 0, 1, 0) + body


def test_a_can_fd_controller_with_all_its_settings() -> None:
    data = (
        attribute(1, struct.pack("=I28x", 500_000))
        + attribute(4, struct.pack("=I", 2))
        + attribute(5, struct.pack("=II", 0x22, 0x22))
        + attribute(6, struct.pack("=I", 100))
        + attribute(9, struct.pack("=I28x", 2_000_000))
    )
    about = attribute(0x8000 | 18, attribute(1, b"can\0") + attribute(0x8000 | 2, data))
    assert parse_interface(answer(attribute(3, b"can1\0"), attribute(4, struct.pack("=I", 72)), about)) == CanInterface(
        "can1", 9, is_can=True, is_up=False, mtu=72, kind="can", bitrate=500_000, data_bitrate=2_000_000,
        state=BusState.PASSIVE, restart_ms=100, listen_only=True,
    )  # fmt: skip


@pytest.mark.parametrize(("number", "state"), [(1, BusState.ACTIVE), (4, None), (77, None)])
def test_states_that_mean_nothing_for_the_bus_are_not_told(number: int, state: BusState | None) -> None:
    data = attribute(2, attribute(4, struct.pack("=I", number)))
    found = parse_interface(answer(attribute(3, b"can0\0"), attribute(18, attribute(1, b"can\0") + data)))
    assert found is not None
    assert found.state is state


@given(st.binary(max_size=64), st.sampled_from(ANSWERS), st.integers(0, 900), st.integers(0, 900))
@settings(deadline=None)
def test_no_answer_raises(noise: bytes, base: bytes, at: int, end: int) -> None:
    parse_interface(noise)
    parse_interface(base[:end])
    parse_interface(base[:at] + noise + base[at + len(noise) :])


needs_netlink = pytest.mark.skipif(not hasattr(socket, "AF_NETLINK"), reason="rtnetlink is a part of Linux")


@needs_netlink
def test_this_kernel_answers() -> None:
    found = find_interface("lo")
    assert found is not None
    assert (found.name, found.is_can) == ("lo", False)
    assert find_interface("msbot-not-there") is None
    assert find_interface("a-name-longer-than-an-interface-can-have") is None
    assert all(interface.is_can for interface in can_interfaces())


@needs_netlink
def test_what_is_no_can_controller_cannot_be_restarted() -> None:
    found = find_interface("lo")
    assert found is not None
    with pytest.raises(OSError) as caught:  # noqa: PT011 - the kernel's number is compared below
        restart_controller(found.index)
    assert caught.value.errno in (errno.EPERM, errno.EOPNOTSUPP, errno.EINVAL)


def test_systems_without_netlink_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(socket, "AF_NETLINK", raising=False)
    with pytest.raises(OSError, match="not supported"):
        find_interface("can0")


def test_the_error_counters_of_a_controller() -> None:
    data = attribute(0x8002, attribute(8, struct.pack("=HH", 130, 4)))
    statistics = attribute(3, struct.pack("=6I", 9, 8, 7, 6, 5, 4))
    found = parse_interface(answer(attribute(0x8012, attribute(1, b"can\0") + data + statistics)))
    assert found is not None
    assert (found.transmit_errors, found.receive_errors) == (130, 4)
    assert found.totals == CanTotals(9, 8, 7, 6, 5, 4)
