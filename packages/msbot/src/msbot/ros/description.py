"""The robot's description for ROS 2: the URDF file that the blueprint names, as it is."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from msbot.config import Blueprint
from msbot_agent.text.given_file import open_given
from msbot_xrce.errors import ConfigError

LARGEST = 1 << 20
"""Octets; a description only names its meshes, so it is far smaller."""


def read_description(blueprint: Blueprint) -> str:
    """The text for `/robot_description`; empty if the blueprint names no file. Reads a file: not for an event loop.

    Raises:
        ConfigError: the file cannot be read, is too large, or is no URDF; the text says which.
    """
    if not blueprint.ros.urdf:
        return ""
    folder = Path() if blueprint.source is None else blueprint.source.parent
    path = folder / blueprint.ros.urdf
    where = f'[ros] urdf = "{blueprint.ros.urdf}"'
    try:
        with open_given(path) as file:
            octets = file.read(LARGEST + 1) or b""
    except OSError as error:
        raise ConfigError(
            f"{where}: {path} cannot be read ({error.strerror}): name a URDF file beside the blueprint"
        ) from error
    if len(octets) > LARGEST:
        raise ConfigError(
            f"{where}: {path} has more than {LARGEST} octets: name meshes in it instead of containing them"
        )
    try:
        text = octets.decode()
        root = ElementTree.fromstring(octets)
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise ConfigError(f"{where}: {path} is not XML in UTF-8 ({error}): a URDF file is needed") from error
    if root.tag != "robot" or "\0" in text:
        raise ConfigError(f"{where}: {path} is not URDF: it begins with <{root.tag}>, not with <robot>")
    return text
