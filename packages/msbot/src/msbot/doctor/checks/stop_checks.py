"""Whether `msbot stop` reaches the robots: the folder of its sockets, and STOP groups."""

from __future__ import annotations

from collections.abc import Iterator

from msbot.doctor.facts import OddFolder, StopFacts
from msbot.doctor.finding import Finding
from msbot_agent.text.sentence import said

WIRE = said("nothing: this way does not go over a wire")


def check_stop(facts: StopFacts) -> Iterator[Finding]:
    """What keeps `msbot stop` from a robot of this user."""
    if facts.trouble:
        yield Finding(
            "stop-folder",
            "msbot stop",
            said("no folder for the sockets of STOP can be made: {why}", why=facts.trouble),
            said(
                "on Linux masters take a name without a file; elsewhere `msbot stop` does not reach them. The page does"
            ),
            WIRE,
            "msbot doctor --only disk",
        )
    for folder in facts.odd:
        yield Finding(
            "stop-folder-odd",
            folder.path,
            _seen(folder),
            said(
                "masters do not use it, and `msbot stop` does not look into it: a master that was started while the "
                "folder was right is not reached"
            ),
            WIRE,
            _mending(folder),
            must=False,
        )
    for robot, group in facts.groups.items():
        if facts.own_group and group != facts.own_group:
            yield Finding(
                "stop-group",
                robot,
                said(
                    "{robot} is in the STOP group {group}, and this terminal in {own}",
                    robot=robot,
                    group=group or said("(none)"),
                    own=facts.own_group,
                ),
                said("`msbot stop` does not reach it from here"),
                WIRE,
                f"msbot stop --stop-group {group}" if group else "env -u MSBOT_STOP_GROUP msbot stop",
                must=False,
            )


def _seen(folder: OddFolder) -> str:
    if not folder.is_folder:
        return said("{path} is no folder", path=folder.path)
    if folder.owner:
        return said("{path} belongs to {owner}", path=folder.path, owner=folder.owner)
    return said("others may look into {path} (mode {mode})", path=folder.path, mode=f"{folder.mode:03o}")


def _mending(folder: OddFolder) -> str:
    if folder.owner or not folder.is_folder:
        return f"sudo rm -r {folder.path}"
    return f"chmod 700 {folder.path}"
