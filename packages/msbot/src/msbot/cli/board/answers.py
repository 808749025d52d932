"""What a board answers to the questions of `connection.py`: whether it is an answer at all.

A board prints Python values; one that runs something else, or is out of its mind, prints values of other kinds.
"""

from __future__ import annotations

from typing import Final

SHORTEST: Final = 2
"""Numbers of a version."""


def are_facts(found: object) -> bool:
    """Name, version, machine, version of compiled files, folders for packages, home."""
    match found:
        case (str(), [*version], str(), int(), [*lib], str()) if len(version) >= SHORTEST:
            return all(isinstance(one, int) for one in version) and all(isinstance(one, str) for one in lib)
    return False


def is_room(found: object) -> bool:
    """Octets of a block and of a fragment, blocks in all, free ones; or None."""
    match found:
        case None | (int(), int(), int(), int()):
            return found is None or (found[0] > 0 and min(found) >= 0)
    return False


def are_files(found: list[object]) -> bool:
    """Name, octets and SHA-256 of each file."""
    for one in found:
        match one:
            case (str(), int(), bytes() | None):
                pass
            case _:
                return False
    return True
