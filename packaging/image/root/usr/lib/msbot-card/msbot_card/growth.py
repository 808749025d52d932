"""Gives the data partition the rest of the card, at the first start. The table of partitions is one sector: a power cut
leaves the old one or the new one, and the file system grows with its journal."""

from __future__ import annotations

import ctypes
import fcntl
import os
import struct
import subprocess
from pathlib import Path

SECTOR = 512
WORTH_IT = 64 << 20
"""Octets; less is not added."""
ALIGNED = 4 << 20
NUMBER = 3
"""Of the data partition, the last one."""
_BLKPG, _BLKPG_RESIZE_PARTITION = 0x1269, 3
_PARTITION = struct.Struct("<qqi64s64s4x")
_ARGUMENT = struct.Struct("@iii4xP")


def grown(sector: bytes, size: int) -> tuple[bytes, int, int] | None:
    """The first sector with a last partition that reaches to the end of the card.

    Args:
        sector: the first sector.
        size: of the card, in octets.

    Returns:
        the sector, start and length of the partition in octets; None: there is nothing worth it.

    Raises:
        ValueError: it is not the table that the card was flashed with.
    """
    if len(sector) != SECTOR or sector[510:] != b"\x55\xaa":
        raise ValueError("the card's first sector is no table of partitions")
    place = 446 + (NUMBER - 1) * 16
    if sector[place + 16 : place + 32] != bytes(16) or sector[place + 4] != 0x83:
        raise ValueError("the data partition is not the last one: the card was divided by somebody else")
    first, count = struct.unpack_from("<II", sector, place + 8)
    wanted = min((size // ALIGNED * ALIGNED) // SECTOR - first, 0xFFFFFFFF - first)
    if (wanted - count) * SECTOR < WORTH_IT:
        return None
    changed = bytearray(sector)
    struct.pack_into("<I", changed, place + 12, wanted)
    return bytes(changed), first * SECTOR, wanted * SECTOR


def grow(device: Path) -> bool:
    """Let a mounted data partition grow, once; returns whether it did.

    Args:
        device: the data partition's, e.g. /dev/mmcblk0p3.

    Raises:
        OSError, ValueError, subprocess.CalledProcessError: it cannot.
    """
    entry = Path("/sys/class/block", device.name).resolve()
    card = Path("/dev", entry.parent.name)
    descriptor = os.open(card, os.O_RDWR | os.O_SYNC)
    try:
        size = os.lseek(descriptor, 0, os.SEEK_END)
        found = grown(os.pread(descriptor, SECTOR, 0), size)
        if found is not None:
            sector, start, length = found
            os.pwrite(descriptor, sector, 0)
            os.fsync(descriptor)
            _tell_kernel(descriptor, start, length)
    finally:
        os.close(descriptor)
    # Also when the table says so already: the power may have gone in between. It does nothing to a whole file system.
    subprocess.run(["/usr/sbin/resize2fs", str(device)], check=True, capture_output=True)
    return found is not None


def _tell_kernel(descriptor: int, start: int, length: int) -> None:
    """Other partitions of the card are mounted, so the kernel is told of this one alone (BLKPG)."""
    partition = _PARTITION.pack(start, length, NUMBER, b"", b"")
    memory = ctypes.create_string_buffer(partition, len(partition))
    argument = _ARGUMENT.pack(_BLKPG_RESIZE_PARTITION, 0, len(partition), ctypes.addressof(memory))
    fcntl.ioctl(descriptor, _BLKPG, argument)
