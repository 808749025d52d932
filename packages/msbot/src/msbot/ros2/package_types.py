"""Types of a ROS 2 package of the user's own: they have the fields of ours, as `msbot library ros-package` writes them.

In CDR both have the same octets, because an enum of ours is a uint32 there. So what is converted is only the name.
"""

from __future__ import annotations

import types
from enum import IntEnum
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

from msbot.part import Message
from msbot.part.messages.ros_names import PACKAGE, ros_field_names, ros_name
from msbot.part.messages.type_hash import described_types, whole_hash
from msbot.part.messages.wire_types import uint32
from msbot_xrce.errors import ConfigError


def package_class(ours: type[Message], package: str, name: str) -> type[Message]:
    """The class of a type of such a package.

    Args:
        ours: the class whose fields it has.
        package: where it is; the types inside it are there, too.
        name: in the package.

    Raises:
        ConfigError: our own package has the type under another name.
    """
    own = ros_name(ours.type_name)
    if package == PACKAGE and own != f"{PACKAGE}/msg/{name}":
        raise ConfigError(
            f"{PACKAGE} has the types of the library (msbot library ros-package), and {ours.type_name} is {own} there, "
            f"not {package}/msg/{name}"
        )
    return _made(ours, package, name, {})


def package_hash(theirs: type[Message]) -> str:
    """The hash of such a type, as ROS 2 makes it (REP 2016); empty: there are lists of lists in it."""
    described = described_types(theirs)
    return "" if described is None else whole_hash(theirs.type_name, described[theirs.type_name], described.get).hex()


def _made(ours: type[Message], package: str, name: str, known: dict[type[Message], type[Message]]) -> type[Message]:
    hints = get_type_hints(ours, include_extras=True)
    fields = {field: kind for field, kind in hints.items() if get_origin(kind) is not ClassVar}
    shown = ros_field_names(list(fields))
    kinds = [_kind(kind, package, known) for kind in fields.values()]
    body = {
        "__annotations__": dict(zip(shown, kinds, strict=True)),
        "__doc__": f"{ours.type_name} as a type of ROS 2.",
        "type_name": f"{package}::msg::dds_::{name}_",
    }
    made = types.new_class(name, (Message,), exec_body=lambda namespace: namespace.update(body))
    assert issubclass(made, Message)
    return made


def _kind(annotation: Any, package: str, known: dict[type[Message], type[Message]]) -> Any:  # noqa: ANN401 - a type hint
    if get_origin(annotation) is Annotated:
        base, *marks = get_args(annotation)
        return Annotated[_kind(base, package, known), *marks]
    if get_origin(annotation) is list:
        return list[_kind(get_args(annotation)[0], package, known)]  # type: ignore[misc]  # a kind made at run time
    if isinstance(annotation, type) and issubclass(annotation, IntEnum):
        return uint32
    if isinstance(annotation, type) and issubclass(annotation, Message):
        if annotation.type_name.count("::") == 3:
            return annotation  # it is one of ROS 2 already
        if annotation not in known:
            known[annotation] = _made(annotation, package, ros_name(annotation.type_name).rpartition("/")[2], known)
        return known[annotation]
    return annotation
