"""Files that a power cut leaves whole: the old one or the new one."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Be the only one of the card's programs that reads a file there to write it anew."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def keep(path: Path, content: bytes, mode: int = 0o600) -> None:
    """Write a file so that it is on the disk when this returns."""
    growing = path.with_name(path.name + ".new")
    descriptor = os.open(growing, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    growing.chmod(mode)
    growing.replace(path)
    sync_folder(path.parent)


def remove(path: Path) -> None:
    """Remove a file for good."""
    path.unlink(missing_ok=True)
    sync_folder(path.parent)


def wipe(path: Path) -> None:
    """Remove a file whose text is secret: first its lines are empty, because FAT leaves removed text where it was."""
    with path.open("r+b", buffering=0) as file:
        file.write(b"\n" * os.fstat(file.fileno()).st_size)
        os.fsync(file.fileno())
    remove(path)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def read(path: Path, most: int) -> bytes | None:
    """A file up to one octet more than `most`; None: there is none."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        return file.read(most + 1)
