"""Framings that turn a byte stream into packets: serial (HDLC-like) and TCP (length prefix). Pure.

Serial (OMG DDS-XRCE, serial transport): `7E src dst len_lo len_hi payload crc_lo crc_hi`; every octet 7E or 7D after
the flag is sent as 7D, octet ^ 20. The length counts the payload before escaping. CRC-16/ARC over the unescaped
payload. There is no end flag and no time-out: the next 7E ends whatever was going on.

TCP (eProsima): 16-bit little-endian length, then the packet; a length of 0 is skipped.
"""

from __future__ import annotations

from dataclasses import field

from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

FLAG = 0x7E
ESCAPE = 0x7D
ESCAPE_XOR = 0x20
MAX_PACKET = 0xFFFF


def _crc_table() -> tuple[int, ...]:
    table = []
    for octet in range(256):
        crc = octet
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
        table.append(crc)
    return tuple(table)


_CRC_TABLE = _crc_table()


def crc16_arc(data: bytes) -> int:
    """CRC-16/ARC: polynomial 0x8005 reflected, initial value 0, no final inversion; check value 0xBB3D."""
    crc = 0
    for octet in data:
        crc = (crc >> 8) ^ _CRC_TABLE[(crc ^ octet) & 0xFF]
    return crc


def encode_serial(packet: bytes, source: int, destination: int) -> bytes:
    """One serial frame that carries `packet` (1 to 65535 bytes) between two addresses (0 to 255)."""
    if not 0 < len(packet) <= MAX_PACKET:
        raise ValueError(f"a serial frame carries 1 to {MAX_PACKET} bytes, not {len(packet)}")
    body = bytes((source, destination)) + len(packet).to_bytes(2, "little") + packet
    body += crc16_arc(packet).to_bytes(2, "little")
    escaped = body.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")
    return b"\x7e" + escaped


_HEADER_SIZE = 4
_CRC_SIZE = 2


@dataclass(slots=True)
class SerialReceiver:
    """Takes octets as they come and returns whole packets for one address."""

    address: int
    """Own address; frames for others are skipped."""
    max_packet: int = MAX_PACKET
    """Largest packet in bytes; longer frames are dropped."""
    dropped: Tally = field(default_factory=Tally)
    """Frames that were not delivered, by reason."""
    _frame: bytearray | None = None
    _escaped: bool = False

    def receive(self, data: bytes) -> list[tuple[int, bytes]]:
        """Feed octets; returns `(source address, packet)` for each frame that is now complete."""
        packets: list[tuple[int, bytes]] = []
        pieces = data.split(b"\x7e")
        self._append(pieces[0], packets)
        for piece in pieces[1:]:
            if self._frame:
                self.dropped.count("frame cut short")
            self._frame = bytearray()
            self._escaped = False
            self._append(piece, packets)
        return packets

    def _append(self, piece: bytes, packets: list[tuple[int, bytes]]) -> None:
        frame = self._frame
        if frame is None or not piece:
            return
        frame += self._unescape(piece)
        if len(frame) < _HEADER_SIZE:
            return
        size = frame[2] | frame[3] << 8
        if frame[1] != self.address:
            return self._end("for another address")
        if size > self.max_packet:
            return self._end("longer than the limit")
        if len(frame) < _HEADER_SIZE + size + _CRC_SIZE:
            return None
        packet = bytes(frame[_HEADER_SIZE : _HEADER_SIZE + size])
        crc = frame[_HEADER_SIZE + size] | frame[_HEADER_SIZE + size + 1] << 8
        if crc != crc16_arc(packet):
            return self._end("wrong check sum")
        self._frame = None
        packets.append((frame[0], packet))
        return None

    def _unescape(self, piece: bytes) -> bytes:
        if not self._escaped and ESCAPE not in piece:
            return piece
        plain = bytearray()
        for octet in piece:
            if self._escaped:
                plain.append(octet ^ ESCAPE_XOR)
                self._escaped = False
            elif octet == ESCAPE:
                self._escaped = True
            else:
                plain.append(octet)
        return bytes(plain)

    def _end(self, reason: str) -> None:
        self.dropped.count(reason)
        self._frame = None


def encode_tcp(packet: bytes) -> bytes:
    """One packet (at most 65535 bytes) with its length in front."""
    if len(packet) > MAX_PACKET:
        raise ValueError(f"a TCP frame carries at most {MAX_PACKET} bytes, not {len(packet)}")
    return len(packet).to_bytes(2, "little") + packet


@dataclass(slots=True)
class TcpReceiver:
    """Cuts a TCP stream into packets, however it is chunked."""

    _buffer: bytearray = field(default_factory=bytearray)

    def receive(self, data: bytes) -> list[bytes]:
        """Feed octets; returns the packets that are now complete."""
        buffer = self._buffer
        buffer += data
        packets: list[bytes] = []
        offset = 0
        while len(buffer) - offset >= 2:
            size = buffer[offset] | buffer[offset + 1] << 8
            if len(buffer) - offset - 2 < size:
                break
            if size:
                packets.append(bytes(buffer[offset + 2 : offset + 2 + size]))
            offset += 2 + size
        del buffer[:offset]
        return packets
