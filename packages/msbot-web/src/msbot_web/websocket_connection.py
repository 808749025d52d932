"""A WebSocket of the page's server: uvicorn's, with a short way for packets of parts.

uvicorn takes each message through a queue and a task, and stops reading meanwhile. Thirty programs of pupils bring and
get hundreds of packets a second: whoever serves such a connection may have its packets straight from the transport
(`carry`) and give it packets straight (`send_packet`). Only whole binary messages of one frame go that way (RFC 6455,
5.2); all other frames, and whatever is wrong, are left to uvicorn and its library, as on other connections.

Imported when the first WebSocket comes (`nicegui_internals/application.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State

from msbot_agent.link.net import PART_PATH
from msbot_web.live_channel import LIVE_PATH
from msbot_web.part_websocket import PACKETS

try:
    from websockets.speedups import apply_mask
except ImportError:  # there is no compiled form for this computer
    from websockets.utils import apply_mask

if TYPE_CHECKING:
    from uvicorn.config import Config
    from uvicorn.server import ServerState
    from websockets.http11 import Request

MOST_AT_ONCE: Final = 32
"""Frames of one connection that are taken until everything else has its turn."""
_BINARY, _TEXT, _CONTROL, _MASKED = 0x80 | Opcode.BINARY, 0x80 | Opcode.TEXT, 0x80 | Opcode.CLOSE, 0x80
_TWO_MORE, _EIGHT_MORE = 126, 127
"""Lengths that say how many octets of the length follow."""


class WebSocketConnection(WebSocketsSansIOProtocol):
    """See the module's docstring; what is overridden is uvicorn's."""

    def __init__(self, config: Config, server_state: ServerState, app_state: dict[str, Any]) -> None:
        super().__init__(config, server_state, app_state)
        self._take: Callable[[bytes], float] | None = None
        """Takes packets; None: all that comes is the library's."""
        self._unread = bytearray()
        """What has come for `_take`, from the beginning of a frame on."""
        self._is_held = False
        """Whether it waits until more may be taken."""
        self._has_frames = False
        """Whether the library was given frames: it may be within one."""

    def handle_connect(self, event: Request) -> None:
        """A handshake."""
        is_carrier = event.path.partition("?")[0].endswith((LIVE_PATH, PART_PATH))
        if is_carrier:
            # What is live is packed once for all browsers, and packets are short.
            self.conn.available_extensions = []
        super().handle_connect(event)
        if self.response.status_code == 101 and is_carrier:
            self.scope["state"][PACKETS] = self

    # Messages for the application

    def handle_text(self, event: Frame) -> None:
        """The first or only frame of a text."""
        try:
            text = bytes(event.data).decode() if event.fin else None
        except UnicodeDecodeError:
            text = None
        if text is None:
            super().handle_text(event)
        elif not self.close_sent:
            self.queue.put_nowait({"type": "websocket.receive", "text": text})
            if self.queue.qsize() >= self.config.ws_max_queue and not self.read_paused:
                self.read_paused = True
                self.transport.pause_reading()

    # Packets, see `part_websocket.PacketCarrier`

    def carry(self, take: Callable[[bytes], float]) -> None:
        """Give the packets that come to `take`, which says for how many seconds nothing more may be read."""
        if not self._has_frames:
            self._take = take

    def send_packet(self, packet: bytes | str) -> bool:
        """Send a packet, or a text; False: it cannot be sent at once."""
        octets, kind = (packet.encode(), _TEXT) if isinstance(packet, str) else (packet, _BINARY)
        size, conn = len(octets), self.conn
        is_ready = self.writable.is_set() and conn.state is State.OPEN and not conn.extensions
        if not is_ready or size > 0xFFFF:
            return False
        long = size >= _TWO_MORE
        head = bytes((kind, _TWO_MORE, size >> 8, size & 0xFF) if long else (kind, size))
        self.transport.write(head + octets)
        return True

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        if self._take is None:
            self._has_frames = self.handshake_initiated
            super().data_received(data)
            return
        if not self._unread and not self._is_held:
            self._unread += data[self._take_frames(data) :]
            return
        self._unread += data
        if not self._is_held:
            self._go_on()

    def _take_frames(self, octets: bytes | bytearray) -> int:
        """Take what has come, and return how much of it; all is left to the library from what cannot be taken on."""
        at, pause_s, left = 0, 0.0, MOST_AT_ONCE
        while self._take is not None and pause_s <= 0.0 and left:
            frame = _frame_at(octets, at, self.config.ws_max_size)
            if frame is None:
                return at
            left -= 1
            begin, end = frame
            if not end or self.conn.state is not State.OPEN:
                self._take = None
                super().data_received(bytes(octets[at:]))
                return len(octets)
            if octets[at] == _BINARY:
                pause_s = self._take(apply_mask(octets[begin:end], octets[begin - 4 : begin]))
            else:
                super().data_received(bytes(octets[at:end]))
            at = end
        if pause_s > 0.0 or not left:
            self._is_held = True
            self.transport.pause_reading()
            self.loop.call_later(pause_s, self._go_on)
        return at

    def _go_on(self) -> None:
        self._is_held = False
        if self.disconnected:
            self._unread.clear()
            return
        del self._unread[: self._take_frames(self._unread)]
        if not self._is_held:
            self.transport.resume_reading()


def _frame_at(octets: bytes | bytearray, at: int, most: int) -> tuple[int, int] | None:
    """Where the payload of the frame there begins and ends; None: it is not all there yet.

    Ends at 0: it is neither a whole binary message nor a control frame, or is larger than `most`.
    """
    if len(octets) < at + 2:
        return None
    first, second = octets[at], octets[at + 1]
    size, begin = second & ~_MASKED, at + 6
    is_control = first & _CONTROL == _CONTROL and size < _TWO_MORE
    if not second & _MASKED or size == _EIGHT_MORE or (first != _BINARY and not is_control):
        return 0, 0
    if size == _TWO_MORE:
        size, begin = int.from_bytes(octets[at + 2 : at + 4], "big"), at + 8
    if size > most and len(octets) >= begin:
        return 0, 0
    return (begin, begin + size) if len(octets) >= begin + size else None
