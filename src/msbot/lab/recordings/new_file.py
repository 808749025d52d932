"""A file that is written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
