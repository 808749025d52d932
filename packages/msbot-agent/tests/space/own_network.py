"""A network for a test with nothing in it but the loopback interface."""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from tests.space.dds.foreign_programs import refuse

NEW_NETWORK = 0x40000000
"""CLONE_NEWNET of unshare(2)."""
_LIBC = ctypes.CDLL(None, use_errno=True)


@contextmanager
def own_network() -> Iterator[None]:
    """This thread, and what it starts, is in a network of its own; the test is skipped where that is not permitted."""
    outside = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    try:
        if _LIBC.unshare(NEW_NETWORK) != 0:
            refuse(f"a network of its own needs root: {os.strerror(ctypes.get_errno())}")
        try:
            subprocess.run(["ip", "link", "set", "lo", "up"], check=True, capture_output=True)
            yield
        finally:
            assert _LIBC.setns(outside, NEW_NETWORK) == 0
    finally:
        os.close(outside)


def open_network() -> int:
    """A network that stays; returns its file descriptor, for `inside`."""
    with own_network():
        return os.open("/proc/thread-self/ns/net", os.O_RDONLY)


@contextmanager
def inside(network: int) -> Iterator[None]:
    """This thread, and what it starts, is in that network."""
    outside = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    try:
        assert _LIBC.setns(network, NEW_NETWORK) == 0
        yield
    finally:
        assert _LIBC.setns(outside, NEW_NETWORK) == 0
        os.close(outside)
