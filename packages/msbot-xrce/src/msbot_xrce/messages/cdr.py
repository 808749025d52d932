"""Classic CDR (XCDR version 1), the way every structure of DDS-XRCE is written.

Each number is at a multiple of its own size (1, 2, 4 or 8), counted from an origin: the first octet of the message for
submessages, of the blob for BINARY representations, of the sample for user data. A string has its length with the
closing NUL in front, a sequence its count, an optional member a boolean (OMG CORBA 3 §9.3, XRCE 1.0 §8.3; seen on the
wire). Padding is written as zeros and ignored when reading.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError

_CODES = ("H", "I", "Q", "h", "i", "q", "f", "d")
_LITTLE = {code: struct.Struct("<" + code) for code in _CODES}
_BIG = {code: struct.Struct(">" + code) for code in _CODES}


class CdrWriter:
    """Writes values one after the other; `finish` returns the octets.

    Every method raises LocalProtocolError for a value that cannot be represented on the wire.
    """

    __slots__ = ("_buffer", "_structs")

    def __init__(self, little_endian: bool = True) -> None:
        self._buffer = bytearray()
        self._structs = _LITTLE if little_endian else _BIG

    def u8(self, value: int) -> None:
        """Write an octet."""
        try:
            self._buffer.append(value)
        except ValueError:
            raise _misfit(value, "a byte") from None

    def i8(self, value: int) -> None:
        """Write a signed octet."""
        if not -128 <= value <= 127:
            raise _misfit(value, "a signed byte")
        self._buffer.append(value & 0xFF)

    def u16(self, value: int) -> None:
        """Write an unsigned number of 16 bits."""
        self._number("H", 2, value)

    def u32(self, value: int) -> None:
        """Write an unsigned number of 32 bits."""
        self._number("I", 4, value)

    def u64(self, value: int) -> None:
        """Write an unsigned number of 64 bits."""
        self._number("Q", 8, value)

    def i16(self, value: int) -> None:
        """Write a signed number of 16 bits."""
        self._number("h", 2, value)

    def i32(self, value: int) -> None:
        """Write a signed number of 32 bits."""
        self._number("i", 4, value)

    def i64(self, value: int) -> None:
        """Write a signed number of 64 bits."""
        self._number("q", 8, value)

    def f32(self, value: float) -> None:
        """Write a float of 32 bits; a value it cannot hold exactly is rounded."""
        self._number("f", 4, value)

    def f64(self, value: float) -> None:
        """Write a float of 64 bits."""
        self._number("d", 8, value)

    def boolean(self, value: bool) -> None:
        """Write a boolean: one octet, 0 or 1."""
        self._buffer.append(1 if value else 0)

    def string(self, value: str) -> None:
        """Write a text as UTF-8 with its length and a NUL."""
        try:
            octets = value.encode()
        except UnicodeEncodeError:
            raise LocalProtocolError(f"{value!r} cannot be sent: it has no UTF-8 form") from None
        if 0 in octets:
            raise LocalProtocolError(f"{value!r} cannot be sent: NUL ends a text on the wire")
        self.u32(len(octets) + 1)
        self._buffer += octets
        self._buffer.append(0)

    def octets(self, value: bytes) -> None:
        """Write octets as they are: no length, no alignment."""
        self._buffer += value

    def octet_sequence(self, value: bytes) -> None:
        """Write a count of octets, then the octets."""
        self.u32(len(value))
        self._buffer += value

    def numbers(self, code: str, values: Sequence[float]) -> None:
        """Write numbers of one kind, given by its code in a `struct` format; an empty sequence writes nothing."""
        if not values:
            return
        self.align(struct.calcsize(f"<{code}"))
        try:
            self._buffer += struct.pack(f"{'<' if self._structs is _LITTLE else '>'}{len(values)}{code}", *values)
        except (struct.error, OverflowError):
            raise LocalProtocolError(f"one of {len(values)} numbers cannot be sent in its width") from None

    def align(self, size: int) -> None:
        """Write zeros up to a multiple of `size` (1, 2, 4 or 8)."""
        padding = -len(self._buffer) & (size - 1)
        if padding:
            self._buffer += bytes(padding)

    def finish(self) -> bytes:
        """Everything written so far."""
        return bytes(self._buffer)

    def _number(self, code: str, size: int, value: float) -> None:
        buffer = self._buffer
        padding = -len(buffer) & (size - 1)
        if padding:
            buffer += bytes(padding)
        try:
            buffer += self._structs[code].pack(value)
        except (struct.error, OverflowError):
            raise _misfit(value, f"a number of {size * 8} bits") from None


class CdrReader:
    """Reads values one after the other from part of some octets.

    Every method raises RemoteProtocolError when the value is incomplete or makes no sense.
    """

    __slots__ = ("_data", "_end", "_origin", "_structs", "offset")

    def __init__(
        self,
        data: bytes,
        offset: int = 0,
        end: int | None = None,
        *,
        origin: int | None = None,
        little_endian: bool = True,
    ) -> None:
        """Read from `offset` up to `end` (default: all of it); alignment counts from `origin` (default: `offset`)."""
        self._data = data
        self._end = len(data) if end is None else min(end, len(data))
        self._origin = offset if origin is None else origin
        self._structs = _LITTLE if little_endian else _BIG
        self.offset = offset
        """Where the next value is read, before alignment."""

    @property
    def remaining(self) -> int:
        """Octets not read yet."""
        return self._end - self.offset

    def u8(self) -> int:
        """Read an octet."""
        offset = self.offset
        if offset >= self._end:
            raise self._overrun(1)
        self.offset = offset + 1
        return self._data[offset]

    def i8(self) -> int:
        """Read a signed octet."""
        value = self.u8()
        return value - 256 if value > 127 else value

    def u16(self) -> int:
        """Read an unsigned number of 16 bits."""
        return self._integer("H", 2)

    def u32(self) -> int:
        """Read an unsigned number of 32 bits."""
        return self._integer("I", 4)

    def u64(self) -> int:
        """Read an unsigned number of 64 bits."""
        return self._integer("Q", 8)

    def i16(self) -> int:
        """Read a signed number of 16 bits."""
        return self._integer("h", 2)

    def i32(self) -> int:
        """Read a signed number of 32 bits."""
        return self._integer("i", 4)

    def i64(self) -> int:
        """Read a signed number of 64 bits."""
        return self._integer("q", 8)

    def f32(self) -> float:
        """Read a float of 32 bits."""
        (value,) = self._structs["f"].unpack_from(self._data, self._place(4))
        return float(value)

    def f64(self) -> float:
        """Read a float of 64 bits."""
        (value,) = self._structs["d"].unpack_from(self._data, self._place(8))
        return float(value)

    def boolean(self) -> bool:
        """Read a boolean; any octet but 0 and 1 is refused (the genuine agent aborts there)."""
        value = self.u8()
        if value > 1:
            raise RemoteProtocolError(f"a boolean is {value}: only 0 and 1 are allowed")
        return value == 1

    def string(self) -> str:
        """Read a text; a length of 0 counts as an empty one, as in the genuine agent."""
        length = self.u32()
        if length == 0:
            return ""
        octets = self.octets(length)
        if octets[-1] != 0:
            raise RemoteProtocolError("a text does not end with NUL")
        if octets.find(0) != length - 1:
            raise RemoteProtocolError("a text has a NUL inside")
        try:
            return octets[:-1].decode()
        except UnicodeDecodeError:
            raise RemoteProtocolError("a text is not UTF-8") from None

    def octets(self, count: int) -> bytes:
        """Read `count` octets as they are."""
        offset = self.offset
        if count > self._end - offset:
            raise self._overrun(count)
        self.offset = offset + count
        return self._data[offset : offset + count]

    def octet_sequence(self) -> bytes:
        """Read a count of octets, then the octets."""
        return self.octets(self.u32())

    def numbers(self, code: str, count: int) -> list[float]:
        """Read several numbers of one kind, given by its code in a `struct` format."""
        size = struct.calcsize(f"<{code}")
        if count == 0:
            return []
        start = self.offset + (-(self.offset - self._origin) & (size - 1))
        if start + count * size > self._end:
            raise self._overrun(count * size)
        self.offset = start + count * size
        return list(struct.unpack_from(f"{'<' if self._structs is _LITTLE else '>'}{count}{code}", self._data, start))

    def align(self, size: int) -> None:
        """Skip to the next multiple of `size` (1, 2, 4 or 8)."""
        self.offset += -(self.offset - self._origin) & (size - 1)

    def _integer(self, code: str, size: int) -> int:
        value: int = self._structs[code].unpack_from(self._data, self._place(size))[0]
        return value

    def _place(self, size: int) -> int:
        offset = self.offset
        offset += -(offset - self._origin) & (size - 1)
        if offset + size > self._end:
            raise self._overrun(size)
        self.offset = offset + size
        return offset

    def _overrun(self, needed: int) -> RemoteProtocolError:
        return RemoteProtocolError(f"{needed} bytes are needed where {max(self.remaining, 0)} are left")


def _misfit(value: object, what: str) -> LocalProtocolError:
    return LocalProtocolError(f"{value!r} cannot be sent as {what}")
