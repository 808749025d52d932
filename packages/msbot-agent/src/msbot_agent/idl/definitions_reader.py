"""Reads a file into definitions: recognises its language, and finds the files that it needs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files
from itertools import islice
from pathlib import Path

from msbot_agent.idl.installed_interfaces import installed_interfaces, share_folders
from msbot_agent.idl.model import BASICS, Definitions, Name, SourceLocation
from msbot_agent.idl.omg_reader import LARGEST_FILE, read_idl
from msbot_agent.idl.ros_reader import read_ros
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_agent.text.untrusted_input import read_input_file
from msbot_xrce.errors import ConfigError

MOST_FILES = 500
"""How many files one file may need."""
MANIFEST = "package.xml"
_REMARK = re.compile(r"<!--.*?-->", re.DOTALL)
_NAME = re.compile(r"<name>\s*([^<]*?)\s*</name>")
_PACKAGE = re.compile(r"[a-z][a-z0-9_]*")
ROS_FILE = "ros2.idl"
"""The common ROS 2 types that MsBOT brings."""


def read_definitions(
    path: Path,
    *,
    package: str = "",
    include: Sequence[Path] = (),
    is_ros: bool = False,
    defined: Sequence[str] = (),
) -> Definitions:
    """Read an interface file and everything it needs.

    Args:
        path: an `.idl`, `.msg` or `.srv` file.
        package: the ROS package of a `.msg` or `.srv` file; if absent, that of the `package.xml` in the folder above
            `msg` or `srv`, or the name of that folder.
        include: folders that hold ROS packages, in addition to the one that the file is in, and to those that ROS 2 on
            this computer has.
        defined: what the conditions of an `.idl` file take as defined.
        is_ros: give the structs of an `.idl` file type names in the style of ROS 2; those of other files always have
            them.

    Raises:
        ConfigError: the file cannot be read, or has a mistake: its line, column, and what would be right.
    """
    if path.suffix == ".idl":
        if package:
            raise ConfigError(f"{path}: --package is for .msg and .srv files; an .idl file names its modules itself")
        found = Definitions()
        folder = path.resolve().parent
        around = [folder.parent.parent] if folder.name in ("msg", "srv") else []
        read_idl(
            _text(path),
            str(path),
            found,
            is_ros=is_ros,
            include=[*include, *around, *share_folders()],
            defined=defined,
            other=lambda name, place: _take_common(name, place, found),
            hint=lambda name: _meant(name, [*include, *around]),
        )
        return found
    if defined:
        raise ConfigError(f"{path}: --define is for .idl files; there are no conditions in others")
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
        self._package = package or (package_of(folder.parent) if in_package else "")
        self._folders = [*include, *([folder.parent.parent] if in_package else []), *share_folders()]
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
        if not _PACKAGE.fullmatch(self._package):
            raise ConfigError(
                f"{self._path}: {self._package!r} is no name of a ROS package, which has small letters, digits and _ "
                "and begins with a letter: say --package NAME"
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
            path = package_folder(folder, name[0]).joinpath(*name[1:]).with_suffix(".msg")
            if path.is_file():
                self._read(path, name)
                return
        beside = self._beside / f"{name[-1]}.msg"
        if name[0] == self._package and beside.is_file():
            self._read(beside, name)
        elif not _take_common(name, place, self._found):
            own = name[0] == self._package
            meant = _meant(name, self._folders, self._beside if own else None)
            raise place.error(
                f"the type {'/'.join((name[0], name[-1]))} is nowhere{f'; {meant} Else' if meant else ':'} give the "
                f"folder that holds the package {name[0]} with --include"
            )


def _meant(name: Name, folders: Sequence[Path], beside: Path | None = None) -> str:
    """The question whether another type is meant: one of the package, or one of its name in a similar package; empty:
    none is like it.

    Args:
        name: what there is not.
        folders: where packages are looked for.
        beside: where the types of its package are; None: it is not the package of the file that is read.
    """
    package, last = name[0], name[-1]
    types = {one: f"{package}/{one}" for one in _types_of(package, folders)}
    if beside is not None:
        types |= {path.stem: f"{package}/{path.stem}" for path in islice(beside.glob("*.msg"), MOST_FILES)}
        types |= {one: one for one in (*BASICS, "string")}
    if near := nearest(last, sorted(types)):
        return did_you_mean([types[one] for one in near])
    packages = {one[0] for one in common_ros_definitions().structs} | set(installed_interfaces())
    for folder in folders:
        packages |= {path.parent.name for path in islice(folder.glob("*/msg"), MOST_FILES)}
    near = nearest(package, sorted(packages - {package}))
    having = [one for one in near if last in _types_of(one, folders)]
    return did_you_mean([f"{one}/{last}" for one in having]) if having else ""


def _types_of(package: str, folders: Sequence[Path]) -> set[str]:
    """The messages of a package that are known here."""
    found = {one[-1] for one in common_ros_definitions().structs if one[:2] == (package, "msg")}
    found |= {one.removeprefix("msg/") for one in installed_interfaces().get(package, ()) if one.startswith("msg/")}
    for folder in folders:
        place = package_folder(folder, package) / "msg"
        found |= {path.stem for ending in ("msg", "idl") for path in islice(place.glob(f"*.{ending}"), MOST_FILES)}
    return found


def _take_common(name: Name, place: SourceLocation, found: Definitions) -> bool:
    """Add one of the common types and what it needs; False: it is none of them."""
    known = common_ros_definitions()
    if name not in known.structs:
        return False
    needed = known.needed_by(name)
    for one in known.order:
        if one in needed and one not in found.structs and one not in found.enums:
            found.add(known.structs[one] if one in known.structs else known.enums[one], place)
    return True


def package_of(folder: Path) -> str:
    """The ROS package in a folder: as its `package.xml` says, since an archive's folder has the branch in its name."""
    try:
        octets = read_input_file(folder / MANIFEST, LARGEST_FILE, "a package.xml")
    except (OSError, ConfigError):
        return folder.name
    found = _NAME.search(_REMARK.sub("", octets.decode("utf-8", "replace")))
    return found[1] if found else folder.name


def package_folder(folder: Path, package: str) -> Path:
    """The folder of a ROS package among those in a folder: the one of its name, or the one whose manifest has it."""
    named = folder / package
    if named.is_dir():
        return named
    manifests = islice(folder.glob(f"*/{MANIFEST}"), MOST_FILES)
    return next((one.parent for one in manifests if package_of(one.parent) == package), named)


def _text(path: Path) -> str:
    try:
        return read_input_file(path, LARGEST_FILE, "a file with message definitions").decode("utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8") from None
