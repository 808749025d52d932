"""Imports lgpio without what it does to the current folder.

On import, lgpio makes a pipe `.lgd-nfy0` in the current folder and opens it. In a folder where this user may not write
(a service in /) the import fails; elsewhere the pipe stays behind. So the import runs in a thread whose current folder
is a temporary one; that of the other threads stays as it is.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import tempfile
import threading
from importlib import import_module

CLONE_FS = 0x200
"""unshare(2): this thread gets a current folder of its own."""


def import_lgpio() -> None:
    """Import lgpio if it is there; why it is not, gpiozero says when it wants it."""
    if sys.platform == "linux" and "lgpio" not in sys.modules:
        thread = threading.Thread(target=_in_a_folder_of_its_own, name="import lgpio")
        thread.start()
        thread.join()


def _in_a_folder_of_its_own() -> None:
    with contextlib.suppress(ImportError, OSError), tempfile.TemporaryDirectory(prefix="msbot-") as folder:
        if ctypes.CDLL(None).unshare(CLONE_FS) == 0:  # a container may forbid it
            os.chdir(folder)
        import_module("lgpio")
