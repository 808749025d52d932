"""The robots on other computers that the user of this one has an access to: an address and an API token for each.

They are in one file that the user alone can read. What is announced in a network never gets into it by itself, and a
token is sent to no other address than the one that it was entered for.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
from collections.abc import Mapping, Sequence
from dataclasses import asdict, field
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from msbot_agent.process.user_folders import make_own_folder, state_folder
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import open_input_text
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST: Final = 300
"""Accesses that are kept."""
_NAMES: Final = frozenset({"address", "token", "robot", "serial_number", "certificate"})


@dataclass(frozen=True, slots=True)
class RemoteAccess:
    """What it takes to speak to one master elsewhere."""

    address: str
    """Of its page, as `http://192.168.1.20:8080`."""
    token: str = field(repr=False)
    robot: str
    serial_number: str
    """Who answered there when the access was entered."""
    certificate: str = field(default="", repr=False)
    """PEM: the only certificate that is trusted there; empty: those that this computer trusts."""


class RemoteAccessFile:
    """The file with them.

    Args:
        folder: where it is; None: the user's state folder.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder

    @property
    def path(self) -> Path:
        """Where it is."""
        return (self._folder or state_folder()) / "class.json"

    def all(self) -> list[RemoteAccess]:
        """All accesses, by address.

        Raises:
            ConfigError: the file cannot be read, makes no sense, or others can read it.
        """
        try:
            with open_input_text(self.path) as file:
                if os.name == "posix" and stat.S_IMODE(os.fstat(file.fileno()).st_mode) & 0o077:
                    raise ConfigError(
                        said("{path} has API tokens, and others can read it: chmod 600 {path}", path=str(self.path))
                    )
                return sorted((_access(one) for one in json.load(file)), key=lambda access: access.address)
        except FileNotFoundError:
            return []
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ConfigError(
                said(
                    "cannot read which robots are in the class, {path}: {error}; move it away",
                    path=str(self.path),
                    error=str(error),
                )
            ) from error

    def add(self, access: RemoteAccess) -> None:
        """Add an access, in place of another one for that address.

        Raises:
            ConfigError: it cannot be written, or there are too many.
        """
        others = [one for one in self.all() if one.address != access.address]
        if len(others) >= MOST:
            raise ConfigError(said("a class has accesses to at most {most} robots", most=MOST))
        self._write([*others, access])

    def take_away(self, access: RemoteAccess) -> None:
        """Remove an access.

        Raises:
            ConfigError: it cannot be written.
        """
        self._write([one for one in self.all() if one.address != access.address])

    def _write(self, accesses: Sequence[RemoteAccess]) -> None:
        new = self.path.with_suffix(".new")
        try:
            make_own_folder(self.path.parent)
            with contextlib.suppress(FileNotFoundError):
                new.unlink()
            number = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(number, "w", encoding="utf-8") as file:
                json.dump([asdict(one) for one in accesses], file)
            new.replace(self.path)
        except OSError as error:
            raise ConfigError(f"cannot write down who is in the class, {self.path}: {error.strerror}") from error


def _access(entry: Mapping[str, object]) -> RemoteAccess:
    if not isinstance(entry, dict) or set(entry) != _NAMES or not all(isinstance(one, str) for one in entry.values()):
        raise ValueError("an entry is no access")
    return RemoteAccess(**entry)


def page_address(text: str) -> str:
    """The address of a page in one spelling: `http://HOST:PORT` or `https://HOST:PORT`.

    Raises:
        ConfigError: it is none.
    """
    try:
        found = urlsplit(text if "://" in text else f"http://{text}")
        host, port = found.hostname or "", found.port
    except ValueError:
        found, host, port = urlsplit(""), "", None
    if (
        found.scheme not in ("http", "https")
        or not host
        or found.path not in ("", "/")
        or found.query
        or found.username
    ):
        raise ConfigError(said("{text!r} is no address of a page: it is like http://192.168.1.20:8080", text=text))
    shown = f"[{host}]" if ":" in host else host
    return f"{found.scheme}://{shown}:{port or (443 if found.scheme == 'https' else 80)}"
