"""Types of a ROS 2 package of the user's own: they have the fields of ours, as `msbot library ros-package` writes them.

So have services, whose two messages they are.

In CDR both have the same octets, because an enum of ours is a uint32 there. So what is converted is only the name.
"""

from __future__ import annotations

import types
from enum import IntEnum
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

from msbot.part import Message
from msbot.part.messages.ros_names import PACKAGE, ros_field_names, ros_name, ros_stem, service_stem
from msbot.part.messages.type_hash import Fields, described_types, whole_hash
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


def service_classes(
    request: type[Message], reply: type[Message], package: str, name: str
) -> tuple[type[Message], type[Message]]:
    """The classes of the two messages of a service of such a package.

    Args:
        request: our class of the request.
        reply: that of the reply.
        package: where the service is; the types inside its messages are there, too.
        name: of the service in the package.

    Raises:
        ConfigError: our own package has the service under another name.
    """
    stem = service_stem(request.type_name, reply.type_name)
    if package == PACKAGE and name != stem:
        raise ConfigError(
            f"{PACKAGE} has the services of the library (msbot library ros-package), and "
            f"{request.type_name} -> {reply.type_name} is {PACKAGE}/srv/{stem} there, not {package}/srv/{name}"
        )
    known: dict[type[Message], type[Message]] = {}
    asked = _made(request, package, f"{name}_Request", known, "srv")
    return asked, _made(reply, package, f"{name}_Response", known, "srv")


def package_hash(theirs: type[Message]) -> str:
    """The hash of such a type, as ROS 2 makes it (REP 2016); empty: there are lists of lists in it."""
    described = described_types(theirs)
    return "" if described is None else whole_hash(theirs.type_name, described[theirs.type_name], described.get).hex()


_EVENT_INFO: dict[str, Fields] = {
    "service_msgs::msg::dds_::ServiceEventInfo_": [
        ("event_type", "uint8"),
        ("stamp", "builtin_interfaces::msg::dds_::Time_"),
        ("client_gid", "uint8[16]"),
        ("sequence_number", "int64"),
    ],
    "builtin_interfaces::msg::dds_::Time_": [("sec", "int32"), ("nanosec", "uint32")],
}
"""What ROS 2 tells of each call to those that watch a service: it is inside the type of every service."""


def service_hash(request: type[Message], reply: type[Message]) -> str:
    """The hash of a service with these messages, as ROS 2 makes it (REP 2016); empty: there are lists of lists in it.

    It is that of a type with a request, a reply and an event, the record of one call. Endpoints tell the hashes of the
    messages; this one is in the files that ROS 2 generates for a package.
    """
    asked, told = described_types(request), described_types(reply)
    if asked is None or told is None:
        return ""
    begin = request.type_name.removesuffix("_Request_")
    info, event = next(iter(_EVENT_INFO)), f"{begin}_Event_"
    recorded = [("info", info), ("request", f"{request.type_name}[<=1]"), ("response", f"{reply.type_name}[<=1]")]
    types: dict[str, Fields] = {**_EVENT_INFO, **asked, **told, event: recorded}
    whole = [("request_message", request.type_name), ("response_message", reply.type_name), ("event_message", event)]
    return whole_hash(f"{begin}_", whole, types.get).hex()


def _made(
    ours: type[Message], package: str, name: str, known: dict[type[Message], type[Message]], kind: str = "msg"
) -> type[Message]:
    hints = get_type_hints(ours, include_extras=True)
    fields = {field: kind for field, kind in hints.items() if get_origin(kind) is not ClassVar}
    shown = ros_field_names(list(fields))
    kinds = [_kind(one, package, known) for one in fields.values()]
    body = {
        "__annotations__": dict(zip(shown, kinds, strict=True)),
        "__doc__": f"{ours.type_name} as a type of ROS 2.",
        "type_name": f"{package}::{kind}::dds_::{name}_",
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
            known[annotation] = _made(annotation, package, ros_stem(annotation.type_name), known)
        return known[annotation]
    return annotation
