"""A client's session in the test's hand: packets in and out in hex, time as the test says."""

from __future__ import annotations

import struct

from msbot_xrce import ClientSession, ClientSessionSettings, ClientState
from msbot_xrce.messages import ObjectVariant
from msbot_xrce.sessions import ClientEvent, Connected, DataReceived

KEY = 0xAABBCCDD
SECOND = 1_000_000_000
LOGIN = "8000000000011000585243450100010faabbccdd8100fc01"
LOGOUT = "81000000030104000002fffe"
WELCOME = "8100000004010b000000585243450100010f00"
PARTICIPANT = ObjectVariant(1, 3, blob=b"\0\1\0\0\5\0\0\0part\0", domain_id=5)


class Bench:
    """A session and its events; packets in and out as hex."""

    def __init__(
        self, *, session_id: int = 0x81, mtu: int = 512, connected: bool = True, **settings: float | int | None
    ) -> None:
        self.now = 0.0
        self.clock_ns = 100 * SECOND
        self.session = ClientSession(
            KEY,
            session_id=session_id,
            mtu=mtu,
            settings=ClientSessionSettings(**settings),  # type: ignore[arg-type]
            epoch_ns=lambda: self.clock_ns,
        )
        self._events: list[ClientEvent] = []
        if connected:
            self.session.connect(0.0)
            self.feed(WELCOME)
            assert self.events() == [Connected()]

    def feed(self, *packets: str) -> list[str]:
        """Let packets arrive; everything that is sent then."""
        for packet in packets:
            self.session.receive_packet(bytes.fromhex(packet), self.now)
            self._take_events()
        return self.pull()

    def pull(self) -> list[str]:
        """Everything that is sent now."""
        return [packet.hex() for packet in self.session.packets_to_send(self.now)]

    def wait(self, seconds: float) -> list[str]:
        """Let time pass, timer by timer; everything that is sent."""
        end, sent = self.now + seconds, self.pull()
        while (at := self.session.timer()) is not None and at <= end:
            self.now = at
            self.session.handle_timer(at)
            self._take_events()
            sent += self.pull()
        self.now = end
        return sent

    def events(self) -> list[ClientEvent]:
        """What happened since the last call."""
        self._take_events()
        events, self._events = self._events, []
        return events

    def state(self) -> ClientState:
        """Where the session stands."""
        return self.session.state

    def _take_events(self) -> None:
        while (event := self.session.next_event()) is not None:
            self._events.append(event)


def head(stream_id: int, sequence_nr: int = 0) -> str:
    """Header of a message in session 0x81."""
    return struct.pack("<BBH", 0x81, stream_id, sequence_nr).hex()


def data(payload: str, *, flags: int = 1, request_id: int = 10) -> str:
    """A DATA submessage for reader 0016."""
    return f"09{flags:02x}" + struct.pack("<H", 4 + len(payload) // 2).hex() + f"{request_id:04x}0016" + payload


def acknack(first: int, bitmap: int = 0, stream_id: int = 0x80) -> str:
    """An ACKNACK message."""
    return head(0) + "0a010500" + struct.pack("<H", first).hex() + f"{bitmap:04x}{stream_id:02x}"


def heartbeat(first: int, last: int, stream_id: int = 0x80) -> str:
    """A HEARTBEAT message."""
    return head(0) + "0b010500" + struct.pack("<HHB", first, last, stream_id).hex()


def fragment(piece: str, *, last: bool = False) -> str:
    """A FRAGMENT submessage."""
    return f"0d{3 if last else 1:02x}" + struct.pack("<H", len(piece) // 2).hex() + piece


def status(stream_id: int, sequence_nr: int, request_id: int, code: int = 0, object_id: int = 0x11) -> str:
    """A STATUS message."""
    return head(stream_id, sequence_nr) + f"05010600{request_id:04x}{object_id:04x}{code:02x}00"


def received(payload: str, stream_id: int = 0x80) -> DataReceived:
    """The event for `data(payload)`."""
    return DataReceived(10, 0x16, bytes.fromhex(payload), stream_id)
