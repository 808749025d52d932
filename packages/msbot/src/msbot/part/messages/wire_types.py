"""The types a message field may have, and how each one is written as CDR.

CDR here is the classic one (XCDR version 1), little endian, every number aligned to its own size counted from the
first octet of the message. WRITE_DATA and DATA carry it without an encapsulation header (DDS-XRCE 1.0 §7.3, seen on
the wire).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from enum import IntEnum
from typing import Annotated, Any, get_args, get_origin

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import CdrReader, CdrWriter


@dataclass(frozen=True, slots=True)
class Number:
    """Marks the width of a number in an annotation; use the ready names (`uint8`, `float32`, ...)."""

    word: str
    """Name of the type, as in `uint8`."""


@dataclass(frozen=True, slots=True)
class Octets:
    """Makes `bytes` a fixed array: `uid: Annotated[bytes, Octets(8)]` is `octet uid[8]`."""

    length: int
    """Exact number of octets, at least 1."""


@dataclass(frozen=True, slots=True)
class AtMost:
    """Bounds a `str`, `bytes` or list: `name: Annotated[str, AtMost(254)]` is `string<254>`."""

    length: int
    """Largest number of UTF-8 octets, octets or elements."""


uint8 = Annotated[int, Number("uint8")]
uint16 = Annotated[int, Number("uint16")]
uint32 = Annotated[int, Number("uint32")]
uint64 = Annotated[int, Number("uint64")]
int8 = Annotated[int, Number("int8")]
int16 = Annotated[int, Number("int16")]
int32 = Annotated[int, Number("int32")]
int64 = Annotated[int, Number("int64")]
float32 = Annotated[float, Number("float32")]
float64 = Annotated[float, Number("float64")]


@dataclass(frozen=True, slots=True)
class Exactly:
    """Makes a list a fixed array: `covariance: Annotated[list[float64], Exactly(9)]` is `double covariance[9]`."""

    length: int
    """Exact number of elements, at least 1."""


FLOAT32_MAX = 3.4028234663852886e38


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """How one type is checked, written and read."""

    word: str
    """The type as a person writes it: `uint8`, `list[str]`."""
    needs: str
    """What a value must be, in words: `a whole number from 0 to 255`."""
    smallest: int
    """Octets of the shortest value, without padding."""
    zero: Callable[[], object]
    """Makes the value of a field that nobody set."""
    fits: Callable[[object], bool]
    write: Callable[[CdrWriter, Any], None]
    """Writes a value that fits (`fits` has checked it, so its static type is of no use here)."""
    read: Callable[[CdrReader], Any]
    """Reads a value that fits; raises RemoteProtocolError only."""
    fragile: bool = False
    """Whether the value can change in place: defaults are copied for each message."""
    code: str | None = None
    """Of a number or boolean: its code in a `struct` format."""
    kind: str = ""
    """The type as a library file writes it: `uint16[<=64]`; empty: such a type cannot be declared in one."""
    inside: type | None = None
    """Of a message class or an `IntEnum`, or a list of them: the class."""
    element: FieldCodec | None = None
    """Of a list, and of bytes: what is in it."""
    most: int | None = None
    """Elements, octets of a text or of bytes, that it may have; None: any number."""
    is_exact: bool = False
    """Whether it always has so many."""

    def size_fault(self, value: object) -> str:
        """What is wrong with the size of a value of the right kind; empty: nothing, or another kind."""
        if self.most is None or not isinstance(value, str | bytes | list):
            return ""
        size = _size_of(value)
        if size <= self.most and not (self.is_exact and size < self.most):
            return ""
        unit = "elements" if isinstance(value, list) else "bytes"
        return f"must have {'exactly' if self.is_exact else 'at most'} {self.most} {unit}; it has {size}"


RecordCodec = Callable[[object], FieldCodec | None]
"""Returns the codec of a message class, None for anything else."""


def codec_for(annotation: object, record: RecordCodec) -> FieldCodec | None:
    """The codec of a resolved annotation, or None if it has no form on the wire."""
    base, marks = _split(annotation)
    match marks:
        case ():
            return _unbounded(base, record)
        case (Number(word),) if base in (int, float):
            return _NUMBERS[word]
        case (Octets(length),) if base is bytes and length > 0:
            return _octet_array(length)
        case (Exactly(length),) if get_origin(base) is list and length > 0:
            element = codec_for(get_args(base)[0], record)
            return None if element is None or element.smallest == 0 else _array(element, length)
        case (AtMost(length),) if base in (str, bytes) or get_origin(base) is list:
            codec = _unbounded(base, record)
            return None if codec is None else _at_most(codec, length)
    return None


def _split(annotation: object) -> tuple[object, tuple[object, ...]]:
    if get_origin(annotation) is Annotated:
        base, *marks = get_args(annotation)
        return base, tuple(mark for mark in marks if isinstance(mark, Number | Octets | AtMost | Exactly))
    return annotation, ()


def _unbounded(base: object, record: RecordCodec) -> FieldCodec | None:
    if base is bool:
        return _BOOLEAN
    if base is str:
        return _STRING
    if base is bytes:
        return _OCTET_SEQUENCE
    if get_origin(base) is list:
        element = codec_for(get_args(base)[0], record)
        return None if element is None or element.smallest == 0 else _sequence(element)
    if isinstance(base, type) and issubclass(base, IntEnum) and len(base):
        return _enumeration(base)
    return record(base)


def _size_of(value: str | bytes | list[object]) -> int:
    return len(value.encode()) if isinstance(value, str) else len(value)


def _at_most(codec: FieldCodec, limit: int) -> FieldCodec:
    words = f"at most {limit} {'elements' if codec.fragile else 'bytes'}"

    def fits(value: object) -> bool:
        return isinstance(value, str | bytes | list) and codec.fits(value) and _size_of(value) <= limit

    def read(reader: CdrReader) -> object:
        value = codec.read(reader)
        if (size := _size_of(value)) > limit:
            raise RemoteProtocolError(f"a {codec.word} of {size} where {words} are agreed")
        return value

    kind = f"text<={limit}" if codec.kind == "text" else codec.kind.replace("[]", f"[<={limit}]")
    return replace(
        codec,
        word=f"{codec.word} ({words})",
        needs=f"{codec.needs}, {words}",
        fits=fits,
        read=read,
        kind=kind,
        most=limit,
    )


def _integer(
    word: str, size: int, write: Callable[[CdrWriter, int], None], read: Callable[[CdrReader], int]
) -> FieldCodec:
    low, high = (-(1 << (8 * size - 1)), (1 << (8 * size - 1)) - 1) if word[0] == "i" else (0, (1 << 8 * size) - 1)

    def fits(value: object) -> bool:
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high

    code = {1: "b", 2: "h", 4: "i", 8: "q"}[size]
    code = code if word[0] == "i" else code.upper()
    return FieldCodec(word, f"a whole number from {low} to {high}", size, int, fits, write, read, code=code, kind=word)


def _fits_float32(value: object) -> bool:
    if isinstance(value, float):
        return abs(value) <= FLOAT32_MAX or not math.isfinite(value)
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= FLOAT32_MAX


def _fits_float64(value: object) -> bool:
    # A whole number from 2**1024 up cannot become a float at all.
    return isinstance(value, float) or (
        isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1 << 1023
    )


_NUMBERS = {
    "uint8": _integer("uint8", 1, CdrWriter.u8, CdrReader.u8),
    "uint16": _integer("uint16", 2, CdrWriter.u16, CdrReader.u16),
    "uint32": _integer("uint32", 4, CdrWriter.u32, CdrReader.u32),
    "uint64": _integer("uint64", 8, CdrWriter.u64, CdrReader.u64),
    "int8": _integer("int8", 1, CdrWriter.i8, CdrReader.i8),
    "int16": _integer("int16", 2, CdrWriter.i16, CdrReader.i16),
    "int32": _integer("int32", 4, CdrWriter.i32, CdrReader.i32),
    "int64": _integer("int64", 8, CdrWriter.i64, CdrReader.i64),
    "float32": FieldCodec(
        "float32",
        f"a number from -{FLOAT32_MAX} to {FLOAT32_MAX}, or inf or nan",
        4,
        float,
        _fits_float32,
        CdrWriter.f32,
        CdrReader.f32,
        code="f",
        kind="float32",
    ),
    "float64": FieldCodec(
        "float64", "a number", 8, float, _fits_float64, CdrWriter.f64, CdrReader.f64, code="d", kind="float64"
    ),
}

_BOOLEAN = FieldCodec(
    "bool",
    "True or False",
    1,
    bool,
    lambda value: isinstance(value, bool),
    CdrWriter.boolean,
    CdrReader.boolean,
    code="?",
    kind="bool",
)


def _fits_string(value: object) -> bool:
    # NUL ends a string in CDR, and a lone surrogate has no UTF-8 form.
    if not isinstance(value, str) or "\0" in value:
        return False
    return value.isascii() or not any("\ud800" <= character <= "\udfff" for character in value)


_STRING = FieldCodec(
    "str", "a text without NUL characters", 4, str, _fits_string, CdrWriter.string, CdrReader.string, kind="text"
)

_OCTET_SEQUENCE = FieldCodec(
    "bytes",
    "bytes",
    4,
    bytes,
    lambda value: isinstance(value, bytes),
    CdrWriter.octet_sequence,
    CdrReader.octet_sequence,
    kind="uint8[]",
    element=_NUMBERS["uint8"],
)


def _octet_array(length: int) -> FieldCodec:
    def fits(value: object) -> bool:
        return isinstance(value, bytes) and len(value) == length

    def read(reader: CdrReader) -> object:
        return reader.octets(length)

    words = f"exactly {length} bytes"
    return FieldCodec(
        f"octet[{length}]",
        words,
        length,
        lambda: bytes(length),
        fits,
        CdrWriter.octets,
        read,
        kind=f"uint8[{length}]",
        element=_NUMBERS["uint8"],
    )


def _enumeration(kind: type[IntEnum]) -> FieldCodec:
    """An IDL enum: 32 bits in classic CDR (XCDR version 1)."""

    def fits(value: object) -> bool:
        return isinstance(value, kind)

    def read(reader: CdrReader) -> object:
        number = reader.u32()
        try:
            return kind(number)
        except ValueError:
            raise RemoteProtocolError(f"{number} is no {kind.__name__}") from None

    names = ", ".join(f"{kind.__name__}.{member.name}" for member in kind)
    zero = next(iter(kind))
    return FieldCodec(
        kind.__name__,
        f"one of {names}",
        4,
        lambda: zero,
        fits,
        CdrWriter.u32,
        read,
        kind=kind.__name__,
        inside=kind,
    )


def _array(element: FieldCodec, length: int) -> FieldCodec:
    def fits(value: object) -> bool:
        return isinstance(value, list) and len(value) == length and all(map(element.fits, value))

    def write(writer: CdrWriter, value: list[object]) -> None:
        _write_all(writer, element, value)

    def read(reader: CdrReader) -> object:
        return _read_all(reader, element, length)

    needs = f"a list of exactly {length}, each element {element.needs}"
    word = f"list[{element.word}] (exactly {length})"
    return FieldCodec(
        word,
        needs,
        length * element.smallest,
        lambda: [element.zero() for _ in range(length)],
        fits,
        write,
        read,
        fragile=True,
        kind=_list_kind(element, str(length)),
        inside=element.inside,
        element=element,
        most=length,
        is_exact=True,
    )


def _list_kind(element: FieldCodec, length: str) -> str:
    """There are no lists of lists in a library file, as there are none in ROS 2."""
    return f"{element.kind}[{length}]" if element.kind and element.element is None else ""


def _write_all(writer: CdrWriter, element: FieldCodec, values: list[Any]) -> None:
    if element.code is not None:
        writer.numbers(element.code, values)
        return
    for value in values:
        element.write(writer, value)


def _read_all(reader: CdrReader, element: FieldCodec, count: int) -> list[Any]:
    # Checked before the loop, so that four octets cannot make us build a list of four billion elements.
    if count * element.smallest > reader.remaining:
        raise RemoteProtocolError(f"a list of {count} {element.word} in {reader.remaining} bytes")
    if element.code is not None and element.code != "?":
        return reader.numbers(element.code, count)
    return [element.read(reader) for _ in range(count)]


def _sequence(element: FieldCodec) -> FieldCodec:
    def fits(value: object) -> bool:
        return isinstance(value, list) and all(map(element.fits, value))

    def write(writer: CdrWriter, value: list[object]) -> None:
        writer.u32(len(value))
        _write_all(writer, element, value)

    def read(reader: CdrReader) -> object:
        return _read_all(reader, element, reader.u32())

    needs = f"a list, each element {element.needs}"
    return FieldCodec(
        f"list[{element.word}]",
        needs,
        4,
        list,
        fits,
        write,
        read,
        fragile=True,
        kind=_list_kind(element, ""),
        inside=element.inside,
        element=element,
    )
