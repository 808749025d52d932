"""Whether a type of ROS 2 is one that somebody here knows: MsBOT's own table, or ROS 2 on this computer.

A type of another package has the fields of ours, and nothing on this computer may know it; so a typo in its name would
only show as a topic that nobody reads. It is found where the names are known.
"""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from typing import Final

from msbot import ros2
from msbot.part import Message
from msbot.part.messages.ros_names import PACKAGE
from msbot_agent.idl.installed_interfaces import installed_interfaces
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_xrce.errors import ConfigError

ROS_TYPES: dict[str, type[Message]] = {
    cls.type_name: cls
    for cls in vars(ros2).values()
    if isinstance(cls, type) and issubclass(cls, Message) and "::dds_::" in cls.type_name
}
"""The known message types of ROS 2 by their names in DDS."""
KNOWN_PACKAGES: Final = {name.partition("::")[0] for name in ROS_TYPES}
"""Packages of ROS 2 of which MsBOT has the types that robots use."""
_ALIKE: Final = 0.85
"""How similar the name of a package must be to count as a typo of another one, from 0 to 1."""
_LONGER: Final = 2
"""So many characters more or fewer it may have."""


@cache
def table() -> Mapping[str, frozenset[str]]:
    """What MsBOT knows by itself: the types of each package, as `msg/Float32` and `srv/SetBool`."""
    found: dict[str, set[str]] = {}
    for type_name in ROS_TYPES:
        package, kind, _, name = type_name.split("::")
        shown = name.removesuffix("_").removesuffix("_Request").removesuffix("_Response")
        found.setdefault(package, set()).add(f"{kind}/{shown}")
    return {package: frozenset(types) for package, types in found.items()}


@cache
def here() -> Mapping[str, frozenset[str]]:
    """What ROS 2 on this computer has, as this program found it first."""
    return installed_interfaces()


def check_type(package: str, kind: str, name: str) -> None:
    """Look for a typo in the name of a type that is not in MsBOT's table.

    Args:
        package: its package.
        kind: `msg` or `srv`.
        name: its last word.

    Raises:
        ConfigError: its package is known and does not have it, or another package is nearly called so and has it; the
            text says what may be meant.
    """
    there = here()
    if package in there:
        if f"{kind}/{name}" not in there[package]:
            raise ConfigError(
                f"ROS 2 on this computer has a package {package}, but no {kind}/{name} in it; "
                f"{_instead(package, kind, name, there[package])}"
            )
        return
    ours = table()
    if package in ours:
        near = [one for one in _named(package, kind, ours[package]) if _is_alike(name, one.rpartition("/")[2])]
        if near:
            raise ConfigError(f"MsBOT knows no {package}/{kind}/{name}; {did_you_mean(near)}")
        return
    if package == PACKAGE:
        return
    near = [
        f"{other}/{kind}/{name}"
        for other, types in {**ours, **there, PACKAGE: frozenset([f"{kind}/{name}"])}.items()
        if _is_alike(package, other) and f"{kind}/{name}" in types
    ]
    if near:
        raise ConfigError(
            f"neither MsBOT nor ROS 2 on this computer knows a package {package}; {did_you_mean(near[:3])} If there is "
            f"a {package}, source its setup file before this command"
        )


def hint_of(type_name: str, kind: str) -> str:
    """What cannot be known of a type here, as a sentence; empty where it is known.

    Args:
        type_name: `arm_msgs/msg/Pose` or `arm_msgs/Pose`; empty: the usual one.
        kind: `msg` or `srv`.
    """
    package, _, rest = type_name.partition("/")
    name = rest.removeprefix(f"{kind}/")
    if not type_name or package == PACKAGE or f"{kind}/{name}" in table().get(package, ()) or package in here():
        return ""
    return (
        f"{package}/{kind}/{name}: neither MsBOT nor this computer has the package {package}, so whether there is such "
        f"a type, and with these fields, is not known here; on a computer that has it: "
        f"ros2 interface show {package}/{kind}/{name}"
    )


def types_like(package: str, kind: str, name: str) -> str:
    """What to write instead of a type that is not in MsBOT's table, for a sentence."""
    return _instead(package, kind, name, table().get(package, frozenset()))


def _instead(package: str, kind: str, name: str, types: frozenset[str]) -> str:
    if near := nearest(name, [one.rpartition("/")[2] for one in sorted(types) if one.startswith(f"{kind}/")]):
        return did_you_mean([f"{package}/{kind}/{one}" for one in near])
    others = [f"{other}/{kind}/{name}" for other, known in sorted(table().items()) if f"{kind}/{name}" in known]
    return did_you_mean(others) if others else f"`ros2 interface package {package}` lists what it has"


def _named(package: str, kind: str, types: frozenset[str]) -> list[str]:
    return [f"{package}/{one}" for one in sorted(types) if one.startswith(f"{kind}/")]


def _is_alike(word: str, other: str) -> bool:
    is_as_long = abs(len(word) - len(other)) <= _LONGER
    return is_as_long and bool(get_close_matches(word.casefold(), [other.casefold()], cutoff=_ALIKE))
