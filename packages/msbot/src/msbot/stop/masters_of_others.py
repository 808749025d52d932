"""Masters of other users of this computer: STOP does not reach them, and whoever says it must know that they run.

Their sockets are closed to others, so they are found as `ps` finds them (Linux): by the words of their processes. What
these say decides nothing; it is told to a person.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from msbot.stop.socket_folders import own_user
from msbot.stop.stop_request import user_words

PROCESSES: Final = Path("/proc")
_COMMANDS: Final = (b"master", b"demo")
_PROGRAM: Final = b"msbot"
_FIRST_WORDS: Final = 4
"""The command is among them: `python -m msbot master`."""
_MOST_SHOWN: Final = 4


def masters_of_others(processes: Path = PROCESSES) -> dict[int, list[int]]:
    """The processes of masters that other users run, by user; empty where the system does not show them.

    Root has no others: its STOP reaches all.
    """
    found: dict[int, list[int]] = defaultdict(list)
    own = own_user()
    if own == 0:
        return found
    for process in processes.glob("[0-9]*"):
        try:
            user = process.stat().st_uid
            words = (process / "cmdline").read_bytes().split(b"\0") if user != own else []
        except OSError:
            continue  # it has ended, or is not to be looked into
        if _is_master(words):
            found[user].append(int(process.name))
    return found


def others_words(found: Mapping[int, Sequence[int]], command: str) -> str:
    """Who runs masters that were not reached, and how to reach them; empty: nobody.

    Args:
        found: from `masters_of_others`.
        command: the command that was to reach them, without `sudo`.
    """
    if not found:
        return ""
    each = []
    for user in sorted(found)[:_MOST_SHOWN]:
        pids = sorted(found[user])
        shown = ", ".join(map(str, pids[:_MOST_SHOWN])) + (" ..." if len(pids) > _MOST_SHOWN else "")
        each.append(f"{user_words(user)} (process {shown})")
    more = " and others" if len(found) > _MOST_SHOWN else ""
    return f"masters of {', '.join(each)}{more} run here: `sudo {command}` reaches them, and so does their page"


def _is_master(words: Sequence[bytes]) -> bool:
    """Whether a process runs `msbot master` or `msbot demo`: by its script, or as `python -m msbot`."""
    first = pairwise(words[:_FIRST_WORDS])
    return any(word in _COMMANDS and before.rpartition(b"/")[2] == _PROGRAM for before, word in first)
