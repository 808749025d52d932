"""A file that is written whole or not at all, and is its owner's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

OWNER_ONLY: Final = 0o600


def new_file(target: Path) -> BinaryIO:
    """Create a recording, for its owner's eyes only: it contains what people did.

    Raises:
        FileExistsError: there is one.
        OSError: it cannot be written.
    """
    descriptor = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), OWNER_ONLY)
    return os.fdopen(descriptor, "wb")


@contextmanager
def whole_or_none(target: Path) -> Iterator[None]:
    """Remove the new file again when writing it fails: nobody shall take its beginning for all of it.

    Outside of `open`, so that the file is closed by then. A file that somebody else made meanwhile is left alone.
    """
    try:
        yield
    except FileExistsError:
        raise
    except BaseException:  # Ctrl-C, too
        target.unlink(missing_ok=True)
        raise
