"""The partition table of the card: an MBR, which the first program of every Raspberry Pi reads. Pure."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

SECTOR = 512
ALIGNED = 4 << 20
"""Where partitions begin: a multiple of what cards erase at once."""
FAT32_LBA, LINUX = 0x0C, 0x83
MOST = 4
_ENTRY = struct.Struct("<B3sB3sII")
_NO_CHS = b"\xfe\xff\xff"
"""Cylinder, head and sector of what lies beyond what they can say."""


@dataclass(frozen=True, slots=True)
class Partition:
    """A part of the card."""

    kind: int
    """Of the MBR."""
    start: int
    """In octets."""
    size: int
    """In octets."""


def lay_out(kinds_and_sizes: Sequence[tuple[int, int]]) -> list[Partition]:
    """Partitions one behind the other, aligned.

    Args:
        kinds_and_sizes: kind and least size in octets.

    Raises:
        ValueError: an MBR has no place for that many, or one has no size.
    """
    if len(kinds_and_sizes) > MOST:
        raise ValueError(f"an MBR has {MOST} partitions; {len(kinds_and_sizes)} are wanted")
    made, start = [], ALIGNED
    for kind, least in kinds_and_sizes:
        if least <= 0:
            raise ValueError(f"a partition of {least} octets")
        size = -(-least // ALIGNED) * ALIGNED
        made.append(Partition(kind, start, size))
        start += size
    return made


def table(partitions: Sequence[Partition], signature: int) -> bytes:
    """The first sector of the card.

    Args:
        partitions: in the order of their numbers; the first one is what the firmware reads.
        signature: the disk's; Linux names partitions by it (`PARTUUID=SIGNATURE-01`).

    Raises:
        ValueError: they overlap, or one lies where an MBR cannot say.
    """
    entries, end = b"", SECTOR
    for partition in partitions:
        first, count = partition.start // SECTOR, partition.size // SECTOR
        if partition.start < end or partition.start % SECTOR or partition.size % SECTOR:
            raise ValueError(f"a partition at {partition.start} overlaps, or does not begin and end with a sector")
        if first + count > 0xFFFFFFFF:
            raise ValueError("an MBR reaches 2 TB")
        entries += _ENTRY.pack(0, _NO_CHS, partition.kind, _NO_CHS, first, count)
        end = partition.start + partition.size
    return bytes(440) + struct.pack("<IH", signature, 0) + entries.ljust(MOST * _ENTRY.size, b"\0") + b"\x55\xaa"


def read(sector: bytes) -> tuple[int, list[Partition]]:
    """Signature and partitions of a first sector.

    Raises:
        ValueError: it is no MBR.
    """
    if len(sector) < SECTOR or sector[510:512] != b"\x55\xaa":
        raise ValueError("no MBR: its last two octets are not 55 aa")
    found = []
    for number in range(MOST):
        _, _, kind, _, first, count = _ENTRY.unpack_from(sector, 446 + number * _ENTRY.size)
        if kind:
            found.append(Partition(kind, first * SECTOR, count * SECTOR))
    return struct.unpack_from("<I", sector, 440)[0], found
