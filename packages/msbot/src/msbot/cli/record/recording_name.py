"""Names of recordings that a command writes."""

from __future__ import annotations

from pathlib import Path

from msbot_xrce.errors import ConfigError

SUFFIX = ".mcap"


def recording_name(file: Path) -> Path:
    """The file of that name: a name without an ending gets that of recordings.

    Raises:
        ConfigError: it has the ending of something else, which a recording is not, or is a folder.
    """
    if not file.name or file.name == ".." or file.is_dir():
        raise ConfigError(f"{file} is a folder: name a file in it, for example {file / 'lesson'}{SUFFIX}")
    if file.suffix.lower() == SUFFIX:
        return file
    if file.suffix:
        raise ConfigError(
            f"{file}: a recording is an MCAP file, and its name ends in {SUFFIX}: {file.with_suffix(SUFFIX)} "
            "(tables are made of it by `msbot log export`)"
        )
    return file.with_name(f"{file.name}{SUFFIX}")
