"""Passes samples of any type through Cyclone DDS as octets; only the name of the type is known here.

A topic is made with the descriptor of an empty type. Samples never go through that type: they are handed over and taken
in serialised form. They begin with the encapsulation header of CDR, little endian (DDSI-RTPS 2.3 §10.2), whose last two
bits say how many octets of padding follow the body. No description of the type is announced, so every peer that knows
the type by the same name is matched, unless it insists on comparing descriptions.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, byref, c_uint32, c_void_p
from struct import Struct

from msbot_agent.space.dds.libddsc import ANY_STATE, DATA, DdsLibrary, IoVec, SampleInfo, TopicDescriptor
from msbot_xrce.errors import ConfigError, RemoteProtocolError

BATCH = 64
"""Samples taken in one call."""

_HEADERS = tuple(bytes((0, 1, 0, padding)) for padding in range(4))
_PADDING = (b"", b"\0", b"\0\0", b"\0\0\0")
_HEADER_SIZE = 4
_SCRATCH = 0x10000

_RESTRICT_REPRESENTATION = 1 << 7
_XCDR1 = 1 << 0
_EMPTY_ARRAY_OF_OCTETS = (c_uint32 * 4)(1 << 24 | 8 << 16 | 1 << 8, 0, 0, 0)
"""`octet[0]` at offset 0, and the end (ddsc/dds_opcodes.h): the least that the library accepts as a type."""

_VALID, _PUBLICATION = SampleInfo.valid_data.offset, SampleInfo.publication.offset
_INFO = Struct(f"={_VALID}x?{_PUBLICATION - _VALID - 1}xQ{ctypes.sizeof(SampleInfo) - _PUBLICATION - 8}x")
"""What is needed of a `SampleInfo`: whether there is a value, and the handle of its writer."""

_TYPE_IN_SAMPLE = 24
"""Where a serialised sample of version 0.10 keeps its type: behind operations, hash, reference count and kind."""


def descriptor(type_name: str) -> TopicDescriptor:
    """The descriptor for a topic with that type name."""
    return TopicDescriptor(
        size=1,
        align=1,
        flags=_RESTRICT_REPRESENTATION,
        type_name=type_name.encode(),
        op_count=2,
        ops=ctypes.cast(_EMPTY_ARRAY_OF_OCTETS, POINTER(c_uint32)),
        meta=b"",
        representations=_XCDR1,
    )


class Serialiser:
    """Turns octets into the library's samples and back; for use in one thread."""

    def __init__(self, library: DdsLibrary) -> None:
        self._quick = library.quick
        self._octets = IoVec()
        self._octets_at = byref(self._octets)
        self._samples = (c_void_p * BATCH)()
        self._infos = (SampleInfo * BATCH)()
        self._info_octets = memoryview(self._infos).cast("B")
        self._scratch = ctypes.create_string_buffer(_SCRATCH)
        self._view = memoryview(self._scratch).cast("B")

    def write(self, writer: int, sample_type: int, body: bytes) -> int:
        """Write a body of CDR; returns the library's return code.

        Raises:
            RemoteProtocolError: the library does not accept it.
        """
        padding = -len(body) & 3
        octets = _HEADERS[padding] + body + _PADDING[padding]
        size = len(octets)
        where = self._octets
        where.base = octets
        where.length = size
        quick = self._quick
        sample = quick.ddsi_serdata_from_ser_iov(sample_type, DATA, 1, self._octets_at, size)
        if not sample:
            raise RemoteProtocolError(f"DDS does not take a sample of {len(body)} bytes")
        code: int = quick.dds_writecdr(writer, sample)
        return code

    def take(self, reader: int, most: int = BATCH) -> list[tuple[int, bytes]] | None:
        """Up to `most` samples, `BATCH` at most: (handle of the writer, body of CDR); None when there is nothing.

        Entries that report the end of a writer have no body and are left out, so the list may be empty.
        """
        quick = self._quick
        samples, infos = self._samples, self._infos
        count = quick.dds_takecdr(reader, samples, min(most, BATCH), infos, ANY_STATE)
        if count <= 0:
            return None
        size_of, copy, release = quick.ddsi_serdata_size, quick.ddsi_serdata_to_ser, quick.ddsi_serdata_unref
        scratch, view = self._scratch, self._view
        room = len(view)
        taken = []
        # Both arrays are read at once: element by element, ctypes makes an object for each.
        states = _INFO.iter_unpack(self._info_octets[: count * _INFO.size])
        for sample, (is_valid, publication) in zip(samples[:count], states, strict=True):
            if is_valid:
                size = size_of(sample)
                if size > room:
                    self._grow(size)
                    scratch, view, room = self._scratch, self._view, size
                copy(sample, 0, size, scratch)
                taken.append((publication, view[_HEADER_SIZE : size - (view[3] & 3)].tobytes()))
            release(sample)
        return taken

    def _grow(self, size: int) -> None:
        self._scratch = ctypes.create_string_buffer(size)
        self._view = memoryview(self._scratch).cast("B")


def type_of(library: DdsLibrary, entity: int) -> int:
    """The library's internal type of a topic, for `Serialiser.write` (since version 11).

    Raises:
        ConfigError: the library does not report it.
    """
    found = c_void_p()
    code = library.calls.dds_get_entity_sertype(entity, byref(found))
    if code < 0 or not found.value:
        raise ConfigError(f"DDS: {library.path} does not tell the type of a topic ({library.describe(code)})")
    return found.value


def type_by_sample(library: DdsLibrary, topic: int, participant: int, qos: int) -> int:
    """The same for version 0.10: read from a sample that a private writer gives to a private reader, both with `qos`.

    Raises:
        ConfigError: the sample does not arrive.
    """
    calls = library.calls
    reader = calls.dds_create_reader(participant, topic, qos, None)
    writer = calls.dds_create_writer(participant, topic, qos, None)
    samples, infos = (c_void_p * 1)(), (SampleInfo * 1)()
    calls.dds_write(writer, ctypes.create_string_buffer(8))
    count = calls.dds_takecdr(reader, samples, 1, infos, ANY_STATE)
    found = None
    if count == 1 and samples[0]:
        found = c_void_p.from_address(samples[0] + _TYPE_IN_SAMPLE).value
        calls.ddsi_serdata_unref(samples[0])
    calls.dds_delete(writer)
    calls.dds_delete(reader)
    if not found:
        raise ConfigError(f"DDS: a sample does not come back from {library.path} ({library.describe(count)})")
    return found
