"""Which services of a robot are services of ROS 2, too, under which names and in which form."""

from __future__ import annotations

from msbot.config import Binding, Blueprint, Library
from msbot.ros2.service_forms import ServiceForm, service_form, service_name
from msbot.service_types import ServiceType, service_type
from msbot.sim.model_part import message_class
from msbot_agent.ros.graph import EVERYBODY
from msbot_agent.space import Qos, Topic
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

SERVICE = Qos(depth=64, partitions=EVERYBODY, service=True)
"""As all services of ROS 2."""


@dataclass(frozen=True, slots=True)
class RosService:
    """A service of the robot in ROS 2."""

    binding: Binding
    kind: ServiceType
    """Our two messages."""
    name: str
    """`/ROVER/photo`."""
    form: ServiceForm

    @property
    def requests(self) -> Topic:
        """Where ROS 2 has its requests."""
        return Topic(f"rq{self.name}Request", self.form.request_type)

    @property
    def replies(self) -> Topic:
        """Where ROS 2 has its replies."""
        return Topic(f"rr{self.name}Reply", self.form.reply_type)


def ros_services(blueprint: Blueprint, library: Library) -> tuple[RosService, ...]:
    """The services with `ros = true`.

    Raises:
        ConfigError: ROS 2 has no form for one; the text names its topic and what to do.
    """
    found: dict[str, RosService] = {}
    for binding in blueprint.bindings:
        kind = service_type(binding.type_name)
        if kind is None or not binding.in_dds.ros or binding.topic in found:
            continue
        wish = binding.in_dds
        try:
            request, reply = (message_class(library.messages[one]) for one in kind)
            form = service_form(request, reply, wish.ros_type, dict(wish.ros_fields))
            name = service_name(blueprint.robot.name, wish.ros_topic or binding.topic)
        except ConfigError as error:
            raise ConfigError(f'the binding of "{binding.topic}" with ros = true: {error}') from None
        found[binding.topic] = RosService(binding, kind, name, form)
    return tuple(found.values())
