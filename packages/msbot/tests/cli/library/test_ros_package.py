"""`msbot library ros-package`: what our own reader of .msg and .srv files makes of the package."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner
from hypothesis import given, settings

from msbot.cli.library import command
from msbot.cli.ros_package import package_files, services_of, write_package
from msbot.config import FieldType, Library, MessageType, load_library
from msbot.part import Message
from msbot.part.messages.ros_names import PACKAGE, service_stem
from msbot.part.messages.type_hash import described_types, type_hash
from msbot.recording.recorder.schemas import ros_definition
from msbot.ros2.package_types import service_classes, service_hash
from msbot.service_types import ServiceType
from msbot.sim.model_part import message_class
from msbot_agent.idl import read_definitions, to_python
from msbot_xrce.errors import ConfigError
from tests.cli.library.ros_packages import LAMP, library, ros_hash, service_hashes
from tests.idl.generated import module_from
from tests.part.messages.test_library_types import any_type


def hashes(file: Path) -> dict[str, str]:
    """The hashes of all types in a file, by their names in ROS 2."""
    found = {}
    for cls in vars(classes(file)).values():
        if isinstance(cls, type) and issubclass(cls, Message) and "::dds_::" in cls.type_name:
            types = described_types(cls)
            assert types is not None
            name = cls.type_name.replace("::dds_::", "::").removesuffix("_").replace("::", "/")
            found[name] = type_hash(cls.type_name, types[cls.type_name], types.get).hex()
    return found


def classes(file: Path) -> Any:
    return module_from(to_python(read_definitions(file), file.name), f"generated_{file.stem}")


def whole_hash(service: ServiceType, request: MessageType, reply: MessageType) -> str:
    """The hash of a service; `tests.ros.genuine` compares it with that of ROS 2."""
    classes = message_class(request), message_class(reply)
    return service_hash(*service_classes(*classes, PACKAGE, service_stem(*service)))


def test_each_type_and_each_service_is_read_back(tmp_path: Path) -> None:
    own = library(tmp_path)
    folder = tmp_path / "msbot_msgs"
    told = CliRunner().invoke(command, ["ros-package", str(folder), "--library", str(tmp_path / "library")])
    assert told.output.splitlines() == [
        f"{folder} is written: {len(own.messages)} messages, 2 services.",
        *(
            f'  {one}:  ros_type = "{PACKAGE}/srv/{service_stem(*one)}"  (RIHS01_{whole_hash(one, *messages)[:16]}...)'
            for one, messages in services_of(own).items()
        ),
    ]
    for message in own.messages.values():
        stem = {"arm-1": "Arm1"}.get(message.name, message.name)
        assert hashes(folder / f"msg/{stem}.msg")[f"{PACKAGE}/msg/{stem}"] == ros_hash(message)
    for service, (request, reply) in services_of(own).items():
        stem = service_stem(*service)
        wanted = service_hashes(stem, request, reply)
        found = hashes(folder / f"srv/{stem}.srv")
        assert {name: found[name] for name in wanted} == wanted
    scan = own.messages["Scan"]
    assert ros_hash(scan) == type_hash("Scan", scan.described()["Scan"]).hex()  # a type without enums keeps its hash
    assert (folder / "msg/Joint.msg").read_text() == (
        "float32 degrees  # °\nuint32 MODE_OFF=0\nuint32 MODE_HALF_ON=1\nuint32 mode\n"
    )


def test_the_package_names_itself_and_its_files(tmp_path: Path) -> None:
    files = package_files(library(tmp_path), "rover_msgs")
    assert ElementTree.fromstring(files["package.xml"]).findtext("name") == "rover_msgs"
    assert "project(rover_msgs)" in files["CMakeLists.txt"]
    for path in files.keys() - {"package.xml", "CMakeLists.txt"}:
        assert f'\n  "{path}"\n' in files["CMakeLists.txt"]
    assert "rover_msgs/Joint[3] joints" in files["srv/Arm1ToPicture.srv"]


@settings(max_examples=30)
@given(any_type())
def test_any_type_of_a_library_is_read_back_and_is_as_recordings_have_it(kind: MessageType) -> None:
    inside: dict[str, MessageType] = {}

    def collect(one: FieldType) -> None:
        one = getattr(one, "element", one)
        if isinstance(one, MessageType):
            inside[one.name] = one
            for inner in one.fields.values():
                collect(inner)

    collect(kind)
    files = package_files(Library((), inside))
    recorded = ros_definition(message_class(kind)).partition("\n=")[0].splitlines()
    assert [line for line in files["msg/Any.msg"].splitlines() if "=" not in line.replace("<=", "")] == recorded
    with TemporaryDirectory() as folder:
        write_package(files, Path(folder) / PACKAGE)
        file = Path(folder) / PACKAGE / "msg/Any.msg"
        assert hashes(file)[f"{PACKAGE}/msg/Any"] == ros_hash(kind)
        octets = message_class(kind)().encode()
        assert classes(file).Any.decode(octets).encode() == octets


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    own = library(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").write_text("")
    with pytest.raises(ConfigError, match=r"full: there is something in it, and nothing is overwritten"):
        write_package(package_files(own), tmp_path / "full")
    with pytest.raises(ConfigError, match=r"mine: cannot be written \(.*\); name another folder"):
        write_package(package_files(own), tmp_path / "full" / "mine")
    for bad in ("Rover", "a", "rover__msgs", "rover_", "../rover"):
        with pytest.raises(ConfigError, match="is no name of a ROS package"):
            package_files(own, bad)
    (tmp_path / "library" / "lamp.toml").write_text(LAMP + '[[type]]\nname = "Arm1"\nfields = { a = "bool" }\n')
    told = CliRunner().invoke(command, ["ros-package", str(tmp_path / "new"), "--library", str(tmp_path / "library")])
    assert str(told.exception) == "arm-1 and Arm1 are both msg/Arm1.msg in ROS 2: give one of them another name"
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            'class = "bool"',
            "cannot be in ROS 2, because class is a word of C or C++ and of Python; name it in the library ",
        ),
        (
            'fineX = "bool", Default = "int8"',
            "Own: the field Default cannot be in ROS 2, because default is a word of C",
        ),
        ('lambda = "bool"', 'lambda is a word of Python; name it in the library "lambda_value" or the like'),
        (
            'a__b = "bool"',
            "Own: the field a__b cannot be in ROS 2: a name there has letters a to z, digits and single _, and begins",
        ),
        ('"größe" = "bool"', 'begins with a letter; name it in the library "gr_e"'),
        (
            'isUp = "bool", is_up = "bool"',
            "Own: the field is_up and isUp are both is_up in ROS 2; give one another name",
        ),
    ],
)
def test_a_field_that_ros_does_not_take_is_named_with_what_would_be_right(
    tmp_path: Path, fields: str, words: str
) -> None:
    (tmp_path / "own.toml").write_text(f'[[type]]\nname = "Own"\nfields = {{ {fields} }}\n')
    told = CliRunner().invoke(command, ["ros-package", str(tmp_path / "new"), "--library", str(tmp_path)])
    assert isinstance(told.exception, ConfigError)
    assert words in str(told.exception)
    assert not (tmp_path / "new").exists()


def test_every_standard_type_is_one_that_ros_takes() -> None:
    assert "msg/Scan.msg" in package_files(load_library())


def test_a_service_has_a_name_of_both_its_messages() -> None:
    assert service_stem("Switch", "my text") == "SwitchToMyText"
