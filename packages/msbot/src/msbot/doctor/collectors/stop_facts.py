"""Facts about the way of `msbot stop`: the folder of its sockets, and STOP groups."""

from __future__ import annotations

import os
import stat

from msbot.doctor.facts import OddFolder, StopFacts
from msbot.doctor.finding import Examined, NotNeeded
from msbot.stop import socket_folders
from msbot.stop.socket_names import own_group
from msbot.stop.stop_request import user_words
from msbot_agent.agent import MASTER, running_processes
from msbot_agent.text.sentence import said


def stop(_patient: Examined) -> StopFacts:
    """The way of `msbot stop`."""
    if not socket_folders.IS_THERE:
        raise NotNeeded(said("this system has no sockets by which `msbot stop` reaches masters"))
    own = socket_folders.own_user()
    name = f"{socket_folders.PREFIX}{own}"
    usual = (f"{socket_folders.USERS_FOLDER}/{own}", socket_folders.SYSTEM_FOLDER, socket_folders.SHARED_FOLDER)
    trouble = ""
    try:
        socket_folders.own_folder().close()
    except OSError as error:
        trouble = error.strerror or type(error).__name__
    groups = {
        f"{one.details.get('robot', '')} {one.details.get('serial_number', '')}": one.details.get("stop_group", "")
        for one in running_processes()
        if one.what == MASTER
    }
    odd = tuple(found for base in usual if (found := _odd(f"{base}/{name}", own)) is not None)
    return StopFacts(trouble=trouble, odd=odd, own_group=own_group(), groups=groups)


def _odd(path: str, own: int) -> OddFolder | None:
    """That folder, if it is there and no master may use it."""
    try:
        info = os.lstat(path)
    except OSError:
        return None
    if not stat.S_ISDIR(info.st_mode):
        return OddFolder(path, is_folder=False, owner="", mode=0)
    if info.st_uid != own:
        return OddFolder(path, is_folder=True, owner=user_words(info.st_uid), mode=info.st_mode & 0o777)
    return OddFolder(path, is_folder=True, owner="", mode=info.st_mode & 0o777) if info.st_mode & 0o077 else None
