"""A part library as a ROS 2 interface package: with it a ROS program calls a part's service by its own type.

A message of ROS 2 has the octets of ours, and the hash of ours, if its package is `msbot_msgs`; but ROS 2 has no enums:
there they are a uint32 with constants.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.sax.saxutils import escape

from msbot.config import EnumType, FieldType, Library, ListType, MessageType
from msbot.config.library.field_types import BoundedText, FieldKind
from msbot.part.messages.ros_names import PACKAGE, ros_field_names, ros_stem, service_stem
from msbot.service_types import ServiceType
from msbot_xrce.errors import ConfigError

_NAME = re.compile(r"[a-z](_?[a-z0-9])+")
_FIELD = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*")
_WORDS_OF_C = """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t char32_t
    class compl concept const consteval constexpr constinit const_cast continue co_await co_return co_yield
    decltype default delete do double dynamic_cast else enum explicit export extern false float for friend
    goto if inline int long mutable namespace new noexcept not not_eq nullptr operator or or_eq private
    protected public register reinterpret_cast requires restrict return short signed sizeof static
    static_assert static_cast struct switch template this thread_local throw true try typedef typeid typename
    typeof union unsigned using virtual void volatile wchar_t while xor xor_eq
"""
_WORDS = {"C or C++": frozenset(_WORDS_OF_C.split()), "Python": frozenset(keyword.kwlist)}
"""Words of the languages for which ROS 2 makes code of a package: none of them can be a field."""
REPLY = "of the reply"
"""Stands behind each constant of a reply: what generates code for ROS 2 takes two constants of one file for the same if
they are written alike, as those of a request and its reply with one enum are."""
_MANIFEST = """\
<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.1.0</version>
  <description>Messages and services of MsBOT parts</description>
  <maintainer email="you@example.org">you</maintainer>
  <license>TODO: License declaration</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""
_CMAKE = """\
cmake_minimum_required(VERSION 3.8)
project({package})

find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)

rosidl_generate_interfaces(${{PROJECT_NAME}}
{files}
)

ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


def services_of(library: Library) -> dict[ServiceType, tuple[MessageType, MessageType]]:
    """The services that parts of a library serve or call, with their requests and replies."""
    return {
        ServiceType(port.message.name, port.reply.name): (port.message, port.reply)
        for part_type in library
        for port in part_type.ports
        if port.message is not None and port.reply is not None
    }


def package_files(library: Library, package: str = PACKAGE) -> dict[str, str]:
    """The files of a package, by their paths in it.

    Raises:
        ConfigError: ROS 2 takes no package of that name, or two types have one name there, or it takes no field of a
            name; the text names all of those.
    """
    if not _NAME.fullmatch(package):
        raise ConfigError(
            f"{package!r} is no name of a ROS package: it has small letters, digits and single _, and begins with a "
            "letter; say --package NAME"
        )
    if faults := [fault for message in library.messages.values() for fault in _field_faults(message)]:
        raise ConfigError("\n".join(faults))
    files: dict[str, str] = {}
    of: dict[str, str] = {}

    def put(path: str, name: str, text: str) -> None:
        if path in files:
            raise ConfigError(f"{of[path]} and {name} are both {path} in ROS 2: give one of them another name")
        files[path], of[path] = text, name

    for message in library.messages.values():
        head = f"{_remark(message.description)}\n" if message.description else ""
        put(f"msg/{ros_stem(message.name)}.msg", message.name, head + _fields(message, package))
    for service, (request, reply) in services_of(library).items():
        text = f"{_remark(str(service))}\n{_fields(request, package)}---\n{_fields(reply, package, REPLY)}"
        put(f"srv/{service_stem(*service)}.srv", str(service), text)
    listed = "\n".join(f'  "{path}"' for path in sorted(files))
    files["CMakeLists.txt"] = _CMAKE.format(package=package, files=listed)
    files["package.xml"] = _MANIFEST.format(package=escape(package))
    return files


def _field_faults(message: MessageType) -> Iterator[str]:
    """Why ROS 2 takes no message with such fields: a sentence for each of them."""
    shown = ros_field_names(list(message.fields))
    for place, (name, other) in enumerate(zip(message.fields, shown, strict=True)):
        where = f"{message.name}: the field {name}"
        right = f'name it in the library "{other}_value" or the like'
        if languages := [language for language, words in _WORDS.items() if other in words]:
            yield f"{where} cannot be in ROS 2, because {other} is a word of {' and of '.join(languages)}; {right}"
        elif not _FIELD.fullmatch(name):
            yield (
                f"{where} cannot be in ROS 2: a name there has letters a to z, digits and single _, and begins with a "
                f'letter; name it in the library "{other}"'
            )
        elif twins := [
            one for one in list(message.fields)[:place] if ros_field_names([one]) == ros_field_names([name])
        ]:
            yield f"{where} and {twins[0]} are both {ros_field_names([name])[0]} in ROS 2; give one another name"


def write_package(files: Mapping[str, str], folder: Path) -> None:
    """Write a package to a new folder.

    Raises:
        ConfigError: there is something in the folder, or it cannot be written.
    """
    try:
        if folder.is_dir() and any(folder.iterdir()):
            raise ConfigError(f"{folder}: there is something in it, and nothing is overwritten; name a new folder")
        for path, text in files.items():
            place = folder / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text, "utf-8")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written ({error.strerror}); name another folder") from None


def _fields(message: MessageType, package: str, of: str = "") -> str:
    return "".join(f"{line}\n" for line in _lines(message, package, of))


def _lines(message: MessageType, package: str, of: str) -> Iterator[str]:
    shown = ros_field_names(list(message.fields))
    of_enums = {
        name: enum.names for name, kind in zip(shown, message.fields.values(), strict=True) if (enum := _enum(kind))
    }
    constants = iter(ros_field_names([f"{name}_{one}" for name, names in of_enums.items() for one in names]))
    for name, (field, kind) in zip(shown, message.fields.items(), strict=True):
        for number in range(len(of_enums.get(name, ()))):
            yield f"uint32 {next(constants).upper()}={number}" + (f"  {_remark(of)}" if of else "")
        unit = message.units.get(field, "")
        yield f"{_word(kind, package)} {name}" + (f"  {_remark(unit)}" if unit else "")


def _enum(kind: FieldType) -> EnumType | None:
    element = kind.element if isinstance(kind, ListType) else kind
    return element if isinstance(element, EnumType) else None


def _remark(text: str) -> str:
    return f"# {' '.join(text.split())}"


def _word(kind: FieldType, package: str) -> str:
    """A kind as ROS 2 writes it."""
    match kind:
        case ListType(element, most, is_fixed):
            return f"{_word(element, package)}[{'' if is_fixed else '<='}{most}]"
        case MessageType():
            return f"{package}/{ros_stem(kind.name)}"
        case EnumType():
            return "uint32"
        case BoundedText(most):
            return f"string<={most}"
        case FieldKind.TEXT:
            return "string"
        case _:
            return kind.word
