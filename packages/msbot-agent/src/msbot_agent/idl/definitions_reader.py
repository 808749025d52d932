"""Reads a file into definitions: recognises its language, and finds the files that it needs."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from msbot_agent.idl.model import Definitions, Name, SourceLocation
from msbot_agent.idl.omg_reader import LARGEST_FILE, read_idl
from msbot_agent.idl.ros_reader import read_ros
from msbot_agent.text.untrusted_input import read_input_file
from msbot_xrce.errors import ConfigError

MOST_FILES = 500
"""How many files one file may need."""
ROS_FILE = "ros2.idl"
"""The common ROS 2 types that MsBOT brings."""


def read_definitions(
    path: Path, *, package: str = "", include: Sequence[Path] = (), is_ros: bool = False
) -> Definitions:
    """Read an interface file and everything it needs.

    Args:
        path: an `.idl`, `.msg` or `.srv` file.
        package: the ROS package of a `.msg` or `.srv` file; the folder above `msg` or `srv` if absent.
        include: folders that hold ROS packages, in addition to the one that the file is in.
        is_ros: give the structs of an `.idl` file type names in the style of ROS 2; those of other files always have
            them.

    Raises:
        ConfigError: the file cannot be read, or has a mistake: its line, column, and what would be right.
    """
    if path.suffix == ".idl":
        found = Definitions()
        read_idl(_text(path), str(path), found, is_ros=is_ros)
        return found
    if path.suffix in (".msg", ".srv"):
        return _RosFiles(path, package, include).read()
    raise ConfigError(f"{path}: the name must end in .idl, .msg or .srv")


def common_ros_definitions() -> Definitions:
    """The common ROS 2 types that MsBOT brings: std_msgs, geometry_msgs, sensor_msgs, nav_msgs and what they need."""
    found = Definitions()
    read_idl((files("msbot_agent.idl") / ROS_FILE).read_text("utf-8"), ROS_FILE, found, is_ros=True)
    return found


class _RosFiles:
    """A ROS file and the files of the types it uses."""

    def __init__(self, path: Path, package: str, include: Sequence[Path]) -> None:
        self._path = path
        folder = path.resolve().parent
        in_package = folder.name in ("msg", "srv")
        self._package = package or (folder.parent.name if in_package else "")
        self._folders = [*include, *([folder.parent.parent] if in_package else [])]
        self._beside = folder
        self._found = Definitions()
        self._open: list[Name] = []
        self._files = 0

    def read(self) -> Definitions:
        if not self._package:
            raise ConfigError(
                f"{self._path}: which ROS package does it belong to? Put it into PACKAGE/{self._path.suffix[1:]}/, "
                "or say --package NAME"
            )
        self._read(self._path, (self._package, self._path.suffix[1:], self._path.stem))
        return self._found

    def _read(self, path: Path, name: Name) -> None:
        self._files += 1
        if self._files > MOST_FILES:
            raise ConfigError(f"{self._path}: it needs more than {MOST_FILES} other files")
        self._open.append(name)
        read_ros(_text(path), str(path), name, self._found, self._find)
        self._open.pop()

    def _find(self, name: Name, place: SourceLocation) -> None:
        if name in self._open:
            raise place.error(f"{'/'.join(name)} contains itself")
        for folder in self._folders:
            path = folder.joinpath(*name).with_suffix(".msg")
            if path.is_file():
                self._read(path, name)
                return
        beside = self._beside / f"{name[-1]}.msg"
        if name[0] == self._package and beside.is_file():
            self._read(beside, name)
        elif name in common_ros_definitions().structs:
            self._take_common(name, place)
        else:
            raise place.error(
                f"the type {'/'.join((name[0], name[-1]))} is nowhere: give the folder that holds the package "
                f"{name[0]} with --include"
            )

    def _take_common(self, name: Name, place: SourceLocation) -> None:
        known = common_ros_definitions()
        needed = known.needed_by(name)
        for one in known.order:
            if one in needed and one not in self._found.structs and one not in self._found.enums:
                self._found.add(known.structs[one] if one in known.structs else known.enums[one], place)


def _text(path: Path) -> str:
    try:
        return read_input_file(path, LARGEST_FILE, "a file with message definitions").decode("utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: octet {error.start} is not UTF-8") from None
