"""Where running agents announce themselves: one small file each, readable only by their user.

A file gives the port of this computer at which the process answers, and the token to present there. It is removed when
the process ends; a file left behind by a killed process is recognised and removed by the next process that looks. A
running process puts its file back when it is gone.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from msbot_agent.process.user_folders import check_owner, is_running, running_folder
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_log = logging.getLogger(__name__)

FORMAT = 1
"""Version of the format of the lines."""
DESCRIBE = "describe"
"""The request that every process answers."""

PREFIX = "status-"


@dataclass(frozen=True, slots=True)
class StatusFile:
    """What is in a file."""

    path: Path
    port: int
    token: str
    pid: int


def status_folder() -> Path:
    """The user's folder for such files (`running_folder`)."""
    return running_folder()


def write_status_file(folder: Path, port: int) -> StatusFile:
    """Write the file of this process, and remove those of dead ones.

    Raises:
        ConfigError: the folder cannot be used, or is not the user's own.
    """
    file = StatusFile(
        folder / f"{PREFIX}{os.getpid()}-{secrets.token_hex(4)}.json", port, secrets.token_hex(16), os.getpid()
    )
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        list(find_status_files(folder))  # finding the files also removes dead ones
        _write(file)
    except OSError as error:
        raise ConfigError(f"cannot write {file.path} ({error.strerror})") from error
    return file


def restore_status_file(file: StatusFile) -> None:
    """Write the file of this process again if somebody has removed it.

    Systems clean their temporary folders, and a process that sees other processes or another network than this one
    (in a container that shares the folder) takes its file for that of a dead one. Failing is for the next time.
    """
    if file.path.exists():
        return
    try:
        file.path.parent.mkdir(mode=0o700, exist_ok=True)
        check_owner(file.path.parent)
        _write(file)
    except (OSError, ConfigError) as error:
        _log.debug("%s is gone and cannot be written: %s", file.path, error)
    else:
        _log.info("%s was gone; it is there again", file.path)


def _write(file: StatusFile) -> None:
    descriptor = os.open(file.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w") as stream:
        stream.write(json.dumps({"port": file.port, "token": file.token, "pid": file.pid}))


def find_status_files(folder: Path) -> Iterator[StatusFile]:
    """The files of processes that still run, oldest first; those of dead ones are removed.

    Raises:
        ConfigError: the folder is not the user's own.
    """
    if not folder.is_dir():
        return
    check_owner(folder)
    for path in sorted(folder.glob(f"{PREFIX}*.json"), key=_written_at):
        try:
            content = read_json(path.read_text())
            file = StatusFile(path, int(content["port"]), str(content["token"]), int(content["pid"]))
        except (OSError, ValueError, KeyError, TypeError, OverflowError):
            continue  # being written, being removed, or not ours
        if is_running(file.pid):
            yield file
        else:
            path.unlink(missing_ok=True)


def _written_at(path: Path) -> tuple[int, str]:
    try:
        return path.lstat().st_mtime_ns, path.name
    except FileNotFoundError:
        return 0, path.name  # removed in the meantime
