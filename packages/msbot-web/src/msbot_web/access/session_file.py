"""Keeps sessions over a restart of the master, in a file that only the user who runs it can read.

The file holds SHA-256s of the cookies' words, so reading it signs nobody in. It is written in a thread, whole, and put
in place of the old one at once.

How long nobody ran is known by the computer's own seconds as long as it has not been started anew, else by the wall
clock. A file from the future says that the clock was set back: nobody knows how old its sessions are, so they have
ended.

Robots come and go, so the files of all robots of this user are tidied up, too: one that is too old to restore anything
is removed, and there are never more than `MOST_FILES`.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from msbot_agent.process.user_folders import check_owner, make_own_folder, running_folder
from msbot_agent.text.untrusted_input import read_json
from msbot_web.access.accounts import Accounts
from msbot_web.access.clocks import boot_id, since_boot_s
from msbot_web.access.sessions import LONGEST_S, KeptSession
from msbot_xrce.errors import ConfigError

_log = logging.getLogger(__name__)

LARGEST = 1_000_000
"""Octets of a file that is read."""
MOST_FILES = 100
"""Robots whose sign-ins are kept; beyond that, people sign in again at those that have been unused the longest."""


class SessionFile:
    """The sessions of one robot in a file.

    Args:
        accounts: whose sessions.
        path: the file.
        wall_clock: seconds since 1970.
        boot: tells this start of the computer from others; empty: unknown.
        boot_clock: seconds since then.
    """

    def __init__(
        self,
        accounts: Accounts,
        path: Path,
        *,
        wall_clock: Callable[[], float] = time.time,
        boot: Callable[[], str] = boot_id,
        boot_clock: Callable[[], float] = since_boot_s,
    ) -> None:
        self._accounts = accounts
        self._path = path
        self._wall_clock, self._boot, self._boot_clock = wall_clock, boot, boot_clock
        self._written = ""
        self._has_failed = False

    def bring_back(self) -> None:
        """Restore the sessions of the previous run; an invalid file is ignored."""
        try:
            check_owner(self._path.parent)
            if self._path.stat().st_size > LARGEST:
                return
            content = read_json(self._path.read_text("utf-8"))
            away_s = self._away_s(content)
            kept = [_kept(one) for one in content["sessions"]]
            browsers = [(str(digest), str(name)) for digest, name in content["browsers"]]
            ticket_key = bytes.fromhex(content["ticket_key"])
            forward_s = float(content["forward_s"])
        except FileNotFoundError:
            return
        except (OSError, ConfigError, ValueError, KeyError, TypeError, OverflowError) as error:
            _log.warning("the sessions of the run before are not taken over, people sign in again: %s", error)
            return
        if away_s < LONGEST_S and len(ticket_key) == 32:
            self._accounts.ticket_key = ticket_key
            self._accounts.forward_clock.not_before(forward_s)
            self._accounts.browsers.bring_back(one for one in browsers if self._accounts.role_of(one[1]) is not None)
            if away_s < 0.0:
                _log.warning("people sign in again: the computer's clock was set back since they have signed in")
                return
            self._accounts.sessions.bring_back(kept, away_s, self._accounts.role_of, self._accounts.mark_of)

    def _away_s(self, content: dict[str, Any]) -> float:
        """For how long nobody ran; below 0: nobody knows, because the wall clock was set back."""
        boot, boot_s = self._boot(), self._boot_clock() - float(content["boot_s"])
        if boot and boot == content["boot"] and boot_s >= 0.0:
            return boot_s
        return self._wall_clock() - float(content["at"])

    async def tidy_up(self) -> None:
        """Remove what robots have left that nobody can use any more; to be called at the start, after `bring_back`."""
        await asyncio.to_thread(remove_old, self._path.parent, time.time())

    async def save(self) -> None:
        """Write what has changed since the last time."""
        kept = self._accounts.sessions.to_persist(self._accounts.mark_of)
        browsers = self._accounts.browsers.to_persist()
        mark = json.dumps([browsers, sorted((one.key, round(one.idle_s - time.monotonic(), -2)) for one in kept)])
        if mark == self._written:
            return
        content = {
            "at": self._wall_clock(),
            "forward_s": self._accounts.forward_clock.now(),
            "boot": self._boot(),
            "boot_s": self._boot_clock(),
            "ticket_key": self._accounts.ticket_key.hex(),
            "browsers": browsers,
            "sessions": [asdict(one) for one in kept],
        }
        try:
            await asyncio.to_thread(self._write, json.dumps(content))
            self._written, self._has_failed = mark, False
        except (OSError, ConfigError) as error:
            if not self._has_failed:
                _log.warning("sessions are not kept over a restart: %s", error)
            self._has_failed = True

    def _write(self, text: str) -> None:
        make_own_folder(self._path.parent)
        check_owner(self._path.parent)
        new = self._path.with_suffix(".new")
        descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
        new.replace(self._path)


def _kept(one: dict[str, Any]) -> KeptSession:
    return KeptSession(
        str(one["key"]),
        str(one["name"]),
        str(one["csrf"]),
        float(one["age_s"]),
        float(one["idle_s"]),
        str(one["guest_of"]),
        str(one["mark"]),
    )


def remove_old(folder: Path, now_s: float) -> int:
    """Remove files of sessions that nobody can use any more, and the oldest of those that are too many.

    Args:
        folder: where they are; another user's is left alone.
        now_s: seconds since 1970, as files are dated.

    Returns:
        How many were removed.
    """
    if not folder.is_dir():
        return 0
    try:
        check_owner(folder)
        dated = sorted(((_changed_at(path), path) for path in folder.glob("sessions-*.*")), reverse=True)
        removed = 0
        for place, (at_s, path) in enumerate(dated):
            if place >= MOST_FILES or now_s - at_s >= LONGEST_S:
                path.unlink(missing_ok=True)
                removed += 1
    except (OSError, ConfigError) as error:
        _log.warning("old files of sessions stay where they are: %s", error)
        return 0
    return removed


def _changed_at(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # another master has just removed it
        return 0.0


def session_file(accounts: Accounts, mark: str) -> SessionFile:
    """The file for the robot of that mark: letters and digits."""
    return SessionFile(accounts, running_folder() / f"sessions-{mark}.json")
