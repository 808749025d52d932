from __future__ import annotations

import errno
import os
import socket
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.adapters.interface import (
    CanInterface,
    CanTotals,
    can_interfaces,
    find_interface,
    parse_interface,
    restart_controller,
)
from msbot_agent.link.can.controller import BusState
from tests import ROOT

ANSWERS = [
    bytes.fromhex(line.split()[1])
    for line in (ROOT / "tests" / "vectors" / "can_interfaces.txt").read_text().splitlines()
    if not line.startswith("#")
]
LOOPBACK, VIRTUAL, ADAPTER, BUS_OFF = ANSWERS


def test_answers_of_a_real_kernel() -> None:
    adapter = CanInterface(
        "can0",
        4,
        is_can=True,
        is_up=True,
        mtu=16,
        kind="can",
        bitrate=250_000,
        state=BusState.ACTIVE,
        totals=CanTotals(),
    )
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
        "can1",
        9,
        is_can=True,
        is_up=False,
        mtu=72,
        kind="can",
        bitrate=500_000,
        data_bitrate=2_000_000,
        state=BusState.PASSIVE,
        restart_ms=100,
        listen_only=True,
    )


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


class Route:
    """A socket to the kernel that keeps what is asked, and answers as the test says."""

    answer = b""
    asked: list[bytes]

    def __init__(self) -> None:
        self.asked = []

    def __call__(self, family: int, kind: int, protocol: int) -> Route:
        assert (family, kind, protocol) == (socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE)
        self.is_open = True
        return self

    def __enter__(self) -> Route:
        return self

    def __exit__(self, *_: object) -> None:
        self.is_open = False

    def settimeout(self, seconds: float) -> None:
        self.patience_s = seconds

    def send(self, message: bytes) -> None:
        self.asked.append(message)

    def recv(self, size: int) -> bytes:
        assert size >= len(self.answer)
        return self.answer


@pytest.fixture
def route(monkeypatch: pytest.MonkeyPatch) -> Route:
    found = Route()
    monkeypatch.setattr(socket, "socket", found)
    return found


def acknowledgement(number: int) -> bytes:
    """NLMSG_ERROR as linux/netlink.h has it, without the message that it answers."""
    return struct.pack("=IHHII", 20, 2, 0, 1, 0) + struct.pack("=i", -number)


@needs_netlink
def test_the_question_for_an_interface_as_the_kernel_reads_it(route: Route) -> None:
    route.answer = VIRTUAL
    found = find_interface("vcan0")
    assert found is not None
    assert found.name == "vcan0"
    (asked,) = route.asked
    name = struct.pack("=HH", 10, 3) + b"vcan0\0\0\0"  # IFLA_IFNAME; its length without the padding
    body = struct.pack("=BxHiII", 0, 0, 0, 0, 0) + name
    assert asked == struct.pack("=IHHII", 16 + len(body), 18, 0x01, 1, 0) + body  # RTM_GETLINK, NLM_F_REQUEST
    assert not route.is_open
    assert route.patience_s > 0


@needs_netlink
def test_the_order_to_restart_a_controller_as_the_kernel_reads_it(route: Route) -> None:
    route.answer = acknowledgement(0)
    restart_controller(7)
    (asked,) = route.asked
    restart = struct.pack("=HHI", 8, 7, 1)  # IFLA_CAN_RESTART
    about = struct.pack("=HH", 7, 1) + b"can\0" + struct.pack("=HH", 4 + len(restart), 2) + restart
    body = struct.pack("=BxHiII", 0, 0, 7, 0, 0) + struct.pack("=HH", 4 + len(about), 18) + about
    assert asked == struct.pack("=IHHII", 16 + len(body), 16, 0x05, 1, 0) + body  # RTM_NEWLINK, with NLM_F_ACK


@needs_netlink
@pytest.mark.parametrize(
    ("number", "is_raised"),
    [(errno.ENODEV, False), (errno.EINVAL, False), (errno.ERANGE, False), (errno.EPERM, True), (errno.EBUSY, True)],
)
def test_an_interface_that_is_not_there_is_none_and_other_refusals_are_raised(
    number: int, is_raised: bool, route: Route
) -> None:
    route.answer = acknowledgement(number)
    if is_raised:
        with pytest.raises(OSError, match=os.strerror(number)) as caught:
            find_interface("can0")
        assert caught.value.errno == number
    else:
        assert find_interface("can0") is None
    with pytest.raises(OSError, match=os.strerror(number)):
        restart_controller(1)


@needs_netlink
def test_only_can_interfaces_are_listed_and_none_where_the_kernel_is_silent(
    route: Route, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "lo"), (2, "vcan0")])
    for route.answer, names in ((LOOPBACK, []), (VIRTUAL, ["vcan0", "vcan0"]), (acknowledgement(errno.EPERM), [])):
        assert [one.name for one in can_interfaces()] == names


def test_an_interface_of_which_little_is_known() -> None:
    assert parse_interface(answer()) == CanInterface(
        "",
        9,
        is_can=True,
        is_up=False,
        mtu=0,
        kind="",
        bitrate=None,
        data_bitrate=None,
        state=None,
        restart_ms=0,
        listen_only=False,
        transmit_errors=None,
        receive_errors=None,
        totals=None,
    )
    ethernet = answer(
        attribute(18, attribute(1, b"dummy\0") + attribute(2, attribute(1, bytes(32))) + attribute(3, bytes(24))),
        link_type=1,
        flags=0x41,
    )
    found = parse_interface(ethernet)
    assert found is not None
    assert (found.is_can, found.is_up, found.kind, found.bitrate, found.totals) == (False, True, "dummy", None, None)
    no_settings = attribute(18, attribute(2, attribute(5, struct.pack("=II", 2, 0)) + attribute(4, b"\1\0\0")))
    found = parse_interface(answer(no_settings, flags=0x40))
    assert found is not None
    assert (found.is_up, found.listen_only, found.state) == (False, False, None)
    assert parse_interface(struct.pack("=IHHII", 16, 17, 0, 1, 0) + answer()[16:]) is None, "RTM_DELLINK"


@needs_netlink
def test_a_short_answer_is_no_interface(route: Route) -> None:
    route.answer = acknowledgement(errno.EPERM)[:18]
    assert find_interface("can0") is None


@pytest.mark.parametrize(("flags", "listens"), [(0x01, False), (0x02, True), (0x03, True), (0x20, False)])
def test_listen_only_is_the_second_of_the_control_modes(flags: int, listens: bool) -> None:
    """`CAN_CTRLMODE_...` of linux/can/netlink.h: loopback, listen-only, three samples, one shot, berr, FD."""
    mode = attribute(18, attribute(2, attribute(5, struct.pack("=II", 0xFF, flags))))
    found = parse_interface(answer(mode))
    assert found is not None
    assert found.listen_only == listens


def test_attributes_end_where_a_length_makes_no_sense() -> None:
    empty = struct.pack("=HH", 4, 77)
    wrong = struct.pack("=HH", 3, 77)
    mtu = attribute(4, struct.pack("=I", 72))
    for before, expected in ((b"", 72), (empty, 72), (wrong, 0)):
        found = parse_interface(answer(before, mtu))
        assert found is not None
        assert found.mtu == expected
    assert [CanInterface("x", 1, is_can=True, is_up=True, mtu=mtu).fd for mtu in (16, 71, 72, 73)] == [
        False,
        False,
        True,
        True,
    ]
