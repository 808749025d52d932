"""The interface packages of ROS 2 that this computer has, by the index that ament keeps of them.

`AMENT_PREFIX_PATH` names the places, as the setup file of a workspace sets it; `/opt/ros` counts also without it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path

from msbot_agent.text.untrusted_input import read_input_file
from msbot_xrce.errors import ConfigError

MOST_PLACES = 100
MOST_PACKAGES = 2000
LARGEST_LIST = 1 << 20
"""Octets of the list of one package's files."""
SYSTEM = Path("/opt/ros")
_INDEX = "ament_index/resource_index/rosidl_interfaces"


def share_folders(environ: Mapping[str, str] = os.environ, system: Path = SYSTEM) -> list[Path]:
    """The folders that hold ROS packages here, those that a setup file named first."""
    named = [Path(place) for place in environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if place]
    places = dict.fromkeys([*named[:MOST_PLACES], *sorted(islice(system.glob("*"), MOST_PLACES))])
    return [place / "share" for place in places]


def installed_interfaces(environ: Mapping[str, str] = os.environ, system: Path = SYSTEM) -> dict[str, frozenset[str]]:
    """The types of each package, as `msg/Float32` and `srv/SetBool`; empty where there is no ROS 2."""
    found: dict[str, frozenset[str]] = {}
    for share in share_folders(environ, system):
        for listed in islice((share / _INDEX).glob("*"), MOST_PACKAGES):
            if listed.name not in found:
                found[listed.name] = frozenset(_types(listed))
    return found


def _types(listed: Path) -> Iterator[str]:
    try:
        text = read_input_file(listed, LARGEST_LIST, "a list of interface files").decode("utf-8", "replace")
    except (OSError, ConfigError):
        return  # it may have gone meanwhile; whoever asks for its types is told that nobody knows them
    for line in text.split():
        name, dot, _ = line.rpartition(".")
        if dot and name.count("/") == 1:
            yield name
