"""Files that a person names: a name may be that of a device without an end, which nobody can read to its end."""

from __future__ import annotations

from pathlib import Path

from msbot.errors import ConfigError

LARGEST_PEM = 1_000_000
"""Octets of a file with certificates or keys."""


def read_given(path: Path, most: int, what: str) -> bytes:
    """All octets of a file.

    Args:
        path: the name that was given.
        most: octets that such a file has at most.
        what: what it should be, for the sentence: `a program`.

    Raises:
        ConfigError: it has more, which a device without an end has, too.
        OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        octets = stream.read(most + 1)
    if len(octets) > most:
        raise ConfigError(f"{path} is larger than {most:,} octets, or has no end: {what} is not; name another file")
    return octets
