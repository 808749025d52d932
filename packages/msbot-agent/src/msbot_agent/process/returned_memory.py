"""Has the C library give large pieces of memory back to the system as soon as they are free.

glibc takes pieces from 128 kB up from the system one by one, and gives each back when it is free. But whenever such a
piece is freed it raises that bound to the piece's size, and from then on keeps what is smaller in its heap, where one
small piece that is still used holds everything below it: after a flood of connections by TLS (256 kB each in asyncio)
the process would stay as large as it was at worst. With a bound that somebody has set it does not raise it.
"""

from __future__ import annotations

import ctypes
import sys

LARGE = 128 * 1024
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3


def give_memory_back() -> None:
    """Do so in this process from now on; nothing where the C library is another one."""
    if sys.platform != "linux":
        return
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_M_MMAP_THRESHOLD, LARGE)
        set_option(_M_TRIM_THRESHOLD, LARGE)
