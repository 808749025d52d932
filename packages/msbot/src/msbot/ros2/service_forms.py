"""Services of MsBOT as services of ROS 2 and back: a lamp that serves `Switch -> Text` is a `std_srvs/srv/SetBool`.

A type of ROS 2 that MsBOT does not know has the fields of our two messages: a node with such a type, from a package of
the user's own, reads them as they are, and its messages have the same hashes. Where a reply of ROS 2 has `success` and
`message`, they say whether there was a reply at all, and else why not; so a refusal reaches a program that asks for
`std_srvs`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from msbot.part import Message
from msbot.part.messages.message import fields_of
from msbot.ros2.forms import MOST_BEHIND, PackageForm, RosForm, fields_by_themselves
from msbot.ros2.known_types import ROS_TYPES, check_type
from msbot.ros2.package_types import service_classes
from msbot_agent.ros.node_names import is_topic, service_of
from msbot_xrce.errors import CallError, ConfigError
from msbot_xrce.lazy import dataclass

USUAL: Final = {"Switch": "std_srvs/srv/SetBool", "Trigger": "std_srvs/srv/Trigger"}
"""The service that a request of this type usually is."""
_STANDARD: Final = "std_srvs"
"""A package of which MsBOT knows every type."""
SUCCESS: Final = "success"
MESSAGE: Final = "message"
_DUMMY: Final = "structure_needs_at_least_one_member"
"""The field of a message of ROS 2 that has none."""
_NAME: Final = re.compile(r"(?P<package>[a-z][a-z0-9_]*)/(srv/)?(?P<type>[A-Z][A-Za-z0-9]*)")
_REQUEST: Final = "request."
_REPLY: Final = "reply."


@dataclass(frozen=True, slots=True)
class ServiceForm:
    """How one service looks in ROS 2."""

    request_type: str
    """Its name in DDS."""
    reply_type: str
    request: RosForm
    reply: RosForm
    says_success: bool
    """The reply of ROS 2 has a field `success` to which no field of ours is joined."""

    def request_inward(self, octets: bytes) -> bytes:
        """A request of theirs as one of ours.

        Raises:
            RemoteProtocolError: it is not a message of their class, or a value does not fit into ours.
        """
        return self.request.inward(octets)

    def request_outward(self, request: bytes) -> bytes:
        """A request of ours as one of theirs.

        Raises:
            RemoteProtocolError: it is not a message of our class, or a value does not fit into theirs.
        """
        return self.request.outward(request)

    def reply_outward(self, reply: bytes) -> bytes:
        """A reply of ours as one of theirs.

        Raises:
            RemoteProtocolError: it is not a message of our class, or a value does not fit into theirs.
        """
        octets = self.reply.outward(reply)
        if not self.says_success:
            return octets
        told = self.reply.theirs.decode(octets)
        setattr(told, SUCCESS, True)
        return told.encode()

    def refusal(self, why: str) -> bytes | None:
        """A reply of theirs that says why there is none; None: they have no words for it."""
        if not {(SUCCESS, "bool"), (MESSAGE, "text")} <= {
            (field.name, field.codec.kind) for field in fields_of(self.reply.theirs)
        }:
            return None
        return self.reply.theirs(**{SUCCESS: False, MESSAGE: why}).encode()

    def reply_inward(self, octets: bytes) -> bytes:
        """A reply of theirs as one of ours.

        Raises:
            CallError: it says `success: false`; the text is its message.
            RemoteProtocolError: it is not a message of their class, or a value does not fit into ours.
        """
        if self.says_success:
            told = self.reply.theirs.decode(octets, most_behind=MOST_BEHIND)
            if not getattr(told, SUCCESS):
                raise CallError(str(getattr(told, MESSAGE, "")) or "success: false")
        return self.reply.inward(octets)


def service_form(
    request: type[Message], reply: type[Message], type_name: str = "", fields: Mapping[str, str] | None = None
) -> ServiceForm:
    """The form of a service.

    Args:
        request: our class of the request.
        reply: that of the reply.
        type_name: `std_srvs/srv/SetBool`; empty for the usual one.
        fields: ours to theirs, `request.` or `reply.` in front where both of ours have a field of that name; absent:
            the usual ones.

    Raises:
        ConfigError: there is no usual one, or what is said does not fit.
    """
    name = type_name or USUAL.get(request.type_name, "")
    if not name:
        raise ConfigError(
            f"{request.type_name} -> {reply.type_name} has no usual service type in ROS 2: say ros_type, for example "
            'ros_type = "std_srvs/srv/Trigger"'
        )
    match = _NAME.fullmatch(name)
    if match is None:
        raise ConfigError(f"{name!r} is not a service type of ROS 2: write it like std_srvs/srv/SetBool")
    asked, told = (f"{match['package']}::srv::dds_::{match['type']}_{end}_" for end in ("Request", "Response"))
    given = [_given(fields or {}, request, reply, _REQUEST), _given(fields or {}, reply, request, _REPLY)]
    for named in fields or {}:
        if not any(named.removeprefix(front) in one for one, front in zip(given, (_REQUEST, _REPLY), strict=True)):
            known = ", ".join(field.name for one in (request, reply) for field in fields_of(one))
            raise ConfigError(f"ros_fields names {named!r}; request and reply have {known}")
    if asked not in ROS_TYPES:
        if match["package"] == _STANDARD:
            known = ", ".join(
                sorted({one.split("::")[-1].split("_")[0] for one in ROS_TYPES if one.startswith(f"{_STANDARD}::")})
            )
            raise ConfigError(f"{name}: there is no such service type in {_STANDARD}; there are {known}")
        check_type(match["package"], "srv", match["type"])
        if fields:
            raise ConfigError(
                f"{name} is not among the service types that MsBOT knows: its fields must be those of "
                f"{request.type_name} -> {reply.type_name}; remove ros_fields"
            )
        classes = service_classes(request, reply, match["package"], match["type"])
        requests, replies = map(PackageForm, (request, reply), classes)
        return ServiceForm(asked, told, requests, replies, says_success=False)
    theirs = ROS_TYPES[told]
    forms = _form(request, ROS_TYPES[asked], given[0]), _form(reply, theirs, given[1])
    free = {field.name for field in fields_of(theirs)} - {path for _, path, *_ in forms[1].fields}
    return ServiceForm(asked, told, *forms, SUCCESS in free)


def _form(ours: type[Message], theirs: type[Message], given: dict[str, str]) -> RosForm:
    return RosForm(ours, theirs, given or _usual_fields(ours, theirs))


def service_name(robot: str, topic: str) -> str:
    """A service of a robot as ROS 2 has it, `/ROVER/photo`.

    Raises:
        ConfigError: ROS 2 does not take the name.
    """
    if not is_topic(topic):
        raise ConfigError(
            f"service {topic!r} cannot be in ROS 2: names consist of letters, digits, _ and /; "
            'ros_topic = "..." gives it another name there'
        )
    return service_of(robot, topic)


def _given(fields: Mapping[str, str], ours: type[Message], other: type[Message], front: str) -> dict[str, str]:
    """What is said of the fields of one of the two messages."""
    mine, others = ({field.name for field in fields_of(one)} for one in (ours, other))
    found = {}
    for name, path in fields.items():
        bare = name.removeprefix(front)
        if bare in mine and (bare != name or name not in others):
            found[bare] = path
        elif bare == name and name in mine & others:
            raise ConfigError(
                f"request and reply have a field {name!r}: write {_REQUEST}{name} or {_REPLY}{name} in ros_fields"
            )
    return found


def _usual_fields(ours: type[Message], theirs: type[Message]) -> dict[str, str]:
    mine, others = fields_of(ours), {field.name for field in fields_of(theirs)}
    if others == {_DUMMY}:
        return {}
    if others == {SUCCESS, MESSAGE}:
        found = {}
        for kind, name in ((bool, SUCCESS), (str, MESSAGE)):
            fitting = [field.name for field in mine if type(field.default) is kind]
            if fitting:
                found[fitting[0]] = name
        return found
    return fields_by_themselves(ours, theirs)
