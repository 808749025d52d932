"""What a parser is to the fuzzer, and what parsers need."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Parser:
    """One of them."""

    read: Callable[[bytes], Iterable[str]]
    """Reads octets, and tells what was seen; may raise what MsBOT raises on purpose."""
    samples: Callable[[], Iterable[bytes]]
    """What is right."""


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="msbot-fuzz-")


def file_of(octets: bytes, suffix: str, *, folder: str = "") -> Path:
    """A file with that content, which only this user can read."""
    place = Path(_folder().name) / folder
    place.mkdir(mode=0o700, exist_ok=True)
    path = place / f"fuzz{suffix}"
    path.write_bytes(octets)
    return path


def lines(*texts: str) -> Callable[[], Iterable[bytes]]:
    """Samples that are texts."""
    return lambda: [text.encode() for text in texts]
