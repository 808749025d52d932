"""Serial lines without a port: who is on them, and what becomes of them."""

from __future__ import annotations

import pytest

from msbot_agent.link import Signal
from msbot_agent.link.byte_frames import encode_serial
from msbot_agent.link.serial.serial_line import WRITE_LIMIT, SerialLine, SerialLineServer
from msbot_xrce.errors import LinkDown, LinkFull
from tests.link.ends import End
from tests.link.transports import FakeTransport


class Lines(SerialLineServer):
    """Lines that the test opens."""

    async def run(self) -> None:
        raise NotImplementedError


async def opened(link: SerialLineServer, port: str = "tty") -> tuple[SerialLine, FakeTransport]:
    line = SerialLine(link, port)
    return line, FakeTransport(line)


async def test_little_waits_for_a_slow_line_and_all_its_peers_have_room_together() -> None:
    link = Lines("serial:tty")
    end = End(link)
    line, transport = await opened(link)
    assert transport.limits == (WRITE_LIMIT, 0)
    for address in (1, 2):
        line.data_received(encode_serial(b"x", address, 0))
    line.pause_writing()
    for peer in (("tty", 1), ("tty", 2)):
        assert not link.has_room(peer)
        with pytest.raises(LinkFull, match=rf"serial:tty: tty address {peer[1]} does not take its data"):
            link.send(b"x", peer)
    line.resume_writing()
    assert sorted(str(end.room.get_nowait()) for _ in range(2)) == ["('tty', 1)", "('tty', 2)"]
    link.send(b"\x7e", ("tty", 2))
    assert bytes(transport.written) == encode_serial(b"\x7e", 0, 2)


def test_who_is_on_a_port_answers_for_all_addresses_of_it() -> None:
    link = Lines("serial:tty")
    assert link.origin(("tty", 1)) == link.origin(("tty", 2)) == "tty"
    assert link.origin("other") == "other"


async def test_nothing_is_written_to_a_port_that_is_about_to_close() -> None:
    link = Lines("serial:tty")
    line, transport = await opened(link)
    line.data_received(encode_serial(b"x", 1, 0))
    transport.begin_to_close()
    with pytest.raises(LinkDown, match="there is no connection with tty address 1"):
        link.send(b"x", ("tty", 1))
    assert transport.written == b""


async def test_a_port_that_breaks_is_told_once_for_each_peer() -> None:
    link = Lines("serial:tty")
    end = End(link)
    line, _ = await opened(link)
    for address in (1, 2):
        line.data_received(encode_serial(b"x", address, 0))
    line.connection_lost(OSError(5, "Input/output error"))
    line.connection_lost(None)
    assert await line.closed == "broken: Input/output error"
    told = [end.signals.get_nowait() for _ in range(4)]
    assert [signal for signal, *_ in told] == [Signal.PEER_JOINED] * 2 + [Signal.PEER_GONE] * 2
    assert {words for *_, words in told[2:]} == {"port broken: Input/output error"}
    again, _ = await opened(link)
    assert [end.signals.get_nowait()[:2] for _ in range(2)] == [
        (Signal.PEER_BACK, ("tty", 1)),
        (Signal.PEER_BACK, ("tty", 2)),
    ]
    assert again.known == {("tty", 1), ("tty", 2)}
    assert end.signals.empty()


async def test_a_port_that_was_replaced_meanwhile_takes_nobody_along() -> None:
    link = Lines("serial:tty")
    end = End(link)
    old, _ = await opened(link)
    new, _ = await opened(link)
    new.data_received(encode_serial(b"x", 1, 0))
    old.connection_lost(None)
    assert [end.signals.get_nowait()[0]] == [Signal.PEER_JOINED]
    assert end.signals.empty()
    assert link.has_room(("tty", 1))


async def test_peers_are_described_by_port_and_address() -> None:
    link = Lines("serial:tty")
    assert link.describe(("/dev/ttyUSB0", 7)) == "/dev/ttyUSB0 address 7"
    assert link.describe("who?") == "who?"
